#!/usr/bin/env python3
"""Runs every scenario of CARLA's scenario_runner against Gantry, unattended, and writes a table of verdicts.

    git clone --branch v0.9.16 https://github.com/carla-simulator/scenario_runner
    python -m venv env && env/bin/pip install -r scenario_runner/requirements.txt carla==0.9.16
    tests/foreign/scenario_runner.py scenario_runner --python env/bin/python --agents CARLA/PythonAPI/carla --maps MAPS --sync

MAPS is a folder with CARLA's `Town*.xodr` (scenarios name coordinates of those towns). One simulator and gateway of their own run per
call; they are started again if they end. Exit code 1 if a scenario crashed, hung or could not be loaded.
"""

import argparse
import collections
import glob
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ElementTree

HERE = pathlib.Path(__file__).resolve().parent
REPOSITORY = HERE.parent.parent
Verdict = collections.namedtuple("Verdict", "name kind town verdict reason game_secs wall_secs")


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path, help="scenario_runner, as cloned")
    parser.add_argument("--python", default=sys.executable, help="interpreter with scenario_runner's requirements")
    parser.add_argument("--agents", type=pathlib.Path, required=True, help="folder that contains CARLA's package agents")
    parser.add_argument("--maps", type=pathlib.Path, help="folder with CARLA's Town*.xodr; without it Gantry's own towns are used")
    parser.add_argument("--bin", type=pathlib.Path, default=REPOSITORY / "target/release", help="folder with simd and gantry-carla")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("scenario_runner_out"), help="logs and the table")
    parser.add_argument("--port", type=int, default=2000, help="RPC port of the gateway; streams are at the next one")
    parser.add_argument("--manager-port", type=int, default=8000, help="port of the Traffic Manager")
    parser.add_argument("--domain", default=f"foreign{os.getpid()}", help="name of the simulator on the bus")
    parser.add_argument("--sync", action="store_true", help="scenario_runner steps the world")
    parser.add_argument("--only", default="", help="regular expression of names")
    parser.add_argument("--one-per-type", action="store_true", help="only the first scenario of each type")
    parser.add_argument("--shard", default="0/1", metavar="K/N", help="every N-th scenario, beginning with the K-th (from 0)")
    parser.add_argument("--limit", type=float, default=240.0, metavar="SECONDS", help="longest time of a scenario, wall clock")
    return parser.parse_args()


def listed(folder):
    """(name, kind, town, arguments) of all scenarios: those of the XML files, then the OpenSCENARIO 1.0 and 2.0 files."""
    found = []
    examples = folder / "srunner/examples"
    for path in sorted(examples.glob("*.xml")):
        for one in ElementTree.parse(path).iter("scenario"):
            found.append((one.get("name"), one.get("type"), one.get("town"), ["--scenario", one.get("name")]))
    for path in sorted(examples.glob("*.xosc")):
        town = ElementTree.parse(path).find("RoadNetwork/LogicFile").get("filepath")
        found.append((path.name, "OpenSCENARIO 1.0", town, ["--openscenario", str(path.resolve())]))
    for path in sorted(examples.glob("*.osc")):
        found.append((path.name, "OpenSCENARIO 2.0", "", ["--openscenario2", str(path.relative_to(folder))]))
    return found


class Server:
    """The simulator and the gateway."""

    def __init__(self, args):
        self.args, self.processes = args, []
        self.data = pathlib.Path(tempfile.mkdtemp(prefix="gantry-foreign-"))
        (self.data / "maps").mkdir()
        for path in args.maps.glob("*.xodr") if args.maps else []:
            (self.data / "maps" / path.name).symlink_to(path.resolve())

    def start(self):
        self.stop()
        args = self.args
        common = ["--domain", args.domain, "--data", str(self.data), "--color", "never"]
        log = open(args.out / "server.log", "ab")
        commands = (
            [str(args.bin / "simd"), "--launch", str(REPOSITORY / "launch/carla.toml"), *common],
            [str(args.bin / "gantry-carla"), "--port", str(args.port), *common],
        )
        self.processes = [subprocess.Popen(command, stdout=log, stderr=log) for command in commands]
        # A busy machine is given time: simulator and gateway start side by side.
        probe = f"import carla; c = carla.Client('127.0.0.1', {args.port}); c.set_timeout(10); c.get_world()"
        end = time.monotonic() + 90.0
        while subprocess.run([args.python, "-c", probe], stdout=log, stderr=log).returncode:
            if not self.runs():
                sys.exit(f"the simulator or the gateway ended at its start; see {log.name}")
            if time.monotonic() > end:
                sys.exit(f"no answer from the gateway on port {args.port} within 90 s; see {log.name}")
            time.sleep(1.0)

    def runs(self):
        return bool(self.processes) and all(process.poll() is None for process in self.processes)

    def stop(self):
        for process in self.processes:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for process in self.processes:
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self.processes = []

    def end(self):
        self.stop()
        shutil.rmtree(self.data, ignore_errors=True)


def run(args, scenario):
    """Runs one scenario; its process and all that it starts are gone afterwards."""
    name, kind, town, own = scenario
    out = args.out / name
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    command = [args.python, str(HERE / "scenario_runner_driven.py"), str(args.folder), *own, "--reloadWorld", "--output", "--json",
               "--outputDir", str(out.resolve()), "--port", str(args.port), "--trafficManagerPort", str(args.manager_port), "--timeout", "60"]
    if args.sync:
        command.append("--sync")
    environment = dict(os.environ, PYTHONPATH=str(args.agents.resolve()), SDL_VIDEODRIVER="dummy", PYTHONFAULTHANDLER="1")
    begin = time.monotonic()
    with open(out / "log.txt", "wb") as log:
        process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, env=environment, cwd=args.folder, start_new_session=True)
        try:
            code = process.wait(args.limit)
        except subprocess.TimeoutExpired:
            code = None
        finally:
            # It leads a session of its own, so Ctrl-C does not reach it.
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
    wall_secs = time.monotonic() - begin
    text = (out / "log.txt").read_text(errors="replace")
    verdict, reason, game_secs = judged(out, text, code, args.limit)
    return Verdict(name, kind, town, verdict, reason, game_secs, wall_secs)


def judged(out, text, code, limit):
    """Verdict, reason and simulated seconds from what a run left."""
    game = re.search(r"Game Time\s*│\s*([\d.]+)s", text)
    game_secs = float(game.group(1)) if game else None
    found = re.search(r"Results of Scenario: .* ---- (\w+)", text)
    errors = [line.strip() for line in text.splitlines() if re.match(r"\s*(\w+\.)*\w*(Error|Exception)\b", line)]
    said = errors[-1] if errors else ""
    if code is None:
        return "hung", f"not over after {limit:.0f} s", game_secs
    if code < 0:
        return "crashed", f"signal {-code}" + (f"; {said}" if said else ""), game_secs
    if found:
        failed = []
        for path in glob.glob(str(out / "*.json")):
            report = json.loads(pathlib.Path(path).read_text())
            failed += [f"{c['name']} {c['actual']}" for c in report["criteria"] if not c["success"] and not c["optional"]]
        return found.group(1), "; ".join(dict.fromkeys(failed)), game_secs
    if "no criteria" in text and not errors:
        return "ended", "has no criteria", game_secs
    known = re.search(r"(.*(not supported|cannot be found|wrong map|not found|does not exist).*)", text)
    return "not run", said or (known.group(1).strip() if known else f"exit code {code}"), game_secs


def table(verdicts, sync):
    lines = ["| Scenario | Type | Town | Verdict | Reason | Simulated s | Wall s |", "|---|---|---|---|---|---|---|"]
    for one in verdicts:
        game = "" if one.game_secs is None else f"{one.game_secs:.1f}"
        reason = one.reason.replace("|", "/")[:160]
        lines.append(f"| {one.name} | {one.kind} | {one.town} | {one.verdict} | {reason} | {game} | {one.wall_secs:.0f} |")
    counts = collections.Counter(one.verdict for one in verdicts)
    total = ", ".join(f"{n} {what}" for what, n in counts.most_common())
    return "\n".join([f"{'synchronous' if sync else 'asynchronous'}: {len(verdicts)} scenarios: {total}", "", *lines, ""])


def main():
    args = arguments()
    if not (args.folder / "scenario_runner.py").is_file():
        sys.exit(f"{args.folder} has no scenario_runner.py; give the folder that was cloned")
    args.out.mkdir(parents=True, exist_ok=True)
    args.folder = args.folder.resolve()
    k, n = map(int, args.shard.split("/"))
    scenarios = [one for one in listed(args.folder) if re.search(args.only, one[0])]
    if args.one_per_type:
        scenarios = list({kind if "OpenSCENARIO" not in kind else name: (name, kind, *rest) for name, kind, *rest in reversed(scenarios)}.values())[::-1]
    scenarios = scenarios[k::n]
    server, verdicts = Server(args), []
    try:
        for scenario in scenarios:
            if not server.runs():
                server.start()
            verdict = run(args, scenario)
            if not server.runs():
                verdict = verdict._replace(verdict="crashed", reason="the simulator or the gateway ended; see server.log")
            if verdict.verdict in ("hung", "crashed"):
                server.stop()
            verdicts.append(verdict)
            print(f"{verdict.name}: {verdict.verdict} {verdict.reason} ({verdict.wall_secs:.0f} s)", flush=True)
            (args.out / "table.md").write_text(table(verdicts, args.sync))
    finally:
        server.end()
    print(table(verdicts, args.sync).splitlines()[0])
    sys.exit(any(one.verdict in ("hung", "crashed", "not run") for one in verdicts))


if __name__ == "__main__":
    main()
