#!/usr/bin/env python3
"""Runs a tutorial script that drives one car again and again, and counts the runs in which the car moves.

    git clone https://github.com/wuhanstudio/carla-tutorial
    tests/foreign/tutorial_drives.py carla-tutorial/02_sync_mode.py --times 100 --port 2000

A simulator and its gateway run already. The script is unmodified and gets a process of its own each time; the car's red lights are
waited for. It ends by Ctrl-C, as its reader ends it. Exit code 1 if a car stood still or a script ended by itself.
"""

import argparse
import collections
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time

import carla

# The port of the server is written in the script, and so is the Traffic Manager's, unsaid.
BOOT = """
import runpy, sys, carla
connect, drive = carla.Client, carla.Vehicle.set_autopilot
carla.Client = lambda host, port, *more: connect('127.0.0.1', {port}, *more)
carla.Vehicle.set_autopilot = lambda self, enabled=True, port={manager}: drive(self, enabled, port)
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name='__main__')
"""


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("script", type=pathlib.Path)
    parser.add_argument("--python", default=sys.executable)
    parser.add_argument("--port", type=int, default=2000, help="RPC port of the gateway")
    parser.add_argument("--manager-port", type=int, default=8000)
    parser.add_argument("--times", type=int, default=100)
    parser.add_argument("--moved", type=float, default=1.0, metavar="METRES", help="a car that has come this far moves")
    parser.add_argument("--limit", type=float, default=60.0, metavar="SECONDS", help="longest wait for that")
    return parser.parse_args()


def watch(world, process, given):
    """What became of one run."""
    end, start = time.monotonic() + given.limit, {}
    while time.monotonic() < end:
        if process.poll() is not None:
            return f"ended by itself, {process.returncode}"
        for actor in world.get_snapshot():
            at = actor.get_transform().location
            car = world.get_actor(actor.id) if actor.id not in start else None
            if car is not None:
                start[actor.id] = at if car.type_id.startswith("vehicle.") else None
            # A new car falls a little onto its wheels.
            if start.get(actor.id) and at.distance_2d(start[actor.id]) > given.moved:
                return "moved"
        time.sleep(0.1)
    return "stood"


def main():
    given = arguments()
    client = carla.Client("127.0.0.1", given.port)
    client.set_timeout(30.0)
    boot = BOOT.format(port=given.port, manager=given.manager_port)
    counts, begin = collections.Counter(), time.monotonic()
    for number in range(given.times):
        with tempfile.TemporaryFile() as log:
            process = subprocess.Popen([given.python, "-c", boot, str(given.script)], stdout=log, stderr=log, start_new_session=True)
            verdict = watch(client.get_world(), process, given)
            process.send_signal(signal.SIGINT)
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                verdict += ", and did not end on Ctrl-C"
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            if verdict != "moved":
                log.seek(0)
                print(f"run {number}: {verdict}\n{log.read().decode(errors='replace')[-2000:]}", flush=True)
        counts[verdict] += 1
        for car in client.get_world().get_actors().filter("vehicle.*"):
            car.destroy()
    print(f"{given.times} runs in {time.monotonic() - begin:.0f} s: " + ", ".join(f"{n} {what}" for what, n in counts.most_common()))
    return counts["moved"] != given.times


if __name__ == "__main__":
    sys.exit(main())
