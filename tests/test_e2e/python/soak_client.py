"""One visit of a stock client during a soak: weather, a car with sensors, a CARLA recording, and now and then another map.

    soak_client.py PORT SEED MAP [hang]

With MAP a name the map is loaded, with "-" the world stays. With `hang` the visit ends by waiting to be killed, its sensors listening.
"""

import os
import random
import sys
import time

import carla
from carla_kit import connect

SENSORS = (
    ("sensor.camera.rgb", {"image_size_x": "64", "image_size_y": "48"}),
    ("sensor.camera.depth", {"image_size_x": "64", "image_size_y": "48"}),
    ("sensor.lidar.ray_cast", {"channels": "4", "points_per_second": "4000"}),
    ("sensor.other.imu", {}),
    ("sensor.other.collision", {}),
)
FRAMES_WANTED = 3

client = connect(sys.argv[1], timeout_secs=120.0)
dice = random.Random(int(sys.argv[2]))
world = client.get_world() if sys.argv[3] == "-" else client.load_world(sys.argv[3])
world.set_weather(carla.WeatherParameters(
    cloudiness=dice.uniform(0.0, 100.0), precipitation=dice.uniform(0.0, 100.0), fog_density=dice.uniform(0.0, 60.0), sun_altitude_angle=dice.uniform(-30.0, 80.0)))
client.start_recorder(f"soak_{sys.argv[2]}.log", True)
library = world.get_blueprint_library()
cars = library.filter("vehicle.*")
points = world.get_map().get_spawn_points()
car = next(made for _ in range(50) if (made := world.try_spawn_actor(dice.choice(cars), dice.choice(points))))
car.apply_control(carla.VehicleControl(throttle=0.4))
seen, sensors = {}, []


def count(name):
    def look(_data):
        seen[name] = seen.get(name, 0) + 1

    return look


for name, attributes in SENSORS:
    blueprint = library.find(name)
    for key, value in attributes.items():
        blueprint.set_attribute(key, value)
    sensors.append(world.spawn_actor(blueprint, carla.Transform(carla.Location(x=0.5, z=2.2)), attach_to=car))
    sensors[-1].listen(count(name))
wanted = [name for name, _ in SENSORS if name != "sensor.other.collision"]
deadline = time.monotonic() + 120.0
while any(seen.get(name, 0) < FRAMES_WANTED for name in wanted):
    assert time.monotonic() < deadline, seen
    time.sleep(0.05)
print("seen", flush=True)
if "hang" in sys.argv:
    time.sleep(1e6)
for sensor in sensors:
    sensor.stop()
client.stop_recorder()
client.apply_batch_sync([carla.command.DestroyActor(made) for made in [*sensors, car]])
print("visit passed", flush=True)
# The client's own threads are not joined when Python ends, which sometimes ends in std::terminate.
os._exit(0)
