"""Every command of a batch, and calls that nothing else looks at, by what they do, through the stock `carla` 0.9.16 wheel.

Usage: carla_commands.py PORT. Prints "<theme> passed" after each theme. Expected values are Newton's.
"""

import math
import os
import sys
import tempfile

import carla
from carla_kit import STEP_SECS, connect, listen, must_be, near, run, run_checks, speed, step_by_hand, ticks, turn_deg, unevenness

G = 9.81
GAINS = ("speed_kp", "speed_ki", "speed_kd", "accel_kp", "accel_ki", "accel_kd")

client = connect(sys.argv[1])
world = client.get_world()
original = step_by_hand(world)
library = world.get_blueprint_library()
does = carla.command

START = min(world.get_map().get_spawn_points(), key=lambda point: unevenness(world, point))
assert unevenness(world, START) < 0.5


def do(*commands):
    """Runs commands in one batch, with a step behind it, as `apply_batch_sync` is told to."""
    answers = client.apply_batch_sync(list(commands), True)
    assert len(answers) == len(commands) and not any(answer.error for answer in answers), [answer.error for answer in answers]


def fresh(model="vehicle.tesla.model3"):
    car = world.spawn_actor(library.find(model), START)
    ticks(world, 20)
    assert speed(car) < 0.05, speed(car)
    return car


def in_the_air():
    """A cube of 40 kg and 1 m that nothing holds and nothing draws down."""
    mesh = library.find("static.prop.mesh")
    mesh.set_attribute("mass", "40")
    box = world.spawn_actor(mesh, carla.Transform(START.location + carla.Location(z=20.0), START.rotation))
    world.tick()
    do(does.SetSimulatePhysics(box, True), does.SetEnableGravity(box, False), does.ApplyTargetVelocity(box, carla.Vector3D()))
    return box


def check_places():
    """Poses of vehicles and walkers, and the end of both."""
    car = fresh()
    there = carla.Transform(START.location + 15.0 * START.get_forward_vector(), START.rotation)
    do(does.ApplyTransform(car, there))
    assert car.get_location().distance_2d(there.location) < 0.1, car.get_location()
    walker = world.spawn_actor(library.find("walker.pedestrian.0010"), carla.Transform(START.location + carla.Location(z=1.2), START.rotation))
    ticks(world, 20)
    place = walker.get_transform()
    place.location -= 5.0 * START.get_forward_vector()
    place.rotation.yaw += 90.0
    do(does.ApplyWalkerState(walker, place, 1.5))
    seen = walker.get_transform()
    assert seen.location.distance_2d(place.location) < 0.1 and turn_deg(seen.rotation.yaw, place.rotation.yaw) < 1.0, (seen, place)
    # The rotation stays where only the place is told.
    rotation = car.get_transform().rotation
    elsewhere = START.location - 10.0 * START.get_forward_vector()
    car.set_location(elsewhere)
    world.tick()
    seen = car.get_transform()
    assert seen.location.distance_2d(elsewhere) < 0.1 and turn_deg(seen.rotation.yaw, rotation.yaw) < 0.1, (seen, elsewhere)
    do(does.DestroyActor(car), does.DestroyActor(walker))
    world.tick()
    left = {actor.id for actor in world.get_actors()}
    assert not left & {car.id, walker.id}, left


def check_pushes():
    """Velocities at once, impulse over mass, force for one step; a cube of 1 m has a moment of inertia of m/6."""
    box = in_the_air()
    do(does.ApplyTargetVelocity(box, carla.Vector3D(0.0, 2.0, 0.0)))
    must_be(box.get_velocity().y, 2.0, 0.02, "velocity that was set")
    do(does.ApplyTargetVelocity(box, carla.Vector3D()), does.ApplyImpulse(box, carla.Vector3D(0.0, 0.0, 40.0 * 1.5)))
    must_be(box.get_velocity().z, 1.5, 0.02, "velocity by impulse over mass")
    do(does.ApplyForce(box, carla.Vector3D(0.0, 0.0, -40.0 * 10.0)))
    must_be(box.get_velocity().z, 1.5 - 10.0 * STEP_SECS, 0.03, "velocity after a force of one step")
    do(does.ApplyTargetVelocity(box, carla.Vector3D()), does.ApplyTargetAngularVelocity(box, carla.Vector3D(0.0, 0.0, 60.0)))
    must_be(box.get_angular_velocity().z, 60.0, 0.03, "turn that was set")
    inertia = 40.0 / 6.0
    do(does.ApplyAngularImpulse(box, carla.Vector3D(0.0, 0.0, -inertia * math.radians(60.0))))
    assert abs(box.get_angular_velocity().z) < 2.0, box.get_angular_velocity()
    # For one step, so that 90 degrees per second come of it.
    do(does.ApplyTorque(box, carla.Vector3D(0.0, 0.0, inertia * math.radians(90.0) / STEP_SECS)))
    must_be(box.get_angular_velocity().z, 90.0, 0.05, "turn after a torque of one step")
    world.tick()
    must_be(box.get_angular_velocity().z, 90.0, 0.05, "turn a step later")
    do(does.SetEnableGravity(box, True))
    before = box.get_velocity().z
    ticks(world, 6)
    must_be(before - box.get_velocity().z, G * 6 * STEP_SECS, 0.05, "speed of a fall in 0.3 s")
    do(does.SetSimulatePhysics(box, False))
    held = box.get_location()
    ticks(world, 6)
    assert box.get_location().distance(held) < 1e-3, "it hangs where it is"
    box.destroy()


def check_ackermann():
    """A speed by commands of a batch, which is reached no sooner than the acceleration allows; gains are kept, and act."""
    car = fresh()
    first = car.get_ackermann_controller_settings()
    assert first.speed_kp > 0.0
    gains = carla.AckermannControllerSettings(speed_kp=first.speed_kp / 2.0, speed_kd=0.125, accel_kp=first.accel_kp, accel_ki=0.25)
    car.apply_ackermann_controller_settings(gains)
    world.tick()
    seen = car.get_ackermann_controller_settings()
    for name in GAINS:
        assert near(getattr(seen, name), getattr(gains, name), 1e-5), (name, seen, gains)
    car.apply_ackermann_controller_settings(first)
    for _ in range(160):
        do(does.ApplyVehicleAckermannControl(car, carla.VehicleAckermannControl(speed=6.0, acceleration=3.0)))
    must_be(speed(car), 6.0, 0.05, "Ackermann speed")
    # Without any gain nobody presses a pedal, and the car rolls out.
    car.apply_ackermann_controller_settings(carla.AckermannControllerSettings(**dict.fromkeys(GAINS, 0.0)))
    for _ in range(60):
        do(does.ApplyVehicleAckermannControl(car, carla.VehicleAckermannControl(speed=12.0, acceleration=3.0)))
    assert speed(car) < 7.0, speed(car)
    car.destroy()


def check_lamps():
    """Lamps of a vehicle."""
    car = fresh()
    lamps = carla.VehicleLightState(carla.VehicleLightState.HighBeam | carla.VehicleLightState.RightBlinker)
    # Given the car itself, the wheel makes a truth value of the lamps.
    do(does.SetVehicleLightState(car.id, int(lamps)))
    assert int(car.get_light_state()) == int(lamps), car.get_light_state()
    car.destroy()


def check_collisions():
    """A car without collisions rolls through another one, on its wheels; with them it stops there."""
    for collides in (False, True):
        ahead = START.get_forward_vector()
        other = world.spawn_actor(library.find("vehicle.carlamotors.carlacola"), carla.Transform(START.location + 15.0 * ahead, START.rotation))
        car = fresh()
        other.apply_control(carla.VehicleControl(hand_brake=True, brake=1.0))
        ticks(world, 10)
        stood, height = other.get_location(), car.get_location().z
        car.set_collisions(collides)
        for _ in range(100):
            car.apply_control(carla.VehicleControl(throttle=0.5))
            world.tick()
        driven = car.get_location().distance(START.location)
        pushed = other.get_location().distance(stood)
        if collides:
            assert driven < 14.0 and pushed > 0.001, (driven, pushed)
        else:
            assert driven > 22.0 and pushed < 0.001 and abs(car.get_location().z - height) < 0.2, (driven, pushed, car.get_location())
        car.destroy()
        other.destroy()
        world.tick()


def check_files():
    """The navigation mesh comes to the client's folder, as it is used there."""
    with tempfile.TemporaryDirectory() as folder:
        assert client.set_files_base_folder(folder)
        names = client.get_required_files("", False)
        assert len(names) == 1 and names[0].endswith(f"/Nav/{world.get_map().name.rsplit('/', maxsplit=1)[-1]}.bin"), names
        client.request_file(names[0])
        found = [os.path.join(at, name) for at, _, files in os.walk(folder) for name in files]
        assert len(found) == 1 and found[0].endswith(names[0].rsplit("/", maxsplit=1)[-1]), found
        with open(found[0], "rb") as file:
            # Recast's set of tiles.
            assert file.read(4) in (b"TESM", b"MSET"), found
            assert os.path.getsize(found[0]) > 10_000


def check_ros():
    """No sensor publishes to ROS by itself."""
    camera, _ = listen(world, library.find("sensor.camera.rgb"), START)
    world.tick()
    assert camera.is_enabled_for_ros() is False
    camera.destroy()


def main():
    run_checks({
        "places": check_places,
        "pushes": check_pushes,
        "ackermann": check_ackermann,
        "lamps": check_lamps,
        "collisions": check_collisions,
        "files": check_files,
        "ros": check_ros,
    })
    world.apply_settings(original)


run(main)
