"""Rules the time of a paused replay from Python: step, speed, jumps, and what is refused.

Usage: replay_play.py DOMAIN LAST_TICK
"""

import sys
import time

import gantry

domain, last_tick = sys.argv[1], int(sys.argv[2])


def refused(call, words):
    """Asserts that a call fails with these words."""
    try:
        call()
    except gantry.GantryError as error:
        assert words in str(error), error
    else:
        raise AssertionError(f"{words!r} was not refused")


def wait_for_replay():
    """Waits until a replay publishes the domain's world: then all its topics exist."""
    deadline = time.monotonic() + 60
    while True:
        try:
            return gantry.document("world/info", domain, 10).json()
        except gantry.NoSuchTopicError:
            assert time.monotonic() < deadline, "the replay did not appear"
            time.sleep(0.02)


info = wait_for_replay()
assert (info["source"], info["mode"], info["map"]) == ("replay", "stepped", "Town10HD"), info
first = gantry.snapshot(domain, timeout=20)
with gantry.open("ego/front/rgb", domain=domain) as camera:
    # A reader that comes while the replay stands still gets the very next frame.
    assert gantry.step(2, domain=domain) == first.tick + 2 == 2
    frame = camera.next(timeout=10)
    assert (frame.tick, frame.epoch) == (1, first.epoch)
    while camera.poll() is not None:
        pass

    gantry.seek(1.0, domain=domain)
    jumped = gantry.snapshot(domain, timeout=10)
    assert jumped.epoch != first.epoch and abs(jumped.sim_time - 1.0) < 1e-9, jumped.header
    tick = gantry.step(domain=domain)
    frame = camera.next(timeout=10)
    assert (frame.tick, frame.epoch) == (tick, jumped.epoch) == (20, jumped.epoch), frame
    assert frame.header.sim_nanos == 1_000_000_000
    assert camera.counts.lost == 0 and camera.counts.restarts >= 1, camera.counts

    refused(lambda: gantry.seek(1e6, domain=domain), "the recording ends at")
    refused(lambda: gantry.set_speed(0, domain=domain), "ratio is 0, but must be 0.01 to 100")
    refused(lambda: gantry.command({"do": "destroy", "actor_id": 1}, domain=domain), "this is a recording, which destroy does not change")
    refused(lambda: gantry.command({"do": "configure", "period_nanos": 1000000}, domain=domain), "whose ticks keep their lengths")

    # To the end, which is held, and back from there while it is paused.
    gantry.set_speed(100, domain=domain)
    gantry.resume(domain=domain)
    deadline = time.monotonic() + 60
    while gantry.snapshot(domain, timeout=10).tick < last_tick:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    gantry.pause(domain=domain)
    assert gantry.document("world/info", domain, 10).json()["mode"] == "stepped"
    time.sleep(0.3)
    gantry.seek(0.5, domain=domain)
    tick = gantry.step(domain=domain)
    assert tick == 10, tick
    while (frame := camera.next(timeout=10)).tick != 10 or frame.epoch == jumped.epoch:
        pass
print("passed", flush=True)
