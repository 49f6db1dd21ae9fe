"""Vehicles through the stock client: the catalogue, all that can be spawned, paint, friction areas, collision impulses, doors.

Usage: carla_vehicles.py PORT. Prints "<theme> passed" after each theme. Expected values are CARLA's list and Newton's laws.
"""

import math
import sys

import carla
import numpy as np
from carla_kit import connect, listen, must_be, of_tick, run, run_checks, step_by_hand, ticks, unevenness

G = 9.81
DOORS = {"vehicle.dodge.charger_2020", "vehicle.dodge.charger_police_2020", "vehicle.ford.crown", "vehicle.lincoln.mkz_2020"}

client = connect(sys.argv[1])
world = client.get_world()
original = step_by_hand(world)
library = world.get_blueprint_library()


START = min(world.get_map().get_spawn_points(), key=lambda point: unevenness(world, point))
AHEAD = START.get_forward_vector()


def ahead(metres, up=0.0):
    at = START.location + carla.Location(AHEAD.x * metres, AHEAD.y * metres, up)
    return carla.Transform(at, START.rotation)


def spawn(name, place, **attributes):
    blueprint = library.find(name)
    for key, value in attributes.items():
        blueprint.set_attribute(key, value)
    return world.spawn_actor(blueprint, place)


def along(vector):
    return vector.x * AHEAD.x + vector.y * AHEAD.y + vector.z * AHEAD.z


def check_catalogue():
    """41 vehicles; two-wheelers have riders, cars of the second generation doors; helpers can be made."""
    vehicles = {blueprint.id: blueprint for blueprint in library.filter("vehicle.*")}
    assert len(vehicles) == 41, len(vehicles)
    for name in ("dodge.charger_police_2020", "mini.cooper_s_2021", "tesla.cybertruck", "volkswagen.t2_2021", "vespa.zx125"):
        assert f"vehicle.{name}" in vehicles, name
    assert DOORS <= {name for name, blueprint in vehicles.items() if blueprint.get_attribute("has_dynamic_doors").as_bool()}
    assert all(vehicles[name].has_attribute("driver_id") == (int(vehicles[name].get_attribute("number_of_wheels")) == 2) for name in vehicles)
    vespa = spawn("vehicle.vespa.zx125", ahead(0.0), driver_id="3")
    must_be(vespa.bounding_box.extent.x, 0.902, 1e-3, "half length of the Vespa")
    # The client takes an actor that no snapshot has shown yet for dead.
    world.tick()
    vespa.destroy()
    empty = spawn("util.actor.empty", ahead(5.0, 2.0))
    mesh = spawn("static.prop.mesh", ahead(12.0), mesh_path="/Game/Own/Thing")
    world.tick()
    assert empty.get_location().distance(ahead(5.0, 2.0).location) < 1e-3
    assert empty.destroy() and mesh.destroy()


def check_every_blueprint():
    """Whatever is listed can be made, is what it was asked to be, and goes again."""
    # Sensors are a matter of `carla_sensors.py` and others.
    blueprints = sorted((one for one in library if not one.id.startswith("sensor.")), key=lambda blueprint: blueprint.id)
    commands = []
    for n, blueprint in enumerate(blueprints):
        # High up, 20 m apart, so that nothing is in the way.
        commands.append(carla.command.SpawnActor(blueprint, carla.Transform(carla.Location(20.0 * (n % 20), 20.0 * (n // 20), 400.0))))
    answers = client.apply_batch_sync(commands, True)
    failed = [(blueprint.id, answer.error) for blueprint, answer in zip(blueprints, answers) if answer.error]
    assert len(blueprints) > 180 and not failed, failed
    there = {actor.id: actor.type_id for actor in world.get_actors()}
    for blueprint, answer in zip(blueprints, answers):
        assert there[answer.actor_id] == blueprint.id, (there[answer.actor_id], blueprint.id)
    answers = client.apply_batch_sync([carla.command.DestroyActor(answer.actor_id) for answer in answers], True)
    assert not any(answer.error for answer in answers), [answer.error for answer in answers]


def check_paint():
    """A camera sees the colour that was asked for."""
    blueprint = library.find("sensor.camera.rgb")
    for name, value in (("image_size_x", "32"), ("image_size_y", "32"), ("fov", "20")):
        blueprint.set_attribute(name, value)
    shades = {}
    for color in ("200,0,0", "0,0,200"):
        car = spawn("vehicle.tesla.model3", START, color=color)
        # Down onto the bonnet.
        camera, pictures = listen(world, blueprint, carla.Transform(carla.Location(x=1.6, z=4.0), carla.Rotation(pitch=-90.0)), attach_to=car)
        ticks(world, 3)
        picture = np.frombuffer(of_tick(pictures, world.tick()).raw_data, dtype=np.uint8).reshape(32, 32, 4)
        shades[color] = picture[8:24, 8:24].mean(axis=(0, 1))
        camera.destroy()
        car.destroy()
        world.tick()
    red, blue = shades.values()
    assert red[2] > red[0] + 40 and blue[0] > blue[2] + 40, shades


def check_friction_area():
    """Braking distances are v² / (2 µ g) inside it, whatever the tyres are."""

    def braking_m(friction):
        area = spawn(
            "static.trigger.friction", ahead(60.0), friction=str(friction), extent_x="9000.0", extent_y="9000.0", extent_z="1000.0"
        )
        car = spawn("vehicle.tesla.model3", START)
        ticks(world, 20)
        for _ in range(400):
            if car.get_velocity().length() > 9.0:
                break
            car.apply_control(carla.VehicleControl(throttle=0.6))
            world.tick()
        car.apply_control(carla.VehicleControl(brake=1.0))
        world.tick()
        begin, v = car.get_location(), car.get_velocity().length()
        assert v > 8.0, v
        for _ in range(600):
            world.tick()
            if car.get_velocity().length() < 0.05:
                break
        way = begin.distance(car.get_location())
        car.destroy()
        area.destroy()
        return way, v * v / (2 * friction * G)

    for friction in (0.2, 0.6):
        must_be(*braking_m(friction), 0.1, f"braking distance in an area of friction {friction}")


def check_collision_impulse():
    """Both cars feel the same impulse in opposite directions, and it is the change of momentum of each."""
    hit, stood = spawn("vehicle.tesla.model3", START), spawn("vehicle.nissan.patrol_2021", ahead(25.0))
    felt = {hit.id: [], stood.id: []}
    sensors = []
    for car in (hit, stood):
        sensor = world.spawn_actor(library.find("sensor.other.collision"), carla.Transform(), attach_to=car)
        sensor.listen(lambda event: felt[event.actor.id].append((event.frame, event.other_actor.id, event.normal_impulse)))
        sensors.append(sensor)
    ticks(world, 20)
    mass = {car.id: car.get_physics_control().mass for car in (hit, stood)}
    neutral = carla.VehicleControl(manual_gear_shift=True, gear=0)
    hit.apply_control(neutral)
    stood.apply_control(neutral)
    hit.set_target_velocity(carla.Vector3D(AHEAD.x * 8.0, AHEAD.y * 8.0, 0.0))
    speeds = []
    for _ in range(80):
        frame = world.tick()
        speeds.append((frame, along(hit.get_velocity()), along(stood.get_velocity())))
    blows = [(frame, other) for frame, other, _ in felt[hit.id]]
    assert len(set(blows)) == len(blows), f"once per tick and thing, {blows}"
    frames = sorted({frame for frame, other, _ in felt[hit.id] if other == stood.id})
    assert frames, "nothing was felt"
    first, last = frames[0], frames[-1]
    before = [row for row in speeds if row[0] == first - 1][0]
    after = [row for row in speeds if row[0] == min(last, speeds[-1][0])][0]
    impulses = {}
    for me, you in ((hit, stood), (stood, hit)):
        impulses[me.id] = sum(along(impulse) for frame, other, impulse in felt[me.id] if other == you.id and frame <= after[0])
    for me, column in ((hit, 1), (stood, 2)):
        must_be(impulses[me.id], mass[me.id] * (after[column] - before[column]), 0.15, f"impulse on {me.type_id}")
    must_be(impulses[hit.id], -impulses[stood.id], 0.01, "impulse on one against that on the other")
    assert impulses[hit.id] < -2000.0, impulses
    for actor in (*sensors, hit, stood):
        actor.destroy()


def check_doors():
    """A ray from the side meets the flank, and through an open door the inside."""
    car = spawn("vehicle.dodge.charger_2020", START)
    ticks(world, 30)

    def depth(left, metres_forward=0.15):
        """How far behind the car's box a ray from the side meets it, at the height of the window's lower edge."""
        box = car.bounding_box.extent
        right = car.get_transform().get_right_vector() * (-1.0 if left else 1.0)
        middle = car.get_location() + car.get_transform().get_forward_vector() * metres_forward + carla.Location(0, 0, 1.0 * box.z)
        from_m = box.y + 3.0
        start = middle + carla.Location(right.x * from_m, right.y * from_m, 0)
        beyond = middle - carla.Location(right.x * box.y, right.y * box.y, 0)
        points = world.cast_ray(start, beyond)
        # Through two open doors it may meet nothing at all.
        return min((start.distance(point.location) for point in points), default=math.inf) - 3.0

    shut = depth(True), depth(False)
    assert max(shut) < 0.3, shut
    car.open_door(carla.VehicleDoor.FL)
    ticks(world, 20)
    assert depth(True) > shut[0] + 0.1, (depth(True), shut)
    assert abs(depth(False) - shut[1]) < 0.03
    car.close_door(carla.VehicleDoor.FL)
    ticks(world, 20)
    assert abs(depth(True) - shut[0]) < 0.03
    car.open_door(carla.VehicleDoor.All)
    ticks(world, 20)
    assert depth(True) > shut[0] + 0.1 and depth(False) > shut[1] + 0.1
    car.destroy()
    # A vehicle without doors takes the call and keeps its shape.
    car = spawn("vehicle.tesla.model3", START)
    ticks(world, 30)
    shut = depth(True)
    car.open_door(carla.VehicleDoor.FL)
    ticks(world, 20)
    assert abs(depth(True) - shut) < 0.03, (depth(True), shut)
    car.destroy()


def main():
    run_checks({
        "catalogue": check_catalogue,
        "every blueprint": check_every_blueprint,
        "paint": check_paint,
        "friction area": check_friction_area,
        "collision impulse": check_collision_impulse,
        "doors": check_doors,
    })
    world.apply_settings(original)


run(main)
