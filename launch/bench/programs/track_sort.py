"""Follows boxes as SORT does (Bewley et al. 2016): a Kalman filter of centre, area and aspect per
object, and the assignment of boxes to predictions that overlaps most. Needs filterpy and scipy.

Settings: `min_overlap` (0.3), `min_hits` (2), `max_missed` (5).
"""

import filterpy.kalman
import gantry
import gantry.bench
import numpy as np
from scipy.optimize import linear_sum_assignment


class Track:
    """One object: centre x, y, area, aspect, and the rates of the first three per result."""

    def __init__(self, id_, box, class_):
        self.id, self.class_, self.hits, self.missed, self.score = id_, class_, 1, 0, 0.0
        self.filter = filterpy.kalman.KalmanFilter(dim_x=7, dim_z=4)
        self.filter.F = np.eye(7) + np.eye(7, k=4)
        self.filter.H = np.eye(4, 7)
        self.filter.R[2:, 2:] *= 10.0
        self.filter.P[4:, 4:] *= 1000.0  # the rates are not known at first
        self.filter.P *= 10.0
        self.filter.Q[4:, 4:] *= 0.01
        self.filter.Q[-1, -1] *= 0.01
        self.filter.x[:4, 0] = measured(box)

    def predict(self):
        if self.filter.x[2, 0] + self.filter.x[6, 0] <= 0:
            self.filter.x[6, 0] = 0.0  # an area stays above nothing
        self.filter.predict()
        self.missed += 1

    def update(self, box, score):
        self.filter.update(measured(box))
        self.hits, self.missed, self.score = self.hits + 1, 0, score

    def box(self):
        x, y, area, aspect = self.filter.x[:4, 0]
        width = np.sqrt(max(area * aspect, 1e-6))
        half = np.array([width, max(area, 1e-6) / width]) / 2
        return np.concatenate([[x, y] - half, [x, y] + half])


def measured(box):
    """Centre, area and aspect of a box `[x0, y0, x1, y1]`, pixels."""
    width, height = box[2] - box[0], box[3] - box[1]
    return np.array([(box[0] + box[2]) / 2, (box[1] + box[3]) / 2, width * height, width / max(height, 1e-6)])


def overlaps(a, b):
    """Intersection over union of all pairs of boxes (n, 4) and (m, 4)."""
    low, high = np.maximum(a[:, None, :2], b[None, :, :2]), np.minimum(a[:, None, 2:], b[None, :, 2:])
    both = np.prod(np.clip(high - low, 0, None), axis=2)
    area_a, area_b = (np.prod(boxes[:, 2:] - boxes[:, :2], axis=1) for boxes in (a, b))
    return both / np.maximum(area_a[:, None] + area_b[None] - both, 1e-6)


class Sort(gantry.bench.Program):
    inputs = {"boxes": "noisy/boxes"}
    outputs = [gantry.bench.Output("sort/tracks", "tracks", classes=["person", "car"])]
    every = True

    def __init__(self):
        settings = gantry.bench.params()
        self.min_overlap, self.min_hits = settings.get("min_overlap", 0.3), settings.get("min_hits", 2)
        self.max_missed = settings.get("max_missed", 5)
        self.tracks, self.n_made = [], 0

    def work(self, boxes):
        seen = np.hstack([boxes.array["min_px"], boxes.array["max_px"]]).astype(float)
        classes, scores = boxes.array["class"].copy(), boxes.array["score"].copy()
        for track in self.tracks:
            track.predict()
        predicted = np.array([track.box() for track in self.tracks]).reshape(-1, 4)
        overlap = overlaps(predicted, seen) * (np.array([track.class_ for track in self.tracks]).reshape(-1, 1) == classes)
        free = set(range(len(seen)))
        for i, j in zip(*linear_sum_assignment(-overlap)):
            if overlap[i, j] >= self.min_overlap:
                self.tracks[i].update(seen[j], scores[j])
                free.discard(j)
        for j in sorted(free):
            self.n_made += 1
            self.tracks.append(Track(self.n_made, seen[j], classes[j]))
        self.tracks = [track for track in self.tracks if track.missed <= self.max_missed]
        shown = [track for track in self.tracks if track.hits >= self.min_hits]
        at = np.array([track.box() for track in shown]).reshape(-1, 4)
        columns = {name: [getattr(track, name) for track in shown] for name in ("class_", "score")}
        state = ["confirmed" if track.missed == 0 else "lost" for track in shown]
        return gantry.tracks([track.id for track in shown], min_px=at[:, :2], max_px=at[:, 2:], state=state, **columns)


if __name__ == "__main__":
    gantry.bench.run(Sort())
