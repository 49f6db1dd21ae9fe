"""Compares figures of pixels with those of scikit-learn, SciPy and mmflow.

Where no package has a figure, its paper's formula stands here in NumPy: SqRel, the shares within a factor, bad1 and
bad2, and what counts as no answer.
"""

import math

import numpy as np
from metrics_kit import array, judge, mean, one_file_of, share
from scipy.spatial.transform import Rotation
from scipy.stats import tstd
from sklearn.metrics import (
    accuracy_score,
    jaccard_score,
    mean_absolute_percentage_error,
    recall_score,
    root_mean_squared_error,
)

mmflow = one_file_of("mmflow", "core/evaluation/metrics.py")


def classes(case):
    truth = np.concatenate([frame["truth"] for frame in case["frames"]])
    result = np.concatenate([frame["result"] for frame in case["frames"]])
    mask = np.concatenate([frame["mask"] for frame in case["frames"]]) & ~np.isin(truth, case["ignored"])
    truth, result = truth[mask], result[mask]
    labels = [label for label in np.union1d(truth, result) if label not in case["ignored"]]
    if not len(truth):
        return {}
    ious = jaccard_score(truth, result, labels=labels, average=None, zero_division=0)
    there = np.unique(truth)
    return {
        "mIoU": mean(ious),
        "accuracy": accuracy_score(truth, result),
        "mAcc": recall_score(truth, result, labels=there, average="macro", zero_division=0),
        "fwIoU": jaccard_score(truth, result, labels=there, average="weighted", zero_division=0),
    } | {f"IoU/{label}": iou for label, iou in zip(labels, ious)}


def depth(case):
    figures, n_answered, n_scored = [], 0, 0
    for image in case["images"]:
        truth, result = array(image["truth"]), array(image["result"])
        scored = np.array(image["mask"]) & (truth > case["min_m"]) & (truth < case["max_m"])
        answered = scored & (result > 0)
        n_scored, n_answered = n_scored + scored.sum(), n_answered + answered.sum()
        truth, result = truth[answered], result[answered]
        if not len(truth):
            continue
        if case["median"]:
            result = result * (np.median(truth) / np.median(result))
        result = np.clip(result, case["min_m"], case["max_m"])
        log_truth, log_result = np.log(truth), np.log(result)
        factor = np.exp(np.abs(log_truth - log_result))
        figures.append([
            mean_absolute_percentage_error(truth, result),
            mean((truth - result) ** 2 / truth),
            root_mean_squared_error(truth, result),
            root_mean_squared_error(log_truth, log_result),
            100 * tstd(log_truth - log_result, ddof=0),
            *[mean(factor < 1.25**power) for power in (1, 2, 3)],
        ])
    names = ["AbsRel", "SqRel", "RMSE", "RMSElog", "SILog", "d1", "d2", "d3"]
    means = np.mean(figures, axis=0) if figures else [math.nan] * len(names)
    return dict(zip(names, means)) | {"density": 100 * share(n_answered, n_scored)}


def stereo(case):
    """Disparity is a flow without a vertical part; KITTI's rule of outliers is one for both."""
    truth, result = (np.concatenate([array(image[name]) for image in case["images"]]) for name in ("truth", "result"))
    scored = np.concatenate([image["mask"] for image in case["images"]]) & (truth > 0)
    answered = scored & (result >= 0)
    # No answer is as wrong as can be.
    result = np.where(answered, result, 1e9)
    pair = [np.stack([values, np.zeros_like(values)], -1)[None] for values in (result, truth)]
    figures = mmflow.eval_metrics([pair[0]], [pair[1]], [scored[None]], ["Fl"])
    error = np.abs(truth - result)[scored]
    return {
        "D1": figures["Fl"],
        "EPE": mmflow.end_point_error([pair[0]], [pair[1]], [answered[None]]),
        "density": 100 * share(answered.sum(), scored.sum()),
    } | {f"bad{limit}": 100 * mean(error > limit) for limit in (1, 2, 3)}


def of_flow(truth, result, scored, limits, suffix=""):
    answered = scored & np.isfinite(result).all(1)
    result = np.where(answered[:, None], result, 1e9)
    truth = np.where(scored[:, None], truth, 0.0)
    pair = [result[None]], [truth[None]]
    errors = mmflow.end_point_error_map(result, truth)
    return answered, {
        f"EPE{suffix}": mmflow.end_point_error(*pair, [answered[None]]) if answered.any() else math.nan,
        f"Fl{suffix}": mmflow.optical_flow_outliers(*pair, [scored[None]]),
    } | {f"{limit}px{suffix}": 100 * mean(errors[scored] > limit) for limit in limits}


def joined(case, *names):
    images = case["images"]
    flows = (np.concatenate([array(image[name]).reshape(-1, 2) for image in images]) for name in ("truth", "result"))
    masks = (np.concatenate([image[name] for image in images]) for name in names)
    return *flows, *masks


def flow(case):
    truth, result, mask, moving, occluded = joined(case, "mask", "moving", "occluded")
    scored = mask & np.isfinite(truth).all(1)
    parts = {"/moving": moving, "/static": ~moving, "/occluded": occluded, "/visible": ~occluded}
    answered, figures = of_flow(truth, result, scored, (1, 3, 5))
    for name, part in parts.items():
        figures |= of_flow(truth, result, scored & part, (1, 3, 5), name)[1]
    return figures | {"density": 100 * share(answered.sum(), scored.sum())}


def event_flow(case):
    truth, result, mask = joined(case, "mask")
    scored = mask & np.isfinite(truth).all(1)
    answered, figures = of_flow(truth, result, scored, (1, 2, 3))
    # The angle of the shortest turn from one vector (u, v, 1) to the other.
    vectors = [np.c_[values[answered], np.ones(answered.sum())] for values in (truth, result)]
    turns = [Rotation.align_vectors(a[None], b[None])[0].magnitude() for a, b in zip(*vectors)]
    return {
        "EPE": figures["EPE"],
        **{f"{limit}PE": figures[f"{limit}px"] for limit in (1, 2, 3)},
        "AE": mean(np.degrees(turns)),
        "density": 100 * share(answered.sum(), scored.sum()),
    }


judge({"classes": classes, "depth": depth, "stereo": stereo, "flow": flow, "event_flow": event_flow})
