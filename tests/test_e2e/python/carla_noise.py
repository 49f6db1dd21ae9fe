"""Noise of sensors through the stock `carla` 0.9.16 wheel: the same again in every run.

    carla_noise.py PORT

Prints "NAME passed" per theme; the first thing that is not as it should be ends the script. What chance decides follows from attributes, seed and
role, and from the time since the sensor was made: neither ids of actors nor how long the simulator has run matter, as with CARLA's generators,
which every sensor seeds for itself.
"""

import queue
import sys

import carla
import numpy as np
from carla_kit import PATIENCE_SECS, run, run_checks, stage

PORT = int(sys.argv[1])
N_TICKS = 12
SEEDED = {"noise_seed": "20250913"}
LIDAR = {"channels": "8", "points_per_second": "8000", "range": "60", "rotation_frequency": "7", "noise_stddev": "0.2", **SEEDED}
RADAR = {"points_per_second": "2000", **SEEDED}
IMU = {f"noise_{of}_stddev_{axis}": "0.3" for of in ("accel", "gyro") for axis in "xyz"} | SEEDED
GNSS = {"noise_lat_stddev": "1e-4", "noise_lon_stddev": "1e-4", "noise_alt_stddev": "2.0", **SEEDED}
DVS = {"image_size_x": "64", "image_size_y": "48", "sigma_positive_threshold": "0.1", "sigma_negative_threshold": "0.1"}
V2X = {"noise_lat_stddev": "1e-3", "noise_head_stddev": "20", "noise_accel_stddev_x": "3", "fixed_rate": "true", "filter_distance": "2000", **SEEDED}
ROOF = carla.Transform(carla.Location(z=2.4))


def values(message):
    """What chance has a hand in, without places and times of the run."""
    if isinstance(message, carla.IMUMeasurement):
        return [[vector.x, vector.y, vector.z] for vector in (message.accelerometer, message.gyroscope)]
    if isinstance(message, carla.GnssMeasurement):
        return [message.latitude, message.longitude, message.altitude]
    if isinstance(message, carla.CAMEvent):
        cams = [(event.power, event.get()["Message"]["Message"]["CAM Parameters"]) for event in message]
        return [(power, cam["Basic Container"], cam["High Frequency Container"]) for power, cam in cams]
    if isinstance(message, carla.DVSEventArray):
        events = np.frombuffer(message.raw_data, dtype=np.dtype([("x", "<u2"), ("y", "<u2"), ("t", "<i8"), ("pol", "?")]))
        return [events["x"].tobytes(), events["y"].tobytes(), events["pol"].tobytes()]
    return bytes(message.raw_data)


class Run:
    """Two equal cars, apart from each other and held; the first one has a sensor of every kind that has noise."""

    def __init__(self, world):
        self.world, self.library = world, world.get_blueprint_library()
        self.made, self.heard = [], {}
        model = self.library.find("vehicle.tesla.model3")
        model.set_attribute("role_name", "scenario")
        points = world.get_map().get_spawn_points()
        self.place, there = points[3], min(points[4:], key=lambda other: abs(other.location.distance(points[3].location) - 30.0))
        self.cars = [world.spawn_actor(model, at) for at in (self.place, there)]
        for car in self.cars:
            car.set_simulate_physics(False)
        world.tick()
        first, second = self.cars
        for name, kind, parent, attributes in [
            ("lidar", "lidar.ray_cast", first, LIDAR),
            ("twin", "lidar.ray_cast", second, LIDAR),
            ("unseeded", "lidar.ray_cast", first, LIDAR | {"noise_seed": "0"}),
            ("radar", "other.radar", first, RADAR),
            ("imu", "other.imu", first, IMU),
            ("other imu", "other.imu", second, IMU),
            ("gnss", "other.gnss", first, GNSS),
            ("dvs", "camera.dvs", first, DVS),
            ("v2x", "other.v2x", first, V2X),
            ("other v2x", "other.v2x", second, V2X),
            # The same sensors at the same places, which only their seeds tell apart.
            ("reseeded radar", "other.radar", first, RADAR | {"noise_seed": "5"}),
            ("reseeded imu", "other.imu", first, IMU | {"noise_seed": "5"}),
            ("reseeded gnss", "other.gnss", first, GNSS | {"noise_seed": "5"}),
        ]:
            self.heard[name] = self.listen(kind, parent, attributes)

    def listen(self, kind, parent, attributes):
        blueprint, messages = self.library.find("sensor." + kind), queue.Queue()
        for name, value in attributes.items():
            blueprint.set_attribute(name, value)
        sensor = self.world.spawn_actor(blueprint, ROOF, attach_to=parent)
        sensor.listen(messages.put)
        self.made.append(sensor)
        return messages

    def go(self):
        """Messages of every sensor, by the number of the tick. The first car is moved 0.2 m at every tick."""
        seen, by_number = {name: {} for name in self.heard}, {}
        ahead = self.place.get_forward_vector()
        for n in range(N_TICKS):
            place = carla.Transform(self.place.location + ahead * (0.2 * n), self.place.rotation)
            self.cars[0].set_transform(place)
            by_number[self.world.tick()] = n
        last = max(by_number)
        # Stations send every other tick: one that has sent later has sent all that is asked for.
        for _ in range(4):
            self.world.tick()
        for name, messages in self.heard.items():
            frame, end = 0, last + 1 if "v2x" in name else last
            while frame < end:
                message = messages.get(timeout=PATIENCE_SECS)
                frame = message.frame
                if frame <= last:
                    seen[name][by_number[frame]] = values(message)
        return seen

    def end(self):
        for actor in self.made + self.cars:
            actor.destroy()
        self.world.tick()


def fresh_world(client, world):
    """A new episode without the launch file's vehicle, which sinks onto its wheels in the radar's sight."""
    client.reload_world(False)
    world.tick()
    for car in world.get_actors().filter("vehicle.*"):
        car.destroy()
    world.tick()


def fresh_run(client, world, before=lambda world: None):
    fresh_world(client, world)
    before(world)
    run = Run(world)
    seen = run.go()
    run.end()
    return seen


def others(world):
    """Actors that come and go before the run, and cars that stay, farther away than any sensor sees."""
    library, points = world.get_blueprint_library(), world.get_map().get_spawn_points()
    far = sorted(points, key=lambda point: point.location.distance(points[3].location))[-3:]
    assert all(point.location.distance(points[3].location) > 130.0 for point in far)
    gone = [world.spawn_actor(library.find("sensor.other.imu"), carla.Transform()) for _ in range(5)]
    for point in far:
        world.spawn_actor(library.find("vehicle.audi.tt"), point).set_simulate_physics(False)
    world.tick()
    for actor in gone:
        actor.destroy()


def must_agree(one, other, kinds):
    for kind in kinds:
        assert one[kind] and one[kind].keys() == other[kind].keys(), (kind, one[kind].keys(), other[kind].keys())
        for n in one[kind]:
            assert one[kind][n] == other[kind][n], f"{kind} sees something else at tick {n}"


def check_reload(client, world, first):
    """After `reload_world`, with other ids and an older simulator."""
    must_agree(first, fresh_run(client, world), first)


def check_neighbours(client, world, first):
    """Whoever else lives or lived."""
    kinds = [kind for kind in first if kind != "dvs"]
    must_agree(first, fresh_run(client, world, others), kinds)


def check_again(client, world, first):
    """A second run in one episode."""
    fresh_world(client, world)
    for _ in range(2):
        run = Run(world)
        # Lamps of traffic lights have gone on since, which an event camera may see.
        must_agree(first, run.go(), [kind for kind in first if kind != "dvs"])
        run.end()
        for _ in range(7):
            world.tick()


def check_apart(client, world, first):
    """Equal sensors on two equal cars, and sensors that only their seeds tell apart, have noise of their own."""
    arrays = {name: [np.frombuffer(turn, dtype="<f4").reshape(-1, 4) for turn in first[name].values()] for name in ("lidar", "unseeded")}
    assert any(len(a) != len(b) for a, b in zip(*arrays.values())), "two seeds drop the same points"
    assert all(first["lidar"][n] != first["twin"][n] for n in first["lidar"])
    for kind in ("radar", "imu", "gnss"):
        assert all(first[kind][n] != first["reseeded " + kind][n] for n in first[kind]), f"two seeds make the same noise of {kind}"
    # Both cars are level and the second stands still: what differs from 9.81 upwards is noise.
    ups = [[seen[0][2] for seen in first[name].values()] for name in ("imu", "other imu")]
    assert all(abs(a - b) > 1e-6 for a, b in zip(*ups)), ups
    headings = [[cam[0][2] for cam in first[name].values()] for name in ("v2x", "other v2x")]
    assert headings[0] and headings[1] and headings[0] != headings[1]
    assert all(len(first[name]) > 5 for name in ("dvs", "radar", "gnss")) and len({str(seen) for seen in first["gnss"].values()}) == N_TICKS


def main():
    client, world = stage(PORT)
    first = fresh_run(client, world)
    run_checks(
        {
            "apart": lambda: check_apart(client, world, first),
            "reload": lambda: check_reload(client, world, first),
            "neighbours": lambda: check_neighbours(client, world, first),
            "again": lambda: check_again(client, world, first),
        }
    )


run(main)
