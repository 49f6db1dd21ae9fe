"""Optical flow of the front camera with OpenCV: DIS (presets ultrafast, fast, medium) or Farnebäck.

Settings: `method`, one of `dis-ultrafast`, `dis-fast`, `dis-medium`, `farneback`.
"""

import cv2
import gantry
import gantry.bench
import numpy as np

DIS_PRESETS = {
    "dis-ultrafast": cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
    "dis-fast": cv2.DISOPTICAL_FLOW_PRESET_FAST,
    "dis-medium": cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
}


def method(name):
    """A function from two grey images (h, w) to the flow (h, w, 2) from the first to the second, pixels."""
    if name in DIS_PRESETS:
        dis = cv2.DISOpticalFlow_create(DIS_PRESETS[name])
        return lambda a, b: dis.calc(a, b, None)
    if name == "farneback":
        return lambda a, b: cv2.calcOpticalFlowFarneback(a, b, None, 0.5, 5, 21, 5, 7, 1.5, 0)
    raise SystemExit(f"params.method is {name!r}; it must be one of {', '.join(DIS_PRESETS)}, farneback")


class Flow(gantry.bench.Program):
    inputs = {"image": "ego/front/rgb"}
    outputs = ("flow/front", "flow")

    def __init__(self):
        self.between = method(gantry.bench.params().get("method", "dis-medium"))
        self.before = None

    def warm_up(self):
        noise = np.random.default_rng(1).integers(0, 255, (240, 320), np.uint8)
        self.between(noise, np.roll(noise, 3, axis=1))

    def work(self, image):
        grey = cv2.cvtColor(image.array, cv2.COLOR_BGRA2GRAY)
        before, self.before = self.before, (grey, image.seq, image.epoch)
        if before is None or before[2] != image.epoch or image.seq <= before[1]:
            return np.full((*grey.shape, 2), np.nan, np.float32)
        # Gantry's flow is "now minus then" at the pixel where a point is now. If frames were
        # skipped, the motion since the last one that was seen is shared out among them.
        return -self.between(grey, before[0]) / (image.seq - before[1])


if __name__ == "__main__":
    gantry.bench.run(Flow())
