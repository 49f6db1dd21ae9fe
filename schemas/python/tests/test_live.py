"""Frames read live from another process: the Rust example `test_card`, in a private iceoryx2 root and prefix."""

import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import textwrap
import unittest

HERE = pathlib.Path(__file__).resolve().parent
SOURCE = HERE.parent / "src"
TEST_CARD = pathlib.Path(os.environ.get("GANTRY_TEST_CARD", HERE.parents[2] / "target" / "release" / "examples" / "test_card"))


class Live(unittest.TestCase):
    """Each script runs in its own process, because iceoryx2 reads its configuration once per process, from the working directory."""

    def setUp(self):
        self.assertTrue(TEST_CARD.exists(), f"{TEST_CARD} is missing; build it: cargo build --release -p schema_bus --example test_card")
        self.folder = pathlib.Path(tempfile.mkdtemp())
        self.prefix = f"gpy{os.getpid()}_"
        (self.folder / "config").mkdir()
        config = f'[global]\nroot-path = "{self.folder}/iox"\nprefix = "{self.prefix}"\n'
        (self.folder / "config" / "iceoryx2.toml").write_text(config)
        self.card = subprocess.Popen([TEST_CARD, "live", "60"], cwd=self.folder, stdout=subprocess.PIPE, text=True)
        self.assertIn("test card on live", self.card.stdout.readline())

    def tearDown(self):
        self.card.kill()
        self.card.wait()
        self.card.stdout.close()
        for path in pathlib.Path("/dev/shm").glob(self.prefix + "*"):
            path.unlink()
        shutil.rmtree(self.folder)

    def script(self, text):
        env = {**os.environ, "PYTHONPATH": str(SOURCE)}
        code = "import gantry, numpy as np\n" + textwrap.dedent(text)
        done = subprocess.run([sys.executable, "-c", code], cwd=self.folder, env=env, capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return done.stdout

    def test_every_frame_kind_is_read_in_place(self):
        self.script("""
            names = [topic.name for topic in gantry.topics("live") if topic.modality]
            assert len(names) == 15, names
            for name in names:
                with gantry.open(name, domain="live") as topic:
                    frame = topic.next(timeout=10)
                    assert frame is not None, name
                    assert frame.topic == name and frame.header.seq == frame.tick
                    assert not frame.array.flags.writeable
                    first = frame.array.reshape(-1)[:1].copy().view(np.uint8)
                    assert first[0] == frame.tick % 256, (name, first, frame.tick)
                    assert frame.header.world_from_sensor.translation_m[2] == frame.tick
        """)

    def test_an_array_keeps_its_sample_although_the_frame_is_gone(self):
        self.script("""
            with gantry.open("ego/card/rgb", domain="live") as topic:
                frame = topic.next(timeout=10)
                tick, array = frame.tick, frame.array[1:, 2:]
                before = array.copy()
                del frame
                for _ in range(20):
                    assert topic.next(timeout=10) is not None
                assert (array == before).all()
        """)

    def test_a_busy_wait_takes_frames_in_order_and_ends_in_time(self):
        self.script("""
            import time
            with gantry.open("ego/card/rgb", domain="live") as topic:
                seqs = [topic.next(timeout=10, busy_wait=10).header.seq for _ in range(20)]
                # A reader that the machine leaves waiting loses its oldest frames, and counts them.
                assert all(a < b for a, b in zip(seqs, seqs[1:])) and seqs[-1] - seqs[0] == 19 + topic.counts.lost, (seqs, topic.counts)
            with gantry.open("ego/card/collision", domain="live") as topic:
                while topic.next(timeout=0.0) is not None:
                    pass
                began = time.monotonic()
                while topic.next(timeout=0.0, busy_wait=10) is not None:
                    pass
                assert time.monotonic() - began < 10
        """)

    def test_the_newest_is_newer_and_skips_are_counted(self):
        self.script("""
            import time
            with gantry.open("ego/card/imu", domain="live") as topic:
                last, taken, gap = topic.next(timeout=10), 1, 0
                # A writer that the machine leaves waiting needs longer for three frames.
                while gap <= 2 and taken < 300:
                    time.sleep(0.2)
                    newer, taken = topic.latest(timeout=10), taken + 1
                    last, gap = newer, newer.tick - last.tick
                assert gap > 2, gap
                assert topic.counts.skipped >= 2 and topic.counts.taken == taken, topic.counts
        """)

    def test_sync_gives_frames_of_one_tick(self):
        self.script("""
            names = ["ego/card/rgb", "ego/card/depth", "ego/card/lidar"]
            with gantry.sync(names, domain="live") as rows:
                for _ in range(5):
                    row = rows.next(timeout=10)
                    assert {row[name].tick for name in names} == {row.tick}
                    del row
        """)

    def test_traps_are_explained(self):
        self.script("""
            try:
                gantry.open("ego/nope/rgb", domain="live")
            except gantry.NoSuchTopicError as error:
                assert "there is ego/card/rgb" in str(error), error
            else:
                raise AssertionError("opened a topic that is not there")
            try:
                gantry.open("ego/card/rgb", domain="nobody")
            except gantry.NoSuchTopicError as error:
                assert "nothing runs on domain 'nobody'" in str(error), error
            held = []
            with gantry.open("ego/card/rgb", domain="live") as topic:
                try:
                    while len(held) < 9:
                        held.append(topic.next(timeout=10))
                except gantry.BorrowLimitError as error:
                    assert len(held) == 3 and "keep frame.copy()" in str(error), error
                else:
                    raise AssertionError("no borrow limit")
        """)

    def test_world_documents_and_commands(self):
        self.script("""
            snapshot = gantry.snapshot("live")
            assert snapshot.actor(7)["world_from_actor"]["translation_m"][0] == snapshot.tick
            assert snapshot.vehicle_parts["gear"].tolist() == [3]
            assert gantry.document("world/info", "live").json()["map"] == "TestCard"
            assert gantry.command({"do": "ping"}, domain="live") == [{"is": "pong", "version": "test_card"}]
            try:
                gantry.command({"do": "fly"}, domain="live")
            except gantry.GantryError as error:
                assert "unknown variant" in str(error), error
            else:
                raise AssertionError("an unknown command was taken")
        """)


if __name__ == "__main__":
    unittest.main()
