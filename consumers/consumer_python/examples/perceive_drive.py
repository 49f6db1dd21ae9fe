"""Drives the ego by its sensors alone: lane lines from the camera, kerbs and obstacles from the lidar, speed from GNSS, turns
from the IMU.

It reads no map and no truth of the simulator. Its results are ordinary topics, which `gantry-view` draws:
`perceive/lines` (lane lines, key points in the image), `perceive/obstacles` (boxes) and `perceive/path` (where it will drive).
One step per tick, in lockstep. `./gantry up launch/perceive.toml`; docs/how-to/pipelines.md says how it works and what it cannot do.
"""

import contextlib
import math
from typing import Any

import gantry
import numpy as np

TOPICS = ["ego/front/rgb", "ego/roof/lidar", "ego/gnss/gnss", "ego/imu/imu"]
CAMERA_HEIGHT_M, CAMERA_AHEAD_M, LIDAR_HEIGHT_M = 1.6, 0.6, 2.0  # as launch/perceive.toml mounts them
LANE_M = 3.5  # width of a lane until both its lines have been seen
CRUISE_MPS, TURN_MPS = 6.0, 3.5
BRAKING_MPS2, ROOM_M = 3.0, 4.0
FRONT_M, HALF_WIDTH_M = 2.6, 1.15  # of the car, from its origin, with some room
WHEELBASE_M, MAX_STEER_RAD = 2.9, 1.0
NEAR_M, FAR_M = 3.5, 14.0  # where lines are looked for
BESIDE_M = 0.3  # from a line's middle to the asphalt beside it
CURVATURES = np.linspace(-0.19, 0.19, 39)  # arcs that the car may take, 1/m, positive to the left
ARC_M = np.arange(1.0, 9.1, 1.0)  # where arcs are judged, metres along them


def lane_marks(bgra: np.ndarray, focal_px: float, centre_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middles of narrow bright or yellow strips on the road: in metres (ahead, left) of the car's origin, and in pixels."""
    rows = np.arange(int(centre_px[1]) + 2, bgra.shape[0])
    ahead_m = CAMERA_HEIGHT_M * focal_px / (rows + 0.5 - centre_px[1])
    rows, ahead_m = rows[(ahead_m > NEAR_M) & (ahead_m < FAR_M)], ahead_m[(ahead_m > NEAR_M) & (ahead_m < FAR_M)]
    blue, green, red = (bgra[rows, :, i].astype(int) for i in range(3))
    # Paint is brighter than the asphalt on both sides of it, in the sun as in the shade; yellow paint lacks blue.
    columns = np.arange(bgra.shape[1])
    apart_px = np.round(BESIDE_M * focal_px / ahead_m).astype(int)[:, None]
    beside = [np.take_along_axis(green, np.clip(columns + side * apart_px, 0, columns[-1]), 1) for side in (-1, 1)]
    road = np.maximum(*beside)
    paint = (np.minimum(blue, green) > 1.35 * road + 8) | ((green > 1.15 * road + 5) & (green - blue > 0.3 * green))
    step = np.diff(np.pad(paint.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    (row, begin), (_, end) = np.nonzero(step == 1), np.nonzero(step == -1)
    metres_per_px = ahead_m[row] / focal_px
    is_line = (np.abs((end - begin) * metres_per_px - 0.16) < 0.11) & (end < paint.shape[1])
    row, middle = row[is_line], 0.5 * (begin + end)[is_line]
    left_m = (centre_px[0] - middle) * ahead_m[row] / focal_px
    return np.stack([ahead_m[row] + CAMERA_AHEAD_M, left_m], axis=1), np.stack([middle, rows[row] + 0.5], axis=1)


class Line:
    """One line of the own lane, followed from image to image: left = a + b · ahead."""

    def __init__(self, side: float):
        self.side, self.age = side, 0
        self.fit: Any = None  # start and slope, once it is seen
        self.reach_m, self.ends_px = 0.0, None

    def follow(self, marks_m: np.ndarray, marks_px: np.ndarray, turned_rad: float) -> None:
        """Takes the marks near where the line is expected; without enough of them in a row it is lost."""
        expected = np.array([self.side * LANE_M / 2, 0.0]) if self.fit is None else self.fit - [0.0, turned_rad]
        away = np.abs(marks_m[:, 1] - expected[0] - expected[1] * marks_m[:, 0])
        near = away < (0.9 if self.fit is None else 0.45)
        self.reach_m, self.ends_px = 0.0, None
        for _ in range(3):
            if near.sum() < 8 or np.ptp(marks_m[near, 0]) < 1.5:
                self.fit = expected if self.fit is not None and self.age < 5 else None
                self.age += 1
                return
            slope, start = np.polyfit(marks_m[near, 0], marks_m[near, 1], 1)
            near = np.abs(marks_m[:, 1] - start - slope * marks_m[:, 0]) < 0.2
        # A line does not jump aside or turn at once; marks that do belong to a bay or a crossing.
        jumps = self.fit is not None and (abs(slope - expected[1]) > 0.15 or abs(start - expected[0]) > 0.4)
        if jumps or abs(slope) > 0.5 or not 0.7 < self.side * start < 3.2:
            self.fit = None
            return
        self.fit, self.age = np.array([start, slope]), 0
        self.reach_m = marks_m[near, 0].max()
        self.ends_px = marks_px[near][[marks_m[near, 0].argmin(), marks_m[near, 0].argmax()]]

    def at(self, ahead_m: np.ndarray) -> np.ndarray:
        return self.fit[0] + self.fit[1] * ahead_m


def kerbs_and_obstacles(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cells of 0.25 m with ground that is raised above the road, and points of what stands on the ground near by."""
    height = points[:, 2] + LIDAR_HEIGHT_M
    near = (np.abs(points[:, 1]) < 14.0) & (points[:, 0] > -4.0) & (points[:, 0] < 30.0)
    raised = near & (height > 0.055) & (height < 0.4) & (points[:, 0] < 16.0)
    cells, counts = np.unique(np.round(points[raised, :2] / 0.25).astype(int), axis=0, return_counts=True)
    return cells[counts >= 2] * 0.25, points[near & (height > 0.35) & (height < 2.5)]


def clusters(points: np.ndarray) -> list[np.ndarray]:
    """Groups of points that are less than a metre apart."""
    cells, of = np.unique(np.floor(points[:, :2] / 0.5).astype(int), axis=0, return_inverse=True)
    number = {tuple(cell): idx for idx, cell in enumerate(cells)}
    group, groups = np.full(len(cells), -1), 0
    for start in range(len(cells)):
        if group[start] >= 0:
            continue
        waiting = [start]
        group[start] = groups
        while waiting:
            x, y = cells[waiting.pop()]
            for dx in (-1, 0, 1):
                for dy in (-1, 0, 1):
                    other = number.get((x + dx, y + dy), -1)
                    if other >= 0 and group[other] < 0:
                        group[other] = groups
                        waiting.append(other)
        groups += 1
    members = group[of.reshape(-1)]
    return [points[members == idx] for idx in range(groups) if (members == idx).sum() >= 5]


def arcs() -> tuple[np.ndarray, np.ndarray]:
    """Points (arc, step, xy) and headings (arc, step) of all arcs."""
    turn = CURVATURES[:, None] * ARC_M
    safe = np.where(np.abs(CURVATURES) < 1e-6, 1e-6, CURVATURES)[:, None]
    return np.stack([np.sin(safe * ARC_M) / safe, (1.0 - np.cos(safe * ARC_M)) / safe], axis=2), turn


ARC_XY, ARC_YAW = arcs()


class Driver:
    """What is known from one tick to the next."""

    def __init__(self) -> None:
        self.left, self.right = Line(1.0), Line(-1.0)
        self.width_m, self.kerb_m = LANE_M, LANE_M / 2 + 0.6
        self.curvature, self.speed_mps = 0.0, 0.0
        self.last_fix: Any = None
        self.kerbs = np.zeros((0, 2))

    def feel(self, gnss: np.ndarray, imu: np.ndarray, dt_secs: float) -> float:
        """Speed from two fixes; carries the remembered kerbs along and returns how far the car has turned."""
        turned = float(imu["angular_velocity_radps"][2]) * dt_secs
        fix = np.radians([float(gnss["latitude_deg"]), float(gnss["longitude_deg"])])
        if self.last_fix is not None:
            north, east = (fix - self.last_fix) * 6_378_137.0 * np.array([1.0, math.cos(fix[0])])
            self.speed_mps = math.hypot(north, east) / dt_secs
        self.last_fix = fix
        way, (sin, cos) = self.speed_mps * dt_secs, (math.sin(turned), math.cos(turned))
        moved = self.kerbs - [way * math.cos(turned / 2), way * math.sin(turned / 2)]
        self.kerbs = moved @ np.array([[cos, -sin], [sin, cos]])
        return turned

    def remember(self, kerbs: np.ndarray) -> np.ndarray:
        """Kerbs that are seen now, with those in the lidar's blind spot round the car that were seen before."""
        blind = (np.hypot(self.kerbs[:, 0], self.kerbs[:, 1]) < 5.0) & (self.kerbs[:, 0] > -3.0)
        self.kerbs = np.unique(np.round(np.vstack([kerbs, self.kerbs[blind]]), 1), axis=0)
        return self.kerbs

    def kerb_beside(self, kerbs: np.ndarray) -> np.ndarray:
        """Distance to the kerb on the right of every point of every arc; 6 m where there is none nearer."""
        ahead, left = ARC_XY[..., 0, None], ARC_XY[..., 1, None]
        dx, dy = kerbs[:, 0] - ahead, kerbs[:, 1] - left
        cos, sin = np.cos(ARC_YAW)[..., None], np.sin(ARC_YAW)[..., None]
        along, beside = dx * cos + dy * sin, dy * cos - dx * sin
        counts = (np.abs(along) < 2.5) & (beside < 0.6)
        return np.where(counts, np.hypot(along, beside), 6.0).min(axis=2, initial=6.0)

    def choose(self, kerbs: np.ndarray) -> None:
        """The arc that keeps to the middle between the lines as far as they are seen, and beyond them along the kerb on the right."""
        right, left = self.right, self.left
        if right.fit is not None and left.fit is not None:
            self.width_m += 0.05 * (np.clip(left.fit[0] - right.fit[0], 3.0, 4.0) - self.width_m)
        ahead = ARC_XY[..., 0]
        kerb = self.kerb_beside(kerbs)
        off = np.minimum(np.abs(kerb - self.kerb_m), 2.5)
        reach_m = max(right.reach_m if right.fit is not None else 0.0, left.reach_m if left.fit is not None else 0.0)
        if reach_m > 5.0:
            middle = right.at(ahead) + self.width_m / 2 if right.fit is not None else left.at(ahead) - self.width_m / 2
            if right.fit is not None and left.fit is not None:
                middle = (right.at(ahead) + left.at(ahead)) / 2
            off = np.where(ahead < reach_m, np.abs(ARC_XY[..., 1] - middle), off)
            # How far the kerb is from the middle of the lane, where both are seen.
            beside = kerbs[(kerbs[:, 0] > 5.0) & (kerbs[:, 0] < min(8.0, right.reach_m)) & (kerbs[:, 1] < -1.0)]
            if right.fit is not None and len(beside):
                found = float(np.min(right.at(beside[:, 0]) + self.width_m / 2 - beside[:, 1]))
                if 2.0 < found < 3.2:
                    self.kerb_m += 0.1 * (found - self.kerb_m)
        touches = (kerb < HALF_WIDTH_M).any(axis=1)
        cost = (off**2).mean(axis=1) + 3.0 * (CURVATURES - self.curvature) ** 2 + 5.0 * touches
        best = CURVATURES[cost.argmin()]
        self.curvature += 0.5 * (best - self.curvature)

    def free_m(self, obstacles: np.ndarray) -> float:
        """Way along the chosen arc until the car's front meets something."""
        ahead, left = obstacles[:, 0], obstacles[:, 1]
        if abs(self.curvature) < 1e-3:
            along, beside = ahead, left
        else:
            radius = 1.0 / self.curvature
            angle = np.arctan2(ahead, (radius - left) * np.sign(radius))
            along, beside = np.abs(radius) * angle, (radius - np.hypot(ahead, radius - left) * np.sign(radius))
        hits = (along > 1.0) & (np.abs(beside) < HALF_WIDTH_M) & (along < 25.0)
        return float((along[hits] - FRONT_M).min(initial=30.0))

    def pedals(self, free_m: float) -> dict[str, Any]:
        wanted = CRUISE_MPS if abs(self.curvature) < 0.03 else TURN_MPS
        wanted = min(wanted, math.sqrt(max(0.0, 2.0 * BRAKING_MPS2 * (free_m - ROOM_M))))
        steer = float(np.clip(math.atan(WHEELBASE_M * self.curvature) / MAX_STEER_RAD, -1.0, 1.0))
        error = wanted - self.speed_mps
        if wanted < 0.3:
            return {"brake": 1.0, "steer": steer}
        if error < -0.5:
            return {"brake": float(np.clip(-0.25 * error, 0.0, 1.0)), "steer": steer}
        return {"throttle": float(np.clip(0.2 + 0.25 * error, 0.0, 0.7)), "steer": steer}


def main() -> None:
    driver, last_secs = Driver(), None
    with (
        contextlib.suppress(KeyboardInterrupt),
        gantry.publish("perceive/lines", "keypoints", bones=[(0, 1)], classes=["left", "right"]) as lines,
        gantry.publish("perceive/obstacles", "boxes3d", classes=["obstacle"]) as boxes,
        gantry.publish("perceive/path", "path") as path,
        gantry.lockstep("perceive", timeout=60, topics=TOPICS) as rows,
    ):
        for row in rows:
            if len(row) < len(TOPICS):
                continue
            image, cloud, gnss = row["ego/front/rgb"], row["ego/roof/lidar"], row["ego/gnss/gnss"]
            dt_secs = image.sim_time - last_secs if last_secs is not None else 0.1
            last_secs = image.sim_time
            turned = driver.feel(gnss.array.reshape(-1)[0], row["ego/imu/imu"].array.reshape(-1)[0], dt_secs)
            intrinsics = image.header.intrinsics_px
            marks_m, marks_px = lane_marks(image.array, intrinsics[0], np.asarray(intrinsics[2:4]))
            for line in (driver.left, driver.right):
                line.follow(marks_m, marks_px, turned)
            kerbs, standing = kerbs_and_obstacles(cloud.array["hit_in_sensor_m"])
            driver.choose(driver.remember(kerbs))
            free_m = driver.free_m(standing)
            gantry.vehicle(image.header.parent_id).control(**driver.pedals(free_m), tick=image.tick)
            publish(driver, row, standing, lines, boxes, path)


def publish(driver, row, standing, lines, boxes, path) -> None:
    """Lane lines in the image, boxes round clusters in the lidar's space, and the chosen arc."""
    cloud = row["ego/roof/lidar"]
    seen = [(idx, line.ends_px) for idx, line in enumerate((driver.left, driver.right)) if line.ends_px is not None]
    lines.send(gantry.keypoints([ends for _, ends in seen], class_=[idx for idx, _ in seen]), answers=row["ego/front/rgb"])
    groups = clusters(standing)
    low, high = (np.array([pick(group, axis=0) for group in groups]).reshape(-1, 3) for pick in (np.min, np.max))
    boxes.send(gantry.boxes3d((low + high) / 2, (high - low) / 2, n_points=[len(group) for group in groups]), answers=cloud)
    best = np.abs(CURVATURES - driver.curvature).argmin()
    at = np.column_stack([ARC_XY[best], np.full(len(ARC_M), 0.1 - LIDAR_HEIGHT_M)])
    path.send(gantry.path(at, yaw_rad=ARC_YAW[best], curvature_pm=driver.curvature), answers=cloud)


if __name__ == "__main__":
    main()
