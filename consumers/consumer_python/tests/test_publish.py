"""Publishing results live, across processes."""

import signal
import unittest

from live_kit import CardCase, LiveCase


class Publish(LiveCase):
    """Writers and readers, each in a process of its own."""

    def test_results_of_every_type_arrive_as_they_were_sent(self):
        self.script("""
            from gantry import _dtypes
            picture = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
            cloud = np.array([(1.5, 2, 3, 7)], [("x", "<f8"), ("y", "<f4"), ("z", "<f4"), ("ring", "<u2")])
            mask = np.eye(3, 4).astype(bool)
            control = np.zeros(2, gantry.VEHICLE_CONTROL)
            control["throttle_ratio"] = [0.25, 1]
            sent = {
                "image": picture, "tensor": np.linspace(0, 1, 24).reshape(2, 3, 4), "boxes2d": gantry.boxes2d([[1, 2]], [[3, 4]], id=9),
                "boxes3d": gantry.boxes3d([[1, 2, 3]], [[1, 1, 1]], yaw_rad=0.5, velocity_mps=0), "tracks": gantry.tracks([4, 5], min_px=[0, 1], max_px=[2, 3], yaw_rate_radps=0, velocity_mps=0),
                "masks": gantry.masks([mask, ~mask]), "keypoints": gantry.keypoints([[[1, 2]], [[3, 4], [5, 6]]]),
                "flow": np.ones((2, 4, 2), np.float32), "depth": np.full((2, 4), 2.5, np.float32), "semantic": np.eye(3, dtype=np.uint8),
                "instance": np.arange(6, dtype=np.uint32).reshape(2, 3), "points": cloud, "pose": gantry.pose([1, 2, 3]),
                "odometry": gantry.odometry([1, 2, 3], velocity_mps=[4, 5, 6]), "path": gantry.path([[0, 0, 0], [1, 0, 0]], speed_mps=3, after_secs=0, acceleration_mps2=0, curvature_pm=0),
                "control": control, "scalars": {"speed_mps": 3.5, "n": 2}, "text": "straße", "json": {"a": [1, None]}, "bytes": b"\\x00\\xff",
            }
            assert list(sent) == gantry.RESULT_TYPES
            schema = gantry.BytesSchema("mine.Message", "cbor", "jsonschema", "{}")
            for kind, data in sent.items():
                more = {"bytes": {"schema": schema}, "points": {"fields": cloud.dtype}}.get(kind, {})
                name = f"mine/{kind}"
                with gantry.publish(name, kind, **more) as writer, gantry.open(name, result=kind) as reader:
                    assert writer.n_readers == 1
                    assert writer.send(data, tick=11, sim_time=0.5, **({"size_px": (4, 3)} if kind == "masks" else {})) == 1
                    result = reader.next(timeout=10)
                    assert (result.type, result.tick, result.sim_time, result.seq, result.inputs) == (kind, 11, 0.5, 1, []), result
                    if kind == "masks":
                        assert all((a == b).all() for a, b in zip(result.masks, [mask, ~mask]))
                    elif kind == "keypoints":
                        assert [points["at_px"].tolist() for points in result.keypoints] == [[[1, 2]], [[3, 4], [5, 6]]]
                    elif kind == "scalars":
                        assert result.scalars == data
                    elif kind in ("text", "json"):
                        assert (result.text if kind == "text" else result.json()) == data
                    elif kind == "bytes":
                        assert result.data == data
                    else:
                        assert result.array.dtype == data.dtype and (result.array == data).all(), (kind, result.array, data)
            # What was closed can be published again, as another type.
            gantry.publish("mine/image", "text").close()
        """)

    def test_a_loan_is_shared_memory_itself(self):
        self.script("""
            def mapped(array):
                at = array.__array_interface__["data"][0]
                for line in open("/proc/self/maps"):
                    first, last = (int(part, 16) for part in line.split()[0].split("-"))
                    if first <= at < last:
                        return line
            x, y = np.arange(12, dtype=np.float32).reshape(3, 4), np.ones((3, 4), np.float32)
            with gantry.publish("mine/difference", "tensor") as topic, gantry.open("mine/difference", result="tensor") as reader:
                with topic.loan(x.shape, x.dtype) as a:
                    assert "/dev/shm/" in mapped(a) and "rw-s" in mapped(a) and a.flags.writeable, mapped(a)
                    np.subtract(x, y, out=a)
                assert not a.flags.writeable
                result = reader.next(timeout=10)
                assert (result.array == x - y).all() and "r--s" in mapped(result.array), mapped(result.array)
                # An exception gives the slot back.
                try:
                    with topic.loan(x.shape) as a:
                        raise KeyError("mine")
                except KeyError:
                    pass
                assert reader.next(timeout=0.05, or_none=True) is None
                with (loan := topic.loan(3)) as a:
                    a[:] = 5
                    loan.answers(result)
                assert loan.n_received == 1 and reader.next(timeout=10).inputs[0].topic == "mine/difference"
                try:
                    loan.send()
                except gantry.GantryError as error:
                    assert "sent or dropped" in str(error), error
                else:
                    raise AssertionError("a loan was sent twice")
            with gantry.publish("mine/boxes", "boxes2d") as topic, gantry.open("mine/boxes") as reader:
                with (loan := topic.loan(100)) as boxes:
                    assert not boxes["score"].any()
                    boxes["score"][:3] = 0.5
                    loan.n_items = 3
                assert len(reader.next(timeout=10)) == 3
        """)

    def test_slots_grow_and_arrays_of_earlier_loans_stay_readable(self):
        self.script("""
            with gantry.publish("mine/growing", "tensor") as topic, gantry.open("mine/growing", result="tensor") as reader:
                for k in range(1, 16):
                    with topic.loan(2**k, np.float64) as a:
                        a[:] = k
                    result = reader.next(timeout=10)
                    assert (result.array == k).all() and (a == k).all()
                    result = None
                # Kept arrays of sent loans show bytes of later results, but they stay mapped.
                slices = []
                try:
                    for k in range(19, 26):
                        with topic.loan(2**k, np.uint8) as a:
                            a[:] = k
                        slices.append(a[::4096])
                        assert reader.next(timeout=10).array[-1] == k
                        assert all(part.sum() >= 0 for part in slices)
                except gantry.BorrowLimitError as error:
                    assert "keep copies of arrays" in str(error) and len(slices) > 1, error
                else:
                    raise AssertionError("slots for any number of kept arrays")
                slices = a = None
                with topic.loan(2**26, np.uint8) as a:
                    a[:] = 1
        """)

    def test_a_second_writer_gets_a_sentence_and_a_dead_one_is_replaced(self):
        first = self.start("""
            topic = gantry.publish("mine/taken", "text")
            loan = topic.loan(8)
            print("publishing", flush=True)
            input()
        """)
        self.assertEqual(first.stdout.readline(), "publishing\n")
        second = """
            try:
                topic = gantry.publish("mine/taken", "text")
            except gantry.TopicTakenError as error:
                print(error)
            else:
                print("taken over", topic.send("x"))
        """
        self.assertRegex(self.script(second), r"is written by python \(process \d+\), and a topic has one writer; stop that process")
        # It dies inside a loan.
        first.send_signal(signal.SIGKILL)
        self.finish(first, -signal.SIGKILL)
        self.assertEqual(self.script(second), "taken over 0\n")

    def test_what_cannot_be_published_is_refused_with_a_sentence(self):
        self.script("""
            def sentence(act, error=ValueError):
                try:
                    act()
                except error as found:
                    return str(found)
                raise AssertionError("it was taken")
            assert "is no type of results" in sentence(lambda: gantry.publish("a", "jpeg"))
            assert "are the simulator's" in sentence(lambda: gantry.publish("world/a", "text"), gantry.GantryError)
            assert "must name its schema" in sentence(lambda: gantry.publish("a", "bytes"), gantry.GantryError)
            assert "buffer is -1" in sentence(lambda: gantry.publish("a", "text", buffer=-1))
            assert "'v' of a point has the type" in sentence(lambda: gantry.publish("a", "points", fields=[("v", "<f4", (3,))]))
            with gantry.publish("a", "image") as image, gantry.publish("b", "tensor") as tensor, gantry.publish("c", "boxes2d") as boxes, gantry.publish("d", "masks") as masks:
                assert "no usual pixel format" in sentence(lambda: image.send(np.zeros((2, 2, 2), np.uint8)))
                assert "is no pixel format" in sentence(lambda: image.send(np.zeros((2, 2, 3), np.uint8), format="rgb9"))
                assert "are arrays (h, w)" in sentence(lambda: image.send(np.zeros((2, 2, 3), np.uint8), format="mono8"))
                assert "cannot be sent" in sentence(lambda: tensor.send(np.zeros(3, complex)))
                assert "cannot be sent" in sentence(lambda: tensor.send(np.zeros(9 * (1,))))
                assert "a topic of boxes2d sends arrays" in sentence(lambda: boxes.send(np.zeros(3)))
                assert "gantry.masks(...) returns" in sentence(lambda: masks.send(np.zeros((2, 2), bool)))
                assert "use send(gantry.masks(...))" in sentence(lambda: masks.loan(3))
                assert "is no space" in sentence(lambda: boxes.send(gantry.boxes2d([], []), space="here"))
                assert "answers frames and results" in sentence(lambda: boxes.send(gantry.boxes2d([], []), answers=[3]))
                assert "not results of type 'text'" in sentence(lambda: gantry.open("a", result="text"), gantry.GantryError)
                loans = [tensor.loan(3) for _ in range(4)]
                assert "all its loans are open" in sentence(lambda: tensor.loan(3), gantry.BorrowLimitError)
            image = gantry.publish("a", "image")
            image.close()
            assert "is closed" in sentence(lambda: image.loan((2, 2)), gantry.GantryError)
        """)

    def test_results_wake_threads_and_tasks(self):
        self.script("""
            import asyncio, threading
            with gantry.publish("mine/text", "text") as writer, gantry.open("mine/text", result="text") as reader:
                threading.Timer(0.05, lambda: writer.send("hello")).start()
                assert reader.next(timeout=10).text == "hello"

                async def main():
                    asyncio.get_running_loop().call_later(0.05, writer.send, "again")
                    async for result in reader:
                        return result.text

                assert asyncio.run(main()) == "again"
        """)

    def test_classes_are_known_with_the_first_result(self):
        writer = self.start("""
            with gantry.publish("mine/boxes", "boxes2d", classes=["person", "dog"], note="of the test") as topic:
                print("publishing", flush=True)
                while input() == "send":
                    topic.send(gantry.boxes2d([[1, 2]], [[3, 4]], class_=1))
        """)
        self.assertEqual(writer.stdout.readline(), "publishing\n")
        reader = self.start("""
            with gantry.open("mine/boxes", result="boxes2d") as topic:
                print("reading", flush=True)
                result = topic.next(timeout=60)
                assert [result.classes[n] for n in result.array["class"]] == ["dog"], result.classes
                assert topic.classes == ["person", "dog"]
        """)
        self.assertEqual(reader.stdout.readline(), "reading\n")
        writer.stdin.write("send\n")
        writer.stdin.flush()
        self.finish(reader)
        writer.stdin.write("end\n")
        self.finish(writer)


class Answers(CardCase):
    """Results about frames of another process."""

    def test_a_result_names_its_frames_and_takes_their_tick_and_pose(self):
        self.script("""
            with gantry.open("ego/card/rgb") as camera, gantry.open("ego/card/lidar") as lidar, \\
                 gantry.publish("mine/boxes", "boxes2d") as boxes, gantry.publish("mine/tracks", "tracks") as tracks, \\
                 gantry.open("mine/boxes", result="boxes2d") as read_boxes, gantry.open("mine/tracks", result="tracks") as read_tracks, \\
                 gantry.sync(["ego/card/rgb", "mine/boxes"]) as both:
                frame = camera.next(timeout=10)
                boxes.send(gantry.boxes2d([[1, 2]], [[3, 4]]), answers=frame)
                found = read_boxes.next(timeout=10)
                assert (found.tick, found.epoch, found.sim_time) == (frame.tick, frame.epoch, frame.sim_time)
                (source,) = found.inputs
                assert (source.topic, source.tick, source.seq, source.published_mono_nanos) == ("ego/card/rgb", frame.tick, frame.seq, frame.header.published_mono_nanos)
                assert source.published_mono_nanos <= source.taken_mono_nanos <= found.header.published_mono_nanos
                assert found.header.world_from_space == frame.header.world_from_sensor and found.header.origin_mono_nanos == source.published_mono_nanos
                tracks.send(gantry.tracks([1]), answers=[found, lidar.next(timeout=10)])
                track = read_tracks.next(timeout=10)
                assert [one.topic for one in track.inputs] == ["mine/boxes", "ego/card/lidar"], track.inputs
                assert track.header.origin_mono_nanos == source.published_mono_nanos
                frame = found = track = None
                # A row of several topics, results among them, is named whole.
                # A reader that the machine leaves waiting loses the frame that was answered.
                row = None
                for _ in range(100):
                    boxes.send(gantry.boxes2d([], []), answers=camera.latest(timeout=10))
                    if (row := both.next(timeout=0.5, or_none=True)) is not None:
                        break
                assert row["mine/boxes"].tick == row["ego/card/rgb"].tick
                tracks.send(gantry.tracks([1]), answers=row)
                assert [one.topic for one in read_tracks.next(timeout=10).inputs] == ["ego/card/rgb", "mine/boxes"]
                # Bytes have no topic that could be named.
                recorded = gantry.frame_from_bytes(row["ego/card/rgb"].header_bytes() + row["ego/card/rgb"].array.tobytes())
                try:
                    boxes.send(gantry.boxes2d([], []), answers=recorded)
                except ValueError as error:
                    assert "because it has no topic" in str(error), error
                else:
                    raise AssertionError("a frame without a topic was answered")
        """)


if __name__ == "__main__":
    unittest.main()
