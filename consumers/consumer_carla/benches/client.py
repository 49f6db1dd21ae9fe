"""What the stock `carla` 0.9.16 client gets from gantry-carla, measured in the client's own process.

    client.py PORT DOMAIN tick                   round trip of world.tick() in an empty synchronous world
    client.py PORT DOMAIN frames WIDTH HEIGHT    published -> Python callback of RGB frames, beside gantry.attach in
                                                 another process, asleep until the frame comes and looking again and again
    client.py PORT DOMAIN cameras [N …]          ticks/s with 1, 2, 4, 8, 16 cameras of 640x480, all frames taken, by callback
                                                 (also with a client that works beside the rendering) and by gantry.attach
    client.py PORT DOMAIN traffic TM_PORT        ticks/s with 0 to 200 vehicles of the client's own Traffic Manager
    client.py PORT DOMAIN echo                   world.tick() of a server that only answers (needs msgpack)

With `--json FILE` the figures are also written for the tables of docs/benchmarks.
Run the simulator on DOMAIN with `vehicles = 0` and the gateway at PORT; PYTHONPATH has consumers/consumer_python/python.
"""

import json
import os
import platform
import queue
import socket
import struct
import subprocess
import sys
import threading
import time

import carla
import numpy as np

JSON_FILE = None
if "--json" in sys.argv:
    JSON_FILE = sys.argv.pop(sys.argv.index("--json") + 1)
    sys.argv.remove("--json")
PORT, DOMAIN, WHAT = int(sys.argv[1]), sys.argv[2], sys.argv[3]
ROWS = []


def note(name, **figures):
    """Adds a row to the result that `--json` writes."""
    ROWS.append({"name": name, **figures})


def write_json():
    """The same form as launch_cli::bench writes: what, on which machine, from which commit, with which command."""
    models = [line.split(": ", 1)[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")]
    commit = subprocess.run(["git", "describe", "--always", "--dirty", "--abbrev=10"], capture_output=True, text=True)
    machine = {
        "cpu": models[0] if models else "unknown",
        "n_cores": len(os.sched_getaffinity(0)),
        "kernel": platform.release(),
        "load_1min": open("/proc/loadavg").read().split()[0],
        "commit": commit.stdout.strip() or "unknown",
        "command": " ".join(["client.py", *sys.argv[1:]]),
    }
    with open(JSON_FILE, "w") as file:
        json.dump({"bench": "client.py", "machine": machine, "rows": ROWS}, file, indent=2)
        file.write("\n")


def say(name, micros):
    values = np.asarray(micros)
    note(name, p50_us=float(np.percentile(values, 50)), p99_us=float(np.percentile(values, 99)), n=len(values))
    print(f"{name}: p50 {np.percentile(values, 50):.0f} us, p99 {np.percentile(values, 99):.0f} us, n {len(values)}", flush=True)


def connect(port=PORT):
    client = carla.Client("127.0.0.1", port)
    client.set_timeout(60.0)
    world = client.get_world()
    settings = world.get_settings()
    settings.synchronous_mode = True
    settings.fixed_delta_seconds = 0.05
    world.apply_settings(settings)
    for actor in world.get_actors().filter("vehicle.*"):
        actor.destroy()
    return client, world


def measure_ticks(world, n=3000):
    for _ in range(100):
        world.tick()
    times = []
    for _ in range(n):
        began = time.monotonic_ns()
        world.tick()
        times.append((time.monotonic_ns() - began) / 1e3)
    say("world.tick()", times)
    print(f"{n / (sum(times) / 1e6):.0f} ticks/s", flush=True)
    note("steps per second", steps_per_sec=n / (sum(times) / 1e6))


def camera(world, width, height, place):
    blueprint = world.get_blueprint_library().find("sensor.camera.rgb")
    blueprint.set_attribute("image_size_x", str(width))
    blueprint.set_attribute("image_size_y", str(height))
    place.location.z += 2.0
    return world.spawn_actor(blueprint, place)


def measure_frames(world, width, height, n=80):
    import gantry

    sensor = camera(world, width, height, world.get_map().get_spawn_points()[20])
    arrived, messages, own = {}, queue.Queue(), np.zeros(width * height * 4, np.uint8)
    used = {}

    def callback(image):
        arrived[image.frame] = time.monotonic_ns()
        np.copyto(own, np.frombuffer(image.raw_data, np.uint8))
        used[image.frame] = time.monotonic_ns()
        messages.put(image.frame)

    through_carla, copied = [], []
    with gantry.attach(sensor, domain=DOMAIN) as frames:
        # One reader at a time; when a frame was published is read from shared memory afterwards.
        sensor.listen(callback)
        for _ in range(n):
            tick = world.tick()
            while messages.get(timeout=60.0) != tick:
                pass
            frame = frames.next(timeout=60.0)
            assert frame.tick == tick
            published = frame.header.published_mono_nanos
            frame = None
            through_carla.append((arrived[tick] - published) / 1e3)
            copied.append((used[tick] - published) / 1e3)
        sensor.stop()
        world.tick()
        frames.next(timeout=60.0)
    say(f"{width}x{height} published -> carla callback", through_carla[10:])
    say(f"{width}x{height} published -> carla callback, copied", copied[10:])
    for name, busy_wait in (("gantry.attach", 0.0), ("gantry.attach, busy_wait", 60.0)):
        times = through_memory(world, sensor.id, n, busy_wait)
        say(f"{width}x{height} published -> {name}", times[10:])
        print(f"  ratio p50 {np.percentile(through_carla[10:], 50) / np.percentile(times[10:], 50):.1f}", flush=True)
    sensor.destroy()


def through_memory(world, actor_id, n, busy_wait):
    """Frames of `n` steps as a process beside this one gets them, which does nothing else."""
    reader = subprocess.Popen([sys.executable, __file__, str(PORT), DOMAIN, "read", str(actor_id), str(n), str(busy_wait)],
                              stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert reader.stdout.readline() == "ready\n"
    times = []
    for _ in range(n):
        tick = world.tick()
        seen, micros = reader.stdout.readline().split()
        assert int(seen) == tick, (seen, tick)
        times.append(float(micros))
        reader.stdin.write("next\n")
        reader.stdin.flush()
    assert reader.wait(60) == 0
    return times


def read_frames(actor_id, n, busy_wait):
    import gantry

    with gantry.attach(actor_id, domain=DOMAIN) as frames:
        print("ready", flush=True)
        for _ in range(n):
            frame = frames.next(timeout=60.0, busy_wait=busy_wait)
            now = time.monotonic_ns()
            print(frame.tick, (now - frame.header.published_mono_nanos) / 1e3, flush=True)
            frame = None
            sys.stdin.readline()


def measure_cameras(world, numbers, n=15):
    """Ticks/s with all frames taken: through CARLA's callbacks, the same while the client sleeps for half a step
    between `world.tick()` and its images (unchanged if the images are made meanwhile), and through `attach`."""
    import gantry

    points = world.get_map().get_spawn_points()

    def steps(taking, nap=0.0):
        for step in range(n + 3):
            if step == 3:
                began = time.monotonic()
            tick = world.tick()
            time.sleep(nap)
            for take in taking:
                while take() != tick:
                    pass
        return n / (time.monotonic() - began)

    for n_cameras in numbers:
        cameras = [camera(world, 640, 480, points[5 * i]) for i in range(n_cameras)]
        queues = [queue.Queue() for _ in cameras]
        for sensor, messages in zip(cameras, queues):
            sensor.listen(messages.put)
        callbacks = [lambda messages=messages: messages.get(timeout=60.0).frame for messages in queues]
        listening = steps(callbacks)
        napping = steps(callbacks, 0.5 / listening)
        for sensor in cameras:
            sensor.stop()
        world.tick()
        readers = [gantry.attach(sensor, domain=DOMAIN) for sensor in cameras]
        attached = steps([lambda reader=reader: reader.next(timeout=60.0).tick for reader in readers])
        for reader in readers:
            reader.close()
        for name, per_sec in (("", listening), (", half a step asleep", napping), (", attach", attached)):
            print(f"{n_cameras} cameras 640x480{name}: {per_sec:.2f} ticks/s", flush=True)
            note(f"{n_cameras} cameras{name}", steps_per_sec=per_sec)
        for sensor in cameras:
            sensor.destroy()
        world.tick()


def measure_traffic(client, world, tm_port, n=200):
    points = world.get_map().get_spawn_points()
    models = [bp for bp in world.get_blueprint_library().filter("vehicle.*") if int(bp.get_attribute("number_of_wheels")) == 4]
    manager = client.get_trafficmanager(tm_port)
    manager.set_synchronous_mode(True)
    manager.set_random_device_seed(7)
    cars, next_point = [], 0
    for wanted in (0, 25, 50, 100, 150, 200):
        while len(cars) < wanted and next_point < len(points):
            actor = world.try_spawn_actor(models[next_point % len(models)], points[next_point])
            next_point += 1
            if actor:
                cars.append(actor)
        world.tick()
        for with_manager in (False, True):
            for car in cars:
                car.set_autopilot(with_manager, tm_port)
            for _ in range(10):
                world.tick()
            began = time.monotonic()
            for _ in range(n):
                world.tick()
            per_sec, state = n / (time.monotonic() - began), "on" if with_manager else "off"
            print(f"{len(cars)} vehicles, Traffic Manager {state}: {per_sec:.0f} ticks/s", flush=True)
            note(f"{len(cars)} vehicles, Traffic Manager {state}", steps_per_sec=per_sec)
        if next_point >= len(points):
            break


def echo_server():
    """Answers `tick_cue` at once and sends an empty snapshot: what the client and the kernel cost."""
    import msgpack

    calls, streams = socket.create_server(("127.0.0.1", 0)), socket.create_server(("127.0.0.1", 0))
    token = struct.pack("<IHBB", 1, streams.getsockname()[1], 1, 0) + bytes(16)
    settings = [True, False, [True, 0.05], True, 0.01, 10, 0.0, False, 3000.0, 2000.0, True]
    answers = {
        "version": "0.9.16", "get_episode_info": [7, [token]], "get_sensor_token": [token], "get_episode_settings": settings,
        "query_lights_state": [], "get_required_files": [], "set_episode_settings": 1, "get_actors_by_id": [],
    }
    frame, listener = [1], []

    def accept():
        connection, _ = streams.accept()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.recv(4)
        listener.append(connection)

    def serve():
        connection, _ = calls.accept()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        unpacker = msgpack.Unpacker(raw=False)
        while True:
            data = connection.recv(65536)
            if not data:
                return
            unpacker.feed(data)
            for _, number, method, _ in unpacker:
                if method == "tick_cue":
                    frame[0] += 1
                    snapshot = struct.pack("<QQd6fQdfiiiI", 17, frame[0], frame[0] * 0.05, *[0.0] * 6, 7, 0.0, 0.05, 0, 0, 0, 0)
                    listener[0].sendall(struct.pack("<I", len(snapshot)) + snapshot)
                    answer = frame[0]
                else:
                    answer = answers[method]
                connection.sendall(msgpack.packb([1, number, None, [[1, answer]]]))

    threading.Thread(target=accept, daemon=True).start()
    threading.Thread(target=serve, daemon=True).start()
    return calls.getsockname()[1]


def main():
    if WHAT == "echo":
        # A process of its own: one interpreter cannot be client and server at once without waiting for itself.
        read, write = os.pipe()
        child = os.fork()
        if child == 0:
            os.write(write, struct.pack("<I", echo_server()))
            time.sleep(600)
            os._exit(0)
        client = carla.Client("127.0.0.1", struct.unpack("<I", os.read(read, 4))[0])
        client.set_timeout(10.0)
        world = client.get_world()
        time.sleep(0.5)
        measure_ticks(world)
        os.kill(child, 9)
        return
    if WHAT == "read":
        return read_frames(int(sys.argv[4]), int(sys.argv[5]), float(sys.argv[6]))
    client, world = connect()
    if WHAT == "tick":
        measure_ticks(world)
    elif WHAT == "frames":
        measure_frames(world, int(sys.argv[4]), int(sys.argv[5]))
    elif WHAT == "cameras":
        measure_cameras(world, [int(n) for n in sys.argv[4:]] or [1, 2, 4, 8, 16])
    elif WHAT == "traffic":
        measure_traffic(client, world, int(sys.argv[4]))


main()
if JSON_FILE:
    write_json()
# The wheel's own threads must not outlive the interpreter.
os._exit(0)
