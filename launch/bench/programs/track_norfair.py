"""Follows boxes with norfair: a Kalman filter per object, matched by overlap. Needs `pip install norfair`."""

import gantry
import gantry.bench
import norfair
import numpy as np


class Tracks(gantry.bench.Program):
    inputs = {"boxes": "noisy/boxes"}
    outputs = [gantry.bench.Output("norfair/tracks", "tracks", classes=["person", "car"])]
    every = True

    def __init__(self):
        self.tracker = norfair.Tracker(distance_function="iou", distance_threshold=0.7, initialization_delay=2, hit_counter_max=8)

    def work(self, boxes):
        corners = np.stack([boxes.array["min_px"], boxes.array["max_px"]], axis=1).astype(float)
        seen = [
            norfair.Detection(points, scores=np.full(2, score), label=int(class_), data=float(score))
            for points, score, class_ in zip(corners, boxes.array["score"], boxes.array["class"])
        ]
        alive = self.tracker.update(seen)
        at = np.array([track.estimate for track in alive]).reshape(-1, 2, 2)
        return gantry.tracks(
            [track.id for track in alive],
            min_px=at[:, 0],
            max_px=at[:, 1],
            class_=[track.label for track in alive],
            score=[track.last_detection.data for track in alive],
            state=["confirmed" if track.last_detection in seen else "lost" for track in alive],
        )


if __name__ == "__main__":
    gantry.bench.run(Tracks())
