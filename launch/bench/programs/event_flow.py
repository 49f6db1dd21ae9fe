"""Optical flow from events alone: the events of each half of a window make an image, bright where
they rose and dark where they fell, and DIS follows the edges from one image to the other.

Answers ten times a second, for the last 100 ms, at the places that saw events.
"""

import cv2
import gantry
import gantry.bench
import numpy as np

WINDOW_NANOS = 100_000_000
#: Side of the square round a pixel, and the mean number of events in it below which nothing is said.
AROUND_PX, MIN_EVENTS_PER_PX = 33, 0.05


class EventFlow(gantry.bench.Program):
    inputs = {"events": "ego/events/dvs"}
    outputs = ("events/flow", "flow")
    every = True

    def __init__(self):
        self.dis = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        self.parts = []

    def warm_up(self):
        noise = np.random.default_rng(1).integers(0, 255, (240, 320), np.uint8)
        self.dis.calc(noise, np.roll(noise, 3, axis=1), None)

    def work(self, events):
        header = events.header
        now, began = header.sim_nanos, header.sim_nanos - header.window_nanos
        part = began + events.array["nanos_in_window"].astype(np.int64), events.array[["x_px", "y_px", "polarity"]].copy()
        self.parts = [kept for kept in self.parts if now - WINDOW_NANOS < kept[0] <= now] + [(now, *part)]
        # Windows end where a sensor of 10 Hz fires: with the first frame, and every 100 ms after it.
        if (events.seq - 1) % (WINDOW_NANOS // header.window_nanos) != 0:
            return None
        _, _, centre_x, centre_y = header.intrinsics_px
        size = round(2 * centre_x), round(2 * centre_y)
        times, found = (np.concatenate([kept[i] for kept in self.parts]) for i in (1, 2))
        return self.flow(found, times >= now - WINDOW_NANOS // 2, size)

    def flow(self, events, is_late, size):
        """Flow (height, width, 2) of a window, pixels; NaN where nothing happened."""
        counts = [image(events[half], size) for half in (~is_late, is_late)]
        bright = max(np.percentile(np.abs(counts), 99), 1.0)
        early, late = (np.clip(128 + 100 * count / bright, 0, 255).astype(np.uint8) for count in counts)
        # From the middle of the second half back to the middle of the first: half of the window.
        motion = -2.0 * self.dis.calc(late, early, None)
        happened = cv2.boxFilter(image(events, size, signed=False), -1, (AROUND_PX, AROUND_PX))
        motion[happened < MIN_EVENTS_PER_PX] = np.nan
        return motion


def image(events, size, signed=True):
    """Sums of events per pixel (height, width): rising ones count 1, falling ones -1 if `signed`."""
    width, height = size
    weights = np.where(events["polarity"] > 0, 1.0, -1.0 if signed else 1.0)
    sums = np.bincount(events["y_px"].astype(np.int64) * width + events["x_px"], weights, width * height)
    return cv2.GaussianBlur(sums.reshape(height, width).astype(np.float32), (0, 0), 0.7)


if __name__ == "__main__":
    gantry.bench.run(EventFlow())
