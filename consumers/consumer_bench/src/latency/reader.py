"""One reader of `gantry-bench latency --python`, started by it: what latency/reader.rs does, with the Python package."""

import argparse
import json
import time

import gantry

WARM_UP = 30

parser = argparse.ArgumentParser()
for name in ("--way", "--domain", "--topic"):
    parser.add_argument(name, required=True)
for name in ("--size", "--last"):
    parser.add_argument(name, type=int, required=True)
args = parser.parse_args()
busy_wait = 1.0 if args.way == "shm-polled" else 0.0

nanos, seq = [], 0
with gantry.open(args.topic, domain=args.domain) as topic:
    print("ready", flush=True)
    while seq < args.last:
        frame = topic.next(20.0, busy_wait)
        pixels = frame.array
        held = time.monotonic_ns()
        seq = frame.seq
        if pixels.size != args.size:
            raise SystemExit(f"frame {seq} has {pixels.size} bytes instead of {args.size}")
        if [pixels[0, 0], pixels[0, -1]] != [seq % 256, seq % 256]:
            raise SystemExit(f"frame {seq} has the bytes {pixels[0, 0]} and {pixels[0, -1]}: it was overwritten while it was held")
        if seq > WARM_UP:
            nanos.append(held - frame.header.published_mono_nanos)
print(json.dumps({"nanos": nanos, "lost": args.last - WARM_UP - len(nanos)}))
