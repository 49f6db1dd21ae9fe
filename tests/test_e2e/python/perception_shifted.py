"""Answers with the exact boxes of all vehicles, moved to the right by a share of their own widths: its argument.

A box that is moved by the share d overlaps itself by (1 - d) / (1 + d), whatever its size.
"""

import sys

import gantry
import gantry.bench
from gantry.torch._samples import objects_of

SHARE = float(sys.argv[1])
#: COCO's numbers of what has wheels.
VEHICLES = (2, 3, 4, 6, 7, 8)


INPUTS = {"instance": "ego/front/instance", "semantic": "ego/front/semantic"}


@gantry.bench.program(inputs=INPUTS, output=gantry.bench.Output("shifted/boxes", "boxes2d", classes=["vehicle"]))
def answer(instance, semantic):
    found = objects_of(instance, semantic, 1)
    boxes = found.boxes[[number in VEHICLES for number in found.categories]]
    boxes[:, [0, 2]] += SHARE * (boxes[:, 2:3] - boxes[:, 0:1])
    return gantry.boxes2d(xyxy=boxes)


gantry.bench.run(answer)
