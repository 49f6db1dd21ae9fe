"""Opens exported COCO and YOLO sets with pycocotools, and compares them with instance images.

Usage: export_coco.py RECORDING CAMERA COCO_RLE COCO_POLYGONS YOLO
"""

import json
import sys
from pathlib import Path

import numpy as np
from export_kit import Recording
from PIL import Image
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

# Classes of CARLA by category of COCO.
CLASSES = {1: (12, 13), 2: (19,), 3: (14,), 4: (18,), 6: (16,), 7: (17,), 8: (15,), 10: (7,)}

recording, camera, rle, polygons, yolo = sys.argv[1:]
topics = [f"ego/{camera}/{kind}" for kind in ("semantic", "instance")]
truth = Recording(recording, topics)
coco = COCO(f"{rle}/annotations/instances_train.json")
outlines = COCO(f"{polygons}/annotations/instances_train.json")
n_masks = n_categories = n_parked = 0
for image in coco.loadImgs(coco.getImgIds()):
    if image["camera"] != camera:
        continue
    semantic, instance = (truth.frames[topic][image["tick"]] for topic in topics)
    picture = Image.open(f"{rle}/images/train/{image['file_name']}")
    assert picture.size == (image["width"], image["height"]) == instance.shape[::-1]
    annotations = coco.loadAnns(coco.getAnnIds(imgIds=[image["id"]]))
    labelled = np.zeros(instance.shape, bool)
    for annotation in annotations:
        mask = coco.annToMask(annotation).astype(bool)
        of_class = np.isin(semantic, CLASSES[annotation["category_id"]])
        assert (mask == ((instance == annotation["track_id"]) & of_class)).all(), annotation
        rows, columns = np.nonzero(mask)
        box = [columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1]
        assert annotation["bbox"] == box and annotation["area"] == mask.sum()
        for name in ("visible_fraction", "truncation", "occlusion"):
            assert 0 <= annotation.get(name, 0) <= 1
        if annotation["track_id"] in truth.scenery and annotation["category_id"] == 3:
            assert annotation["type_id"] == "parked_car" and annotation["visible_fraction"] > 0
            n_parked += 1
        labelled |= mask
        n_masks += 1
    things = np.isin(semantic, sum(CLASSES.values(), ())) & (instance != 0)
    left_out = np.unique(instance[things & ~labelled], return_counts=True)
    carrier = [actor for actor, facts in truth.actors.items() if facts["role"] == "ego_vehicle"]
    for ident, count in zip(*left_out):
        assert count < 10 or ident in carrier, f"{count} pixels of {ident} have no label"
    # The same as outlines: equal where a mask has no holes.
    others = outlines.loadAnns(outlines.getAnnIds(imgIds=[image["id"]]))
    assert len(others) == len(annotations)
    for one, other in zip(annotations, others):
        whole, filled = coco.annToMask(one).astype(bool), outlines.annToMask(other).astype(bool)
        assert (whole & ~filled).sum() <= 0.02 * whole.sum() + 2, (one["id"], whole.sum(), (whole & ~filled).sum())
    # YOLO has the same boxes in the same order.
    name = Path(image["file_name"]).stem
    lines = Path(f"{yolo}/detect/labels/train/{name}.txt").read_text().splitlines()
    segments = Path(f"{yolo}/segment/labels/train/{name}.txt").read_text().splitlines()
    assert len(lines) == len(segments) == len(annotations)
    order = sorted(CLASSES)
    for line, segment, annotation in zip(lines, segments, annotations):
        words = line.split()
        assert order[int(words[0])] == annotation["category_id"]
        x, y, w, h = (float(word) for word in words[1:])
        size = np.array([image["width"], image["height"]] * 2)
        box = np.array([x - w / 2, y - h / 2, w, h]) * size
        assert np.abs(box - annotation["bbox"]).max() < 0.01, (box, annotation["bbox"])
        path = np.array(segment.split()[1:], float).reshape(-1, 2) * size[:2]
        low, high = path.min(axis=0), path.max(axis=0)
        assert np.abs([*low, *(high - low)] - np.array(annotation["bbox"])).max() < 0.01
        n_categories += 1
assert n_masks > 50 and n_parked > 20, (n_masks, n_parked)

# The truth judged against itself is perfect.
results = [{key: annotation[key] for key in ("image_id", "category_id", "segmentation", "bbox")} | {"score": 1.0}
           for annotation in coco.dataset["annotations"]]
for kind in ("segm", "bbox"):
    judge = COCOeval(coco, coco.loadRes(json.loads(json.dumps(results))), kind)
    judge.evaluate()
    judge.accumulate()
    judge.summarize()
    assert judge.stats[0] == 1.0, (kind, judge.stats)

# What gantry.torch reads of the recording is what it reads of the set that was made of it: pictures, boxes, classes.
sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "consumers" / "consumer_python" / "python"))
from gantry.torch import Dataset  # noqa: E402

exported = Dataset(rle)
for name in {image["camera"] for image in coco.dataset["images"]}:
    recorded = Dataset(recording, camera=f"ego/{name}")
    files = [i for i, image in enumerate(coco.loadImgs(sorted(coco.getImgIds()))) if image["camera"] == name]
    assert len(files) == len(recorded) > 0, (name, len(files), len(recorded))
    for i, at in enumerate(files):
        one, other = recorded.sample(i), exported.sample(at)
        assert all(a.dtype == b.dtype and np.array_equal(a, b) for a, b in zip(one, other)), (name, i)
cars = Dataset(rle, classes=["car"])
n_cars = sum(len(cars.sample(i).labels) for i in range(len(cars)))
assert n_cars == len(coco.getAnnIds(catIds=[3])) > 0 and not any(cars.sample(i).labels.any() for i in range(len(cars)))
yaml = Path(f"{yolo}/detect/data.yaml").read_text()
assert "train: images/train" in yaml and "2: car" in yaml
assert list(Path(f"{yolo}/segment/images/train").iterdir())
print(f"ok: {n_masks} masks, {n_parked} of parked cars, {n_categories} boxes")
