"""Depth from one image by geometry alone: what has the colour of the road in front is flat ground at
the depth of its row, and what stands on it is as far away as the place where it touches the ground.

Settings: `height_m` (1.6), the camera's height above the road.
"""

import cv2
import gantry
import gantry.bench
import numpy as np

#: Depth of the sky and of all that touches the ground beyond it, metres.
FARTHEST_M = 80.0
#: Columns are looked at in groups of this size, pixels.
COLUMNS_PX = 4


class Depth(gantry.bench.Program):
    inputs = {"image": "ego/front/rgb"}
    outputs = ("ground/depth", "depth")

    def __init__(self):
        self.height_m = float(gantry.bench.params().get("height_m", 1.6))

    def work(self, image):
        bgr = image.array[..., :3]
        height, width = bgr.shape[:2]
        _, fy, _, cy = image.header.intrinsics_px
        below = np.arange(height) + 0.5 - cy
        ground_m = np.where(below > 0, np.minimum(fy * self.height_m / np.maximum(below, 1e-3), FARTHEST_M), FARTHEST_M)
        horizon = int(np.ceil(cy))
        free = self.is_ground(bgr)
        # From the bottom of the image upwards, the first row of a column that is no ground.
        lower = cv2.resize(free[horizon:].astype(np.float32), (width // COLUMNS_PX, height - horizon), interpolation=cv2.INTER_AREA) > 0.5
        blocked = np.cumprod(lower[::-1], axis=0).sum(axis=0)
        contact = np.clip(height - blocked, horizon + 1, height - 1)
        contact = np.repeat(cv2.medianBlur(contact.astype(np.float32).reshape(1, -1), 5).reshape(-1), COLUMNS_PX)[:width]
        contact = np.pad(contact, (0, width - len(contact)), mode="edge").astype(int)
        rows = np.arange(height)[:, None]
        depth = np.where(rows >= contact[None], ground_m[:, None], ground_m[contact][None])
        depth[self.is_sky(bgr)] = np.nan
        return depth.astype(np.float32)

    def is_ground(self, bgr):
        """Pixels that are as grey as the road straight ahead, and not much brighter or darker."""
        height, width = bgr.shape[:2]
        lab = cv2.cvtColor(cv2.GaussianBlur(bgr, (5, 5), 0), cv2.COLOR_BGR2LAB).astype(np.float32)
        road = lab[int(0.72 * height) : int(0.88 * height), int(0.4 * width) : int(0.6 * width)].reshape(-1, 3)
        middle = np.median(road, axis=0)
        # The median deviation hears neither marks nor shadows.
        spread = np.clip(1.5 * np.median(np.abs(road - middle), axis=0), [6.0, 1.5, 1.5], [12.0, 3.0, 3.0])
        near = (np.abs(lab - middle) < 3.0 * spread).all(axis=2)
        near[int(0.9 * height) :] = True  # the car's own bonnet
        return cv2.morphologyEx(near.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8)) > 0

    def is_sky(self, bgr):
        """Bright bluish or white pixels of the upper half."""
        sky = (bgr[..., 0] >= bgr[..., 2]) & (bgr[..., 0] > 120)
        sky[bgr.shape[0] // 2 :] = False
        return cv2.erode(sky.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0


if __name__ == "__main__":
    gantry.bench.run(Depth())
