"""Frames on a GPU in Python, on the software adapter: its exported memory is mapped in the place of CUDA."""

import pathlib
import subprocess
import sys
import unittest

from live_kit import LiveCase

SIMD = pathlib.Path(__file__).resolve().parents[3] / "target" / "release" / "simd"
LAUNCH = """version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 20
[sensor.front]
kind = "camera"
modalities = ["rgb", "depth", "semantic", "instance", "flow", "normals", "dvs"]
rate_hz = 20
width_px = 96
height_px = 64
mount.position_m = [0.6, 0.0, 1.6]
[sensor.side]
kind = "camera"
modalities = ["rgb", "depth", "semantic", "instance", "flow", "normals"]
rate_hz = 20
width_px = 96
height_px = 64
mount.position_m = [0.0, 0.9, 1.6]
mount.rpy_deg = [0.0, 0.0, 90.0]
[batch.pair]
cameras = ["ego/side", "ego/front"]
modalities = ["rgb", "depth", "semantic", "instance", "flow", "normals"]
[sensor.roof]
kind = "lidar"
rate_hz = 20
channels = 8
columns = 180
mount.position_m = [0.0, 0.0, 2.0]
"""


class OnGpu(LiveCase):
    """Each script in a process of its own, beside a simulator."""

    def setUp(self):
        super().setUp()
        self.assertTrue(SIMD.exists(), f"{SIMD} is missing; build it: cargo build --release --workspace")
        (self.folder / "launch.toml").write_text(LAUNCH)
        arguments = [SIMD, "--launch", "launch.toml", "--domain", "live"]
        self.simd = subprocess.Popen(arguments, cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        lines = []
        while "ready" not in (lines or [""])[-1]:
            line = self.simd.stdout.readline()
            self.assertNotEqual(line, "", f"the simulator ended:\n{''.join(lines)}")
            lines.append(line)

    def tearDown(self):
        self.simd.terminate()
        self.simd.communicate()
        super().tearDown()

    def test_frames_are_those_of_shared_memory_and_numpy_takes_them_by_dlpack(self):
        self.script("""
            kinds = {"rgb": (np.uint8, (64, 96, 4)), "depth": (np.float32, (64, 96)), "semantic": (np.uint8, (64, 96)),
                     "instance": (np.uint32, (64, 96)), "flow": (np.float32, (64, 96, 2)), "normals": (np.float16, (64, 96, 4))}
            for modality, (dtype, shape) in kinds.items():
                name = f"ego/front/{modality}"
                with gantry.open(name) as host, gantry.open(name, device="mapped") as gpu:
                    n_compared = 0
                    there = {}
                    while n_compared < 3:
                        frame = gpu.next(timeout=60)
                        assert frame is not None and frame.device == "mapped" and frame.header.payload_place == 1
                        assert frame.shape == shape and len(frame) == shape[0]
                        while frame.tick not in there:
                            other = host.next(timeout=60)
                            there[other.tick] = other.copy()
                            if other.tick > frame.tick:
                                break
                        if frame.tick not in there:
                            continue
                        array = np.from_dlpack(frame)
                        assert array.dtype == dtype and array.shape == shape, (array.dtype, array.shape)
                        assert (array == there[frame.tick]).all() and (frame.copy() == there[frame.tick]).all()
                        n_compared += 1
            with gantry.open("ego/roof/lidar", device="mapped") as gpu:
                frame = gpu.next(timeout=60)
                points = np.from_dlpack(frame).view(np.float32)[:, :3]
                assert points.shape == (len(frame), 3) and (points == frame.copy()["hit_in_sensor_m"]).all()
        """)

    def test_a_tensor_keeps_its_slot_although_the_frame_is_gone(self):
        self.script("""
            with gantry.open("ego/front/instance", device="mapped") as gpu:
                frame = gpu.next(timeout=60)
                array = np.from_dlpack(frame)[1:]
                before = array.copy()
                del frame
                for _ in range(20):
                    assert gpu.next(timeout=60) is not None
                assert (array == before).all()
                held = [array] + [np.from_dlpack(gpu.next(timeout=60)) for _ in range(2)]
                try:
                    for _ in range(100):
                        if gpu.next(timeout=1) is not None:
                            raise AssertionError("a fourth frame")
                    raise AssertionError("no frame came")
                except gantry.BorrowLimitError:
                    pass
                del held, array
                assert gpu.next(timeout=60) is not None
            assert (before == before).all()
        """)

    def test_a_topic_goes_on_when_a_worker_takes_it_over(self):
        reads = self.start("""
            import asyncio
            async def read():
                with gantry.open("ego/front/rgb", device="mapped") as gpu:
                    last = 0
                    for what in ["by the simulator", "by a worker", "by the simulator again"]:
                        for _ in range(10):
                            frame = await gpu.anext(timeout=60)
                            assert frame is not None and frame.tick > last, (frame, last)
                            last = frame.tick
                        assert gpu.fallback is None
                        print(what, flush=True)
                        await asyncio.to_thread(input)
                    assert gpu.counts.refused == 0, gpu.counts
            asyncio.run(read())
        """)
        worker = None
        for what in ["by the simulator", "by a worker", "by the simulator again"]:
            self.assertEqual(reads.stdout.readline(), what + "\n")
            if what == "by the simulator":
                arguments = [SIMD.with_name("gantry-render"), "--domain", "live"]
                worker = subprocess.Popen(arguments, cwd=self.folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
                self.script("""
                    import time
                    while gantry.command({"do": "counters"})[0]["counters"]["sent_by_workers"] < 5:
                        time.sleep(0.05)
                """)
            elif what == "by a worker":
                worker.kill()
                worker.wait()
            reads.stdin.write("\n")
            reads.stdin.flush()
        self.finish(reads)

    def test_a_batch_is_one_tensor_of_all_images_in_shared_memory_and_on_the_gpu(self):
        self.script("""
            kinds = {"rgb": (np.uint8, (64, 96, 4)), "depth": (np.float32, (64, 96)), "semantic": (np.uint8, (64, 96)),
                     "instance": (np.uint32, (64, 96)), "flow": (np.float32, (64, 96, 2)), "normals": (np.float16, (64, 96, 4))}
            for modality, (dtype, shape) in kinds.items():
                name = f"batch/pair/{modality}"
                with gantry.open(name) as host, gantry.open(name, device="mapped") as gpu, \\
                     gantry.open(f"ego/side/{modality}") as side, gantry.open(f"ego/front/{modality}") as front:
                    cameras = host.cameras
                    assert [camera.name for camera in cameras] == ["ego/side", "ego/front"] and gpu.cameras == cameras, cameras
                    assert front.cameras == []
                    images = {"host": {}, "gpu": {}, "side": {}, "front": {}}
                    while len(both := set.intersection(*(set(of) for of in images.values()))) < 3:
                        frame = gpu.next(timeout=120)
                        assert frame is not None and frame.n_images == 2 and frame.size == (96, 64) and frame.header.n_images == 2
                        tensor = np.from_dlpack(frame)
                        assert frame.shape == tensor.shape == (2, *shape) and tensor.dtype == dtype and len(frame) == 2
                        assert tensor.strides == np.empty((2, *shape), dtype).strides, tensor.strides
                        images["gpu"][frame.tick] = frame.copy()
                        assert (tensor == images["gpu"][frame.tick]).all()
                        del tensor, frame
                        frame = host.next(timeout=120)
                        assert frame.array.shape == frame.image.shape == np.from_dlpack(frame).shape == (2, *shape)
                        assert frame.array.dtype == dtype and frame.array.flags.c_contiguous and not frame.array.flags.writeable
                        assert "2×96×64" in repr(frame)
                        if modality == "rgb":
                            assert frame.rgb.shape == (2, 64, 96, 3)
                        if modality in ("rgb", "depth", "semantic"):
                            assert frame._repr_png_().startswith(b"\\x89PNG")
                        images["host"][frame.tick] = frame.copy()
                        again = gantry.frame_from_bytes(frame.header_bytes() + frame.array.tobytes())
                        assert again.n_images == 2 and (again.array == frame.array).all()
                        for own, place, camera in ((side, "side", cameras[0]), (front, "front", cameras[1])):
                            frame = own.next(timeout=120)
                            assert frame.n_images == 0 and frame.shape == shape
                            assert frame.header.sensor_id == camera.sensor_id and frame.header.intrinsics_px == camera.intrinsics_px
                            images[place][frame.tick] = frame.copy()
                        del frame, again
                    for tick in both:
                        whole = images["host"][tick]
                        assert (whole == images["gpu"][tick]).all()
                        assert (whole[0] == images["side"][tick]).all() and (whole[1] == images["front"][tick]).all()
            with gantry.sync(["batch/pair/depth", "ego/side/depth"], snapshots=True) as rows:
                row = rows.next(timeout=120)
                ids = set(row.snapshot.actors["id"])
                assert {camera.sensor_id for camera in cameras} <= ids
        """)

    def test_what_cannot_be_is_said(self):
        self.script("""
            def sentence(*names, **options):
                try:
                    gantry.open(*names, **options)
                except (gantry.GantryError, ValueError) as error:
                    return str(error)
                raise AssertionError((names, options))

            assert "it must be \\"cuda\\"" in sentence("ego/front/rgb", device="gpu")
            assert "no process of this domain" in sentence("world/nothing/imu", device="mapped") or "there is no topic" in sentence("world/nothing/imu", device="mapped")
            assert "leave device out" in sentence("ego/front/rgb", device="cuda", result="boxes2d")
            import os
            if not os.path.exists("/dev/nvidia0"):
                assert "CUDA cannot be used here" in sentence("ego/front/rgb", device="cuda")
            with gantry.open("ego/front/rgb", device="mapped") as gpu:
                frame = gpu.next(timeout=60)
                for act, words in [(lambda: frame.array, "torch.from_dlpack"), (lambda: frame.__dlpack__(stream=0), "ambiguous")]:
                    try:
                        act()
                    except (TypeError, BufferError) as error:
                        assert words in str(error), error
                    else:
                        raise AssertionError(words)
                assert not hasattr(frame, "__cuda_array_interface__")
                assert frame.__dlpack_device__() == (1, 0)
            assert [t.name for t in gantry.topics() if t.name.endswith("/gpu")] == []
        """)


if __name__ == "__main__":
    sys.exit(unittest.main())
