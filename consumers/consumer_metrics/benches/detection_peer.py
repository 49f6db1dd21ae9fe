"""Time of pycocotools for the boxes that `--example detection_bench -- IMAGES FOLDER` writes.

python consumers/consumer_metrics/benches/detection_peer.py FOLDER
"""

import contextlib
import io
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
print(f"pycocotools: {(evaluated - begin) * 1e6 / n:.2f} µs an image, scores {(end - evaluated) * 1e3:.1f} ms, value {evaluation.stats[0]:.6f}")
