"""Recordings read with the package and with PyPI's mcap, which share no code."""

import os
import pathlib
import subprocess
import sys
import tempfile
import threading
import unittest

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "python"))

import gantry  # noqa: E402
import gantry.bench  # noqa: E402

EXAMPLES = pathlib.Path(os.environ.get("GANTRY_TEST_CARD", HERE.parents[2] / "target" / "release" / "examples" / "test_card")).parent
N_TICKS = 12
PERIOD_SECS = 0.05


def decoded(path):
    """Yields topic, seconds and message of everything in a file."""
    with open(path, "rb") as file:
        for _, channel, message, proto in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(log_time_order=False):
            yield channel.topic, message, proto


def pictures_only(source, path, topic):
    """Copies a recording as if one topic's frames had been kept as JPEG files alone."""
    with open(source, "rb") as file, open(path, "wb") as out:
        writer, channels = Writer(out), {}
        writer.start()
        for schema, channel, message, proto in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            if channel.topic not in channels:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, schema_id, dict(channel.metadata))
            data = message.data
            if channel.topic == f"/{topic}/gantry":
                proto.codec = "jpeg"
                data = proto.SerializeToString()
            writer.add_message(channels[channel.topic], message.log_time, data, message.publish_time, message.sequence)
        writer.finish()


def of_a_run(source, path):
    """Copies a recording, with what a recorder says about its version and its run."""
    with open(source, "rb") as file, open(path, "wb") as out:
        writer, channels = Writer(out), {}
        writer.start()
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.id not in channels:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, schema_id, dict(channel.metadata))
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence)
        writer.add_metadata("gantry", {"domain": "sample", "schema_version": str(gantry.SCHEMA_VERSION)})
        writer.add_metadata("world/info", {"epoch": "77"})
        writer.finish()


class Recordings(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.sample = os.path.join(cls.folder.name, "sample.mcap")
        cls.results = os.path.join(cls.folder.name, "results.mcap")
        for example, path in (("record_sample", cls.sample), ("record_results", cls.results)):
            subprocess.run([EXAMPLES / example, path, str(N_TICKS)], check=True, stdout=subprocess.DEVNULL)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def test_every_frame_is_what_another_reader_finds(self):
        found = {(frame.topic, frame.tick): frame for frame in gantry.Recording(self.sample).frames()}
        heads, shown = {}, {}
        for topic, message, proto in decoded(self.sample):
            place = (topic.removesuffix("/gantry")[1:], message.log_time // 50_000_000)
            (heads if topic.endswith("/gantry") else shown)[place] = proto
        self.assertEqual(set(found), set(heads))
        self.assertEqual(len({topic for topic, _ in found}), 9)
        for place, frame in found.items():
            with self.subTest(place):
                self.assertEqual(frame.header_bytes(), heads[place].header)
                payload = shown[place].data if heads[place].payload_topic else heads[place].payload
                self.assertEqual(np.ascontiguousarray(frame.array).tobytes(), payload)
                self.assertFalse(frame.array.flags.writeable)

    def test_frames_that_were_kept_as_pictures_are_a_sentence(self):
        path = os.path.join(self.folder.name, "pictures.mcap")
        pictures_only(self.sample, path, "ego/front/rgb")
        drive = gantry.Recording(path)
        # Eight other topics have their frames.
        self.assertEqual(len({frame.topic for frame in drive.frames()}), 8)
        for read in (lambda: drive.frames("ego/front/rgb"), lambda: drive.sync(["ego/front/rgb"])):
            with self.assertRaisesRegex(gantry.GantryError, f"none of {N_TICKS} frames .*only a picture for people was kept.*--jpeg"):
                list(read())

    def test_times_and_patterns_choose(self):
        drive = gantry.Recording(self.sample)
        self.assertAlmostEqual(drive.end, N_TICKS * PERIOD_SECS)
        ticks = [frame.tick for frame in drive.frames("ego/front/rgb", start=4 * PERIOD_SECS, end=7 * PERIOD_SECS)]
        self.assertEqual(ticks, [4, 5, 6])
        topics = {frame.topic for frame in drive.frames("ego/front/*", "*/imu")}
        self.assertIn("ego/imu/imu", topics)
        self.assertNotIn("ego/gnss/gnss", topics)
        self.assertEqual(list(drive.frames("nobody/*")), [])
        with self.assertRaisesRegex(ValueError, "end is 1.0 s, but must not be before start, 2.0 s"):
            drive.frames(start=2.0, end=1.0)
        with self.assertRaisesRegex(ValueError, "the time is -1.0 s"):
            drive.frames(start=-1.0)

    def test_what_belongs_to_a_file_is_read(self):
        drive = gantry.Recording(self.sample)
        kinds = {topic.name: topic.kind for topic in drive.topics}
        self.assertEqual((kinds["ego/front/rgb"], kinds["world/snapshot"], kinds["world/info"]), ("frame", "snapshot", "document"))
        self.assertTrue(drive.is_complete)
        self.assertEqual(drive.metadata["gantry"]["domain"], "sample")
        self.assertEqual((drive.attachments, drive.attachment("Sample.xodr")), (["Sample.xodr"], b"<OpenDRIVE/>"))
        self.assertEqual(drive.document("world/info").json(), {"map": "Sample"})
        with self.assertRaisesRegex(KeyError, "no attachment 'other'; it has Sample.xodr"):
            drive.attachment("other")
        with self.assertRaisesRegex(KeyError, "no document 'world/catalogue'"):
            drive.document("world/catalogue")
        worlds = list(drive.snapshots())
        self.assertEqual([world.tick for world in worlds], list(range(1, N_TICKS + 1)))
        expected = [proto.records for topic, _, proto in decoded(self.sample) if topic == "/world/snapshot"]
        self.assertEqual([world.actors.tobytes() for world in worlds], expected)

    def test_rows_hold_one_tick_of_every_topic(self):
        drive = gantry.Recording(self.sample)
        rows = list(drive.sync(["ego/front/rgb", "ego/front/depth"], snapshots=True))
        self.assertEqual([row.tick for row in rows], list(range(1, N_TICKS + 1)))
        for row in rows:
            self.assertEqual({frame.tick for frame in row.values()}, {row.tick})
            self.assertEqual(row.snapshot.tick, row.tick)
        with self.assertRaisesRegex(gantry.GantryError, "no frames or results of ego/front/rbg; it has .*ego/front/rgb"):
            drive.sync(["ego/front/rbg"])

    def test_a_tick_is_found_without_reading_what_lies_before(self):
        with gantry.Recording(self.sample) as drive:
            self.assertEqual(len(drive), N_TICKS)
            for wanted in drive.frames("ego/front/rgb"):
                found = drive.frame("ego/front/rgb", wanted.tick)
                self.assertEqual((found.tick, found.header_bytes(), found.copy().tobytes()), (wanted.tick, wanted.header_bytes(), wanted.copy().tobytes()))
            for tick in (0, N_TICKS + 1, 10**9):
                with self.assertRaisesRegex(KeyError, f"no frame of ego/front/rgb of tick {tick}"):
                    drive.frame("ego/front/rgb", tick)
            with self.assertRaisesRegex(gantry.GantryError, "no frames of ego/front/rbg; it has .*ego/front/rgb"):
                drive.frame("ego/front/rbg", 3)
            frames = drive.frames("ego/front/rgb")
            next(frames)
        self.assertEqual(list(frames), [], "what is read ends with the block")
        with self.assertRaisesRegex(gantry.GantryError, "sample.mcap is closed"):
            drive.frames()

    def test_a_tick_is_found_although_ticks_have_any_distance(self):
        """Frames of the same bytes, filed under the times of a drive that was paused, slow and quick."""
        path, times = os.path.join(self.folder.name, "uneven.mcap"), {}
        with open(self.sample, "rb") as file, open(path, "wb") as out:
            writer, channels, now = Writer(out), {}, 0
            writer.start()
            for schema, channel, message in make_reader(file).iter_messages(topics=["/ego/front/depth", "/ego/front/depth/gantry"]):
                if channel.topic not in channels:
                    schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, schema_id, {})
                if message.log_time not in times:
                    now += (1, 10**10, 3, 10**8)[len(times) % 4]
                    times[message.log_time] = now
                writer.add_message(channels[channel.topic], times[message.log_time], message.data, now, message.sequence)
            writer.finish()
        with gantry.Recording(path) as drive:
            self.assertEqual([drive.frame("ego/front/depth", tick).tick for tick in range(1, N_TICKS + 1)], list(range(1, N_TICKS + 1)))

    def test_rows_hold_results_beside_frames(self):
        drive = gantry.Recording(self.results)
        frames = [topic.name for topic in drive.topics if topic.kind == "frame"]
        boxes = next(topic.name for topic in drive.topics if topic.kind == "result" and next(drive.results(topic.name)).type == "boxes2d")
        wanted = {result.tick: result.array.tobytes() for result in drive.results(boxes)}
        rows = list(drive.sync([*frames[:1], boxes]))
        self.assertTrue(rows)
        for row in rows:
            self.assertEqual((row.result(boxes).tick, row.result(boxes).array.tobytes()), (row.tick, wanted[row.tick]))
            self.assertEqual(drive.result(boxes, row.tick).seq, row.result(boxes).seq)
            for name in frames[:1]:
                self.assertEqual(row[name].tick, row.tick)
                with self.assertRaisesRegex(TypeError, "has frames"):
                    row.result(name)

    def test_results_are_kept_beside_a_recording(self):
        """What is written is what another reader finds in the file, beside the frames that it answers."""
        path, again = (os.path.join(self.folder.name, name) for name in ("boxes.mcap", "again.mcap"))
        topic = "ego/front/rgb"
        for name in (path, again):
            with gantry.Recording(self.sample) as drive, drive.writer(name) as out:
                boxes = out.publish("mine/boxes", "boxes2d", classes=["person"], note="of the test")
                grey = out.publish("mine/grey", "image")
                for frame in drive.frames(topic):
                    boxes.send(gantry.boxes2d(xyxy=[[0, 0, frame.tick, 2]]), answers=frame)
                    with grey.loan(frame.rgb.shape[:2], answers=frame) as memory:
                        memory[...] = frame.rgb[..., 0]
                self.assertTrue(os.path.exists(name + ".part"))
        mine, drive = gantry.Recording(path), gantry.Recording(self.sample)
        self.assertTrue(mine.is_complete)
        self.assertEqual({one.name: one.kind for one in mine.topics if one.kind == "result"}, {"mine/boxes": "result", "mine/grey": "result"})
        found = list(mine.results("mine/boxes"))
        self.assertEqual([result.tick for result in found], list(range(1, N_TICKS + 1)))
        heads = {message.log_time: proto for name, message, proto in decoded(path) if name == "/mine/boxes/gantry"}
        for result in found:
            frame = drive.frame(topic, result.tick)
            self.assertEqual((result.seq, result.classes, result.array["max_px"].tolist()), (result.tick, ["person"], [[result.tick, 2]]))
            (answered,) = result.inputs
            self.assertEqual((answered.topic, answered.tick, answered.seq, answered.epoch), (topic, frame.tick, frame.header.seq, frame.header.epoch))
            self.assertEqual((result.header.world_from_space, result.header.intrinsics_px), (frame.header.world_from_sensor, frame.header.intrinsics_px))
            self.assertEqual((result.header.sim_nanos, result.space), (frame.header.sim_nanos, "image"))
            # A file is read without a clock.
            sent = frame.header.published_mono_nanos
            self.assertEqual((result.header.published_mono_nanos, result.header.origin_mono_nanos, result.inputs[0].taken_mono_nanos), (sent, sent, sent))
            self.assertEqual(heads[result.header.sim_nanos].header, result._outcome.header_bytes())
            self.assertEqual(mine.result("mine/grey", result.tick).array.tobytes(), frame.rgb[..., 0].tobytes())
        self.assertEqual([result._outcome.header_bytes() for result in found], [result._outcome.header_bytes() for result in gantry.Recording(again).results("mine/boxes")])
        # A second stage answers results of a file.
        third = os.path.join(self.folder.name, "tracks.mcap")
        with mine.writer(third) as out:
            tracks = out.publish("mine/tracks", "tracks")
            for result in mine.results("mine/boxes"):
                tracks.send(gantry.tracks([1], min_px=result.array["min_px"], max_px=result.array["max_px"]), answers=result)
        (answered,) = next(gantry.Recording(third).results()).inputs
        self.assertEqual((answered.topic, answered.tick, answered.seq), ("mine/boxes", 1, 1))

    def test_a_program_runs_over_a_file_and_its_results_are_merged_into_it(self):
        seen = []
        whole, alone, both = (os.path.join(self.folder.name, f"{name}.mcap") for name in ("whole", "alone", "both"))
        of_a_run(self.sample, whole)

        @gantry.bench.program(inputs={"image": "ego/front/rgb", "depth": "ego/front/depth"}, output=("mine/found", "boxes2d"))
        def detect(image, depth):
            seen.append((image.tick, depth.tick))
            return gantry.boxes2d(xyxy=[[1, 2, 3, image.tick]]) if image.tick % 2 else None

        counts = gantry.bench.run_file(detect, whole, alone, start=2 * PERIOD_SECS, end=9 * PERIOD_SECS)
        self.assertEqual(seen, [(tick, tick) for tick in range(2, 9)])
        self.assertEqual((counts.worked, counts.answered), (7, 3))
        subprocess.run([EXAMPLES.parent / "gantry-record", "merge", whole, alone, both], check=True, stdout=subprocess.DEVNULL)
        rows = list(gantry.Recording(both).sync(["ego/front/rgb", "mine/found"], snapshots=True))
        self.assertEqual([row.tick for row in rows], [3, 5, 7])
        for row in rows:
            result = row.result("mine/found")
            self.assertEqual((result.array["max_px"].tolist(), row.snapshot.tick), ([[3, row.tick]], row.tick))
            self.assertEqual([(one.topic, one.seq) for one in result.inputs], [("ego/front/rgb", row["ego/front/rgb"].seq), ("ego/front/depth", result.inputs[1].seq)])

    def test_what_cannot_be_written_beside_a_recording_is_a_sentence(self):
        drive = gantry.Recording(self.sample)
        with self.assertRaisesRegex(gantry.GantryError, "sample.mcap exists already"):
            drive.writer(self.sample)
        path = os.path.join(self.folder.name, "broken.mcap")
        with self.assertRaisesRegex(KeyError, "of the program"), drive.writer(path) as out:
            boxes = out.publish("mine/boxes", "boxes2d")
            boxes.send(gantry.boxes2d([], []), answers=drive.frame("ego/front/rgb", 3))
            with self.assertRaisesRegex(gantry.GantryError, "'mine/boxes' is written to this file already|\"mine/boxes\" is written to this file already"):
                out.publish("mine/boxes", "boxes2d")
            with self.assertRaisesRegex(gantry.GantryError, "world/boxes"):
                out.publish("world/boxes", "boxes2d")
            with self.assertRaisesRegex(ValueError, "'boxes4d' is no type of results|\"boxes4d\" is no type of results"):
                out.publish("mine/other", "boxes4d")
            raise KeyError("of the program")
        self.assertTrue(os.path.exists(path + ".part") and not os.path.exists(path))
        self.assertEqual([result.tick for result in gantry.Recording(path + ".part").results()], [3])
        with self.assertRaisesRegex(gantry.GantryError, "is finished; nothing can be written"):
            boxes.send(gantry.boxes2d([], []))

    def test_results_of_every_type_are_what_another_reader_finds(self):
        bodies, wholes = {}, {}
        with open(self.results, "rb") as file:
            for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
                if not channel.topic.endswith("/gantry"):
                    wholes[channel.topic, message.log_time] = message.data
        for topic, message, proto in self._results():
            place = (topic.removesuffix("/gantry")[1:], message.sequence)
            body = proto.body
            if proto.body_topic:
                whole = wholes[proto.body_topic, message.log_time]
                body = self.shown[proto.body_topic, message.log_time].data if (proto.body_topic, message.log_time) in self.shown else whole
            bodies[place] = (proto.header, body, proto.inputs)
        found = {(result.topic, result.seq): result for result in gantry.Recording(self.results).results()}
        self.assertEqual(set(found), set(bodies))
        self.assertEqual({result.type for result in found.values()}, set(gantry.RESULT_TYPES))
        for place, result in found.items():
            header, body, inputs = bodies[place]
            with self.subTest(place):
                outcome = result._outcome
                self.assertEqual(outcome.header_bytes(), header)
                whole = outcome.array(np.dtype("u1"), (outcome.body_bytes,), (1,), 0).tobytes()
                self.assertEqual((whole, outcome.inputs_bytes()), (body, inputs))

    def _results(self):
        """The results, and in `shown` what holds bodies of some of them."""
        self.shown, found = {}, []
        for topic, message, proto in decoded_protobuf(self.results):
            if topic.endswith("/gantry"):
                found.append((topic, message, proto))
            elif hasattr(proto, "data"):
                self.shown[topic, message.log_time] = proto
        return found

    def test_a_file_that_was_cut_off_is_read_as_far_as_it_goes(self):
        data = pathlib.Path(self.sample).read_bytes()
        cut = os.path.join(self.folder.name, "cut.mcap.part")
        whole = len(list(gantry.Recording(self.sample).samples()))
        counts = []
        for share in (0.999, 0.7, 0.4):
            pathlib.Path(cut).write_bytes(data[: int(len(data) * share)])
            drive = gantry.Recording(cut)
            self.assertFalse(drive.is_complete)
            counts.append(len(list(drive.samples())))
        self.assertEqual(counts, sorted(counts, reverse=True))
        self.assertLessEqual(counts[0], whole)
        flipped = bytearray(data)
        flipped[len(data) // 2] ^= 0x55
        pathlib.Path(cut).write_bytes(flipped)
        drive = gantry.Recording(cut)
        left = len(list(drive.samples()))
        self.assertLess(left, whole)
        self.assertGreater(sum(drive.damage.values()), 0)
        self.assertTrue(drive.damage_sentences)

    def test_what_is_no_recording_is_a_sentence(self):
        for text, sentence in ((b"", "is empty"), (b"PK" + bytes(100), "is not an MCAP file")):
            path = os.path.join(self.folder.name, "odd")
            pathlib.Path(path).write_bytes(text)
            with self.assertRaisesRegex(gantry.GantryError, sentence):
                gantry.Recording(path)
        with self.assertRaisesRegex(gantry.GantryError, "cannot open .*nothing.mcap"):
            gantry.Recording("nothing.mcap")

    def test_threads_share_one_file(self):
        drive, sums = gantry.Recording(self.sample), []

        def read():
            sums.append(sum(int(frame.array.view("u1").sum()) for frame in drive.frames("ego/front/rgb", "ego/front/depth")))

        threads = [threading.Thread(target=read) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(len(sums), 4)
        self.assertEqual(len(set(sums)), 1)


def decoded_protobuf(path):
    """As `decoded`, without the messages that are no protobuf."""
    factory = DecoderFactory()
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            if channel.message_encoding == "protobuf" and schema.encoding == "protobuf" and not schema.name.startswith("own"):
                decode = factory.decoder_for(channel.message_encoding, schema)
                try:
                    proto = decode(message.data)
                except Exception:  # noqa: BLE001 - a user's bytes need not be what their schema says
                    continue
                yield channel.topic, message, proto


if __name__ == "__main__":
    unittest.main()
