"""The stock `carla` 0.9.16 wheel: what a replay does with actors, sensors, the hero, the spectator and time, and the texts about a recording.

    carla_replay.py PORT

Prints "NAME passed" per theme; the first thing that is not as it should be ends the script.
"""

import math
import queue
import re
import sys

import carla
from carla_kit import PATIENCE_SECS, STEP_SECS, passed, run, stage

PORT = int(sys.argv[1])
N_STEPS = 100
MOUNT = carla.Transform(carla.Location(x=1.0, y=0.5, z=2.0))


def straight_places(world, n_wanted):
    """Spawn points with 60 m of straight lane ahead, far from each other."""
    town, found = world.get_map(), []
    taken = [car.get_location() for car in world.get_actors().filter("vehicle.*")]
    for point in town.get_spawn_points():
        here = town.get_waypoint(point.location)
        ahead = here.next(60.0)
        if not ahead or abs(ahead[0].transform.rotation.yaw - here.transform.rotation.yaw) > 0.5:
            continue
        if all(point.location.distance(other) > 80.0 for other in [place.location for place in found] + taken):
            found.append(point)
    assert len(found) >= n_wanted, len(found)
    return found[:n_wanted]


def forward(transform, metres):
    direction = transform.get_forward_vector()
    return carla.Location(
        transform.location.x + metres * direction.x, transform.location.y + metres * direction.y, transform.location.z
    )


def speed(vector):
    return math.sqrt(vector.x**2 + vector.y**2 + vector.z**2)


def apart(a, b):
    return speed(carla.Vector3D(a.x - b.x, a.y - b.y, a.z - b.z))


def record(client, world):
    """A hero and another car drive off, a walker walks, a GNSS rides on the hero, the spectator climbs; lamps go on half way."""
    library = world.get_blueprint_library()
    places = straight_places(world, 2)
    hero_print = library.find("vehicle.tesla.model3")
    hero_print.set_attribute("role_name", "hero")
    hero = world.spawn_actor(hero_print, places[0])
    other = world.spawn_actor(library.find("vehicle.audi.tt"), places[1])
    gnss_print = library.find("sensor.other.gnss")
    gnss_print.set_attribute("noise_seed", "7")
    gnss = world.spawn_actor(gnss_print, MOUNT, attach_to=hero)
    beside = carla.Transform(forward(places[1], -8.0), places[1].rotation)
    beside.location.z += 1.0
    walker = world.spawn_actor(library.find("walker.pedestrian.0005"), beside)
    spectator = world.get_spectator()
    for _ in range(10):
        world.tick()
    client.start_recorder("replay_test.log", True)
    track = []
    heading = walker.get_transform().get_forward_vector()
    for step in range(N_STEPS):
        hero.apply_control(carla.VehicleControl(throttle=0.6))
        other.apply_control(carla.VehicleControl(throttle=0.4))
        walker.apply_control(carla.WalkerControl(heading, 1.5))
        spectator.set_transform(carla.Transform(carla.Location(x=10.0, z=50.0 + step)))
        if step == 50:
            hero.set_light_state(carla.VehicleLightState(carla.VehicleLightState.LowBeam | carla.VehicleLightState.Fog))
        world.tick()
        track.append(
            {
                "hero": hero.get_transform(),
                "velocity": hero.get_velocity(),
                "other": other.get_transform(),
                "walker": walker.get_transform(),
                "lamps": int(hero.get_light_state()),
            }
        )
    client.stop_recorder()
    world.tick()
    assert track[-1]["hero"].location.distance(track[0]["hero"].location) > 15.0
    assert track[-1]["walker"].location.distance(track[0]["walker"].location) > 4.0
    return hero, other, gnss, walker, track


def numbers(text):
    return [float(number) for number in re.findall(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", text)]


def check_additional(client, hero, lines):
    """Boxes and trigger volumes are those that the client knows, in centimetres; the machine's clock goes on."""
    world = client.get_world()
    boxed = {int(numbers(line)[0]): numbers(line)[1:] for line in lines if " origin: (" in line}
    lights = list(world.get_actors().filter("traffic.traffic_light"))
    for actor, box in [(hero, hero.bounding_box)] + [(light, light.trigger_volume) for light in lights]:
        wanted = [100.0 * metres for vector in (box.location, box.extent) for metres in (vector.x, vector.y, vector.z)]
        assert max(abs(a - b) for a, b in zip(boxed[actor.id], wanted)) < 0.1, (actor.type_id, boxed[actor.id], wanted)
    timed = {int(numbers(line)[0]): numbers(line)[1:] for line in lines if " green_time: " in line}
    for light in lights:
        wanted = [light.get_green_time(), light.get_yellow_time(), light.get_red_time()]
        assert max(abs(a - b) for a, b in zip(timed[light.id], wanted)) < 1e-3, (timed[light.id], wanted)
    clock = [float(line.split()[-1]) for line in lines if line.startswith(" Current platform time: ")]
    assert len(clock) >= N_STEPS and clock == sorted(clock) and clock[-1] > clock[0], (len(clock), clock[:3])


def check_text(client, hero, gnss, walker, track):
    """Every line of the whole text is one of the documented ones, and the numbers are those that the client saw: centimetres, roll first."""
    lines = client.show_recorder_file_info("replay_test.log", True).splitlines()
    assert re.fullmatch(r"Version: \d+", lines[0]) and lines[1] == "Map: Town10HD" and lines[2].startswith("Date: "), lines[:3]
    kinds = [
        r"Frame (\d+) at ([\d.]+) seconds",
        r" Create \d+: \S+ \([0-3]\) at \(\S+, \S+, \S+\)",
        r"  \w+ = .*",
        r" Destroy \d+",
        r" Parenting \d+ with \d+ \(parent\)",
        r" Collision id \d+ between \d+(?: \(hero\) )? with \d+(?: \(hero\) )?",
        r" Positions: \d+",
        r"  Id: \d+ Location: \(\S+, \S+, \S+\) Rotation: \(\S+, \S+, \S+\)",
        r" State traffic lights: \d+",
        r"  Id: \d+ state: [0-4] frozen: [01] elapsedTime: \S+",
        r" (?:Vehicle|Walker) animations: \d+",
        r"  Id: \d+ Steering: \S+ Throttle: \S+ Brake: \S+ Handbrake: [01] Gear: -?\d+",
        r"  Id: \d+ speed: \S+",
        r" Vehicle light animations: \d+",
        r"  Id: \d+ (?:None|[A-Z][A-Za-z0-9 ]+)",
        r" Dynamic actors: \d+",
        r"  Id: \d+ linear_velocity: \(\S+, \S+, \S+\) angular_velocity: \(\S+, \S+, \S+\)",
        r" Actor (?:bounding boxes|trigger volumes): \d+",
        r"  Id: \d+ origin: \(\S+, \S+, \S+\) extension: \(\S+, \S+, \S+\)",
        r" Current platform time: [\d.]+",
        r" Traffic Light time events: \d+",
        r"  Id: \d+ green_time: \S+ yellow_time: \S+ red_time: \S+",
        r" Weathers: 1",
        r"  Cloudiness: \S+ .* DustStorm: \S+",
        r" (?:Physics Control events|Walkers Bones): \d+",
        r"  Id: \d+",
        r"   (?:\w+ =.*|\w+:| (?:gear|wheel) \d+: .*)",
        r"     Bone: \"\S+\" relative: Loc\(.*\) Rot\(.*\)",
        r"Frames: \d+",
        r"Duration: [\d.]+ seconds",
        r"",
    ]
    at_frame, worst_m, worst_mps, n_lit, n_walked = None, 0.0, 0.0, 0, 0
    for line in lines[3:]:
        assert any(re.fullmatch(kind, line) for kind in kinds), line
        if line.startswith("Frame "):
            at_frame = int(line.split()[1]) - 1
        if at_frame is None or not 0 <= at_frame < N_STEPS:
            continue
        was = track[at_frame]
        if line.startswith(f"  Id: {hero.id} Location"):
            _, x, y, z, roll, pitch, yaw = numbers(line)
            worst_m = max(worst_m, was["hero"].location.distance(carla.Location(x / 100, y / 100, z / 100)))
            rotation = was["hero"].rotation
            turned = [roll - rotation.roll, pitch - rotation.pitch, (yaw - rotation.yaw + 180.0) % 360.0 - 180.0]
            assert max(map(abs, turned)) < 0.01, (line, rotation)
        if line.startswith(f"  Id: {hero.id} linear_velocity"):
            worst_mps = max(worst_mps, apart(carla.Vector3D(*numbers(line)[1:4]), was["velocity"]))
        if line == f"  Id: {hero.id} LowBeam Fog":
            n_lit += 1
        if line.startswith(f"  Id: {walker.id} speed: "):
            n_walked += float(line.split()[-1]) > 100.0
    print(f"text: places within {worst_m:.4f} m, velocities within {worst_mps:.4f} m/s of what the client saw")
    assert worst_m < 2e-3 and worst_mps < 2e-3 and n_lit >= 45 and n_walked > 50, (worst_m, worst_mps, n_lit, n_walked)
    whole = "\n".join(lines)
    check_additional(client, hero, lines)
    assert f" Parenting {gnss.id} with {hero.id} (parent)" in whole and f" Create {gnss.id}: sensor.other.gnss (0) at" in whole
    assert f" Create {hero.id}: vehicle.tesla.model3 (1) at" in whole and f" Create {walker.id}: walker.pedestrian.0005 (2) at" in whole
    without = client.show_recorder_file_info("replay_test.log", False)
    assert "Positions" not in without and f"Create {hero.id}:" in without


def check_ignored(client, world, hero, other, track):
    """The hero is left alone, the spectator is taken along, on demand."""
    for car in (hero, other):
        car.apply_control(carla.VehicleControl(brake=1.0, hand_brake=True))
    for _ in range(60):
        world.tick()
    parked = hero.get_location()
    client.set_replayer_ignore_hero(True)
    client.set_replayer_ignore_spectator(False)
    client.replay_file("replay_test.log", 1.0, 2.0, 0, False)
    for _ in range(20):
        world.tick()
    assert hero.get_location().distance(parked) < 0.05, "an ignored hero stays where it is"
    assert min(other.get_location().distance(at["other"].location) for at in track) < 0.1
    height = world.get_spectator().get_location().z
    assert 70.0 < height < 95.0, height
    client.stop_replayer(True)
    client.set_replayer_ignore_hero(False)
    client.set_replayer_ignore_spectator(True)
    world.get_spectator().set_location(carla.Location(z=5.0))
    world.tick()
    client.replay_file("replay_test.log", 1.0, 0.5, 0, False)
    for _ in range(5):
        world.tick()
    assert abs(world.get_spectator().get_location().z - 5.0) < 0.01
    assert min(hero.get_location().distance(at["hero"].location) for at in track) < 0.05, "now the hero takes part"
    client.stop_replayer(True)
    world.tick()


def check_sensors(client, world, track):
    """Made anew: the actors, and the sensor on its vehicle, which measures there."""
    n_before = len(world.get_actors())
    client.replay_file("replay_test.log", 0.0, 0.0, 0, True)
    world.tick()
    made = world.get_actors().filter("sensor.other.gnss")
    assert len(made) == 1 and made[0].attributes["noise_seed"] == "7", list(made)
    hero = made[0].parent
    assert hero.type_id == "vehicle.tesla.model3" and hero.attributes["role_name"] == "hero"
    walker = world.get_actors().filter("walker.*")[0]
    heard = queue.Queue()
    made[0].listen(heard.put)
    before, worst_m, n_fast = None, 0.0, 0
    for step in range(60):
        world.tick()
        fix, now, velocity = heard.get(timeout=PATIENCE_SECS), hero.get_transform(), hero.get_velocity()
        mount = carla.Location(MOUNT.location.x, MOUNT.location.y, MOUNT.location.z)
        now.transform(mount)
        assert fix.transform.location.distance(mount) < 0.02, (fix.transform.location, mount)
        nearest = min(now.location.distance(at["hero"].location) for at in track)
        worst_m = max(worst_m, nearest)
        if before is not None and step > 2:
            moved = carla.Vector3D(*[(b - a) / STEP_SECS for a, b in zip(before, (now.location.x, now.location.y, now.location.z))])
            assert apart(moved, velocity) < 0.01 + 0.01 * speed(moved), (step, moved, velocity)
            n_fast += speed(velocity) > 3.0
        before = (now.location.x, now.location.y, now.location.z)
        # What the engine would do with it has no effect.
        hero.add_impulse(carla.Vector3D(z=50_000.0))
    print(f"replayed within {worst_m:.4f} m of the way, faster than 3 m/s in {n_fast} ticks")
    assert worst_m < 0.03 and n_fast > 20, (worst_m, n_fast)
    assert int(hero.get_light_state()) & 0x82 == 0x82, "lamps come on as then"
    assert speed(walker.get_velocity()) > 1.0
    assert min(walker.get_location().distance(at["walker"].location) for at in track) < 0.15
    made[0].stop()
    # At twice the pace the way per tick is twice as long; at 0 it stands.
    single = speed(hero.get_velocity())
    client.set_replayer_time_factor(2.0)
    for _ in range(4):
        world.tick()
    assert 1.7 < speed(hero.get_velocity()) / single < 2.5, (single, speed(hero.get_velocity()))
    client.set_replayer_time_factor(0.0)
    for _ in range(4):
        world.tick()
    assert speed(hero.get_velocity()) < 1e-3
    client.set_replayer_time_factor(1.0)
    for _ in range(3):
        world.tick()
    client.stop_replayer(False)
    for _ in range(2):
        world.tick()
    assert len(world.get_actors()) == n_before, "what the replay made goes with it"


def check_kept(client, world):
    """Kept actors go on by themselves: with their speed, moved by the engine."""
    client.replay_file("replay_test.log", 1.0, 0.0, 0, False)
    for _ in range(40):
        world.tick()
    hero = [car for car in world.get_actors().filter("vehicle.*") if car.attributes["role_name"] == "hero"][0]
    held = speed(hero.get_velocity())
    client.stop_replayer(True)
    for _ in range(3):
        world.tick()
    free = speed(hero.get_velocity())
    assert abs(free - held) < 0.25 * held + 0.5, (held, free)
    hero.apply_control(carla.VehicleControl(brake=1.0))
    for _ in range(100):
        world.tick()
    assert speed(hero.get_velocity()) < 0.1, "its brakes act again"


def check_names(client):
    """No name leads out of the folder."""
    for name in ("../../outside", "/etc/passwd", "..", "a\0b", ".hidden", "ä"):
        text = client.show_recorder_file_info(name, False)
        assert "Frames:" not in text and len(text) > 10, (name, text)
    for name in ("..", ".hidden", ""):
        try:
            client.start_recorder(name)
        except RuntimeError as error:
            assert "file name" in str(error), error
        else:
            raise AssertionError(name)


def main():
    client, world = stage(PORT)
    hero, other, gnss, walker, track = record(client, world)
    check_text(client, hero, gnss, walker, track)
    passed("text")
    check_ignored(client, world, hero, other, track)
    passed("ignored")
    for actor in (gnss, hero, other, walker):
        actor.destroy()
    world.tick()
    check_sensors(client, world, track)
    passed("sensors")
    check_kept(client, world)
    passed("kept")
    check_names(client)
    passed("names")


run(main)
