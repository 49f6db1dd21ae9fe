"""What the scripts under the stock `carla` 0.9.16 wheel have in common; no script by itself."""

import faulthandler
import math
import os
import queue
import socket
import struct
import sys
import threading
import time

import carla

STEP_SECS = 0.05
PATIENCE_SECS = 60.0
# A script that neither ticks nor ends a theme for this long hangs.
STANDSTILL_SECS = 300.0
# A step of a Traffic Manager takes milliseconds.
MANAGER_SECS = 10.0


def connect(port, host="127.0.0.1", timeout_secs=60.0):
    """A client that asked for nothing yet."""
    client = carla.Client(host, int(port))
    client.set_timeout(timeout_secs)
    return client


def step_by_hand(world, step_secs=STEP_SECS, **others):
    """From now on the world steps only when it is told to. Returns the settings of before."""
    before, settings = world.get_settings(), world.get_settings()
    settings.synchronous_mode, settings.fixed_delta_seconds = True, step_secs
    for name, value in others.items():
        setattr(settings, name, value)
    world.apply_settings(settings)
    return before


def stage(port, **options):
    """A client and its world, which steps by hand and has stepped once."""
    client = connect(port, **options)
    world = client.get_world()
    step_by_hand(world)
    world.tick()
    return client, world


def ticks(world, n):
    for _ in range(n):
        world.tick()


def passed(theme):
    """The tests look for this line."""
    print(theme, "passed", flush=True)
    WATCH.moved()


def run_checks(checks, *given):
    """Runs functions by name; a name is a theme."""
    for name, check in checks.items():
        began = time.monotonic()
        check(*given)
        print(f"{name} passed in {time.monotonic() - began:.1f} s", flush=True)
        WATCH.moved()


def near(a, b, tolerance=1e-3):
    return abs(a - b) <= tolerance


def must_be(value, wanted, share, what):
    """Asserts a value up to a share of it."""
    assert abs(value - wanted) <= share * abs(wanted), f"{what} is {value:.3f}, but {wanted:.3f} within {share:.0%} is expected"


def turn_deg(a, b):
    """The smallest turn between two angles."""
    return abs((a - b + 180.0) % 360.0 - 180.0)


def speed(actor):
    return actor.get_velocity().length()


def refused(call, *words):
    """Asserts that a call fails with a sentence that has all the words."""
    try:
        call()
    except RuntimeError as error:
        assert all(word in str(error) for word in words), error
        return
    raise AssertionError(f"nothing was refused with {words}")


def listen(world, blueprint, place, **spawning):
    """A sensor and the queue that it fills."""
    sensor, messages = world.spawn_actor(blueprint, place, **spawning), queue.Queue()
    sensor.listen(messages.put)
    return sensor, messages


def of_tick(messages, tick):
    """The first message of a tick or after it."""
    while (message := messages.get(timeout=PATIENCE_SECS)).frame < tick:
        pass
    return message


class Wire:
    """A connection of its own for calls that no method of the wheel makes: MessagePack-RPC, as the wheel speaks it."""

    def __init__(self, port, host="127.0.0.1"):
        self.socket = socket.create_connection((host, int(port)), PATIENCE_SECS)
        self.stream, self.n_calls = self.socket.makefile("rb"), 0

    def call(self, method, *arguments):
        """The answer's value; a refusal is an error with its sentence."""
        self.n_calls += 1
        self.socket.sendall(packed([0, self.n_calls, method, [[False], *arguments]]))
        kind, number, error, result = unpacked(self.stream)
        assert (kind, number) == (1, self.n_calls), (kind, number)
        if error is not None:
            raise RuntimeError(error)
        # An optional error, a variant of error and value, or a list of such for a batch.
        match result:
            case [[False]]:
                return None
            case [[True, [sentence]]] | [[0, [sentence]]]:
                raise RuntimeError(sentence)
            case [[1, value]]:
                return value
        return result

    def batch(self, *commands):
        """Runs commands, each its number and its fields, as `apply_batch_sync` does."""
        for answer in self.call("apply_batch", [[list(command)] for command in commands], False):
            assert answer[0][0] == 1, answer

    def close(self):
        self.stream.close()
        self.socket.close()


def packed(value):
    """MessagePack of numbers, texts and lists; numbers with a point as doubles."""
    if value is None or isinstance(value, bool):
        return {None: b"\xc0", False: b"\xc2", True: b"\xc3"}[value]
    if isinstance(value, int):
        return struct.pack(">Bq", 0xD3, value)
    if isinstance(value, float):
        return struct.pack(">Bd", 0xCB, value)
    if isinstance(value, str):
        return struct.pack(">BI", 0xDB, len(value.encode())) + value.encode()
    return struct.pack(">BI", 0xDD, len(value)) + b"".join(map(packed, value))


def unpacked(stream):
    """The next value of a stream of MessagePack."""
    def number(code):
        return struct.unpack(">" + code, stream.read(struct.calcsize(">" + code)))[0]

    head = stream.read(1)[0]
    if head < 0x80 or head >= 0xE0:
        return head if head < 0x80 else head - 0x100
    if head in (0xC0, 0xC2, 0xC3):
        return {0xC0: None, 0xC2: False, 0xC3: True}[head]
    numbers = {0xCA: "f", 0xCB: "d", 0xCC: "B", 0xCD: "H", 0xCE: "I", 0xCF: "Q", 0xD0: "b", 0xD1: "h", 0xD2: "i", 0xD3: "q"}
    if head in numbers:
        return number(numbers[head])
    if 0xA0 <= head < 0xC0 or head in (0xD9, 0xDA, 0xDB):
        return stream.read(head - 0xA0 if head < 0xC0 else number({0xD9: "B", 0xDA: "H", 0xDB: "I"}[head])).decode()
    if head in (0xC4, 0xC5, 0xC6):
        return stream.read(number({0xC4: "B", 0xC5: "H", 0xC6: "I"}[head]))
    assert 0x90 <= head < 0xA0 or head in (0xDC, 0xDD), hex(head)
    return [unpacked(stream) for _ in range(head - 0x90 if head < 0xA0 else number({0xDC: "H", 0xDD: "I"}[head]))]


def unevenness(world, point):
    """How far the next 140 m are from straight and level: degrees of turn and of slope."""
    here = world.get_map().get_waypoint(point.location)
    worst = 0.0
    for metres in (30.0, 60.0, 100.0, 140.0):
        places = here.next(metres)
        if not places:
            return 360.0
        for place in places:
            rise = place.transform.location.z - here.transform.location.z
            slope_deg = math.degrees(math.atan2(abs(rise), metres))
            worst = max(worst, turn_deg(place.transform.rotation.yaw, here.transform.rotation.yaw), slope_deg)
    return worst


class Watch(threading.Thread):
    """Ends a script that stands still, and wakes a Traffic Manager of the wheel that does.

    The wheel's Traffic Manager can stand still in synchronous mode: `world.tick` and its worker thread set a flag and notify a condition
    variable without holding the mutex, so a notification that falls between the other thread's look at the flag and its wait is lost, and
    both wait for ever (carla-simulator/carla#9172, mended after 0.9.16). On a busy machine that happens about once in a hundred thousand
    ticks. Switching its mode off and on notifies the worker again; it does its step, and the tick returns. That goes through the Traffic
    Manager's own port, because a tick holds the lock that every method of `carla.TrafficManager` takes.
    """

    def __init__(self):
        super().__init__(daemon=True)
        self.moved_at = time.monotonic()
        # World, snapshot's frame at the begin, and time, while a tick lasts.
        self.ticking = None
        self.managers = []
        self.n_woken = 0

    def moved(self):
        """Something that the script waited for has happened."""
        self.moved_at = time.monotonic()

    def run(self):
        while True:
            time.sleep(0.5)
            self.wake_managers()
            if time.monotonic() - self.moved_at > STANDSTILL_SECS:
                print(f"the script stands still for {STANDSTILL_SECS:.0f} s", flush=True)
                faulthandler.dump_traceback(all_threads=True)
                os._exit(1)

    def wake_managers(self):
        """Only once the tick's snapshot is there: from then on a tick waits for the Traffic Manager alone."""
        ticking = self.ticking
        if ticking is None or not self.managers:
            return
        world, before, began = ticking
        if time.monotonic() - began < MANAGER_SECS or world.get_snapshot().frame == before or self.ticking is not ticking:
            return
        self.n_woken += 1
        print(f"tick after {before}: the wheel's Traffic Manager stood still and is woken", flush=True)
        for port in self.managers:
            notify_manager(port)
        self.ticking = world, before, time.monotonic()


WATCH = Watch()


def notify_manager(port):
    """Switches a Traffic Manager's synchronous mode off and on as another process would: MessagePack-RPC requests to its port."""
    with socket.create_connection(("127.0.0.1", port), PATIENCE_SECS) as connection:
        for number, mode in ((1, False), (2, True)):
            connection.sendall(packed([0, number, "set_synchronous_mode", [mode]]))
            assert connection.recv(64), "the Traffic Manager answers"


def watched(method):
    """`World.tick` or `World.wait_for_tick`, whose end is a movement."""

    def call(world, *given):
        WATCH.ticking = world, world.get_snapshot().frame, time.monotonic()
        try:
            return method(world, *given)
        finally:
            WATCH.ticking = None
            WATCH.moved()

    return call


def synchronous_manager(client, port):
    """The client's own Traffic Manager in synchronous mode, which is woken should it stand still."""
    manager = client.get_trafficmanager(port)
    manager.set_synchronous_mode(True)
    WATCH.managers.append(port)
    return manager


def shut_down(manager):
    """Ends a Traffic Manager of [`synchronous_manager`]."""
    WATCH.managers.remove(manager.get_port())
    # A worker that waits for the next tick can miss the notification that ends it, too; a free-running one looks by itself.
    manager.set_synchronous_mode(False)
    manager.shut_down()


def run(main):
    """Runs a script to its end, which is the process's; says where it stands should it ever stand still."""
    faulthandler.enable()
    carla.World.tick, carla.World.wait_for_tick = watched(carla.World.tick), watched(carla.World.wait_for_tick)
    WATCH.moved()
    WATCH.start()
    main()
    sys.stdout.flush()
    # The wheel tears its own threads down while the interpreter ends, and that can go wrong whatever the server did.
    os._exit(0)
