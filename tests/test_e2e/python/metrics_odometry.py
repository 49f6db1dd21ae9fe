"""Compares figures of trajectories with those of evo and, for KITTI's relative error, of KISS-ICP.

KISS-ICP gives the relative error of one drive; the segments of several are counted by a walk along the path.
"""

import copy
import math

import numpy as np
from evo.core import geometry, metrics
from evo.core.trajectory import PosePath3D
from kiss_icp.metrics import sequence_error
from metrics_kit import judge


def laid_on(truth, result, alignment):
    result = copy.deepcopy(result)
    if alignment == "origin":
        result.align_origin(truth)
    elif alignment in ("rigid", "scaled"):
        return result, result.align(truth, correct_scale=alignment == "scaled")[2]
    return result, 1.0


def relative(truth, result, case, relation):
    unit, delta = (metrics.Unit.frames, case["frames"]) if case["metres"] is None else (metrics.Unit.meters, case["metres"])
    error = metrics.RPE(relation, delta, unit, all_pairs=case["all_pairs"], pairs_from_reference=True)
    error.process_data((truth, result))
    return error.error


def n_segments(poses, lengths):
    path = geometry.accumulated_distances(np.array(poses)[:, :3, 3])
    return sum(path[-1] > path[start] + length for start in range(0, len(path), 10) for length in lengths)


def odometry(case):
    errors, shifts, turns, scales, kitti = [], [], [], [], []
    paths = []
    for sequence in case["sequences"]:
        truth = PosePath3D(poses_se3=[np.array(pose) for pose in sequence["truth"]])
        result, scale = laid_on(truth, PosePath3D(poses_se3=[np.array(pose) for pose in sequence["result"]]), case["alignment"])
        error = metrics.APE()
        error.process_data((truth, result))
        errors.append(error.error)
        shifts.append(relative(truth, result, case, metrics.PoseRelation.translation_part))
        turns.append(relative(truth, result, case, metrics.PoseRelation.rotation_angle_deg))
        scales.append(scale)
        paths.append((truth, result))
    is_short = all(truth.path_length <= 100 for truth, _ in paths)
    factor = 10.0 if is_short else 1.0
    for truth, result in paths:
        # Lengths of a tenth are KITTI's in a world ten times as large.
        larger = [np.array(path.poses_se3) for path in (truth, result)]
        for poses in larger:
            poses[:, :3, 3] *= factor
        n = n_segments(larger[0], range(100, 801, 100))
        if n:
            shift, turn = sequence_error(*larger)
            # Percent, and degrees per metre, for which KISS-ICP takes pi as 3.14.
            kitti.append((n, shift, turn * factor * 3.14 / math.pi))
    errors, shifts, turns = map(np.concatenate, (errors, shifts, turns))
    n = sum(part[0] for part in kitti)
    names = ("t_err/10-80m", "r_err/10-80m") if is_short else ("t_err", "r_err")
    root = lambda values: math.sqrt(np.mean(values**2))
    return {
        "ATE": root(errors),
        "ATE/mean": np.mean(errors),
        "ATE/median": np.median(errors),
        "ATE/max": np.max(errors),
        "RPE": root(shifts),
        "RPE/mean": np.mean(shifts),
        "RPE/rotation_deg": root(turns),
        "RPE/rotation_mean_deg": np.mean(turns),
        "scale": np.mean(scales) if case["alignment"] == "scaled" else math.nan,
        "segments": n,
        **{name: sum(part[0] * part[1 + at] for part in kitti) / n if n else math.nan for at, name in enumerate(names)},
    }


judge({"odometry": odometry})
