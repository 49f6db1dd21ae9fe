"""Golden frames, made by the Rust tests, read from bytes."""

import pathlib
import sys
import unittest

import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "python"))

import gantry  # noqa: E402
from gantry import _dtypes, _layout  # noqa: E402

GOLDEN = HERE.parents[2] / "schemas" / "schema_frames" / "tests" / "golden" / "frames.txt"


def golden():
    lines = [line.split() for line in GOLDEN.read_text().splitlines() if not line.startswith("#")]
    return {name: bytes.fromhex(text) for name, text in lines}


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
