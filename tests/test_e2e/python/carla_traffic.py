"""The client's own Traffic Manager through the stock `carla` 0.9.16 wheel against gantry-carla.

    carla_traffic.py PORT TM_PORT [sync|async SECONDS]

Without a mode: lights, paths, speeds and hybrid physics, then fifty cars for a minute. With one: only fifty cars, for that simulated time.
Prints "NAME passed" per theme; the first thing that is not as it should be ends the script.
"""

import random
import sys

import carla
from carla_kit import STEP_SECS, connect, passed, run, run_checks, shut_down, speed, synchronous_manager

PORT, TM_PORT = int(sys.argv[1]), int(sys.argv[2])
N_CARS = 50


class Stage:
    """A synchronous (or free) world without vehicles, and its Traffic Manager."""

    def __init__(self, client, synchronous):
        self.client, self.world, self.synchronous = client, client.get_world(), synchronous
        self.library, self.map = self.world.get_blueprint_library(), self.world.get_map()
        self.clear()
        if synchronous:
            settings = self.world.get_settings()
            settings.synchronous_mode, settings.fixed_delta_seconds = True, STEP_SECS
            self.world.apply_settings(settings)
        self.manager = synchronous_manager(client, TM_PORT) if synchronous else client.get_trafficmanager(TM_PORT)
        self.manager.set_random_device_seed(7)
        self.tick()

    def tick(self, n=1):
        for _ in range(n):
            self.world.tick() if self.synchronous else self.world.wait_for_tick(60.0)

    def car(self, place, model="vehicle.tesla.model3", role="autopilot"):
        blueprint = self.library.find(model) if isinstance(model, str) else model
        blueprint.set_attribute("role_name", role)
        place.location.z += 0.3
        return self.world.try_spawn_actor(blueprint, place)

    def drive(self, *cars):
        self.tick()
        for car in cars:
            car.set_autopilot(True, TM_PORT)

    def clear(self):
        """Also the vehicle of the launch file, which would stand in everybody's way."""
        for actor in self.world.get_actors().filter("vehicle.*"):
            actor.destroy()
        self.tick()


def check_lights(stage):
    """Before a red light, one car waits behind the line and the one that ignores all lights drives on; green lets the first go."""
    lights = [light for light in stage.world.get_actors().filter("traffic.traffic_light*") if light.get_stop_waypoints()]
    approaches = []
    for light in sorted(lights, key=lambda light: light.id):
        line = light.get_stop_waypoints()[0]
        back = line.previous(30.0)
        if back and all(back[0].transform.location.distance(other.get_location()) > 60.0 for _, other, _ in approaches):
            approaches.append((line, light, back[0]))
    light_cars = []
    for light in lights:
        light.set_state(carla.TrafficLightState.Red)
        light.freeze(True)
    for (line, light, place), ignores in zip(approaches[:2], (0, 100)):
        car = stage.car(place.transform)
        assert car is not None
        light_cars.append(car)
        stage.manager.auto_lane_change(car, False)
        stage.manager.ignore_lights_percentage(car, ignores)
    stage.drive(*light_cars)
    waiting, through = light_cars
    ways, last = [0.0, 0.0], [car.get_location() for car in light_cars]
    for _ in range(400):
        stage.tick()
        for i, car in enumerate(light_cars):
            at = car.get_location()
            ways[i] += at.distance_2d(last[i])
            last[i] = at
    assert waiting.is_at_traffic_light() and waiting.get_traffic_light_state() == carla.TrafficLightState.Red
    line = approaches[0][0].transform
    nose = line.location - waiting.get_location()
    ahead_m = nose.x * line.get_forward_vector().x + nose.y * line.get_forward_vector().y - waiting.bounding_box.extent.x
    assert speed(waiting) < 0.05 and -1.0 < ahead_m < 12.0, f"{ahead_m} m from its nose to the line"
    assert ways[1] > 60.0 and speed(through) < 20.0, ways
    for light in lights:
        light.set_state(carla.TrafficLightState.Green)
    stage.tick(100)
    assert waiting.get_location().distance_2d(last[0]) > 10.0, "green lets it go"
    for light in lights:
        light.freeze(False)
    stage.world.reset_all_traffic_lights()
    stage.clear()


def check_paths(stage):
    """At every fork a car takes the way that its path says, in two runs that differ at the first fork."""
    start = next(waypoint for waypoint in map(fork_ahead, spawn_waypoints(stage)) if waypoint)
    ends = []
    for which in (0, -1):
        route = path_from(start, which)
        car = stage.car(start.transform)
        assert car is not None
        stage.manager.auto_lane_change(car, False)
        stage.manager.ignore_lights_percentage(car, 100)
        stage.manager.set_path(car, route)
        stage.drive(car)
        missing = list(route)
        for _ in range(1200):
            stage.tick()
            if missing and car.get_location().distance_2d(missing[0]) < 3.0:
                missing.pop(0)
            if not missing:
                break
        assert not missing, f"{len(missing)} of {len(route)} places of the path were not reached, next {missing[0]}, now {car.get_location()}"
        ends.append(car.get_location())
        stage.clear()
    assert ends[0].distance(ends[1]) > 15.0, "the two paths part"


def spawn_waypoints(stage):
    return [stage.map.get_waypoint(point.location) for point in stage.map.get_spawn_points()]


def fork_ahead(waypoint):
    """The place itself if the first junction ahead, within 60 m, leaves a choice."""
    at = waypoint
    for _ in range(30):
        following = at.next(2.0)
        if not following:
            return None
        if len(following) > 1:
            return waypoint
        at = following[0]
    return None


def path_from(start, which):
    """Places every 8 m or so over 150 m, the `which`-th way at each fork (from right to left)."""
    places, at = [], start
    for n in range(75):
        following = at.next(2.0)
        if not following:
            break
        following.sort(key=lambda w: (w.transform.rotation.yaw - at.transform.rotation.yaw + 540.0) % 360.0)
        at = following[which if len(following) > 1 else 0]
        if n % 4 == 3:
            places.append(at.transform.location)
    return places


def check_speeds(stage):
    """Cars keep to the share of the limit that they are told."""
    point = max(stage.map.get_spawn_points(), key=straight_m(stage))
    car = stage.car(point)
    stage.manager.auto_lane_change(car, False)
    stage.manager.ignore_lights_percentage(car, 100)
    stage.manager.vehicle_percentage_speed_difference(car, 60)
    stage.drive(car)
    fastest = 0.0
    for _ in range(240):
        stage.tick()
        fastest = max(fastest, speed(car) * 3.6 / car.get_speed_limit())
    assert 0.3 < fastest < 0.45, fastest
    stage.clear()


def straight_m(stage):
    def measure(point):
        at, way_m = stage.map.get_waypoint(point.location), 0.0
        while way_m < 100.0:
            following = at.next(5.0)
            if len(following) != 1 or abs(following[0].transform.rotation.yaw - point.rotation.yaw) % 360.0 > 2.0:
                break
            at, way_m = following[0], way_m + 5.0
        return way_m

    return measure


def check_hybrid(stage):
    """Round the hero cars are driven by pedals; far from it they are put where they should be, and their pedals are not touched."""
    points = stage.map.get_spawn_points()
    hero = stage.car(points[0], role="hero")
    stage.manager.set_hybrid_physics_mode(True)
    stage.manager.set_hybrid_physics_radius(60.0)
    near = [p for p in points[1:] if p.location.distance(hero.get_location()) < 45.0][:3]
    far = [p for p in points if p.location.distance(hero.get_location()) > 150.0][:12]
    cars = [car for car in map(stage.car, near + far) if car]
    stage.drive(*cars)
    pedals, were_near = {car.id: [] for car in cars}, set()
    for _ in range(200):
        stage.tick()
        for car in cars:
            away, moves = car.get_location().distance(hero.get_location()), speed(car) > 1.0
            if away < 80.0:
                # From now on the pedals stay as they were last.
                were_near.add(car.id)
            if moves and (away < 50.0 or car.id not in were_near):
                pedals[car.id].append((away < 50.0, car.get_control().throttle > 0.0))
    seen = [pair for pairs in pedals.values() for pair in pairs[10:]]
    close, distant = [pedal for is_near, pedal in seen if is_near], [pedal for is_near, pedal in seen if not is_near]
    assert len(distant) > 200 and not any(distant), f"{sum(distant)} of {len(distant)} moments of far cars with throttle"
    assert len(close) > 20 and any(close), f"{sum(close)} of {len(close)} moments of near cars with throttle"
    stage.manager.set_hybrid_physics_mode(False)
    stage.clear()


def check_fifty(stage, secs):
    """Fifty cars at default settings: nobody touches anybody, and everybody gets somewhere."""
    generator = random.Random(11)
    models = sorted((b for b in stage.library.filter("vehicle.*") if b.get_attribute("base_type").as_str() == "car"), key=lambda b: b.id)
    points = stage.map.get_spawn_points()
    generator.shuffle(points)
    cars = []
    for point in points:
        if len(cars) < N_CARS:
            car = stage.car(point, generator.choice(models))
            cars += [car] if car else []
    assert len(cars) == N_CARS, len(cars)
    blows, sensors = [], []
    for car in cars:
        sensor = stage.world.spawn_actor(stage.library.find("sensor.other.collision"), carla.Transform(), attach_to=car)
        sensor.listen(blows.append)
        sensors.append(sensor)
    # They drop onto their wheels.
    stage.tick(20)
    blows.clear()
    stage.drive(*cars)
    ways, last = {car.id: 0.0 for car in cars}, {}
    gone = set()
    begin = stage.world.get_snapshot().timestamp.elapsed_seconds
    while (snapshot := stage.world.get_snapshot()).timestamp.elapsed_seconds < begin + secs:
        stage.tick()
        for car in cars:
            seen = snapshot.find(car.id)
            if seen is None:
                gone.add(car.id)
                continue
            at = seen.get_transform().location
            ways[car.id] += at.distance_2d(last.get(car.id, at))
            last[car.id] = at
    said = [f"{b.timestamp - begin:.1f} s: {b.actor.type_id} and {b.other_actor.type_id} at {b.transform.location}" for b in blows]
    moved = sorted(ways.values())
    print(f"{N_CARS} cars, {secs:.0f} s: {sum(moved) / 1e3:.1f} km, {moved[0]:.0f} to {moved[-1]:.0f} m each, {len(blows)} collisions, "
          f"{len(gone)} taken away by the Traffic Manager", flush=True)
    assert not said, said[:10]
    # Who stands before a red light at first has still come away after a minute.
    assert moved[5] > min(secs, 60.0) * 1.5, moved
    for sensor in sensors:
        sensor.stop()
        sensor.destroy()
    if stage.synchronous:
        shut_down(stage.manager)
    else:
        stage.manager.shut_down()


def main():
    client = connect(PORT)
    if sys.argv[3:]:
        mode, secs = sys.argv[3], float(sys.argv[4])
        check_fifty(Stage(client, mode == "sync"), secs)
        passed(mode)
        return
    stage = Stage(client, True)
    run_checks({"lights": check_lights, "paths": check_paths, "speeds": check_speeds, "hybrid": check_hybrid}, stage)
    check_fifty(stage, 60.0)
    passed("fifty")


run(main)
