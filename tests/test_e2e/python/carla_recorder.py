"""The stock `carla` 0.9.16 wheel: recorder, its texts, and the replayer.

    carla_recorder.py PORT

Prints "NAME passed" per theme; the first thing that is not as it should be ends the script.
"""

import os
import re
import sys

import carla
from carla_kit import STEP_SECS, passed, run, stage

PORT = int(sys.argv[1])


def two_cars(world, hero_print, other_print):
    """A car, and another 14 m ahead of it on a straight lane, so that the first runs into the second."""
    town = world.get_map()
    for point in town.get_spawn_points():
        here = town.get_waypoint(point.location)
        ahead = here.next(14.0)
        if not ahead or ahead[0].is_junction or abs(ahead[0].transform.rotation.yaw - here.transform.rotation.yaw) > 1.0:
            continue
        front = ahead[0].transform
        front.location.z += 0.3
        hero = world.try_spawn_actor(hero_print, point)
        other = world.try_spawn_actor(other_print, front) if hero is not None else None
        if other is not None:
            return hero, other
        if hero is not None:
            hero.destroy()
    raise AssertionError("no straight lane with room")


def record(client, world):
    hero_print = world.get_blueprint_library().find("vehicle.tesla.model3")
    hero_print.set_attribute("role_name", "hero")
    hero_print.set_attribute("color", "10,20,30")
    hero, other = two_cars(world, hero_print, world.get_blueprint_library().find("vehicle.volkswagen.t2"))
    world.tick()
    path = client.start_recorder("folder/that/does/not/matter/drive.log")
    assert os.path.isabs(path) and path.endswith("/recordings/carla/drive.log"), path
    light = sorted(world.get_actors().filter("traffic.traffic_light"), key=lambda one: one.id)[0]
    track, lights = [], []
    other.apply_control(carla.VehicleControl(hand_brake=True))
    for step in range(120):
        hero.apply_control(carla.VehicleControl(throttle=0.8 if step < 60 else 0.0, brake=0.0 if step < 60 else 1.0))
        if step == 30:
            light.set_state(carla.TrafficLightState.Yellow)
        frame = world.tick()
        track.append((hero.get_transform(), hero.get_control().throttle))
        lights.append(light.get_state())
    client.stop_recorder()
    world.tick()
    assert os.path.getsize(path) > 10_000
    return path, hero, other, light, track, lights


def check_texts(client, hero, other):
    text = client.show_recorder_file_info("drive.log", False)
    for wanted in ("Version: 4\n", "Map: Town10HD\n", "Date: 20", "Frame 1 at 0 seconds", f"Create {hero.id}: vehicle.tesla.model3",
                   "role_name = hero", "color = 10,20,30", f"Create {other.id}: vehicle.volkswagen.t2"):
        assert wanted in text, (wanted, text[:2000])
    frames = int(re.search(r"Frames: (\d+)", text).group(1))
    duration = float(re.search(r"Duration: ([\d.]+) seconds", text).group(1))
    assert 119 <= frames <= 121 and abs(duration - (frames - 1) * STEP_SECS) < 1e-6, (frames, duration)
    everything = client.show_recorder_file_info("drive.log", True)
    assert everything.count("Positions: ") == frames and "Vehicle animations" in everything and "State traffic lights" in everything
    crashes = client.show_recorder_collisions("drive.log", "h", "v")
    lines = [line for line in crashes.splitlines() if re.search(r"\sv v\s", line)]
    assert lines and str(hero.id) in lines[0] and str(other.id) in lines[0], crashes
    assert not [line for line in client.show_recorder_collisions("drive.log", "w", "w").splitlines() if " w w " in line]
    blocked = client.show_recorder_actors_blocked("drive.log", 1.0, 10.0)
    assert re.search(rf"\s{other.id} vehicle.volkswagen.t2\s", blocked), blocked
    assert "not found" in client.show_recorder_file_info("missing.log", False)
    print(text[:300])


def check_replay(client, world, hero, light, track, lights):
    """The same actors, moved along the same way, tick by tick."""
    text = client.replay_file("drive.log", 0.0, 0.0, 0, False)
    assert "Total time recorded: 5.9" in text and "at 1.0x" in text, text
    worst, seen = 0.0, []
    for step in range(110):
        world.tick()
        at = hero.get_transform()
        seen.append(at)
        # The poses of the first tick are put before the second one.
        nearest = min((at.location.distance(track[k][0].location), k) for k in range(max(0, step - 3), min(len(track), step + 3)))
        worst = max(worst, nearest[0])
        if nearest[0] > 0.1:
            print(step, nearest, at.location, track[min(step, 119)][0].location)
        if 5 < step < 55:
            assert hero.get_control().throttle > 0.5
        if 40 < step < 60:
            assert light.get_state() == lights[step], (step, light.get_state(), lights[step])
    moved = seen[0].location.distance(seen[-1].location)
    print(f"replayed over {moved:.1f} m, at most {worst:.3f} m off the recorded way")
    assert moved > 5.0 and worst < 0.1, (moved, worst)
    client.stop_replayer(True)
    world.tick()
    assert world.get_actor(hero.id) is not None


def check_made_anew(client, world, hero, other, track):
    """Actors that are gone are made anew; half the way, at double speed, followed by the spectator, without hero afterwards."""
    hero_id = hero.id
    hero.destroy()
    other.destroy()
    world.tick()
    n_before = len(world.get_actors().filter("vehicle.*"))
    client.set_replayer_time_factor(2.0)
    text = client.replay_file("drive.log", -3.0, 2.0, hero_id, False, carla.Transform(carla.Location(x=-4.0, z=2.0)))
    assert "Replaying from 2.9" in text and "2.0x" in text, text
    for _ in range(6):
        world.tick()
    cars = world.get_actors().filter("vehicle.*")
    assert len(cars) == n_before + 2, len(cars)
    anew = [car for car in cars if car.attributes.get("role_name") == "hero"]
    assert len(anew) == 1 and anew[0].type_id == "vehicle.tesla.model3" and anew[0].attributes["color"] == "10,20,30"
    distance = min(anew[0].get_location().distance(at.location) for at, _ in track)
    assert distance < 0.2, distance
    behind = carla.Location(x=-4.0, z=2.0)
    anew[0].get_transform().transform(behind)
    assert world.get_spectator().get_location().distance(behind) < 0.3
    client.stop_replayer(False)
    for _ in range(2):
        world.tick()
    assert len(world.get_actors().filter("vehicle.*")) == n_before
    client.set_replayer_time_factor(1.0)
    client.set_replayer_ignore_hero(True)
    client.replay_file("drive.log", 0.0, 1.0, 0, False)
    for _ in range(6):
        world.tick()
    assert len(world.get_actors().filter("vehicle.*")) == n_before + 1, "the hero is left out"
    client.stop_replayer(False)
    client.set_replayer_ignore_hero(False)
    world.tick()


def main():
    client, world = stage(PORT)
    path, hero, other, light, track, lights = record(client, world)
    passed("recording")
    check_texts(client, hero, other)
    passed("texts")
    check_replay(client, world, hero, light, track, lights)
    passed("replay")
    check_made_anew(client, world, hero, other, track)
    passed("anew")


run(main)
