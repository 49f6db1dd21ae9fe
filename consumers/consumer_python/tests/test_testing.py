"""`gantry.testing`: what it starts, hands out, reports and removes. Needs the simulator, `cargo build --release --workspace`."""

import pathlib
import signal
import sys
import tempfile
import unittest
import warnings

import gantry
import numpy as np
from gantry import _domain
from gantry.testing import Program, Simulator
from gantry.testing._sandbox import Sandbox
from gantry.testing._simulator import _toml, find_program

WORLD = 'version = 1\n[scenario]\nmap = "Town10HD"\n'
RIG = WORLD + '[sensor.front]\nkind = "camera"\nmodalities = ["semantic"]\nwidth_px = 64\nheight_px = 48\n'
#: Answers every image with its tick.
ECHO = """
import contextlib, gantry
with contextlib.suppress(KeyboardInterrupt), gantry.publish("echo/text", "text") as out, gantry.open("ego/front/semantic", timeout=60) as camera:
    for frame in camera:
        out.send(f"tick {frame.tick}", answers=frame)
"""
SHARED_MEMORY = pathlib.Path("/dev/shm")


def left(prefix):
    return [path.name for path in SHARED_MEMORY.glob(prefix + "*")]


class Simulators(unittest.TestCase):
    def test_steps_a_program_and_hands_out_what_it_says_about_each_tick(self):
        with Simulator(text=RIG) as simulator:
            prefix = simulator._sandbox.prefix
            program = simulator.run(sys.executable, "-c", ECHO)
            simulator.watch("echo/text", "ego/front/semantic")
            simulator.wait_readers("ego/front/semantic", 2)
            for steps in (1, 1, 3):
                before = simulator.snapshot().tick
                tick = simulator.step(steps)
                self.assertEqual(tick, before + steps)
                self.assertEqual(simulator.result("echo/text", tick).text, f"tick {tick}")
                self.assertEqual(simulator.frame("ego/front/semantic", tick).array.shape, (48, 64))
                self.assertEqual(simulator.snapshot().tick, tick)
            # Functions without a domain mean this simulator.
            self.assertEqual(gantry.snapshot().tick, tick)
            with self.assertRaisesRegex(gantry.GantryError, "nothing of tick 1, the next is of tick"):
                simulator.step()
                simulator.frame("ego/front/semantic", 1)
            folder = simulator.folder
        self.assertEqual(program.exit_code, 0)
        self.assertFalse(folder.exists())
        self.assertEqual(left(prefix), [])
        self.assertEqual(_domain.sandboxes, [])

    def test_two_stand_side_by_side_and_a_killed_program_leaves_nothing(self):
        with Simulator(text=RIG) as one, Simulator(text=RIG, set={"scenario.seed": 5}) as other:
            program = one.run(sys.executable, "-c", ECHO)
            one.watch("echo/text")
            one.wait_readers("ego/front/semantic", 1)
            before = other.snapshot().tick
            tick = one.step(2)
            self.assertEqual(other.snapshot().tick, before)
            self.assertNotIn("echo/text", [topic.name for topic in gantry.topics(other.domain)])
            self.assertEqual(one.result("echo/text", tick).tick, tick)
            program.kill()
            one.programs.remove(program)

    def test_vehicles_are_spawned_where_the_ego_sees_them(self):
        with Simulator(text=WORLD) as simulator:
            simulator.step()
            ego = simulator.ego()
            actor = simulator.spawn_near_ego("vehicle.audi.tt", (10.0, 3.0, 0.5))
            simulator.step()
            poses = [gantry.Pose(*(tuple(at[name]) for name in gantry.Pose._fields)) for at in (ego["world_from_actor"], simulator.snapshot().actor(actor)["world_from_actor"])]
            at = np.linalg.inv(poses[0].matrix()) @ poses[1].matrix()
            np.testing.assert_allclose(at[:2, 3], [10.0, 3.0], atol=0.05)
            np.testing.assert_allclose(at[:3, :3], np.eye(3), atol=0.05)

    def test_failures_of_programs_come_with_their_output(self):
        with Simulator(text=WORLD) as simulator:
            broken = simulator.run(sys.executable, "-c", "raise SystemExit('no weights')")
            with self.assertRaisesRegex(gantry.GantryError, "ended with 1; its output:\n.*no weights"):
                simulator.watch("broken/boxes")
            simulator.programs.remove(broken)
            with self.assertRaisesRegex(gantry.GantryError, "never said 'ready'.*\nhello"):
                simulator.run(sys.executable, "-c", "print('hello')").wait_line("ready")
            with self.assertRaisesRegex(gantry.GantryError, "cannot be started"):
                simulator.run("./no-such-program")
            with self.assertRaisesRegex(gantry.GantryError, "watch"):
                simulator.frame("ego/front/rgb", 1)

    def test_a_launch_file_that_is_wrong_is_said_by_the_simulator(self):
        with self.assertRaisesRegex(gantry.GantryError, "mapp"):
            Simulator(text="version = 1\n[scenario]\nmapp = 'Town10HD'\n")
        self.assertEqual(_domain.sandboxes, [])
        with self.assertRaisesRegex(ValueError, "either a launch file or the text"):
            Simulator()
        with self.assertRaisesRegex(gantry.GantryError, "no program 'simd' in /nowhere; build"):
            Simulator(text=WORLD, gantry_bin="/nowhere")

    def test_what_is_left_in_shared_memory_is_named_and_removed(self):
        simulator = Simulator(text=WORLD)
        lost = SHARED_MEMORY / f"{simulator._sandbox.prefix}lost"
        lost.write_bytes(b"x")
        with self.assertRaisesRegex(gantry.GantryError, "left in /dev/shm: " + lost.name):
            simulator.close()
        self.assertFalse(lost.exists())
        simulator.close()

    def test_an_array_that_is_held_is_told_and_stays_readable(self):
        with self.assertWarnsRegex(ResourceWarning, "still holds"), Simulator(text=RIG) as simulator:
            prefix = simulator._sandbox.prefix
            simulator.watch("ego/front/semantic")
            frame = simulator.frame("ego/front/semantic", simulator.step())
        self.assertEqual(frame.array.shape, (48, 64))
        self.assertEqual(left(prefix), [])
        del frame
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            with Simulator(text=WORLD) as simulator:
                simulator.step()


class Programs(unittest.TestCase):
    def test_one_that_is_started_in_the_background_heeds_interrupts(self):
        # As a shell does with `python -m pytest &`.
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            with Simulator(text=RIG) as simulator:
                program = simulator.run(sys.executable, "-c", ECHO)
                simulator.wait_readers("ego/front/semantic", 1)
                program.stop(timeout=60.0)
        finally:
            signal.signal(signal.SIGINT, before)
        self.assertEqual(program.exit_code, 0)


class Sandboxes(unittest.TestCase):
    def test_programs_find_their_files_and_the_private_configuration(self):
        sandbox = Sandbox()
        with tempfile.TemporaryDirectory() as folder:
            project = pathlib.Path(folder)
            (project / "weights.bin").write_text("weights")
            (project / "config").mkdir()
            (project / "config" / "model.toml").write_text("model")
            (project / "config" / "iceoryx2.toml").write_text("theirs")
            place = sandbox.links_to(project)
            words = "import pathlib; print(pathlib.Path('weights.bin').read_text(), pathlib.Path('config/model.toml').read_text())"
            program = Program([sys.executable, "-c", words], str(place), {})
            self.assertEqual((program.wait(), program.output), (0, "weights model"))
            self.assertIn(sandbox.prefix, (place / "config" / "iceoryx2.toml").read_text())
            (place / "written").write_text("x")
            self.assertFalse((project / "written").exists())
            self.assertEqual(sandbox.leave(), ([], True))
            self.assertEqual((project / "config" / "iceoryx2.toml").read_text(), "theirs")

    def test_programs_are_found_in_the_checkout_or_where_they_are_said_to_be(self):
        simd = find_program("simd")
        self.assertEqual(find_program("simd", pathlib.Path(simd).parent), simd)

    def test_values_are_written_as_toml(self):
        self.assertEqual(_toml({"a": [1, 2.5], "b": "x\"y", "c": True}), '{ "a" = [1, 2.5], "b" = "x\\"y", "c" = true }')


if __name__ == "__main__":
    unittest.main()
