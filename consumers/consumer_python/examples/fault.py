"""Kills a program of this pipeline after some simulated time, to see what the others do.

docs/how-to/pipelines.md explains it. Parameters, as JSON in the last argument: `program` and `after_secs`.
"""

import json
import os
import pathlib
import signal
import sys

import gantry

params = json.loads(sys.argv[-1])
domain = os.environ.get("GANTRY_DOMAIN", "gantry")


def victims() -> list[int]:
    """Processes of this name on this domain, never others."""
    found = []
    for folder in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            name = (folder / "comm").read_text().strip()
            environment = (folder / "environ").read_bytes().split(b"\0")
        except OSError:
            continue  # it has ended, or is somebody else's
        if name == params["program"][:15] and f"GANTRY_DOMAIN={domain}".encode() in environment:
            found.append(int(folder.name))
    return found


while gantry.snapshot().sim_time < params["after_secs"]:
    pass
for pid in victims():
    print(f"kill -9 {pid} ({params['program']})", flush=True)
    os.kill(pid, signal.SIGKILL)
