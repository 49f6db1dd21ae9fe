"""The stock `carla` 0.9.16 wheel: many listeners of one sensor, cameras without rendering, and a listener that takes nothing.

    carla_streams.py PORT STREAM_PORT DOMAIN DARK_FILE

Prints "NAME passed" per theme; the first thing that is not as it should be ends the script. While cameras are dark it says "all is dark now" and waits until
DARK_FILE is there.
"""

import os
import queue
import socket
import struct
import sys
import time

import carla
import gantry
from carla_kit import PATIENCE_SECS, connect, listen, of_tick, run, run_checks, stage

PORT, STREAM_PORT, DOMAIN, DARK_FILE = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], sys.argv[4]
N_CLIENTS = 10


def spawn(world, kind, width=64, height=48, **attributes):
    blueprint = world.get_blueprint_library().find("sensor." + kind)
    if kind.startswith("camera"):
        blueprint.set_attribute("image_size_x", str(width))
        blueprint.set_attribute("image_size_y", str(height))
    for name, value in attributes.items():
        blueprint.set_attribute(name, value)
    place = world.get_map().get_spawn_points()[40]
    place.location.z += 2.0
    return world.spawn_actor(blueprint, place)


def until(messages, tick):
    """Takes messages up to a tick: `apply_settings` of the wheel steps the world by itself when a step length is fixed."""
    frame = 0
    while frame < tick:
        frame = messages.get(timeout=PATIENCE_SECS)
    assert frame == tick, (frame, tick)


def content(data):
    return (data.frame, bytes(data.raw_data)) if hasattr(data, "raw_data") else (data.frame, data.latitude, data.longitude)


def check_many(world):
    """Ten clients listen to a camera and a GNSS, two readers of shared memory look on: everybody has every frame, and the same."""
    camera, gnss = spawn(world, "camera.rgb"), spawn(world, "other.gnss")
    world.tick()
    clients, heard, listeners = [], [], []
    for _ in range(N_CLIENTS):
        client = connect(PORT)
        clients.append(client)
        for sensor in (camera, gnss):
            mine, messages = client.get_world().get_actor(sensor.id), queue.Queue()
            mine.listen(lambda data, messages=messages: messages.put(content(data)))
            listeners.append(mine)
            heard.append(messages)
    attached = {"domain": DOMAIN, "timeout": PATIENCE_SECS}
    with gantry.attach(camera, **attached) as one, gantry.attach(camera, **attached) as two:
        for _ in range(20):
            tick = world.tick()
            messages = [each.get(timeout=PATIENCE_SECS) for each in heard]
            assert all(message[0] == tick for message in messages), (tick, [message[0] for message in messages])
            assert len(set(messages[0::2])) == 1 and len(set(messages[1::2])) == 1, "all are sent the same"
            raw = messages[0][1]
            for frames in (one, two):
                frame = frames.next(timeout=PATIENCE_SECS)
                assert frame.tick == tick and frame.array.tobytes() == raw
    # The first goes, the others stay, and one comes back.
    listeners[0].stop()
    for _ in range(5):
        tick = world.tick()
        assert all(each.get(timeout=PATIENCE_SECS)[0] == tick for each in heard[1:])
    listeners[0].listen(lambda data: heard[0].put(content(data)))
    tick = world.tick()
    assert all(each.get(timeout=PATIENCE_SECS)[0] == tick for each in heard)
    for listener in listeners:
        listener.stop()
    camera.destroy()
    gnss.destroy()
    world.tick()


def check_dark(world):
    """Without rendering cameras send nothing, everything else goes on, and then cameras go on with the very next tick."""
    camera, other, gnss, lidar = (spawn(world, kind) for kind in ("camera.rgb", "camera.depth", "other.gnss", "lidar.ray_cast"))
    heard = {}
    for sensor in (camera, other, gnss, lidar):
        heard[sensor.id] = queue.Queue()
        sensor.listen(lambda data, messages=heard[sensor.id]: messages.put(data.frame))
    # A second listener of the first camera.
    second, second_heard = connect(PORT).get_world().get_actor(camera.id), queue.Queue()
    second.listen(lambda data: second_heard.put(data.frame))
    tick = world.tick()
    assert all(messages.get(timeout=PATIENCE_SECS) == tick for messages in [*heard.values(), second_heard])
    settings = world.get_settings()
    settings.no_rendering_mode = True
    world.apply_settings(settings)
    assert world.get_settings().no_rendering_mode
    tick = world.tick()
    for sensor in (gnss, lidar):
        until(heard[sensor.id], tick)
    for _ in range(10):
        tick = world.tick()
        for sensor in (gnss, lidar):
            assert heard[sensor.id].get(timeout=PATIENCE_SECS) == tick
    late = spawn(world, "camera.semantic_segmentation")
    late_heard = queue.Queue()
    late.listen(lambda data: late_heard.put(data.frame))
    print("all is dark now", flush=True)
    deadline = time.monotonic() + 240.0
    while not os.path.exists(DARK_FILE):
        world.tick()
        assert time.monotonic() < deadline
    cameras = [heard[camera.id], heard[other.id], second_heard, late_heard]
    assert all(messages.empty() for messages in cameras)
    settings.no_rendering_mode = False
    world.apply_settings(settings)
    tick = world.tick()
    for messages in cameras:
        first = messages.get(timeout=PATIENCE_SECS)
        assert tick - 1 <= first <= tick, (first, tick)
        if first < tick:
            until(messages, tick)
    for _ in range(5):
        tick = world.tick()
        assert [messages.get(timeout=PATIENCE_SECS) for messages in cameras] == [tick] * 4
    for sensor in (second, camera, other, gnss, lidar, late):
        sensor.stop()
    for sensor in (camera, other, gnss, lidar, late):
        sensor.destroy()
    world.tick()


def check_slow(world):
    """A connection that takes nothing holds up neither its sensor's other listeners nor other sensors. The test counts waits for it: one."""
    camera, other = spawn(world, "camera.rgb", 640, 480), spawn(world, "camera.rgb")
    slow = socket.socket()
    slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    slow.connect(("127.0.0.1", STREAM_PORT))
    slow.sendall(struct.pack("<I", camera.id + 1))
    heard = []
    for sensor in (camera, other):
        messages = queue.Queue()
        sensor.listen(lambda data, messages=messages: messages.put(data.frame))
        heard.append(messages)
    for _ in range(30):
        tick = world.tick()
        assert [messages.get(timeout=PATIENCE_SECS) for messages in heard] == [tick] * 2
    slow.close()
    for sensor in (camera, other):
        sensor.stop()
        sensor.destroy()
    world.tick()


def check_palette(world):
    """CARLA's colours of the classes that a semantic camera shows; the two modes of the event camera differ, other values are refused."""
    semantic, coloured = spawn(world, "camera.semantic_segmentation"), spawn(world, "camera.cosmos_visualization")
    heard = [queue.Queue(), queue.Queue()]
    for sensor, messages in zip((semantic, coloured), heard):
        sensor.listen(messages.put)
    world.tick()
    classes, colours = (messages.get(timeout=PATIENCE_SECS) for messages in heard)
    classes.convert(carla.ColorConverter.CityScapesPalette)
    assert isinstance(colours, carla.Image) and bytes(classes.raw_data) == bytes(colours.raw_data), "the client's own palette"
    assert len(set(bytes(colours.raw_data))) > 4
    for sensor in (semantic, coloured):
        sensor.stop()
        sensor.destroy()
    try:
        spawn(world, "camera.dvs", gantry_mode="three_frame")
    except RuntimeError as error:
        assert "three_frame" in str(error), error
    else:
        raise AssertionError("three_frame was spawned")
    for mode in ("motion", "two_frame"):
        spawn(world, "camera.dvs", gantry_mode=mode).destroy()
    world.tick()


def check_buffers(world):
    """All 13 buffers of a camera may be listened to at once: nothing comes, the picture does, and the client lives."""
    camera, pictures = listen(world, world.get_blueprint_library().find("sensor.camera.rgb"), carla.Transform(carla.Location(z=5.0)))
    camera.enable_gbuffers(True)
    heard, kinds = [], list(carla.GBufferTextureID.values.values())
    assert len(kinds) == 13, kinds
    for kind in kinds:
        camera.listen_to_gbuffer(kind, heard.append)
    for _ in range(5):
        of_tick(pictures, world.tick())
    assert not heard, heard[:2]
    for kind in kinds:
        camera.stop_gbuffer(kind)
    camera.stop()
    camera.destroy()
    world.tick()


def main():
    _, world = stage(PORT)
    run_checks({"many": check_many, "palette": check_palette, "buffers": check_buffers, "dark": check_dark, "slow": check_slow}, world)


run(main)
