"""Maps made by PyPI scenariogeneration, for tests: one folder argument. Each has features of its own."""

import math
import os
import sys

from scenariogeneration import xodr


def save(name, roads, junctions=(), geo=None):
    world = xodr.OpenDrive(name, geo_reference=geo) if geo else xodr.OpenDrive(name)
    for road in roads:
        world.add_road(road)
    for junction in junctions:
        world.add_junction(junction)
    world.adjust_roads_and_lanes()
    world.write_xml(os.path.join(sys.argv[1], name + ".xodr"))


def chain():
    """Line, spiral, arc, spiral, cubic polynomials one after another in one road, three lanes to the right, two to the left."""
    shapes = [
        xodr.Line(60),
        xodr.Spiral(1e-9, 0.02, 40),
        xodr.Arc(0.02, length=50),
        xodr.Spiral(0.02, -0.01, 45),
        xodr.ParamPoly3(0, 30, 0, 0, 0, 0, 4, -2, prange="normalized", length=30.1),
        xodr.Line(20),
    ]
    road = xodr.create_road(shapes, id=0, left_lanes=2, right_lanes=3, lane_width=3.4)
    road.add_elevation(0, 10, 0.02, 0.0001, -0.0000004)
    return [road]


def crossing():
    """Four roads meet in a junction, every way linked."""
    roads = [xodr.create_road(xodr.Line(90), i, left_lanes=2, right_lanes=2) for i in range(4)]
    creator = xodr.CommonJunctionCreator(100, "crossing", startnum=200)
    for i, road in enumerate(roads):
        creator.add_incoming_road_circular_geometry(road, 25, i * math.pi / 2, "predecessor")
    for a in range(4):
        for b in range(a + 1, 4):
            creator.add_connection(a, b)
    return roads + creator.get_connecting_roads(), [creator.junction]


def signals():
    """A long road with speed signs, lights and a crosswalk."""
    road = xodr.create_road([xodr.Line(200), xodr.Arc(0.005, length=100)], id=7, left_lanes=1, right_lanes=2)
    road.add_type(xodr.RoadType.town, 0, "DE", speed=50, speed_unit="km/h")
    for s, value in ((20, 30), (120, 70)):
        road.add_signal(xodr.Signal(s=s, t=-8, zOffset=2, country="OpenDRIVE", Type="274", subtype="-1", value=value, unit="km/h"))
    road.add_signal(xodr.Signal(s=190, t=-8, zOffset=5, country="OpenDRIVE", Type="1000001", subtype="-1", dynamic=xodr.Dynamic.yes))
    road.add_object(xodr.Object(s=100, t=9, Type=xodr.ObjectType.pole, height=4, radius=0.1))
    return [road]


def direct():
    """A motorway with an exit: a direct junction."""
    main = xodr.create_road(xodr.Line(200), 1, left_lanes=0, right_lanes=3)
    small = xodr.create_road(xodr.Line(150), 2, left_lanes=0, right_lanes=2)
    exit_road = xodr.create_road(xodr.Spiral(-0.00001, -0.02, length=100), 3, left_lanes=0, right_lanes=1)
    junction = xodr.DirectJunctionCreator(4, "exit")
    main.add_successor(xodr.ElementType.junction, junction.id)
    small.add_predecessor(xodr.ElementType.junction, junction.id)
    exit_road.add_predecessor(xodr.ElementType.junction, junction.id)
    junction.add_connection(main, small, incoming_lane_ids=[-1, -2], linked_lane_ids=[-1, -2])
    junction.add_connection(main, exit_road, incoming_lane_ids=-3, linked_lane_ids=-1)
    return [main, small, exit_road], [junction.junction]


os.makedirs(sys.argv[1], exist_ok=True)
save("chain", chain(), geo="+proj=tmerc +lat_0=48.1 +lon_0=11.5 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs")
save("crossing", *crossing())
save("signals", signals())
save("direct", *direct())
