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
        gantry.open("ego/roof/lidar", timeout=60) as lidar,
        gantry.publish("scan/odometry", "odometry") as out,
        gantry.lockstep("odometry", timeout=60) as lockstep,
    ):
        poses, truth, scans = [], [], []
        for tick in lockstep:
            while (cloud := lidar.next(timeout=60)) is not None and cloud.tick < tick:
                pass
            scan = walls(cloud)
            # As fast on as in the last step, then as the scans fit.
            guess = poses[-1] + (poses[-1] - poses[-2]) if len(poses) > 1 else np.zeros(3)
            pose = aligned(scan, np.concatenate(scans), guess) if scans else guess
            poses.append(pose)
            scans = [*scans[-9:], moved(scan, *pose)]
            out.send(gantry.odometry([pose[0], pose[1], 0.0], yaw_rad=pose[2], velocity_mps=[math.nan] * 3), answers=cloud)
            truth.append(gantry_pose(tick.snapshot.vehicles[0]["world_from_actor"]))
            if len(poses) >= settings["ticks"]:
                break
    x, y, yaw = truth[0]
    from_start = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    driven = (np.array(truth)[:, :2] - [x, y]) @ from_start
    length_m = float(np.linalg.norm(np.diff(driven, axis=0), axis=1).sum())
    drift_m = float(np.linalg.norm(np.array(poses)[-1, :2] - driven[-1]))
    good = drift_m < 0.5 + 0.03 * length_m
    print(f"{length_m:.1f} m driven, drift {drift_m:.2f} m: {'good' if good else 'bad'}", flush=True)
    return 0 if good else 1


def gantry_pose(pose):
    """(x, y, yaw) of a pose."""
    x, y, z, w = (float(value) for value in pose["rotation_xyzw"])
    return [*map(float, pose["translation_m"][:2]), math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))]


if __name__ == "__main__":
    sys.exit(main())
