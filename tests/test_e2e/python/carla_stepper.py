"""A client of gantry-carla that steps the world a few times and then hangs, to be killed.

    carla_stepper.py PORT
"""

import sys
import time

import carla

client = carla.Client("127.0.0.1", int(sys.argv[1]))
client.set_timeout(20.0)
world = client.get_world()
settings = world.get_settings()
settings.synchronous_mode = True
settings.fixed_delta_seconds = 0.05
world.apply_settings(settings)
for _ in range(5):
    world.tick()
print("stepping")
time.sleep(600)
