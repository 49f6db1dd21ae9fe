"""Attributes of sensors that nothing else looks at, each by what it does to the sensor's messages, through the stock `carla` 0.9.16 wheel.

    carla_attributes.py PORT

Prints "NAME passed" per theme; the first thing that is not as it should be ends the script.
"""

import math
import queue
import sys

import carla
import numpy as np
from carla_kit import PATIENCE_SECS, listen, near, of_tick, run, run_checks, stage, ticks

PORT = int(sys.argv[1])
WIDTH, HEIGHT = 160, 96
ROOF = carla.Transform(carla.Location(x=0.0, z=2.4))
QUIET = {"dropoff_general_rate": "0", "dropoff_intensity_limit": "1", "dropoff_zero_intensity": "0"}
LIDAR = {"channels": "16", "points_per_second": "57600", "range": "60", "rotation_frequency": "20"}


class Scene:
    """A held car, so that sensors which are made one after the other look from one place."""

    def __init__(self, world):
        self.world, self.library = world, world.get_blueprint_library()
        point = world.get_map().get_spawn_points()[3]
        self.car = world.spawn_actor(self.library.find("vehicle.tesla.model3"), point)
        ticks(world, 20)
        self.car.set_simulate_physics(False)
        world.tick()

    def listen(self, kind, attributes, place=ROOF):
        blueprint = self.library.find("sensor." + kind)
        for name, value in attributes.items():
            assert blueprint.has_attribute(name), name
            blueprint.set_attribute(name, str(value))
        return listen(self.world, blueprint, place, attach_to=self.car)

    def seen(self, kind, *variants, place=ROOF, n=1):
        """What sensors with these attributes say of the same ticks: the messages of each."""
        made = [self.listen(kind, attributes, place) for attributes in variants]
        self.world.tick()
        frames = [self.world.tick() for _ in range(n)]
        messages = [[of_tick(heard, frame) for frame in frames] for _, heard in made]
        for sensor, _ in made:
            sensor.destroy()
        self.world.tick()
        return messages if n > 1 else [one for one, in messages]


def colours(image):
    """Rows of R, G, B as numbers."""
    bgra = np.frombuffer(image.raw_data, dtype=np.uint8).reshape(image.height, image.width, 4)
    return bgra[..., 2::-1].astype(float)


def points(message):
    """x, y, z and intensity; y to the right."""
    return np.frombuffer(message.raw_data, dtype=np.float32).reshape(-1, 4)


def check_film(scene):
    """Each attribute of the film against a plain camera at the same place."""
    size = {"image_size_x": WIDTH, "image_size_y": HEIGHT, "exposure_mode": "manual"}
    variants = {
        "plain": {},
        "bright": {"gamma": 3.0},
        "warm": {"temp": 9500},
        "cold": {"temp": 4500},
        "green": {"tint": -0.6},
        "magenta": {"tint": 0.6},
        "bloom": {"bloom_intensity": 6.0},
        "fringe": {"chromatic_aberration_intensity": 4.0},
        "fringe outside": {"chromatic_aberration_intensity": 4.0, "chromatic_aberration_offset": 0.9},
        "circle": {"lens_circle_multiplier": 4.0, "lens_circle_falloff": 3.0},
        "raw": {"enable_postprocess_effects": "False"},
    }
    images = scene.seen("camera.rgb", *[size | variant for variant in variants.values()])
    seen = dict(zip(variants, map(colours, images)))
    mean = {name: image.mean(axis=(0, 1)) for name, image in seen.items()}
    plain = mean["plain"]
    assert 20.0 < plain.mean() < 235.0, "there is something to be seen in the picture"
    assert mean["bright"].mean() > plain.mean() + 5.0, (mean["bright"], plain)
    # A film that is balanced for a colder light shows the scene warmer.
    assert mean["warm"][0] / mean["warm"][2] > 1.1 * mean["cold"][0] / mean["cold"][2], (mean["warm"], mean["cold"])
    green = {name: mean[name][1] / (mean[name][0] + mean[name][2]) for name in ("green", "plain", "magenta")}
    assert green["green"] > 1.03 * green["plain"] > 1.03 * 1.03 * green["magenta"], green
    assert mean["bloom"].mean() > plain.mean() + 0.5, (mean["bloom"], plain)
    # Red and blue part at the rim and not in the middle, and with an offset only further outside.
    change = {name: np.abs(seen[name] - seen["plain"]).max(axis=2) for name in ("fringe", "fringe outside")}
    middle = (slice(HEIGHT * 7 // 16, HEIGHT * 9 // 16), slice(WIDTH * 7 // 16, WIDTH * 9 // 16))
    assert change["fringe"].mean() > 2.0 * change["fringe"][middle].mean(), change["fringe"].mean()
    assert change["fringe outside"].mean() < 0.5 * change["fringe"].mean(), [one.mean() for one in change.values()]
    corner = lambda name: np.mean([seen[name][y][x] for y in (0, -1) for x in (0, -1)])  # noqa: E731
    assert corner("circle") < 0.8 * corner("plain"), (corner("circle"), corner("plain"))
    assert np.abs(seen["circle"][middle] - seen["plain"][middle]).mean() < 3.0, "it darkens the rim"
    assert np.abs(seen["raw"] - seen["plain"]).mean() > 1.0


def check_views(scene):
    """Half the size at half the tangent of `fov` shows the middle of the whole picture, pixel by pixel."""
    half = {"image_size_x": WIDTH // 2, "image_size_y": HEIGHT // 2, "fov": math.degrees(2.0 * math.atan(0.5))}
    middle = (slice(HEIGHT // 4, HEIGHT * 3 // 4), slice(WIDTH // 4, WIDTH * 3 // 4))
    for name in ("depth", "semantic_segmentation", "instance_segmentation", "normals", "cosmos_visualization", "rgb"):
        manual = {"exposure_mode": "manual"} if name == "rgb" else {}
        whole, part = scene.seen("camera." + name, {"image_size_x": WIDTH, "image_size_y": HEIGHT} | manual, half | manual)
        assert (part.width, part.height) == (WIDTH // 2, HEIGHT // 2) and near(part.fov, half["fov"], 1e-4), (name, part)
        wanted, seen = colours(whole)[middle], colours(part)
        assert len(np.unique(seen)) > 3, f"{name} sees nothing"
        if name == "depth":
            wanted, seen = (one @ (1.0, 256.0, 65536.0) for one in (wanted, seen))
            same = (np.abs(wanted - seen) <= 1e-3 * wanted).mean()
        else:
            same = (np.abs(wanted - seen) <= (3 if name in ("rgb", "normals") else 0)).all(axis=2).mean()
        assert same > 0.98, (name, same)
    # Flow is told in shares of the picture, of which the part is half.
    whole, part = (scene.listen("camera.optical_flow", one) for one in ({"image_size_x": WIDTH, "image_size_y": HEIGHT}, half))
    place = scene.car.get_transform()
    for step in range(2):
        scene.car.set_transform(carla.Transform(place.location + 0.3 * step * place.get_forward_vector(), place.rotation))
        frame = scene.world.tick()
    flows = [of_tick(messages, frame) for _, messages in (whole, part)]
    wanted, seen = (np.frombuffer(flow.raw_data, dtype=np.float32).reshape(flow.height, flow.width, 2) for flow in flows)
    same = (np.abs(2.0 * wanted[middle] - seen) < 2e-3).all(axis=2).mean()
    assert np.abs(seen).max() > 0.01 and same > 0.95, (np.abs(seen).max(), same)
    for sensor, _ in (whole, part):
        sensor.destroy()
    scene.car.set_transform(place)
    ticks(scene.world, 2)


def check_lidar_fans(scene):
    """Angles, range and number of points."""
    variants = [
        {"upper_fov": 10, "lower_fov": -30},
        {"upper_fov": -5, "lower_fov": -15},
        {"upper_fov": 10, "lower_fov": -30, "horizontal_fov": 90},
        {"upper_fov": 10, "lower_fov": -30, "range": 12},
        {"upper_fov": -5, "lower_fov": -15, "points_per_second": 28800, "channels": 8},
        {"upper_fov": -5, "lower_fov": -15, "rotation_frequency": 5},
    ]
    seen = scene.seen("lidar.ray_cast", *[LIDAR | QUIET | variant for variant in variants])
    wide, narrow, sector, near_by, half, slow = seen
    at = points(narrow)
    down = np.degrees(np.arctan2(at[:, 2], np.hypot(at[:, 0], at[:, 1])))
    assert abs(down.max() + 5.0) < 0.1 and abs(down.min() + 15.0) < 0.1, (down.min(), down.max())
    assert len(np.unique(np.round(down, 2))) == 16 == narrow.channels, np.unique(np.round(down, 2))
    # Every beam of the narrow fan meets the ground: all points of a tick of 0.05 s are there.
    assert len(narrow) == 57600 // 20, len(narrow)
    assert half.channels == 8 and len(half) == 28800 // 20, len(half)
    aside = np.degrees(np.abs(np.arctan2(points(sector)[:, 1], points(sector)[:, 0])))
    assert aside.max() <= 45.1 and aside.max() > 43.0, aside.max()
    everywhere = np.degrees(np.abs(np.arctan2(points(wide)[:, 1], points(wide)[:, 0])))
    assert everywhere.max() > 170.0
    far = lambda message: np.linalg.norm(points(message)[:, :3], axis=1)  # noqa: E731
    assert far(near_by).max() <= 12.0 < far(wide).max() <= 60.0
    assert len(near_by) == (far(wide) <= 12.0).sum(), "the same rays, and none beyond"
    # Five turns a second are a quarter of one in a tick.
    around = np.unwrap(np.sort(np.arctan2(points(slow)[:, 1], points(slow)[:, 0])))
    gaps = np.diff(np.concatenate([around, [around[0] + 2.0 * math.pi]]))
    assert len(slow) == 57600 // 20 and near(math.degrees(gaps.max()), 270.0, 2.0), (len(slow), math.degrees(gaps.max()))
    # The semantic lidar sends the same rays.
    alike = scene.seen("lidar.ray_cast_semantic", *[LIDAR | variant for variant in variants])
    kinds = np.dtype([("xyz", "<f4", 3), ("cos", "<f4"), ("idx", "<u4"), ("tag", "<u4")])
    for one, other, variant in zip(seen, alike, variants):
        same = np.frombuffer(other.raw_data, dtype=kinds)["xyz"]
        assert other.channels == one.channels and len(same) == len(points(one)) > 100, (variant, len(same), len(points(one)))
        if variant.get("rotation_frequency") is None:
            assert np.abs(np.sort(far(one)) - np.sort(np.linalg.norm(same, axis=1))).max() < 0.01, variant
        else:
            around = np.sort(np.arctan2(same[:, 1], same[:, 0]))
            gaps = np.diff(np.concatenate([around, [around[0] + 2.0 * math.pi]]))
            assert near(math.degrees(gaps.max()), 270.0, 2.0), math.degrees(gaps.max())


def check_lidar_losses(scene):
    """Attenuation, drop-off and noise."""
    plain, foggy, half, weak, rough = scene.seen(
        "lidar.ray_cast",
        LIDAR | QUIET,
        LIDAR | QUIET | {"atmosphere_attenuation_rate": 0.05},
        LIDAR | QUIET | {"dropoff_general_rate": 0.5},
        LIDAR | QUIET | {"dropoff_intensity_limit": 1.0, "dropoff_zero_intensity": 1.0, "atmosphere_attenuation_rate": 0.05},
        LIDAR | QUIET | {"noise_stddev": 0.3},
        n=8,
    )
    together = lambda messages: np.concatenate([points(message) for message in messages])  # noqa: E731
    far = lambda at: np.linalg.norm(at[:, :3], axis=1)  # noqa: E731
    for messages, rate in ((plain, 0.004), (foggy, 0.05)):
        at = together(messages)
        assert np.abs(at[:, 3] - np.exp(-rate * far(at))).max() < 2e-3, rate
    n = len(together(plain))
    # Points drop out one by one: six sigma of a binomial distribution.
    share = len(together(half)) / n
    assert abs(share - 0.5) < 6.0 * math.sqrt(0.25 / n), share
    # A point of intensity i is dropped with probability (1 - i) of what zero intensity is dropped with.
    intensity = together(foggy)[:, 3]
    kept, wanted = len(together(weak)) / len(intensity), intensity.mean()
    assert abs(kept - wanted) < 6.0 * math.sqrt(0.25 / n), (kept, wanted)
    # The same rays, whose ranges have a spread of their own.
    errors = far(together(rough)) - far(together(plain))
    assert abs(errors.mean()) < 0.02 and abs(errors.std() - 0.3) < 0.03, (errors.mean(), errors.std())


def check_radar(scene):
    """Angles, range and number of rays."""
    bumper = carla.Transform(carla.Location(x=2.5, z=1.0))
    wide, flat, short, few = scene.seen(
        "other.radar",
        {"points_per_second": 20000, "range": 100, "horizontal_fov": 60, "vertical_fov": 20},
        {"points_per_second": 20000, "range": 100, "horizontal_fov": 10, "vertical_fov": 20},
        {"points_per_second": 20000, "range": 15, "horizontal_fov": 60, "vertical_fov": 20},
        {"points_per_second": 2000, "range": 100, "horizontal_fov": 60, "vertical_fov": 20},
        place=bumper,
        n=4,
    )
    rays = lambda messages: np.concatenate([np.frombuffer(one.raw_data, dtype=np.float32).reshape(-1, 4) for one in messages])  # noqa: E731
    for messages, across, above in ((wide, 30.0, 10.0), (flat, 5.0, 10.0)):
        _, azimuth, altitude, _ = np.degrees(rays(messages)).T
        assert 0.8 * across < np.abs(azimuth).max() <= across + 0.01, np.abs(azimuth).max()
        assert 0.5 * above < np.abs(altitude).max() <= above + 0.01, np.abs(altitude).max()
    # The range is that along the axis, as with CARLA.
    farthest = [max(depth * math.cos(azimuth) * math.cos(altitude) for _, azimuth, altitude, depth in rays(messages)) for messages in (short, wide)]
    assert farthest[0] <= 15.001 < farthest[1] <= 100.0, farthest
    assert all(len(one) <= 2000 // 20 for one in few) and len(rays(wide)) > 5 * len(rays(few)) > 0, (len(rays(wide)), len(rays(few)))


def spread(values):
    return np.std(values, ddof=1)


def check_imu(scene):
    """Biases of the gyroscope, and spreads axis by axis, of a car that stands."""
    n = 300
    noisy = {"noise_accel_stddev_x": 0.2, "noise_accel_stddev_y": 0.4, "noise_accel_stddev_z": 0.8}
    noisy |= {"noise_gyro_stddev_x": 0.1, "noise_gyro_stddev_y": 0.2, "noise_gyro_stddev_z": 0.3}
    biased = {"noise_gyro_bias_x": 0.11, "noise_gyro_bias_y": -0.22, "noise_gyro_bias_z": 0.33}
    plain, noisy_seen, biased_seen = scene.seen("other.imu", {}, noisy, biased, n=n)
    for of, reading in (("accel", lambda one: one.accelerometer), ("gyro", lambda one: one.gyroscope)):
        for axis in "xyz":
            errors = [getattr(reading(a), axis) - getattr(reading(b), axis) for a, b in zip(noisy_seen, plain)]
            wanted = noisy[f"noise_{of}_stddev_{axis}"]
            # The spread of a sample of n has itself a spread of 1/sqrt(2n): five of those.
            assert abs(spread(errors) / wanted - 1.0) < 5.0 / math.sqrt(2 * n), (of, axis, spread(errors), wanted)
    for a, b in zip(biased_seen, plain):
        error = a.gyroscope - b.gyroscope
        assert near(error.x, 0.11, 1e-5) and near(error.y, -0.22, 1e-5) and near(error.z, 0.33, 1e-5), error


def check_gnss(scene):
    """Biases and spreads in degrees and metres."""
    n = 300
    noisy = {"noise_lat_stddev": 2e-5, "noise_lon_stddev": 4e-5, "noise_alt_stddev": 1.5}
    biased = {"noise_lat_bias": 1e-4, "noise_lon_bias": -2e-4, "noise_alt_bias": 3.0}
    plain, noisy_seen, biased_seen = scene.seen("other.gnss", {}, noisy, biased, n=n)
    for name, of in (("lat", "latitude"), ("lon", "longitude"), ("alt", "altitude")):
        errors = [getattr(a, of) - getattr(b, of) for a, b in zip(noisy_seen, plain)]
        wanted = noisy[f"noise_{name}_stddev"]
        assert abs(spread(errors) / wanted - 1.0) < 5.0 / math.sqrt(2 * n), (name, spread(errors), wanted)
        for a, b in zip(biased_seen, plain):
            assert near(getattr(a, of) - getattr(b, of), biased[f"noise_{name}_bias"], 1e-6), (name, a, b)


def check_obstacle(scene):
    """With `only_dynamics` what stands in the town is no obstacle, and a car is; nothing beyond the distance is one, nor beside the radius. Where a
    detector looks is drawn into colour pictures on demand."""
    ahead = scene.car.get_transform().get_forward_vector()
    place = scene.car.get_transform()
    model = scene.library.find("vehicle.audi.tt")
    other = scene.world.spawn_actor(model, carla.Transform(place.location + 12.0 * ahead + carla.Location(z=0.5), place.rotation))
    ticks(scene.world, 10)
    down = carla.Transform(carla.Location(x=2.6, z=1.0), carla.Rotation(pitch=-20.0))
    level = carla.Transform(carla.Location(x=2.6, z=0.8))

    def heard(attributes, at):
        sensor, messages = scene.listen("other.obstacle", attributes, at)
        ticks(scene.world, 4)
        # An event comes with its tick, so one that a later sensor has sent has come.
        probe, probed = scene.listen("other.imu", {})
        of_tick(probed, scene.world.tick())
        sensor.destroy()
        probe.destroy()
        scene.world.tick()
        found = set()
        while not messages.empty():
            found.add(messages.get(timeout=PATIENCE_SECS).other_actor.type_id)
        return found

    ground = heard({"distance": 8, "only_dynamics": "False"}, down)
    assert ground and all(name.startswith("static.") for name in ground), ground
    assert not heard({"distance": 8, "only_dynamics": "True"}, down)
    assert heard({"distance": 20, "only_dynamics": "True"}, level) == {"vehicle.audi.tt"}
    assert not heard({"distance": 4, "only_dynamics": "True"}, level)
    # Half a metre beside the other car's flank.
    aside = carla.Transform(carla.Location(x=2.6, y=other.bounding_box.extent.y + 0.5, z=0.8))
    assert not heard({"distance": 20, "only_dynamics": "True", "hit_radius": 0.3}, aside)
    assert heard({"distance": 20, "only_dynamics": "True", "hit_radius": 0.8}, aside) == {"vehicle.audi.tt"}
    size = {"image_size_x": WIDTH, "image_size_y": HEIGHT, "exposure_mode": "manual"}
    pictures = {}
    for draws in ("False", "True"):
        detector, _ = scene.listen("other.obstacle", {"distance": 20, "debug_linetrace": draws}, level)
        pictures[draws] = colours(*scene.seen("camera.rgb", size))
        detector.destroy()
        scene.world.tick()
    pictures["gone"] = colours(*scene.seen("camera.rgb", size))
    changed = lambda name: int((np.abs(pictures[name] - pictures["False"]).max(axis=2) > 40).sum())  # noqa: E731
    assert changed("True") > 10 and changed("gone") == 0, (changed("True"), changed("gone"))
    other.destroy()
    scene.world.tick()


def check_events(scene):
    """A higher threshold and a longer rest make fewer events of the same motion; they are taken from logarithms or not."""
    size = {"image_size_x": WIDTH, "image_size_y": HEIGHT}
    variants = [
        {},
        {"positive_threshold": 0.9, "negative_threshold": 0.3},
        {"positive_threshold": 0.3, "negative_threshold": 0.9},
        {"refractory_period_ns": 40_000_000},
        {"use_log": "false"},
        {"log_eps": 0.5},
        {},
        {"sigma_positive_threshold": 0.05},
        {"sigma_negative_threshold": 0.05},
        {"gantry_mode": "two_frame"},
        # The middle of the picture.
        {"image_size_x": WIDTH // 2, "image_size_y": HEIGHT // 2, "fov": math.degrees(2.0 * math.atan(0.5))},
    ]
    made = [scene.listen("camera.dvs", size | variant) for variant in variants]
    place = scene.car.get_transform()
    start, ahead = carla.Location(place.location), place.get_forward_vector()
    for step in range(12):
        place.location = start + carla.Location(ahead.x * 0.3 * step, ahead.y * 0.3 * step)
        scene.car.set_transform(place)
        frame = scene.world.tick()
    place.location = start
    scene.car.set_transform(place)
    probe, probed = scene.listen("other.imu", {})
    of_tick(probed, scene.world.tick())
    counts, places, both_ways, n_middle = [], [], [], 0
    kinds = np.dtype([("x", "<u2"), ("y", "<u2"), ("t", "<i8"), ("pol", "?")])
    for sensor, messages in made:
        up = down = n_both = 0
        seen_at = [[], []]
        while True:
            try:
                message = messages.get_nowait()
            except queue.Empty:
                break
            if message.frame <= frame:
                events = np.frombuffer(message.raw_data, dtype=kinds)
                up, down = up + int(events["pol"].sum()), down + int((~events["pol"]).sum())
                if message.width == WIDTH and not counts:
                    x, y = events["x"].astype(int) - WIDTH // 4, events["y"].astype(int) - HEIGHT // 4
                    n_middle += int(((0 <= x) & (x < WIDTH // 2) & (0 <= y) & (y < HEIGHT // 2)).sum())
                # One number for the place, and one for place and time.
                by_way = [events[events["pol"] == way] for way in (False, True)]
                spots = [one["x"].astype(np.int64) + WIDTH * one["y"] for one in by_way]
                n_both += len(np.intersect1d(*spots))
                for way in (0, 1):
                    seen_at[way].append(by_way[way]["t"] * WIDTH * HEIGHT + spots[way])
        counts.append((up, down))
        places.append([np.unique(np.concatenate(one)) for one in seen_at])
        both_ways.append(n_both)
        sensor.destroy()
    probe.destroy()
    scene.world.tick()
    plain, few_up, few_down, rested, linear, dull, twin, rough_up, rough_down, straight, part = counts
    assert plain[0] > 100 and plain[1] > 100, counts
    # Where brightness rises and falls again, what did not count on the way up is missing on the way down.
    assert few_up[0] < 0.5 * plain[0] and few_up[1] > 0.7 * plain[1], counts
    assert few_down[1] < 0.5 * plain[1] and few_down[0] > 0.7 * plain[0], counts
    assert sum(rested) < 0.9 * sum(plain), counts
    assert linear != plain and sum(dull) < sum(plain), counts
    # Thresholds that chance spreads move events of their own direction most of all, and twins without are alike.
    assert twin == plain and all(np.array_equal(*pair) for pair in zip(places[6], places[0]))
    shared = [[len(np.intersect1d(one[way], places[0][way])) / len(places[0][way]) for way in (0, 1)] for one in places[7:9]]
    assert shared[0][1] < 0.5 and shared[1][0] < 0.5 and shared[0][0] > shared[0][1] and shared[1][1] > shared[1][0], shared
    assert 0.7 * plain[0] < rough_up[0] < 1.5 * plain[0] and 0.7 * plain[1] < rough_down[1] < 1.5 * plain[1], counts
    assert n_middle > 100 and abs(sum(part) / n_middle - 1.0) < 0.1, (sum(part), n_middle)
    # Between two frames a straight line only rises or only falls; an edge that passes a pixel does both.
    assert straight[0] > 100 and straight[1] > 100 and both_ways[9] == 0 < both_ways[0], (straight, both_ways)


def main():
    _, world = stage(PORT)
    scene = Scene(world)
    run_checks(
        {
            "film": check_film,
            "views": check_views,
            "lidar fans": check_lidar_fans,
            "lidar losses": check_lidar_losses,
            "radar": check_radar,
            "imu": check_imu,
            "gnss": check_gnss,
            "obstacle": check_obstacle,
            "events": check_events,
        },
        scene,
    )


run(main)
