"""Every command of a batch, and calls that nothing else looks at, by what they do, through the stock `carla` 0.9.16 wheel; what no method of the
wheel calls, over its protocol.

Usage: carla_commands.py PORT. Prints "<theme> passed" after each theme. Expected values are Newton's.
"""

import math
import os
import sys
import tempfile
import time

import carla
from carla_kit import PATIENCE_SECS, STEP_SECS, Wire, connect, listen, must_be, near, run, run_checks, speed, step_by_hand, ticks, turn_deg, unevenness

G = 9.81
# Commands of a batch that the wheel has no class for.
APPLY_LOCATION, SET_TRAFFIC_LIGHT_STATE = 19, 21
GAINS = ("speed_kp", "speed_ki", "speed_kd", "accel_kp", "accel_ki", "accel_kd")

client = connect(sys.argv[1])
world = client.get_world()
original = step_by_hand(world)
library = world.get_blueprint_library()
does = carla.command
wire = Wire(sys.argv[1])

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
    # Its limbs show the speed at which it is led.
    for pace_mps in (1.5, 0.0):
        strides = set()
        for step in range(16):
            place.location += pace_mps * STEP_SECS * place.get_forward_vector()
            do(does.ApplyWalkerState(walker, place, pace_mps))
            if step < 8:
                continue
            [knee] = [bone.component.location for bone in walker.get_bones().bone_transforms if bone.name == "crl_leg__L"]
            strides.add(round(knee.x, 3))
        assert (len(strides) > 4) == (pace_mps > 0.0), (pace_mps, strides)
    # The rotation stays where only the place is told.
    rotation = car.get_transform().rotation
    elsewhere = START.location - 10.0 * START.get_forward_vector()
    car.set_location(elsewhere)
    world.tick()
    seen = car.get_transform()
    assert seen.location.distance_2d(elsewhere) < 0.1 and turn_deg(seen.rotation.yaw, rotation.yaw) < 0.1, (seen, elsewhere)
    back = carla.Location(elsewhere.x, elsewhere.y, elsewhere.z) + 3.0 * START.get_forward_vector()
    wire.batch((APPLY_LOCATION, [car.id, [back.x, back.y, back.z]]))
    world.tick()
    seen = car.get_transform()
    assert seen.location.distance_2d(back) < 0.1 and turn_deg(seen.rotation.yaw, rotation.yaw) < 0.1, (seen, back)
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


def check_levers():
    """An impulse and a force of one step beside the middle push and turn; a torque only turns."""
    box, inertia = in_the_air(), 40.0 / 6.0
    push = [0.0, 20.0, 0.0]
    for method, times in (("add_actor_impulse_at_location", 1.0), ("add_actor_force_at_location", 1.0 / STEP_SECS)):
        do(does.ApplyTransform(box, carla.Transform(START.location + carla.Location(z=20.0), carla.Rotation())))
        do(does.ApplyTargetVelocity(box, carla.Vector3D()), does.ApplyTargetAngularVelocity(box, carla.Vector3D()))
        ahead = box.get_transform().transform(box.bounding_box.location + carla.Location(x=0.5))
        wire.call(method, box.id, [times * newton_secs for newton_secs in push], [ahead.x, ahead.y, ahead.z])
        world.tick()
        must_be(box.get_velocity().y, 20.0 / 40.0, 0.03, f"velocity after {method}")
        # From x towards y is a positive yaw.
        must_be(box.get_angular_velocity().z, math.degrees(0.5 * 20.0 / inertia), 0.05, f"turn after {method}")
    do(does.ApplyTargetVelocity(box, carla.Vector3D()), does.ApplyTargetAngularVelocity(box, carla.Vector3D()))
    wire.call("add_actor_torque", box.id, [0.0, 0.0, inertia * math.radians(90.0) / STEP_SECS])
    for _ in range(2):
        world.tick()
        must_be(box.get_angular_velocity().z, 90.0, 0.05, "turn after a torque of one step")
    assert speed(box) < 0.01, speed(box)
    box.destroy()


def check_wheels():
    """Wheels are shown as they are told until the next control."""
    car, at = fresh(), carla.VehicleWheelLocation
    car.set_wheel_steer_direction(at.FL_Wheel, 20.0)
    car.set_wheel_pitch_angle(at.BR_Wheel, 50.0)
    world.tick()
    assert near(car.get_wheel_steer_angle(at.FL_Wheel), 20.0, 0.01) and near(car.get_wheel_steer_angle(at.FR_Wheel), 0.0, 0.1)
    assert near(car.get_wheel_pitch_angle(at.BR_Wheel), 50.0, 0.5), car.get_wheel_pitch_angle(at.BR_Wheel)
    # The wheel does not send a control that is the last one.
    car.apply_control(carla.VehicleControl(brake=1.0))
    ticks(world, 3)
    assert near(car.get_wheel_steer_angle(at.FL_Wheel), 0.0, 0.1), car.get_wheel_steer_angle(at.FL_Wheel)
    car.destroy()


def check_boxes():
    """Of an actor as the wheel knows it; of one that does not exist an empty one."""
    car = fresh()
    place, half = wire.call("get_actor_bounding_box", car.id)[:2]
    for seen, wanted in ((place, car.bounding_box.location), (half, car.bounding_box.extent)):
        assert all(near(a, b, 1e-5) for a, b in zip(seen, (wanted.x, wanted.y, wanted.z))), (seen, wanted)
    assert wire.call("get_actor_bounding_box", 4_000_000)[1] == [0.0, 0.0, 0.0]
    car.destroy()


def check_traffic_lights():
    """A batch sets a light's state; freezing all keeps it."""
    lights = sorted(world.get_actors().filter("traffic.traffic_light"), key=lambda light: light.id)
    world.freeze_all_traffic_lights(True)
    world.tick()
    assert all(light.is_frozen() for light in lights)
    for state in (carla.TrafficLightState.Yellow, carla.TrafficLightState.Off):
        others = [light.get_state() for light in lights[1:]]
        wire.batch((SET_TRAFFIC_LIGHT_STATE, [lights[0].id, int(state)]))
        ticks(world, 3)
        assert lights[0].get_state() == state and [light.get_state() for light in lights[1:]] == others
    world.freeze_all_traffic_lights(False)
    world.reset_all_traffic_lights()
    world.tick()


def check_registry():
    """A Traffic Manager is found by everybody at the place that was registered, and goes with its connection."""
    port, place = 54321, ["192.0.2.1", 54321]
    mine = Wire(sys.argv[1])
    assert wire.call("is_traffic_manager_running", port) is False and wire.call("get_traffic_manager_running", port) == ["", 0]
    assert mine.call("add_traffic_manager_running", place) is True and mine.call("add_traffic_manager_running", place) is False
    assert wire.call("is_traffic_manager_running", port) is True and wire.call("get_traffic_manager_running", port) == place
    assert wire.call("destroy_traffic_manager", port) is False and wire.call("is_traffic_manager_running", port) is True
    assert mine.call("destroy_traffic_manager", port) is True and wire.call("is_traffic_manager_running", port) is False
    assert mine.call("add_traffic_manager_running", place) is True
    mine.close()
    until = time.monotonic() + PATIENCE_SECS
    while wire.call("is_traffic_manager_running", port):
        assert time.monotonic() < until, "an entry outlives its connection"
        time.sleep(0.01)

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
            file.seek(0)
            assert wire.call("get_navigation_mesh") == file.read()


def check_ros():
    """No sensor publishes to ROS by itself, none has G-buffers."""
    camera, _ = listen(world, library.find("sensor.camera.rgb"), START)
    world.tick()
    assert camera.is_enabled_for_ros() is False
    camera.enable_gbuffers(True)
    assert wire.call("are_gbuffers_enabled", camera.id) is False
    camera.destroy()


def main():
    run_checks({
        "places": check_places,
        "pushes": check_pushes,
        "levers": check_levers,
        "wheels": check_wheels,
        "boxes": check_boxes,
        "traffic lights": check_traffic_lights,
        "registry": check_registry,
        "ackermann": check_ackermann,
        "lamps": check_lamps,
        "collisions": check_collisions,
        "files": check_files,
        "ros": check_ros,
    })
    world.apply_settings(original)


run(main)
