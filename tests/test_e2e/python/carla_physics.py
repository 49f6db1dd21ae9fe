"""How vehicles move, through the stock client: physical data, Ackermann control, pushes, switches, telemetry.

Usage: carla_physics.py PORT. Prints "<theme> passed" after each theme. Expected values are Newton's.
"""

import math
import sys

import carla

G = 9.81
DT = 0.05

client = carla.Client("127.0.0.1", int(sys.argv[1]))
client.set_timeout(60.0)
world = client.get_world()
settings = world.get_settings()
settings.synchronous_mode, settings.fixed_delta_seconds = True, DT
world.apply_settings(settings)
library = world.get_blueprint_library()


def passed(theme):
    print(theme, "passed", flush=True)


def near(value, wanted, share, what):
    assert abs(value - wanted) <= share * abs(wanted), f"{what} is {value:.3f}, but {wanted:.3f} within {share:.0%} is expected"


def ticks(n):
    for _ in range(n):
        world.tick()


def unevenness(point):
    """How far the next 140 m are from straight and level: degrees of turn and of slope."""
    here = world.get_map().get_waypoint(point.location)
    worst = 0.0
    for metres in (30.0, 60.0, 100.0, 140.0):
        for place in here.next(metres) or [None]:
            if place is None:
                return 360.0
            turn = math.radians(place.transform.rotation.yaw - here.transform.rotation.yaw)
            rise = place.transform.location.z - here.transform.location.z
            worst = max(worst, abs(math.degrees(math.remainder(turn, 2 * math.pi))), math.degrees(math.atan2(abs(rise), metres)))
    return worst


START = min(world.get_map().get_spawn_points(), key=unevenness)
assert unevenness(START) < 0.5


def speed(car):
    return car.get_velocity().length()


def fresh(settle=20):
    """The car at the start of a straight street, standing."""
    car = world.spawn_actor(library.find("vehicle.tesla.model3"), START)
    ticks(settle)
    assert speed(car) < 0.05, speed(car)
    return car


def reach_mps(car, wanted):
    for _ in range(400):
        if speed(car) >= wanted:
            return
        car.apply_control(carla.VehicleControl(throttle=1.0))
        world.tick()
    raise AssertionError(f"never reached {wanted} m/s, but {speed(car):.2f}")


# Fields: what is set is read back, and the factory's values are a car's.
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
    near(getattr(again, name), getattr(changed, name), 1e-4, name)
assert [(p.x, p.y) for p in again.torque_curve] == [(0, 400), (6000, 300)]
assert all(abs(wheel.tire_friction - 0.7) < 1e-5 for wheel in again.wheels)
car.destroy()
passed("fields")


# Mass: twice of it is slower off the mark under the same engine.
def speed_after_two_seconds(times):
    car = fresh()
    control = car.get_physics_control()
    control.mass *= times
    car.apply_physics_control(control)
    world.tick()
    car.apply_control(carla.VehicleControl(throttle=1.0))
    ticks(40)
    reached = speed(car)
    car.destroy()
    return reached


light, heavy = speed_after_two_seconds(1.0), speed_after_two_seconds(2.0)
assert light > 5.0 and 0.35 * light < heavy < 0.75 * light, (light, heavy)
passed("mass")


# Friction: v² / (2 µ g) with brakes that lock or nearly so.
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
    near(way, wanted, 0.1, f"braking distance with friction {friction}")
passed("friction")

# Ackermann: holds a speed, then another one.
car = fresh()
for wanted in (8.0, 4.0):
    for _ in range(160):
        car.apply_ackermann_control(carla.VehicleAckermannControl(speed=wanted, acceleration=3.0))
        world.tick()
    near(speed(car), wanted, 0.05, "Ackermann speed")
car.destroy()
passed("ackermann")

# Constant velocity: along the car's own axis, held against everything.
car = fresh()
car.enable_constant_velocity(carla.Vector3D(6.0, 0.0, 0.0))
ticks(20)
for _ in range(40):
    world.tick()
    near(speed(car), 6.0, 0.02, "held speed")
car.disable_constant_velocity()
car.apply_control(carla.VehicleControl(brake=1.0))
ticks(60)
assert speed(car) < 0.1
car.destroy()
passed("constant velocity")

# Gravity and pushes: in free air Δv is J/m and F·t/m, and without gravity nothing falls.
car = fresh()
mass = car.get_physics_control().mass
car.set_enable_gravity(False)
place = car.get_transform()
place.location.z += 8.0
car.set_transform(place)
car.set_target_velocity(carla.Vector3D())
ticks(20)
assert abs(car.get_location().z - place.location.z) < 0.05, "it floats"
before = car.get_velocity()
car.add_impulse(carla.Vector3D(0.0, 0.0, 2.0 * mass))
world.tick()
near(car.get_velocity().z - before.z, 2.0, 0.03, "velocity after an impulse")
before = car.get_velocity()
car.add_force(carla.Vector3D(0.0, 0.0, -10.0 * mass))
world.tick()
near(car.get_velocity().z - before.z, -10.0 * DT, 0.05, "velocity after a force of one step")
car.set_target_velocity(carla.Vector3D())
world.tick()
car.set_enable_gravity(True)
height = car.get_location().z
ticks(12)
near(height - car.get_location().z, 0.5 * G * (12 * DT) ** 2, 0.12, "fall in 0.6 s")
car.destroy()
passed("pushes")

# Without physics a vehicle stands where it is put and takes no pedals; with it again it drives.
car = fresh()
car.set_simulate_physics(False)
place = car.get_transform()
place.location.z += 3.0
car.set_transform(place)
car.apply_control(carla.VehicleControl(throttle=1.0))
ticks(20)
assert car.get_location().distance(place.location) < 0.01, "it hangs where it was put"
place.location.z -= 3.0
car.set_transform(place)
car.set_simulate_physics(True)
car.apply_control(carla.VehicleControl(throttle=1.0))
ticks(40)
assert speed(car) > 3.0
car.destroy()
passed("no physics")

# Telemetry and wheels agree with the snapshot.
car = fresh()
car.apply_control(carla.VehicleControl(throttle=0.6))
ticks(50)
telemetry = car.get_telemetry_data()
near(telemetry.speed, speed(car), 0.02, "speed by telemetry")
assert len(telemetry.wheels) == 4 and telemetry.engine_rpm > 500 and abs(telemetry.throttle - 0.6) < 1e-3
car.apply_control(carla.VehicleControl(brake=1.0))
ticks(100)
car.apply_control(carla.VehicleControl(brake=1.0, steer=0.5))
ticks(20)
left = car.get_wheel_steer_angle(carla.VehicleWheelLocation.FL_Wheel)
right = car.get_wheel_steer_angle(carla.VehicleWheelLocation.FR_Wheel)
assert left > 10 and right > 10, (left, right)
assert right > left, "the inner wheel turns more"
car.destroy()
passed("telemetry")

settings.synchronous_mode = False
world.apply_settings(settings)
