"""Disparity of a stereo pair with OpenCV's semi-global block matching.

Settings: `scale` (1.0), the size at which the images are compared: 2 finds finer differences and
takes eight times as long, 0.25 is quick and coarse. `max_disparity_px` (128), of the whole image;
`paths` (3, also 5 or 8), the directions along which neighbours are asked.
"""

import cv2
import gantry
import gantry.bench
import numpy as np

MODES = {3: cv2.STEREO_SGBM_MODE_SGBM_3WAY, 5: cv2.STEREO_SGBM_MODE_SGBM, 8: cv2.STEREO_SGBM_MODE_HH}


class Stereo(gantry.bench.Program):
    inputs = {"left": "ego/front/rgb", "right": "ego/front_right/rgb"}
    outputs = ("stereo/disparity", "image")

    def __init__(self):
        settings = gantry.bench.params()
        self.scale = float(settings.get("scale", 1.0))
        n_disparities = max(16, round(settings.get("max_disparity_px", 128) * self.scale / 16) * 16)
        block = 5
        self.sgbm = cv2.StereoSGBM_create(
            minDisparity=0, numDisparities=n_disparities, blockSize=block, P1=8 * block**2, P2=32 * block**2, disp12MaxDiff=1,
            uniquenessRatio=10, speckleWindowSize=100, speckleRange=2, mode=MODES[settings.get("paths", 3)],
        )  # fmt: skip

    def warm_up(self):
        noise = np.random.default_rng(1).integers(0, 255, (240, 320), np.uint8)
        self.sgbm.compute(noise, np.roll(noise, -8, axis=1))

    def grey(self, frame):
        grey = cv2.cvtColor(frame.array, cv2.COLOR_BGRA2GRAY)
        way = cv2.INTER_AREA if self.scale < 1 else cv2.INTER_CUBIC
        return cv2.resize(grey, None, fx=self.scale, fy=self.scale, interpolation=way)

    def work(self, left, right):
        sixteenths = self.sgbm.compute(self.grey(left), self.grey(right))
        disparity = sixteenths.astype(np.float32) / 16.0
        disparity[sixteenths <= 0] = np.nan  # no match
        height, width = left.array.shape[:2]
        # Nearest neighbours, because between two surfaces no disparity in the middle is right.
        return cv2.resize(filled(disparity), (width, height), interpolation=cv2.INTER_NEAREST) / self.scale


def filled(disparity):
    """Puts into gaps what lies beside them in the row, of both sides the farther, as KITTI's tools do."""

    def from_left(rows):
        known = np.where(np.isnan(rows), 0, np.arange(rows.shape[1]))
        return np.take_along_axis(rows, np.maximum.accumulate(known, axis=1), axis=1)

    return np.fmin(from_left(disparity), from_left(disparity[:, ::-1])[:, ::-1])


if __name__ == "__main__":
    gantry.bench.run(Stereo())
