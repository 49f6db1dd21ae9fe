"""Frames and results on a GPU in Python.

Frames are those of the software adapter, whose exported memory is mapped in the place of CUDA; results are on a
driver for tests in the place of NVIDIA's, whose device memory any process can look at.
"""

import pathlib
import signal
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
[sensor.rear]
kind = "camera"
modalities = ["rgb"]
rate_hz = 20
width_px = 96
height_px = 64
mount.position_m = [-0.6, 0.0, 1.6]
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
                        if gpu.next(timeout=1, or_none=True) is not None:
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
                with gantry.open("ego/rear/rgb", device="mapped") as gpu:
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

    def test_torch_is_handed_a_capsule(self):
        (self.folder / "torch").mkdir()
        (self.folder / "torch" / "__init__.py").write_text("import numpy\ndef from_dlpack(sample):\n    return 'asked', numpy.asarray(sample)\n")
        (self.folder / "torch" / "utils").mkdir()
        (self.folder / "torch" / "utils" / "__init__.py").write_text("")
        (self.folder / "torch" / "utils" / "dlpack.py").write_text(
            "import numpy\nclass Held:\n    def __init__(self, capsule): self.capsule = capsule\n    def __dlpack__(self, **_): return self.capsule\n"
            "    def __dlpack_device__(self): return 1, 0\ndef from_dlpack(capsule):\n    return 'given', numpy.from_dlpack(Held(capsule))\n"
        )
        self.script("""
            with gantry.open("ego/front/rgb", device="mapped") as gpu, gantry.open("ego/front/rgb") as host:
                frame = gpu.next(timeout=60)
                how, tensor = frame.torch()
                assert how == "given" and (tensor == frame.copy()).all()
                how, tensor = host.next(timeout=60).torch()
                assert how == "asked" and tensor.shape == (64, 96, 4)
                before = tensor.copy()
                del frame
                for _ in range(10):
                    assert gpu.next(timeout=60) is not None
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
            import os
            if not os.path.exists("/dev/nvidia0"):
                assert "CUDA cannot be used here" in sentence("ego/front/rgb", device="cuda")
            with gantry.open("ego/front/rgb", device="mapped") as gpu:
                frame = gpu.next(timeout=60)
                for act, words in [(lambda: frame.array, "frame.torch()"), (lambda: frame.__dlpack__(stream=0), "ambiguous")]:
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


#: What every script about results begins with: a tensor of another library on the device of the driver for tests,
#: whose memory is that of the process.
TENSORS = """
import ctypes

pointer_of = ctypes.pythonapi.PyCapsule_GetPointer
pointer_of.restype, pointer_of.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]

class Tensor:
    def __init__(self, array, number=0):
        self.array, self.number, self.streams = array, number, []
    def __dlpack_device__(self):
        return 2, self.number
    def __dlpack__(self, stream=None):
        self.streams.append(stream)
        capsule = self.array.__dlpack__()
        device = (ctypes.c_int32 * 2).from_address(pointer_of(capsule, b"dltensor") + 8)
        device[:] = 2, self.number
        return capsule
    def contiguous(self):
        return Tensor(np.ascontiguousarray(self.array), self.number)

class Shown:
    def __init__(self, array, **more):
        self.array = array
        self.__cuda_array_interface__ = {**array.__array_interface__, "version": 2, **more}

def seen(gpu):
    address = gpu.__cuda_array_interface__["data"][0]
    dtype = np.dtype(gpu.__cuda_array_interface__["typestr"])
    n = int(np.prod(gpu.shape))
    return np.frombuffer((ctypes.c_uint8 * (n * dtype.itemsize)).from_address(address), dtype).reshape(gpu.shape)

def sentence(act, error=ValueError):
    try:
        act()
    except error as found:
        return str(found)
    raise AssertionError("it was taken")
"""


class ResultsOnGpu(LiveCase):
    """Writers and readers of results on a driver for tests."""

    def setUp(self):
        super().setUp()
        source = pathlib.Path(__file__).resolve().parents[2] / "consumer_gpu" / "tests" / "fake_cuda" / "fake_cuda.c"
        driver = self.folder / "driver"
        driver.mkdir()
        subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-o", driver / "libcuda.so", source], check=True)
        self.driver = {"LD_LIBRARY_PATH": str(driver), "FAKE_CUDA_UUID": "00" * 15 + "07", "FAKE_CUDA_LOG": str(self.folder / "cuda.log")}

    def start(self, text, **environment):
        import textwrap

        return super().start(TENSORS + textwrap.dedent(text), **{**self.driver, **environment})

    def noted(self, what):
        """Lines of work on the device that begin so."""
        log = self.folder / "cuda.log"
        return [line for line in (log.read_text().splitlines() if log.exists() else []) if line.startswith(what)]

    def test_tensors_of_every_kind_arrive_as_they_were_sent(self):
        self.script("""
            kinds = ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8", "?"]
            with gantry.publish("net/features", "tensor", device="cuda") as topic:
                assert topic.device == "cuda:0" and topic.n_readers == 0
                # Nobody reads: nothing is made or copied.
                assert topic.send(Tensor(np.ones((2, 3)))) == 0 and topic.device_bytes == 0
                with gantry.open("net/features", device="cuda", result="tensor") as gpu, gantry.open("net/features", result="tensor") as host:
                    assert topic.n_readers == 2
                    for n, kind in enumerate(kinds):
                        array = (np.arange(24).reshape(2, 3, 4) % 5).astype(kind)
                        for tensor in (Tensor(array), Shown(array), Shown(array, version=3, stream=None), Shown(array, version=3, stream=1), array):
                            if kind == "?" and isinstance(tensor, Tensor):
                                continue  # numpy gives no capsules of bool in its oldest form
                            assert topic.send(tensor, tick=n) == 2
                            result, same = gpu.next(timeout=10), host.next(timeout=10)
                            assert result.device == "cuda:0" and same.device is None and result.__dlpack_device__() == (2, 0)
                            assert (result.tick, result.seq, result.shape, len(result), result.format) == (n, same.seq, (2, 3, 4), 2, same.format)
                            assert seen(result).dtype == array.dtype and (seen(result) == array).all() and (same.array == array).all()
                            assert (result.copy() == array).all() and result.copy().dtype == array.dtype
                            if isinstance(tensor, Tensor):
                                assert tensor.streams == [topic._native.stream()]
                            del result, same
                    # One number, nothing at all, and something that does not lie in one piece.
                    for array in (np.array(3, np.float32), np.zeros((0, 4), np.float32), np.arange(24.0).reshape(4, 6)[:, ::2].T):
                        topic.send(Tensor(array))
                        result, same = gpu.next(timeout=10), host.next(timeout=10)
                        assert result.shape == array.shape and (same.array == array).all() and (result.copy() == array).all()
                        del result, same
                    assert topic.device_bytes == 2 << 20
            with gantry.publish("net/picture", "image", device="cuda:0") as topic, gantry.open("net/picture", device="cuda") as gpu:
                picture = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
                topic.send(Tensor(picture))
                result = gpu.next(timeout=10)
                assert result.type == "image" and result.format == "rgb8" and (seen(result) == picture).all()
        """)
        self.assertEqual(len(self.noted("create")), 2)

    def test_a_reader_in_another_process_and_one_in_shared_memory_get_the_same_bytes(self):
        writer = self.start("""
            import time
            with gantry.publish("net/features", "tensor", device="cuda", note="of the test") as topic:
                print("publishing", flush=True)
                n = 0
                while True:
                    n += 1
                    topic.send(Tensor(np.arange(1000, dtype=np.uint32) * n), tick=n)
                    time.sleep(0.002)
        """)
        self.assertEqual(writer.stdout.readline(), "publishing\n")
        reader = """
            with gantry.open("net/features", device="cuda") as gpu:
                held = []
                for _ in range(30):
                    result = gpu.next(timeout=60)
                    assert (seen(result) == np.arange(1000, dtype=np.uint32) * result.tick).all() and result.inputs == []
                print("read", flush=True)
                for result in gpu:
                    held = [*held[-1:], result]
        """
        first = self.start(reader)
        self.assertEqual(first.stdout.readline(), "read\n")
        self.assertEqual(self.noted("to host"), [], "nobody reads in shared memory")
        for _ in range(3):
            other = self.start(reader)
            self.assertEqual(other.stdout.readline(), "read\n")
            other.send_signal(signal.SIGKILL)
            self.finish(other, -signal.SIGKILL)
        self.script("""
            with gantry.open("net/features") as host:
                for _ in range(10):
                    result = host.next(timeout=60)
                    assert (result.array == np.arange(1000, dtype=np.uint32) * result.tick).all()
        """)
        self.assertGreaterEqual(len(self.noted("to host 4000")), 10)
        self.assertIsNone(first.poll())
        for process in (writer, first):
            process.send_signal(signal.SIGKILL)
            self.finish(process, -signal.SIGKILL)
        # The next one removes what they left.
        self.script("""
            with gantry.publish("net/features", "tensor", device="cuda") as topic:
                topic.send(Tensor(np.ones(3)))
            gantry._native.leave("live")
        """)

    def test_a_loan_is_a_slot_of_the_gpu(self):
        self.script("""
            with gantry.publish("net/features", "tensor", device="cuda", max_bytes=4096) as topic, gantry.open("net/features", device="cuda") as gpu:
                assert topic.device_bytes == 2 << 20
                with (loan := topic.loan((4, 8), "float16", tick=7)) as slot:
                    assert slot.shape == (4, 8) and slot.dtype == np.float16 and slot.__dlpack_device__() == (2, 0)
                    assert slot.__cuda_array_interface__["data"][1] is False
                    capsule = slot.__dlpack__(stream=1)
                    seen(slot)[:] = np.arange(32).reshape(4, 8)
                assert loan.n_received == 1
                result = gpu.next(timeout=10)
                assert result.tick == 7 and (seen(result) == np.arange(32).reshape(4, 8)).all()
                assert "sent or dropped" in sentence(lambda: slot.__dlpack__(), gantry.GantryError)
                del capsule
                # A result on the GPU is a tensor like any other: a chain without a copy over the bus.
                with gantry.publish("net/more", "tensor", device="cuda") as more, gantry.open("net/more", device="cuda") as last:
                    more.send(result, answers=result)
                    found = last.next(timeout=10)
                    assert [one.topic for one in found.inputs] == ["net/features"] and found.tick == 7 and (found.copy() == result.copy()).all()
                # An exception gives the slot back, and the torch of a type has the name of numpy's.
                class dtype:
                    def __str__(self):
                        return "torch.int32"
                try:
                    with topic.loan(3, dtype()) as slot:
                        assert slot.dtype == np.int32
                        raise KeyError("mine")
                except KeyError:
                    pass
                assert gpu.next(timeout=0.05, or_none=True) is None
                loans = [topic.loan(3) for _ in range(3)]
                assert "all its loans are open" in sentence(lambda: topic.loan(3), gantry.BorrowLimitError)
                del loans
                topic.loan(3).give_back()
        """)

    def test_what_cannot_be_sent_is_said(self):
        self.script("""
            with gantry.publish("net/features", "tensor", device="cuda") as topic, gantry.publish("net/picture", "image", device="cuda") as picture:
                class Half(Tensor):
                    def __dlpack__(self, stream=None):
                        capsule = super().__dlpack__(stream)
                        # DLPack's number of bfloat16.
                        ctypes.c_uint8.from_address(pointer_of(capsule, b"dltensor") + 20).value = 4
                        return capsule
                class Named:
                    def __str__(self):
                        return "torch.bfloat16"
                class Elsewhere(Tensor):
                    def __dlpack_device__(self):
                        return 10, 0
                class Pieces(Tensor):
                    contiguous = None
                assert "bfloat16 cannot be sent" in sentence(lambda: topic.send(Half(np.zeros(3, np.uint16))))
                assert "bfloat16 cannot be sent" in sentence(lambda: topic.loan(3, Named()))
                assert "is on cuda:1, and the topic on cuda:0" in sentence(lambda: topic.send(Tensor(np.zeros(3), 1)))
                assert "of DLPack's kind 10" in sentence(lambda: topic.send(Elsewhere(np.zeros(3))))
                assert "do not lie one behind the other" in sentence(lambda: topic.send(Pieces(np.zeros((4, 4)).T[1:])))
                assert "complex128 with 1 dimensions cannot be sent" in sentence(lambda: topic.send(Tensor(np.zeros(3, complex))))
                assert "with 9 dimensions cannot be sent" in sentence(lambda: topic.send(Tensor(np.zeros(9 * (1,)))))
                assert "no usual pixel format" in sentence(lambda: picture.send(Tensor(np.zeros((2, 2, 2), np.uint8))))
                assert "answers frames and results" in sentence(lambda: topic.send(Tensor(np.zeros(3)), answers=[3]))
                assert "boxes2d are no arrays" in sentence(lambda: gantry.publish("a", "boxes2d", device="cuda"), gantry.GantryError)
                assert "must be \\"cuda\\"" in sentence(lambda: gantry.publish("a", "tensor", device="gpu"))
                assert "CUDA has no device 3" in sentence(lambda: gantry.publish("a", "tensor", device="cuda:3"), gantry.GantryError)
                assert "a topic has one writer" in sentence(lambda: gantry.publish("net/features", "tensor", device="cuda"), gantry.TopicTakenError)
                with gantry.open("net/features", device="cuda") as gpu:
                    topic.send(np.ones(3))
                    result = gpu.next(timeout=10)
                    assert "result.torch()" in sentence(lambda: result.array, TypeError)
                    assert "ambiguous" in sentence(lambda: result.__dlpack__(stream=0), BufferError)
            assert "is closed" in sentence(lambda: topic.send(np.ones(3)), gantry.GantryError)
            with gantry.publish("log", "text") as log:
                assert "of type text" in sentence(lambda: gantry.open("log", device="cuda"), gantry.GantryError)
        """)
        self.script(
            """
            room = sentence(lambda: gantry.publish("a", "tensor", device="cuda", max_bytes=1 << 30, gpu_readers=1), gantry.GantryError)
            assert "no room on the GPU for 8 results" in room and "8192 MiB: 1024 of" in room, room
        """,
            FAKE_CUDA_FREE=str(1 << 30),
        )

    def test_results_in_shared_memory_are_uploaded_with_one_warning(self):
        self.script("""
            import warnings
            with gantry.publish("net/features", "tensor") as topic, warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always")
                with gantry.open("net/features", device="cuda") as gpu, gantry.open("net/features", device="cuda") as second:
                    topic.send(np.arange(6.0).reshape(2, 3))
                    result = gpu.next(timeout=10)
                    assert result.device == "cuda:0" and (seen(result) == np.arange(6.0).reshape(2, 3)).all()
                assert [str(one.message) for one in said if "does not stay on the GPU" in str(one.message)] != [] and len(said) == 1, said
        """)
        self.assertEqual(len(self.noted("upload 48")), 1)


if __name__ == "__main__":
    sys.exit(unittest.main())
