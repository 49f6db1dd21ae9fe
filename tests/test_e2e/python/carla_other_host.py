"""The stock `carla` 0.9.16 wheel from another machine: connects, steps and looks.

    carla_other_host.py HOST PORT

By hand: `tests/test_e2e/other_host.sh` gives it a machine of its own.
"""

import queue
import sys
import time

import carla
from carla_kit import connect, passed, run, step_by_hand

HOST, PORT = sys.argv[1], int(sys.argv[2])


def main():
    client = connect(PORT, HOST)
    print(f"server {client.get_server_version()}, client {client.get_client_version()}")
    world = client.get_world()
    step_by_hand(world)
    library = world.get_blueprint_library()
    places = world.get_map().get_spawn_points()
    car = next(filter(None, (world.try_spawn_actor(library.find("vehicle.tesla.model3"), place) for place in places)))
    blueprint = library.find("sensor.camera.rgb")
    blueprint.set_attribute("image_size_x", "320")
    blueprint.set_attribute("image_size_y", "240")
    camera = world.spawn_actor(blueprint, carla.Transform(carla.Location(x=1.5, z=2.0)), attach_to=car)
    images = queue.Queue()
    camera.listen(images.put)
    began = time.monotonic()
    for _ in range(40):
        car.apply_control(carla.VehicleControl(throttle=0.5))
        tick = world.tick()
        image = images.get(timeout=30.0)
        assert image.frame == tick and len(bytes(image.raw_data)) == 320 * 240 * 4
    moved = car.get_velocity()
    print(f"40 steps with a camera in {time.monotonic() - began:.1f} s; the car goes {moved.length():.1f} m/s")
    assert moved.length() > 1.0
    passed("other host")


run(main)
