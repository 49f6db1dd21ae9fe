#!/usr/bin/env python3
"""The quickstart as it is, with one set of programs after another, by turns.

    quickstart_turns.py LABEL=FOLDER [LABEL=FOLDER ...] [--rounds 2] [--secs 15] [--record]
                        [--launch FILE] [--json FILE]

Each FOLDER holds `gantry`, `simd`, `gantry-drive`, `gantry-view` and, for --record,
`gantry-record`; the last one also `gantry-bench`, which does the counting. Each turn starts the
quickstart with a viewer that writes a file (--record: and the recorder), lets it drive for four
seconds, and prints what a tick costs the processors, process by process and, where the programs
count stages, stage by stage.

Four turns of 15 s take two minutes. Nothing else should run.
"""

import argparse
import json
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time

WARM_UP_SECS = 4
START_SECS = 90
END_SECS = 60


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("folders", nargs="+", metavar="LABEL=FOLDER")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--secs", type=int, default=15)
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--launch", metavar="FILE")
    parser.add_argument("--json", metavar="FILE")
    args = parser.parse_args()
    folders = []
    for text in args.folders:
        label, found, folder = text.partition("=")
        if not found or not pathlib.Path(folder, "gantry").is_file():
            sys.exit(f"{text!r} is not LABEL=FOLDER with a folder that holds gantry")
        folders.append((label, pathlib.Path(folder).resolve()))
    bench = folders[-1][1] / "gantry-bench"
    rows, machine = [], None
    for turn in range(args.rounds):
        for label, folder in folders:
            report = one_turn(folder, bench, args)
            machine = machine or report["machine"]
            for process in report["processes"]:
                # Programs may add a number or a word behind their name.
                process["name"] = "-".join(process["name"].split("-")[:2])
            row = {
                "name": f"{label}, turn {turn + 1}",
                "real_time": report["simulated_secs"] / report["secs"],
                "ticks_per_sec": report["ticks_per_sec"],
                "cpu_ms": report["cpu_ms"],
                "processes": {process["name"]: process["cpu_ms"] for process in report["processes"]},
                "stages": {
                    f"{process['name']}: {stage['stage']}": stage["cpu_ms"]
                    for process in report["processes"]
                    for stage in process["stages"]
                },
            }
            rows.append(row)
            print_row(row)
    if args.json:
        machine["command"] = "quickstart_turns.py " + " ".join(sys.argv[1:])
        text = json.dumps({"bench": "quickstart_turns", "machine": machine, "rows": rows}, indent=2)
        pathlib.Path(args.json).write_text(text + "\n")


def one_turn(folder, bench, args):
    """Starts the quickstart, counts, ends it; returns what gantry-bench counted."""
    domain = f"turns{os.getpid()}"
    with tempfile.TemporaryDirectory(prefix="quickstart_turns") as scratch:
        command = [str(folder / "gantry"), "up", "--domain", domain, "--data", scratch]
        command += ["--view", f"save:{scratch}/view.rrd"]
        command += ["--record", f"{scratch}/drive.mcap"] if args.record else []
        command += [args.launch] if args.launch else []
        log = pathlib.Path(scratch, "log.txt")
        with log.open("w") as out:
            running = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)
        try:
            wait_until_up(running, log)
            time.sleep(WARM_UP_SECS)
            counted = pathlib.Path(scratch, "tick.json")
            subprocess.run(
                [bench, "--domain", domain, "tick", "--profile", "--for", f"{args.secs}s"]
                + ["--json", str(counted)],
                check=True,
                stdout=subprocess.DEVNULL,
            )
            return json.loads(counted.read_text())
        finally:
            running.send_signal(signal.SIGINT)
            try:
                running.wait(END_SECS)
            except subprocess.TimeoutExpired:
                running.kill()


def wait_until_up(running, log):
    """Waits until all processes run."""
    end = time.monotonic() + START_SECS
    while "processes are up" not in log.read_text():
        if running.poll() is not None or time.monotonic() > end:
            sys.exit(f"the quickstart did not start:\n{log.read_text()}")
        time.sleep(0.2)


def print_row(row):
    processes = ", ".join(f"{name} {cpu:.1f}" for name, cpu in row["processes"].items())
    print(f"{row['name']}: {row['real_time']:.2f} x real time, {row['cpu_ms']:.1f} ms ({processes})")
    for stage, cpu in sorted(row["stages"].items(), key=lambda item: -item[1]):
        if cpu >= 0.05:
            print(f"    {stage:28} {cpu:7.2f}")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
