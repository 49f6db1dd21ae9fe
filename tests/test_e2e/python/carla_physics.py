"""How vehicles move, through the stock client: physical data, Ackermann control, pushes, switches, telemetry.

Usage: carla_physics.py PORT. Prints "<theme> passed" after each theme. Expected values are Newton's.
"""

import math
import sys

import carla
from carla_kit import STEP_SECS, connect, listen, must_be, near, of_tick, refused, run, run_checks, speed, step_by_hand, ticks, unevenness

G = 9.81

client = connect(sys.argv[1])
world = client.get_world()
original = step_by_hand(world)
library = world.get_blueprint_library()


START = min(world.get_map().get_spawn_points(), key=lambda point: unevenness(world, point))
assert unevenness(world, START) < 0.5


def fresh(settle=20):
    """The car at the start of a straight street, standing."""
    car = world.spawn_actor(library.find("vehicle.tesla.model3"), START)
    ticks(world, settle)
    assert speed(car) < 0.05, speed(car)
    return car


def reach_mps(car, wanted):
    for _ in range(400):
        if speed(car) >= wanted:
            return
        car.apply_control(carla.VehicleControl(throttle=1.0))
        world.tick()
    raise AssertionError(f"never reached {wanted} m/s, but {speed(car):.2f}")


def check_fields():
    """What is set is read back, and the factory's values are a car's."""
    car = fresh()
    factory = car.get_physics_control()
    assert 1000 < factory.mass < 3000 and len(factory.wheels) == 4 and len(factory.torque_curve) > 2 and factory.max_rpm > 3000
    assert all(20 < wheel.radius < 60 for wheel in factory.wheels), "wheels are in centimetres"
    changed = car.get_physics_control()
    changed.mass, changed.drag_coefficient, changed.final_ratio = 2222.0, 0.5, 5.0
    changed.torque_curve = [carla.Vector2D(0, 400), carla.Vector2D(6000, 300)]
    wheels = changed.wheels
    for wheel in wheels:
        wheel.tire_friction, wheel.max_steer_angle = 0.7, wheel.max_steer_angle / 2
    changed.wheels = wheels
    car.apply_physics_control(changed)
    world.tick()
    again = car.get_physics_control()
    for name in ("mass", "drag_coefficient", "final_ratio", "moi", "max_rpm"):
        must_be(getattr(again, name), getattr(changed, name), 1e-4, name)
    assert [(p.x, p.y) for p in again.torque_curve] == [(0, 400), (6000, 300)]
    assert all(abs(wheel.tire_friction - 0.7) < 1e-5 for wheel in again.wheels)
    car.destroy()


def check_mass():
    """Twice the mass is slower off the mark under the same engine."""

    def speed_after_two_seconds(times):
        car = fresh()
        control = car.get_physics_control()
        control.mass *= times
        car.apply_physics_control(control)
        world.tick()
        car.apply_control(carla.VehicleControl(throttle=1.0))
        ticks(world, 40)
        reached = speed(car)
        car.destroy()
        return reached

    light, heavy = speed_after_two_seconds(1.0), speed_after_two_seconds(2.0)
    assert light > 5.0 and 0.35 * light < heavy < 0.75 * light, (light, heavy)


def check_friction():
    """Braking distances are v² / (2 µ g) with brakes that lock or nearly so."""

    def braking_m(friction):
        car = fresh()
        control = car.get_physics_control()
        wheels = control.wheels
        for wheel in wheels:
            wheel.tire_friction = friction
        reach_mps(car, 12.0)
        control.wheels = wheels
        car.apply_physics_control(control)
        car.apply_control(carla.VehicleControl(brake=1.0))
        world.tick()
        begin, v = car.get_location(), speed(car)
        for _ in range(400):
            world.tick()
            if speed(car) < 0.05:
                break
        way = begin.distance(car.get_location())
        car.destroy()
        return way, v * v / (2 * friction * G)

    for friction in (0.3, 0.8):
        way, wanted = braking_m(friction)
        must_be(way, wanted, 0.1, f"braking distance with friction {friction}")


def check_ackermann():
    """Holds a speed, then another one."""
    car = fresh()
    for wanted in (8.0, 4.0):
        for _ in range(160):
            car.apply_ackermann_control(carla.VehicleAckermannControl(speed=wanted, acceleration=3.0))
            world.tick()
        must_be(speed(car), wanted, 0.05, "Ackermann speed")
    car.destroy()


def check_constant_velocity():
    """Along the car's own axis, held against everything."""
    car = fresh()
    car.enable_constant_velocity(carla.Vector3D(6.0, 0.0, 0.0))
    ticks(world, 20)
    for _ in range(40):
        world.tick()
        must_be(speed(car), 6.0, 0.02, "held speed")
    car.disable_constant_velocity()
    car.apply_control(carla.VehicleControl(brake=1.0))
    ticks(world, 60)
    assert speed(car) < 0.1
    # In free air it falls, unless it is told how fast to rise.
    place = car.get_transform()
    place.location.z += 20.0
    for up_mps, wanted in ((0.0, -G * 10 * STEP_SECS), (1.0, 1.0)):
        car.set_transform(place)
        car.set_target_velocity(carla.Vector3D())
        car.enable_constant_velocity(carla.Vector3D(6.0, 0.0, up_mps))
        ticks(world, 10)
        must_be(car.get_velocity().z, wanted, 0.1, f"upward speed with {up_mps} m/s asked for")
        must_be(math.hypot(car.get_velocity().x, car.get_velocity().y), 6.0, 0.03, "held speed in the air")
    car.destroy()


def check_pushes():
    """In free air Δv is J/m and F·t/m, and without gravity nothing falls."""
    car = fresh()
    mass = car.get_physics_control().mass
    car.set_enable_gravity(False)
    place = car.get_transform()
    place.location.z += 8.0
    car.set_transform(place)
    car.set_target_velocity(carla.Vector3D())
    ticks(world, 20)
    assert abs(car.get_location().z - place.location.z) < 0.05, "it floats"
    before = car.get_velocity()
    car.add_impulse(carla.Vector3D(0.0, 0.0, 2.0 * mass))
    world.tick()
    must_be(car.get_velocity().z - before.z, 2.0, 0.03, "velocity after an impulse")
    before = car.get_velocity()
    car.add_force(carla.Vector3D(0.0, 0.0, -10.0 * mass))
    world.tick()
    must_be(car.get_velocity().z - before.z, -10.0 * STEP_SECS, 0.05, "velocity after a force of one step")
    car.set_target_velocity(carla.Vector3D())
    world.tick()
    car.set_enable_gravity(True)
    height = car.get_location().z
    ticks(world, 12)
    must_be(height - car.get_location().z, 0.5 * G * (12 * STEP_SECS) ** 2, 0.12, "fall in 0.6 s")
    car.destroy()


def check_substeps():
    """An explicit fall of n steps of length h is g·h²·n(n+1)/2, further than the true one by g·t·h/2."""
    for substep_secs, substepping in ((0.01, True), (0.002, True), (0.0005, True), (0.0005, False)):
        step_by_hand(world, max_substep_delta_time=substep_secs, max_substeps=16, substepping=substepping)
        place = carla.Transform(START.location + carla.Location(z=40.0), START.rotation)
        car = world.spawn_actor(library.find("vehicle.tesla.model3"), place)
        ticks(world, 10)
        length_secs = substep_secs if substepping else 0.01
        n_substeps = round(10 * STEP_SECS / length_secs)
        fall = place.location.z - car.get_location().z
        wanted = 0.5 * G * length_secs**2 * n_substeps * (n_substeps + 1)
        assert near(fall, wanted, 1.5e-3), (substep_secs, substepping, fall, wanted)
        car.destroy()
        world.tick()
    step_by_hand(world)


def check_long_ticks():
    """A tick of 10 s is taken, and a longer one refused with the limits; its lidar frame has all its turns."""
    blueprint = library.find("sensor.lidar.ray_cast")
    blueprint.set_attribute("dropoff_general_rate", "0")
    blueprint.set_attribute("rotation_frequency", "10")
    lidar, messages = listen(world, blueprint, carla.Transform(START.location + carla.Location(z=1.5), START.rotation))
    world.tick()
    # A tick of 0.05 s is half a turn.
    turn = sum(len(of_tick(messages, world.tick())) for _ in range(2))
    refused(lambda: step_by_hand(world, 10.1), "period_nanos is 10100000000", "100000 to 10000000000")
    assert near(world.get_settings().fixed_delta_seconds, STEP_SECS, 1e-9)
    step_by_hand(world, 10.0)
    before = world.get_snapshot().timestamp.elapsed_seconds
    message = of_tick(messages, world.tick())
    assert near(message.timestamp, before + 10.0, 1e-6), (message.timestamp, before)
    assert turn > 500
    must_be(len(message), 100 * turn, 0.02, "the number of points in 10 s")
    lidar.destroy()
    step_by_hand(world)
    world.tick()


def check_sticky():
    """A control that does not stick is for one step: two cars with the same pedal once, and with the same pedal at every step."""
    blueprint = library.find("vehicle.tesla.model3")
    for sticky, again, is_driving in (("true", False, True), ("false", False, False), ("false", True, True)):
        blueprint.set_attribute("sticky_control", sticky)
        car = world.spawn_actor(blueprint, START)
        ticks(world, 20)
        car.apply_control(carla.VehicleControl(throttle=1.0))
        world.tick()
        assert car.get_control().throttle == 1.0
        for _ in range(40):
            if again:
                car.apply_control(carla.VehicleControl(throttle=1.0))
            world.tick()
        assert car.get_control().throttle == (1.0 if is_driving else 0.0)
        assert (speed(car) > 3.0) == is_driving, (sticky, again, speed(car))
        car.destroy()
        world.tick()


def check_no_physics():
    """Without physics a vehicle stands where it is put and takes no pedals; with it again it drives."""
    car = fresh()
    car.set_simulate_physics(False)
    place = car.get_transform()
    place.location.z += 3.0
    car.set_transform(place)
    car.apply_control(carla.VehicleControl(throttle=1.0))
    ticks(world, 20)
    assert car.get_location().distance(place.location) < 0.01, "it hangs where it was put"
    place.location.z -= 3.0
    car.set_transform(place)
    car.set_simulate_physics(True)
    car.apply_control(carla.VehicleControl(throttle=1.0))
    ticks(world, 40)
    assert speed(car) > 3.0
    car.destroy()


def check_telemetry():
    """Telemetry and wheels agree with the snapshot."""
    car = fresh()
    car.apply_control(carla.VehicleControl(throttle=0.6))
    ticks(world, 50)
    telemetry = car.get_telemetry_data()
    must_be(telemetry.speed, speed(car), 0.02, "speed by telemetry")
    assert len(telemetry.wheels) == 4 and telemetry.engine_rpm > 500 and abs(telemetry.throttle - 0.6) < 1e-3
    car.apply_control(carla.VehicleControl(brake=1.0))
    ticks(world, 100)
    car.apply_control(carla.VehicleControl(brake=1.0, steer=0.5))
    ticks(world, 20)
    left = car.get_wheel_steer_angle(carla.VehicleWheelLocation.FL_Wheel)
    right = car.get_wheel_steer_angle(carla.VehicleWheelLocation.FR_Wheel)
    assert left > 10 and right > 10, (left, right)
    assert right > left, "the inner wheel turns more"
    car.destroy()


def check_two_wheels():
    """A two-wheeler has four wheels in its physics control, as in CARLA; what is set reads back and acts."""
    bike = world.spawn_actor(library.find("vehicle.kawasaki.ninja"), START)
    ticks(world, 20)
    changed = bike.get_physics_control()
    assert len(changed.wheels) == 4 == len(bike.get_telemetry_data().wheels)
    front_left, front_right, rear_left, rear_right = wheels = changed.wheels
    ahead = START.get_forward_vector()
    along = [(wheel.position.x * ahead.x + wheel.position.y * ahead.y) / 100 for wheel in wheels]
    assert near(along[0], along[1]) and near(along[2], along[3]) and along[0] - along[2] > 1.0, along
    assert front_left.max_steer_angle == front_right.max_steer_angle > 10 and rear_left.max_steer_angle == rear_right.max_steer_angle == 0
    weight_n = changed.mass * G
    loads = [wheel.tire_load for wheel in bike.get_telemetry_data().wheels]
    must_be(sum(loads), weight_n, 0.05, "sum of the wheels' loads")
    for wheel in wheels:
        wheel.tire_friction, wheel.long_stiff_value, wheel.max_brake_torque = 0.4, 987.0, 700.0
    changed.wheels, changed.drag_coefficient = wheels, 0.77
    bike.apply_physics_control(changed)
    world.tick()
    for again in (bike.get_physics_control(),):
        assert len(again.wheels) == 4 and near(again.drag_coefficient, 0.77)
        for wheel, wanted in zip(again.wheels, wheels):
            for name in ("tire_friction", "long_stiff_value", "max_brake_torque", "max_steer_angle", "radius", "damping_rate", "lat_stiff_value"):
                must_be(getattr(wheel, name), getattr(wanted, name), 1e-4, name)
    for wheel in wheels:
        wheel.tire_friction = 0.3
    changed.wheels = wheels
    [answer] = client.apply_batch_sync([carla.command.ApplyVehiclePhysicsControl(bike, changed)], True)
    assert not answer.error and near(bike.get_physics_control().wheels[3].tire_friction, 0.3)
    reach_mps(bike, 8.0)
    began = speed(bike)
    bike.apply_control(carla.VehicleControl(brake=1.0))
    ticks(world, 20)
    must_be((began - speed(bike)) / (20 * STEP_SECS), 0.3 * G, 0.25, "deceleration at a friction of 0.3")
    bike.destroy()


def check_six_wheels():
    """Scripts that know four wheels set the first four of a lorry's six; the others stay."""
    lorry = world.spawn_actor(library.find("vehicle.carlamotors.european_hgv"), START)
    ticks(world, 5)
    control = lorry.get_physics_control()
    assert len(control.wheels) == 6
    four = control.wheels[:4]
    for wheel in four:
        wheel.tire_friction = 2.5
    control.wheels = four
    lorry.apply_physics_control(control)
    world.tick()
    assert [round(wheel.tire_friction, 4) for wheel in lorry.get_physics_control().wheels] == [2.5] * 4 + [1.0] * 2
    lorry.destroy()


def check_half_turn():
    """A yaw of exactly 180 degrees comes back as it went out, for every kind of actor."""
    for kind in ("vehicle.tesla.model3", "walker.pedestrian.0001", "static.prop.box01", "sensor.other.gnss"):
        place = carla.Transform(START.location + carla.Location(z=0.5), carla.Rotation(yaw=180.0))
        actor = world.spawn_actor(library.find(kind), place)
        if kind.startswith("vehicle"):
            actor.set_simulate_physics(False)
        ticks(world, 2)
        assert actor.get_transform().rotation.yaw == 180.0, (kind, actor.get_transform())
        actor.set_transform(place)
        world.tick()
        assert actor.get_transform().rotation.yaw == 180.0, (kind, actor.get_transform())
        actor.destroy()
    points = [point for point in world.get_map().get_spawn_points() if abs(point.rotation.yaw) > 179.999]
    assert all(point.rotation.yaw > 0.0 for point in points), points


def check_props():
    """A prop stands still until its physics is switched on; then it falls, and pushes do what Newton says."""
    place = carla.Transform(START.location + carla.Location(z=20.0), START.rotation)
    mesh = library.find("static.prop.mesh")
    mesh.set_attribute("mass", "40")
    box = world.spawn_actor(mesh, place)
    world.tick()
    box.set_target_velocity(carla.Vector3D(3.0, 0.0, 0.0))
    box.add_impulse(carla.Vector3D(0.0, 0.0, 400.0))
    ticks(world, 5)
    assert box.get_location().distance(place.location) < 1e-3 and speed(box) == 0.0, "nothing moves what stands"
    box.set_simulate_physics(True)
    ticks(world, 10)
    fallen = place.location.z - box.get_location().z
    must_be(fallen, 0.5 * G * 0.5**2, 0.1, "fall in 0.5 s")
    must_be(-box.get_velocity().z, G * 0.5, 0.05, "speed after 0.5 s")
    box.set_enable_gravity(False)
    box.set_target_velocity(carla.Vector3D())
    world.tick()
    hung = box.get_location()
    ticks(world, 10)
    assert box.get_location().distance(hung) < 1e-3, "it floats"
    box.set_target_velocity(carla.Vector3D(0.0, 2.0, 0.0))
    ticks(world, 20)
    must_be(box.get_location().y - hung.y, 2.0, 0.03, "way in a second at 2 m/s")
    box.set_target_velocity(carla.Vector3D())
    box.add_impulse(carla.Vector3D(0.0, 0.0, 40.0 * 1.5))
    world.tick()
    must_be(box.get_velocity().z, 1.5, 0.02, "velocity by impulse over mass")
    box.add_force(carla.Vector3D(0.0, 0.0, -40.0 * 10.0))
    world.tick()
    must_be(box.get_velocity().z, 1.5 - 10.0 * STEP_SECS, 0.03, "velocity after a force of one step")
    world.tick()
    must_be(box.get_velocity().z, 1.5 - 10.0 * STEP_SECS, 0.03, "velocity a step later")
    box.set_target_velocity(carla.Vector3D())
    box.set_target_angular_velocity(carla.Vector3D(0.0, 0.0, 90.0))
    before = box.get_transform().rotation.yaw
    ticks(world, 10)
    must_be((box.get_transform().rotation.yaw - before) % 360.0, 45.0, 0.03, "turn in half a second")
    # A cube of 1 m has a moment of inertia of m/6.
    box.add_angular_impulse(carla.Vector3D(0.0, 0.0, -40.0 / 6.0 * 90.0 * 3.14159265 / 180.0))
    world.tick()
    assert abs(box.get_angular_velocity().z) < 3.0, box.get_angular_velocity()
    box.set_enable_gravity(True)
    for _ in range(200):
        world.tick()
    ground = world.ground_projection(box.get_location() + carla.Location(z=0.5), 50.0) if speed(box) > 0.05 else None
    assert ground is None and abs(box.get_location().z - START.location.z) < 1.5, (box.get_location(), START.location)
    box.set_simulate_physics(False)
    rest = box.get_location()
    box.add_impulse(carla.Vector3D(0.0, 0.0, 4000.0))
    ticks(world, 5)
    assert box.get_location().distance(rest) < 1e-3, "it is held again"
    box.destroy()


def check_prop_in_the_way():
    """A car knocks a cone over whose physics is on, hardly slower for it; one that is fixed stops it."""
    ahead, drove = START.get_forward_vector(), {}
    for simulated in (True, False):
        barrier = world.spawn_actor(library.find("static.prop.streetbarrier"), carla.Transform(START.location + ahead * 25.0, START.rotation))
        barrier.set_simulate_physics(simulated)
        car = fresh()
        before = barrier.get_location()
        for _ in range(140):
            car.apply_control(carla.VehicleControl(throttle=0.6))
            world.tick()
        drove[simulated] = (car.get_location().distance(START.location), barrier.get_location().distance(before))
        car.destroy()
        barrier.destroy()
        world.tick()
    assert drove[True][0] > 35.0 and drove[True][1] > 3.0, drove
    assert drove[False][0] < 26.0 and drove[False][1] == 0.0, drove


def check_walkers():
    """Impulses, forces and velocities move a walker; its feet stop it again; a blow knocks over who is not invincible."""
    place = carla.Transform(START.location + carla.Location(z=1.2), START.rotation)
    for invincible in ("true", "false"):
        print_ = library.find("walker.pedestrian.0010")
        print_.set_attribute("is_invincible", invincible)
        walker = world.spawn_actor(print_, place)
        ticks(world, 20)
        start, ahead = walker.get_location(), START.get_forward_vector()
        walker.set_target_velocity(carla.Vector3D(ahead.x * 3.0, ahead.y * 3.0, 0.0))
        world.tick()
        assert speed(walker) > 2.0, speed(walker)
        ticks(world, 20)
        gone = walker.get_location().distance(start)
        # Feet hold with a friction of 1.2, which ends 3 m/s after v²/2a.
        must_be(gone, 3.0**2 / (2.0 * 1.2 * G), 0.35, "way of a walker pushed to 3 m/s")
        assert speed(walker) < 0.01
        walker.add_force(carla.Vector3D(ahead.x * 100.0, ahead.y * 100.0, 0.0))
        ticks(world, 3)
        assert walker.get_location().distance(start) - gone < 0.02, "a small force does not move who stands"
        here = walker.get_location()
        walker.add_force(carla.Vector3D(ahead.x * 4000.0, ahead.y * 4000.0, 0.0))
        ticks(world, 20)
        assert walker.get_location().distance(here) > 0.05, "a large one does"
        yaw = walker.get_transform().rotation.yaw
        walker.set_target_angular_velocity(carla.Vector3D(0.0, 0.0, 600.0))
        ticks(world, 10)
        assert 5.0 < (walker.get_transform().rotation.yaw - yaw) % 360.0 < 120.0
        height = walker.get_location().z
        walker.set_target_velocity(carla.Vector3D(0.0, 0.0, 4.0))
        top = max(walker.get_location().z for _ in range(20) if world.tick())
        must_be(top - height, 4.0**2 / (2.0 * G), 0.1, "height of a throw at 4 m/s")
        ticks(world, 20)
        walker.add_impulse(carla.Vector3D(ahead.x * 400.0, ahead.y * 400.0, 0.0))
        ticks(world, 20)
        roll, pitch = walker.get_transform().rotation.roll, walker.get_transform().rotation.pitch
        lies = max(abs(roll), abs(pitch)) > 60.0
        assert lies == (invincible == "false"), (invincible, walker.get_transform())
        walker.destroy()
        world.tick()


def main():
    run_checks({
        "fields": check_fields,
        "mass": check_mass,
        "friction": check_friction,
        "ackermann": check_ackermann,
        "constant velocity": check_constant_velocity,
        "pushes": check_pushes,
        "substeps": check_substeps,
        "long ticks": check_long_ticks,
        "sticky": check_sticky,
        "no physics": check_no_physics,
        "telemetry": check_telemetry,
        "two wheels": check_two_wheels,
        "six wheels": check_six_wheels,
        "half turn": check_half_turn,
        "props": check_props,
        "prop in the way": check_prop_in_the_way,
        "walkers": check_walkers,
    })
    world.apply_settings(original)


run(main)
