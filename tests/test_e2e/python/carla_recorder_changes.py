"""The stock `carla` 0.9.16 wheel: what a recording has of doors, weather, street lights, physics control and bones, and that a replay brings it back.

    carla_recorder_changes.py PORT

Prints "NAME passed" per theme; the first thing that is not as it should be ends the script.
"""

import re
import sys

import carla
from carla_kit import near, passed, run, stage, ticks

PORT = int(sys.argv[1])
N_STEPS = 80
OPENED, WEATHERED, LIT, LOADED, POSED, SHUT = 10, 20, 30, 40, 50, 60


def numbers(text):
    return [float(number) for number in re.findall(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", text)]


def lamp_of(world, wanted_id):
    lights = world.get_lightmanager().get_all_lights(carla.LightGroup.Street)
    return next(light for light in lights if light.id == wanted_id)


def bones_of(walker):
    return {bone.name: bone.relative for bone in walker.get_bones().bone_transforms}


def record(client, world):
    library, points = world.get_blueprint_library(), world.get_map().get_spawn_points()
    blueprint = library.find("vehicle.dodge.charger_2020")
    car, point = next((car, point) for point in points if (car := world.try_spawn_actor(blueprint, point)))
    place = point.transform(carla.Location(x=12.0, z=0.6))
    walker = world.spawn_actor(library.find("walker.pedestrian.0005"), carla.Transform(place, point.rotation))
    lamp = world.get_lightmanager().get_all_lights(carla.LightGroup.Street)[0].id
    ticks(world, 10)
    mass = car.get_physics_control().mass
    before = world.get_weather()
    client.start_recorder("changes.log", True)
    seen = []
    for step in range(N_STEPS):
        if step == OPENED:
            car.open_door(carla.VehicleDoor.FL)
        if step == SHUT:
            car.close_door(carla.VehicleDoor.FL)
        if step == WEATHERED:
            weather = world.get_weather()
            weather.cloudiness, weather.sun_altitude_angle, weather.sun_azimuth_angle = 77.0, 12.0, 200.0
            world.set_weather(weather)
        if step == LIT:
            light = lamp_of(world, lamp)
            light.set_color(carla.Color(200, 100, 50))
            light.turn_on()
        if step == LOADED:
            control = car.get_physics_control()
            control.mass = mass + 250.0
            car.apply_physics_control(control)
        if step == POSED:
            held = carla.Transform(bones_of(walker)["crl_arm__R"].location, carla.Rotation(roll=40.0, yaw=20.0))
            walker.set_bones(carla.WalkerBoneControlIn([("crl_arm__R", held)]))
            walker.blend_pose(1.0)
        frame = world.tick()
        seen.append((frame, bones_of(walker)))
    client.stop_recorder()
    world.tick()
    return car, walker, lamp, mass, before, seen


def blocks(text):
    """Lines by frame, counted from 0."""
    frames = re.split(r"^Frame \d+ at .*$", text, flags=re.M)[1:]
    return [frame.splitlines() for frame in frames]


def after(lines, title):
    """The lines behind one with a title."""
    at = next((at for at, line in enumerate(lines) if line.startswith(title)), None)
    return lines[at + 1 :] if at is not None else []


def check_text(client, car, walker, lamp, mass, seen):
    frames = blocks(client.show_recorder_file_info("changes.log", True))
    assert N_STEPS - 1 <= len(frames) <= N_STEPS + 1, len(frames)
    # Ten lines lie between an id and the mass.
    masses = [(at, numbers(lines[n + 10])[0]) for at, lines in enumerate(frames) for n, line in enumerate(lines)
              if line == f"  Id: {car.id}" and lines[n + 1].startswith("   max_rpm")]
    assert [value for _, value in masses] == [mass, mass + 250.0] and masses[0][0] == 0, masses
    assert abs(masses[1][0] - LOADED) <= 2, masses
    doors = [(at, after(lines, " Vehicle door animations: 1")[1].split(":")[1].strip()) for at, lines in enumerate(frames)
             if after(lines, " Vehicle door animations")]
    assert [what for _, what in doors] == ["Front Left", ""], doors
    assert abs(doors[0][0] - OPENED) <= 2 and abs(doors[1][0] - SHUT) <= 2, doors
    weathers = [(at, after(lines, " Weathers: 1")[0]) for at, lines in enumerate(frames) if after(lines, " Weathers")]
    assert len(weathers) == 2 and weathers[0][0] == 0 and abs(weathers[1][0] - WEATHERED) <= 2, weathers
    assert weathers[1][1].startswith("  Cloudiness: 77 ") and " SunAzimuthAngle: 200 SunAltitudeAngle: 12 " in weathers[1][1], weathers
    lit = [(at, line) for at, lines in enumerate(frames) for line in after(lines, " Scene light changes")[:1]]
    # Colour and switch are two calls.
    assert lit and f"  Id: {lamp} enabled: True" in lit[-1][1] and lit[-1][1].endswith("RGB_color: (0.784314, 0.392157, 0.196078)"), lit
    # Bones of the walker, by the client's own reading of the same tick.
    worst_cm, n_compared = 0.0, 0
    for at in (5, POSED + 10):
        lines = [line for line in frames[at] if line.startswith("     Bone: ")]
        recorded = {line.split('"')[1]: numbers(line.split("Loc")[1]) for line in lines}
        mine = min(seen, key=lambda one: abs(one[0] - seen[0][0] - at))[1]
        assert set(recorded) == set(mine) and len(mine) > 60, len(recorded)
        for name, place in mine.items():
            wanted = [100.0 * place.location.x, 100.0 * place.location.y, 100.0 * place.location.z]
            worst_cm = max(worst_cm, *(abs(a - b) for a, b in zip(recorded[name], wanted)))
            n_compared += 1
    print(f"{n_compared} bones within {worst_cm:.3f} cm of what the client saw")
    assert worst_cm < 0.5, worst_cm
    arm = numbers(next(line for line in frames[POSED + 10] if '"crl_arm__R"' in line).split("Rot")[1])
    assert near(arm[0], 40.0, 0.1) and near(arm[2], 20.0, 0.1), arm


def check_replay(client, world, car, walker, lamp, mass, before, seen):
    """Made anew in another weather, with the lamp off."""
    for actor in (car, walker):
        actor.destroy()
    world.set_weather(before)
    lamp_of(world, lamp).turn_off()
    world.tick()
    client.replay_file("changes.log", 0.0, 0.0, 0, False)
    world.tick()
    client.start_recorder("again.log", True)
    for _ in range(WEATHERED - 5):
        world.tick()
    assert near(world.get_weather().cloudiness, before.cloudiness)
    ticks(world, POSED + 10 - (WEATHERED - 5))
    now = world.get_weather()
    assert near(now.cloudiness, 77.0) and near(now.sun_altitude_angle, 12.0) and near(now.sun_azimuth_angle, 200.0, 0.01)
    light = lamp_of(world, lamp)
    assert light.is_on and (light.color.r, light.color.g, light.color.b) == (200, 100, 50), light.color
    twin = world.get_actors().filter("vehicle.dodge.charger_2020")[0]
    assert near(twin.get_physics_control().mass, mass + 250.0, 0.01)
    arm = bones_of(world.get_actors().filter("walker.*")[0])["crl_arm__R"].rotation
    assert near(arm.roll, 40.0, 0.1) and near(arm.yaw, 20.0, 0.1), arm
    ticks(world, 15)
    client.stop_recorder()
    text = client.show_recorder_file_info("again.log", True)
    assert [line.split(":")[1].strip() for line in text.splitlines() if line.startswith("  Doors opened")] == ["Front Left", ""]
    client.stop_replayer(True)
    ticks(world, 3)
    arm = bones_of(world.get_actors().filter("walker.*")[0])["crl_arm__R"].rotation
    assert not near(arm.roll, 40.0, 1.0), "the gait is shown again"


def main():
    client, world = stage(PORT)
    car, walker, lamp, mass, before, seen = record(client, world)
    check_text(client, car, walker, lamp, mass, seen)
    passed("changes")
    check_replay(client, world, car, walker, lamp, mass, before, seen)
    passed("changes replayed")


run(main)
