"""The stock `carla` 0.9.16 wheel: a car under the PID controller that CARLA's own agents have follows its lane.

    carla_controller.py PORT TOWN...

Structure and gains are the published ones of CARLA's local planner at its defaults: lateral 1.95, 0.05, 0.2 on the angle to a way point 3 m and
half a second's way ahead, longitudinal 1.0, 0.05, 0 on km/h, 20 steps per second. Beside the car goes a point on two wheels with the car's
wheelbase, steering and speed, under a controller of its own: plane geometry without tyres, engine or suspension. What it leaves of the lane is
the controller's doing, what the car leaves beyond that is ours.
"""

import itertools
import math
import random
import sys
from collections import deque

import carla
from carla_kit import STEP_SECS, connect, run, step_by_hand

PORT = int(sys.argv[1])
SPACING_M = 2.0
ROUTE_M = 700.0
MIN_ROUTE_M = 300.0
N_ROUTES = 3
# 20 km/h is what CARLA's agents drive when nobody tells them otherwise.
TOWN_KMH, FAST_KMH = 20.0, 60.0
FAST_TOWNS = ("Town04", "Town06")
# Where a car drives fast, bends ask for no more than this: a third of what tyres hold on dry ground.
BEND_MPS2 = 3.0
# Beyond what geometry leaves of the lane.
SLACK_M = 0.25


class Pid:
    """Terms over the last ten errors, clipped to ±1."""

    def __init__(self, p, i, d):
        self.gains, self.errors = (p, i, d), deque(maxlen=10)

    def step(self, error):
        p, i, d = self.gains
        self.errors.append(error)
        slope = (self.errors[-1] - self.errors[-2]) / STEP_SECS if len(self.errors) > 1 else 0.0
        total = sum(self.errors) * STEP_SECS if len(self.errors) > 1 else 0.0
        return max(-1.0, min(1.0, p * error + i * total + d * slope))


class Controller:
    """Drives along points; steering changes by a tenth a step at most."""

    def __init__(self, route, wanted_kmh):
        self.route, self.wanted_kmh = deque(route), wanted_kmh
        self.lateral, self.along, self.steer = Pid(1.95, 0.05, 0.2), Pid(1.0, 0.05, 0.0), 0.0

    def step(self, x, y, yaw_rad, speed_mps):
        """Throttle, brake, steer; nothing once the route is done."""
        while self.route and math.hypot(self.route[0][0] - x, self.route[0][1] - y) < (3.0 + 0.5 * speed_mps if len(self.route) > 1 else 1.0):
            self.route.popleft()
        if not self.route:
            return None
        to_x, to_y = self.route[0][0] - x, self.route[0][1] - y
        angle = math.atan2(math.cos(yaw_rad) * to_y - math.sin(yaw_rad) * to_x, math.cos(yaw_rad) * to_x + math.sin(yaw_rad) * to_y)
        wished = max(self.steer - 0.1, min(self.steer + 0.1, self.lateral.step(angle)))
        self.steer = max(-0.8, min(0.8, wished))
        pedal = self.along.step(self.wanted_kmh - 3.6 * speed_mps)
        return min(max(pedal, 0.0), 0.75), min(max(-pedal, 0.0), 0.3), self.steer


class Bicycle:
    """Rear axle, front axle, no slip; the reference is where the car's is."""

    def __init__(self, car, place):
        control = car.get_physics_control()
        here = car.get_transform()
        ahead = here.get_forward_vector()
        along = [(w.position.x / 100 - here.location.x) * ahead.x + (w.position.y / 100 - here.location.y) * ahead.y for w in control.wheels]
        self.rear_m, self.base_m = -min(along), max(along) - min(along)
        self.max_steer_rad = math.radians(max(wheel.max_steer_angle for wheel in control.wheels))
        self.curve = [(point.x / 3.6, point.y) for point in control.steering_curve]
        self.yaw = math.radians(place.rotation.yaw)
        self.x, self.y = place.location.x - self.rear_m * math.cos(self.yaw), place.location.y - self.rear_m * math.sin(self.yaw)

    def reference(self):
        return self.x + self.rear_m * math.cos(self.yaw), self.y + self.rear_m * math.sin(self.yaw)

    def share(self, speed_mps):
        """How much of its steering a car has at a speed."""
        before = self.curve[0]
        for point in self.curve:
            if speed_mps <= point[0]:
                width = point[0] - before[0]
                return point[1] if width <= 0.0 else before[1] + (point[1] - before[1]) * (speed_mps - before[0]) / width
            before = point
        return before[1]

    def step(self, steer, speed_mps):
        angle, n = steer * self.max_steer_rad * self.share(speed_mps), 10
        for _ in range(n):
            self.x += speed_mps * STEP_SECS / n * math.cos(self.yaw)
            self.y += speed_mps * STEP_SECS / n * math.sin(self.yaw)
            self.yaw += speed_mps * STEP_SECS / n * math.tan(angle) / self.base_m


def turned_rad(a, b):
    return abs((math.radians(b.transform.rotation.yaw - a.transform.rotation.yaw) + math.pi) % (2.0 * math.pi) - math.pi)


def route_from(town, point, rng, speed_mps):
    """Middles of lanes every 2 m: in towns any way at junctions, where it is fast the straightest, up to the first bend that is too sharp."""
    here, route = town.get_waypoint(point.location), []
    most_rad = BEND_MPS2 / speed_mps**2 * SPACING_M if speed_mps > TOWN_KMH / 3.6 else math.inf
    while len(route) * SPACING_M < ROUTE_M:
        route.append((here.transform.location.x, here.transform.location.y))
        ways = sorted(here.next(SPACING_M), key=lambda one: (one.road_id, one.lane_id))
        if not ways:
            break
        way = min(ways, key=lambda one: turned_rad(here, one)) if most_rad < math.inf else rng.choice(ways)
        if turned_rad(here, way) > most_rad:
            break
        here = way
    return route


class Way:
    """How far a place is from the route, looked for about where it was found before."""

    def __init__(self, route):
        self.route, self.at = route, 0

    def off_m(self, x, y):
        best, at = math.inf, self.at
        for idx in range(max(0, self.at - 3), min(len(self.route) - 1, self.at + 12)):
            (ax, ay), (bx, by) = self.route[idx], self.route[idx + 1]
            length = math.hypot(bx - ax, by - ay)
            along = max(0.0, min(1.0, ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / length**2)) if length > 1e-6 else 0.0
            apart = math.hypot(x - ax - along * (bx - ax), y - ay - along * (by - ay))
            if apart < best:
                best, at = apart, idx
        self.at = at
        return best


def drive(world, point, route, wanted_kmh):
    """Worst distances from the route of the car and of its model, metres, and how the car ended."""
    library = world.get_blueprint_library()
    car = world.spawn_actor(library.find("vehicle.lincoln.mkz_2020"), point)
    bumper = world.spawn_actor(library.find("sensor.other.collision"), carla.Transform(), attach_to=car)
    hits = []
    bumper.listen(lambda event: hits.append((event.frame, event.other_actor.type_id)))
    world.tick()
    pilot, twin, model = Controller(route, wanted_kmh), Controller(route, wanted_kmh), Bicycle(car, car.get_transform())
    ways, worst, is_done = (Way(route), Way(route)), [0.0, 0.0], False
    for _ in range(int(4.0 * ROUTE_M / (wanted_kmh / 3.6) / STEP_SECS)):
        world.tick()
        at, velocity = car.get_transform(), car.get_velocity()
        speed_mps = velocity.length()
        control = pilot.step(at.location.x, at.location.y, math.radians(at.rotation.yaw), speed_mps)
        if control is None:
            is_done = True
            break
        throttle, brake, steer = control
        car.apply_control(carla.VehicleControl(throttle=throttle, brake=brake, steer=steer))
        x, y = model.reference()
        follows = twin.step(x, y, model.yaw, speed_mps)
        if follows is not None:
            model.step(follows[2], speed_mps)
        for idx, place in enumerate(((at.location.x, at.location.y), (x, y))):
            worst[idx] = max(worst[idx], ways[idx].off_m(*place))
    bumper.stop()
    bumper.destroy()
    car.destroy()
    world.tick()
    return worst, is_done, hits


def check_town(client, name):
    world = client.get_world()
    if not world.get_map().name.endswith(name):
        world = client.load_world(name)
    step_by_hand(world)
    world.tick()
    wanted_kmh = FAST_KMH if name in FAST_TOWNS else TOWN_KMH
    rng, points = random.Random(5), world.get_map().get_spawn_points()
    rng.shuffle(points)
    routes = ((point, route_from(world.get_map(), point, rng, wanted_kmh / 3.6)) for point in points)
    long_enough = ((point, route) for point, route in routes if len(route) * SPACING_M >= MIN_ROUTE_M)
    driven = list(itertools.islice(long_enough, N_ROUTES))
    assert len(driven) == N_ROUTES, (name, len(driven))
    for point, route in driven:
        (car_m, model_m), is_done, hits = drive(world, point, route, wanted_kmh)
        where = f"{name} at {wanted_kmh:.0f} km/h from ({point.location.x:.0f}, {point.location.y:.0f}) for {len(route) * SPACING_M:.0f} m"
        print(f"{where}: the car leaves the lane's middle by {car_m:.2f} m, geometry alone by {model_m:.2f} m", flush=True)
        assert is_done and not hits, (where, is_done, hits[:3])
        assert car_m < model_m + SLACK_M, (where, car_m, model_m)
    print(f"{name} passed", flush=True)


def main():
    client = connect(PORT)
    for name in sys.argv[2:]:
        check_town(client, name)


run(main)
