"""Programs that the benchmark must measure rightly: each behaves as its first argument says.

every        answers every frame
second       answers every second frame
twice        answers every frame twice
swapped      answers each pair of frames in the wrong order
late         answers each frame when two more have come
never        says nothing
crash SECS   ends with exit code 3 so long after its eighth answer
flood        answers every frame 500 times
invented     answers every frame, and one that never was
slow SECS    answers the newest frame after this time
shy          answers, but never says so: it reads frames and makes no topic
ended        ends with exit code 0 before it reads anything
"""

import sys
import time

import gantry

KIND = sys.argv[1]
BOX = gantry.boxes2d([[10.0, 10.0]], [[30.0, 30.0]], score=[0.5])


def answer(boxes, frame, kept, n):
    """What to do with the `n`th frame."""
    if KIND in ("every", "invented", "crash"):
        boxes.send(BOX, answers=frame)
    elif KIND == "second" and n % 2 == 0:
        boxes.send(BOX, answers=frame)
    elif KIND == "twice":
        boxes.send(BOX, answers=frame)
        boxes.send(BOX, answers=frame)
    elif KIND == "flood":
        for _ in range(500):
            boxes.send(BOX, answers=frame)
    elif KIND == "swapped" and n % 2 == 1:
        boxes.send(BOX, answers=frame)
        boxes.send(BOX, answers=kept[-1])
    elif KIND == "late" and len(kept) == 2:
        boxes.send(BOX, answers=kept.pop(0))
    elif KIND == "slow":
        time.sleep(float(sys.argv[2]))
        boxes.send(BOX, answers=frame)
    if KIND == "invented":
        boxes.send(BOX, tick=1_000_000)
    if KIND == "crash" and n == 7:
        time.sleep(float(sys.argv[2]))  # its last answer is seen, even if this machine is slow
        sys.exit(3)


if KIND == "ended":
    sys.exit(0)
with gantry.open("ego/front/rgb", timeout=120) as camera:
    if KIND == "shy":
        time.sleep(3600)
    with gantry.publish("fake/boxes", "boxes2d", classes=["car"]) as boxes:
        kept, n = [], 0
        while True:
            frame = camera.latest(timeout=None) if KIND == "slow" else camera.next(timeout=None)
            answer(boxes, frame, kept, n)
            if KIND in ("swapped", "late"):
                kept = [*kept, frame][-2:]
            n += 1
