#!/usr/bin/env python3
"""Runs routes of CARLA's leaderboard (1.0, 2.0, 2.1) or of Bench2Drive against Gantry, unattended, with the evaluator's NPC agent.

    git clone --branch leaderboard-2.0 https://github.com/carla-simulator/leaderboard
    git clone --branch leaderboard-2.0 https://github.com/carla-simulator/scenario_runner     # Bench2Drive brings its own
    python -m venv env && env/bin/pip install -r leaderboard/requirements.txt -r scenario_runner/requirements.txt carla==0.9.16
    tests/foreign/leaderboard.py leaderboard --runner scenario_runner --routes ROUTES.xml --python env/bin/python \\
        --agents CARLA/PythonAPI/carla --data DATA --times 2

DATA/maps has CARLA's `Town*.xodr` (`gantry map import --data DATA`); routes on other towns are left out. Servers are those of a folder
that `gantry carla-root` makes; Bench2Drive starts them itself. With --times 2 the verdicts of both runs are compared, without times of
the clock. Exit code 1 if the evaluator crashed, a route has no verdict, or two runs differ.
"""

import argparse
import json
import os
import pathlib
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree

REPOSITORY = pathlib.Path(__file__).resolve().parent.parent.parent

# What the evaluators expect of their time: Python before 3.9, and for 1.0 CARLA 0.9.10's agents and names of maps.
BOOT = """
import runpy, sys, types
sys.modules['_elementtree'] = None
import xml.etree.ElementTree as tree
tree.Element.getchildren = lambda self: list(self)
if {old}:
    import carla
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
    parser.add_argument("--port", type=int, default=2000, help="RPC port of the server")
    parser.add_argument("--manager-port", type=int, default=8000, help="port of the Traffic Manager")
    parser.add_argument("--times", type=int, default=1, help="how often all of it is run")
    parser.add_argument("--limit", type=float, default=900.0, metavar="SECONDS", help="longest time per route, wall clock")
    return parser.parse_args()


def chosen_routes(given):
    """Writes the wanted routes into a file of their own, and returns it with their number."""
    tree = ElementTree.parse(given.routes)
    root = tree.getroot()
    towns = {path.stem for path in (given.data / "maps").glob("*.xodr")}
    for route in list(root):
        wanted = route.get("id") in given.only if given.only else route.get("town") in towns
        if not wanted:
            root.remove(route)
    path = given.out / "routes.xml"
    tree.write(path)
    return path.resolve(), len(root)


class Evaluator:
    """One of the three evaluators."""

    def __init__(self, given):
        self.given = given
        inner = given.folder / "leaderboard"
        self.starts_servers = (inner / "leaderboard/leaderboard_evaluator.py").is_file()
        self.root = (inner if self.starts_servers else given.folder).resolve()
        self.runner = (given.folder / "scenario_runner" if self.starts_servers else given.runner).resolve()
        self.is_old = given.scenarios is not None

    def command(self, routes, checkpoint):
        given = self.given
        program = str(self.root / "leaderboard/leaderboard_evaluator.py")
        agent = str(self.root / "leaderboard/autoagents/npc_agent.py")
        flags = {"routes": routes, "repetitions": 1, "track": "SENSORS", "checkpoint": checkpoint, "agent": agent, "debug": 0, "resume": "", "record": "", "port": given.port, "timeout": 120}
        if self.is_old:
            flags |= {"trafficManagerPort": given.manager_port, "scenarios": given.scenarios.resolve()}
        else:
            flags |= {"traffic-manager-port": given.manager_port, "agent-config": "none"}
        if self.starts_servers:
            flags |= {"gpu-rank": 0}
        return [given.python, "-c", BOOT.format(old=self.is_old), program, *(f"--{name}={value}" for name, value in flags.items())]

    def environment(self, carla_root):
        folders = [self.given.agents.resolve(), self.root, self.runner]
        own = {
            "CARLA_ROOT": carla_root, "PYTHONPATH": os.pathsep.join(map(str, folders)), "SCENARIO_RUNNER_ROOT": self.runner,
            "LEADERBOARD_ROOT": self.root, "IS_BENCH2DRIVE": "True", "SAVE_PATH": self.given.out.resolve(), "SDL_VIDEODRIVER": "dummy",
        }
        return os.environ | {name: str(value) for name, value in own.items()}


def start_server(carla_root, given, log):
    server = subprocess.Popen([carla_root / "CarlaUE4.sh", f"-carla-rpc-port={given.port}"], stdout=log, stderr=log, start_new_session=True)
    # The evaluators' own servers are given 30 s in the same way.
    time.sleep(30.0)
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


def run_once(evaluator, carla_root, routes, n_routes, number):
    """Runs all routes once and returns the evaluator's records."""
    given = evaluator.given
    checkpoint = (given.out / f"results{number}.json").resolve()
    checkpoint.unlink(missing_ok=True)
    with open(given.out / f"log{number}.txt", "w") as log:
        server = None if evaluator.starts_servers else start_server(carla_root, given, log)
        folder = evaluator.root.parent if evaluator.starts_servers else given.out
        program = subprocess.Popen(evaluator.command(routes, checkpoint), cwd=folder, env=evaluator.environment(carla_root), stdout=log, stderr=log, start_new_session=True)
        try:
            program.wait(given.limit * n_routes)
        except subprocess.TimeoutExpired:
            print(f"the evaluator did not end within {given.limit:.0f} s per route", flush=True)
        finally:
            # Python runs no exit handlers after a kill, so the evaluator's own servers are killed here.
            kill_groups([*sessions_below(program.pid), program.pid])
            program.wait()
            if server:
                kill_groups([server.pid])
                server.wait()
    records = json.loads(checkpoint.read_text())["_checkpoint"]["records"] if checkpoint.exists() else []
    return records


def verdict(record):
    """What does not depend on the clock. Ids of actors count on from route to route, so they are equal too."""
    return record["status"], record["scores"], {kind: found for kind, found in record["infractions"].items() if found}


def main():
    given = arguments()
    given.out.mkdir(parents=True, exist_ok=True)
    carla_root = (given.out / "carla").resolve()
    made = [given.bin.resolve() / "gantry", "carla-root", carla_root, "--data", given.data.resolve()]
    subprocess.run(made, check=True, stdout=subprocess.DEVNULL)
    routes, n_routes = chosen_routes(given)
    print(f"{n_routes} routes, {given.times} times", flush=True)
    evaluator = Evaluator(given)
    runs = [run_once(evaluator, carla_root, routes, n_routes, number) for number in range(given.times)]
    for record in runs[0]:
        seconds = record["meta"]
        print(
            f"| {record['route_id']} | {record.get('town_name', '')} | {record.get('scenario_name', '')} | {record['status']} | {record['scores']['score_route']:.0f} % "
            f"| {record['scores']['score_composed']:.0f} | {seconds.get('duration_game', 0):.0f} s in {seconds.get('duration_system', 0):.0f} s |"
        )
    wrong = [f"run {number} has {len(run)} of {n_routes} verdicts" for number, run in enumerate(runs) if len(run) != n_routes]
    wrong += [f"{record['route_id']}: {record['status']}" for run in runs for record in run if "crashed" in record["status"]]
    for number, run in enumerate(runs[1:], 1):
        wrong += [f"{a['route_id']} differs in run {number}" for a, b in zip(runs[0], run) if verdict(a) != verdict(b)]
    print("\n".join(wrong) or "every route has a verdict" + (", the same each time" if given.times > 1 else ""))
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
