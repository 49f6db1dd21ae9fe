"""Results: golden ones, made by the Rust tests, read from bytes; and the records that helpers make."""

import pathlib
import sys
import unittest

import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "python"))

import gantry  # noqa: E402
from gantry import _dtypes, _layout  # noqa: E402

GOLDEN = HERE.parents[2] / "schemas" / "schema_frames" / "tests" / "golden" / "results.txt"


def golden():
    lines = [line.split() for line in GOLDEN.read_text().splitlines() if not line.startswith("#")]
    return {name: bytes.fromhex(text) for name, text in lines}


class GoldenResults(unittest.TestCase):
    def test_a_header_has_every_field_of_the_layout(self):
        data = bytearray((37 * i + 11) % 251 for i in range(320))
        data[84:88] = (8).to_bytes(4, "little")
        record, header = np.frombuffer(bytes(data), _dtypes.RESULT_HEADER, 1)[0], gantry.ResultHeader.from_bytes(data)
        for name, _, _, _ in _layout.STRUCTS["ResultHeader"][2]:
            if name == "world_from_space":
                for part in ("translation_m", "rotation_xyzw"):
                    np.testing.assert_array_equal(getattr(header.world_from_space, part), record[name][part])
            elif not name.startswith("reserved"):
                np.testing.assert_array_equal(getattr(header, name), record[name], name)

    def test_every_type_has_the_shape_and_type_of_the_specification(self):
        expected = {
            "image": ((2, 4, 3), "u1"), "tensor": ((2, 3), "<u2"), "boxes2d": ((2,), gantry.BOX2D), "boxes3d": ((2,), gantry.BOX3D),
            "tracks": ((2,), gantry.TRACK), "masks": ((2,), gantry.MASK), "keypoints": ((2,), gantry.KEYPOINT_SET), "flow": ((2, 4, 2), "<f4"),
            "depth": ((2, 4), "<f4"), "semantic": ((2, 4), "u1"), "instance": ((2, 4), "<u4"),
            "points": ((3,), [(name, "<f4") for name in ("x", "y", "z", "intensity")]), "pose": ((2,), gantry.POSE_ESTIMATE),
            "odometry": ((2,), gantry.ODOMETRY), "path": ((2,), gantry.PATH_POINT), "control": ((2,), gantry.VEHICLE_CONTROL),
            "scalars": ((2,), gantry.SCALAR), "text": ((2,), "u1"), "json": ((2,), "u1"), "bytes": ((2,), "u1"),
        }  # fmt: skip
        results = golden()
        self.assertEqual(list(results), gantry.RESULT_TYPES)
        self.assertEqual(set(results), set(expected))
        for name, (shape, dtype) in expected.items():
            with self.subTest(name):
                result = gantry.result_from_bytes(results[name])
                self.assertEqual((result.type, result.array.shape, result.array.dtype), (name, shape, np.dtype(dtype)))
                self.assertFalse(result.array.flags.writeable or result.array.flags.owndata)

    def test_header_and_inputs_are_read(self):
        result = gantry.result_from_bytes(golden()["boxes2d"])
        self.assertEqual((result.tick, result.seq, result.epoch, result.space), (1 << 40, 7, 2**64 - 2, "image"))
        self.assertEqual((result.header.writer_epoch, result.header.flags, result.header.origin_mono_nanos), (99, 1, 3))
        self.assertEqual([(one.topic, one.tick, one.seq) for one in result.inputs], [("ego/front/rgb", 1 << 40, 11), ("detector/boxes", 1 << 40, 11)])
        self.assertEqual((result.inputs[0].epoch, result.inputs[0].published_mono_nanos, result.inputs[0].taken_mono_nanos), (8, 4, 5))
        self.assertEqual(result.classes[14], "Car")

    def test_bytes_land_where_they_belong(self):
        results = {name: gantry.result_from_bytes(data) for name, data in golden().items()}
        body = [byte for i in range(400) for byte in [[0, 0, 0x20 + i % 64, 0x41][i % 4]]]
        self.assertEqual(results["image"].array[1, 2].tolist(), body[18:21])
        self.assertEqual(results["boxes2d"].array["class"][1], int.from_bytes(bytes(body[52:56]), "little"))
        self.assertEqual(results["tracks"].array["yaw_rate_radps"][0], np.frombuffer(bytes(body[144:148]), "<f4")[0])
        self.assertEqual(results["masks"].tail.tobytes(), bytes(body[96:108]))
        self.assertEqual(results["keypoints"].tail.dtype, gantry.KEYPOINT)
        self.assertEqual((results["text"].text, results["json"].json()), ("hi", {}))
        points = gantry.result_from_bytes(golden()["points"], about={"fields": [{"name": "t", "type": "u16", "offset": 6}]})
        self.assertEqual(points.array["t"].tolist(), [int.from_bytes(bytes(body[at : at + 2]), "little") for at in (6, 22, 38)])

    def test_broken_results_are_refused_with_a_sentence(self):
        data = golden()["boxes2d"]
        for broken, sentence in [
            (b"X" + data[1:], "GRES"), (data[:-1], "its sample holds"), (data[:8] + b"\x63" + data[9:], "has type 99"), (data[:100], "are no result"),
        ]:  # fmt: skip
            with self.assertRaisesRegex(gantry.FrameFormatError, sentence):
                gantry.result_from_bytes(broken)
        with self.assertRaisesRegex(gantry.SchemaVersionError, "carries schema 9"):
            gantry.result_from_bytes(data[:4] + b"\x09\x00" + data[6:])
        with self.assertRaisesRegex(gantry.FrameFormatError, "not masks"):
            gantry.result_from_bytes(data).masks
        # The records of these name runs and points by random numbers.
        with self.assertRaisesRegex(gantry.FrameFormatError, "there are 3"):
            gantry.result_from_bytes(golden()["masks"]).masks
        with self.assertRaisesRegex(gantry.FrameFormatError, "there are 3"):
            gantry.result_from_bytes(golden()["keypoints"]).keypoints

    def test_random_headers_never_do_worse_than_an_error(self):
        rng = np.random.default_rng(2)
        for data in golden().values():
            for _ in range(200):
                broken = bytearray(data)
                for _ in range(3):
                    broken[rng.integers(0, 320)] = rng.integers(0, 256)
                try:
                    result = gantry.result_from_bytes(bytes(broken))
                    result.copy(), result.inputs
                except gantry.GantryError:
                    pass


class Tensor:
    """What torch's tensors are to a program without torch: on a device, on a graph, bfloat16 perhaps."""

    def __init__(self, numbers, on_device=True, on_graph=True, dtype="torch.float32"):
        self.numbers, self.on_device, self.on_graph, self.dtype = np.asarray(numbers, np.float32), on_device, on_graph, dtype

    def __dlpack__(self, **_):
        raise BufferError("not from a device")

    def detach(self):
        return Tensor(self.numbers, self.on_device, False, self.dtype)

    def cpu(self):
        return Tensor(self.numbers, False, self.on_graph, self.dtype)

    def float(self):
        return Tensor(self.numbers, self.on_device, self.on_graph, "torch.float32")

    def __array__(self, dtype=None, copy=None):
        if self.on_device or self.on_graph or self.dtype == "torch.bfloat16":
            raise TypeError("torch refuses")
        return np.array(self.numbers, dtype)


class BoolTensor(Tensor):
    """A tensor of torch.bool."""

    def __init__(self, numbers, on_device=True):
        super().__init__(numbers, on_device, False, "torch.bool")

    def detach(self):
        return self

    def cpu(self):
        return BoolTensor(self.numbers, False)

    def __array__(self, dtype=None, copy=None):
        if self.on_device:
            raise TypeError("torch refuses")
        return self.numbers.astype(bool)


class Records(unittest.TestCase):
    def test_boxes_come_as_networks_give_them(self):
        wanted = gantry.boxes2d([[10, 20], [1, 2]], [[30, 60], [4, 8]], score=[0.5, 1], class_=[3, 4])
        ways = {"xyxy": [[10, 20, 30, 60], [1, 2, 4, 8]], "xywh": [[10, 20, 20, 40], [1, 2, 3, 6]], "cxcywh": [[20, 40, 20, 40], [2.5, 5, 3, 6]]}
        for name, rows in ways.items():
            for column in (rows, np.array(rows, np.float32), Tensor(rows), Tensor(rows, dtype="torch.bfloat16")):
                with self.subTest(name, type=type(column)):
                    made = gantry.boxes2d(**{name: column}, score=Tensor([0.5, 1]), class_=[3, 4])
                    self.assertEqual(made.tobytes(), wanted.tobytes())
            self.assertEqual(len(gantry.boxes2d(**{name: np.zeros((0, 4))})), 0)
        with self.assertRaisesRegex(ValueError, r"xywh has the shape \(1, 2\); it must be \(n, 4\)"):
            gantry.boxes2d(xywh=[[1, 2]])
        for given, words in (({}, "no boxes"), ({"xyxy": [], "xywh": []}, "xyxy, xywh"), ({"min_px": [[1, 2]]}, "one corner")):
            with self.assertRaisesRegex(ValueError, f"is given {words}; say where the boxes are in one way"):
                gantry.boxes2d(**given)

    def test_boxes_in_space_have_sizes_or_halves(self):
        wanted = gantry.boxes3d([[1, 2, 3]], [[2, 1, 0.5]], yaw_rad=0.5, velocity_mps=0)
        made = gantry.boxes3d(Tensor([[1, 2, 3]]), size_m=Tensor([[4, 2, 1]]), yaw_rad=Tensor([0.5]), velocity_mps=0)
        self.assertEqual(made.tobytes(), wanted.tobytes())
        for given in ({}, {"half_m": [[1, 1, 1]], "size_m": [[2, 2, 2]]}):
            with self.assertRaisesRegex(ValueError, "in one way: half_m or size_m"):
                gantry.boxes3d([[1, 2, 3]], **given)

    def test_masks_and_key_points_come_as_tensors_of_all_objects(self):
        pictures = np.zeros((2, 4, 5), bool)
        pictures[0, 1:3, 2:4] = pictures[1, 3, :] = True
        wanted = gantry.masks(list(pictures), score=[0.5, 1], class_=3)
        for column in (pictures, pictures.astype(np.uint8), BoolTensor(pictures), [BoolTensor(it) for it in pictures]):
            made = gantry.masks(column, score=Tensor([0.5, 1]), class_=3)
            self.assertEqual([part.tobytes() for part in made], [part.tobytes() for part in wanted])
        with self.assertRaisesRegex(ValueError, "compare probabilities first: masks > 0.5"):
            gantry.masks(Tensor(pictures))
        points = np.arange(12.0).reshape(2, 3, 2)
        seen = [[0, 1, 2], [2, 2, 2]]
        wanted = gantry.keypoints(list(points), point_score=[[0.5] * 3] * 2, visibility=seen)
        made = gantry.keypoints(Tensor(points), point_score=Tensor(np.full((2, 3), 0.5)), visibility=Tensor(seen))
        self.assertEqual([part.tobytes() for part in made], [part.tobytes() for part in wanted])
        self.assertEqual(made.tail["at_px"].tolist(), points.reshape(-1, 2).tolist())

    def test_the_age_of_a_result_is_that_of_its_oldest_frame(self):
        result = gantry.result_from_bytes(golden()["boxes2d"])
        self.assertEqual(result.age_ms, (result.header.published_mono_nanos - 3) / 1e6)
        nothing = bytearray(golden()["boxes2d"])
        at = next(offset for name, _, _, offset in _layout.STRUCTS["ResultHeader"][2] if name == "origin_mono_nanos")
        nothing[at : at + 8] = bytes(8)
        self.assertIsNone(gantry.result_from_bytes(bytes(nothing)).age_ms)

    def test_columns_are_broadcast_and_a_wrong_one_is_named(self):
        boxes = gantry.boxes2d([[1, 2], [3, 4]], [[5, 6], [7, 8]], score=0.5, class_=[1, 2])
        self.assertEqual((boxes["max_px"].tolist(), boxes["score"].tolist(), boxes["class"].tolist()), ([[5, 6], [7, 8]], [0.5, 0.5], [1, 2]))
        self.assertEqual(len(gantry.boxes2d([], [])), 0)
        with self.assertRaisesRegex(ValueError, "score has the shape"):
            gantry.boxes2d([[1, 2], [3, 4]], [[5, 6], [7, 8]], score=[1, 2, 3])
        with self.assertRaisesRegex(ValueError, r"it must be \(n, 2\)"):
            gantry.boxes2d([[1, 2, 3]], [[5, 6, 7]])

    def test_a_yaw_becomes_a_quaternion_about_z(self):
        boxes = gantry.boxes3d([[1, 2, 3]], [[2, 1, 1]], yaw_rad=np.pi / 2)
        np.testing.assert_allclose(boxes["pose"]["rotation_xyzw"], [[0, 0, np.sqrt(0.5), np.sqrt(0.5)]])
        self.assertTrue(np.isnan(boxes["velocity_mps"]).all())
        with self.assertRaisesRegex(ValueError, "either rotation_xyzw or yaw_rad"):
            gantry.path([[0, 0, 0]], yaw_rad=0, rotation_xyzw=[0, 0, 0, 1])

    def test_tracks_say_which_of_their_boxes_hold(self):
        tracks = gantry.tracks([1, 2], min_px=[[0, 0], [1, 1]], max_px=[[2, 2], [3, 3]], state=["tentative", "lost"])
        self.assertEqual((tracks["flags"].tolist(), tracks["state"].tolist()), ([1, 1], [0, 2]))
        self.assertEqual(gantry.tracks([1], center_m=[[0, 0, 0]], half_m=[[1, 1, 1]])["flags"].tolist(), [2])
        with self.assertRaisesRegex(ValueError, "'gone' is no state"):
            gantry.tracks([1], state="gone")
        with self.assertRaisesRegex(ValueError, "needs min_px and max_px"):
            gantry.tracks([1], min_px=[[0, 0]])

    def test_runs_are_those_of_coco(self):
        # COCO counts column by column, background first.
        picture = np.array([[0, 1], [1, 1]], bool)
        records, runs = gantry.masks([picture, ~picture])
        self.assertEqual(runs.tolist(), [1, 3, 0, 1, 3])
        self.assertEqual((records["first_run"].tolist(), records["n_runs"].tolist()), ([0, 2], [2, 3]))
        self.assertEqual((records["min_px"].tolist(), records["max_px"].tolist()), ([[0, 0], [0, 0]], [[2, 2], [1, 1]]))
        with self.assertRaisesRegex(ValueError, "of one size"):
            gantry.masks([picture, picture[:1]])

    def test_key_points_of_several_objects_lie_one_behind_the_other(self):
        records, points = gantry.keypoints([[[1, 2]], [[3, 4], [5, 6]]], visibility=[2, [1, 0]])
        self.assertEqual((records["first_point"].tolist(), records["n_points"].tolist()), ([0, 1], [1, 2]))
        self.assertEqual((points["at_px"].tolist(), points["visibility"].tolist()), ([[1, 2], [3, 4], [5, 6]], [2, 1, 0]))

    def test_poses_scalars_and_their_limits(self):
        pose = gantry.pose([1, 2, 3], covariance=np.eye(6))
        self.assertEqual((pose["pose"]["translation_m"].tolist(), pose["covariance"][0][7]), ([[1, 2, 3]], 1))
        self.assertEqual(gantry.odometry([0, 0, 0], velocity_mps=[1, 0, 0])["velocity_mps"].tolist(), [[1, 0, 0]])
        with self.assertRaisesRegex(ValueError, r"must be \(6, 6\)"):
            gantry.pose([1, 2, 3], covariance=np.eye(3))
        with self.assertRaisesRegex(ValueError, "56 are allowed"):
            gantry.scalars({"x" * 57: 1.0})

    def test_controls_outside_their_range_are_refused(self):
        from gantry._control import control_record

        record = np.frombuffer(control_record(24, throttle=0.5, steer=-1, gear=-1, reverse=True), gantry.VEHICLE_CONTROL)[0]
        self.assertEqual((record["actor_id"], record["throttle_ratio"], record["steer_ratio"], record["flags"], record["gear"]), (24, 0.5, -1, 6, -1))
        self.assertEqual(record["lamps"], 2**32 - 1)
        for values, sentence in [({"throttle": 1.5}, "throttle is 1.5"), ({"steer": float("nan")}, "steer is nan"), ({"gear": 30}, "gear is 30")]:
            with self.assertRaisesRegex(ValueError, sentence):
                control_record(1, **values)


if __name__ == "__main__":
    unittest.main()
