"""A CARLA script that collects images, depth and classes from shared memory instead of callbacks.

Everything but `gantry.attach` is CARLA's own client. Saves one file per tick: frames/000123.npz.
"""

import pathlib
import sys

import carla
import gantry
import numpy as np

PORT, N_TICKS = int(sys.argv[1]), int(sys.argv[2])
WIDTH, HEIGHT = 240, 160
KINDS = {"rgb": "sensor.camera.rgb", "depth": "sensor.camera.depth", "semantic": "sensor.camera.semantic_segmentation"}

client = carla.Client("localhost", PORT)
client.set_timeout(60.0)
world = client.get_world()
settings = world.get_settings()
settings.synchronous_mode, settings.fixed_delta_seconds = True, 0.1
world.apply_settings(settings)
library, actors, topics = world.get_blueprint_library(), [], {}
out = pathlib.Path("frames")
out.mkdir(exist_ok=True)
try:
    car = world.spawn_actor(library.find("vehicle.tesla.model3"), world.get_map().get_spawn_points()[10])
    actors.append(car)
    car.apply_control(carla.VehicleControl(throttle=0.4))
    for name, kind in KINDS.items():
        blueprint = library.find(kind)
        blueprint.set_attribute("image_size_x", str(WIDTH))
        blueprint.set_attribute("image_size_y", str(HEIGHT))
        camera = world.spawn_actor(blueprint, carla.Transform(carla.Location(x=1.5, z=1.6)), attach_to=car)
        actors.append(camera)
        topics[name] = gantry.attach(camera)  # instead of camera.listen(callback)
    for _ in range(N_TICKS):
        tick = world.tick()
        frames = {name: topic.next(60) for name, topic in topics.items()}
        assert all(frame.tick == tick for frame in frames.values()), "a frame of another tick"
        # Views of shared memory: what is kept has to be written or copied before the frame goes.
        np.savez_compressed(
            out / f"{tick:06}.npz",
            rgb=frames["rgb"].rgb,
            depth_m=frames["depth"].array,
            classes=frames["semantic"].array,
            speed_mps=car.get_velocity().length(),
        )
    with np.load(out / f"{tick:06}.npz") as last:
        near = float(last["depth_m"].min())
        print(f"{N_TICKS} ticks saved; the last: {last['rgb'].shape}, nearest {near:.2f} m, {len(np.unique(last['classes']))} classes")
finally:
    for topic in topics.values():
        topic.close()
    for actor in reversed(actors):
        actor.destroy()
    settings.synchronous_mode = False
    world.apply_settings(settings)
