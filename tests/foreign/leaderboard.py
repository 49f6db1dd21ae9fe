#!/usr/bin/env python3
"""Runs routes of CARLA's leaderboard (1.0, 2.0, 2.1) or of Bench2Drive against Gantry, unattended.

    git clone --branch leaderboard-2.0 https://github.com/carla-simulator/leaderboard
    git clone --branch leaderboard-2.0 https://github.com/carla-simulator/scenario_runner     # Bench2Drive brings its own
    python -m venv env && env/bin/pip install -r leaderboard/requirements.txt -r scenario_runner/requirements.txt carla==0.9.16
    tests/foreign/leaderboard.py leaderboard --runner scenario_runner --routes ROUTES.xml --python env/bin/python \\
        --agents CARLA/PythonAPI/carla --data DATA --times 3 --jobs 8

DATA/maps has CARLA's `Town*.xodr` (`gantry map import --data DATA`); routes on other towns are left out. Servers are those of a folder
that `gantry carla-root` makes; Bench2Drive starts them itself. Every evaluator gets --chunk routes and a server of its own, and --jobs
of them run side by side. With --times 2 or more the verdicts of a route's runs are compared, without times of the clock. Exit code 1 if
an evaluator crashed, a route has no verdict, or two runs differ.
"""

import argparse
import collections
import concurrent.futures
import json
import os
import pathlib
import queue
import signal
import socket
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree

REPOSITORY = pathlib.Path(__file__).resolve().parent.parent.parent

# What the evaluators expect of their time: Python before 3.9, and for 1.0 CARLA 0.9.10's agents and names of maps. Their pause of
# 30 s for a server to start ends as soon as its port answers. CARLA's route planner divides by the length of each lane: those of no
# length, as early public files of Town03 and Town05 have, are left out of the topology; both their ends are one node of its graph.
# ControlLoss draws its noise from numpy's own generator, to which nobody gives a seed.
BOOT = """
import runpy, socket, sys, time, types
def until_answered(secs, pause=time.sleep):
    end = time.monotonic() + secs
    while secs >= 30 and time.monotonic() < end:
        try:
            return socket.create_connection(('127.0.0.1', {port}), 1).close()
        except OSError:
            pause(0.2)
    pause(max(0.0, end - time.monotonic()))
time.sleep = until_answered
import carla, numpy
numpy.random.seed(0)
topology = carla.Map.get_topology
carla.Map.get_topology = lambda self: [
    (a, b) for a, b in topology(self) if a.transform.location.distance(b.transform.location) > 1e-5]
sys.modules['_elementtree'] = None
import xml.etree.ElementTree as tree
tree.Element.getchildren = lambda self: list(self)
tree.Element.items = lambda self: list(self.attrib.items())
if {old}:
    name = carla.Map.name
    carla.Map.name = property(lambda self: name.fget(self).rsplit('/', 1)[-1])
    from agents.navigation import basic_agent, global_route_planner
    planner, begin = global_route_planner.GlobalRoutePlanner, global_route_planner.GlobalRoutePlanner.__init__
    access = types.ModuleType('agents.navigation.global_route_planner_dao')
    access.GlobalRoutePlannerDAO = lambda world_map, step=1.0: (world_map, step)
    sys.modules[access.__name__] = access
    planner.__init__ = lambda self, given, step=2.0: begin(self, *(given if isinstance(given, tuple) else (given, step)))
    planner.setup = lambda self: None
    basic_agent.BasicAgent._trace_route = basic_agent.BasicAgent.trace_route
sys.argv = sys.argv[1:]
sys.path.insert(0, __import__('os').path.dirname(sys.argv[0]))
runpy.run_path(sys.argv[0], run_name='__main__')
"""


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path, help="leaderboard or Bench2Drive, as cloned")
    parser.add_argument("--runner", type=pathlib.Path, help="scenario_runner of the same branch (Bench2Drive brings its own)")
    parser.add_argument("--routes", type=pathlib.Path, required=True, help="XML file with routes")
    parser.add_argument("--scenarios", type=pathlib.Path, help="leaderboard 1.0: JSON file with the scenarios' places")
    parser.add_argument("--only", nargs="*", default=[], metavar="ID", help="ids of routes [default: all on towns of DATA/maps]")
    parser.add_argument("--python", default=sys.executable, help="interpreter with the requirements of both")
    parser.add_argument("--agents", type=pathlib.Path, required=True, help="folder that contains CARLA's package agents")
    parser.add_argument("--data", type=pathlib.Path, required=True, help="data folder, whose maps/ has CARLA's Town*.xodr")
    parser.add_argument("--bin", type=pathlib.Path, default=REPOSITORY / "target/release", help="folder with Gantry's programs")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("leaderboard_out"), help="results and logs")
    parser.add_argument("--agent", type=pathlib.Path, help="agent to evaluate [default: the evaluator's npc_agent.py]")
    parser.add_argument("--port", type=int, default=2000, help="RPC port of the first server; the next ones are 10 apart")
    parser.add_argument("--manager-port", type=int, default=8000, help="port of the first Traffic Manager, likewise")
    parser.add_argument("--times", type=int, default=1, help="how often all of it is run")
    parser.add_argument("--jobs", type=int, default=1, help="evaluators side by side")
    parser.add_argument("--chunk", type=int, metavar="ROUTES", help="routes per evaluator and server [default: all, with --jobs 1]")
    parser.add_argument("--gpus", type=int, default=1, help="graphics adapters over which servers are spread")
    parser.add_argument("--deadline", type=float, metavar="SECONDS", help="no route runs longer than until then, wall clock")
    parser.add_argument("--limit", type=float, default=900.0, metavar="SECONDS", help="longest time per route, wall clock")
    parser.add_argument("--json", type=pathlib.Path, metavar="FILE", help="every run's verdict, scores and infractions")
    return parser.parse_args()


def chosen_routes(given):
    """The wanted routes, as XML elements."""
    towns = {path.stem for path in (given.data / "maps").glob("*.xodr")}
    routes = ElementTree.parse(given.routes).getroot()
    return [route for route in routes if (route.get("id") in given.only if given.only else route.get("town") in towns)]


class Evaluator:
    """One of the three evaluators."""

    def __init__(self, given):
        self.given = given
        inner = given.folder / "leaderboard"
        self.starts_servers = (inner / "leaderboard/leaderboard_evaluator.py").is_file()
        self.root = (inner if self.starts_servers else given.folder).resolve()
        self.runner = (given.folder / "scenario_runner" if self.starts_servers else given.runner).resolve()
        self.is_old = given.scenarios is not None

    def command(self, routes, checkpoint, slot):
        given = self.given
        program = str(self.root / "leaderboard/leaderboard_evaluator.py")
        agent = str((given.agent or self.root / "leaderboard/autoagents/npc_agent.py").resolve())
        port, manager_port = given.port + 10 * slot, given.manager_port + 10 * slot
        flags = {"routes": routes, "repetitions": 1, "track": "SENSORS", "checkpoint": checkpoint, "agent": agent, "debug": 0, "resume": "", "record": "", "port": port, "timeout": 120}
        if self.is_old:
            flags |= {"trafficManagerPort": manager_port, "scenarios": given.scenarios.resolve()}
        else:
            flags |= {"traffic-manager-port": manager_port, "agent-config": "none"}
        if self.starts_servers:
            flags |= {"gpu-rank": slot % given.gpus, "debug-checkpoint": f"{checkpoint}.live"}
        return [str(pathlib.Path(given.python).absolute()), "-c", BOOT.format(old=self.is_old, port=port), program, *(f"--{name}={value}" for name, value in flags.items())]

    def environment(self, carla_root):
        folders = [self.given.agents.resolve(), self.root, self.runner]
        own = {
            "CARLA_ROOT": carla_root, "PYTHONPATH": os.pathsep.join(map(str, folders)), "SCENARIO_RUNNER_ROOT": self.runner,
            "LEADERBOARD_ROOT": self.root, "IS_BENCH2DRIVE": "True", "SAVE_PATH": self.given.out.resolve(), "SDL_VIDEODRIVER": "dummy",
        }
        return os.environ | {name: str(value) for name, value in own.items()}


def start_server(carla_root, port, log):
    server = subprocess.Popen([carla_root / "CarlaUE4.sh", f"-carla-rpc-port={port}"], stdout=log, stderr=log, start_new_session=True)
    end = time.monotonic() + 90.0
    while time.monotonic() < end:
        try:
            socket.create_connection(("127.0.0.1", port), 1).close()
            break
        except OSError:
            time.sleep(0.2)
    return server


def sessions_below(pid):
    """Process groups that children of a process lead: Bench2Drive's servers."""
    found = []
    for path in pathlib.Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == pid and fields[2] == path.parent.name:
            found.append(int(fields[2]))
    return found


def kill_groups(groups):
    for group in groups:
        try:
            os.killpg(group, signal.SIGKILL)
        except ProcessLookupError:
            pass


class Runs:
    """All runs of all routes: `found[(route, time)]` is the evaluator's record, or None if it left none."""

    def __init__(self, given, routes):
        self.given, self.routes, self.found = given, routes, {}
        self.evaluator = Evaluator(given)
        self.carla_root = (given.out / "carla").resolve()
        made = [given.bin.resolve() / "gantry", "carla-root", self.carla_root, "--data", given.data.resolve()]
        subprocess.run(made, check=True, stdout=subprocess.DEVNULL)
        self.end = time.monotonic() + given.deadline if given.deadline else float("inf")
        self.slots = queue.SimpleQueue()
        for slot in range(given.jobs):
            self.slots.put(slot)

    def run(self):
        n = self.given.chunk or -(-len(self.routes) // self.given.jobs)
        chunks = [(number, self.routes[at:at + n]) for number in range(self.given.times) for at in range(0, len(self.routes), n)]
        with concurrent.futures.ThreadPoolExecutor(self.given.jobs) as pool:
            for done in [pool.submit(self.run_chunk, *chunk) for chunk in chunks]:
                done.result()

    def run_chunk(self, number, routes):
        """Runs routes with one evaluator after the other: one that stops leaves the rest to the next."""
        slot = self.slots.get()
        try:
            while routes and time.monotonic() < self.end:
                records = {record["route_id"].split("_")[1]: record for record in self.run_evaluator(number, routes, slot)}
                if not records and time.monotonic() < self.end:
                    self.note(routes[0], number, None)
                    records = {routes[0].get("id"): None}
                for route in routes:
                    if records.get(route.get("id")):
                        self.note(route, number, records[route.get("id")])
                routes = [route for route in routes if route.get("id") not in records]
        finally:
            self.slots.put(slot)

    def note(self, route, number, record):
        self.found[route.get("id"), number] = record
        print(f"{route.get('id')} run {number}: {record['status'] if record else 'no verdict'}", flush=True)

    def run_evaluator(self, number, routes, slot):
        """The records that an evaluator leaves of these routes."""
        given, evaluator = self.given, self.evaluator
        name = f"{routes[0].get('id')}_{number}"
        tree = ElementTree.Element("routes")
        tree.extend(routes)
        file = (given.out / f"{name}.xml").resolve()
        ElementTree.ElementTree(tree).write(file)
        checkpoint = (given.out / f"{name}.json").resolve()
        checkpoint.unlink(missing_ok=True)
        with open(given.out / f"{name}.log", "w") as log:
            server = None if evaluator.starts_servers else start_server(self.carla_root, given.port + 10 * slot, log)
            folder = evaluator.root.parent if evaluator.starts_servers else given.out
            program = subprocess.Popen(evaluator.command(file, checkpoint, slot), cwd=folder, env=evaluator.environment(self.carla_root), stdout=log, stderr=log, start_new_session=True)
            try:
                program.wait(max(0.0, min(given.limit * len(routes), self.end - time.monotonic())))
            except subprocess.TimeoutExpired:
                print(f"{name}: the evaluator did not end in its time", flush=True)
            finally:
                # Python runs no exit handlers after a kill, so the evaluator's own servers are killed here.
                kill_groups([*sessions_below(program.pid), program.pid])
                program.wait()
                if server:
                    kill_groups([server.pid])
                    server.wait()
        return json.loads(checkpoint.read_text())["_checkpoint"]["records"] if checkpoint.exists() else []


def verdict(record):
    """What does not depend on the clock."""
    return record["status"], record["scores"], {kind: found for kind, found in record["infractions"].items() if found}


def described(route, records):
    """A row of the table, and what is wrong with the runs of a route."""
    kind = next((scenario.get("type") for scenario in route.iter("scenario")), "")
    name = route.get("id")
    known = [record for record in records if record]
    if not known:
        return f"| {name} | {route.get('town')} | {kind} | no verdict | | | 0 | |", [f"{name}: no verdict"]
    equal = all(verdict(record) == verdict(known[0]) for record in known)
    wrong = [f"{name}: no verdict of {len(records) - len(known)} runs"] if len(known) < len(records) else []
    wrong += [f"{name}: {record['status']}" for record in known if "rashed" in record["status"] or "imulation" in record["status"]]
    wrong += [] if equal else [f"{name}: runs differ: " + "; ".join(f"{r['status']} {r['scores']['score_composed']:.1f}" for r in known)]
    first, clock = known[0], [record["meta"].get("duration_system", 0) for record in known]
    events = {kind: len(found) for kind, found in first["infractions"].items() if found and kind not in ("min_speed_infractions",)}
    said = first["status"] + ("; " + ", ".join(f"{kind} {n}" for kind, n in events.items()) if events else "")
    scores = first["scores"]
    return (
        f"| {name} | {route.get('town')} | {kind} | {said} | {scores['score_route']:.0f} % | {scores['score_composed']:.0f} "
        f"| {len(known)}{'' if len(known) == 1 else ' equal' if equal else ' DIFFER'} | {first['meta'].get('duration_game', 0):.0f} s in {sum(clock) / len(clock):.0f} s |"
    ), wrong


def kept(given, runs, routes, secs, load):
    """Every run as one row, with the machine and its load when they began."""
    rows = []
    for route in routes:
        kind = next((scenario.get("type") for scenario in route.iter("scenario")), "")
        for number in range(given.times):
            record = runs.found.get((route.get("id"), number))
            row = {"route": route.get("id"), "town": route.get("town"), "scenario": kind, "run": number, "status": record["status"] if record else "no verdict"}
            if record:
                status, scores, infractions = verdict(record)
                counts = {name: len(found) for name, found in infractions.items()}
                row |= {"status": status, **scores, "infractions": counts, "simulated_secs": record["meta"].get("duration_game", 0), "secs": record["meta"].get("duration_system", 0)}
            if (route.get("id"), number) in runs.found:
                rows.append(row)
    cpu = next((line.partition(":")[2].strip() for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")), "")
    commit = subprocess.run(["git", "-C", REPOSITORY, "rev-parse", "--short=8", "HEAD"], capture_output=True, text=True).stdout.strip()
    command = " ".join(["leaderboard.py", *(word if not pathlib.Path(word).is_absolute() else pathlib.Path(word).name for word in sys.argv[1:])])
    machine = {"cpu": cpu, "n_cores": os.cpu_count(), "load_1min": load, "date": time.strftime("%Y-%m-%d", time.gmtime()), "commit": commit, "command": command}
    return {"bench": "evaluator", "machine": machine, "side_by_side": given.jobs, "gpus": given.gpus, "secs": round(secs, 1), "agent": given.agent.stem if given.agent else "npc_agent", "rows": rows}


def main():
    given = arguments()
    given.out.mkdir(parents=True, exist_ok=True)
    routes = chosen_routes(given)
    print(f"{len(routes)} routes, {given.times} times", flush=True)
    begin, load = time.monotonic(), f"{os.getloadavg()[0]:.1f}"
    runs = Runs(given, routes)
    runs.run()
    rows, wrong = [], []
    for route in routes:
        records = [runs.found[route.get("id"), number] for number in range(given.times) if (route.get("id"), number) in runs.found]
        if records:
            row, faults = described(route, records)
            rows.append(row)
            wrong += faults
    head = ["| Route | Town | Scenario | Verdict | Route | Score | Runs | Simulated, in |", "|---|---|---|---|---|---|---|---|"]
    (given.out / "table.md").write_text("\n".join([*head, *rows, ""]))
    if given.json:
        # One run per line, so that a diff shows what became of which.
        head, _, rest = json.dumps(kept(given, runs, routes, time.monotonic() - begin, load)).partition('"rows": [')
        given.json.write_text(head + '"rows": [\n' + rest.replace('}, {"route"', '},\n{"route"') + "\n")
    statuses = collections.Counter(record["status"] if record else "no verdict" for record in runs.found.values())
    print("\n".join([*rows, *wrong]))
    print(f"{len(runs.found)} runs of {len(rows)} routes in {time.monotonic() - begin:.0f} s: " + ", ".join(f"{n} {status}" for status, n in statuses.most_common()))
    left = len(routes) * given.times - len(runs.found)
    if left:
        print(f"{left} runs were not begun or not ended at the deadline")
    return bool(wrong or left)


if __name__ == "__main__":
    sys.exit(main())
