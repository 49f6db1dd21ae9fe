"""Time of pycocotools for the boxes that `--example detection_bench -- IMAGES FOLDER` writes.

python consumers/consumer_metrics/benches/detection_peer.py FOLDER [FILE]

With a FILE, which the bench wrote with --json, it adds its row there.
"""

import contextlib
import io
import json
import sys
import time
from pathlib import Path

from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

folder = Path(sys.argv[1])
with contextlib.redirect_stdout(io.StringIO()):
    truth = COCO(folder / "truths.json")
    found = truth.loadRes(str(folder / "results.json"))
    begin = time.perf_counter()
    evaluation = COCOeval(truth, found, "bbox")
    evaluation.evaluate()
    evaluated = time.perf_counter()
    evaluation.accumulate()
    evaluation.summarize()
    end = time.perf_counter()
n = len(evaluation.params.imgIds)
row = {
    "name": "boxes in images, pycocotools",
    "n_images": n,
    "add_us": (evaluated - begin) * 1e6 / n,
    "scores_ms": (end - evaluated) * 1e3,
    "value": evaluation.stats[0],
}
print(f"{row['name']}: {row['add_us']:.2f} µs an image, scores {row['scores_ms']:.1f} ms, value {row['value']:.6f}")
if len(sys.argv) > 2:
    file = Path(sys.argv[2])
    result = json.loads(file.read_text())
    result["rows"].append(row)
    file.write_text(json.dumps(result, indent=2) + "\n")
