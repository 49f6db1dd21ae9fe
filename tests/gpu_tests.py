#!/usr/bin/env python3
"""Every test that needs a GPU to say anything, in one run, with its output kept.

  tests/gpu_tests.py go [--log FILE]    builds what is missing and runs them on this machine
  tests/gpu_tests.py pack FILE.tar.xz   packs what is built for a machine that has a GPU but no Rust
  tests/gpu_tests.py unpack FILE.tar.xz there, in a checkout at the same commit: lays the programs in place

CI draws by Mesa's software adapter and puts a stand-in in CUDA's place. Here are the same test programs on a GPU
(sensor_gpu, sensor_camera, sensor_ray, test_render), and what only NVIDIA's driver can show of consumer_gpu and of the
Python package, with torch: frames that stay on the GPU against those of shared memory, every topic byte for byte; a
batch; results of every type; readers and writers that are killed. Needs Python with torch and numpy.

consumer_gpu's own tests map the software adapter's memory, which is a file, and so stay with CI. So do the tests that
hold generated code bit by bit against the software adapter: a GPU weighs its texels with eight bits.

Test programs know the path that they were built at: unpack makes a link of that path, or says that it cannot.
Ends with 1 if anything failed; the last line says what.
"""

import argparse
import json
import os
import pathlib
import platform
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[1]
BUILT = ROOT / "target" / "release"
LIST = BUILT / "gpu_tests.json"
CRATES = ("sensors/sensor_gpu", "sensors/sensor_camera", "sensors/sensor_ray", "tests/test_render")
# Held against the software adapter bit by bit.
ONLY_SOFTWARE = ("lanes::every_shading_function", "lanes::every_resolving_function")
# One file of all programs, under the names that the tests start.
ALL, PROGRAMS = "launch_all", ("simd", "gantry", "gantry-drive", "gantry-render")
PACKAGE = ROOT / "consumers" / "consumer_python" / "python"
BENCHES = ROOT / "consumers" / "consumer_python" / "benches"
# Long enough for a whole test program, and a limit where one hangs.
PATIENCE_S = 900
RIG = """version = 1
[scenario]
map = "Town10HD"
seed = 3
tick_hz = 20
mode = "stepped"
vehicles = 12
lidars_on = "gpu"
[sensor.front]
kind = "camera"
modalities = ["rgb", "depth", "semantic", "instance", "flow", "normals", "dvs"]
rate_hz = 20
width_px = 800
height_px = 600
mount.position_m = [0.6, 0.0, 1.6]
[sensor.roof]
kind = "lidar"
rate_hz = 20
channels = 64
columns = 1024
mount.position_m = [0.0, 0.0, 2.0]
"""
TOPICS = [f"ego/front/{name}" for name in ("rgb", "depth", "semantic", "instance", "flow", "normals", "dvs")] + ["ego/roof/lidar"]


def fail(sentence, code=2):
    print(f"error: {sentence}", file=sys.stderr)
    sys.exit(code)


def build():
    """Builds programs and test programs, and notes where the latter are."""
    cargo = ["cargo", "build", "--release", "--workspace", "--lib", "--bins", "--examples"]
    subprocess.run(cargo, cwd=ROOT, check=True)
    cargo = ["cargo", "test", "--release", "--workspace", "--no-run", "--test", "it", "--message-format=json"]
    lines = subprocess.run(cargo, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()
    made = {}
    for line in lines:
        message = json.loads(line) if line.startswith("{") else {}
        if message.get("executable") and message["profile"]["test"]:
            crate = pathlib.Path(message["manifest_path"]).parent.relative_to(ROOT)
            made[str(crate)] = str(pathlib.Path(message["executable"]).relative_to(ROOT))
    commit = subprocess.check_output(["git", "describe", "--always", "--dirty", "--abbrev=12"], cwd=ROOT, text=True)
    LIST.write_text(json.dumps({"root": str(ROOT), "commit": commit.strip(), "tests": {name: made[name] for name in CRATES}}))


def pack(file):
    """Everything that `go` runs, without symbols."""
    build()
    tests = json.loads(LIST.read_text())["tests"]
    files = [*tests.values(), f"target/release/{ALL}", "target/release/libconsumer_python.so"]
    with tempfile.TemporaryDirectory() as folder, tarfile.open(file, "w:xz", preset=9) as archive:
        archive.add(LIST, LIST.relative_to(ROOT))
        for name in files:
            bare = pathlib.Path(folder, "bare")
            subprocess.run(["strip", "-o", bare, ROOT / name], check=True)
            archive.add(bare, name)


def unpack(file):
    with tarfile.open(file) as archive:
        archive.extractall(ROOT, filter="data")
    for name in PROGRAMS:
        (BUILT / name).unlink(missing_ok=True)
        (BUILT / name).hardlink_to(BUILT / ALL)
    built_at = pathlib.Path(json.loads(LIST.read_text())["root"])
    if built_at != ROOT and not (built_at.is_symlink() and built_at.resolve() == ROOT):
        if built_at.exists():
            fail(f"the test programs were built at {built_at}, where something else is; unpack them on another machine")
        built_at.parent.mkdir(parents=True, exist_ok=True)
        built_at.symlink_to(ROOT)


class Run:
    """What was run, and what failed."""

    def __init__(self, log):
        self.log, self.failed = log, []

    def say(self, text):
        print(text, flush=True)
        self.log.write(text + "\n")
        self.log.flush()

    def program(self, name, command, folder=ROOT, shown=lambda line: True):
        """Runs a program; its output, of which `shown` lines are logged if it is well, and all if not."""
        self.say(f"== {name}")
        began, env = time.monotonic(), dict(os.environ, PYTHONPATH=str(PACKAGE), CARGO_MANIFEST_DIR=str(folder))
        try:
            ended = subprocess.run(
                command, cwd=folder, env=env, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=PATIENCE_S
            )
            code, output = ended.returncode, ended.stdout
        except subprocess.TimeoutExpired as late:
            code, output = f"not over after {PATIENCE_S} s", (late.stdout or b"").decode(errors="replace")
        for line in output.splitlines():
            if code != 0 or shown(line):
                self.say(line)
        self.say(f"ended with {code} after {time.monotonic() - began:.1f} s")
        if code != 0:
            self.failed.append(name)


def answers(simulator, domain):
    """Waits until a simulator answers."""
    import gantry

    for _ in range(600):
        try:
            return gantry.command({"do": "ping"}, domain=domain)
        except gantry.NoSuchTopicError:
            assert simulator.poll() is None, f"simd ended with {simulator.returncode}"
            time.sleep(0.1)
    raise AssertionError("no answer of simd within a minute")


def frames_are_equal(n_steps=40):
    """Every topic of the rig, read from the GPU and from shared memory: the same bytes."""
    import gantry
    import torch

    with tempfile.TemporaryDirectory() as folder:
        launch = pathlib.Path(folder, "rig.toml")
        launch.write_text(RIG)
        domain = f"gpu-tests-{os.getpid()}"
        simulator = subprocess.Popen([BUILT / "simd", "--launch", launch, "--domain", domain, "--adapter", "0"], stdout=subprocess.DEVNULL)
        try:
            answers(simulator, domain)
            pairs = [(gantry.open(name, domain=domain, device="cuda"), gantry.open(name, domain=domain)) for name in TOPICS]
            n_equal, n_bytes = dict.fromkeys(TOPICS, 0), dict.fromkeys(TOPICS, 0)
            for _ in range(n_steps):
                gantry.step(domain=domain)
                for name, (there, here) in zip(TOPICS, pairs):
                    on_gpu, on_host = there.next(timeout=30), here.next(timeout=30)
                    assert on_gpu.tick == on_host.tick, f"{name}: tick {on_gpu.tick} on the GPU, {on_host.tick} in shared memory"
                    seen = torch.from_dlpack(on_gpu)
                    assert seen.is_cuda, f"{name} was uploaded to {seen.device}"
                    shown, wanted = seen.cpu().contiguous().view(torch.uint8).numpy().tobytes(), on_host.array.tobytes()
                    assert shown == wanted, f"{name} differs at tick {on_host.tick}"
                    n_equal[name] += 1
                    n_bytes[name] += len(wanted)
            for name in TOPICS:
                assert n_bytes[name] > 0, f"{name} was empty in all {n_steps} frames"
                print(f"{name}: {n_equal[name]} frames equal, {n_bytes[name]} bytes")
        finally:
            simulator.terminate()
            simulator.wait(30)


def go(file):
    if not LIST.is_file():
        build()
    known = json.loads(LIST.read_text())
    with open(file, "w", encoding="utf-8") as log:
        run = Run(log)
        run.say(f"commit {known['commit']}, {platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.2f}, {time.strftime('%Y-%m-%d')}")
        asked = ["nvidia-smi", "--query-gpu=name,driver_version", "--format=csv,noheader"]
        run.say(subprocess.run(asked, stdout=subprocess.PIPE, text=True, check=True).stdout.strip() if shutil.which(asked[0]) else "no nvidia-smi")
        run.program("adapters", [BUILT / "simd", "--adapters"])
        link = PACKAGE / "gantry" / "_native.abi3.so"
        if not link.exists():
            link.unlink(missing_ok=True)
            link.symlink_to(BUILT / "libconsumer_python.so")
        quiet = re.compile(r"^(test .* \.\.\. ok|test .* has been running.*|)$")
        for crate, program in known["tests"].items():
            command = [ROOT / program, "--test-threads=8", *(word for name in ONLY_SOFTWARE for word in ("--skip", name))]
            run.program(pathlib.Path(crate).name, command, ROOT / crate, lambda line: not quiet.match(line))
        python = sys.executable
        run.program("frames on the GPU", [python, __file__, "frames"])
        run.program("batches on the GPU", [python, BENCHES / "batches.py", "--cameras", "16", "--frames", "100"])
        run.program("results on the GPU", [python, BENCHES / "gpu_results.py", "--n", "100", "--kills", "12"])
        run.say(f"failed: {', '.join(run.failed)}" if run.failed else "all passed")
    sys.exit(1 if run.failed else 0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ways = parser.add_subparsers(dest="way", required=True)
    ways.add_parser("go").add_argument("--log", default="gpu_tests.txt")
    for way in ("pack", "unpack"):
        ways.add_parser(way).add_argument("file")
    ways.add_parser("frames")
    arguments = parser.parse_args()
    match arguments.way:
        case "go":
            go(arguments.log)
        case "pack":
            pack(arguments.file)
        case "unpack":
            unpack(arguments.file)
        case "frames":
            sys.path.insert(0, str(PACKAGE))
            frames_are_equal()


if __name__ == "__main__":
    main()
