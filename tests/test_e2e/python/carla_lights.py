"""The stock `carla` 0.9.16 wheel: traffic lights' times, groups, resets, boxes; what a car before a light knows; weather presets.

    carla_lights.py PORT

Prints "NAME passed" per theme; the first thing that is not as it should be ends the script.
"""

import math
import sys

import carla
from carla_kit import STEP_SECS, near, run, run_checks, stage, turn_deg

PORT = int(sys.argv[1])
STATE = carla.TrafficLightState


def ticks_until(world, light, state, most=4000):
    for tick in range(most):
        if light.get_state() == state:
            return tick
        world.tick()
    raise AssertionError(f"light {light.id} is never {state}")


def check_times(world, lights):
    light = next(one for one in lights if one.get_state() == STATE.Green)
    assert (light.get_green_time(), light.get_yellow_time(), light.get_red_time()) == (10.0, 3.0, 2.0)
    light.set_green_time(2.0)
    light.set_yellow_time(0.5)
    light.set_red_time(1.0)
    light.reset_group()
    world.tick()
    assert (light.get_green_time(), light.get_yellow_time(), light.get_red_time()) == (2.0, 0.5, 1.0)
    assert near(light.get_elapsed_time(), STEP_SECS), light.get_elapsed_time()
    # One tick of the stage was the one above.
    assert ticks_until(world, light, STATE.Yellow) == 39
    assert ticks_until(world, light, STATE.Red) == 10
    group = light.get_group_traffic_lights()
    assert light.id in [one.id for one in group] and sorted(one.get_pole_index() for one in group) == list(range(len(group)))
    for _ in range(20):
        assert all(one.get_state() == STATE.Red for one in group)
        world.tick()
    green = [one.id for one in group if one.get_state() == STATE.Green]
    assert green and light.id not in green, "the next controller's turn"
    world.reset_all_traffic_lights()
    world.tick()
    assert light.get_state() == STATE.Green and near(light.get_elapsed_time(), STEP_SECS)
    light.set_green_time(10.0)
    light.set_yellow_time(3.0)
    light.set_red_time(2.0)
    world.tick()


def check_states(world, lights):
    first, other = lights[0], lights[-1]
    first.freeze(True)
    world.tick()
    assert first.is_frozen() and other.is_frozen(), "freezing one freezes all"
    for state in (STATE.Off, STATE.Unknown, STATE.Yellow, STATE.Red, STATE.Green):
        first.set_state(state)
        before = other.get_state()
        for _ in range(3):
            world.tick()
        assert first.get_state() == state and other.get_state() == before
    world.freeze_all_traffic_lights(False)
    world.tick()
    assert not first.is_frozen() and not other.is_frozen()


def check_boxes(world, lights):
    town = world.get_map()
    n_stops = 0
    for light in lights:
        boxes = light.get_light_boxes()
        assert boxes
        for box in boxes:
            assert box.location.distance(light.get_location()) < 25.0 and 0.02 < box.extent.z < 1.0
        volume = light.trigger_volume
        # Across the lanes along x, a box of 3 m along y, as far as the lanes run straight.
        assert volume.extent.x > 0.5 and 1.0 < volume.extent.y, volume.extent
        transform = light.get_transform()
        centre = carla.Location(volume.location)
        transform.transform(centre)
        on_lane = town.get_waypoint(centre)
        assert centre.distance_2d(on_lane.transform.location) < 8.0
        stops = light.get_stop_waypoints()
        affected = light.get_affected_lane_waypoints()
        assert stops and affected, light.id
        for stop in stops:
            n_stops += 1
            assert not stop.is_junction, "one stops before the junction"
            # Its x axis lies to the right of the traffic.
            assert turn_deg(stop.transform.rotation.yaw + 90.0, transform.rotation.yaw) < 30.0, (stop, transform)
            ahead = stop
            for _ in range(60):
                following = ahead.next(0.5)
                if not following or following[0].is_junction:
                    break
                ahead = following[0]
            assert following and following[0].is_junction, "a junction follows"
    print(f"{len(lights)} lights with {n_stops} stop waypoints")
    assert n_stops >= len(lights)


def check_cars(world, lights):
    blueprint = world.get_blueprint_library().find("vehicle.mini.cooper_s")
    seen = 0
    for light in lights:
        if seen == 6:
            break
        centre = carla.Location(light.trigger_volume.location)
        light.get_transform().transform(centre)
        stop = world.get_map().get_waypoint(centre)
        place = stop.transform
        place.location.z += 0.3
        car = world.try_spawn_actor(blueprint, place)
        if car is None:
            continue
        car.apply_control(carla.VehicleControl(hand_brake=True))
        world.tick()
        assert car.is_at_traffic_light(), (light.id, place)
        at = car.get_traffic_light()
        assert at is not None and at.get_opendrive_id() == light.get_opendrive_id()
        for state in (STATE.Red, STATE.Green, STATE.Yellow):
            light.set_state(state)
            world.tick()
            assert car.get_traffic_light_state() == light.get_state() == state
        assert car.get_speed_limit() > 0.0
        away = world.get_map().get_spawn_points()[0]
        away.location.z += 50.0
        car.set_transform(away)
        world.tick()
        assert not car.is_at_traffic_light() and car.get_traffic_light() is None and car.get_traffic_light_state() == STATE.Green
        car.destroy()
        seen += 1
    assert seen >= 3, seen


def check_signs(world):
    signs = [actor for actor in world.get_actors().filter("traffic.*") if actor.type_id != "traffic.traffic_light"]
    landmarks = {mark.id: mark for mark in world.get_map().get_all_landmarks()}
    for sign in signs:
        # The id in the snapshot joins actors and landmarks.
        names = [name for name, mark in landmarks.items() if (found := world.get_traffic_sign(mark)) is not None and found.id == sign.id]
        assert names, sign
        volume = sign.trigger_volume
        assert volume.extent.x > 0.0 and volume.extent.y > 0.0, (sign, volume)
    limits = [sign for sign in signs if sign.type_id.startswith("traffic.speed_limit.")]
    assert limits, [sign.type_id for sign in signs]
    print(f"{len(signs)} signs, {len(limits)} of them speed limits")


def check_weather(world):
    presets = [name for name in dir(carla.WeatherParameters) if isinstance(getattr(carla.WeatherParameters, name), carla.WeatherParameters)]
    assert len(presets) >= 22, presets
    fields = ["cloudiness", "precipitation", "precipitation_deposits", "wind_intensity", "sun_altitude_angle", "fog_density",
              "fog_distance", "fog_falloff", "wetness", "scattering_intensity", "mie_scattering_scale", "rayleigh_scattering_scale", "dust_storm"]
    before = world.get_weather()
    for name in presets:
        wanted = getattr(carla.WeatherParameters, name)
        world.set_weather(wanted)
        now = world.get_weather()
        if name == "Default":
            continue
        for field in fields:
            assert near(getattr(now, field), getattr(wanted, field), 1e-4), (name, field, getattr(now, field), getattr(wanted, field))
        assert 0.0 <= now.sun_azimuth_angle < 360.0
    odd = carla.WeatherParameters(cloudiness=900.0, sun_altitude_angle=-200.0, sun_azimuth_angle=45.0, dust_storm=-3.0)
    world.set_weather(odd)
    now = world.get_weather()
    assert (now.cloudiness, now.sun_altitude_angle, now.dust_storm) == (100.0, -90.0, 0.0) and near(now.sun_azimuth_angle, 45.0)
    world.set_weather(before)


def main():
    _, world = stage(PORT)
    lights = sorted(world.get_actors().filter("traffic.traffic_light"), key=lambda light: light.id)
    assert len(lights) > 4 and all(math.isfinite(light.get_location().x) for light in lights)
    checks = {
        "times": lambda: check_times(world, lights),
        "states": lambda: check_states(world, lights),
        "boxes": lambda: check_boxes(world, lights),
        "cars": lambda: check_cars(world, lights),
        "signs": lambda: check_signs(world),
        "weather": lambda: check_weather(world),
    }
    run_checks(checks)


run(main)
