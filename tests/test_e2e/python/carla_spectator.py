"""The stock client moves the spectator to the camera that hangs in the town, and writes and draws into its picture, clears that, or lets
it show the numbers of a vehicle."""

import math
import sys

import carla

from carla_kit import Wire, connect, passed, run

PORT = sys.argv[1]
# A command of a batch whose class the package itself does not take.
SHOW_DEBUG_TELEMETRY = 17
MAGENTA = carla.Color(255, 0, 255)


def place(pose, forward, up):
    pitch, yaw = math.radians(pose.rotation.pitch), math.radians(pose.rotation.yaw)
    ahead, above = forward * math.cos(pitch) - up * math.sin(pitch), forward * math.sin(pitch) + up * math.cos(pitch)
    x, y = pose.location.x + ahead * math.cos(yaw), pose.location.y + ahead * math.sin(yaw)
    return carla.Location(x, y, pose.location.z + above)


def main():
    world = connect(PORT).get_world()
    world.tick()
    match sys.argv[2:]:
        case ["clear"]:
            world.debug.clear_debug_string()
            world.debug.clear_debug_shape()
            # Calls without an answer are carried out before one with an answer returns.
            world.get_weather()
            passed("cleared")
            return
        case ["telemetry"]:
            # Under the ground nothing is white.
            world.get_spectator().set_location(carla.Location(0.0, 0.0, -50.0))
            world.tick()
            passed("below")
            world.get_actors().filter("vehicle.*")[0].show_debug_telemetry(True)
            world.get_weather()
            passed("shown")
            return
        case ["batch", shown]:
            car = world.get_actors().filter("vehicle.*")[0]
            Wire(PORT).batch((SHOW_DEBUG_TELEMETRY, [car.id, shown == "shown"]))
            passed(shown)
            return
    # 300 m up, looking 30 degrees down to the left; CARLA's pitch is positive upwards, its y to the right.
    pose = carla.Transform(carla.Location(0.0, 0.0, 300.0), carla.Rotation(pitch=-30.0, yaw=-90.0))
    spectator = world.get_spectator()
    spectator.set_transform(pose)
    world.tick()
    seen = world.get_spectator().get_transform()
    assert seen.location.distance(pose.location) < 1e-3 and abs(seen.rotation.pitch + 30.0) < 1e-3, seen
    world.debug.draw_string(place(pose, 5.0, 1.0), "Gantry", True, MAGENTA, 1000.0)
    world.debug.draw_hud_line(place(pose, 10.0, -2.0), place(pose, 10.0, 2.0), 3.0, MAGENTA, 1000.0)
    world.get_weather()
    passed("drawn")


run(main)
