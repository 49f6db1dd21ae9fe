"""What the package itself costs: making views, and publishing 1920x1080 images to a reader in another process.

    package.py [--json FILE] [--count N]

Latency of frames from Rust to Python beside Rust to Rust: gantry-bench latency --python PROGRAM.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import time

import numpy as np

import gantry
from gantry import _dtypes, _layout

WIDTH, HEIGHT, RATE_HZ, WARM_UP = 1920, 1080, 100.0, 30
DOMAIN = f"bench-{os.getpid()}"
ROWS = []


def note(name, nanos):
    """Adds a row of times and prints it."""
    micros = np.asarray(nanos) / 1e3
    row = {"name": name, "p50_us": float(np.percentile(micros, 50)), "p99_us": float(np.percentile(micros, 99)), "n": len(micros)}
    ROWS.append(row)
    print(f"{name}: p50 {row['p50_us']:.2f} us, p99 {row['p99_us']:.2f} us, n {row['n']}", flush=True)


def machine():
    """The same form as launch_cli::bench writes: on which machine, from which commit, with which command."""
    models = [line.split(": ", 1)[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")]
    commit = subprocess.run(["git", "describe", "--always", "--dirty", "--abbrev=10"], capture_output=True, text=True)
    return {
        "cpu": models[0] if models else "unknown",
        "n_cores": len(os.sched_getaffinity(0)),
        "kernel": platform.release(),
        "load_1min": open("/proc/loadavg").read().split()[0],
        "commit": commit.stdout.strip() or "unknown",
        "command": f"package.py with Python {platform.python_version()}, numpy {np.__version__}",
    }


def frame_1080p():
    """A frame of rgb, as a recording holds it."""
    header = np.zeros((), _dtypes.FRAME_HEADER)
    header["magic"], header["schema_version"], header["header_bytes"] = _layout.FRAME_MAGIC, _layout.SCHEMA_VERSION, 256
    header["encoding"], header["element_bytes"], header["row_stride"] = 1, 4, 4 * WIDTH
    header["width"], header["height"], header["payload_bytes"] = WIDTH, HEIGHT, 4 * WIDTH * HEIGHT
    return gantry.frame_from_bytes(header.tobytes() + bytes(4 * WIDTH * HEIGHT))


def views(what, act, n=200, calls=1000):
    """Times an act, `calls` at a time."""
    times = []
    for _ in range(n):
        began = time.perf_counter_ns()
        for _ in range(calls):
            act()
        times.append((time.perf_counter_ns() - began) / calls)
    note(what, times)


def paced(n):
    """Yields `n` times at the rate; a late turn delays those after it."""
    period, due = 1.0 / RATE_HZ, time.monotonic()
    for i in range(n):
        time.sleep(max(0.0, due - time.monotonic()))
        due = max(due, time.monotonic() - period) + period
        yield i


def read(topic, n):
    """The reader: prints how old each result was when its view was in hand, nanoseconds."""
    ages = []
    with gantry.open(topic, domain=sys.argv[2], result="image") as reader:
        print("ready", flush=True)
        for _ in range(n):
            result = reader.next(timeout=20)
            view = result.array
            held = time.monotonic_ns()
            assert view.shape == (HEIGHT, WIDTH, 4)
            ages.append(held - result.header.published_mono_nanos)
            del result, view
    print(json.dumps(ages))


def publish(name, count, send):
    """Publishes at the rate with one reader in a process of its own, asleep until a result comes."""
    topic = f"bench/{name.replace(' ', '_')}"
    with gantry.publish(topic, "image", domain=DOMAIN, max_bytes=4 * WIDTH * HEIGHT) as writer:
        n = WARM_UP + count
        reader = subprocess.Popen([sys.executable, __file__, "read", DOMAIN, topic, str(n)], stdout=subprocess.PIPE, text=True)
        assert reader.stdout.readline() == "ready\n", "the reader ended before it was ready"
        times = []
        for i in paced(n):
            began = time.perf_counter_ns()
            send(writer, i)
            times.append(time.perf_counter_ns() - began)
        ages = json.loads(reader.communicate()[0])
    note(f"{name}: the writer's time", times[WARM_UP:])
    note(f"{name}: published to view in hand", ages[WARM_UP:])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", metavar="FILE")
    parser.add_argument("--count", type=int, default=300, help="images per way of publishing")
    args = parser.parse_args()
    frame, image = frame_1080p(), np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH, 4), np.uint8)
    other, held = image[::-1].copy(), np.empty_like(image)
    data = frame.header_bytes() + frame.array.tobytes()
    views("a 1080p frame made of bytes, with its view", lambda: gantry.frame_from_bytes(data).array)
    views("the view of a frame asked for again", lambda: frame.array)
    views("view of R G B", lambda: frame.rgb)
    views("header by name", lambda: gantry.Header.from_bytes(frame.header_bytes()))
    copies = []
    for _ in paced(args.count):
        began = time.perf_counter_ns()
        np.copyto(held, image)
        copies.append(time.perf_counter_ns() - began)
    note("for scale: np.copyto of 1080p", copies)

    def in_place(writer, _):
        with writer.loan(image.shape) as pixels:
            np.subtract(image, other, out=pixels)

    def empty(writer, i):
        with writer.loan(image.shape) as pixels:
            pixels[0, 0] = i % 256

    publish("loan and send", args.count, empty)
    publish("send a copy", args.count, lambda writer, _: writer.send(image))
    publish("subtract in place", args.count, in_place)
    if args.json:
        with open(args.json, "w") as file:
            json.dump({"bench": "package.py", "machine": machine(), "rows": ROWS}, file, indent=2)
            file.write("\n")


if __name__ == "__main__":
    read(sys.argv[3], int(sys.argv[4])) if sys.argv[1:2] == ["read"] else main()
