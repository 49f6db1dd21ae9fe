"""Compares scores of boxes in space with those of nuscenes-devkit, its own code unchanged.

What the devkit does not know is brought about by taking away boxes before it runs: what lies beyond a
class's range, detections that found an ignored truth (truths stand apart in such cases, so that this
is clear), detections that do not count if they found nothing, and classes without truths. Errors of
which no truth of a class has what they are about are taken from the means by the devkit's own rule
for classes without velocity or attribute.
"""

import contextlib
import json
import math
import sys
import warnings

import numpy as np
from nuscenes.eval.common.data_classes import EvalBoxes
from nuscenes.eval.detection import evaluate
from nuscenes.eval.detection.algo import accumulate
from nuscenes.eval.detection.config import config_factory
from nuscenes.eval.detection.data_classes import DetectionBox, DetectionConfig
from pyquaternion import Quaternion

ERRORS = {"ATE": "trans_err", "ASE": "scale_err", "AOE": "orient_err", "AVE": "vel_err", "AAE": "attr_err"}


def boxes_of(case, key):
    boxes = EvalBoxes()
    for frame in range(case["n_frames"]):
        boxes.add_boxes(str(frame), [])
    for line in case[key]:
        x, y, z, length, width, height, yaw = line["shape"]
        box = DetectionBox(
            sample_token=str(line["frame"]),
            translation=(x, y, z),
            size=(width, length, height),
            rotation=tuple(Quaternion(axis=[0, 0, 1], angle=yaw)),
            velocity=tuple(line["velocity"] or (math.nan, math.nan)),
            ego_translation=(line["distance_m"], 0.0, 0.0),
            detection_name=line["class"],
            detection_score=-1.0 if line["score"] is None else line["score"],
            attribute_name=line["attribute"],
        )
        box.flag = line["flag"]
        if box.ego_dist < case["ranges"][line["class"]]:
            boxes.add_boxes(box.sample_token, [box])
    return boxes


def apart(a, b):
    return float(np.hypot(a.translation[0] - b.translation[0], a.translation[1] - b.translation[1]))


def left(truths, found, name, limit):
    """Truths that count, and the detections that count at this distance."""
    counted, kept = EvalBoxes(), EvalBoxes()
    for frame in truths.sample_tokens:
        counted.add_boxes(frame, [truth for truth in truths[frame] if not truth.flag])
        # Best first, of equals the last one; each truth has its own surroundings.
        own = [(box.detection_score, at, box) for at, box in enumerate(found[frame]) if box.detection_name == name]
        away, taken = set(), set()
        for _, at, box in sorted(own, key=lambda entry: entry[:2], reverse=True):
            near = [truth for truth in truths[frame] if truth.detection_name == name and apart(truth, box) < limit]
            assert len(near) <= 1
            if near and id(near[0]) not in taken:
                taken.add(id(near[0]))
                if near[0].flag:
                    away.add(at)
            elif box.flag:
                away.add(at)
        kept.add_boxes(frame, [box for at, box in enumerate(found[frame]) if at not in away])
    return counted, kept


def scores(case):
    truths, found = boxes_of(case, "truths"), boxes_of(case, "found")
    counted = [truth for truth in truths.all if not truth.flag]
    present = {truth.detection_name for truth in counted}
    standard = config_factory("detection_cvpr_2019")
    cfg = DetectionConfig.deserialize(standard.serialize())
    if not case["count_absent"]:
        cfg.class_names = [name for name in cfg.class_names if name in present]
    if not present:
        # The devkit has 0 and errors of 1 then; no error is left that exists.
        whole = ["mAP", "NDS", *(f"AP@{limit:g}m" for limit in cfg.dist_ths)]
        each = [f"AP/{name}" for name in cfg.class_names]
        return (dict.fromkeys(whole, 0.0), dict.fromkeys(each, 0.0)) if case["count_absent"] else ({}, {})

    run = evaluate.DetectionEval.__new__(evaluate.DetectionEval)
    run.cfg, run.gt_boxes, run.pred_boxes, run.verbose = cfg, truths, found, False
    if case["flags"]:
        evaluate.accumulate = lambda gt, pred, name, function, limit: accumulate(*left(gt, pred, name, limit), name, function, limit)
    else:
        evaluate.accumulate = accumulate
    metrics, _ = run.evaluate()

    # Without velocities or attributes in truth the devkit gives 1 for "not reached"; we leave it out.
    missing = 0
    has = {
        "vel_err": {truth.detection_name for truth in counted if not math.isnan(truth.velocity[0])},
        "attr_err": {truth.detection_name for truth in counted if truth.attribute_name},
    }
    still = {"traffic_cone", "barrier"}
    for metric, names in has.items():
        names -= still
        for name in cfg.class_names:
            if name in present - names or not names:
                metrics.add_label_tp(name, metric, math.nan)
    if present == {"traffic_cone"}:
        for name in cfg.class_names:
            metrics.add_label_tp(name, "orient_err", math.nan)

    named, by_class = {"mAP": metrics.mean_ap}, {}
    with warnings.catch_warnings(action="ignore"):
        errors, right, whole = metrics.tp_errors, metrics.tp_scores, metrics.nd_score
    for short, metric in ERRORS.items():
        if not math.isnan(errors[metric]):
            named[f"m{short}"] = errors[metric]
        else:
            missing += 1
        for name in cfg.class_names:
            value = metrics.get_label_tp(name, metric)
            if not math.isnan(value):
                by_class[f"{short}/{name}"] = value
    named["NDS"] = whole
    if missing:
        rest = sum(right[metric] for short, metric in ERRORS.items() if not math.isnan(errors[metric]))
        named["NDS"] = (cfg.mean_ap_weight * metrics.mean_ap + rest) / (cfg.mean_ap_weight + 5 - missing)
    for limit in cfg.dist_ths:
        named[f"AP@{limit:g}m"] = np.mean([metrics.get_label_ap(name, limit) for name in cfg.class_names])
    by_class |= {f"AP/{name}": value for name, value in metrics.mean_dist_aps.items()}
    return named, by_class


def main():
    n, n_there, n_whole, largest = 0, 0, 0, 0.0
    for number, line in enumerate(open(sys.argv[1])):
        case = json.loads(line)
        with contextlib.redirect_stdout(sys.stderr):
            named, by_class = scores(case)
        n_whole += "mAAE" in named and "mAVE" in named
        for expected, got in ((named, case["named"]), (by_class, case["classes"])):
            assert expected.keys() == got.keys(), (number, expected, got)
            for key, value in expected.items():
                assert abs(got[key] - value) <= 1e-6, (number, key, got[key], value)
                largest = max(largest, abs(got[key] - value))
                n_there += 0.01 < value < 0.99
                n += 1
    assert n_there > n / 4, f"only {n_there} of {n} figures are neither 0 nor 1: too easy"
    assert n_whole > 50, f"only {n_whole} cases have all five errors"
    print(f"compared {n} figures of which {n_there} lie between 0 and 1; largest difference {largest:.1e}")


main()
