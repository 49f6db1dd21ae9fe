"""Odometry from lidar scans: each scan is laid onto a map of the last ones, point to line. Needs numpy and scipy.

Publishes `scan/odometry` and says at the end how far it drifted from the truth, which the program itself does not use.
"""

import json
import math
import sys

import gantry
import numpy as np
from scipy.spatial import cKDTree

LIDAR_HEIGHT_M = 2.0


def walls(cloud):
    """Points (n, 2) of what stands 0.5 to 5 m over the road, thinned to one per 0.3 m."""
    points = cloud.array["hit_in_sensor_m"].astype(float)
    height = points[:, 2] + LIDAR_HEIGHT_M
    points = points[(height > 0.5) & (height < 5.0)][:, :2]
    points = points[np.hypot(*points.T) > 3.0]
    _, first = np.unique(np.floor(points / 0.3).astype(int), axis=0, return_index=True)
    return points[first]


def moved(points, x, y, yaw):
    c, s = math.cos(yaw), math.sin(yaw)
    return points @ np.array([[c, s], [-s, c]]) + [x, y]


def aligned(scan, known, pose):
    """The pose (x, y, yaw) at which a scan fits known points best, from a first guess."""
    tree = cKDTree(known)
    pose = np.array(pose, float)
    for n in range(20):
        here = moved(scan, *pose)
        # The line through the nearest three known points stands for the wall there.
        distance, nearest = tree.query(here, k=3)
        close = distance[:, 2] < (2.0 if n < 5 else 0.8)
        if close.sum() < 20:
            break
        here, three = here[close], known[nearest[close]]
        middle = three.mean(axis=1)
        spread = three - middle[:, None]
        angle = 0.5 * np.arctan2(2 * (spread[..., 0] * spread[..., 1]).sum(1), (spread[..., 0] ** 2 - spread[..., 1] ** 2).sum(1))
        normal = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
        aside = ((here - middle) * normal).sum(1)
        arm = here - pose[:2]
        jacobian = np.column_stack([normal, normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1]])
        weight = 0.1 / (0.1 + np.abs(aside))
        step = np.linalg.lstsq(jacobian * weight[:, None], -aside * weight, rcond=None)[0]
        pose += step
        if np.abs(step).max() < 1e-4:
            break
    return pose


def main():
    settings = json.loads(sys.argv[-1])
    with (
        gantry.lockstep("odometry", timeout=60, topics=["ego/roof/lidar"]) as rows,
        gantry.publish("scan/odometry", "odometry") as out,
    ):
        car = gantry.ego()
        poses: list[np.ndarray] = []
        scans: list[np.ndarray] = []
        truth: list[gantry.Pose] = []
        for row in rows:
            cloud = row["ego/roof/lidar"]
            scan = walls(cloud)
            # As fast on as in the last step, then as the scans fit.
            guess = poses[-1] + (poses[-1] - poses[-2]) if len(poses) > 1 else np.zeros(3)
            pose = aligned(scan, np.concatenate(scans), guess) if scans else guess
            poses.append(pose)
            scans = [*scans[-9:], moved(scan, *pose)]
            out.send(gantry.odometry([pose[0], pose[1], 0.0], yaw_rad=pose[2], velocity_mps=[math.nan] * 3), answers=cloud)
            truth.append(row.snapshot.pose(car))
            if len(poses) >= settings["ticks"]:
                break
    driven = truth[0].inverse().apply([pose.translation_m for pose in truth])[:, :2]
    length_m = float(np.linalg.norm(np.diff(driven, axis=0), axis=1).sum())
    drift_m = float(np.linalg.norm(np.array(poses)[-1, :2] - driven[-1]))
    good = drift_m < 0.5 + 0.03 * length_m
    print(f"{length_m:.1f} m driven, drift {drift_m:.2f} m: {'good' if good else 'bad'}", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
