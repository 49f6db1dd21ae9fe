"""A client of gantry-carla that steps the world a few times and then hangs, to be killed.

    carla_stepper.py PORT
"""

import sys
import time

from carla_kit import connect, step_by_hand

client = connect(sys.argv[1])
world = client.get_world()
step_by_hand(world)
for _ in range(5):
    world.tick()
print("stepping")
time.sleep(600)
