"""Frames on the GPU against shared memory and an upload: how soon a tensor is in hand, and a first result.

    gpu_frames.py DOMAIN [--topic ego/front/rgb] [--frames 200] [--cameras TOPIC …] [--kills N]

Runs beside a simulator in free running on a GPU, and needs torch with CUDA. All times are since the frame was
published, microseconds. The result is the mean of the whole image, on the host.
"""

import argparse
import statistics
import subprocess
import sys
import time

import gantry


def row(name, times):
    """A line of the table: p50 and p99 of every moment."""
    cells = []
    for moment in zip(*times):
        ordered = sorted(moment)
        cells.append(f"{statistics.median(ordered):7.0f} /{ordered[int(0.99 * (len(ordered) - 1))]:7.0f}")
    print(f"| {name:34} | {' | '.join(cells)} |", flush=True)


def measure(name, arguments, device, to_tensor):
    """Reads frames one at a time, and notes when each was taken, a tensor, and a number."""
    import torch

    times = []
    with gantry.open(arguments.topic, domain=arguments.domain, device=device) as topic:
        for n in range(arguments.frames + 20):
            frame = topic.latest()
            published, taken = frame.published_mono_nanos, frame.taken_mono_nanos
            tensor = to_tensor(frame)
            if device is None:
                torch.cuda.current_stream().synchronize()
            in_hand = time.monotonic_ns()
            tensor.float().mean().item()
            done = time.monotonic_ns()
            del tensor, frame
            if n >= 20:
                times.append([(moment - published) / 1e3 for moment in (taken, in_hand, done)])
    row(name, times)


def ways(arguments):
    """Three ways of one topic to the GPU."""
    import torch

    device = torch.device("cuda")
    torch.ones(1, device=device).sum().item()
    pinned = None

    def through_pinned(frame):
        nonlocal pinned
        there = torch.from_dlpack(frame)
        if pinned is None:
            pinned = torch.empty_like(there, pin_memory=True)
        pinned.copy_(there)
        return pinned.to(device, non_blocking=True)

    print(f"\n{arguments.topic}, {arguments.frames} frames, p50 / p99 in µs since published\n")
    print(f"| {'way':34} | {'taken':16} | {'tensor in hand':16} | {'first result':16} |\n|---|---|---|---|")
    measure("on the GPU, frame.torch()", arguments, "cuda", lambda frame: frame.torch())
    measure("on the GPU, torch.from_dlpack", arguments, "cuda", torch.from_dlpack)
    measure("shared memory, .to(cuda)", arguments, None, lambda frame: torch.from_dlpack(frame).to(device))
    measure("shared memory, pinned, .to(cuda)", arguments, None, through_pinned)


def parts(arguments):
    """Where the time between publishing and a tensor goes, and what giving the frame back costs."""
    import torch

    for name, to_tensor in (("frame.torch()", lambda frame: frame.torch()), ("torch.from_dlpack", torch.from_dlpack)):
        times = []
        with gantry.open(arguments.topic, domain=arguments.domain, device="cuda") as topic:
            for n in range(arguments.frames + 20):
                frame = topic.latest(timeout=10)
                back = time.monotonic_ns()
                published, taken = frame.published_mono_nanos, frame.taken_mono_nanos
                begin = time.monotonic_ns()
                tensor = to_tensor(frame)
                in_hand = time.monotonic_ns()
                del tensor, frame
                released = time.monotonic_ns()
                if n >= 20:
                    times.append((taken - published, back - taken, in_hand - begin, released - in_hand))
        wake, back, tensor, release = (statistics.median(part) / 1e3 for part in zip(*times))
        print(f"p50 µs: wake {wake:.0f}, back in Python {back:.0f}, {name} {tensor:.0f}, release {release:.0f}", flush=True)


def network(arguments):
    """Newest images of several cameras into one network's input."""
    import torch

    layer = torch.nn.Conv2d(3, 16, 7, 4).cuda().half()
    topics = [gantry.open(name, domain=arguments.domain, device="cuda") for name in arguments.cameras]
    times = []
    for _ in range(arguments.frames):
        frames = [topic.latest(timeout=10) for topic in topics]
        published = max(frame.published_mono_nanos for frame in frames)
        images = torch.stack([torch.from_dlpack(frame) for frame in frames])
        with torch.no_grad():
            layer(images[..., [2, 1, 0]].permute(0, 3, 1, 2).half() / 255).float().mean().item()
        times.append([(time.monotonic_ns() - published) / 1e3])
        del frames, images
    print(f"\n{len(topics)} cameras into one network, {arguments.frames} times, µs since the last was published\n\n| | |\n|---|---|")
    row("result", times)


def used_mib():
    """GPU memory in use, as the driver says."""
    asked = ["nvidia-smi", "--query-gpu=memory.used", "--format=csv,noheader,nounits"]
    return int(subprocess.run(asked, capture_output=True, text=True, check=True).stdout.split()[0])


def kills(arguments):
    """Readers that are killed while they hold frames; what the GPU has in use before and after."""
    code = f"import gantry\nwith gantry.open({arguments.topic!r}, domain={arguments.domain!r}, device='cuda') as t:\n while True:\n  f = t.latest(timeout=10); print(f.tick, flush=True)"
    used = [used_mib()]
    for _ in range(arguments.kills):
        child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        child.stdout.readline()
        child.kill()
        child.wait()
        child.stdout.close()
    time.sleep(8)
    used.append(used_mib())
    print(f"\n{arguments.kills} readers killed: {used[0]} MiB in use before, {used[1]} MiB after")


def main():
    """Runs what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("domain")
    parser.add_argument("--topic", default="ego/front/rgb")
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--cameras", nargs="*", default=[])
    parser.add_argument("--kills", type=int, default=0)
    arguments = parser.parse_args()
    ways(arguments)
    parts(arguments)
    if arguments.cameras:
        network(arguments)
    if arguments.kills:
        kills(arguments)


if __name__ == "__main__":
    main()
