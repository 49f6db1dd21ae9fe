"""Classes of pixels by colour, height in the image and roughness: a table of what was most frequent.

    python semantic_table.py train drive.mcap…      # writes semantic_table.npz from recordings of ours

Recordings need `rgb` and `semantic` of `ego/front`: the labels are those that the simulator draws.
Settings: `shrink` (2): the image is looked at in this fraction of its size.
"""

import pathlib
import sys

import cv2
import gantry
import gantry.bench
import numpy as np

TABLE = pathlib.Path(__file__).with_suffix(".npz")
#: Steps of the table: rows of the image, lightness, the two colours, roughness.
SHAPE = (16, 12, 12, 12, 4)


def places(bgr):
    """The place of every pixel of an image (h, w, 3) in the table: (h, w) integers."""
    lab = cv2.cvtColor(cv2.GaussianBlur(bgr, (3, 3), 0), cv2.COLOR_BGR2LAB)
    rough = cv2.morphologyEx(lab[..., 0], cv2.MORPH_GRADIENT, np.ones((5, 5), np.uint8))
    row = np.arange(len(bgr))[:, None] * SHAPE[0] // len(bgr)
    lightness = lab[..., 0].astype(np.int32) * SHAPE[1] // 256
    colours = np.clip((lab[..., 1:].astype(np.int32) - 128 + 48) * SHAPE[2] // 96, 0, SHAPE[2] - 1)
    steps = np.searchsorted([6, 20, 60], rough)
    return np.ravel_multi_index((np.broadcast_to(row, rough.shape), lightness, colours[..., 0], colours[..., 1], steps), SHAPE)


def train(recordings):
    """The most frequent class of each place, and where no pixel fell, of the nearest rows and colours."""
    counts = np.zeros((len(gantry.CLASS_NAMES), *SHAPE), np.float32)
    for path in recordings:
        for row in gantry.Recording(path).sync(["ego/front/rgb", "ego/front/semantic"]):
            bgr = np.ascontiguousarray(row["ego/front/rgb"].array[..., :3])
            labels = row["ego/front/semantic"].array.astype(np.int64)
            at = labels * np.prod(SHAPE) + places(bgr)
            counts += np.bincount(at.ravel(), minlength=counts.size).reshape(counts.shape)
    # Rare classes would never win; the square root of how frequent a class is evens them out.
    counts /= np.sqrt(np.maximum(counts.sum(axis=(1, 2, 3, 4, 5), keepdims=True), 1.0))
    for axis in (5, 1, 3, 4, 2):
        wider = counts + 1e-3 * (np.roll(counts, 1, axis) + np.roll(counts, -1, axis))
        counts = np.where(counts.sum(axis=0) > 0, counts, wider)
    np.savez_compressed(TABLE, table=counts.argmax(axis=0).astype(np.uint8))


class Semantic(gantry.bench.Program):
    inputs = {"image": "ego/front/rgb"}
    outputs = ("table/semantic", "semantic")

    def __init__(self):
        self.shrink = int(gantry.bench.params().get("shrink", 2))
        self.table = np.load(TABLE)["table"].ravel()

    def work(self, image):
        height, width = image.array.shape[:2]
        bgr = cv2.resize(image.array[..., :3], (width // self.shrink, height // self.shrink), interpolation=cv2.INTER_AREA)
        classes = cv2.medianBlur(self.table[places(bgr)], 5)
        return cv2.resize(classes, (width, height), interpolation=cv2.INTER_NEAREST)


if __name__ == "__main__":
    if sys.argv[1:2] == ["train"]:
        train(sys.argv[2:])
    else:
        gantry.bench.run(Semantic())
