"""People in the front camera, with OpenCV's HOG detector of people.

Settings: `enlarge` (1.0) is how much larger the image is made before the search: more finds people
who are further away, and takes longer. `stride_px` (8) and `scale` (1.05) are steps of the search.
"""

import cv2
import gantry
import gantry.bench
import numpy as np

#: HOG's window of 64 x 128 pixels has a person of about 32 x 96 pixels in its middle.
PERSON_OF_WINDOW = np.array([0.55, 0.78])


class People(gantry.bench.Program):
    inputs = {"image": "ego/front/rgb"}
    outputs = [gantry.bench.Output("people/boxes", "boxes2d", classes=["person"])]

    def __init__(self):
        settings = gantry.bench.params()
        self.enlarge = float(settings.get("enlarge", 1.0))
        stride = int(settings.get("stride_px", 8))
        self.search = {"winStride": (stride, stride), "padding": (16, 16), "scale": float(settings.get("scale", 1.05)), "groupThreshold": 0}
        self.hog = cv2.HOGDescriptor()
        self.hog.setSVMDetector(cv2.HOGDescriptor_getDefaultPeopleDetector())

    def warm_up(self):
        self.hog.detectMultiScale(np.zeros((240, 320, 3), np.uint8), **self.search)

    def work(self, image):
        bgr = np.ascontiguousarray(image.array[..., :3])
        bgr = cv2.resize(bgr, None, fx=self.enlarge, fy=self.enlarge, interpolation=cv2.INTER_LINEAR)
        found, weights = self.hog.detectMultiScale(bgr, **self.search)
        found = np.asarray(found, float).reshape(-1, 4) / self.enlarge
        weights = np.asarray(weights, float).reshape(-1)
        centre, half = found[:, :2] + found[:, 2:] / 2, found[:, 2:] / 2 * PERSON_OF_WINDOW
        corners = np.hstack([centre - half, 2 * half])
        best = np.asarray(cv2.dnn.NMSBoxes(corners.tolist(), weights.tolist(), 0.0, 0.5), int).reshape(-1)
        size = np.array(bgr.shape[1::-1]) / self.enlarge
        low, high = np.clip((centre - half)[best], 0, size), np.clip((centre + half)[best], 0, size)
        return gantry.boxes2d(low, high, score=1 / (1 + np.exp(-weights[best])))


if __name__ == "__main__":
    gantry.bench.run(People())
