"""`gantry.bench`: what programs may say, and that one program runs in every mode. Needs the simulator, `cargo build --release --workspace`."""

import pathlib
import sys
import unittest

import gantry
import gantry.bench
import numpy as np
from gantry.bench._program import outputs_of
from gantry.bench._run import _nothing
from gantry.testing import Simulator

WORLD = 'version = 1\n[scenario]\nmap = "Town10HD"\ntick_hz = 20\n'
CAMERA = '[sensor.{name}]\nkind = "camera"\nmodalities = ["semantic"]\nwidth_px = 64\nheight_px = 48\nrate_hz = {rate}\n'
#: Ticks at 20 Hz, `front` at 20 Hz, `left` at 10 Hz: every second tick has both.
RIG = WORLD + CAMERA.format(name="front", rate=20) + CAMERA.format(name="left", rate=10)
#: A box per image whose score is that of the program's warm-up, and whose class counts the images so far.
PROGRAM = """
import gantry, gantry.bench, time

class Counter(gantry.bench.Program):
    inputs = {"image": "ego/front/semantic"}
    outputs = [gantry.bench.Output("mine/boxes", "boxes2d", classes=["a", "b"])]
    n = 0

    def warm_up(self):
        self.score = 0.25 if gantry.bench.params().get("low") else 0.75

    def work(self, image):
        assert image.array.shape == (48, 64)
        self.n += 1
        time.sleep(gantry.bench.params().get("sleep_s", 0.0))
        return gantry.boxes2d([[0, 0]], [[4, 4]], score=self.score, class_=self.n)

print(gantry.bench.run(Counter()))
"""
PAIR = """
import gantry, gantry.bench

@gantry.bench.program(inputs={"front": "ego/front/semantic", "left": "ego/left/semantic"}, outputs=[("mine/text", "text"), ("mine/boxes", "boxes2d")])
def pair(front, left):
    assert front.tick == left.tick
    return {"mine/text": f"{front.tick}", "mine/boxes": []}

gantry.bench.run(pair)
"""


class Declarations(unittest.TestCase):
    def test_a_decorated_function_is_a_program_and_still_the_function(self):
        @gantry.bench.program(inputs={"image": "ego/front/rgb"}, output=("mine/boxes", "boxes2d"))
        def detect(image):
            "Finds."
            return image + 1

        self.assertEqual((detect(1), detect.work(image=2), detect.name(), detect.__doc__), (2, 3, "detect", "Finds."))
        self.assertEqual([(one.topic, one.type) for one in outputs_of(detect)], [("mine/boxes", "boxes2d")])

    def test_what_cannot_be_a_program_is_refused_with_a_sentence(self):
        with self.assertRaisesRegex(ValueError, "detect cannot be called with the inputs picture: .*; name its parameters as the inputs"):

            @gantry.bench.program(inputs={"picture": "ego/front/rgb"}, output=("mine/boxes", "boxes2d"))
            def detect(image):
                return image

        with self.assertRaisesRegex(ValueError, "'boxes' is no type of results; it must be one of image, tensor, boxes2d"):
            gantry.bench.Output("mine/boxes", "boxes")
        with self.assertRaisesRegex(ValueError, "Program publishes nothing; it needs one output"):
            gantry.bench.run(gantry.bench.Program())
        twice = gantry.bench.Program()
        twice.outputs = [("a/b", "text"), ("a/b", "json")]
        with self.assertRaisesRegex(ValueError, "publishes a/b, a/b; it needs .* each on a topic of its own"):
            gantry.bench.run(twice)
        blind = gantry.bench.Program()
        blind.outputs = ("a/b", "text")
        with self.assertRaisesRegex(ValueError, "has no inputs; name at least one topic"):
            gantry.bench.run(blind)

    def test_settings_are_the_last_argument_if_it_is_an_object(self):
        self.assertEqual(gantry.bench.params(["--fast"]), {})
        self.assertEqual(gantry.bench.params([]), {})
        self.assertEqual(gantry.bench.params(["x", '{"a": 1, "lockstep": "me"}']), {"a": 1, "lockstep": "me"})
        with self.assertRaisesRegex(gantry.GantryError, "settings in the last argument cannot be read: .*JSON object"):
            gantry.bench.params(["{'a': 1}"])

    def test_an_empty_list_is_no_records_of_every_type_of_records(self):
        for type_ in ("boxes2d", "boxes3d", "tracks", "path"):
            self.assertEqual(len(_nothing(type_)), 0)
        for type_ in ("masks", "keypoints"):
            self.assertEqual((len(_nothing(type_).records), len(_nothing(type_).tail)), (0, 0))
        self.assertEqual(_nothing("json"), [])


class Modes(unittest.TestCase):
    """Every test runs the same file, as a process of its own."""

    def run_program(self, simulator, text, settings="{}"):
        return simulator.run(sys.executable, "-c", text, settings)

    def test_each_step_is_answered_with_the_frame_that_it_shows(self):
        with Simulator(text=RIG) as simulator:
            program = self.run_program(simulator, PROGRAM, '{"low": true}')
            simulator.watch("mine/boxes")
            simulator.wait_readers("ego/front/semantic", 1)
            for n in (1, 2, 3):
                tick = simulator.step()
                result = simulator.result("mine/boxes", tick)
                self.assertEqual((result.array["score"][0], result.array["class"][0], result.classes), (0.25, n, ["a", "b"]))
                self.assertEqual([(one.topic, one.tick) for one in result.inputs], [("ego/front/semantic", tick)])
                del result
        self.assertEqual(program.exit_code, 0)
        self.assertIn("RunCounts(worked=3, answered=3, skipped=0, lost=0", program.output)

    def test_in_lockstep_every_frame_is_answered_before_the_world_goes_on(self):
        # The program sleeps longer than two ticks last, in a world that would otherwise go on by the clock.
        with Simulator(text=RIG, set={"scenario.mode": "free_running"}, args=["--await-participant", "counter"]) as simulator:
            program = self.run_program(simulator, PROGRAM, '{"lockstep": "counter", "sleep_s": 0.12}')
            simulator.watch("mine/boxes")
            ticks = []
            while len(ticks) < 6:
                result = simulator.wait_until(lambda: simulator._topics["mine/boxes"].next(0.1, or_none=True), "a result")
                ticks.append(result.tick)
                del result
            self.assertEqual(ticks, list(range(ticks[0], ticks[0] + 6)))
            # The tick before this one has an answer already, although nobody took it yet.
            now, last = simulator.snapshot().tick, ticks[-1]
            while (result := simulator._topics["mine/boxes"].poll()) is not None:
                last = result.tick
                del result
            self.assertGreaterEqual(last, now - 1)
        self.assertEqual(program.exit_code, 0)

    def test_in_real_time_a_slow_program_gets_the_newest_frame(self):
        with Simulator(text=RIG, set={"scenario.mode": "free_running"}) as simulator:
            program = self.run_program(simulator, PROGRAM, '{"sleep_s": 0.5}')
            simulator.watch("mine/boxes")
            ticks = []
            while len(ticks) < 6:
                result = simulator.wait_until(lambda: simulator._topics["mine/boxes"].next(0.1, or_none=True), "a result")
                ticks.append(result.tick)
                del result
            # It works for ten ticks; a queue would give it tick after tick.
            self.assertTrue(all(b - a >= 2 for a, b in zip(ticks, ticks[1:])), ticks)
        self.assertEqual(program.exit_code, 0)
        self.assertNotIn("skipped=0,", program.output)

    def test_several_inputs_come_tick_by_tick_and_nothing_found_is_an_answer(self):
        for settings in ("{}", '{"lockstep": "pair"}'):
            with Simulator(text=RIG) as simulator:
                program = self.run_program(simulator, PAIR, settings)
                simulator.watch("mine/text", "mine/boxes")
                simulator.wait_readers("ego/left/semantic", 1)
                if settings != "{}":
                    simulator.wait_until(lambda: "pair" in gantry.document("world/info").json()["lockstep"] or None, "the program takes part")
                answered = []
                for _ in range(4):
                    tick = simulator.step()
                    # `left` fires at every second tick, and only what has both is worked on.
                    if (tick - 1) % 2 == 0:
                        self.assertEqual(simulator.result("mine/text", tick).text, f"{tick}")
                        boxes = simulator.result("mine/boxes", tick)
                        self.assertEqual((len(boxes.array), [one.topic for one in boxes.inputs]), (0, ["ego/front/semantic", "ego/left/semantic"]))
                        answered.append(tick)
                        del boxes
                self.assertEqual(len(answered), 2)
            self.assertEqual(program.exit_code, 0, program.output)

    def test_what_a_program_raises_ends_it_with_its_own_words(self):
        with Simulator(text=RIG) as simulator:
            broken = PROGRAM.replace("self.n += 1", "raise RuntimeError('no weights')")
            program = self.run_program(simulator, broken)
            simulator.watch("mine/boxes")
            simulator.wait_readers("ego/front/semantic", 1)
            with self.assertRaisesRegex(gantry.GantryError, "no weights"):
                simulator.step()
                simulator.result("mine/boxes", 1)
            simulator.programs.remove(program)


class InThisProcess(unittest.TestCase):
    def test_run_returns_after_so_many_ticks_with_its_counts(self):
        @gantry.bench.program(inputs={"image": "ego/front/semantic"}, output=("mine/masks", "masks"), every=True)
        def silent_every_second(image):
            return None if image.seq % 2 else gantry.masks([np.ones((48, 64), bool)])

        with Simulator(text=RIG, set={"scenario.mode": "free_running"}):
            counts = gantry.bench.run(silent_every_second, n=6)
        self.assertEqual((counts.worked, counts.skipped), (6, 0))
        self.assertGreaterEqual(counts.answered, 2)
        self.assertGreater(counts.work_secs, 0.0)


if __name__ == "__main__":
    unittest.main()
