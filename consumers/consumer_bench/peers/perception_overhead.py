"""What the perception benchmark itself costs: how old images are when a program has them, with
`gantry bench perception` looking on and without it, in turn.

    python perception_overhead.py launch/bench/smoke.toml --rounds 5 --out raw.json

Needs the Python package `gantry`, and Gantry's programs on PATH or in `--programs`.
"""

import argparse
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TOPIC = "ego/front/rgb"


def program(out: Path) -> None:
    """Notes the age of every image at the moment in which it is in hand, until it is ended."""
    import gantry

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    ages_ns = []
    try:
        with gantry.open(TOPIC, timeout=120) as camera, gantry.publish("overhead/boxes", "boxes2d") as boxes:
            for frame in camera:
                ages_ns.append(time.monotonic_ns() - frame.published_mono_nanos)
                boxes.send(gantry.boxes2d([], []), answers=frame)
    except KeyboardInterrupt:
        pass
    out.write_text(json.dumps(ages_ns))


def watched(options, out: Path, folder: Path, modes: str) -> None:
    """Under the benchmark."""
    subprocess.run(
        [options.programs / "gantry-bench", "perception", options.suite, "--cache", options.cache, "--modes", modes, "--out", folder]
        + ["--", sys.executable, __file__, "--program", out],
        check=True,
        stdout=subprocess.DEVNULL,
    )


def bare(options, out: Path, folder: Path, recording: Path) -> None:
    """The same recording and the same program, and nothing beside them."""
    import gantry

    domain = f"overhead{os.getpid()}"
    os.environ["GANTRY_DOMAIN"] = domain
    words = [recording, "--paused", "--hold", "--domain", domain, "--results", "none", "--topics", "ego/front/rgb", "ego/roof/lidar"]
    replay = subprocess.Popen([options.programs / "gantry-replay", *words], stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    child = subprocess.Popen([sys.executable, __file__, "--program", out], stdin=subprocess.DEVNULL)
    try:
        time.sleep(3)
        gantry.resume(domain=domain)
        time.sleep(options.secs + 1)
    finally:
        child.send_signal(signal.SIGINT)
        child.wait(timeout=30)
        replay.send_signal(signal.SIGINT)
        replay.wait(timeout=30)


def spread_us(ages_ns: list) -> dict:
    """Percentiles, microseconds."""
    ages = sorted(age / 1e3 for age in ages_ns)
    at = lambda share: ages[min(len(ages) - 1, int(share * len(ages)))]  # noqa: E731
    return {"n": len(ages), "mean": statistics.fmean(ages), "p50": at(0.5), "p90": at(0.9), "p99": at(0.99), "max": ages[-1]}


def machine(load: float) -> dict:
    """The machine as the other benches describe it."""
    cpu = next((line.split(":", 1)[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), "unknown")
    words = ["git", "-C", Path(__file__).parent, "describe", "--always", "--dirty", "--abbrev=10"]
    return {
        "cpu": cpu,
        "n_cores": os.cpu_count(),
        "kernel": os.uname().release,
        "load_1min": f"{load:.2f}",
        "commit": subprocess.run(words, capture_output=True, text=True).stdout.strip() or "unknown",
        "command": " ".join(["perception_overhead.py", *sys.argv[1:]]),
    }


def main() -> None:
    load = os.getloadavg()[0]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("suite", nargs="?", type=Path)
    parser.add_argument("--program", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--secs", type=float, default=5.0, help="length of the recording, seconds")
    parser.add_argument("--cache", type=Path, default=Path("cache"))
    parser.add_argument("--programs", type=Path, default=Path("target/release"))
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    if options.program:
        return program(options.program)
    ages = {"bare": [], "benchmark": []}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        truth = [options.programs / "gantry-bench", "perception", options.suite, "--cache", options.cache, "--truth-only"]
        listed = subprocess.run(truth, check=True, capture_output=True, text=True).stdout
        recording = Path(listed.split()[2])
        for i in range(options.rounds):
            for kind in ages:
                out = folder / f"{kind}{i}.json"
                if kind == "bare":
                    bare(options, out, folder, recording)
                else:
                    watched(options, out, folder / f"report{i}", "streaming")
                # The first images after a start find cold caches, with and without the benchmark.
                ages[kind] += json.loads(out.read_text())[10:]
    rows = [{"name": kind, **spread_us(of)} for kind, of in ages.items()]
    added = {at: (rows[1][at] / rows[0][at] - 1) * 100 for at in ("p50", "p90", "p99")}
    result = {"bench": "perception_overhead", "machine": machine(load), "rows": rows, "added_percent": added}
    text = json.dumps(result, indent=1)
    print(text)
    if options.out:
        options.out.write_text(text + "\n")


main()
