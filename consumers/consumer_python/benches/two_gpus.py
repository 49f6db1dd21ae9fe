"""Readers on two GPUs of one host while a camera moves between render workers on both.

    two_gpus.py [--programs FOLDER] [--frames 300]

Starts a simulator without a GPU and one `gantry-render` on each of the first two GPUs by turns, and needs torch with
CUDA. One reader is on each GPU. Whichever worker draws, one reader has frames directly and the other an upload; both
must see the same bytes. Times are since the frame was published, microseconds.
"""

import argparse
import json
import os
import statistics
import subprocess
import tempfile
import threading
import time
import warnings

import gantry
import torch

LAUNCH = """version = 1
[scenario]
map = "Town10HD"
seed = 7
tick_hz = 100
vehicles = 10
[sensor.front]
kind = "camera"
rate_hz = 100
width_px = 1920
height_px = 1080
mount.position_m = [0.6, 0.0, 1.6]
[topic."ego/front/rgb"]
readers = 4
"""
TOPIC = "ego/front/rgb"


def gpus(programs):
    """CUDA's number and the simulator's UUID of every GPU that both know."""
    listed = subprocess.run([f"{programs}/simd", "--adapters", "--json"], capture_output=True, text=True, check=True)
    known = {adapter["uuid"]: adapter["index"] for adapter in map(json.loads, listed.stdout.splitlines())}
    numbers = range(torch.cuda.device_count())
    return [(n, uuid) for n in numbers if (uuid := str(torch.cuda.get_device_properties(n).uuid)) in known]


class Reader(threading.Thread):
    """Reads on one GPU for as long as it is asked to, and keeps sums of bytes and times by tick."""

    def __init__(self, domain, number):
        super().__init__()
        self.domain, self.number = domain, number
        self.ends = threading.Event()
        self.frames, self.ways = {}, []

    def run(self):
        device = f"cuda:{self.number}"
        torch.cuda.set_device(self.number)
        weights = None
        with gantry.open(TOPIC, domain=self.domain, timeout=20, device=device) as topic:
            while not self.ends.is_set():
                frame = topic.latest(timeout=1, or_none=True)
                if frame is None:
                    continue
                tensor = frame.torch()
                in_hand = time.monotonic_ns()
                if weights is None:
                    weights = torch.arange(tensor.numel(), device=device, dtype=torch.int64) % 65521
                # A sum over bytes weighted by their places, modulo 2^64.
                check = int((tensor.reshape(-1).to(torch.int64) * weights).sum().item())
                self.frames[frame.tick] = (check, (in_hand - frame.published_mono_nanos) / 1e3, topic.fallback is None)
                if not self.ways or self.ways[-1][1] != topic.fallback:
                    self.ways.append((frame.tick, topic.fallback))
                del tensor, frame


def told(name, times):
    """A line with p50 and p99."""
    if times:
        ordered = sorted(times)
        print(f"  {name}: p50 {statistics.median(ordered):.0f} p99 {ordered[int(0.99 * (len(ordered) - 1))]:.0f} us, {len(times)} frames")


def peer_copies(domain, here, there, frames):
    """A frame of `here` copied to `there` by the GPUs themselves."""
    times = []
    print(f"the GPUs reach one another: {torch.cuda.can_device_access_peer(here, there)}")
    with gantry.open(TOPIC, domain=domain, timeout=20, device=f"cuda:{here}") as topic:
        while len(times) < frames:
            frame = topic.latest(timeout=10)
            tensor = frame.torch().to(f"cuda:{there}")
            torch.cuda.synchronize(there)
            times.append((time.monotonic_ns() - frame.published_mono_nanos) / 1e3)
            del tensor, frame
    told(f"from GPU {here} to GPU {there} by a copy between them, in hand", times[20:])


def main():
    """Moves a camera from one GPU to the other and back."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--programs", default="target/release")
    parser.add_argument("--frames", type=int, default=300)
    arguments = parser.parse_args()
    warnings.simplefilter("always")
    both = gpus(arguments.programs)
    if len(both) < 2:
        raise SystemExit(f"two GPUs are needed that Vulkan and CUDA know; found {both}")
    domain = f"two-{os.getpid()}"
    folder = tempfile.mkdtemp()
    with open(f"{folder}/launch.toml", "w") as file:
        file.write(LAUNCH)

    def start(*command):
        return subprocess.Popen([f"{arguments.programs}/{command[0]}", *command[1:], "--domain", domain], cwd=folder)

    def worker(which):
        return start("gantry-render", "--name", f"gpu{which}", "--adapter", both[which][1])

    def wait_frames(frames):
        least = [len(reader.frames) + frames for reader in readers]
        while any(len(reader.frames) < n for reader, n in zip(readers, least)):
            time.sleep(0.01)

    simulator = start("simd", "--launch", "launch.toml", "--no-gpu", "--await-workers", "1")
    workers = [worker(0)]
    readers = [Reader(domain, both[which][0]) for which in (0, 1)]
    for reader in readers:
        reader.start()
    wait_frames(arguments.frames)
    for turn in range(2):
        goes, comes = (0, 1) if turn == 0 else (1, 0)
        if turn == 1:
            peer_copies(domain, both[1][0], both[0][0], arguments.frames)
        workers.append(worker(comes))
        time.sleep(4)
        print(f"== the worker on GPU {goes} is killed; GPU {comes} takes the camera over")
        workers[-2].kill()
        workers[-2].wait()
        wait_frames(arguments.frames)
    for reader in readers:
        reader.ends.set()
        reader.join()
    workers[-1].terminate()
    simulator.terminate()
    codes = [workers[-1].wait(), simulator.wait()]
    common = readers[0].frames.keys() & readers[1].frames.keys()
    differ = [tick for tick in common if readers[0].frames[tick][0] != readers[1].frames[tick][0]]
    print(f"{len(common)} frames read on both GPUs, {len(differ)} differ; programs ended with {codes}")
    for reader in readers:
        ticks = sorted(reader.frames)
        gaps = [(a, b) for a, b in zip(ticks, ticks[1:]) if b > a + 1]
        print(f"reader on GPU {reader.number}: ways by tick {reader.ways}; ticks passed over {gaps}")
        for name, is_direct in (("directly", True), ("by an upload", False)):
            told(f"{name}, tensor in hand", [in_hand for _, in_hand, direct in reader.frames.values() if direct == is_direct][20:])


if __name__ == "__main__":
    main()
