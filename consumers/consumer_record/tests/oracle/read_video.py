"""Decodes H.264 in Annex B with FFmpeg (inside OpenCV) and compares it with the pictures it was made of.

usage: read_video.py STREAM RAW WIDTH HEIGHT; RAW holds pictures of HEIGHT x WIDTH x 4 bytes, BGRA.
Prints the number of pictures decoded and the smallest PSNR, decibels.
"""

import sys

import cv2
import numpy as np

stream, raw, width, height = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
pictures = np.fromfile(raw, np.uint8).reshape(-1, height, width, 4)[..., :3]
video = cv2.VideoCapture(stream, cv2.CAP_FFMPEG)
assert video.isOpened(), f"{stream} is no video"
worst = np.inf
number = 0
while True:
    there, picture = video.read()
    if not there:
        break
    # 4:2:0 has no odd column or row; the video leaves it out.
    assert picture.shape == (height // 2 * 2, width // 2 * 2, 3), picture.shape
    original = pictures[number, : picture.shape[0], : picture.shape[1]].astype(float)
    error = ((picture.astype(float) - original) ** 2).mean()
    worst = min(worst, 10 * np.log10(255**2 / max(error, 1e-9)))
    number += 1
print(number, f"{worst:.2f}")
