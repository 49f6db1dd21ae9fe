"""The stock `carla` 0.9.16 wheel: a recording in CARLA's own format, made here byte by byte, is told about and replayed.

    carla_log.py PORT

Prints "NAME passed" per theme; the first thing that is not as it should be ends the script.
"""

import math
import os
import struct
import sys

import carla
from carla_kit import STEP_SECS, near, passed, run, stage, ticks

PORT = int(sys.argv[1])
HERO, VAN, WALKER, LIGHT, SPECTATOR, GNSS, STRANGER = 7001, 7002, 7003, 7004, 7005, 7006, 7007
N_FRAMES, SPEED_MPS, PACE_MPS = 80, 8.0, 1.5
LIT, OPENED, WEATHERED, MOUNTED, CRASHED, GONE = 20, 25, 30, 10, 40, 60


def packet(number, contents):
    return struct.pack("<BI", number, len(contents)) + contents


def records(number, all_of_them):
    return packet(number, struct.pack("<H", len(all_of_them)) + b"".join(all_of_them))


def text(value):
    return struct.pack("<H", len(value)) + value.encode()


def place(x, y, z, roll=0.0, pitch=0.0, yaw=0.0):
    """A place in metres and angles in degrees, as the file has them."""
    return struct.pack("<6f", 100.0 * x, 100.0 * y, 100.0 * z, roll, pitch, yaw)


def actor(number, family, type_id, at, **attributes):
    fields = b"".join(struct.pack("<B", 4) + text(name) + text(value) for name, value in attributes.items())
    return struct.pack("<IB", number, family) + at + struct.pack("<I", 1) + text(type_id) + struct.pack("<H", len(attributes)) + fields


class Scene:
    """Where everything is at which time."""

    def __init__(self, world):
        town = world.get_map()
        for point in town.get_spawn_points():
            here = town.get_waypoint(point.location)
            ahead = here.next(60.0)
            if ahead and abs(ahead[0].transform.rotation.yaw - here.transform.rotation.yaw) < 0.5:
                break
        else:
            raise AssertionError("no straight lane of 60 m")
        self.start, self.yaw = point.location, point.rotation.yaw
        self.forward, self.right = point.get_forward_vector(), point.get_right_vector()
        self.lamp = world.get_lightmanager().get_all_lights(carla.LightGroup.Street)[0].id
        self.light = sorted(world.get_actors().filter("traffic.traffic_light"), key=lambda one: one.id)[0]

    def at(self, ahead_m, right_m, up_m=0.3):
        spots = zip((self.start.x, self.start.y), (self.forward.x, self.forward.y), (self.right.x, self.right.y))
        x, y = [start + ahead_m * forward + right_m * right for start, forward, right in spots]
        return carla.Location(x, y, self.start.z + up_m)

    def hero(self, secs):
        return self.at(SPEED_MPS * secs, 0.0)

    def walker(self, secs):
        return self.at(5.0 + PACE_MPS * secs, 4.0, 1.0)

    def bytes_of(self, spot, **angles):
        return place(spot.x, spot.y, spot.z, **{"yaw": self.yaw, **angles})


def write_log(path, scene, map_name):
    """80 ticks of 0.05 s."""
    out = struct.pack("<H", 1) + text("CARLA_RECORDER") + struct.pack("<q", 1_700_000_000) + text(map_name)
    for idx in range(N_FRAMES):
        secs = idx * STEP_SECS
        out += packet(0, struct.pack("<Qdd", idx + 1, STEP_SECS, secs))
        out += packet(20, struct.pack("<d", secs))
        born, gone, parents = [], [], []
        if idx == 0:
            pole = scene.light.get_location()
            born = [
                actor(HERO, 1, "vehicle.audi.tt", scene.bytes_of(scene.hero(0.0)), role_name="hero", color="10,20,30"),
                actor(VAN, 1, "vehicle.volkswagen.t2", scene.bytes_of(scene.at(50.0, 0.0)), role_name="autopilot"),
                actor(WALKER, 2, "walker.pedestrian.0005", scene.bytes_of(scene.walker(0.0))),
                actor(LIGHT, 3, "traffic.traffic_light", place(pole.x + 0.5, pole.y, pole.z)),
                actor(SPECTATOR, 0, "spectator", place(0.0, 0.0, 40.0)),
                actor(STRANGER, 1, "vehicle.of.tomorrow", scene.bytes_of(scene.at(20.0, 9.0))),
            ]
        if idx == MOUNTED:
            born, parents = [actor(GNSS, 5, "sensor.other.gnss", place(1.0, 0.5, 2.0), noise_seed="7")], [struct.pack("<II", GNSS, HERO)]
        if idx == GONE:
            gone = [struct.pack("<I", VAN)]
        out += records(2, born) + records(3, gone) + records(4, parents)
        crash = [struct.pack("<3I2?", 0, HERO, VAN, True, False)] if idx == CRASHED else []
        out += records(5, crash)
        poses = [(HERO, scene.bytes_of(scene.hero(secs))), (WALKER, scene.bytes_of(scene.walker(secs))), (SPECTATOR, place(0.0, 0.0, 40.0 + idx))]
        if idx < GONE:
            poses.append((VAN, scene.bytes_of(scene.at(50.0, 0.0))))
        out += records(6, [struct.pack("<I", number) + at for number, at in poses])
        out += records(7, [struct.pack("<I?fB", LIGHT, False, secs, 2 if idx < 40 else 0)])
        out += records(8, [struct.pack("<I3f?i", HERO, -0.125, 0.625, 0.0, False, 3)])
        out += records(9, [struct.pack("<If", WALKER, 100.0 * PACE_MPS)])
        out += records(10, [struct.pack("<II", HERO, 0x82 if idx >= LIT else 0)])
        bone = text("crl_arm__R") + place(0.1, 0.0, 0.2, roll=77.0)
        out += records(19, [struct.pack("<IH", WALKER, 1) + bone])
        if idx == 0:
            out += records(11, [struct.pack("<if4f?B", scene.lamp, 4321.0, 1.0, 0.5, 0.0, 1.0, True, 2)])
        # Doors, wheels and riders; wheels are not read, but must not be taken for doors.
        out += records(21, [struct.pack("<IB?", HERO, 0, True)] if idx == OPENED else [])
        out += records(22, [struct.pack("<IIBff", HERO, 1, 0, 3.0, 90.0)]) + records(23, [])
        if idx == 0:
            wheel = struct.pack("<12f", 3.5, 0.25, 70.0, 35.0, 1500.0, 3000.0, 2.0, 17.0, 1000.0, 0.0, 0.0, 0.0)
            control = struct.pack("<I5f?7f", HERO, 6500.0, 1.0, 0.15, 2.0, 0.35, True, 10.0, 4.0, 9876.0, 0.3, 0.0, 0.0, 0.0)
            curves = struct.pack("<I2f", 1, 0.0, 400.0) + struct.pack("<I3f", 1, 2.5, 0.5, 0.75) + struct.pack("<I2f", 1, 0.0, 1.0)
            out += records(15, [control + curves + struct.pack("<I", 4) + 4 * wheel])
        if idx == WEATHERED:
            out += records(24, [struct.pack("<14f", 77.0, 0, 0, 10.0, 200.0, 12.0, 0, 0.75, 0.1, 0, 1.0, 0.03, 0.03, 0)])
        out += packet(1, b"")
    with open(path, "wb") as file:
        file.write(out)
    return len(out)


def g(*numbers):
    """Numbers as C prints them; the file has them in single precision."""
    return "({}, {}, {})".format(*("%g" % struct.unpack("<f", struct.pack("<f", number))[0] for number in numbers))


def check_texts(client, scene):
    whole = client.show_recorder_file_info("theirs.log", True)
    lines = whole.splitlines()
    assert lines[:3] == ["Version: 1", "Map: Carla/Maps/Town10HD_Opt", "Date: 11/14/23 22:13:20"], lines[:3]
    assert lines[-2:] == [f"Frames: {N_FRAMES}", "Duration: 3.95 seconds"], lines[-2:]
    spot = scene.hero(1.0)
    for wanted in (
        "Frame 21 at 1 seconds",
        f" Create {VAN}: vehicle.volkswagen.t2 (1) at " + g(*(100.0 * metres for metres in (scene.at(50.0, 0.0).x, scene.at(50.0, 0.0).y, scene.at(50.0, 0.0).z))),
        f"  Id: {HERO} Location: {g(100.0 * spot.x, 100.0 * spot.y, 100.0 * spot.z)} Rotation: {g(0.0, 0.0, scene.yaw)}",
        f"  Id: {HERO} Steering: -0.125 Throttle: 0.625 Brake: 0 Handbrake: 0 Gear: 3",
        f"  Id: {WALKER} speed: 150",
        f"  Id: {HERO} LowBeam Fog",
        f" Parenting {GNSS} with {HERO} (parent)",
        f" Create {GNSS}: sensor.other.gnss (5) at (100, 50, 200)",
        f"  Id: {scene.lamp} enabled: True intensity: 4321 RGB_color: (1, 0.501961, 0)",
        f" Collision id 0 between {HERO} (hero)  with {VAN}",
        f" Destroy {VAN}",
        "   mass = 9876",
        '     Bone: "crl_arm__R" relative: Loc(10, 0, 20) Rot(77, 0, 0)',
    ):
        assert wanted in lines, wanted
    crashes = client.show_recorder_collisions("theirs.log", "h", "v").splitlines()
    assert [row.split() for row in crashes if "audi" in row] == [["2", "v", "v", str(HERO), "vehicle.audi.tt", str(VAN), "vehicle.volkswagen.t2"]], crashes
    blocked = client.show_recorder_actors_blocked("theirs.log", 2.0, 10.0)
    assert f"{VAN} vehicle.volkswagen.t2" in blocked and "audi" not in blocked, blocked


def check_replay(client, world, scene):
    """Everything is where the file says, tick by tick."""
    n_before = len(world.get_actors())
    said = client.replay_file("theirs.log", 0.0, 0.0, HERO, True, carla.Transform(carla.Location(x=-6.0, z=3.0)))
    assert "Total time recorded: 3.950\n" in said and "lacks them: vehicle.of.tomorrow (1)\n" in said and "traffic lights" not in said, said
    hero, worst_m, worst_walk_m, worst_view_m = None, 0.0, 0.0, 0.0
    for idx in range(N_FRAMES - 1):
        world.tick()
        if hero is None:
            made = {one.type_id: one for one in world.get_actors() if one.type_id.startswith(("vehicle.", "walker."))}
            hero, walker, van = (made[name] for name in ("vehicle.audi.tt", "walker.pedestrian.0005", "vehicle.volkswagen.t2"))
            assert hero.attributes["role_name"] == "hero" and hero.attributes["color"] == "10,20,30", hero.attributes
        secs = idx * STEP_SECS
        now, wanted = hero.get_transform(), scene.hero(secs)
        worst_m = max(worst_m, now.location.distance(wanted))
        assert abs((now.rotation.yaw - scene.yaw + 180.0) % 360.0 - 180.0) < 0.01, now.rotation
        at = walker.get_location()
        worst_walk_m = max(worst_walk_m, math.hypot(at.x - scene.walker(secs).x, at.y - scene.walker(secs).y))
        behind = carla.Location(x=-6.0, z=3.0)
        worst_view_m = max(worst_view_m, world.get_spectator().get_location().distance(now.transform(behind)))
        if idx > 2:
            control = hero.get_control()
            assert near(control.throttle, 0.625) and near(control.steer, -0.125), control
            assert near(hero.get_velocity().length(), SPEED_MPS, 0.05), hero.get_velocity()
        state = scene.light.get_state()
        if 2 < idx < 38 or idx > 42:
            assert state == (carla.TrafficLightState.Green if idx < 40 else carla.TrafficLightState.Red), (idx, state)
        if idx == LIT - 3:
            assert not int(hero.get_light_state()) & 0x82
        if idx == LIT + 3:
            assert int(hero.get_light_state()) & 0x82 == 0x82
        if idx == WEATHERED + 3:
            weather = world.get_weather()
            assert near(weather.cloudiness, 77.0) and near(weather.sun_altitude_angle, 12.0) and near(weather.sun_azimuth_angle, 200.0, 0.01), weather
        if idx == MOUNTED + 2:
            gnss = world.get_actors().filter("sensor.other.gnss")[0]
            assert gnss.parent.id == hero.id and gnss.attributes["noise_seed"] == "7"
            mount = carla.Location(x=1.0, y=0.5, z=2.0)
            assert gnss.get_location().distance(hero.get_transform().transform(mount)) < 0.5 * SPEED_MPS * STEP_SECS + 0.05
        if idx == GONE - 3:
            assert van.is_alive and world.get_actor(van.id) is not None
            lamps = world.get_lightmanager().get_all_lights(carla.LightGroup.Street)
            assert all(abs(lamp.intensity - 4321.0) > 1.0 for lamp in lamps), "lamps of another map are no lamps of this one"
            arm = {bone.name: bone.relative for bone in walker.get_bones().bone_transforms}["crl_arm__R"]
            assert hero.get_physics_control().mass < 5000.0, "vehicles keep their physics"
            assert not near(arm.rotation.roll, 77.0, 5.0), "bones of CARLA's walkers have other axes"
        if idx == GONE + 3:
            assert not world.get_actors().filter("vehicle.volkswagen.t2"), "the van is gone"
    print(f"within {worst_m:.4f} m of the file, the walker within {worst_walk_m:.4f} m, the spectator within {worst_view_m:.4f} m")
    assert worst_m < 0.005 and worst_walk_m < 0.02 and worst_view_m < 0.02, (worst_m, worst_walk_m, worst_view_m)
    client.stop_replayer(False)
    ticks(world, 2)
    assert len(world.get_actors()) == n_before, "what the replay made goes with it"


def check_part(client, world, scene):
    """From the second second on, half as fast; the spectator is taken along; the hero is not."""
    client.set_replayer_time_factor(0.5)
    client.set_replayer_ignore_hero(True)
    client.set_replayer_ignore_spectator(False)
    said = client.replay_file("theirs.log", 2.0, 1.0, 0, False)
    assert "Replaying from 2.000 s - 3.000 s (1.000 s) at 0.5x" in said, said
    for step in range(20):
        world.tick()
        height = world.get_spectator().get_location().z
        assert near(height, 40.0 + (2.0 + 0.5 * step * STEP_SECS) / STEP_SECS, 0.02), (step, height)
    assert not world.get_actors().filter("vehicle.audi.tt"), "the hero is left out"
    client.stop_replayer(False)
    client.set_replayer_time_factor(1.0)
    client.set_replayer_ignore_hero(False)
    client.set_replayer_ignore_spectator(True)
    ticks(world, 2)


def check_damaged(client, world, folder, scene):
    """Foreign and damaged files are sentences, and the world goes on."""
    with open(os.path.join(folder, "theirs.log"), "rb") as file:
        whole = file.read()

    def damaged(name, contents):
        with open(os.path.join(folder, name), "wb") as file:
            file.write(contents)
        return client.show_recorder_file_info(name, True), client.replay_file(name, 0.0, 0.0, 0, False)

    for name, contents, wanted in (
        ("empty.log", b"", "not a recording"),
        ("noise.log", bytes(range(256)) * 40, "not a recording"),
        ("newer.log", b"\x02" + whole[1:], "version 2 of CARLA's"),
        ("headless.log", whole[:40], "no frame"),
        ("huge.log", whole + packet(0, struct.pack("<Qdd", 99, 0.05, 9.0)) + struct.pack("<BI", 6, 0xFFFFFFFF), "frame 99 has more than"),
        ("broken.log", whole.replace(records(23, []), packet(6, b"\xff\xff")), "packet 6 of frame 1 is damaged"),
    ):
        for said in damaged(name, contents):
            assert wanted in said and name in said, (name, said)
    within_39th = whole.index(struct.pack("<BIQ", 0, 24, 39)) + 100
    info, said = damaged("cut.log", whole[:within_39th])
    assert "ends within a frame" in info and "ends within a frame" in said and "Total time recorded: 1.850" in said, (info[-200:], said)
    ticks(world, 3)
    assert world.get_actors().filter("vehicle.audi.tt")
    # The file is taken away and cut while it is being played.
    os.truncate(os.path.join(folder, "cut.log"), 100)
    ticks(world, N_FRAMES)
    client.stop_replayer(False)
    ticks(world, 2)
    os.mkfifo(os.path.join(folder, "pipe.log"))
    assert "not a file" in client.show_recorder_file_info("pipe.log", False)
    # Scripts of CARLA also call recordings so.
    os.rename(os.path.join(folder, "theirs.log"), os.path.join(folder, "theirs.rec"))
    assert f"Frames: {N_FRAMES}" in client.show_recorder_file_info("/some/folder/theirs.rec", False)
    write_log(os.path.join(folder, "elsewhere.log"), scene, "Carla/Maps/Town99")
    said = client.replay_file("elsewhere.log", 0.0, 0.0, 0, False)
    assert "Could not load mapfile Town99" in said and client.get_world().get_map().name.endswith("Town10HD"), said


def main():
    client, world = stage(PORT)
    folder = os.path.dirname(client.start_recorder("ours.log"))
    client.stop_recorder()
    scene = Scene(world)
    print(write_log(os.path.join(folder, "theirs.log"), scene, "Carla/Maps/Town10HD_Opt"), "bytes")
    check_texts(client, scene)
    passed("texts")
    check_replay(client, world, scene)
    passed("replay")
    check_part(client, world, scene)
    passed("part")
    check_damaged(client, world, folder, scene)
    passed("damaged")


run(main)
