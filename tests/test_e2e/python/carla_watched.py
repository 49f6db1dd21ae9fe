"""The Traffic Manager's methods watched on the road through the stock `carla` 0.9.16 wheel: what a car does after a call is what CARLA's
reference says of that method. For a manager that is served by `gantry-drive`, in a town with long straight roads of several lanes.

    carla_watched.py PORT TM_PORT THEME…

Prints "NAME passed" per theme; the first thing that is not as it should be ends the script.
"""

import math
import sys

import carla
from carla_kit import STEP_SECS, connect, passed, run, speed, step_by_hand

PORT, TM_PORT = int(sys.argv[1]), int(sys.argv[2])
Lights = carla.VehicleLightState


class Road:
    """A synchronous world without vehicles, its manager, and straight roads of several lanes."""

    def __init__(self, client):
        self.client, self.world = client, client.get_world()
        step_by_hand(self.world)
        self.library, self.map = self.world.get_blueprint_library(), self.world.get_map()
        self.manager, self.sensors = client.get_trafficmanager(TM_PORT), []
        self.begin()

    def begin(self):
        """No vehicles and no people, and a manager that knows nothing."""
        for sensor in self.sensors:
            sensor.stop()
        self.sensors = []
        self.manager.shut_down()
        # The wheel's object does nothing any more after its `shut_down`.
        self.manager = self.client.get_trafficmanager(TM_PORT)
        for kind in ("sensor.*", "vehicle.*", "walker.*"):
            for actor in self.world.get_actors().filter(kind):
                actor.destroy()
        self.tick(2)
        self.manager.set_synchronous_mode(True)
        self.manager.set_random_device_seed(7)

    def tick(self, n=1):
        for _ in range(n):
            self.world.tick()

    def straight(self, length_m=250.0, n_lanes=1):
        """The first lane of a road that runs straight on for so long and has so many lanes in this direction, from left to right."""
        for point in self.map.get_spawn_points():
            at = self.map.get_waypoint(point.location)
            left = leftmost(at)
            lanes = lanes_of(left)
            if len(lanes) >= n_lanes and all(straight_m(lane, length_m) >= length_m for lane in lanes):
                return lanes
        raise AssertionError(f"no {n_lanes} lanes are straight for {length_m} m")

    def car(self, waypoint, model="vehicle.tesla.model3", role="autopilot", ahead_m=0.0):
        place = (waypoint.next(ahead_m)[0] if ahead_m else waypoint).transform
        place.location.z += 0.3
        blueprint = self.library.find(model)
        blueprint.set_attribute("role_name", role)
        return self.world.spawn_actor(blueprint, place)

    def drive(self, *cars):
        self.tick()
        for car in cars:
            car.set_autopilot(True, TM_PORT)
            self.manager.ignore_lights_percentage(car, 100.0)

    def stand(self, car):
        """It stands with its brake on."""
        car.apply_control(carla.VehicleControl(brake=1.0, hand_brake=True))

    def lane_of(self, car):
        at = self.map.get_waypoint(car.get_location())
        return at.road_id, at.section_id, at.lane_id

    def blows(self, car):
        """Actors that it touches, from now on."""
        touched = []
        sensor = self.world.spawn_actor(self.library.find("sensor.other.collision"), carla.Transform(), attach_to=car)
        # The wheel stops listening when its object goes.
        self.sensors.append(sensor)
        sensor.listen(lambda event: touched.append(event.other_actor.id))
        return touched


def leftmost(waypoint):
    """The lane next to the oncoming traffic or to the middle."""
    while (left := waypoint.get_left_lane()) and left.lane_type == carla.LaneType.Driving and left.lane_id * waypoint.lane_id > 0:
        waypoint = left
    return waypoint


def lanes_of(waypoint):
    """The lanes from this one to the rightmost."""
    lanes = [waypoint]
    while (right := lanes[-1].get_right_lane()) and right.lane_type == carla.LaneType.Driving:
        lanes.append(right)
    return lanes


def straight_m(waypoint, limit_m):
    at, way_m = waypoint, 0.0
    while way_m < limit_m:
        following = at.next(5.0)
        if len(following) != 1 or following[0].is_junction or following[0].lane_id != waypoint.lane_id:
            break
        turn = following[0].transform.rotation.yaw - waypoint.transform.rotation.yaw
        if abs((turn + 180.0) % 360.0 - 180.0) > 1.0:
            break
        at, way_m = following[0], way_m + 5.0
    return way_m


def ahead_m(place, location):
    """How far a location lies ahead of a place."""
    forward, way = place.get_forward_vector(), location - place.location
    return forward.x * way.x + forward.y * way.y


def right_m(place, location):
    """How far a location lies to the right of a place."""
    right, way = place.get_right_vector(), location - place.location
    return right.x * way.x + right.y * way.y


def gap_m(follower, leader):
    """From the front of one to the back of the other."""
    between = ahead_m(follower.get_transform(), leader.get_location())
    return between - follower.bounding_box.extent.x - follower.bounding_box.location.x - leader.bounding_box.extent.x + leader.bounding_box.location.x


def check_offsets(road):
    """`vehicle_lane_offset` and `global_lane_offset`: metres from the middle of the lane, positive to the right; a car's own wins."""
    lane = road.straight()[0]
    for common_m, own_m in ((0.0, 0.6), (-0.5, None), (0.4, -0.7)):
        car = road.car(lane)
        road.manager.global_lane_offset(common_m)
        if own_m is not None:
            road.manager.vehicle_lane_offset(car, own_m)
        road.manager.auto_lane_change(car, False)
        road.drive(car)
        road.tick(160)
        seen = []
        for _ in range(60):
            road.tick()
            seen.append(right_m(road.map.get_waypoint(car.get_location()).transform, car.get_location()))
        wanted = common_m if own_m is None else own_m
        assert all(abs(offset - wanted) < 0.1 for offset in seen), f"{min(seen):.2f} to {max(seen):.2f} m, asked {wanted}"
        road.begin()


def check_speeds(road):
    """`set_desired_speed` in km/h whatever the limit; `vehicle_percentage_speed_difference` and `global_…`: percent below the limit."""
    lane = road.straight(350.0)[0]
    for name, ask, wanted in (
        ("desired", lambda car: road.manager.set_desired_speed(car, 36.0), lambda limit: 36.0),
        ("vehicle", lambda car: road.manager.vehicle_percentage_speed_difference(car, 40.0), lambda limit: 0.6 * limit),
        ("global", lambda car: road.manager.global_percentage_speed_difference(70.0), lambda limit: 0.3 * limit),
        ("own one wins", lambda car: (road.manager.global_percentage_speed_difference(70.0), road.manager.vehicle_percentage_speed_difference(car, 50.0)), lambda limit: 0.5 * limit),
    ):
        car = road.car(lane)
        ask(car)
        road.manager.auto_lane_change(car, False)
        road.drive(car)
        road.tick(240)
        seen = []
        for _ in range(40):
            road.tick()
            seen.append(3.6 * speed(car))
        limit = car.get_speed_limit()
        mean = sum(seen) / len(seen)
        assert abs(mean - wanted(limit)) < 0.04 * wanted(limit) + 0.5, f"{name}: {mean:.1f} km/h, not {wanted(limit):.1f} (limit {limit})"
        road.begin()


def check_gaps(road):
    """`distance_to_leading_vehicle` and the global one: the least distance from front to back, behind a leader that stops."""
    lane = road.straight(350.0)[0]
    for common_m, own_m in ((9.0, None), (3.0, 7.0)):
        leader, follower = road.car(lane, ahead_m=30.0), road.car(lane)
        road.manager.set_global_distance_to_leading_vehicle(common_m)
        if own_m is not None:
            road.manager.distance_to_leading_vehicle(follower, own_m)
        for car in (leader, follower):
            road.manager.auto_lane_change(car, False)
        road.manager.set_desired_speed(leader, 20.0)
        road.drive(leader, follower)
        nearest = math.inf
        for tick in range(560):
            road.tick()
            if tick == 260:
                road.manager.set_desired_speed(leader, 0.0)
            nearest = min(nearest, gap_m(follower, leader))
            if tick > 400 and speed(leader) < 0.05 and speed(follower) < 0.05:
                break
        wanted = own_m or common_m
        stands = gap_m(follower, leader)
        assert nearest > wanted - 0.5, f"{nearest:.2f} m at the least, asked {wanted}"
        assert stands < wanted + 2.0 and speed(follower) < 0.1, f"it stands {stands:.2f} m behind, asked {wanted}"
        road.begin()


def check_forced(road):
    """`force_lane_change`: true is right, false left; one lane, also for a car that changes none by itself."""
    lanes = road.straight(300.0, 3)
    for to_right in (True, False):
        car = road.car(lanes[1])
        road.manager.auto_lane_change(car, False)
        road.manager.set_desired_speed(car, 40.0)
        road.drive(car)
        road.tick(60)
        assert road.lane_of(car)[2] == lanes[1].lane_id, "nothing was asked yet"
        road.manager.force_lane_change(car, to_right)
        road.tick(180)
        wanted = lanes[2 if to_right else 0].lane_id
        assert road.lane_of(car)[2] == wanted, (to_right, road.lane_of(car), wanted)
        road.begin()


def lanes_seen(road, car, n):
    """Changes of lanes and the last lane, while it stays on the straight."""
    changes, last = [], road.lane_of(car)
    for _ in range(n):
        road.tick()
        now = road.lane_of(car)
        if now[:2] != last[:2]:
            break
        if now != last:
            changes.append(now[2] - last[2])
        last = now
    return changes, last[2]


def check_random(road):
    """`random_left_lanechange_percentage` and its brother: at 100 % a car changes to that side though nothing is in its way, at 0 never;
    `keep_slow_lane_rule_percentage` at 100 brings it to the rightmost lane."""
    lanes = road.straight(300.0, 3)
    towards_left = lanes[0].lane_id - lanes[1].lane_id
    for name, start, ask, wanted in (
        ("none", 1, lambda car: None, 1),
        ("left", 1, lambda car: road.manager.random_left_lanechange_percentage(car, 100.0), 0),
        ("right", 1, lambda car: road.manager.random_right_lanechange_percentage(car, 100.0), 2),
        ("keep right", 0, lambda car: road.manager.keep_slow_lane_rule_percentage(car, 100.0), len(lanes) - 1),
    ):
        car = road.car(lanes[start])
        ask(car)
        road.manager.set_desired_speed(car, 40.0)
        road.drive(car)
        changes, last = lanes_seen(road, car, 400)
        if name == "none":
            assert not changes, changes
        elif name == "keep right":
            assert last == lanes[-1].lane_id and all(change == -towards_left for change in changes), (changes, last, lanes[-1].lane_id)
        else:
            first = towards_left if name == "left" else -towards_left
            assert changes and changes[0] == first, (name, changes)
        road.begin()


def check_auto(road):
    """`auto_lane_change`: a car passes a slow one if it may change lanes, and else stays behind it."""
    lanes = road.straight(350.0, 3)
    for changes in (True, False):
        slow, quick = road.car(lanes[1], ahead_m=40.0), road.car(lanes[1])
        road.manager.set_desired_speed(slow, 15.0)
        road.manager.auto_lane_change(slow, False)
        road.manager.set_desired_speed(quick, 50.0)
        road.manager.auto_lane_change(quick, changes)
        road.drive(slow, quick)
        touched = road.blows(quick)
        road.tick(400)
        ahead = ahead_m(slow.get_transform(), quick.get_location())
        assert (ahead > 5.0) == changes, f"changes lanes: {changes}; {ahead:.1f} m ahead of the slow one"
        assert not touched, touched
        road.begin()


def check_ignored(road):
    """`ignore_vehicles_percentage`, `ignore_walkers_percentage`: at 100 % a car runs into what stands on its lane, at 0 it stops before it;
    `collision_detection` does it for one pair and no other."""
    lanes = road.straight(300.0)

    def hits(what, ask):
        car = road.car(lanes[0])
        if what == "walker":
            place = lanes[0].next(50.0)[0].transform
            place.location.z += 1.0
            blueprint = road.library.find("walker.pedestrian.0001")
            blueprint.set_attribute("is_invincible", "false")
            target = road.world.spawn_actor(blueprint, place)
        else:
            target = road.car(lanes[0], ahead_m=50.0)
            road.stand(target)
        other = road.car(lanes[0], ahead_m=90.0)
        road.stand(other)
        ask(car, target, other)
        road.manager.auto_lane_change(car, False)
        road.manager.set_desired_speed(car, 25.0)
        road.drive(car)
        touched = road.blows(car)
        road.tick(260)
        found = target.id in touched
        standing = speed(car) < 0.2
        road.begin()
        return found, standing

    nothing = lambda car, target, other: None
    for what, ignore in (("vehicle", "ignore_vehicles_percentage"), ("walker", "ignore_walkers_percentage")):
        found, standing = hits(what, nothing)
        assert not found and standing, f"it runs into the {what}"
        found, _ = hits(what, lambda car, target, other: getattr(road.manager, ignore)(car, 100.0))
        assert found, f"it does not run into the {what} that it ignores"
    found, _ = hits("vehicle", lambda car, target, other: road.manager.collision_detection(car, target, False))
    assert found, "no collision detection, but it stops"
    found, standing = hits("vehicle", lambda car, target, other: road.manager.collision_detection(car, other, False))
    assert not found and standing, "collision detection was switched off for another"


def check_signs(road):
    """`ignore_signs_percentage`: a car stops at a stop sign, one that ignores signs does not."""
    place, line = next(found for found in (stop_ahead(road.map.get_waypoint(p.location)) for p in road.map.get_spawn_points()) if found)
    for percent in (0.0, 100.0):
        car = road.car(place)
        road.manager.ignore_signs_percentage(car, percent)
        road.manager.auto_lane_change(car, False)
        road.drive(car)
        slowest, moved = math.inf, False
        for _ in range(400):
            road.tick()
            moved = moved or speed(car) > 3.0
            away = ahead_m(car.get_transform(), line)
            if moved and -8.0 < away < 20.0:
                slowest = min(slowest, speed(car))
        assert (slowest < 0.3) == (percent == 0.0), f"{percent} % ignored: {slowest:.2f} m/s at the least before the stop sign"
        road.begin()


def stop_ahead(waypoint):
    """The place itself and that of the stop sign 20 to 60 m ahead, if there is one for its lane."""
    for mark in waypoint.get_landmarks_of_type(60.0, "206", True):
        if mark.distance >= 20.0 and mark.waypoint and mark.waypoint.lane_id * waypoint.lane_id > 0:
            return waypoint, mark.waypoint.transform.location
    return None


def check_lamps(road):
    """`update_vehicle_lights`: low beam at night, brake lamps while braking, blinkers on the side of a turn; without it only the brake lamps,
    which the pedal itself switches."""
    before, night = road.world.get_weather(), road.world.get_weather()
    night.sun_altitude_angle = -40.0
    lane = road.straight(350.0, 3)[1]
    for updates in (False, True):
        road.world.set_weather(night)
        road.tick(2)
        car = road.car(lane)
        road.manager.update_vehicle_lights(car, updates)
        road.manager.auto_lane_change(car, False)
        road.manager.set_desired_speed(car, 40.0)
        road.drive(car)
        road.tick(160)
        cruising = int(car.get_light_state())
        road.manager.force_lane_change(car, True)
        changing = 0
        for _ in range(60):
            road.tick()
            changing |= int(car.get_light_state())
        road.manager.set_desired_speed(car, 0.0)
        braking = 0
        for _ in range(60):
            road.tick()
            braking |= int(car.get_light_state())
        road.world.set_weather(before)
        road.tick(20)
        by_day = int(car.get_light_state())
        if updates:
            assert cruising & int(Lights.LowBeam) and cruising & int(Lights.Position) and not cruising & int(Lights.Brake), cruising
            assert changing & int(Lights.RightBlinker) and not changing & int(Lights.LeftBlinker), changing
            assert braking & int(Lights.Brake), braking
            assert not by_day & int(Lights.LowBeam), by_day
        else:
            # Brake lamps shine whoever drives: the pedal switches them.
            assert not (cruising | changing | braking | by_day) & ~int(Lights.Brake), (cruising, changing, braking, by_day)
        road.begin()


def forks(waypoint):
    """Ways over the next junction within 60 m by what they are called, if there are two."""
    at = waypoint
    for _ in range(30):
        following = at.next(2.0)
        if len(following) > 1:
            break
        if len(following) != 1:
            return None
        at = following[0]
    else:
        return None
    turns = {}
    for way in following:
        end = way
        for _ in range(40):
            if not end.is_junction or not end.next(2.0):
                break
            end = end.next(2.0)[0]
        turn = (end.transform.rotation.yaw - at.transform.rotation.yaw + 180.0) % 360.0 - 180.0
        turns["Left" if turn < -45.0 else "Right" if turn > 45.0 else "Straight"] = (turn, end)
    return (waypoint, turns) if len(turns) > 1 else None


def check_route(road):
    """`set_route`: at the next junction a car turns as it was told, whichever way that is."""
    places = (road.map.get_waypoint(point.location) for point in road.map.get_spawn_points())
    place, turns = next(found for found in map(forks, places) if found)
    for name, (turn, end) in turns.items():
        car = road.car(place)
        road.manager.set_route(car, [name])
        road.manager.auto_lane_change(car, False)
        road.drive(car)
        nearest = math.inf
        for _ in range(500):
            road.tick()
            nearest = min(nearest, car.get_location().distance_2d(end.transform.location))
        assert nearest < 3.0, f"{name} of {sorted(turns)}: {nearest:.1f} m from where that leads"
        road.begin()


def check_respawn(road):
    """`set_respawn_dormant_vehicles` with boundaries: a car far from the hero comes back within them; without it, it stays away."""
    points = road.map.get_spawn_points()
    hero_at = road.map.get_waypoint(points[0].location)
    far = max(points, key=lambda point: point.location.distance(points[0].location))
    for respawns in (False, True):
        hero = road.car(hero_at, role="hero")
        road.stand(hero)
        car = road.car(road.map.get_waypoint(far.location))
        road.manager.set_respawn_dormant_vehicles(respawns)
        road.manager.set_boundaries_respawn_dormant_vehicles(30.0, 150.0)
        road.drive(car)
        road.tick()
        began, jumped = car.get_location().distance(hero.get_location()), None
        last = car.get_location()
        for _ in range(300):
            road.tick()
            now = car.get_location()
            if now.distance(last) > 20.0:
                jumped = now.distance(hero.get_location())
                break
            last = now
        assert began > 400.0 and (jumped is not None) == respawns, (began, jumped)
        assert jumped is None or 25.0 < jumped < 155.0, f"{jumped:.0f} m from the hero, allowed are 30 to 150"
        road.begin()


DEAD_END = """<?xml version="1.0" encoding="UTF-8"?>
<OpenDRIVE><header revMajor="1" revMinor="4" name="dead_end"/>
<road name="end" length="120" id="1" junction="-1"><type s="0" type="town"><speed max="50" unit="km/h"/></type>
<planView><geometry s="0" x="0" y="0" hdg="0" length="120"><line/></geometry></planView>
<lanes><laneSection s="0"><center><lane id="0" type="none" level="false"/></center>
<right><lane id="-1" type="driving" level="false"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right></laneSection></lanes></road></OpenDRIVE>"""


def check_dead_end(road):
    """`set_osm_mode`: where a road ends, cars are destroyed in this mode; without it the car stays there."""
    client = road.client
    client.generate_opendrive_world(DEAD_END)
    road = Road(client)
    for osm in (True, False):
        road.manager.set_osm_mode(osm)
        car = road.car(road.map.get_waypoint(carla.Location(20.0, 1.75, 0.0)))
        road.drive(car)
        road.tick(600)
        is_there = bool(road.world.get_actors().filter("vehicle.*"))
        assert is_there != osm, f"mode {osm}, and the car is there: {is_there}"
        if is_there:
            assert car.get_location().x > 90.0 and speed(car) < 0.2, car.get_location()
        road.begin()


def drive(road, seed):
    """Where six cars with random changes of lanes are in each of 300 ticks."""
    road.client.reload_world(False)
    road = Road(road.client)
    road.manager.set_random_device_seed(seed)
    lanes, way = road.straight(350.0, 3), []
    # None is beside another, so that there is room for changes.
    cars = [road.car(lane, ahead_m=1.0 + 20.0 * (idx + 3 * row)) for row in (0, 1) for idx, lane in enumerate(lanes)]
    for car in cars:
        road.manager.random_left_lanechange_percentage(car, 30.0)
        road.manager.random_right_lanechange_percentage(car, 30.0)
    road.drive(*cars)
    for _ in range(300):
        road.tick()
        seen = road.world.get_snapshot()
        way.append([str(seen.find(car.id).get_transform()) for car in cars])
    return way


def check_seeds(road):
    """`set_random_device_seed`: the same seed gives the same way in every tick, another one another way."""
    first, again, other = drive(road, 5), drive(road, 5), drive(road, 6)
    differing = next((n for n, (a, b) in enumerate(zip(first, again)) if a != b), None)
    assert differing is None, f"tick {differing}"
    assert first != other, "another seed, the same drive"


def main():
    road = Road(connect(PORT))
    for theme in sys.argv[3:]:
        globals()[f"check_{theme}"](road)
        passed(theme)
    road.manager.shut_down()


run(main)
