"""Input of trackers: the true boxes of people and cars, late, inexact, with gaps and false alarms.

It reads the truth, so it is no program to be benchmarked: it runs once, in the truth pass of a
suite (`[input.noisy_boxes]`), and its results are replayed to every tracker, the same noise for all.

Settings: `truth` ("ego/front_truth"), `rate_hz` (10), `delay_frames` (1), `sigma` (0.05, of width and
height), `miss` (0.1), `false_per_frame` (0.5), `min_pixels` (64), `seed` (1), `lockstep`.
"""

import contextlib

import gantry
import gantry.bench
import numpy as np
from scipy.ndimage import find_objects

CLASSES = ["person", "car"]
OF_CARLA = {gantry.CLASS_NAMES.index("Pedestrians"): 0, gantry.CLASS_NAMES.index("Car"): 1}


def true_boxes(instance, semantic, carrier_id, min_pixels):
    """Boxes (n, 4) `[x0, y0, x1, y1]` round the pixels of each object but the carrier, and their classes (n,)."""
    wanted = np.isin(semantic, list(OF_CARLA)) & (instance > 0) & (instance != carrier_id)
    ids, labels = np.unique(np.where(wanted, instance, 0), return_inverse=True)
    labels = labels.reshape(instance.shape)
    boxes, classes = [], []
    for label, place in enumerate(find_objects(labels), start=1):
        pixels = labels[place] == label if place is not None else np.zeros(0, bool)
        if pixels.sum() >= min_pixels and ids[label] > 0:
            rows, columns = place
            boxes.append((columns.start, rows.start, columns.stop, rows.stop))
            classes.append(OF_CARLA[int(semantic[place][pixels][0])])
    return np.array(boxes, float).reshape(-1, 4), np.array(classes, int)


def disturbed(boxes, classes, size, settings, random):
    """The boxes as a mediocre detector would have them, and false ones, as records."""
    kept = random.random(len(boxes)) >= settings.get("miss", 0.1)
    boxes, classes = boxes[kept], classes[kept]
    extent = np.tile(boxes[:, 2:] - boxes[:, :2], 2)
    boxes = boxes + random.normal(0.0, settings.get("sigma", 0.05), boxes.shape) * extent
    n_false = random.poisson(settings.get("false_per_frame", 0.5))
    low = random.uniform(0.0, 0.8, (n_false, 2)) * size
    false = np.hstack([low, low + random.uniform(0.03, 0.2, (n_false, 2)) * size])
    boxes = np.clip(np.vstack([boxes, false]), 0, np.tile(size, 2))
    score = np.concatenate([random.uniform(0.5, 1.0, len(classes)), random.uniform(0.2, 0.7, n_false)])
    classes = np.concatenate([classes, random.integers(0, len(CLASSES), n_false)])
    return gantry.boxes2d(boxes[:, :2], boxes[:, 2:], score=score, class_=classes)


def main():
    settings = gantry.bench.params()
    truth, period_nanos = settings.get("truth", "ego/front_truth"), round(1e9 / settings.get("rate_hz", 10.0))
    names = [f"{truth}/instance", f"{truth}/semantic"]
    waiting, first_nanos = [], None
    with (
        contextlib.suppress(KeyboardInterrupt),
        gantry.sync(names, timeout=60) as inputs,
        gantry.publish("noisy/boxes", "boxes2d", classes=CLASSES) as out,
        gantry.lockstep(settings.get("lockstep", "noisy_boxes"), timeout=60) as ticks,
    ):
        for _ in ticks:
            ticks.wait_frames()
            while (row := inputs.next(0.0, or_none=True)) is not None:
                instance, semantic = row[names[0]], row[names[1]]
                now = instance.header.sim_nanos
                first_nanos = now if first_nanos is None else first_nanos
                if (now - first_nanos) % period_nanos == 0:
                    found = true_boxes(instance.array, semantic.array, instance.header.parent_id, settings.get("min_pixels", 64))
                    random = np.random.default_rng((settings.get("seed", 1), row.tick))
                    waiting.append((row.tick, row.sim_time, disturbed(*found, np.array(instance.size), settings, random)))
                    if len(waiting) > settings.get("delay_frames", 1):
                        tick, sim_time, boxes = waiting.pop(0)
                        out.send(boxes, tick=tick, sim_time=sim_time, space="image")
                del row, instance, semantic


if __name__ == "__main__":
    main()
