"""Drives a car on each of two servers, which know nothing of each other. Arguments: two ports."""

import sys

from carla_kit import connect, passed, speed, stage, ticks

PORTS = sys.argv[1:3]
TOWNS = ["Town02", "Town01"]

clients = [connect(port) for port in PORTS]
worlds = [client.get_world() for client in clients]
for world, town in zip(worlds, TOWNS):
    assert world.get_map().name.endswith(town), world.get_map().name
stages = [stage(port) for port in PORTS]
ids = []
for _, world in stages:
    blueprint = world.get_blueprint_library().find("vehicle.tesla.model3")
    blueprint.set_attribute("role_name", "hero")
    car = world.spawn_actor(blueprint, world.get_map().get_spawn_points()[0])
    world.tick()
    ids.append(car.id)
for _, world in stages:
    assert len(world.get_actors().filter("vehicle.*")) == 1
passed("two worlds")

cars = [world.get_actor(idx) for (_, world), idx in zip(stages, ids)]
control = type(cars[0].get_control())(throttle=0.8)
cars[0].apply_control(control)
for _, world in stages:
    ticks(world, 60)
assert speed(cars[0]) > 3.0, speed(cars[0])
assert speed(cars[1]) < 0.1, speed(cars[1])
for car, (_, world) in zip(cars, stages):
    assert car.destroy()
    world.tick()
    settings = world.get_settings()
    settings.synchronous_mode = False
    settings.fixed_delta_seconds = None
    world.apply_settings(settings)
passed("driving apart")
