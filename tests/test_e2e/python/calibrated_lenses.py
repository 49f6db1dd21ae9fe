"""Compares calibrations of frames with OpenCV's own projections.

Usage: calibrated_lenses.py live|replay DOMAIN, calibrated_lenses.py recording FILE, or
calibrated_lenses.py exported NAME FILE, a calibration that `gantry sensor export` wrote for OpenCV
"""

import sys

import cv2
import numpy as np

import gantry

#: By camera, the numbers of the launch file: fx, fy, cx, cy, coefficients, and degrees to look at.
LENSES = {
    "straight": ((100.0, 101.0, 80.0, 60.0), [], 60),
    "bent": ((90.0, 91.5, 81.25, 58.5), [-0.28, 0.09, 0.0011, -0.0007, -0.012], 40),
    "fisheye": ((48.0, 48.5, 79.0, 61.0), [-0.0132, 0.0204, -0.0113, 0.0021], 85),
    "even": ((45.0, 45.0, 80.0, 60.0), [0.0] * 4, 85),
}
FISHEYES = ("fisheye", "even")


def points(most_deg):
    """Returns points at many angles around the axis and to it, at several distances."""
    to, around = np.meshgrid(np.radians(np.linspace(0.5, most_deg, 24)), np.radians(np.arange(0, 360, 15)))
    to, around = to.ravel(), around.ravel()
    rays = np.stack([np.sin(to) * np.cos(around), np.sin(to) * np.sin(around), np.cos(to)], axis=1)
    return rays * (1 + np.arange(len(rays)) % 7)[:, None]


def by_opencv(name, matrix, coefficients, seen):
    """Returns OpenCV's pixels, which count from the middle of the first one."""
    project = cv2.fisheye.projectPoints if name in FISHEYES else cv2.projectPoints
    still = np.zeros((3, 1))
    if name in FISHEYES:
        pixels, _ = project(seen[:, None], still, still, matrix, coefficients)
    else:
        pixels, _ = project(seen, still, still, matrix, coefficients)
    return pixels.reshape(-1, 2)


def check(name, calibration):
    """Asserts that a calibration agrees with OpenCV over its field, both ways."""
    (fx, fy, cx, cy), coefficients, most_deg = LENSES[name]
    matrix = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1.0]])
    seen = points(most_deg)
    expected = by_opencv(name, matrix, np.array(coefficients), seen)
    np.testing.assert_allclose(calibration.project(seen) - 0.5, expected, rtol=0, atol=1e-9, err_msg=name)
    rays = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    np.testing.assert_allclose(calibration.unproject(expected + 0.5), rays, rtol=0, atol=1e-9, err_msg=name)
    assert calibration.parameters["focal_px"] == [fx, fy], (name, calibration.parameters)
    assert calibration.parameters["centre_px"] == [cx, cy], (name, calibration.parameters)
    assert calibration.size == (160, 120) and calibration.crc != 0, (name, calibration)


how = sys.argv[1]
if how == "recording":
    with gantry.Recording(sys.argv[2]) as recording:
        for name in LENSES:
            frames = list(recording.frames(f"ego/{name}/depth"))
            assert frames, name
            for frame in frames[:: max(1, len(frames) // 3)]:
                check(name, frame.calibration)
elif how == "exported":
    name, path = sys.argv[2:]
    file = cv2.FileStorage(path, cv2.FILE_STORAGE_READ)
    matrix = file.getNode("camera_matrix").mat()
    coefficients = file.getNode("distortion_coefficients").mat()
    (fx, fy, cx, cy), own, most_deg = LENSES[name]
    same = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1.0]])
    seen = points(most_deg)
    read, expected = (by_opencv(name, *numbers, seen) for numbers in ((matrix, coefficients), (same, np.array(own))))
    np.testing.assert_allclose(read, expected, rtol=0, atol=1e-9, err_msg=name)
else:
    for name in LENSES:
        with gantry.open(f"ego/{name}/depth", domain=sys.argv[2]) as camera:
            check(name, camera.next(timeout=30).calibration)
print(how, "passed", flush=True)
