#!/usr/bin/env python3
"""What building costs, as `./gantry bench build` measures it: seconds on the clock, and seconds of
processors, which neighbours on the machine do not change.

    ./gantry bench build                 after one changed line: to a running daemon; a check of a leaf crate
    ./gantry bench build --cold FOLDER   from nothing into an empty target folder, in the stages of ./gantry up

Every figure is of commands that a user types. A changed line is a new public function at the end of a
crate's root, which is taken away again.
"""

import argparse
import contextlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CARGO = ["cargo", "build", "--release", "--workspace", "--quiet"]
CHECK = ["cargo", "check", "--release", "--workspace", "--quiet"]
# A sensor's crate, on which the daemon depends, and a crate on which nothing depends.
SENSOR = ROOT / "sensors" / "sensor_camera" / "src" / "lib.rs"
LEAF = ROOT / "consumers" / "consumer_rerun" / "src" / "lib.rs"
# The stages of a first `./gantry up`, and what `./gantry build` adds.
STAGES = [
    ("the world runs", ["--bin=simd", "--bin=gantry", "--bin=gantry-drive"]),
    ("its viewer joins", ["--bin=gantry-view"]),
    ("every program and the Python module", ["--exclude=test_*"]),
]
LAUNCH = """version = 1
[scenario]
map = "Town01"
[ego]
[sensor.front]
kind = "camera"
modalities = ["rgb"]
width_px = 160
height_px = 120
[process.simd]
cmd = ["simd"]
"""


def timed(words, env=None):
    """Runs a command; returns its seconds on the clock, and those of all processors."""
    before, began = os.times(), time.monotonic()
    subprocess.run(words, cwd=ROOT, env=env, check=True)
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return round(time.monotonic() - began, 2), round(cpu, 2)


@contextlib.contextmanager
def one_line_more(file, number):
    """The file with one more function, for as long as the block lasts."""
    text = file.read_text()
    name = f"build_times_{number}"
    line = f"/// A changed line.\n#[doc(hidden)]\n#[allow(dead_code)]\npub fn {name}() -> u32 {{ {number} }}\n"
    try:
        file.write_text(text + line)
        yield
    finally:
        file.write_text(text)


def seconds_to_ready(target, folder):
    """Starts the daemon and stops it once it has said that it is ready."""
    file = folder / "build_times.toml"
    file.write_text(LAUNCH)
    began = time.monotonic()
    words = [target / "release" / "simd", "--launch", file, "--domain", f"build-{os.getpid()}", "--data", folder]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as daemon:
        said = []
        for line in daemon.stdout:
            said.append(line)
            if " ready" in line:
                break
        else:
            sys.exit("error: the daemon ended before it was ready:\n" + "".join(said))
        found = time.monotonic() - began
        daemon.terminate()
        daemon.stdout.read()
    return round(found, 2)


def incremental(target, repeats):
    """After one changed line: the daemon that runs again, and a check."""
    folder = target / "build_times"
    folder.mkdir(parents=True, exist_ok=True)
    simd, leaf = [*CARGO, "--bin=simd"], [*CHECK, "--bin=gantry-rerun"]
    timed(simd), timed(leaf)
    runs = []
    for number in range(repeats):
        with one_line_more(SENSOR, number):
            wall, cpu = timed(simd)
            ready = seconds_to_ready(target, folder)
        with one_line_more(LEAF, number):
            check_wall, check_cpu = timed(leaf)
        runs.append({"build_s": wall, "build_cpu_s": cpu, "ready_s": ready, "running_s": round(wall + ready, 2), "check_s": check_wall, "check_cpu_s": check_cpu})
        print(
            f"one line in sensor_camera: daemon ready after {wall + ready:.1f} s (built in {wall:.1f} s, {cpu:.1f} s of processors); "
            f"check of consumer_rerun: {check_wall:.1f} s ({check_cpu:.1f} s)",
            flush=True,
        )
    return runs


def cold(target):
    """A build from nothing, stage by stage, with the processors' seconds of every crate."""
    if target.exists() and any(target.iterdir()):
        sys.exit(f"error: {target} is not empty; name a new folder")
    target.mkdir(parents=True, exist_ok=True)
    log = target / "crates.tsv"
    env = {**os.environ, "CARGO_TARGET_DIR": str(target), "RUSTC_WRAPPER": str(Path(__file__).resolve()), "GANTRY_BUILD_TIMES": str(log)}
    stages = []
    for name, words in STAGES:
        wall, cpu = timed([*CARGO, *words], env)
        stages.append({"stage": name, "wall_s": wall, "cpu_s": cpu})
        print(f"{name}: {wall:.0f} s, {cpu:.0f} s of processors", flush=True)
    crates = [line.split("\t") for line in log.read_text().splitlines()]
    slowest = sorted(((float(cpu), name) for cpu, name in crates), reverse=True)
    return {"stages": stages, "n_compiled": len(crates), "slowest": [{"crate": name, "cpu_s": cpu} for cpu, name in slowest[:40]]}


def wrapped(words):
    """In rustc's place: runs it, and notes the processors' seconds of the crate."""
    code = subprocess.run(words, check=False).returncode
    spent = os.times()
    name = f"{os.environ.get('CARGO_PKG_NAME', '?')} {os.environ.get('CARGO_PKG_VERSION', '')}".strip()
    if "CARGO_PKG_NAME" in os.environ:
        with open(os.environ["GANTRY_BUILD_TIMES"], "a", encoding="utf-8") as log:
            log.write(f"{spent.children_user + spent.children_system:.2f}\t{name}\n")
    return code


def machine():
    """What it was measured on."""
    info = Path("/proc/cpuinfo").read_text().splitlines()
    model = next((line.split(": ")[1] for line in info if line.startswith("model name")), "unknown")
    commit = subprocess.run(["git", "describe", "--always", "--dirty", "--abbrev=10"], cwd=ROOT, capture_output=True, text=True, check=False)
    compiler = subprocess.run(["rustc", "--version"], cwd=ROOT, capture_output=True, text=True, check=False)
    return {
        "cpu": model,
        "n_cores": len(os.sched_getaffinity(0)),
        "kernel": os.uname().release,
        "load_1min": f"{os.getloadavg()[0]:.1f}",
        "date": time.strftime("%Y-%m-%d"),
        "commit": commit.stdout.strip() or "unknown",
        "compiler": compiler.stdout.strip(),
        "command": " ".join(["./gantry", "bench", "build", *sys.argv[1:]]),
    }


def main():
    parser = argparse.ArgumentParser(prog="./gantry bench build", description=__doc__.split("\n\n")[0], epilog="Examples:\n  ./gantry bench build --json docs/benchmarks/raw/cpu_build.json\n  ./gantry bench build --cold /tmp/cold", formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cold", type=Path, metavar="FOLDER", help="build everything from nothing into this empty folder")
    parser.add_argument("--repeats", type=int, default=3, metavar="N", help="changed lines [default: 3]")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures and the machine here too")
    args = parser.parse_args()
    if args.repeats < 1:
        parser.error(f"--repeats is {args.repeats}, but must be 1 or more")
    about = machine()
    print(f"{about['cpu']}, {about['n_cores']} cores, load {about['load_1min']}, commit {about['commit']}, {about['compiler']}", flush=True)
    target = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target").resolve()
    figures = {"cold": cold(args.cold.resolve())} if args.cold else {"incremental": incremental(target, args.repeats)}
    about["load_1min"] += f" to {os.getloadavg()[0]:.1f}"
    if args.json:
        args.json.write_text(json.dumps({"bench": "build", "machine": about, **figures}, indent=1) + "\n")


if __name__ == "__main__":
    if "GANTRY_BUILD_TIMES" in os.environ:
        sys.exit(wrapped(sys.argv[1:]))
    try:
        main()
    except subprocess.CalledProcessError as error:
        sys.exit(f"error: {' '.join(map(str, error.cmd))} failed")
    except KeyboardInterrupt:
        sys.exit(130)
