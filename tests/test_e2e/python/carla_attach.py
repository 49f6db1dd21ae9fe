"""`gantry.attach` beside the stock `carla` 0.9.16 wheel, in one process: the same frames without a copy.

    carla_attach.py PORT DOMAIN

Prints "NAME passed" per theme; the first thing that is not as it should be ends the script.
"""

import queue
import sys

import gantry
import numpy as np
from carla_kit import PATIENCE_SECS, run, run_checks, stage

PORT, DOMAIN = int(sys.argv[1]), sys.argv[2]
WIDTH, HEIGHT = 96, 64


def spawn(world, kind):
    blueprint = world.get_blueprint_library().find("sensor.camera." + kind)
    blueprint.set_attribute("image_size_x", str(WIDTH))
    blueprint.set_attribute("image_size_y", str(HEIGHT))
    place = world.get_map().get_spawn_points()[40]
    place.location.z += 2.0
    return world.spawn_actor(blueprint, place)


def check_same_frames(world):
    camera = spawn(world, "rgb")
    messages = queue.Queue()
    camera.listen(messages.put)
    with gantry.attach(camera, domain=DOMAIN, timeout=PATIENCE_SECS) as frames:
        for _ in range(5):
            tick = world.tick()
            image = messages.get(timeout=PATIENCE_SECS)
            frame = frames.next(timeout=PATIENCE_SECS)
            assert frame.tick == image.frame == tick, (frame.tick, image.frame, tick)
            theirs = np.frombuffer(image.raw_data, dtype=np.uint8).reshape(HEIGHT, WIDTH, 4)
            assert (frame.array == theirs).all()
            assert not frame.array.flags.writeable and frame.header.sensor_id == camera.id
            x, y, z = frame.header.world_from_sensor.translation_m
            place = image.transform.location
            assert max(abs(x - place.x), abs(-y - place.y), abs(z - place.z)) < 1e-3, (x, y, z, place)
    camera.destroy()


def check_without_listening(world):
    """Frames start with the first reader, whoever that is; depth is metres."""
    camera = spawn(world, "depth")
    messages = queue.Queue()
    camera.listen(messages.put)
    with gantry.attach(camera.id, domain=DOMAIN, timeout=PATIENCE_SECS) as frames:
        world.tick()
        image = messages.get(timeout=PATIENCE_SECS)
        camera.stop()
        frame = frames.next(timeout=PATIENCE_SECS)
        raw = np.frombuffer(image.raw_data, dtype=np.uint8).reshape(HEIGHT, WIDTH, 4).astype(float)
        metres = 1000.0 * (raw[..., 2] + 256.0 * raw[..., 1] + 65536.0 * raw[..., 0]) / (256.0**3 - 1.0)
        assert np.abs(np.minimum(frame.array, 1000.0) - metres).max() < 1e-3
        tick = world.tick()
        assert frames.next(timeout=PATIENCE_SECS).tick == tick, "without a listener"
        assert messages.empty()
    camera.destroy()


def check_choice(world):
    camera = spawn(world, "instance_segmentation")
    of_camera = {"domain": DOMAIN, "timeout": PATIENCE_SECS}
    with gantry.attach(camera, **of_camera) as ids, gantry.attach(camera, "semantic", **of_camera) as classes:
        world.tick()
        assert ids.next(timeout=PATIENCE_SECS).modality == "instance"
        assert classes.next(timeout=PATIENCE_SECS).modality == "semantic"
    camera.destroy()


def check_sentences(world):
    light = world.get_actors().filter("traffic.traffic_light")[0]
    for sensor, words in ((4_000_000, "no actor 4000000"), (light, "has no frames")):
        try:
            gantry.attach(sensor, domain=DOMAIN, timeout=0.2)
        except gantry.GantryError as error:
            assert words in str(error), error
        else:
            raise AssertionError(f"{sensor} was attached")


def main():
    _, world = stage(PORT)
    checks = {
        "same frames": check_same_frames,
        "without listening": check_without_listening,
        "choice": check_choice,
        "sentences": check_sentences,
    }
    run_checks(checks, world)


run(main)
