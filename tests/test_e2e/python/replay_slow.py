"""A slow lockstep participant of a replay: prints a checksum of every frame that it gets.

Usage: replay_slow.py DOMAIN LAST_TICK TOPIC...
"""

import sys
import time
import zlib

import gantry

domain, last_tick, names = sys.argv[1], int(sys.argv[2]), sys.argv[3:]


def wait_for_replay():
    """Waits until a replay publishes the domain's world: then all its topics exist."""
    deadline = time.monotonic() + 60
    while True:
        try:
            return gantry.document("world/info", domain, 10).json()
        except gantry.NoSuchTopicError:
            assert time.monotonic() < deadline, "the replay did not appear"
            time.sleep(0.02)


assert wait_for_replay()["source"] == "replay"
topics = [gantry.open(name, domain=domain) for name in names]
with gantry.lockstep("slow", domain=domain) as lockstep:
    for tick in lockstep:
        time.sleep(0.01)
        lockstep.wait_frames()
        for topic in topics:
            while (frame := topic.poll()) is not None:
                assert frame.header.flags & 2, "a replayed frame says so"
                assert frame.tick == tick, (topic, frame.tick, tick)
                crc = zlib.crc32(frame.array.tobytes())
                print(f"frame {frame.topic} {frame.header.seq} {crc:08x}", flush=True)
        if tick == last_tick:
            break
assert all(topic.counts.lost == 0 for topic in topics)
print("done", flush=True)
