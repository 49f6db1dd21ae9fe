"""The stock `carla` 0.9.16 wheel: vehicle-to-everything radio.

    carla_v2x.py PORT

Prints "NAME passed" per theme; the first thing that is not as it should be ends the script. What arrives, when and how strongly is computed here
anew: triggers by ETSI EN 302 637-2, fields by TS 102 894-2, path loss by ETSI TR 103 257-1, two-ray interference and ITU-R P.526.
"""

import math
import queue
import socket
import struct
import sys

import carla
from carla_kit import PATIENCE_SECS, Wire, passed, run, stage

PORT = int(sys.argv[1])
WAVE_M = 299_792_458.0 / 5.9e9
GROUND = 1.02
TRANSMIT_DBM, GAIN_DBI = 21.5, 10.0


def free_space_db(distance_m):
    return 20.0 * math.log10(4.0 * math.pi * distance_m / WAVE_M)


def two_ray_db(a, b, ground_m):
    """Straight ray and ground reflection, horizontal polarisation left out as everywhere in the model."""
    high, low = a.z - ground_m, b.z - ground_m
    along = math.hypot(a.x - b.x, a.y - b.y)
    straight, reflected = math.hypot(along, high - low), math.hypot(along, high + low)
    sin, cos = (high + low) / reflected, along / reflected
    root = math.sqrt(GROUND - cos**2)
    gamma = (sin - root) / (sin + root)
    wave = 1.0 + gamma * complex(math.cos(2.0 * math.pi * (straight - reflected) / WAVE_M), math.sin(2.0 * math.pi * (straight - reflected) / WAVE_M))
    return free_space_db(along) - 20.0 * math.log10(abs(wave))


def received_dbm(loss_db):
    return TRANSMIT_DBM + GAIN_DBI - loss_db


def antenna(actor, transform):
    box = actor.bounding_box
    top = carla.Location(0.0, 0.0, box.location.z + box.extent.z + 0.02)
    transform.transform(top)
    return top


class Radio:
    def __init__(self, world, kind, place=None, parent=None, **attributes):
        blueprint = world.get_blueprint_library().find("sensor.other." + kind)
        for name, value in {"use_etsi_fading": "false", **attributes}.items():
            blueprint.set_attribute(name, value)
        self.sensor = world.spawn_actor(blueprint, place or carla.Transform(), attach_to=parent)
        self.heard = queue.Queue()
        self.sensor.listen(self.heard.put)

    def next(self):
        return self.heard.get(timeout=PATIENCE_SECS)

    def drain(self):
        """Everything that has come so far."""
        events = []
        while not self.heard.empty():
            events.append(self.heard.get())
        return events

    def up_to(self, world, frame):
        """All that is heard up to a tick, of stations that send once a second at least: what comes later has passed it."""
        events = []
        for _ in range(30):
            world.tick()
        while not events or events[-1].frame <= frame:
            events.append(self.next())
        return [event for event in events if event.frame <= frame]

    def end(self):
        self.sensor.stop()
        self.sensor.destroy()


def straight_pair(world):
    """A place with 80 m of straight lane ahead, and the place 25 m further on."""
    town = world.get_map()
    taken = [car.get_location() for car in world.get_actors().filter("vehicle.*")]
    for point in town.get_spawn_points():
        here = town.get_waypoint(point.location)
        ahead, far = here.next(25.0), here.next(80.0)
        if not ahead or not far or abs(far[0].transform.rotation.yaw - here.transform.rotation.yaw) > 0.5 or ahead[0].is_junction:
            continue
        if all(point.location.distance(other) > 100.0 for other in taken):
            front = ahead[0].transform
            front.location.z += 0.3
            return point, front
    raise AssertionError("no straight lane")


def check_awareness(world):
    """A car drives off, another behind it stands: who sends when, and every field."""
    library, town = world.get_blueprint_library(), world.get_map()
    behind, ahead = straight_pair(world)
    stander = world.spawn_actor(library.find("vehicle.tesla.model3"), behind)
    driver = world.spawn_actor(library.find("vehicle.audi.tt"), ahead)
    stander.apply_control(carla.VehicleControl(hand_brake=True, brake=1.0))
    for _ in range(30):
        world.tick()
    on_stander, on_driver = Radio(world, "v2x", parent=stander), Radio(world, "v2x", parent=driver)
    driver.set_light_state(carla.VehicleLightState(carla.VehicleLightState.LowBeam | carla.VehicleLightState.LeftBlinker))
    states = []
    for step in range(120):
        driver.apply_control(carla.VehicleControl(throttle=0.5 if step < 60 else 0.0, brake=0.0 if step < 60 else 0.6))
        frame = world.tick()
        snapshot = world.get_snapshot()
        both = {}
        for name, car in (("driver", driver), ("stander", stander)):
            seen = snapshot.find(car.id)
            both[name] = (seen.get_transform(), seen.get_velocity(), seen.get_acceleration(), seen.get_angular_velocity())
        states.append((frame, snapshot.timestamp.elapsed_seconds, both))
    by_frame = {frame: (elapsed, both) for frame, elapsed, both in states}
    heard = [event for event in on_stander.up_to(world, states[-1][0]) if event.frame in by_frame]
    expected = cam_frames([(frame, elapsed, both["driver"]) for frame, elapsed, both in states], heard[0].frame)
    assert [event.frame for event in heard] == expected, ([event.frame for event in heard], expected)
    slow_at, worst_db = None, 0.0
    for event in heard:
        elapsed, both = by_frame[event.frame]
        assert abs(event.timestamp - elapsed) < 1e-9 and event.get_message_count() == len(event) == 1
        at, velocity, acceleration, turning = both["driver"]
        whole = event[0].get()
        header, message = whole["Message"]["Header"], whole["Message"]["Message"]
        assert header == {"Message ID": "CAM", "Protocol Version": 1, "Station ID": driver.id}, header
        assert message["Generation Delta Time"] == round(elapsed * 1000) % 65536
        parameters = message["CAM Parameters"]
        basic, fast = parameters["Basic Container"], parameters["High Frequency Container"]
        assert basic["Station Type"] == "Passenger Car"
        place = town.transform_to_geolocation(at.location)
        position = basic["Reference Position"]
        assert abs(position["Latitude"] / 1e7 - place.latitude) < 6e-7 and abs(position["Longitude"] / 1e7 - place.longitude) < 6e-7
        fast = fast["Basic Vehicle Container High Frequency"]
        nose = at.get_forward_vector()
        along = velocity.x * nose.x + velocity.y * nose.y + velocity.z * nose.z
        left = at.get_right_vector()
        assert abs(fast["Speed"]["Value"] - 100.0 * abs(along)) <= 0.51
        # From north (−y), clockwise.
        heading = math.degrees(math.atan2(nose.x, -nose.y)) % 360.0
        assert abs((fast["Heading"]["Value"] / 10.0 - heading + 180.0) % 360.0 - 180.0) <= 0.06, (fast["Heading"], heading)
        ahead_mps2 = acceleration.x * nose.x + acceleration.y * nose.y + acceleration.z * nose.z
        left_mps2 = -(acceleration.x * left.x + acceleration.y * left.y + acceleration.z * left.z)
        assert abs(fast["Longitudinal Acceleration"]["Value"] - 10.0 * ahead_mps2) <= 0.51
        assert abs(fast["Lateral Acceleration"]["Value"] - 10.0 * left_mps2) <= 0.51
        assert abs(fast["Yaw Rate"]["Value"] + 100.0 * turning.z) <= 0.51
        extent = driver.bounding_box.extent
        assert abs(fast["Vehicle Length"]["Value"] - 20.0 * extent.x) <= 0.51 and abs(fast["Vehicle Width"] - 20.0 * extent.y) <= 0.51
        slow = parameters["Low Frequency Container"]
        if slow["Low Frequency Container Present"] != "No Container Present":
            assert slow_at is None or elapsed - slow_at >= 0.5 - 1e-9
            slow_at = elapsed
            # Low beam and left blinker, counted from the left.
            low = slow["Basic Vehicle Low Frequency"]
            assert low["Exterior Light"] == 0b1010_0000 and low["Vehicle Role"] == "Default", low
        a, b = antenna(driver, at), antenna(stander, both["stander"][0])
        loss = two_ray_db(a, b, min(at.location.z, both["stander"][0].location.z))
        worst_db = max(worst_db, abs(event[0].power - received_dbm(loss)))
    assert slow_at is not None
    print(f"{len(heard)} messages, powers within {worst_db:.3f} dB of the two-ray formula")
    # Millimetres turn the phase of the reflected ray.
    assert worst_db < 0.3, worst_db
    # Who stands sends once a second.
    quiet = [event.frame for event in on_driver.up_to(world, states[-1][0])]
    assert len(quiet) >= 5 and all(b - a == 20 for a, b in zip(quiet, quiet[1:])), quiet
    for radio in (on_stander, on_driver):
        radio.end()
    return stander, driver


def cam_frames(states, first):
    """Frames at which a car sends, by the rules, once its first message is known."""
    sent, interval, quiet, frames = None, 1.0, 0, []
    for frame, elapsed, (at, velocity, _, _) in states:
        if frame < first:
            continue
        nose = at.get_forward_vector()
        along = velocity.x * nose.x + velocity.y * nose.y + velocity.z * nose.z
        due = sent is None
        if sent is not None:
            waited = elapsed - sent[0]
            turned = abs((at.rotation.yaw - sent[2] + 180.0) % 360.0 - 180.0)
            changed = at.location.distance(sent[1]) > 4.0 or turned > 4.0 or abs(along - sent[3]) > 0.5
            if waited >= 0.1 - 1e-9 and changed:
                due, interval, quiet = True, min(waited, 1.0), 0
            elif waited >= 0.1 - 1e-9 and waited >= interval - 1e-9:
                due, quiet = True, quiet + 1
                interval = 1.0 if quiet >= 3 else interval
        if due:
            sent = (elapsed, at.location, at.rotation.yaw, along)
            frames.append(frame)
    return frames


def check_range(world, stander, driver):
    """A fixed rate, a receiver that looks no further than 5 m, one that is deaf, and fading."""
    fixed = Radio(world, "v2x", parent=driver, fixed_rate="true", gen_cam_min="0.2")
    near, deaf = Radio(world, "v2x", parent=stander, filter_distance="5"), Radio(world, "v2x", parent=stander, receiver_sensitivity="0")
    plain, faded = Radio(world, "v2x", parent=stander), Radio(world, "v2x", parent=stander, use_etsi_fading="true")
    for _ in range(200):
        world.tick()
    world.tick()
    frames = [plain.next().frame for _ in range(48)] + [event.frame for event in plain.drain()]
    assert all(b - a == 4 for a, b in zip(frames, frames[1:])), frames
    assert not near.drain() and not deaf.drain()
    powers = [faded.next()[0].power for _ in range(48)] + [event[0].power for event in faded.drain()]
    mean = sum(powers) / len(powers)
    deviation = math.sqrt(sum((power - mean) ** 2 for power in powers) / len(powers))
    # Highway, line of sight: 3.3 dB; 50 draws.
    assert 2.0 < deviation < 4.8, deviation
    for radio in (fixed, near, deaf, plain, faded):
        radio.end()


def check_custom(world, stander, driver):
    """Texts: all of a tick, in order, to all others; not to oneself, not too long."""
    one, two, three = (Radio(world, "v2x_custom", parent=parent) for parent in (stander, driver, None))
    three_at = stander.get_transform()
    three_at.location.z += 30.0
    three.sensor.set_transform(three_at)
    world.tick()
    for text in ("first", "zweite Botschaft: ä", "x" * 99):
        one.sensor.send(text)
    frame = world.tick()
    for radio in (two, three):
        event = radio.next()
        assert event.frame == frame and len(event) == 3
        texts = [message.get()["Message"]["Message"] for message in event]
        assert texts == ["first", "zweite Botschaft: ä", "x" * 99], texts
        assert event[0].get()["Message"]["Header"] == {"Protocol Version": 1, "Message ID": "CUSTOM", "Station ID": stander.id}
    one.sensor.send("y" * 100)
    world.tick()
    two.sensor.send("over")
    frame = world.tick()
    event = one.next()
    assert event.frame == frame and [message.get()["Message"]["Message"] for message in event] == ["over"]
    assert three.next()[0].get()["Message"]["Message"] == "over", "what was too long is not sent"
    assert one.heard.empty() and two.heard.empty()
    for radio in (one, two, three):
        radio.end()
    world.tick()


def check_obstacles(world):
    """Two antennas on either side of a building, and of a car."""
    places = building_ends(world)
    a, b = (Radio(world, "v2x_custom", place=place) for place in places)
    world.tick()
    a.sensor.send("through")
    world.tick()
    power = b.next()[0].power
    distance = places[0].location.distance(places[1].location)
    loss = free_space_db(1.0) + 27.0 * math.log10(distance)
    assert abs(power - received_dbm(loss)) < 0.01, (power, received_dbm(loss))
    a.end()
    b.end()
    # High above the town there is nothing, until a car is put between.
    air = carla.Location(0.0, 0.0, 300.0)
    ends = [carla.Transform(carla.Location(air.x + dx, air.y, air.z)) for dx in (-40.0, 25.0)]
    a, b = (Radio(world, "v2x_custom", place=place) for place in ends)
    car = world.spawn_actor(world.get_blueprint_library().find("vehicle.tesla.model3"), carla.Transform(carla.Location(0.0, 0.0, 320.0)))
    world.tick()
    car.set_simulate_physics(False)
    car.set_transform(carla.Transform(carla.Location(0.0, 0.0, 299.5)))
    world.tick()
    a.sensor.send("over the roof")
    world.tick()
    power = b.next()[0].power
    box = car.bounding_box
    # The roof reaches above the line, and the box's middle is where the edge is.
    top, middle = 299.5 + box.location.z + box.extent.z, box.location.x
    above = top - (air.z + 0.02)
    d1, d2 = 40.0 + middle, 25.0 - middle
    v = above * math.sqrt(2.0 * (d1 + d2) / (WAVE_M * d1 * d2))
    edge = 6.9 + 20.0 * math.log10(math.sqrt((v - 0.1) ** 2 + 1.0) + v - 0.1)
    assert abs(power - received_dbm(free_space_db(65.0) + edge)) < 0.05, (power, received_dbm(free_space_db(65.0) + edge))
    car.destroy()
    a.end()
    b.end()


def check_budget(world):
    """What the receiver's and the sender's attributes make of 65 m of free air, and of the way through a building."""
    free_air = [carla.Transform(carla.Location(x, 0.0, 300.0)) for x in (-40.0, 25.0)]
    urban = {"path_loss_model": "winner", "scenario": "urban"}
    log_m, log_ghz = math.log10(65.0), math.log10(5.9)
    on_motorways = 32.4 + 20.0 * log_m + 20.0 * log_ghz
    for sending, receiving, wanted in (
        ({}, {"path_loss_model": "winner"}, received_dbm(on_motorways)),
        ({}, urban, received_dbm(38.77 + 16.7 * log_m + 18.2 * log_ghz)),
        ({}, {"path_loss_model": "winner", "frequency_ghz": "2.4"}, received_dbm(32.4 + 20.0 * log_m + 20.0 * math.log10(2.4))),
        ({"transmit_power": "10"}, {"path_loss_model": "winner"}, received_dbm(on_motorways) - 11.5),
        # The receiver's gain is that of both ends.
        ({"combined_antenna_gain": "30"}, {"path_loss_model": "winner", "combined_antenna_gain": "3"}, received_dbm(on_motorways) - 7.0),
    ):
        for kind in ("v2x_custom", "v2x"):
            power = heard_dbm(world, free_air, sending, receiving, 1, kind)[0]
            assert abs(power - wanted) < 0.01, (kind, sending, receiving, power, wanted)
    # Who is deaf, or looks no farther than 60 m, hears nothing over 65 m; a seed decides on the fading.
    for receiving in ({"receiver_sensitivity": "0"}, {"filter_distance": "60"}):
        assert not any(heard_dbm(world, free_air, {}, receiving, 3, kind, some=False) for kind in ("v2x_custom", "v2x")), receiving
    faded = {"path_loss_model": "winner", "custom_fading_stddev": "6"}
    for kind in ("v2x_custom", "v2x"):
        one, again, other = (heard_dbm(world, free_air, {}, faded | {"noise_seed": seed}, 4, kind) for seed in ("5", "5", "6"))
        assert one == again != other and len(set(one)) == 4, (kind, one, again, other)
    powers = heard_dbm(world, free_air, {}, {"path_loss_model": "winner", "custom_fading_stddev": "6"}, 60)
    mean = sum(powers) / len(powers)
    deviation = math.sqrt(sum((power - mean) ** 2 for power in powers) / (len(powers) - 1))
    # The spread of 60 draws is itself known to a part in eleven: five of those.
    assert abs(deviation / 6.0 - 1.0) < 5.0 / math.sqrt(120.0), deviation
    through = building_ends(world)
    distance = through[0].location.distance(through[1].location)
    wanted = received_dbm(free_space_db(2.0) + 35.0 * math.log10(distance / 2.0))
    for kind in ("v2x_custom", "v2x"):
        power = heard_dbm(world, through, {}, {"path_loss_exponent": "3.5", "d_ref": "2"}, 1, kind)[0]
        assert abs(power - wanted) < 0.01, (kind, power, wanted)
    check_rate(world, free_air)


def check_rate(world, places):
    """With `sensor_tick` texts go out and come in at most once per interval, then all of them."""
    for slow_sender in (True, False):
        slow, at_once = {"sensor_tick": "0.2"}, {}
        a = Radio(world, "v2x_custom", place=places[0], **(slow if slow_sender else at_once))
        b = Radio(world, "v2x_custom", place=places[1], **(at_once if slow_sender else slow))
        world.tick()
        for n in range(20):
            a.sensor.send(str(n))
            last = world.tick()
        # The last text of the twenty comes within an interval.
        heard, texts = [], []
        while len(texts) < 20:
            if b.heard.empty() and world.get_snapshot().frame < last + 8:
                world.tick()
            event = b.next()
            heard.append(event.frame)
            texts += [one.get()["Message"]["Message"] for one in event]
        assert texts == [str(n) for n in range(20)] and all(later - one >= 4 for one, later in zip(heard, heard[1:])), (slow_sender, heard, texts)
        a.end()
        b.end()
    world.tick()


def heard_dbm(world, places, sending, receiving, n, kind="v2x_custom", some=True):
    """How strongly n messages arrive between two places; nothing if none comes that should not."""
    a, b = (Radio(world, kind, place=place, **attributes) for place, attributes in zip(places, (sending, receiving)))
    # One whom everything reaches tells that it has come to all.
    witness = None if some else Radio(world, kind, place=places[1])
    world.tick()
    powers = []
    for _ in range(n):
        if kind == "v2x_custom":
            a.sensor.send("how far")
            world.tick()
        else:
            # Units by themselves send every half second.
            for _ in range(10):
                world.tick()
        if some:
            powers.append(b.next()[0].power)
        else:
            witness.next()
            # The witness may be a unit that sends, too.
            powers += [one.power for event in b.drain() for one in event if one.get()["Message"]["Header"]["Station ID"] == a.sensor.id]
    if witness:
        witness.end()
    a.end()
    b.end()
    world.tick()
    return powers


def building_ends(world):
    """Places on either side of the highest building."""
    building = max(world.get_environment_objects(carla.CityObjectLabel.Buildings), key=lambda one: one.bounding_box.extent.z)
    box = building.bounding_box
    turned = carla.Transform(box.location, box.rotation)
    places = []
    for side in (-1.0, 1.0):
        point = carla.Location(side * (box.extent.x + 0.5), 0.0, 0.0)
        turned.transform(point)
        places.append(carla.Transform(point))
    return places


def check_roadside(world):
    """High above the town: stations by themselves and on a prop are road-side units, and walkers send and hear too."""
    library, town = world.get_blueprint_library(), world.get_map()
    at = lambda x, y: carla.Transform(carla.Location(x, y, 300.0), carla.Rotation(yaw=30.0))  # noqa: E731
    prop = world.spawn_actor(library.find("static.prop.streetbarrier"), at(40.0, 0.0))
    car = world.spawn_actor(library.find("vehicle.tesla.model3"), at(0.0, 0.0))
    walker = world.spawn_actor(library.find("walker.pedestrian.0007"), at(0.0, 15.0))
    world.tick()
    for hanging in (car, walker):
        hanging.set_simulate_physics(False)
    world.tick()
    for hanging, place in ((car, at(0.0, 0.0)), (walker, at(0.0, 15.0))):
        hanging.set_transform(place)
    world.tick()
    alone, on_prop = Radio(world, "v2x", place=at(-25.0, 5.0)), Radio(world, "v2x", parent=prop)
    on_car, on_walker = Radio(world, "v2x", parent=car), Radio(world, "v2x", parent=walker)
    frames = [world.tick() for _ in range(80)]
    world.tick()
    carriers = {alone.sensor.id: (alone.sensor, "Road Side Unit"), prop.id: (prop, "Road Side Unit"), walker.id: (walker, "Pedestrian")}
    sent = {station: [] for station in carriers}
    worst_db, together = 0.0, 0
    for event in on_car.drain():
        powers = {}
        for received in event:
            whole = received.get()
            message = whole["Message"]["Message"]
            station = whole["Message"]["Header"]["Station ID"]
            carrier, kind = carriers[station]
            parameters = message["CAM Parameters"]
            assert parameters["Basic Container"]["Station Type"] == kind, (station, parameters)
            place = town.transform_to_geolocation(carrier.get_location())
            position = parameters["Basic Container"]["Reference Position"]
            assert abs(position["Latitude"] / 1e7 - place.latitude) < 6e-7 and abs(position["Longitude"] / 1e7 - place.longitude) < 6e-7
            assert "Basic Vehicle Container High Frequency" not in parameters["High Frequency Container"], parameters
            if kind == "Road Side Unit":
                zones = parameters["High Frequency Container"]["RSU Container High Frequency"]["Protected Communication Zone"]
                assert list(zones) == [], zones
            sent[station].append(event.frame)
            powers[station] = received.power
            a, b = aerial(carrier), aerial(car)
            loss = two_ray_db(a, b, min(carrier.get_location().z, car.get_location().z))
            worst_db = max(worst_db, abs(received.power - received_dbm(loss)))
        together += {alone.sensor.id, prop.id} <= set(powers)
    print(f"road-side units: powers within {worst_db:.3f} dB of the two-ray formula, both at once in {together} ticks")
    assert worst_db < 0.05 and together >= 6, (worst_db, together)
    # Units that stand send every half second, whatever they are told about rates; who stands on two feet once a second.
    for station, gap in ((alone.sensor.id, 10), (prop.id, 10), (walker.id, 20)):
        heard = [frame for frame in sent[station] if frame in frames]
        assert len(heard) >= 3 and all(b - a == gap for a, b in zip(heard, heard[1:])), (station, heard)
    # Units hear cars and each other, walkers all of them.
    senders = lambda radio: {one.get()["Message"]["Header"]["Station ID"] for event in radio.drain() for one in event}  # noqa: E731
    assert senders(on_walker) == {alone.sensor.id, prop.id, car.id}
    assert senders(alone) == {prop.id, car.id, walker.id}
    assert senders(on_prop) == {alone.sensor.id, car.id, walker.id}
    for radio in (alone, on_prop, on_car, on_walker):
        radio.end()
    for actor in (prop, car, walker):
        actor.destroy()
    world.tick()


def aerial(actor):
    """Where an antenna is now: on the roof, or at the station itself."""
    return actor.get_location() + carla.Location(z=0.02) if actor.type_id.startswith("sensor") else antenna(actor, actor.get_transform())


def check_noise(world, stander, driver):
    """What a station says of itself with biases, and with spreads, against a twin that knows itself well; and how long it may be silent."""
    biases = {"noise_lat_bias": 2e-4, "noise_lon_bias": -3e-4, "noise_alt_bias": 4.0, "noise_head_bias": 30.0, "noise_yawrate_bias": 0.2}
    spreads = {
        "noise_lat_stddev": 4e-5, "noise_lon_stddev": 8e-5, "noise_alt_stddev": 1.5, "noise_head_stddev": 5.0, "noise_yawrate_stddev": 0.1,
        "noise_vel_stddev_x": 0.5, "noise_accel_stddev_x": 0.8, "noise_accel_stddev_y": 1.2, "noise_accel_stddev_z": 1.6,
    }
    for car in (stander, driver):
        car.apply_control(carla.VehicleControl(hand_brake=True, brake=1.0))
        car.set_light_state(carla.VehicleLightState.NONE)
    for _ in range(60):
        world.tick()
    ears, always = Radio(world, "v2x", parent=stander, gen_cam_min="1", gen_cam_max="1"), {"fixed_rate": "true", "gen_cam_min": "0.05"}
    raw = RawRadio(ears.sensor)
    said = {}
    for name, attributes in (("plain", {}), ("biased", biases), ("spread", spreads)):
        radio = Radio(world, "v2x", parent=driver, **always, **{key: str(value) for key, value in attributes.items()})
        since, said[name] = world.tick(), []
        for _ in range(10 if name != "spread" else 300):
            world.tick()
            said[name].append(own_words(ears, raw, driver.id, since))
        radio.end()
        world.tick()
    plain = said["plain"][-1]
    wanted = {"lat": 2e-4, "lon": -3e-4, "alt": 4.0, "heading": 30.0, "yaw_rate": math.degrees(0.2)}
    for words in said["biased"]:
        for name, value in words.items():
            off = (value - plain[name] + 180.0) % 360.0 - 180.0 if name == "heading" else value - plain[name]
            assert abs(off - wanted.get(name, 0.0)) < STEPS_OF_FIELDS[name], (name, off, wanted.get(name))
    wanted = {"lat": 4e-5, "lon": 8e-5, "alt": 1.5, "heading": 5.0, "yaw_rate": math.degrees(0.1), "speed": 0.5, "ahead": 0.8, "left": 1.2, "up": 1.6}
    for name, stddev in wanted.items():
        errors = [(words[name] - plain[name] + 180.0) % 360.0 - 180.0 for words in said["spread"]]
        if name == "speed":
            # A speed is not negative: half of the draws are 0, and with them half of the mean square.
            seen = math.sqrt(2.0 * sum(error * error for error in errors) / len(errors))
        else:
            mean = sum(errors) / len(errors)
            seen = math.sqrt(sum((error - mean) ** 2 for error in errors) / (len(errors) - 1))
        # The spread of n draws is known to a part in sqrt(2n); five of those, and the step of the field.
        assert abs(seen / stddev - 1.0) < 5.0 / math.sqrt(2 * len(errors)) + STEPS_OF_FIELDS[name] / stddev, (name, seen, stddev)
    raw.end()
    # Who stands is silent for as long as it may be, here half a second.
    radio = Radio(world, "v2x", parent=driver, gen_cam_max="0.5")
    world.tick()
    ears.drain()
    frames = []
    for _ in range(60):
        world.tick()
    while len(frames) < 5:
        frames.append(ears.next().frame)
    assert all(b - a == 10 for a, b in zip(frames, frames[1:])), frames
    radio.end()
    ears.end()


# Steps in which a message tells them.
STEPS_OF_FIELDS = {"lat": 2e-6, "lon": 2e-6, "alt": 0.02, "heading": 0.15, "yaw_rate": 0.02, "speed": 0.02, "ahead": 0.15, "left": 0.15, "up": 0.15}


class RawRadio:
    """The same messages byte by byte: the wheel does not tell the altitude in them."""

    def __init__(self, sensor):
        stream = sensor.id + 1
        wire = Wire(PORT)
        [token] = wire.call("get_sensor_token", stream)
        wire.close()
        number, port = struct.unpack("<IH", token[:6])
        assert number == stream, token
        self.socket = socket.create_connection(("127.0.0.1", port), PATIENCE_SECS)
        self.socket.sendall(struct.pack("<I", stream))
        self.stream = self.socket.makefile("rb")

    def altitude_m(self, frame):
        while True:
            message = self.stream.read(struct.unpack("<I", self.stream.read(4))[0])
            at = struct.unpack_from("<Q", message, 8)[0]
            assert at <= frame, (at, frame)
            if at == frame:
                return struct.unpack_from("<q", message, 48 + 88)[0] / 100.0

    def end(self):
        self.stream.close()
        self.socket.close()


def own_words(ears, raw, station, since):
    """What the next message of a station behind a frame says of itself: degrees, metres and seconds."""
    while (event := ears.next()).frame <= since:
        pass
    whole = event[0].get()["Message"]
    assert whole["Header"]["Station ID"] == station and len(event) == 1, whole
    parameters = whole["Message"]["CAM Parameters"]
    place, fast = parameters["Basic Container"]["Reference Position"], parameters["High Frequency Container"]["Basic Vehicle Container High Frequency"]
    return {
        "alt": raw.altitude_m(event.frame),
        "lat": place["Latitude"] / 1e7, "lon": place["Longitude"] / 1e7, "heading": fast["Heading"]["Value"] / 10.0,
        "yaw_rate": fast["Yaw Rate"]["Value"] / 100.0, "speed": fast["Speed"]["Value"] / 100.0,
        "ahead": fast["Longitudinal Acceleration"]["Value"] / 10.0, "left": fast["Lateral Acceleration"]["Value"] / 10.0,
        "up": fast["Vertical Acceleration"]["Value"] / 10.0,
    }


def check_sentences(world):
    library = world.get_blueprint_library()
    for kind, name, value in (
        ("v2x", "d_ref", "0"),
        ("v2x_custom", "frequency_ghz", "-5.9"),
        ("v2x", "scenario", "moon"),
        ("v2x", "gen_cam_min", "2"),
    ):
        blueprint = library.find("sensor.other." + kind)
        blueprint.set_attribute(name, value)
        try:
            world.spawn_actor(blueprint, carla.Transform())
        except RuntimeError as error:
            assert name in str(error), error
        else:
            raise AssertionError(f"{name}={value} was spawned")


def main():
    client, world = stage(PORT)
    stander, driver = check_awareness(world)
    passed("awareness")
    check_range(world, stander, driver)
    passed("range")
    check_custom(world, stander, driver)
    passed("custom")
    check_noise(world, stander, driver)
    passed("noise")
    check_obstacles(world)
    passed("obstacles")
    check_budget(world)
    passed("budget")
    check_roadside(world)
    passed("roadside")
    check_sentences(world)
    passed("sentences")


run(main)
