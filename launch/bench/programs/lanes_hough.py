"""Painted lines of the road, the classical way: bird's-eye view, bright narrow marks, Hough lines.

Settings: `height_m` (1.6), the camera's height above a road that is taken to be flat.
"""

import cv2
import gantry
import gantry.bench
import numpy as np

#: The part of the road that is looked at: metres ahead of the camera, and to either side.
NEAR_M, FAR_M, SIDE_M = 2.7, 40.0, 8.0
#: Pixels per metre of the bird's-eye view, along and across.
ALONG, ACROSS = 10, 20
#: Lines closer than this belong together, those that lead further aside are no lanes, lanes are as
#: parallel as this, and gaps between dashes are shorter.
APART_M, SLOPE, PARALLEL, GAP_M = 0.35, 0.3, 0.05, 9.0
#: How much brighter than the road beside them marks are, and than the road as a whole.
MARK_STEP, MARK_RATIO = 20, 1.35


class Lanes(gantry.bench.Program):
    inputs = {"image": "ego/front/rgb"}
    outputs = [gantry.bench.Output("lanes/lines", "keypoints", bones=[(0, 1)])]

    def __init__(self):
        self.height_m = float(gantry.bench.params().get("height_m", 1.6))

    def work(self, image):
        fx, fy, cx, cy = image.header.intrinsics_px

        def pixels(road_m):
            """Pixels of points (n, 2) `[ahead, left]` of the road, metres."""
            ahead, left = np.asarray(road_m, np.float64).T
            return np.stack([cx - fx * left / ahead, cy + fy * self.height_m / ahead], axis=1)

        corners_m = np.array([[FAR_M, SIDE_M], [FAR_M, -SIDE_M], [NEAR_M, -SIDE_M], [NEAR_M, SIDE_M]])
        size = (int(2 * SIDE_M * ACROSS), int((FAR_M - NEAR_M) * ALONG))
        above = np.float32([[0, 0], [size[0], 0], size, [0, size[1]]])
        # OpenCV counts pixels from their centres, Gantry from their corners.
        from_above = cv2.getPerspectiveTransform(np.float32(pixels(corners_m) - 0.5), above - 0.5)
        road = cv2.warpPerspective(image.array[..., :3].max(axis=2), from_above, size, flags=cv2.INTER_LINEAR)
        step = cv2.morphologyEx(road, cv2.MORPH_TOPHAT, np.ones((1, int(0.6 * ACROSS)), np.uint8))
        asphalt = np.median(road[:, size[0] // 3 : 2 * size[0] // 3])
        marks = ((step > MARK_STEP) & (road > MARK_RATIO * asphalt)).astype(np.uint8)
        found = cv2.HoughLinesP(marks, 1, np.pi / 360, 25, minLineLength=15, maxLineGap=10)
        if found is None:
            return []
        u, v = found.reshape(-1, 2, 2).astype(float).transpose(2, 0, 1)
        ahead, left = FAR_M - v / ALONG, SIDE_M - u / ACROSS
        marks = cv2.dilate(marks, np.ones((1, int(APART_M * ACROSS)), np.uint8))
        return gantry.keypoints([pixels(line) for line in joined(ahead, left, marks)])


def joined(ahead, left, marks):
    """Joins segments (n, 2) to lines `[[ahead, left], [ahead, left]]`, the longest first."""
    length = np.abs(ahead[:, 1] - ahead[:, 0])
    slope = (left[:, 1] - left[:, 0]) / np.where(length > 0, ahead[:, 1] - ahead[:, 0], 1e-9)
    rest = [i for i in np.argsort(-length) if length[i] > 0 and abs(slope[i]) < SLOPE]
    lines, direction = [], None
    while rest:
        first = rest[0]

        def aside(i):
            on_line = left[first, 0] + slope[first] * (ahead[i] - ahead[first, 0])
            return np.abs(left[i] - on_line).max()

        group = [i for i in rest if aside(i) < APART_M]
        a, b = np.polyfit(ahead[group].ravel(), left[group].ravel(), 1, w=np.repeat(length[group], 2))
        ends = np.array(reach(a, b, ahead[group].min(), ahead[group].max(), marks))
        # What lies on a line that is longer than it seemed belongs to it, too.
        rest = [i for i in rest if i not in group and np.abs(left[i] - a * ahead[i] - b).max() >= 2 * APART_M]
        direction = a if direction is None else direction
        if ends[1] - ends[0] > 2.0 and abs(a - direction) < PARALLEL:
            lines.append(np.stack([ends, a * ends + b], axis=1))
    return lines


def reach(a, b, near, far, marks):
    """The stretch along which a line has marks, over gaps between dashes, metres ahead."""
    ahead = FAR_M - (np.arange(len(marks)) + 0.5) / ALONG
    column = ((SIDE_M - a * ahead - b) * ACROSS).astype(int)
    inside = (column >= 0) & (column < marks.shape[1])
    marked = ahead[inside & (marks[np.arange(len(marks)), np.where(inside, column, 0)] > 0)]
    for place in marked[::-1]:  # from near to far
        if far < place < far + GAP_M:
            far = place
    for place in marked:
        if near - GAP_M < place < near:
            near = place
    return near, far


if __name__ == "__main__":
    gantry.bench.run(Lanes())
