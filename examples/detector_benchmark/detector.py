"""Finds vehicles in lidar clouds: what stands on the road, in cells, in groups, in boxes. numpy alone."""

import gantry
import gantry.bench
import numpy as np

#: Heights over the road that count, size of a cell, and fewest points of a group.
LOW_M, HIGH_M, CELL_M, LEAST_POINTS = 0.35, 2.6, 0.6, 6
LIDAR_HEIGHT_M = 2.0
#: Groups larger than this are houses and hedges, smaller ones poles and people.
LONGEST_M, SHORTEST_M = 7.0, 1.2


def groups(cells):
    """Numbers for cells (n, 2), the same for cells that touch one another."""
    places, which = np.unique(cells, axis=0, return_inverse=True)
    number = {tuple(place): -1 for place in places}
    n_groups = 0
    for place in number:
        if number[place] >= 0:
            continue
        todo = [place]
        while todo:
            x, y = todo.pop()
            if number.get((x, y), 0) == -1:
                number[x, y] = n_groups
                todo += [(x + dx, y + dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
        n_groups += 1
    return np.array([number[tuple(place)] for place in places])[which.ravel()]


@gantry.bench.program(inputs={"cloud": "ego/roof/lidar"}, output=gantry.bench.Output("mine/boxes", "boxes3d", classes=["car"]))
def detect(cloud):
    points = cloud.array["hit_in_sensor_m"].astype(float)
    height = points[:, 2] + LIDAR_HEIGHT_M
    standing = points[(height > LOW_M) & (height < HIGH_M) & (np.hypot(points[:, 0], points[:, 1]) > 2.5)]
    boxes = []
    if len(standing):
        group = groups(np.floor(standing[:, :2] / CELL_M).astype(int))
        for number in range(group.max() + 1):
            mine = standing[group == number]
            low, high = mine.min(axis=0), mine.max(axis=0)
            size = (high - low)[:2]
            if len(mine) >= LEAST_POINTS and size.max() <= LONGEST_M and size.max() >= SHORTEST_M:
                boxes.append(((low + high) / 2, np.maximum((high - low) / 2, 0.3), min(len(mine) / 60.0, 1.0)))
    centers = np.array([box[0] for box in boxes]).reshape(-1, 3)
    halves = np.array([box[1] for box in boxes]).reshape(-1, 3)
    return gantry.boxes3d(centers, halves, score=np.array([box[2] for box in boxes]), class_=0)


if __name__ == "__main__":
    gantry.bench.run(detect)
