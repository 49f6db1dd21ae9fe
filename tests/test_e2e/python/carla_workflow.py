"""The first steps of a CARLA session with the stock `carla` 0.9.16 wheel against gantry-carla, as CARLA's own guides go about them.

    carla_workflow.py PORT TM_PORT

Prints "NAME passed" per theme; the first thing that is not as it should be ends the script.
"""

import queue
import random
import sys
import time

import carla
import numpy as np
from carla_kit import PATIENCE_SECS, STEP_SECS, passed, run, shut_down, synchronous_manager

PORT, TM_PORT = int(sys.argv[1]), int(sys.argv[2])


def check_connection():
    """A client with a time-out, and the world."""
    client = carla.Client("localhost", PORT)
    client.set_timeout(PATIENCE_SECS)
    assert client.get_server_version() == "0.9.16"
    return client, client.get_world()


def check_settings(world):
    """Synchronous mode with a fixed step and substepping; what was there is kept to be restored."""
    original = world.get_settings()
    settings = world.get_settings()
    settings.synchronous_mode = True
    settings.fixed_delta_seconds = STEP_SECS
    settings.substepping = True
    settings.max_substep_delta_time = 0.01
    settings.max_substeps = 10
    settings.tile_stream_distance, settings.actor_active_distance, settings.spectator_as_ego = 650.0, 640.0, False
    world.apply_settings(settings)
    now = world.get_settings()
    assert (now.tile_stream_distance, now.actor_active_distance, now.spectator_as_ego) == (650.0, 640.0, False)
    assert now.synchronous_mode and abs(now.fixed_delta_seconds - STEP_SECS) < 1e-9 and now.substepping
    assert (now.max_substep_delta_time, now.max_substeps) == (0.01, 10)
    return original


def check_maps(client):
    """The maps that are listed can be loaded, and loading removes all actors and resets the settings."""
    names = client.get_available_maps()
    assert any(name.endswith("/Town10HD") for name in names), names
    world = client.get_world()
    model = world.get_blueprint_library().find("vehicle.tesla.model3")
    assert any(world.try_spawn_actor(model, point) for point in world.get_map().get_spawn_points())
    n_before = len(world.get_actors().filter("vehicle.*"))
    world.tick()
    assert len(world.get_actors().filter("vehicle.*")) == n_before + (n_before == 1)
    client.set_timeout(PATIENCE_SECS)
    loaded = client.load_world("Town10HD")
    assert loaded.id != world.id and not loaded.get_settings().synchronous_mode
    assert len(loaded.get_actors().filter("vehicle.*")) == 1, "the launch file's own"
    return loaded


def check_layers(client):
    """A map loaded with some of its layers; one that is taken out and put back."""
    world = client.load_world("Town10HD_Opt", map_layers=carla.MapLayer.Buildings)

    def n_shown(label):
        return len(world.get_level_bbs(label))

    assert n_shown(carla.CityObjectLabel.Buildings) > 10 and n_shown(carla.CityObjectLabel.Vegetation) == 0
    world.unload_map_layer(carla.MapLayer.Buildings)
    world.wait_for_tick()
    assert n_shown(carla.CityObjectLabel.Buildings) == 0
    world.load_map_layer(carla.MapLayer.All)
    world.wait_for_tick()
    assert n_shown(carla.CityObjectLabel.Buildings) > 10 and n_shown(carla.CityObjectLabel.Vegetation) > 10


def check_generated(client):
    """A world from an OpenDRIVE text with every parameter of its generation; cars stand on it."""
    town = client.load_world("Town02").get_map()
    parameters = carla.OpendriveGenerationParameters(
        vertex_distance=2.0, max_road_length=50.0, wall_height=1.0, additional_width=0.6, smooth_junctions=True, enable_mesh_visibility=True
    )
    world = client.generate_opendrive_world(town.to_opendrive(), parameters)
    assert world.get_map().name.endswith("OpenDriveMap"), world.get_map().name
    assert len(world.get_map().get_topology()) == len(town.get_topology())
    place = town.generate_waypoints(20.0)[3].transform
    place.location.z += 0.5
    car = world.try_spawn_actor(world.get_blueprint_library().find("vehicle.audi.tt"), place)
    assert car is not None
    for _ in range(30):
        world.wait_for_tick()
    assert abs(car.get_location().z - place.location.z + 0.5) < 0.3, (car.get_location(), place)


def check_blueprints(world):
    """Wildcards, tags and attributes."""
    library = world.get_blueprint_library()
    vehicles = library.filter("vehicle.*")
    assert len(vehicles) > 5 and all(bp.id.startswith("vehicle.") for bp in vehicles)
    cameras = {bp.id.split(".")[-1] for bp in library.filter("camera")}
    assert {"rgb", "semantic_segmentation", "instance_segmentation", "depth", "dvs", "optical_flow"} <= cameras, cameras
    assert {bp.id for bp in library.filter("sensor.lidar.*")} == {"sensor.lidar.ray_cast", "sensor.lidar.ray_cast_semantic"}
    car = library.find("vehicle.tesla.model3")
    assert car.has_attribute("color") and car.get_attribute("number_of_wheels").as_int() == 4 and car.has_tag("model3")
    car.set_attribute("color", random.choice(car.get_attribute("color").recommended_values))
    car.set_attribute("role_name", "hero")
    return car


def check_ego(world, blueprint):
    """A hero at a spawn point; where one stands already, None; the spectator behind it."""
    points = world.get_map().get_spawn_points()
    ego = next(filter(None, (world.try_spawn_actor(blueprint, point) for point in points)))
    world.tick()
    taken = ego.get_transform()
    taken.location.z += 0.3
    assert world.try_spawn_actor(blueprint, taken) is None
    behind = ego.get_transform().transform(carla.Location(x=-4.0, z=2.5))
    world.get_spectator().set_transform(carla.Transform(behind, ego.get_transform().rotation))
    world.tick()
    assert world.get_spectator().get_location().distance(behind) < 0.01
    assert ego.attributes["role_name"] == "hero"
    return ego


def check_sensors(world, ego):
    """Six cameras, lidar, GNSS and IMU on the ego vehicle, each read as CARLA's guides do."""
    library = world.get_blueprint_library()
    place = carla.Transform(carla.Location(x=-5, z=3), carla.Rotation(pitch=-20))
    names = ("rgb", "semantic_segmentation", "instance_segmentation", "depth", "dvs", "optical_flow")
    queues, sensors = {}, []
    for name in (*("camera." + name for name in names), "lidar.ray_cast", "other.gnss", "other.imu", "other.radar"):
        blueprint = library.find("sensor." + name)
        if name.startswith("camera."):
            blueprint.set_attribute("image_size_x", "80")
            blueprint.set_attribute("image_size_y", "60")
        if name == "other.gnss":
            blueprint.set_attribute("sensor_tick", "0.1")
        sensor = world.spawn_actor(blueprint, place, attach_to=ego, attachment_type=carla.AttachmentType.Rigid)
        queues[name] = queue.Queue()
        sensor.listen(queues[name].put)
        sensors.append(sensor)
    ego.apply_control(carla.VehicleControl(throttle=0.6))
    for n in range(8):
        frame = world.tick()
        data = {name: q.get(timeout=PATIENCE_SECS) for name, q in queues.items() if name not in ("camera.dvs", "other.gnss")}
        assert all(message.frame == frame for message in data.values()), (frame, data)
    fixes = [queues["other.gnss"].get(timeout=PATIENCE_SECS).frame for _ in range(4)]
    assert fixes == list(range(fixes[0], fixes[0] + 8, 2)) and fixes[-1] <= frame and queues["other.gnss"].empty(), ("every other step", fixes, frame)
    image = data["camera.rgb"]
    assert np.reshape(np.copy(image.raw_data), (image.height, image.width, 4)).shape == (60, 80, 4)
    data["camera.semantic_segmentation"].convert(carla.ColorConverter.CityScapesPalette)
    data["camera.depth"].convert(carla.ColorConverter.LogarithmicDepth)
    events = queues["camera.dvs"].get(timeout=PATIENCE_SECS)
    dvs = np.frombuffer(events.raw_data, dtype=np.dtype([("x", np.uint16), ("y", np.uint16), ("t", np.int64), ("pol", np.bool_)]))
    picture = np.zeros((events.height, events.width, 4), dtype=np.uint8)
    picture[dvs[:]["y"], dvs[:]["x"], dvs[:]["pol"] * 2] = 255
    assert picture.any()
    flow = data["camera.optical_flow"].get_color_coded_flow()
    assert np.frombuffer(flow.raw_data, dtype=np.uint8).size == 60 * 80 * 4
    assert len(data["lidar.ray_cast"]) > 0
    for sensor in sensors:
        sensor.stop()
        sensor.destroy()


def check_manual_control(world, ego):
    """Control that holds until it is replaced."""
    start = ego.get_location()
    for _ in range(30):
        ego.apply_control(carla.VehicleControl(throttle=0.7, steer=0.0))
        world.tick()
    assert ego.get_location().distance(start) > 1.0
    ego.apply_control(carla.VehicleControl(brake=1.0))
    for _ in range(40):
        world.tick()
    assert ego.get_velocity().length() < 0.5


def check_traffic_manager(client, world, ego):
    """Autopilot with a share of lights ignored, a path of its own for one car, hybrid physics round the hero."""
    manager = synchronous_manager(client, TM_PORT)
    manager.set_random_device_seed(0)
    random.seed(0)
    points = world.get_map().get_spawn_points()
    model = world.get_blueprint_library().find("vehicle.tesla.model3")
    cars = [actor for actor in (world.try_spawn_actor(model, point) for point in random.sample(points, 10)) if actor]
    world.tick()
    for car in (*cars, ego):
        car.set_autopilot(True, TM_PORT)
        manager.ignore_lights_percentage(car, random.randint(0, 50))
    route = [waypoint.transform.location for waypoint in path_ahead(world, cars[0], 60.0)]
    manager.set_path(cars[0], route)
    manager.set_hybrid_physics_mode(True)
    manager.set_hybrid_physics_radius(70.0)
    starts = [car.get_location() for car in cars]
    # Whether paths, lights and the hybrid mode are kept to is a matter of `carla_traffic.py`.
    for _ in range(400):
        world.tick()
        if sum(car.get_location().distance(at) > 10.0 for car, at in zip(cars, starts)) >= 5:
            break
    moved = [car.get_location().distance(at) for car, at in zip(cars, starts)]
    assert sum(metres > 10.0 for metres in moved) >= len(cars) // 2, moved
    shut_down(manager)
    for car in (*cars, ego):
        car.destroy()


def path_ahead(world, car, metres):
    """Waypoints every 5 m, always the first way at a fork."""
    at = world.get_map().get_waypoint(car.get_location())
    for _ in range(int(metres / 5.0)):
        following = at.next(5.0)
        if not following:
            return
        at = following[0]
        yield at


def main():
    client, world = check_connection()
    passed("connection")
    check_settings(world)
    passed("settings")
    world = check_maps(client)
    passed("maps")
    check_layers(client)
    passed("layers")
    check_generated(client)
    passed("generated world")
    world = client.load_world("Town10HD")
    original = check_settings(world)
    blueprint = check_blueprints(world)
    passed("blueprints")
    ego = check_ego(world, blueprint)
    passed("ego")
    check_sensors(world, ego)
    passed("sensors")
    check_manual_control(world, ego)
    passed("manual control")
    started = time.monotonic()
    check_traffic_manager(client, world, ego)
    print(f"traffic manager passed in {time.monotonic() - started:.1f} s")
    world.apply_settings(original)
    assert not world.get_settings().synchronous_mode
    passed("restoring")


run(main)
