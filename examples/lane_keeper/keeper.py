"""Keeps its lane by the painted lines that the front camera sees; in lockstep, so every run is the same drive."""

import json
import math
import sys

import gantry
import numpy as np

CAMERA = "ego/front/semantic"
LINES = gantry.CLASS_NAMES.index("RoadLines")
#: The camera's height over the road and its place ahead of the rear axle, the car's wheelbase, a lane's width.
CAMERA_HEIGHT_M, CAMERA_AHEAD_M, WHEELBASE_M, LANE_M = 1.6, 2.9, 2.9, 3.5
#: Where the lane is looked for, metres ahead of the camera, and at which of these places the car aims.
DISTANCES_M, AIM = [5.0, 6.5, 8.0, 10.0], 3
#: Angle of the wheels at full lock, radians.
FULL_LOCK_RAD = 1.0


def lane_middle(classes, intrinsics_px, distance_m, expected_m):
    """How far left of the car its lane's middle is, metres, at a distance ahead; `expected_m` if no line is seen.

    A row of the image shows the road at one distance, because the road is flat and the camera's height is known.
    """
    fx, fy, cx, cy = intrinsics_px
    row = int(cy + fy * CAMERA_HEIGHT_M / distance_m)
    painted = np.flatnonzero((classes[row - 1 : row + 2] == LINES).any(axis=0))
    left_m = -(painted + 0.5 - cx) * distance_m / fx - expected_m
    sides = []
    for side in (left_m[left_m > 0.0], left_m[left_m < 0.0]):
        near = side[np.abs(np.abs(side) - LANE_M / 2) < 0.9]
        if len(near):
            line = near[np.abs(near).argmin()]
            sides.append(line - math.copysign(LANE_M / 2, line))
    return expected_m + float(np.mean(sides)) if sides else expected_m


def lane_ahead(classes, intrinsics_px, before_m):
    """The middle of the lane at each of `DISTANCES_M`; each place is looked for near where the nearer one leads."""
    seen: list[float] = []
    for i, distance_m in enumerate(DISTANCES_M):
        expected_m = before_m[0] if i == 0 else seen[-1] + before_m[i] - before_m[i - 1]
        found_m = lane_middle(classes, intrinsics_px, distance_m, expected_m)
        seen.append(float(np.clip(found_m, expected_m - 0.3, expected_m + 0.3)))
    return seen


def main():
    """Drives `ticks` ticks; ends with code 1 if a painted line was crossed."""
    settings = json.loads(sys.argv[-1])
    with (
        gantry.lockstep("keeper", timeout=60, topics=[CAMERA, "ego/lines/lane_invasion"]) as rows,
        gantry.publish("keeper/lane", "path") as lane,
    ):
        car = gantry.ego()
        start, crossings = None, 0
        seen: list[float] = [0.0] * len(DISTANCES_M)
        for n, row in enumerate(rows):
            at = np.array(row.snapshot.pose(car).translation_m)
            start = at if start is None else start
            frame = row[CAMERA]
            seen = lane_ahead(frame.array, frame.header.intrinsics_px, seen)
            lane.send(gantry.path([(d, middle, -CAMERA_HEIGHT_M) for d, middle in zip(DISTANCES_M, seen)]), answers=frame)
            # Pure pursuit: the arc through the middle of the lane ahead.
            ahead_m, left_m = DISTANCES_M[AIM] + CAMERA_AHEAD_M, seen[AIM]
            curvature = 2.0 * left_m / (ahead_m**2 + left_m**2)
            pedal = float(np.clip(0.4 * (settings["speed_mps"] - row.snapshot.speed_mps(car)), -1.0, 0.8))
            steer = float(np.clip(math.atan(WHEELBASE_M * curvature) / FULL_LOCK_RAD, -1.0, 1.0))
            car.control(throttle=max(pedal, 0.0), brake=max(-pedal, 0.0), steer=steer)
            crossings += "ego/lines/lane_invasion" in row
            if n >= settings["ticks"]:
                break
    print(f"{np.linalg.norm(at - start):.0f} m driven, {crossings} lines crossed", flush=True)
    return 1 if crossings else 0


if __name__ == "__main__":
    sys.exit(main())
