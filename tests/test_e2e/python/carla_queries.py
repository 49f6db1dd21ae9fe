"""The stock `carla` 0.9.16 wheel: rays against closed forms, and debug drawing.

    carla_queries.py PORT          rays
    carla_queries.py PORT draw     draws a box, a line, an arrow and a point round the ego vehicle and leaves them there

Prints "NAME passed" per theme; the first thing that is not as it should be ends the script.
"""

import sys

import carla
import numpy as np
from carla_kit import connect, listen, of_tick, passed, run, step_by_hand

PORT = int(sys.argv[1])
LABEL = carla.CityObjectLabel


def check_ground(world):
    """Straight down onto lanes: the surface lies where the map's own geometry says."""
    town = world.get_map()
    n_roads = 0
    for waypoint in town.generate_waypoints(40.0)[:120]:
        at = waypoint.transform.location
        found = world.ground_projection(carla.Location(at.x, at.y, at.z + 1.5), 10.0)
        assert found is not None, at
        assert abs(found.location.x - at.x) < 1e-3 and abs(found.location.y - at.y) < 1e-3
        if found.label in (LABEL.Roads, LABEL.RoadLines, LABEL.Bridge, LABEL.Ground):
            n_roads += 1
            assert abs(found.location.z - at.z) < 0.06, (found.location, at, found.label)
    print(f"{n_roads} of 120 points on roads")
    assert n_roads >= 100
    point = town.get_spawn_points()[0].location
    assert world.project_point(carla.Location(point.x, point.y, point.z + 60.0), carla.Vector3D(0.0, 0.0, 1.0), 500.0) is None
    assert world.ground_projection(carla.Location(point.x, point.y, point.z + 60.0), 5.0) is None, "too far below"


def check_car(world):
    """Through a car: in at its front, out at its back, both on its box."""
    blueprint = world.get_blueprint_library().find("vehicle.carlamotors.carlacola")
    car = next(actor for actor in (world.try_spawn_actor(blueprint, point) for point in world.get_map().get_spawn_points()) if actor)
    car.apply_control(carla.VehicleControl(hand_brake=True))
    for _ in range(60):
        world.tick()
    transform, box = car.get_transform(), car.bounding_box
    ahead, height = transform.get_forward_vector(), transform.location + carla.Location(z=0.9)
    start = height + carla.Location(ahead.x * 12.0, ahead.y * 12.0, ahead.z * 12.0)
    end = height - carla.Location(ahead.x * 12.0, ahead.y * 12.0, ahead.z * 12.0)
    hits = [hit for hit in world.cast_ray(start, end) if hit.label in (LABEL.Truck, LABEL.Car)]
    assert len(hits) >= 2, [(hit.location, hit.label) for hit in world.cast_ray(start, end)]
    along = [(hit.location - transform.location).dot(ahead) for hit in hits]
    assert along == sorted(along, reverse=True), "nearest first"
    assert abs(along[0] - (box.location.x + box.extent.x)) < 0.35, (along[0], box.extent.x)
    assert abs(along[-1] - (box.location.x - box.extent.x)) < 0.35, (along[-1], box.extent.x)
    first = world.project_point(start, carla.Vector3D(-ahead.x, -ahead.y, -ahead.z), 24.0)
    assert first is not None and first.location.distance(hits[0].location) < 1e-3 and first.label == hits[0].label
    # The car moves, and rays with it.
    away = carla.Transform(transform.location + carla.Location(z=30.0), transform.rotation)
    car.set_transform(away)
    world.tick()
    assert all(hit.label not in (LABEL.Truck, LABEL.Car) for hit in world.cast_ray(start, end))
    car.destroy()
    world.tick()


def check_shapes(world):
    """Each shape alone is as large in the picture of a camera as it is; it goes after its time, or when it is told to."""
    library, debug, color = world.get_blueprint_library(), world.debug, carla.Color(255, 0, 255)
    blueprint = library.find("sensor.camera.rgb")
    blueprint.set_attribute("image_size_x", "200")
    blueprint.set_attribute("image_size_y", "200")
    # Straight down from high above: at 100 m below, a metre is a pixel.
    eye = carla.Location(0.0, 0.0, 400.0)
    camera, pictures = listen(world, blueprint, carla.Transform(eye, carla.Rotation(pitch=-90.0)))
    below = lambda x, y: eye + carla.Location(x, y, -100.0)  # noqa: E731

    def n_painted():
        picture = np.frombuffer(of_tick(pictures, world.tick()).raw_data, dtype=np.uint8).reshape(200, 200, 4)
        return int((picture[..., :3] == (255, 0, 255)).all(axis=2).sum())

    assert n_painted() == 0
    box = carla.BoundingBox(below(0.0, 0.0), carla.Vector3D(20.0, 15.0, 0.1))
    for name, draw_it, least, most in (
        ("point", lambda life: debug.draw_point(below(0.0, 0.0), 10.0, color, life), 80, 125),
        ("line", lambda life: debug.draw_line(below(-30.0, 0.0), below(30.0, 0.0), 3.0, color, life), 160, 200),
        # The shaft and a head.
        ("arrow", lambda life: debug.draw_arrow(below(-30.0, 0.0), below(30.0, 0.0), 3.0, 8.0, color, life), 200, 340),
        # Edges above and below fall together: 42 by 32 m without 38 by 28 m.
        ("box", lambda life: debug.draw_box(box, carla.Rotation(), 2.0, color, life), 250, 310),
    ):
        draw_it(0.2)
        seen = [n_painted() for _ in range(6)]
        assert all(least <= n <= most for n in seen[:3]) and seen[5] == 0, (name, seen)
        draw_it(1000.0)
        n_painted()
        assert least <= n_painted() <= most, name
        debug.clear_debug_shape()
        assert n_painted() == 0, name
    camera.destroy()
    world.tick()


def draw(world):
    # A client that comes to a halted world knows its actors from the next tick on.
    world.tick()
    ego = world.get_actors().filter("vehicle.*")[0]
    transform = ego.get_transform()
    def place(x, y, z):
        point = carla.Location(x, y, z)
        transform.transform(point)
        return point
    debug, color = world.debug, carla.Color(255, 0, 255)
    debug.draw_line(place(8.0, -3.0, 1.6), place(8.0, 3.0, 1.6), 0.5, color)
    debug.draw_string(place(8.0, 0.0, 3.0), "never seen in pictures", False, color)
    debug.draw_point(place(8.0, 0.0, 3.0), 0.5, color, 1.0)
    debug.draw_arrow(place(8.0, -2.0, 0.5), place(8.0, 2.0, 0.5), 0.1, 0.3, color)
    debug.draw_box(carla.BoundingBox(place(8.0, 0.0, 1.5), carla.Vector3D(0.5, 0.5, 0.5)), transform.rotation, 0.05, color)
    # Calls without an answer are carried out before one with an answer returns.
    world.get_weather()
    world.ground_projection(transform.location, 1.0)


def main():
    client = connect(PORT)
    world = client.get_world()
    if sys.argv[2:] == ["draw"]:
        draw(world)
        passed("drawing")
        return
    step_by_hand(world)
    world.tick()
    check_ground(world)
    passed("ground")
    check_car(world)
    passed("car")
    check_shapes(world)
    passed("shapes")


run(main)
