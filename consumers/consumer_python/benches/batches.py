"""Images of many cameras as one tensor: read as a topic for each camera and stacked, and as one batch.

    batches.py [--cameras 64] [--size 256x256] [--hz 20] [--modality rgb] [--device cuda|mapped|none] [--frames 200] [-- SIMD ARGUMENTS]

Starts a simulator of its own on the domain `batches-bench`, with `--simd` or the one beside this checkout. With `--device cuda`
(torch with CUDA) the tensor is on the GPU: stacked there, or taken as it is; and frames of shared memory are uploaded. `mapped` is for
software adapters and `none` leaves the GPU's side out; both need numpy only.

One line per way: complete sets a second, µs since the last image of the set was published until the tensor is in hand (p50 / p99),
processor time of the reader and of the simulator per set (ms), and how often the reader went to sleep per set.
"""

import argparse
import os
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile
import time

import gantry
import numpy as np

DOMAIN = "batches-bench"
BUILT = pathlib.Path(__file__).resolve().parents[3] / "target" / "release" / "simd"


def launch(arguments):
    """A launch file of cameras all round the ego vehicle, and their batch."""
    width, height = arguments.size
    cameras = "".join(
        f'[sensor.c{i:03}]\nkind = "camera"\nmodalities = ["{arguments.modality}"]\nrate_hz = {arguments.hz}\nwidth_px = {width}\nheight_px = {height}\n'
        f"mount.position_m = [0.0, 0.0, {1.6 + 0.02 * i:.2f}]\nmount.rpy_deg = [0.0, 0.0, {360.0 * i / arguments.cameras - 180.0:.3f}]\n"
        for i in range(arguments.cameras)
    )
    return (
        f'version = 1\n[scenario]\nmap = "{arguments.map}"\ntick_hz = {arguments.hz}\nvehicles = {arguments.vehicles}\n{cameras}'
        f'[batch.all]\ncameras = ["ego/*"]\nmodalities = ["{arguments.modality}"]\n'
    )


def processor_ms(pid):
    """Processor time of a process, ms."""
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) * 1e3 / os.sysconf("SC_CLK_TCK")


def next_of(topic):
    return topic.next(timeout=60)


class Topics:
    """A topic for each camera: frames of one tick, stacked."""

    def __init__(self, arguments, device):
        names = [f"ego/c{i:03}/{arguments.modality}" for i in range(arguments.cameras)]
        self.topics = [gantry.open(name, domain=DOMAIN, timeout=60, device=device) for name in names]

    def next(self):
        """The frames of the next tick that all have."""
        heads = [next_of(topic) for topic in self.topics]
        while len({head.tick for head in heads}) > 1:
            newest = max(head.tick for head in heads)
            for i, topic in enumerate(self.topics):
                while heads[i].tick < newest:
                    heads[i] = next_of(topic)
        return heads


class Batch:
    """One topic for all cameras."""

    def __init__(self, arguments, device):
        self.topics = [gantry.open(f"batch/all/{arguments.modality}", domain=DOMAIN, timeout=60, device=device)]

    def next(self):
        """Its next frame."""
        return [next_of(self.topics[0])]


def tensors(arguments):
    """How frames become one tensor, by where they are: of several topics, and of a batch."""
    if arguments.device != "cuda":
        return {
            None: (lambda frames: np.stack([frame.array for frame in frames]), lambda frames: frames[0].array),
            "mapped": (lambda frames: np.stack([np.from_dlpack(frame) for frame in frames]), lambda frames: np.from_dlpack(frames[0])),
        }
    import torch

    torch.ones(1, device="cuda").sum().item()

    def done(tensor):
        torch.cuda.current_stream().synchronize()
        return tensor

    return {
        None: (
            lambda frames: done(torch.stack([torch.from_dlpack(frame) for frame in frames]).to("cuda")),
            lambda frames: done(torch.from_dlpack(frames[0]).to("cuda")),
        ),
        "cuda": (
            lambda frames: done(torch.stack([torch.from_dlpack(frame) for frame in frames])),
            lambda frames: torch.from_dlpack(frames[0]),
        ),
    }


def measure(name, way, to_tensor, arguments, simulator):
    """Reads sets one after the other; a line of the table."""
    shape = None
    for _ in range(10):
        frames = way.next()
        tensor = to_tensor(frames)
        shape = tuple(tensor.shape)
        del frames, tensor
    wanted = (arguments.cameras, arguments.size[1], arguments.size[0])
    if shape[:3] != wanted:
        sys.exit(f"{name}: the tensor is {shape}, not {wanted}")
    before = (time.monotonic(), time.process_time(), processor_ms(simulator.pid), resource.getrusage(resource.RUSAGE_SELF).ru_nvcsw)
    waits = []
    for _ in range(arguments.frames):
        frames = way.next()
        published = max(frame.published_mono_nanos for frame in frames)
        tensor = to_tensor(frames)
        waits.append((time.monotonic_ns() - published) / 1e3)
        del frames, tensor
    after = (time.monotonic(), time.process_time(), processor_ms(simulator.pid), resource.getrusage(resource.RUSAGE_SELF).ru_nvcsw)
    seconds, own, theirs, sleeps = (b - a for a, b in zip(before, after))
    n = arguments.frames
    waits.sort()
    cells = [
        f"{n / seconds:8.1f}", f"{statistics.median(waits):8.0f} /{waits[int(0.99 * (n - 1))]:8.0f}",
        f"{own * 1e3 / n:8.3f}", f"{theirs / n:8.3f}", f"{sleeps / n:8.2f}",
    ]  # fmt: skip
    print(f"| {name:44} | {' | '.join(cells)} |", flush=True)
    for topic in way.topics:
        topic.close()


def size(text):
    """`256x256` as two numbers."""
    width, height = text.split("x")
    return int(width), int(height)


def main():
    """Starts a simulator and measures every way."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cameras", type=int, default=64)
    parser.add_argument("--size", type=size, default=(256, 256))
    parser.add_argument("--hz", type=float, default=20.0)
    parser.add_argument("--modality", default="rgb")
    parser.add_argument("--device", choices=["cuda", "mapped", "none"], default="cuda")
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--map", default="Town10HD")
    parser.add_argument("--vehicles", type=int, default=0)
    parser.add_argument("--simd", type=pathlib.Path, default=BUILT)
    parser.add_argument("arguments", nargs="*", help="further arguments of simd, after --")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder) / "batches.toml"
        file.write_text(launch(arguments))
        command = [arguments.simd, "--launch", file, "--domain", DOMAIN, *arguments.arguments]
        log = pathlib.Path(folder) / "simd.log"
        with log.open("w") as to:
            simulator = subprocess.Popen(command, stdout=to, stderr=subprocess.STDOUT)
        try:
            while "ready" not in log.read_text():
                if simulator.poll() is not None:
                    sys.exit(f"the simulator ended:\n{log.read_text()}")
                time.sleep(0.1)
            width, height = arguments.size
            print(f"\n{arguments.cameras} cameras of {width} × {height}, {arguments.modality}, {arguments.hz:g} Hz, {arguments.frames} sets each\n")
            print(f"| {'way':44} | sets/s   | µs until in hand  | reader ms | simulator ms | sleeps |\n|---|---|---|---|---|---|")
            kinds = tensors(arguments)
            for device in [None] if arguments.device == "none" else [None, arguments.device]:
                place = "shared memory" if device is None else f"on the GPU ({device})"
                stacked, whole = kinds[device]
                measure(f"{arguments.cameras} topics, {place}, stacked", Topics(arguments, device), stacked, arguments, simulator)
                measure(f"one batch, {place}", Batch(arguments, device), whole, arguments, simulator)
        finally:
            simulator.terminate()
            simulator.wait()


if __name__ == "__main__":
    main()
