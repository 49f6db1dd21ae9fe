"""Prints what the map code of the PyPI wheel carla makes of an OpenDRIVE text, as JSON lines. Run by `gantry map check`.

The text comes on standard input; angles are degrees, axes are CARLA's (y to the south)."""

import json
import math
import sys

import carla

SPACING_M = 2.0
ACROSS_EVERY = 10
ASK_EVERY_M = 11.0
# On CARLA's map there is no lane beyond this many from the middle.
MAX_LANES = 64


def key(waypoint):
    return [waypoint.road_id, waypoint.section_id, waypoint.lane_id]


def place(location):
    return [location.x, location.y, location.z]


def across(waypoint):
    """Every lane of the road here, other than the one asked from."""
    found = []
    for step in ("get_left_lane", "get_right_lane"):
        lane, same_way = waypoint, True
        for _ in range(MAX_LANES):
            # Beyond the middle left and right change places.
            name = step if same_way else ("get_right_lane" if step == "get_left_lane" else "get_left_lane")
            beside = getattr(lane, name)()
            if beside is None or beside.road_id != waypoint.road_id or beside.section_id != waypoint.section_id:
                break
            if beside.lane_id * lane.lane_id < 0:
                same_way = not same_way
            lane = beside
            found.append([*key(lane), str(lane.lane_type), lane.lane_width, lane.s])
    return found


def say(kind, value):
    sys.stdout.write(json.dumps({kind: value}) + "\n")


def main():
    world = carla.Map("map", sys.stdin.read())
    for number, waypoint in enumerate(world.generate_waypoints(SPACING_M)):
        transform = waypoint.transform
        if not all(map(math.isfinite, [*place(transform.location), transform.rotation.yaw])):
            # The client's own arithmetic gave up here.
            say("lost", key(waypoint))
            continue
        say(
            "waypoint",
            {
                "lane": key(waypoint),
                "s": waypoint.s,
                "at": place(transform.location),
                "yaw": transform.rotation.yaw,
                "width": waypoint.lane_width,
                "change": int(waypoint.lane_change),
                "junction": waypoint.junction_id if waypoint.is_junction else None,
            },
        )
        if number % ACROSS_EVERY == 0:
            for lane in across(waypoint):
                say("beside", {"lane": lane[:3], "type": lane[3], "width": lane[4], "s": lane[5]})
    for start, end in world.get_topology():
        say("edge", [key(start), key(end)])
    for landmark in world.get_all_landmarks():
        say("landmark", {"id": landmark.id, "name": landmark.name, "at": place(landmark.transform.location), "type": landmark.type, "value": landmark.value})
    for number, waypoint in enumerate(world.generate_waypoints(ASK_EVERY_M)):
        # A place beside the lane's middle: 0.7 m in a direction that turns from one to the next.
        location = waypoint.transform.location
        if not all(map(math.isfinite, place(location))):
            continue
        aside = carla.Vector3D(0.7, 0.0, 0.0)
        turned = carla.Transform(carla.Location(), carla.Rotation(yaw=57.3 * number)).transform(aside)
        point = carla.Location(location.x + turned.x, location.y + turned.y, location.z)
        try:
            nearest = world.get_waypoint(point)
        except RuntimeError:
            # The client's own search asserts on lanes that begin or end with no length.
            say("stumble", place(point))
            continue
        if nearest is not None:
            say("nearest", {"point": place(point), "lane": key(nearest), "s": nearest.s, "at": place(nearest.transform.location)})
    say("done", True)


main()
