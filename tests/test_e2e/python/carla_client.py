"""The stock `carla` 0.9.16 wheel against gantry-carla: looks round, steps, drives, and changes lights and weather.

    carla_client.py PORT TM_PORT    all themes but loading
    carla_client.py PORT            loading: the wheel can crash when a process that ran a Traffic Manager loads a map

Prints "NAME passed" per theme; the first thing that is not as it should be ends the script.
"""

import sys
import time

import carla
from carla_kit import PATIENCE_SECS, STEP_SECS, connect, near, passed, refused, run, run_checks, shut_down, step_by_hand, synchronous_manager, turn_deg

PORT = int(sys.argv[1])
TM_PORT = int(sys.argv[2]) if len(sys.argv) > 2 else None


def check_session(client, world):
    assert client.get_server_version() == client.get_client_version() == "0.9.16"
    town = world.get_map()
    assert town.name == "Carla/Maps/Town10HD", town.name
    assert any(name.endswith("/Town10HD") for name in client.get_available_maps())
    points = town.get_spawn_points()
    assert len(points) >= 150, len(points)
    for point in points[:40]:
        waypoint = town.get_waypoint(point.location)
        offset = waypoint.transform.location.distance_2d(point.location)
        assert offset < 0.5 and turn_deg(waypoint.transform.rotation.yaw, point.rotation.yaw) < 5.0, (point, waypoint)
    assert len(town.get_topology()) > 50
    library = world.get_blueprint_library()
    car = library.find("vehicle.tesla.model3")
    assert car.get_attribute("base_type").as_str() == "car" and int(car.get_attribute("number_of_wheels")) == 4
    assert len(library.filter("vehicle.*")) >= 8 and int(library.find("sensor.camera.rgb").get_attribute("image_size_x")) == 800


def check_settings(world):
    before = world.get_settings()
    assert not before.synchronous_mode and before.fixed_delta_seconds is None
    frame = world.wait_for_tick(PATIENCE_SECS).frame
    assert world.wait_for_tick(PATIENCE_SECS).frame > frame, "free-running mode runs by itself"
    step_by_hand(world)
    now = world.get_settings()
    assert now.synchronous_mode and near(now.fixed_delta_seconds, STEP_SECS)
    return before


def check_ticks(world):
    seen = []
    callback = world.on_tick(lambda snapshot: seen.append(snapshot.frame))
    first = world.tick()
    for n in range(1, 51):
        frame = world.tick()
        snapshot = world.get_snapshot()
        assert frame == first + n == snapshot.frame, (first, n, frame, snapshot.frame)
        assert near(snapshot.timestamp.delta_seconds, STEP_SECS, 1e-6)
    started = time.monotonic()
    time.sleep(0.3)
    assert world.get_snapshot().frame == frame, "nothing moves without a cue"
    # The client calls back in a thread of its own, whenever that gets to run.
    while len(seen) < 51:
        assert time.monotonic() - started < PATIENCE_SECS, seen
        time.sleep(0.01)
    world.remove_on_tick(callback)
    assert sorted(seen)[-50:] == list(range(first + 1, first + 51)), seen
    started = time.monotonic()
    for _ in range(100):
        world.tick()
    print(f"100 ticks in {time.monotonic() - started:.3f} s")


def check_spectator(world):
    spectator = world.get_spectator()
    for pitch, yaw, roll in ((-10.0, 20.0, 0.0), (35.0, -140.0, 15.0)):
        wanted = carla.Transform(carla.Location(1.0, 2.0, 30.0), carla.Rotation(pitch, yaw, roll))
        spectator.set_transform(wanted)
        world.tick()
        is_at = spectator.get_transform()
        assert is_at.location.distance(wanted.location) < 1e-3, is_at
        for part in ("pitch", "yaw", "roll"):
            assert near(getattr(is_at.rotation, part), getattr(wanted.rotation, part), 1e-3), is_at
        assert is_at.get_forward_vector().distance(wanted.get_forward_vector()) < 1e-4


def check_weather(world):
    weather = carla.WeatherParameters(cloudiness=70.0, precipitation=30.0, sun_azimuth_angle=250.0, sun_altitude_angle=12.0)
    world.set_weather(weather)
    back = world.get_weather()
    for field, value in (("cloudiness", 70.0), ("precipitation", 30.0), ("sun_azimuth_angle", 250.0), ("sun_altitude_angle", 12.0)):
        assert near(getattr(back, field), value), (field, back)
    world.set_weather(carla.WeatherParameters.Default)
    assert world.get_weather().sun_altitude_angle > 10.0, "the map's own weather is a day's"
    world.set_weather(carla.WeatherParameters.ClearNoon)


def free_point(world, car):
    """A spawn point where the car fits, and the car."""
    for point in world.get_map().get_spawn_points():
        actor = world.try_spawn_actor(car, point)
        if actor is not None:
            return point, actor
    raise AssertionError("no spawn point is free")


def check_vehicle(world):
    car = world.get_blueprint_library().find("vehicle.tesla.model3")
    car.set_attribute("color", "0,0,255")
    car.set_attribute("role_name", "hero")
    point, actor = free_point(world, car)
    assert isinstance(actor, carla.Vehicle) and actor.attributes["color"] == "0,0,255" and actor.attributes["role_name"] == "hero"
    assert 2.2 < actor.bounding_box.extent.x < 2.6 and list(actor.semantic_tags) == [14]
    assert world.try_spawn_actor(car, point) is None, "the place is taken"
    refused(lambda: world.spawn_actor(car, point), "collision at spawn position")
    world.tick()
    there = world.get_actor(actor.id)
    assert there.type_id == "vehicle.tesla.model3" and there.attributes["role_name"] == "hero"
    assert actor.get_transform().location.distance(point.location) < 0.6 and turn_deg(actor.get_transform().rotation.yaw, point.rotation.yaw) < 1.0
    for _ in range(20):
        world.tick()
    check_driving(world, actor)
    check_moves(world, actor, point)
    actor.set_light_state(carla.VehicleLightState(carla.VehicleLightState.LowBeam | carla.VehicleLightState.LeftBlinker))
    world.tick()
    wanted = int(carla.VehicleLightState.LowBeam) | int(carla.VehicleLightState.LeftBlinker)
    assert int(actor.get_light_state()) == wanted, actor.get_light_state()
    assert int(dict(world.get_vehicles_light_states())[actor.id]) == wanted, world.get_vehicles_light_states()
    assert actor.destroy()
    world.tick()
    assert actor.id not in [other.id for other in world.get_actors()]
    assert not actor.is_alive


def check_driving(world, actor):
    start = actor.get_transform()
    actor.apply_control(carla.VehicleControl(throttle=0.6))
    for _ in range(40):
        world.tick()
    control = actor.get_control()
    assert near(control.throttle, 0.6) and control.gear >= 1, control
    moved = actor.get_location() - start.location
    ahead = moved.dot(start.get_forward_vector())
    assert ahead > 2.0 and actor.get_velocity().length() > 2.0, (moved, actor.get_velocity())
    assert actor.get_velocity().dot(actor.get_transform().get_forward_vector()) > 2.0
    yaw = actor.get_transform().rotation.yaw
    actor.apply_control(carla.VehicleControl(throttle=0.3, steer=0.3))
    for _ in range(10):
        world.tick()
    turned = (actor.get_transform().rotation.yaw - yaw + 180.0) % 360.0 - 180.0
    assert turned > 0.5, "steering to the right raises the yaw"
    assert actor.get_angular_velocity().z > 0.0 and near(actor.get_control().steer, 0.3)
    actor.apply_control(carla.VehicleControl(brake=1.0))
    for _ in range(80):
        world.tick()
    assert actor.get_velocity().length() < 0.1


def check_moves(world, actor, point):
    raised = carla.Transform(point.location + carla.Location(z=0.2), point.rotation)
    actor.set_transform(raised)
    world.tick()
    assert actor.get_location().distance_2d(point.location) < 0.3
    for _ in range(20):
        world.tick()
    actor.apply_control(carla.VehicleControl())
    forward = point.get_forward_vector()
    actor.set_target_velocity(forward * 6.0)
    world.tick()
    velocity = actor.get_velocity()
    assert near(velocity.dot(forward), 6.0, 0.6), velocity


def check_batch(client, world):
    library = world.get_blueprint_library()
    car = library.find("vehicle.audi.tt") if library.filter("vehicle.audi.tt") else library.find("vehicle.tesla.model3")
    commands = carla.command
    points = world.get_map().get_spawn_points()
    brake = carla.VehicleControl(brake=1.0, hand_brake=True)
    jobs = [commands.SpawnActor(car, point).then(commands.ApplyVehicleControl(commands.FutureActor, brake)) for point in points[:60:10]]
    jobs.append(commands.SpawnActor(car, carla.Transform(points[0].location, points[0].rotation)))
    jobs.append(commands.DestroyActor(4_000_000))
    answers = client.apply_batch_sync(jobs, True)
    ids = [answer.actor_id for answer in answers if not answer.error]
    assert len(ids) >= 3 and len(answers) == len(jobs), [answer.error for answer in answers]
    assert "collision" in answers[-2].error and "4000000" in answers[-1].error, [answer.error for answer in answers]
    # Controls go to the simulator with the next step.
    world.tick()
    for actor in world.get_actors(ids):
        assert actor.get_control().hand_brake and near(actor.get_control().brake, 1.0), actor.get_control()
    assert all(not answer.error for answer in client.apply_batch_sync([commands.DestroyActor(i) for i in ids], True))
    # Known by its number at once, although no snapshot has it before the next step.
    born, short_lived = (answer.actor_id for answer in client.apply_batch_sync([commands.SpawnActor(car, points[i]) for i in (5, 15)], False))
    assert world.get_actor(born).type_id == car.id and world.get_actor(born).get_physics_control().wheels
    assert [actor.id for actor in world.get_actors([born])] == [born]
    client.apply_batch_sync([commands.DestroyActor(short_lived)], True)
    assert world.get_actor(short_lived) is None and len(world.get_actors([short_lived, born])) == 1
    client.apply_batch_sync([commands.DestroyActor(born)], True)


def check_lights(world):
    lights = list(world.get_actors().filter("traffic.traffic_light"))
    assert lights
    light = lights[0]
    assert light.get_opendrive_id() and light.get_green_time() > 0.0
    assert light.id in [other.id for other in light.get_group_traffic_lights()]
    for state in (carla.TrafficLightState.Green, carla.TrafficLightState.Red):
        light.freeze(True)
        light.set_state(state)
        for _ in range(3):
            world.tick()
        assert light.get_state() == state and light.is_frozen()
    light.freeze(False)
    world.tick()
    assert not light.is_frozen()
    landmarks = [mark for mark in world.get_map().get_all_landmarks_of_type("1000001") if mark.id == light.get_opendrive_id()]
    assert landmarks and world.get_traffic_light(landmarks[0]).id == light.id


def check_autopilot(client, world):
    manager = synchronous_manager(client, TM_PORT)
    manager.set_random_device_seed(7)
    car = world.get_blueprint_library().find("vehicle.tesla.model3")
    cars = []
    for point in world.get_map().get_spawn_points()[:60:12]:
        actor = world.try_spawn_actor(car, point)
        if actor is not None:
            cars.append(actor)
    assert len(cars) >= 4
    world.tick()
    for actor in cars:
        actor.set_autopilot(True, TM_PORT)
    starts = [actor.get_location() for actor in cars]
    driven, worst = [0.0] * len(cars), 0.0
    # At least 15 s; more if the lights happen to be red.
    for step in range(900):
        if step >= 300 and sum(d > 10.0 for d in driven) >= 3:
            break
        world.tick()
        for i, actor in enumerate(cars):
            driven[i] += actor.get_location().distance(starts[i])
            starts[i] = actor.get_location()
            waypoint = world.get_map().get_waypoint(starts[i])
            worst = max(worst, waypoint.transform.location.distance_2d(starts[i]))
    print(f"{step * STEP_SECS:.0f} s of the client's own Traffic Manager: {[round(d) for d in driven]} m, at most {worst:.2f} m off the lane's middle")
    assert sum(d > 10.0 for d in driven) >= 3, driven
    assert worst < 2.0, worst
    shut_down(manager)
    for actor in cars:
        actor.destroy()
    world.tick()


def check_loading(client, world):
    car = world.get_blueprint_library().find("vehicle.tesla.model3")
    free_point(world, car)
    world.tick()
    before, n_actors = world.id, len(world.get_actors())
    again = client.reload_world(False)
    assert again.id != before and again.get_settings().synchronous_mode
    again.tick()
    assert len(again.get_actors()) == n_actors - 1 and again.get_map().name == "Carla/Maps/Town10HD"
    other = client.load_world("Town10HD_Opt")
    assert other.id != again.id and not other.get_settings().synchronous_mode, "loading resets the settings"
    check_settings(other)
    other.tick()
    second = carla.Client("127.0.0.1", PORT)
    second.set_timeout(PATIENCE_SECS)
    theirs = second.get_world()
    frame = theirs.tick()
    assert theirs.get_snapshot().frame == frame, "any client may step"
    return other


def check_sentences(client, world):
    camera = world.get_blueprint_library().find("sensor.camera.rgb")
    camera.set_attribute("image_size_x", "5000")
    refused(lambda: world.spawn_actor(camera, carla.Transform()), "width_px is 5000", "16 to 4096")
    refused(lambda: client.load_world("Nowhere"), "Nowhere", "not found")


def main():
    client = connect(PORT)
    world = client.get_world()
    if TM_PORT is None:
        check_settings(world)
        check_loading(client, world)
        passed("loading")
        return
    check_session(client, world)
    passed("session")
    before = check_settings(world)
    passed("settings")
    checks = {
        "ticks": lambda: check_ticks(world),
        "spectator": lambda: check_spectator(world),
        "weather": lambda: check_weather(world),
        "vehicle": lambda: check_vehicle(world),
        "batch": lambda: check_batch(client, world),
        "lights": lambda: check_lights(world),
        "autopilot": lambda: check_autopilot(client, world),
        "sentences": lambda: check_sentences(client, world),
    }
    run_checks(checks)
    world.apply_settings(before)
    assert not world.get_settings().synchronous_mode
    frame = world.wait_for_tick(PATIENCE_SECS).frame
    assert world.wait_for_tick(PATIENCE_SECS).frame > frame
    passed("restore")


run(main)
