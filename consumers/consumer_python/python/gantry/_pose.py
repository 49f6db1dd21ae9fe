"""Poses: where something is and how it is turned, and the arithmetic of that."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt


class Pose(NamedTuple):
    """A rigid transform target_from_source: where the source is in the target.

    `a_from_b @ b_from_c` is `a_from_c`, `apply` moves points from the source to the target.
    """

    #: Position of the source's origin in the target, metres.
    translation_m: tuple[float, float, float]
    #: Unit quaternion [x, y, z, w].
    rotation_xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    @classmethod
    def of(cls, record: Any) -> Pose:
        """Reads the field of a record: `Pose.of(snapshot.actor(24)["world_from_actor"])`."""
        x, y, z = (float(value) for value in record["translation_m"])
        a, b, c, d = (float(value) for value in record["rotation_xyzw"])
        return cls((x, y, z), (a, b, c, d))

    @classmethod
    def turned(cls, translation_m: tuple[float, float, float], yaw_rad: float) -> Pose:
        """Makes a pose that is turned about z alone, to the left for positive angles."""
        return cls(translation_m, (0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)))

    def matrix(self) -> npt.NDArray[np.float64]:
        """Returns the transform as a 4 × 4 matrix of float64, for column vectors in metres."""
        x, y, z, w = self.rotation_xyzw
        out = np.eye(4)
        out[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        out[:3, 3] = self.translation_m
        return out

    @property
    def yaw_rad(self) -> float:
        """Angle from the target's x axis to the source's, seen from above, -π to π, positive to the left."""
        x, y, z, w = self.rotation_xyzw
        return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))

    def inverse(self) -> Pose:
        """Returns source_from_target."""
        x, y, z, w = self.rotation_xyzw
        back = Pose((0.0, 0.0, 0.0), (-x, -y, -z, w))
        a, b, c = (-float(value) for value in back.apply(self.translation_m))
        return Pose((a, b, c), back.rotation_xyzw)

    def __matmul__(self, other: Pose) -> Pose:
        """Returns target_from_c of target_from_source and source_from_c."""
        x, y, z = (float(value) for value in self.apply(other.translation_m))
        ax, ay, az, aw = self.rotation_xyzw
        bx, by, bz, bw = other.rotation_xyzw
        turn = (
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        )
        # Products of many would lose their length.
        length = math.sqrt(sum(part * part for part in turn))
        return Pose((x, y, z), (turn[0] / length, turn[1] / length, turn[2] / length, turn[3] / length))

    def apply(self, points_m: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Moves points (3,) or (n, 3) of the source into the target."""
        points = np.asarray(points_m, np.float64)
        if points.shape[-1:] != (3,):
            raise ValueError(f"points have the shape {points.shape}; it must be (3,) or (n, 3)")
        turn = self.matrix()
        moved: npt.NDArray[np.float64] = points @ turn[:3, :3].T + turn[:3, 3]
        return moved

    def project(self, points_m: npt.ArrayLike, intrinsics_px: tuple[float, float, float, float]) -> npt.NDArray[np.float64]:
        """Returns where a pinhole camera at this pose sees points (3,) or (n, 3) of the target: pixels (2,) or (n, 2).

        `frame.header.world_from_sensor.project(points, frame.header.intrinsics_px)` places points of the
        world in an image. The centre of the top-left pixel is (0.5, 0.5); NaN is behind the camera. The
        lens is left out: `frame.calibration` has it.
        """
        at = self.inverse().apply(points_m)
        fx, fy, cx, cy = intrinsics_px
        ahead = np.where(at[..., 0] > 0.0, at[..., 0], np.nan)
        return np.stack([cx - fx * at[..., 1] / ahead, cy - fy * at[..., 2] / ahead], axis=-1)
