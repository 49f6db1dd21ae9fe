"""Golden frames, made by the Rust tests, read from bytes."""

import json
import pathlib
import struct
import sys
import types
import unittest
import zlib
from unittest import mock

import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "python"))

import gantry  # noqa: E402
from gantry import _dtypes, _layout  # noqa: E402

GOLDEN = HERE.parents[2] / "schemas" / "schema_frames" / "tests" / "golden" / "frames.txt"


def golden():
    lines = [line.split() for line in GOLDEN.read_text().splitlines() if not line.startswith("#")]
    return {name: bytes.fromhex(text) for name, text in lines}


def torch_of_numpy():
    """What `Frame.tensor` calls of torch, which is not installed here: tensors that know their device and how they came to be."""

    class Device:
        def __init__(self, name):
            self.type, _, index = str(name).partition(":")
            self.index = int(index) if index else None

        def __str__(self):
            return self.type if self.index is None else f"{self.type}:{self.index}"

    class Tensor:
        def __init__(self, numbers, device, steps=()):
            self.numbers, self.device, self.steps = numbers, Device(device), list(steps)
            # Sixteen bits without a sign stand for bfloat16.
            self.shape, self.dtype = numbers.shape, f"torch.{numbers.dtype}".replace("uint16", "bfloat16")

        def is_contiguous(self):
            return self.numbers.flags.c_contiguous

        def view(self, dtype):
            return Tensor(self.numbers.view(dtype), self.device, self.steps)

        def numpy(self):
            assert self.device.type == "cpu", "torch refuses the numpy of another device"
            assert self.dtype != "torch.bfloat16", "torch refuses the numpy of a type that numpy lacks"
            return self.numbers

        def to(self, device, non_blocking):
            assert non_blocking
            return Tensor(self.numbers.copy(), device, [*self.steps, f"to {device}, not blocking"])

        def copy_(self, other, non_blocking):
            assert non_blocking
            self.numbers[...] = other.numbers
            return self

    def empty(shape, dtype, pin_memory):
        return Tensor(np.full(shape, 7, "uint16" if dtype == "torch.bfloat16" else dtype), "cpu", ["empty, pinned, on cpu" if pin_memory else "empty on cpu"])

    dtypes = {name: name for name in ("uint8", "int16", "float16", "float32")} | {"bfloat16": "torch.bfloat16"}
    return types.SimpleNamespace(Tensor=Tensor, empty=empty, device=Device, **dtypes)


class GoldenFrames(unittest.TestCase):
    def test_a_header_has_every_field_of_the_layout(self):
        data = bytes((37 * i + 11) % 251 for i in range(256))
        record, header = np.frombuffer(data, _dtypes.FRAME_HEADER, 1)[0], gantry.Header.from_bytes(data)
        for name, _, _, _ in _layout.STRUCTS["FrameHeader"][2]:
            if name == "world_from_sensor":
                for part in ("translation_m", "rotation_xyzw"):
                    np.testing.assert_array_equal(getattr(header.world_from_sensor, part), record[name][part])
            elif not name.startswith("reserved"):
                np.testing.assert_array_equal(getattr(header, name), record[name], name)

    def test_every_modality_has_the_shape_and_type_of_the_specification(self):
        expected = {
            "rgb": ((2, 4, 4), "u1"), "depth": ((2, 4), "<f4"), "semantic": ((2, 4), "u1"), "instance": ((2, 4), "<u4"),
            "flow": ((2, 4, 2), "<f4"), "normals": ((2, 4, 4), "<f2"), "dvs": ((3,), _dtypes.DVS_EVENT),
            "lidar": ((3,), _dtypes.LIDAR_POINT), "semantic_lidar": ((3,), _dtypes.SEMANTIC_LIDAR_POINT),
            "radar": ((3,), _dtypes.RADAR_DETECTION), "imu": ((1,), _dtypes.IMU_SAMPLE), "gnss": ((1,), _dtypes.GNSS_SAMPLE),
            "collision": ((3,), _dtypes.COLLISION_EVENT), "lane_invasion": ((3,), _dtypes.LANE_CROSSING),
            "obstacle": ((1,), _dtypes.OBSTACLE_EVENT), "lidar_returns": ((3,), _dtypes.LIDAR_RETURN),
        }
        frames = golden()
        self.assertEqual(set(frames), set(expected))
        for name, (shape, dtype) in expected.items():
            with self.subTest(name):
                frame = gantry.frame_from_bytes(frames[name])
                self.assertEqual((frame.modality, frame.array.shape, frame.array.dtype), (name, shape, np.dtype(dtype)))
                self.assertFalse(frame.array.flags.writeable)
                self.assertFalse(frame.array.flags.owndata)

    def test_every_header_field_is_read(self):
        header = gantry.frame_from_bytes(golden()["lidar"]).header
        self.assertEqual((header.sensor_id, header.tick, header.seq, header.episode, header.flags), (31, 1 << 40, 7, 2, 1))
        self.assertEqual((header.sim_nanos, header.window_nanos, header.epoch), (123456789012, 50000000, 2**64 - 2))
        self.assertEqual((header.range_limit_m, header.azimuth_rad, header.parent_id, header.n_channels), (120.0, 0.5, 24, 64))
        self.assertEqual((header.rendered_mono_nanos, header.published_mono_nanos, header.cpu_copies, header.ticks_in_flight), (5, 6, 1, 2))
        self.assertEqual(header.world_from_sensor.translation_m, (1.5, -2.0, 0.25))
        self.assertEqual(header.intrinsics[0, 2], 2.0)
        turned = header.world_from_sensor.matrix() @ [1.0, 0.0, 0.0, 1.0]
        np.testing.assert_allclose(turned[:3], [1.5 + 0.28, -2.0 + 0.96, 0.25], atol=1e-12)

    def test_a_pinhole_s_header_is_its_calibration(self):
        bent = gantry.frame_from_bytes(golden()["depth"])
        self.assertEqual((bent.calibration.model, bent.calibration.crc), ("carla", 0))
        np.testing.assert_array_equal(np.float32(bent.calibration.parameters["distortion"]), np.float32(bent.header.lens))
        data = bytearray(golden()["depth"])
        data[228:244] = bytes(16)
        frame = gantry.frame_from_bytes(data)
        fx, fy, cx, cy = frame.header.intrinsics_px
        found = frame.calibration
        self.assertEqual((found.model, found.size, found.crc), ("pinhole", (4, 2), 0))
        self.assertEqual(found.parameters["focal_px"], [fx, fy])
        pixels = found.project([[0.5, -0.25, 2.0], [0.0, 0.0, -1.0]])
        np.testing.assert_allclose(pixels[0], [cx + 0.25 * fx, cy - 0.125 * fy], rtol=1e-15)
        self.assertTrue(np.isnan(pixels[1]).all(), "it is behind the camera")
        direction = found.unproject((cx + fx, cy))
        np.testing.assert_allclose(direction, [np.sqrt(0.5), 0.0, np.sqrt(0.5)], rtol=1e-15)
        with self.assertRaisesRegex(ValueError, r"points have the shape \(2,\); it must be \(3,\) or \(n, 3\)"):
            found.project((1.0, 2.0))
        lidar = bytearray(golden()["lidar"])
        lidar[136:168] = bytes(32)
        with self.assertRaisesRegex(gantry.FrameFormatError, "only frames of a camera"):
            gantry.frame_from_bytes(lidar).calibration

    def test_a_lens_is_what_world_info_says_of_its_crc(self):
        # The numbers and pixels of cv2.fisheye.projectPoints, which counts from the middle of the first pixel.
        lens = {"model": "kannala_brandt", "coefficients": [-0.0132, 0.0204, -0.0113, 0.0021]}
        points = [[0.3, -0.2, 1.0], [-0.5, 0.4, 1.0], [0.1, 0.05, 2.0]]
        by_opencv = [[503.45234651948886, 343.3275502272899], [295.0679695940979, 499.92796971590445], [435.7346008583928, 405.40475990513954]]
        numbers = [848, 800, 4, 285.0, 286.5, 0.0, 0.0, 422.0, 398.75, 1.6, *lens["coefficients"]]
        crc = zlib.crc32(struct.pack(f"<{len(numbers)}d", *numbers))
        calibration = {"size_px": [848, 800], "lens": lens, "focal_px": [285.0, 286.5], "shear_px": [0.0, 0.0], "centre_px": [422.0, 398.75], "max_angle_rad": 1.6}
        data = bytearray(golden()["depth"])
        data[188:192] = struct.pack("<I", 4 | 1 << 16)
        data[252:256] = struct.pack("<I", crc)
        frame = gantry.frame_from_bytes(data)
        with self.assertRaisesRegex(gantry.GantryError, f"calibration_crc {crc:#010x}, are in world/info, which came neither"):
            frame.calibration
        info = {"cameras": [{"name": "ego/front", "sensor_id": 1, "calibration": {**calibration, "crc": crc}}]}
        wrong = {"cameras": [{"name": "ego/front", "sensor_id": 1, "calibration": {**calibration, "crc": crc, "focal_px": [285.0, 286.6]}}]}
        frame._look = lambda: json.dumps(wrong)
        with mock.patch("gantry._calibration._LOOK_FOR_SECS", 0.0):
            with self.assertRaisesRegex(gantry.GantryError, "describes no camera with the calibration_crc"):
                frame.calibration
        frame._look = lambda: json.dumps(info)
        found = frame.calibration
        self.assertEqual((found.model, found.crc, found.size), ("kannala_brandt", crc, (848, 800)))
        self.assertEqual(found.parameters["coefficients"], lens["coefficients"])
        np.testing.assert_allclose(found.project(points) - 0.5, by_opencv, atol=1e-9)
        back = found.unproject(found.project(points))
        np.testing.assert_allclose(back, np.array(points) / np.linalg.norm(points, axis=1, keepdims=True), atol=1e-12)
        self.assertTrue(np.isnan(found.project([1.0, 0.0, -0.2])).all(), "beyond the field")

    def test_payload_bytes_land_where_they_belong(self):
        frames = {name: gantry.frame_from_bytes(data) for name, data in golden().items()}
        self.assertEqual(frames["rgb"].array[1, 2].tolist(), [24, 25, 26, 27])
        self.assertEqual(frames["rgb"].rgb[1, 2].tolist(), [26, 25, 24])
        self.assertTrue(np.shares_memory(frames["rgb"].rgb, frames["rgb"].array))
        self.assertEqual(frames["semantic"].array[1].tolist(), [16, 17, 18, 19], "rows are 16 bytes apart")
        self.assertEqual(frames["instance"].array[0, 1], 0x07060504)
        self.assertEqual(frames["dvs"].array["x_px"][1], 0x1514)
        self.assertEqual(frames["lidar"].array["channel"][2], 0x2F2E)
        self.assertEqual(frames["semantic_lidar"].array["object_id"][0], 0x13121110)
        self.assertEqual(frames["semantic_lidar"].array["class"][0], 0x14)
        self.assertEqual(frames["lidar_returns"].array["time_ns"][0], 0x0F0E0D0C)
        self.assertEqual(frames["lidar_returns"].array["ring"][1], 0x3736)
        self.assertEqual(frames["lidar_returns"].array["range_mm_lsb"][2], 0x5F5E)
        self.assertEqual(frames["radar"].array["object_id"][1], 0x37363534)
        self.assertEqual(frames["radar"].array["class"][0], 0x18)
        self.assertEqual(frames["collision"].array["other_id"][1], 0x43424140)
        self.assertEqual(frames["lane_invasion"].array["lane"][1], 0x23)
        self.assertEqual(frames["lane_invasion"].array["road"][0], 0x0B0A0908)
        self.assertEqual(frames["obstacle"].array["object_id"][0], 0x07060504)

    def test_a_tensor_has_the_wanted_order_layout_and_type(self):
        frame = gantry.frame_from_bytes(golden()["rgb"])
        pixels = frame.array.astype(np.int64)
        for colour, order in {"rgb": [2, 1, 0], "bgr": [0, 1, 2], "bgra": [0, 1, 2, 3]}.items():
            for layout in ("chw", "hwc"):
                for dtype in ("uint8", "float16", "float32"):
                    with self.subTest(colour=colour, layout=layout, dtype=dtype):
                        expected = pixels[..., order] if layout == "hwc" else pixels[..., order].transpose(2, 0, 1)
                        if dtype != "uint8":
                            expected = (expected.astype(np.float32) * np.float32(0.5)).astype(dtype)
                        scale = None if dtype == "uint8" else 0.5
                        out = np.full(expected.shape, 7, dtype)
                        found = frame.tensor(dtype=dtype, layout=layout, colour=colour, scale=scale, out=out)
                        self.assertIs(found, out)
                        np.testing.assert_array_equal(found, expected)
                        self.assertEqual(found.dtype, np.dtype(dtype))
        made = frame.tensor(dtype="float32")
        self.assertTrue(made.flags.c_contiguous and made.flags.writeable)
        np.testing.assert_allclose(made[0], pixels[..., 2] / 255, rtol=1e-6)

    def test_a_tensor_honours_padded_rows_and_images_of_a_batch(self):
        header = bytearray(golden()["rgb"][:256])
        # Two images of 2 x 1 pixels, rows 12 bytes apart.
        header[48:72] = struct.pack("<Q4I", 20, 2, 2, 12, 4)
        header[184:188] = struct.pack("<I", 2)
        frame = gantry.frame_from_bytes(bytes(header) + bytes(range(20)))
        self.assertEqual(frame.tensor().tolist(), [[[[2, 6]], [[1, 5]], [[0, 4]]], [[[14, 18]], [[13, 17]], [[12, 16]]]])
        self.assertEqual(frame.tensor(layout="hwc", colour="bgr").tolist(), [[[[0, 1, 2], [4, 5, 6]]], [[[12, 13, 14], [16, 17, 18]]]])

    def test_a_tensor_that_cannot_be_is_refused_with_a_sentence(self):
        frame = gantry.frame_from_bytes(golden()["rgb"])
        for words, options in {
            "dtype is 'float64'; it must be one of uint8, float16, bfloat16, float32": {"dtype": "float64"},
            "dtype is bfloat16, which numpy lacks": {"dtype": "bfloat16"},
            "layout is 'nchw'; it must be one of chw, hwc": {"layout": "nchw"},
            "colour is 'grey'; it must be one of rgb, bgr, bgra": {"colour": "grey"},
            "scale is 2.0 and dtype is uint8": {"scale": 2.0},
            r"out is uint8 \(2, 4, 3\); it must be uint8 \(3, 2, 4\)": {"out": np.zeros((2, 4, 3), np.uint8)},
            "not contiguous and writeable": {"out": np.zeros((3, 4, 2), np.uint8).transpose(0, 2, 1)},
            "an array of numpy, which is on none": {"out": np.zeros((3, 2, 4), np.uint8), "device": "cpu"},
        }.items():
            with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                frame.tensor(**options)
        with self.assertRaisesRegex(gantry.FrameFormatError, "needs a frame of rgb, this is depth"):
            gantry.frame_from_bytes(golden()["depth"]).tensor()

    def test_a_tensor_of_torch_is_filled_or_made(self):
        frame = gantry.frame_from_bytes(golden()["rgb"])
        expected = frame.tensor(dtype="float32")
        with mock.patch.dict(sys.modules, torch=torch_of_numpy()) as modules:
            torch = modules["torch"]
            for device, steps in {"cpu": ["empty on cpu"], "cuda": ["empty, pinned, on cpu", "to cuda, not blocking"]}.items():
                with self.subTest(device):
                    made = frame.tensor(dtype="float32", device=device)
                    np.testing.assert_array_equal(made.numbers, expected)
                    self.assertEqual((made.device.type, made.steps), (device, steps))
                    out = torch.Tensor(np.zeros((3, 2, 4), np.float32), "cuda:1" if device == "cuda" else device)
                    self.assertIs(frame.tensor(dtype="float32", out=out, device=device), out)
                    np.testing.assert_array_equal(out.numbers, expected)
            for words, options in {
                r"out is float32 \(3, 2, 4\); it must be uint8": {},
                "device is 'cpu' and out is on cuda:1": {"dtype": "float32", "device": "cpu"},
                "device is 'cuda:0' and out is on cuda:1": {"dtype": "float32", "device": "cuda:0"},
            }.items():
                with self.subTest(words), self.assertRaisesRegex(ValueError, words):
                    frame.tensor(out=out, **options)
            with self.assertRaisesRegex(ValueError, "out is list; it must be an array of numpy or a tensor of torch"):
                frame.tensor(out=[])

    def test_bfloat16_is_the_nearest_number_with_the_upper_half_of_its_bits(self):
        frame = gantry.frame_from_bytes(golden()["rgb"])
        with mock.patch.dict(sys.modules, torch=torch_of_numpy()) as modules:
            made = frame.tensor(dtype="bfloat16", device="cpu", scale=1 / 3)
            self.assertEqual(made.dtype, "torch.bfloat16")
            out = modules["torch"].Tensor(np.zeros((3, 2, 4), np.uint16), "cpu")
            self.assertIs(frame.tensor(dtype="bfloat16", out=out, scale=1 / 3), out)
        np.testing.assert_array_equal(out.numbers, made.numbers)
        found = (made.numbers.astype(np.uint32) << 16).view(np.float32)
        wanted = frame.tensor(dtype="float32", scale=1 / 3)
        # Rounded to eight bits, a number is off by half of the last at most; cut off, it would be off by twice as much.
        self.assertLessEqual(float((np.abs(found - wanted) / wanted.clip(1e-9)).max()), 2.0**-8 + 1e-7)
        self.assertGreater(len(np.unique(found)), 10)

    def test_a_frame_reads_only_what_its_header_says(self):
        data = golden()["dvs"]
        self.assertEqual(len(gantry.frame_from_bytes(data + b"\xff" * 64)), 3)

    def test_broken_frames_are_refused_with_a_sentence(self):
        data = golden()["depth"]
        with self.assertRaisesRegex(gantry.FrameFormatError, "GFRM"):
            gantry.frame_from_bytes(b"X" + data[1:])
        with self.assertRaisesRegex(gantry.SchemaVersionError, "carries schema 9"):
            gantry.frame_from_bytes(data[:4] + b"\x09\x00" + data[6:])
        with self.assertRaisesRegex(gantry.FrameFormatError, "claims 32 payload bytes, its sample holds 31"):
            gantry.frame_from_bytes(data[:-1])
        with self.assertRaisesRegex(gantry.FrameFormatError, "does not fit"):
            gantry.frame_from_bytes(data[:60] + b"\x03" + data[61:])
        with self.assertRaisesRegex(gantry.FrameFormatError, "are no frame"):
            gantry.frame_from_bytes(data[:100])

    def test_random_headers_never_do_worse_than_an_error(self):
        rng = np.random.default_rng(1)
        for _ in range(2000):
            data = bytearray(golden_rgb)
            for _ in range(3):
                data[rng.integers(0, 256)] = rng.integers(0, 256)
            try:
                gantry.frame_from_bytes(bytes(data)).copy()
            except gantry.GantryError:
                pass

    def test_a_copy_is_writeable_and_numpy_takes_a_frame(self):
        frame = gantry.frame_from_bytes(golden()["rgb"])
        copy = frame.copy()
        copy[0, 0, 0] = 99
        self.assertEqual(frame.array[0, 0, 0], 0)
        self.assertEqual(np.asarray(frame).shape, (2, 4, 4))
        with self.assertRaises(ValueError):
            frame.array[0, 0, 0] = 1

    def test_a_picture_for_notebooks(self):
        for name in ("rgb", "semantic", "depth"):
            self.assertTrue(gantry.frame_from_bytes(golden()[name])._repr_png_().startswith(b"\x89PNG"))
        self.assertIsNone(gantry.frame_from_bytes(golden()["imu"])._repr_png_())
        with self.assertRaisesRegex(gantry.FrameFormatError, "a list, not an image"):
            gantry.frame_from_bytes(golden()["imu"]).image


class Tables(unittest.TestCase):
    def test_dtypes_have_the_sizes_of_the_contract(self):
        for name, (_, size, _) in _layout.STRUCTS.items():
            self.assertEqual(_dtypes._dtype(name).itemsize, size, name)

    def test_classes_are_carlas(self):
        self.assertEqual(gantry.CLASS_NAMES[11], "Sky")
        self.assertEqual(gantry.colour_classes(np.array([[14, 200]])).tolist(), [[[0, 0, 142], [0, 0, 0]]])


golden_rgb = golden()["rgb"]

if __name__ == "__main__":
    unittest.main()
