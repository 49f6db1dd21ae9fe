"""Drives half of the cars with the Traffic Manager of a running Gantry and half with the client's own, in one world, and compares them.

Start a Gantry with a Traffic Manager first, for example `gantry up launch/carla.toml`; then

    python tests/foreign/traffic_managers.py --map Town10HD --vehicles 100 --minutes 10

Both drive the same kinds of cars from spawn points taken in turn, with their default settings.
Printed for each: mean speed, the 95th percentile of jerk, contacts with vehicles and walkers, and cars that stood longer than 90 s.
"""

import argparse
import datetime
import json
import os
import pathlib
import random
import subprocess
import sys

import carla

OWN_PORT = 8005
PERIOD_SECS = 0.05


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=2000)
    parser.add_argument("--served", type=int, default=8000, help="port of Gantry's Traffic Manager")
    parser.add_argument("--own", type=int, default=OWN_PORT, help="free port for the client's own")
    parser.add_argument("--map", default="Town10HD", help="name of a map; several with commas")
    parser.add_argument("--vehicles", type=int, default=100, help="of both together")
    parser.add_argument("--minutes", type=float, default=5.0, help="simulated")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", help="file for the figures")
    return parser.parse_args()


class Group:
    """What is seen of the cars of one Traffic Manager."""

    def __init__(self, name):
        self.name = name
        self.ids = []
        self.driven_m = 0.0
        self.car_secs = 0.0
        self.jerks = []
        self.contacts = 0
        self.stuck = 0
        self.speeds = {}
        self.standing = {}

    def see(self, snapshot):
        for actor_id in self.ids:
            actor = snapshot.find(actor_id)
            if actor is None:
                continue
            velocity = actor.get_velocity()
            speed = (velocity.x**2 + velocity.y**2) ** 0.5
            self.driven_m += speed * PERIOD_SECS
            self.car_secs += PERIOD_SECS
            speeds = self.speeds.setdefault(actor_id, [])
            speeds.append(speed)
            if len(speeds) > 8:
                # Two accelerations over 0.2 s each, 0.2 s apart.
                a, b, c = speeds[-1], speeds[-5], speeds[-9]
                self.jerks.append(abs((a - b) - (b - c)) / 0.04)
                del speeds[0]
            stood = self.standing.get(actor_id, 0.0)
            now = stood + PERIOD_SECS if speed < 0.1 else 0.0
            self.stuck += stood <= 90.0 < now
            self.standing[actor_id] = now

    def figures(self):
        self.jerks.sort()
        return {
            "name": self.name,
            "vehicles": len(self.ids),
            "mean_kmh": round(3.6 * self.driven_m / max(self.car_secs, 1e-9), 2),
            "jerk_p95_mps3": round(self.jerks[int(0.95 * (len(self.jerks) - 1))], 2) if self.jerks else 0.0,
            "contacts": self.contacts,
            "stuck": self.stuck,
            "car_hours": round(self.car_secs / 3600.0, 2),
        }


def spawn(client, world, groups, options):
    """Cars at spawn points in turn; cars only, so that both groups have the same."""
    library = world.get_blueprint_library().filter("vehicle.*")
    cars = sorted((b for b in library if b.get_attribute("base_type").as_str() == "car"), key=lambda b: b.id)
    points = world.get_map().get_spawn_points()
    draw = random.Random(options.seed)
    draw.shuffle(points)
    batch = []
    for i, point in enumerate(points[: options.vehicles]):
        blueprint = cars[(i // 2) % len(cars)]
        blueprint.set_attribute("role_name", "autopilot")
        batch.append(carla.command.SpawnActor(blueprint, point))
    for i, answer in enumerate(client.apply_batch_sync(batch, True)):
        if not answer.error:
            groups[i % 2].ids.append(answer.actor_id)


def watch_contacts(world, groups):
    """A collision sensor on every car; touches within 3 s are one contact."""
    library = world.get_blueprint_library()
    sensors = []
    for group in groups:
        for actor_id in group.ids:
            car = world.get_actor(actor_id)
            sensor = world.spawn_actor(library.find("sensor.other.collision"), carla.Transform(), attach_to=car)
            last = {"secs": -10.0}

            def met(event, group=group, last=last):
                if event.other_actor.type_id.split(".")[0] in ("vehicle", "walker"):
                    group.contacts += event.timestamp > last["secs"] + 3.0
                    last["secs"] = event.timestamp

            sensor.listen(met)
            sensors.append(sensor)
    return sensors


def machine(options):
    """The machine, as the benches in Rust state it."""
    cpu = [line for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
    here = pathlib.Path(__file__).resolve().parent
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=here, capture_output=True, text=True, check=False)
    return {
        "cpu": cpu[0].split(":")[1].strip() if cpu else "",
        "n_cores": os.cpu_count(),
        "load_1min": f"{os.getloadavg()[0]:.0f}",
        "date": datetime.date.today().isoformat(),
        "commit": commit.stdout.strip(),
        "command": f"traffic_managers.py --map {options.map} --vehicles {options.vehicles} --minutes {options.minutes:g}",
    }


def run(client, town, options):
    """Both groups in one world for the time that was asked for; their figures."""
    world = client.load_world(town)
    settings = world.get_settings()
    settings.synchronous_mode, settings.fixed_delta_seconds = True, PERIOD_SECS
    world.apply_settings(settings)
    groups = [Group("gantry-drive"), Group("client")]
    managers = [client.get_trafficmanager(options.served), client.get_trafficmanager(options.own)]
    for manager in managers:
        manager.set_synchronous_mode(True)
        manager.set_random_device_seed(options.seed)
    spawn(client, world, groups, options)
    world.tick()
    for group, manager in zip(groups, managers):
        for actor_id in group.ids:
            world.get_actor(actor_id).set_autopilot(True, manager.get_port())
    sensors = watch_contacts(world, groups)
    for _ in range(int(options.minutes * 60.0 / PERIOD_SECS)):
        world.tick()
        snapshot = world.get_snapshot()
        for group in groups:
            group.see(snapshot)
    for sensor in sensors:
        sensor.stop()
    rows = [{**group.figures(), "map": town, "simulated_min": options.minutes} for group in groups]
    settings.synchronous_mode, settings.fixed_delta_seconds = False, 0.0
    managers[1].shut_down()
    world.apply_settings(settings)
    destroyed = [actor_id for group in groups for actor_id in group.ids] + [sensor.id for sensor in sensors]
    client.apply_batch_sync([carla.command.DestroyActor(actor_id) for actor_id in destroyed], False)
    return rows


def main():
    options = arguments()
    client = carla.Client(options.host, options.port)
    client.set_timeout(60.0)
    about = machine(options)
    rows = []
    for town in options.map.split(","):
        for row in run(client, town, options):
            print(json.dumps(row), flush=True)
            rows.append(row)
        if options.json:
            with open(options.json, "w") as file:
                json.dump({"bench": "traffic_managers", "machine": about, "rows": rows}, file, indent=2)
                file.write("\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
