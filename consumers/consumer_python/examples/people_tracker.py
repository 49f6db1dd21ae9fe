"""Follows the people that people_detector.py finds, and gives each a number.

Needs `pip install norfair`; docs/how-to/pipelines.md explains it line by line.
"""

import contextlib

import gantry
import norfair
import numpy as np

tracker = norfair.Tracker(distance_function="iou", distance_threshold=0.8, initialization_delay=2, hit_counter_max=10)

with (
    contextlib.suppress(KeyboardInterrupt),  # Ctrl-C and the launcher's end
    gantry.open("people/boxes", result="boxes2d", timeout=60) as boxes,
    gantry.publish("people/tracks", "tracks", classes=["person"]) as tracks,
):
    for result in boxes:
        corners = np.stack([result.array["min_px"], result.array["max_px"]], axis=1).astype(float)
        seen = [norfair.Detection(points, scores=np.full(2, score)) for points, score in zip(corners, result.array["score"])]
        alive = tracker.update(seen)
        at = np.array([track.estimate for track in alive]).reshape(-1, 2, 2)
        tracks.send(
            gantry.tracks(
                [track.id for track in alive],
                min_px=at[:, 0],
                max_px=at[:, 1],
                state=["confirmed" if track.last_detection in seen else "lost" for track in alive],
            ),
            answers=result,
        )
