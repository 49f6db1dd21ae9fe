"""Finds people (HOG) and lane marks (Hough) in the front camera and publishes both.

Needs `pip install opencv-python-headless`; docs/how-to/pipelines.md explains it line by line.
"""

import contextlib

import cv2
import gantry
import numpy as np

hog = cv2.HOGDescriptor()
hog.setSVMDetector(cv2.HOGDescriptor_getDefaultPeopleDetector())


def people(bgr: np.ndarray) -> np.ndarray:
    """Boxes round people, as records of `boxes2d`."""
    found, weights = hog.detectMultiScale(bgr, winStride=(8, 8), padding=(8, 8), scale=1.05)
    found = np.asarray(found, float).reshape(-1, 4)
    score = np.clip(np.asarray(weights, float).reshape(-1) / 2.0, 0.0, 1.0)
    # HOG's window is larger than the person in it by a quarter.
    margin = found[:, 2:] * np.array([0.25, 0.1])
    return gantry.boxes2d(found[:, :2] + margin / 2, found[:, :2] + found[:, 2:] - margin / 2, score=score)


def lane_marks(bgr: np.ndarray):
    """Straight bright lines on the road, each as two key points."""
    height, width = bgr.shape[:2]
    road = cv2.cvtColor(bgr[height // 2:], cv2.COLOR_BGR2GRAY)
    edges = cv2.Canny(cv2.inRange(road, 160, 255), 50, 150)
    lines = cv2.HoughLinesP(edges, 1, np.pi / 180, threshold=40, minLineLength=50, maxLineGap=30)
    ends = np.zeros((0, 2, 2)) if lines is None else lines.reshape(-1, 2, 2).astype(float)
    slope = np.abs(np.arctan2(ends[:, 1, 1] - ends[:, 0, 1], ends[:, 1, 0] - ends[:, 0, 0]))
    ahead = ends[(slope > 0.35) & (slope < np.pi - 0.35)] + [0.0, height // 2]
    return gantry.keypoints(list(ahead))


with (
    contextlib.suppress(KeyboardInterrupt),  # Ctrl-C and the launcher's end
    gantry.open("ego/front/rgb", timeout=60) as camera,
    gantry.publish("people/boxes", "boxes2d", classes=["person"]) as boxes,
    gantry.publish("lanes/lines", "keypoints", bones=[(0, 1)]) as lanes,
):
    for frame in camera.newest():
        bgr = np.ascontiguousarray(frame.array[..., :3])  # B G R A in shared memory; HOG wants three parts
        boxes.send(people(bgr), answers=frame)
        lanes.send(lane_marks(bgr), answers=frame)
