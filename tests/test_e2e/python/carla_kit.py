"""What the scripts under the stock `carla` 0.9.16 wheel have in common; no script by itself."""

import faulthandler
import math
import os
import queue
import sys
import time

import carla

STEP_SECS = 0.05
PATIENCE_SECS = 20.0


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


def run_checks(checks, *given):
    """Runs functions by name; a name is a theme."""
    for name, check in checks.items():
        began = time.monotonic()
        check(*given)
        print(f"{name} passed in {time.monotonic() - began:.1f} s", flush=True)


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


def run(main, limit_secs):
    """Runs a script to its end, which is the process's; says where it stands should it ever stand still."""
    faulthandler.enable()
    faulthandler.dump_traceback_later(limit_secs, exit=True)
    main()
    sys.stdout.flush()
    # The wheel tears its own threads down while the interpreter ends, and that can go wrong whatever the server did.
    os._exit(0)
