"""The package is typed: mypy --strict on it, its stub against the native module, and a user's program."""

import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

HERE = pathlib.Path(__file__).resolve().parent
PACKAGE = HERE.parent / "python"

PROGRAM = '''
import asyncio
from typing import Any
import numpy.typing as npt
from typing_extensions import assert_type
import gantry
import gantry.bench
import gantry.envs

with gantry.open("ego/front/rgb") as camera, gantry.open("mine/boxes", result="boxes2d") as boxes:
    assert_type(camera, gantry.Topic[gantry.Frame])
    assert_type(boxes.next(), gantry.Result)
    assert_type(boxes.next(0.5, or_none=True), gantry.Result | None)
    assert_type(boxes.poll(), gantry.Result | None)
    for frame in camera:
        assert_type(frame.array, npt.NDArray[Any])
        assert_type(frame.tick, int)

with gantry.publish("mine/tensor", "tensor") as topic, gantry.lockstep("mine") as lockstep:
    with topic.loan((2, 3), "f4") as a:
        assert_type(a, npt.NDArray[Any])
    with gantry.publish("mine/features", "tensor", device="cuda") as features, features.loan((2, 3)) as slot:
        assert_type(slot, gantry.GpuArray)
    for tick in lockstep:
        assert_type(tick.snapshot, gantry.Snapshot)
        gantry.vehicle(3).control(throttle=0.5)

drive = gantry.Recording("drive.mcap")
for frame in drive.frames("ego/front/rgb", start=1.0):
    assert_type(frame, gantry.Frame)
for recorded in drive.sync(["ego/front/rgb"], snapshots=True):
    assert_type(recorded.snapshot, gantry.Snapshot | None)

@gantry.bench.program(inputs={"image": "ego/front/rgb"}, output=("mine/found", "boxes2d"))
def detect(image: gantry.Frame) -> npt.NDArray[Any]:
    return gantry.boxes2d([[0, 0]], [[image.tick, 4]])

class Detector(gantry.bench.Program):
    inputs = {"image": "ego/front/rgb"}
    outputs = [gantry.bench.Output("mine/found", "boxes2d", classes=["person"])]

assert_type(gantry.bench.run(detect), gantry.bench.RunCounts)
gantry.bench.run(Detector(), lockstep="detector", n=3)

def straight(state: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return state[:, :2] * 0

envs = gantry.envs.DriveVectorEnv("LaneKeeping", 8, reward=lambda step: step.info["progress_m"], autoreset_mode="NextStep")
observations, infos = envs.reset(seed=[1, 2, None, 4, 5, 6, 7, 8])
observations, rewards, terminated, truncated, infos = envs.step(straight(observations))
one = gantry.envs.DriveEnv("EmergencyBrake")
assert_type(one.step(observations[0])[1], float)
result = gantry.envs.evaluate(straight, "LaneKeeping", range(20))
assert_type(result.score.low, float)
assert_type(result.solved, bool | None)

async def main() -> None:
    async for row in gantry.sync(["ego/front/rgb"], snapshots=True):
        assert_type(row.snapshot, gantry.Snapshot | None)
'''


class Types(unittest.TestCase):
    def run_module(self, *args, cwd=PACKAGE):
        done = subprocess.run([sys.executable, "-m", *args], cwd=cwd, capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def setUp(self):
        self.cache = tempfile.TemporaryDirectory()

    def tearDown(self):
        self.cache.cleanup()

    def test_the_package_passes_mypy_strict(self):
        self.run_module("mypy", "--strict", "--cache-dir", self.cache.name, "-p", "gantry")

    def test_the_stub_is_that_of_the_native_module(self):
        config = pathlib.Path(self.cache.name, "mypy.ini")
        config.write_text(f"[mypy]\ncache_dir = {self.cache.name}\n")
        self.run_module("mypy.stubtest", "--mypy-config-file", str(config), "gantry._native")

    def test_our_own_examples_and_those_of_the_pages_pass_mypy(self):
        """As far as what they import has types: cv2's stubs lack what people_detector.py calls, and carla has none."""
        root = HERE.parents[2]
        folder = pathlib.Path(self.cache.name)
        own = [*root.glob("examples/*/*.py"), *root.glob("consumers/consumer_python/examples/*.py")]
        files = [file for file in own if file.name not in ("people_detector.py", "collect.py")]
        for page in [*root.glob("docs/start/*.md"), *root.glob("docs/tutorials/*.md")]:
            for name, text in re.findall(r"<!-- file: (\S+\.py) -->\n```python\n(.*?)```", page.read_text(), re.S):
                if "import carla" not in text:
                    files.append(folder / f"{page.stem.replace('-', '_')}_{name}")
                    files[-1].write_text(text)
        self.assertGreater(len(files), 10)
        os.environ["MYPYPATH"] = str(PACKAGE)
        self.run_module("mypy", "--check-untyped-defs", "--ignore-missing-imports", "--cache-dir", self.cache.name, *map(str, files), cwd=self.cache.name)

    def test_users_learn_the_types_of_what_they_get(self):
        program = pathlib.Path(self.cache.name, "program.py")
        program.write_text(PROGRAM)
        os.environ["MYPYPATH"] = str(PACKAGE)
        self.run_module("mypy", "--strict", "--cache-dir", self.cache.name, str(program), cwd=self.cache.name)


if __name__ == "__main__":
    unittest.main()
