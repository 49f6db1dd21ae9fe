"""Lens, blur and the rarer calls of the stock `carla` 0.9.16 wheel against gantry-carla.

    carla_optics.py PORT

Prints "NAME passed" per theme; the first thing that is not as it should be ends the script. The lens and the disc of confusion are computed here
anew, with NumPy, from the pictures of a plain camera.
"""

import math
import sys
import time

import carla
import numpy as np
from carla_kit import listen, of_tick, run, run_checks, stage, ticks, turn_deg

PORT = int(sys.argv[1])
WIDTH, HEIGHT = 120, 80
CAR = 14


class Scene:
    """A car on a free spawn point with a camera's place on its roof, and another car ahead."""

    def __init__(self, world):
        self.world = world
        self.library = world.get_blueprint_library()
        model = self.library.find("vehicle.tesla.model3")
        for point in world.get_map().get_spawn_points():
            ahead = world.get_map().get_waypoint(point.location).next(9.0)[0].transform
            ahead.location.z = point.location.z
            if turn_deg(ahead.rotation.yaw, point.rotation.yaw) > 5.0:
                continue
            self.car, self.other = (world.try_spawn_actor(model, place) for place in (point, ahead))
            if self.car and self.other:
                break
            world.tick()
            for car in filter(None, (self.car, self.other)):
                car.destroy()
        ticks(world, 40)

    def camera(self, kind, **attributes):
        blueprint = self.library.find("sensor.camera." + kind)
        for name, value in {"image_size_x": WIDTH, "image_size_y": HEIGHT, **attributes}.items():
            blueprint.set_attribute(name, str(value))
        return listen(self.world, blueprint, carla.Transform(carla.Location(x=0.3, z=2.1)), attach_to=self.car)

    def pictures(self, *cameras):
        """What cameras, given as kind and attributes, see at one tick; they live no longer."""
        made = [self.camera(kind, **attributes) for kind, attributes in cameras]
        ticks(self.world, 2)
        tick = self.world.tick()
        seen = [pixels(of_tick(messages, tick)) for _, messages in made]
        for sensor, _ in made:
            sensor.destroy()
        self.world.tick()
        return seen


def pixels(image):
    return np.frombuffer(image.raw_data, dtype=np.uint8).reshape(image.height, image.width, 4).astype(int)


def check_lens(scene):
    """Every camera with the same lens shows, at p, the plain camera's pixel at p (1 + k r² + kcube r³)."""
    lens = {"lens_k": -0.6, "lens_kcube": 0.15, "lens_x_size": 1.0, "lens_y_size": 0.9}
    kinds = ("depth", "semantic_segmentation", "instance_segmentation", "normals", "rgb")
    seen = scene.pictures(*((kind, attributes) for attributes in ({}, lens) for kind in kinds))
    plain, bent = seen[: len(kinds)], seen[len(kinds) :]
    x, y = np.meshgrid((np.arange(WIDTH) + 0.5) / WIDTH - 0.5, (np.arange(HEIGHT) + 0.5) / HEIGHT - 0.5)
    r = np.hypot(x * lens["lens_x_size"], y * lens["lens_y_size"])
    factor = 1.0 + lens["lens_k"] * r**2 + lens["lens_kcube"] * r**3
    column, row = (((axis * factor + 0.5) * side).astype(int) for axis, side in ((x, WIDTH), (y, HEIGHT)))
    for kind, straight, curved in zip(kinds, plain, bent):
        expected = straight[row, column]
        if kind == "rgb":
            difference = np.abs(curved - expected).mean()
            unbent = np.abs(curved - straight).mean()
            assert difference < 0.5 * unbent, (difference, unbent)
            continue
        same = (curved == expected).all(axis=2).mean()
        assert same > 0.995, (kind, same)
        assert (curved == straight).all(axis=2).mean() < 0.98, kind


def contrast(picture):
    return np.abs(np.diff(picture[:, :, 1], axis=1)).mean()


def check_motion_blur(scene):
    """A camera that turns with its car smears the picture; at rest the same camera is as sharp as another."""
    blurring = {"motion_blur_intensity": 1.0, "motion_blur_max_distortion": 10.0}
    sharp, still = scene.pictures(("rgb", {}), ("rgb", blurring))
    assert np.abs(sharp - still).max() <= 2, "at rest"
    made = [scene.camera("rgb"), scene.camera("rgb", **blurring), scene.camera("rgb", motion_blur_intensity=0.0)]
    here = scene.car.get_transform()
    scene.car.set_simulate_physics(False)
    for n in range(4):
        turned = carla.Transform(here.location, carla.Rotation(yaw=here.rotation.yaw + 6.0 * n))
        scene.car.set_transform(turned)
        tick = scene.world.tick()
        moving = [pixels(of_tick(messages, tick)) for _, messages in made]
    assert contrast(moving[1]) < 0.65 * contrast(moving[0]), [contrast(picture) for picture in moving]
    assert np.abs(moving[0] - moving[2]).max() <= 2, "no intensity is no blur"
    scene.car.set_transform(here)
    scene.car.set_simulate_physics(True)
    for sensor, _ in made:
        sensor.destroy()
    ticks(scene.world, 10)


def check_focus(scene):
    """With a near focus the distance is blurred over the disc that the thin lens gives; behind a hyperfocal focus nothing is."""
    focus = {"focal_distance": 40, "fstop": 0.2, "min_fstop": 0.2, "fov": 50}
    depth, sharp, near, far = scene.pictures(
        ("depth", {"fov": 50}), ("rgb", {"fov": 50}), ("rgb", focus), ("rgb", {**focus, "focal_distance": 100000, "fstop": 8})
    )
    metres = 1000.0 * (depth[:, :, 2] + 256 * depth[:, :, 1] + 65536 * depth[:, :, 0]) / (2**24 - 1)
    focal_mm = 24.576 / (2.0 * math.tan(math.radians(25.0)))
    diameter_px = WIDTH / 24.576 * focal_mm**2 / 0.2 * np.abs(1.0 - 0.4 / metres) / (400.0 - focal_mm)
    radius = min(0.5 * float(np.median(diameter_px)), 0.04 * WIDTH)
    assert radius > 2.0, radius
    step = np.arange(-6, 7)
    disc = np.clip(radius - np.hypot(*np.meshgrid(step, step)) + 0.5, 0.0, 1.0)
    light = lambda picture: (picture[:, :, 1] / 255.0) ** 2.2
    padded = np.pad(light(sharp), 6, mode="edge")
    blurred = sum(disc[j, i] * padded[j : j + HEIGHT, i : i + WIDTH] for j in range(13) for i in range(13)) / disc.sum()
    inside = (slice(8, -8), slice(8, -8))
    error = np.abs(light(near) - blurred)[inside].mean()
    change = np.abs(light(sharp) - blurred)[inside].mean()
    assert error < 0.35 * change, (error, change)
    assert np.abs(far - sharp).mean() < 1.0


def check_film(scene):
    """A steeper straight part is a stronger contrast; defaults are the plain picture."""
    defaults = {"slope": 0.88, "toe": 0.55, "shoulder": 0.26, "black_clip": 0.0, "white_clip": 0.04}
    plain, same, soft, hard = scene.pictures(("rgb", {}), ("rgb", defaults), ("rgb", {"slope": 0.5}), ("rgb", {"slope": 1.4}))
    assert (plain == same).all()
    assert soft[:, :, 1].std() < hard[:, :, 1].std(), (soft[:, :, 1].std(), hard[:, :, 1].std())


def check_ignored_vehicles(scene):
    """One camera leaves a car out, another at the same place does not; an empty list brings it back."""
    made = [scene.camera("semantic_segmentation") for _ in range(2)]

    def n_car():
        tick = scene.world.tick()
        return [int((pixels(of_tick(messages, tick))[: HEIGHT // 2 + 12, :, 2] == CAR).sum()) for _, messages in made]

    scene.world.tick()
    both = n_car()
    assert both[0] == both[1] > 20, both
    made[0][0].set_ignored_vehicles([scene.other.id])
    n_car()
    one = n_car()
    assert one[0] < one[1] == both[1], (one, both)
    made[0][0].set_ignored_vehicles([])
    n_car()
    assert n_car() == both
    for sensor, _ in made:
        sensor.destroy()
    scene.world.tick()


def check_gravity(scene):
    """An IMU at rest measures the gravity that was set, along the world's vertical."""
    imu, messages = listen(scene.world, scene.library.find("sensor.other.imu"), carla.Transform(carla.Location(), carla.Rotation(pitch=30.0)), attach_to=scene.car)
    ticks(scene.world, 5)
    for gravity in (9.81, 3.7):
        scene.world.set_imui_sensor_gravity(gravity)
        assert abs(scene.world.get_imui_sensor_gravity() - gravity) < 1e-5
        felt = of_tick(messages, scene.world.tick()).accelerometer
        assert abs(felt.length() - gravity) < 0.15, (felt, gravity)
        pitch = math.degrees(math.atan2(felt.x, felt.z))
        assert abs(pitch - 30.0) < 3.0, (pitch, felt)
    scene.world.set_imui_sensor_gravity(9.81)
    imu.destroy()


def check_bones(scene):
    """A vehicle has a base and four wheels, whose bones lie where physics control has the wheels."""
    names = scene.car.get_bone_names()
    assert list(names) == ["Vehicle_Base", "Wheel_Front_Left", "Wheel_Front_Right", "Wheel_Rear_Left", "Wheel_Rear_Right"], names
    bones = scene.car.get_bone_world_transforms()
    assert bones[0].location.distance(scene.car.get_location()) < 0.01
    for bone, wheel in zip(bones[1:], scene.car.get_physics_control().wheels):
        place = carla.Location(wheel.position.x / 100.0, wheel.position.y / 100.0, wheel.position.z / 100.0)
        assert bone.location.distance(place) < 0.15, (bone, wheel)


def check_riders(scene):
    """A car and a walker attached to a car ride on it, also while it drives."""
    up = carla.Transform(carla.Location(z=4.0), carla.Rotation(yaw=90.0))
    car = scene.world.spawn_actor(scene.library.find("vehicle.mini.cooper_s"), up, attach_to=scene.car)
    walker = scene.world.spawn_actor(
        scene.library.find("walker.pedestrian.0001"), carla.Transform(carla.Location(x=-1.0, z=3.0)), attach_to=scene.car
    )
    begin = scene.car.get_location()
    scene.car.set_target_velocity(-5.0 * scene.car.get_transform().get_forward_vector())
    for _ in range(20):
        scene.world.tick()
        base = scene.car.get_transform()
        for rider, place in ((car, (0.0, 4.0)), (walker, (-1.0, 3.0))):
            wanted = base.transform(carla.Location(x=place[0], z=place[1]))
            assert rider.get_location().distance(wanted) < 0.02, (rider.type_id, rider.get_location(), wanted)
        assert turn_deg(car.get_transform().rotation.yaw, base.rotation.yaw + 90.0) < 0.5
    assert scene.car.get_location().distance(begin) > 0.5
    scene.world.tick()
    assert car.destroy() and walker.destroy()
    scene.world.tick()


def check_radio(scene):
    """A receiver with `sensor_tick` delivers at most once per interval, and then all that it heard."""
    made = []
    for parent, tick in ((scene.other, "0.0"), (scene.car, "0.2"), (scene.car, "0.0")):
        blueprint = scene.library.find("sensor.other.v2x")
        for name, value in {"sensor_tick": tick, "fixed_rate": "true", "gen_cam_min": "0.0", "use_etsi_fading": "false"}.items():
            blueprint.set_attribute(name, value)
        made.append(listen(scene.world, blueprint, carla.Transform(), attach_to=parent))
    slow, fast = [], []
    # The client hears its sensors in threads of their own, whenever these get to run.
    for _ in range(400):
        scene.world.tick()
        for heard, (_, messages) in ((slow, made[1]), (fast, made[2])):
            while not messages.empty():
                event = messages.get()
                heard.append((event.timestamp, len(list(event))))
        if len(slow) > 4 and len(fast) > 18:
            break
        time.sleep(0.005)
    gaps = np.diff([time for time, _ in slow])
    assert len(slow) > 4 and gaps.min() > 0.19, slow
    assert all(n == 4 for _, n in slow[1:]), slow
    assert len(fast) > 18 and all(n == 1 for _, n in fast), fast
    for sensor, _ in made:
        sensor.destroy()


def main():
    _, world = stage(PORT)
    scene = Scene(world)
    checks = {
        "lens": lambda: check_lens(scene),
        "motion blur": lambda: check_motion_blur(scene),
        "focus": lambda: check_focus(scene),
        "film": lambda: check_film(scene),
        "ignored vehicles": lambda: check_ignored_vehicles(scene),
        "gravity": lambda: check_gravity(scene),
        "bones": lambda: check_bones(scene),
        "radio": lambda: check_radio(scene),
        "riders": lambda: check_riders(scene),
    }
    run_checks(checks)


run(main)
