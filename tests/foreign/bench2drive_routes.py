#!/usr/bin/env python3
"""Writes routes for Bench2Drive's evaluator that put its scenario types onto maps on which its own 220 routes do not have them.

    tests/foreign/bench2drive_routes.py MAPS OUT.xml --per-type 4

MAPS is a folder with CARLA's `Town*.xodr`. A place is searched for each type by what its code asks of the road: a turn at a junction
with or without lights, a curve beside an oncoming lane, a straight with a lane beside it. Towns take turns. Needs the package carla.
"""

import argparse
import itertools
import math
import pathlib
import xml.etree.ElementTree as ElementTree

import carla

STEP_M, BEFORE_M, AFTER_M = 2.0, 40.0, 45.0
# Type: (manoeuvre at the junction, kind of junction, parameters).
TURNS = {
    "SignalizedJunctionLeftTurn": ("left", "lights", {"flow_speed": 8, "source_dist_interval": (20, 35)}),
    "SignalizedJunctionRightTurn": ("right", "lights", {"flow_speed": 8, "source_dist_interval": (20, 35)}),
    "NonSignalizedJunctionLeftTurn": ("left", "none", {"flow_speed": 8, "source_dist_interval": (20, 35)}),
    "NonSignalizedJunctionRightTurn": ("right", "none", {"flow_speed": 8, "source_dist_interval": (20, 35)}),
    "OppositeVehicleRunningRedLight": ("straight", "lights", {"direction": "left"}),
    "OppositeVehicleTakingPriority": ("straight", "none", {"direction": "left"}),
    "VehicleTurningRoute": ("right", "any", {}),
    "VehicleTurningRoutePedestrian": ("right", "any", {}),
    "VanillaSignalizedTurnEncounterGreenLight": ("left", "lights", {}),
    "VanillaSignalizedTurnEncounterRedLight": ("left", "lights", {}),
    "VanillaNonSignalizedTurn": ("left", "none", {}),
    "VanillaNonSignalizedTurnEncounterStopsign": ("right", "stop", {}),
    "T_Junction": ("left", "any", {}),
    "BlockedIntersection": ("right", "any", {}),
    "InterurbanActorFlow": ("left", "flow", {"flow_speed": 12, "source_dist_interval": (35, 60)}),
    "InterurbanAdvancedActorFlow": ("left", "flow2", {"flow_speed": 12, "source_dist_interval": (40, 70)}),
}
# Type: (lane beside the route, parameters).
STRAIGHTS = {
    "ConstructionObstacleTwoWays": ("oncoming", {"distance": 60, "frequency": (60, 100)}),
    "AccidentTwoWays": ("oncoming", {"distance": 60, "frequency": (60, 100)}),
    "ParkedObstacleTwoWays": ("oncoming", {"distance": 60, "frequency": (60, 100)}),
    "VehicleOpensDoorTwoWays": ("parking", {"distance": 50, "frequency": (60, 100)}),
    "InvadingTurn": ("oncoming", {"distance": 60, "offset": 0.3}),
    "HighwayCutIn": ("same", {}),
    "HighwayExit": ("same", {"flow_speed": 12, "source_dist_interval": (20, 40)}),
    "StaticCutIn": ("same", {"distance": 60, "direction": "right"}),
    "ParkingCutIn": ("parking", {"direction": "right"}),
    "ParkingExit": ("parking", {"direction": "right", "front_vehicle_distance": 9, "behind_vehicle_distance": 9, "flow_distance": 25}),
    "Accident": ("same", {"distance": 60, "direction": "right"}),
    "ParkedObstacle": ("same", {"distance": 60, "direction": "right"}),
    "ConstructionObstacle": ("same", {"distance": 60, "direction": "right"}),
    "ControlLoss": ("oncoming", {}),
    "DynamicObjectCrossing": ("oncoming", {"distance": 30, "direction": "right"}),
    "HardBreakRoute": ("same", {}),
}


def along(start, length, back=False):
    """Waypoints every two metres, or None where the lane ends before."""
    found, at = [start], start
    for _ in range(int(length / STEP_M)):
        ways = at.previous(STEP_M) if back else at.next(STEP_M)
        if not ways:
            return None
        at = min(ways, key=lambda way: abs(bend(at, way)))
        found.append(at)
    return found[::-1] if back else found


def bend(a, b):
    return (b.transform.rotation.yaw - a.transform.rotation.yaw + 540.0) % 360.0 - 180.0


def turns(world_map):
    """(manoeuvre, waypoints before and after a junction) of all ways through junctions."""
    for entry, leave in world_map.get_topology():
        if not entry.is_junction or entry.lane_type != carla.LaneType.Driving or entry.transform.location.distance(leave.transform.location) < 6.0:
            continue
        before, at, steps = along(entry, BEFORE_M, back=True), entry, 0
        while before and at.is_junction and steps < 40:
            # The way itself, not another that begins on the same spot: only one follows within it.
            ways = [way for way in at.next(STEP_M) if way.road_id == entry.road_id] or at.next(STEP_M)
            if not ways:
                break
            at, steps = ways[0], steps + 1
        after = along(at, AFTER_M) if before and not at.is_junction else None
        if not after or any(way.is_junction for way in before[:-2] + after[1:]):
            continue
        angle = bend(before[-3], after[0])
        kind = "straight" if abs(angle) < 15 else "left" if -120 < angle < -50 else "right" if 50 < angle < 120 else None
        if kind:
            yield kind, before[:-1], after


def oncoming(way):
    left = way.get_left_lane()
    return left if left and left.lane_type == carla.LaneType.Driving and left.lane_id * way.lane_id < 0 else None


def fits_junction(kind, before, after):
    """Whether a junction is of a kind, and the places of a flow of cars."""
    lights = before[-8].get_landmarks_of_type(20.0, "1000001")
    if kind == "lights":
        return bool(lights), {}
    if kind == "none":
        return not lights, {}
    if kind == "stop":
        return bool(before[-10].get_landmarks_of_type(25.0, "206")), {}
    if kind == "any":
        return True, {}
    if kind == "flow":
        away = oncoming(before[-4])
        reached, behind = away and along(away, 30.0), away and along(away, 90.0, back=True)
        if not reached or not behind or not oncoming(after[5]):
            return False, {}
        return True, {"start_actor_flow": behind[0], "end_actor_flow": reached[-1]}
    source = oncoming(after[-2])
    path = source and along(source, 130.0)
    if not path or not oncoming(path[-1]) or not any(way.is_junction for way in path) or path[-1].is_junction:
        return False, {}
    return True, {"start_actor_flow": source, "end_actor_flow": path[-1], "direction": "left"}


def straights(world_map):
    """Stretches of 170 m without a junction."""
    for way in world_map.generate_waypoints(60.0):
        if way.lane_type == carla.LaneType.Driving and not way.is_junction:
            path = along(way, 170.0)
            if path and not any(at.is_junction for at in path):
                yield path


def fits_straight(beside, kind, path):
    """Whether a lane of a kind accompanies a stretch, and the places beside it."""
    n = len(path)
    probes = [path[n // 6], path[n // 2], path[-10]]
    if kind == "InvadingTurn" and abs(bend(path[5], path[45])) < 20:
        return False, {}
    if beside == "oncoming":
        return all(map(oncoming, probes)), {}
    rights = [way.get_right_lane() for way in probes]
    wanted = carla.LaneType.Parking if beside == "parking" else carla.LaneType.Driving
    if not all(right and right.lane_type == wanted for right in rights):
        return beside == "parking" and all(r and r.lane_type in (carla.LaneType.Parking, carla.LaneType.Shoulder) for r in rights), {}
    if kind == "HighwayCutIn":
        return True, {"other_actor_location": path[12].get_right_lane(), "end_location": path[45].get_right_lane()}
    if kind == "HighwayExit":
        return True, {"start_actor_flow": path[2].get_right_lane(), "end_actor_flow": path[75].get_right_lane()}
    return True, {}


def place(tag, way, parent, **more):
    at = way.transform.location
    return ElementTree.SubElement(parent, tag, x=f"{at.x:.1f}", y=f"{at.y:.1f}", z=f"{at.z:.1f}", **more)


def route(identity, town, kind, path, trigger, parameters):
    root = ElementTree.Element("route", id=str(identity), town=town)
    ways = ElementTree.SubElement(root, "waypoints")
    for way in path:
        place("position", way, ways)
    scenario = ElementTree.SubElement(ElementTree.SubElement(root, "scenarios"), "scenario", name=f"{kind}_1", type=kind)
    place("trigger_point", trigger, scenario, yaw=f"{trigger.transform.rotation.yaw:.1f}")
    for name, value in parameters.items():
        if isinstance(value, carla.Waypoint):
            place(name, value, scenario)
        elif isinstance(value, tuple):
            ElementTree.SubElement(scenario, name, {"from": str(value[0]), "to": str(value[1])})
        else:
            ElementTree.SubElement(scenario, name, value=str(value))
    weathers = ElementTree.SubElement(root, "weathers")
    for percentage in ("0", "100"):
        ElementTree.SubElement(weathers, "weather", route_percentage=percentage, cloudiness="5.0", precipitation="0.0", precipitation_deposits="0.0", wetness="0.0",
                               wind_intensity="10.0", sun_azimuth_angle="-1.0", sun_altitude_angle="45.0", fog_density="2.0")
    return root


def places(world_map, kind):
    """(path, trigger, parameters) of all places for a type."""
    if kind in TURNS:
        manoeuvre, junction, own = TURNS[kind]
        for found, before, after in turns(world_map):
            fits, more = fits_junction(junction, before, after) if found == manoeuvre else (False, {})
            if fits:
                # Places within a junction belong to several lanes; the evaluator finds the way through it by itself.
                yield before + after, before[3], {**own, **more}
    else:
        beside, own = STRAIGHTS[kind]
        for path in straights(world_map):
            fits, more = fits_straight(beside, kind, path)
            if fits:
                yield path, path[5], {**own, **more}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("maps", type=pathlib.Path, help="folder with Town*.xodr")
    parser.add_argument("out", type=pathlib.Path, help="file to write")
    parser.add_argument("--per-type", type=int, default=4, help="routes per scenario type at most")
    parser.add_argument("--types", nargs="*", help="scenario types [default: all that are known]")
    given = parser.parse_args()
    towns = {path.stem: carla.Map(path.stem, path.read_text()) for path in sorted(given.maps.glob("Town*.xodr"))}
    root, number = ElementTree.Element("routes"), itertools.count(90000)
    for turn, kind in enumerate(given.types or [*TURNS, *STRAIGHTS]):
        # Towns take turns, and within a town the places are spread.
        order = sorted(towns)[turn % len(towns):] + sorted(towns)[:turn % len(towns)]
        found = {town: list(places(towns[town], kind)) for town in order}
        rounds = [[(town, all_of[round * len(all_of) // given.per_type]) for town, all_of in found.items() if len(all_of) > round] for round in range(given.per_type)]
        chosen = list(itertools.chain(*rounds))[:given.per_type]
        for town, (path, trigger, parameters) in chosen:
            root.append(route(next(number), town, kind, path, trigger, parameters))
        print(f"{kind}: {len(chosen)} of {sum(map(len, found.values()))} places: {', '.join(town for town, _ in chosen)}", flush=True)
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(given.out)
    print(f"{len(root)} routes in {given.out}")


if __name__ == "__main__":
    main()
