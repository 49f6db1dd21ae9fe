"""A drive with the stock `carla` 0.9.16 wheel as CARLA's guides have them, to be recorded and run again: stepped by hand, a Traffic Manager's
cars, walkers with controllers, sensors, weather, pushes, teleports, batches.

    carla_run_again.py PORT TM_PORT TICKS MIDDLE_FILE

After half of the ticks it prints "half" and waits until MIDDLE_FILE is there. Prints "drive passed".
"""

import math
import os
import random
import sys
import time

import carla
from carla_kit import PATIENCE_SECS, passed, run, shut_down, stage, synchronous_manager

PORT, TM_PORT, N_TICKS, MIDDLE = int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4]

SENSORS = {
    "sensor.camera.rgb": {"image_size_x": "64", "image_size_y": "48"},
    "sensor.camera.dvs": {"image_size_x": "64", "image_size_y": "48"},
    "sensor.camera.instance_segmentation": {"image_size_x": "64", "image_size_y": "48", "sensor_tick": "0.1"},
    "sensor.lidar.ray_cast": {"channels": "8", "points_per_second": "4000", "rotation_frequency": "20"},
    "sensor.other.imu": {},
    "sensor.other.gnss": {},
    "sensor.other.collision": {},
    "sensor.other.radar": {"points_per_second": "300"},
}


def spawn_sensors(world, hero):
    """One of each kind on the hero, all listened to."""
    place, sensors = carla.Transform(carla.Location(x=0.6, z=1.8)), []
    for name, attributes in SENSORS.items():
        blueprint = world.get_blueprint_library().find(name)
        for key, value in attributes.items():
            blueprint.set_attribute(key, value)
        sensor = world.spawn_actor(blueprint, place, attach_to=hero)
        sensor.listen(lambda data: None)
        sensors.append(sensor)
    return sensors


def spawn_walkers(client, world, n):
    """Walkers with CARLA's controllers, as its own example makes them."""
    blueprints = world.get_blueprint_library()
    kinds = sorted(blueprints.filter("walker.pedestrian.*"), key=lambda kind: kind.id)
    walkers, controllers = [], []
    while len(walkers) < n:
        place = world.get_random_location_from_navigation()
        walker = world.try_spawn_actor(random.choice(kinds), carla.Transform(place))
        if walker is not None:
            walkers.append(walker)
    batch = [carla.command.SpawnActor(blueprints.find("controller.ai.walker"), carla.Transform(), walker) for walker in walkers]
    answers = client.apply_batch_sync(batch, False)
    world.tick()
    for answer in answers:
        assert not answer.error, answer.error
        controllers.append(world.get_actor(answer.actor_id))
    for controller in controllers:
        controller.start()
        controller.go_to_location(world.get_random_location_from_navigation())
        controller.set_max_speed(1.0 + random.random())
    return walkers, controllers


def act(world, hero, cars, walkers, tick):
    """What a script does to a world beside its Traffic Manager."""
    if tick % 20 == 3:
        weather = world.get_weather()
        weather.cloudiness, weather.precipitation = 50.0 + 40.0 * math.sin(tick), 30.0 + 29.0 * math.cos(tick)
        weather.sun_altitude_angle = 45.0 - tick / 3.0
        world.set_weather(weather)
    if tick % 15 == 5:
        cars[tick % len(cars)].add_impulse(carla.Vector3D(400.0 * math.cos(tick), 300.1, 1200.7))
    if tick == 30:
        hero.set_autopilot(False, TM_PORT)
    if 30 <= tick < 60:
        hero.apply_control(carla.VehicleControl(throttle=0.4 + 0.1 * math.sin(tick), steer=0.1 * math.cos(0.3 * tick)))
    if tick == 60:
        hero.set_transform(carla.Transform(hero.get_location() + carla.Location(z=0.4), hero.get_transform().rotation))
        hero.set_autopilot(True, TM_PORT)
    if tick == 40:
        walkers[0].blend_pose(0.3)
        world.debug.draw_box(carla.BoundingBox(hero.get_location(), carla.Vector3D(2, 1, 1)), hero.get_transform().rotation, life_time=0.7)
    if tick == 70:
        cars.pop().destroy()


def drive():
    random.seed(11)
    client, world = stage(PORT)
    manager = synchronous_manager(client, TM_PORT)
    manager.set_random_device_seed(5)
    points = world.get_map().get_spawn_points()
    random.shuffle(points)
    blueprints = sorted(world.get_blueprint_library().filter("vehicle.*"), key=lambda kind: kind.id)
    batch = [
        carla.command.SpawnActor(random.choice(blueprints), point).then(carla.command.SetAutopilot(carla.command.FutureActor, True, TM_PORT))
        for point in points[:8]
    ]
    answers = client.apply_batch_sync(batch, True)
    cars = [world.get_actor(answer.actor_id) for answer in answers if not answer.error]
    hero = cars.pop(0)
    sensors = spawn_sensors(world, hero)
    walkers, controllers = spawn_walkers(client, world, 4)
    for tick in range(N_TICKS):
        act(world, hero, cars, walkers, tick)
        if tick == N_TICKS // 2:
            print("half", flush=True)
            end = time.monotonic() + PATIENCE_SECS
            while not os.path.exists(MIDDLE):
                assert time.monotonic() < end, f"{MIDDLE} does not come"
                time.sleep(0.01)
        world.tick()
    for sensor in sensors:
        sensor.destroy()
    for controller in controllers:
        controller.stop()
    world.tick()
    client.apply_batch_sync([carla.command.DestroyActor(actor) for actor in cars + walkers], True)
    shut_down(manager)
    passed("drive")


run(drive)
