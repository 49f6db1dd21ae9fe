"""Compares scores of boxes and masks with those of pycocotools, its own code unchanged."""

import contextlib
import io
import json
import sys

import numpy as np
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

FIGURES = ["ap", "ap50", "ap75", "ap_small", "ap_medium", "ap_large", "ar1", "ar10", "ar100", "ar_small", "ar_medium", "ar_large"]
# An area beyond every range: what has it does not count, by COCO's own rules.
BEYOND = 2e10


def scores(case):
    """All twelve figures of all classes together, and of each class; -1 where there is none."""
    width, height = case["size"]
    classes = {truth["category_id"] for truth in case["truths"]} | {found["category_id"] for found in case["found"]}
    classes = sorted(classes - {case["any_class"]}) or [0]
    own = [truth for truth in case["truths"] if truth["category_id"] != case["any_class"]]
    for truth in case["truths"]:
        if truth["category_id"] == case["any_class"]:
            own += [truth | {"category_id": name} for name in classes]
    for number, truth in enumerate(own, 1):
        truth["id"] = number
    images = [{"id": number, "width": width, "height": height} for number in range(1, case["n_images"] + 1)]
    categories = [{"id": name} for name in classes]
    truth = COCO()
    truth.dataset = {"info": {}, "images": images, "categories": categories, "annotations": own}
    truth.createIndex()
    if case["found"]:
        found = truth.loadRes(case["found"])
    else:
        found = COCO()
        found.dataset = {"images": images, "categories": categories, "annotations": []}
        found.createIndex()
    for annotation in found.anns.values():
        if annotation["ignore_unmatched"]:
            annotation["area"] = BEYOND
    evaluation = COCOeval(truth, found, case["kind"])
    evaluation.evaluate()
    evaluation.accumulate()
    evaluation.summarize()
    by_class = {}
    for number, name in enumerate(classes):
        precision = evaluation.eval["precision"][:, :, number]
        recall = evaluation.eval["recall"][:, number]
        slices = [precision[..., 0, 2], precision[0, :, 0, 2], precision[5, :, 0, 2]]
        slices += [precision[..., area, 2] for area in (1, 2, 3)]
        slices += [recall[:, 0, limit] for limit in (0, 1, 2)] + [recall[:, area, 2] for area in (1, 2, 3)]
        by_class[name] = [np.mean(part[part > -1]) if (part > -1).any() else -1 for part in slices]
    return list(evaluation.stats), by_class


def main():
    n, n_there, largest = 0, 0, 0.0
    for number, line in enumerate(open(sys.argv[1])):
        case = json.loads(line)
        with contextlib.redirect_stdout(io.StringIO()):
            overall, by_class = scores(case)
        own = {int(name): value for name, value in case["scores"]["classes"].items()}
        pairs = [("all", overall, case["scores"]["all"])]
        pairs += [(name, expected, own.get(name)) for name, expected in by_class.items()]
        for name, expected, scored in pairs:
            for key, value in zip(FIGURES, expected):
                got = scored and scored[key]
                if value == -1:
                    assert got is None, (number, name, key, got)
                else:
                    assert got is not None and abs(got - value) <= 1e-6, (number, name, key, got, value)
                    largest = max(largest, abs(got - value))
                    n_there += 0.01 < value < 0.99
                n += 1
    assert n_there > n / 4, f"only {n_there} of {n} figures are neither 0 nor 1: too easy"
    print(f"compared {n} figures of which {n_there} are neither 0 nor 1; largest difference {largest:.1e}")


main()
