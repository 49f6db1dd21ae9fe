"""Structured numpy types of all records on the bus, made from the generated layout."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

from . import _layout
from ._load import native


def _dtype(name: str) -> np.dtype[Any]:
    _, size, fields = _layout.STRUCTS[name]
    formats = [(_dtype("Pose") if code == "Pose" else np.dtype(code), shape) for _, code, shape, _ in fields]
    spec: Any = {
        "names": [field[0] for field in fields],
        "formats": [(base, shape) if shape else base for base, shape in formats],
        "offsets": [field[3] for field in fields],
        "itemsize": size,
    }
    dtype: np.dtype[Any] = np.dtype(spec)
    return dtype


def unpacker(name: str) -> struct.Struct:
    """Returns a `struct.Struct` that reads all fields but `reserved…` as a flat tuple of numbers.

    Reading a numpy record field by field takes thirty times as long.
    """
    parts, at = ["<"], 0
    for code, count, offset in _flat(name, 0):
        parts.append(f"{offset - at}x{count}{_STRUCT_CODES[code]}")
        at = offset + count * np.dtype(code).itemsize
    return struct.Struct("".join([*parts, f"{_layout.STRUCTS[name][1] - at}x"]))


_STRUCT_CODES = {"u1": "B", "<u2": "H", "<u4": "I", "<u8": "Q", "<i4": "i", "<i8": "q", "<f4": "f", "<f8": "d"}


def _flat(name: str, base: int) -> list[tuple[str, int, int]]:
    """Returns (numpy code, count, offset) of every field, with the fields of nested structs."""
    found = []
    for field, code, shape, offset in _layout.STRUCTS[name][2]:
        if code == "Pose":
            found += _flat("Pose", base + offset)
        elif not field.startswith("reserved"):
            found.append((code, shape[0] if shape else 1, base + offset))
    return found


FRAME_HEADER = _dtype("FrameHeader")
SNAPSHOT_HEADER = _dtype("SnapshotHeader")
RESULT_HEADER = _dtype("ResultHeader")
INPUT_RECORD = _dtype("InputRecord")
DVS_EVENT = _dtype("DvsEvent")
LIDAR_POINT = _dtype("LidarPoint")
SEMANTIC_LIDAR_POINT = _dtype("SemanticLidarPoint")
LIDAR_RETURN = _dtype("LidarReturn")
IMU_SAMPLE = _dtype("ImuSample")
GNSS_SAMPLE = _dtype("GnssSample")
RADAR_DETECTION = _dtype("RadarDetection")
COLLISION_EVENT = _dtype("CollisionEvent")
LANE_CROSSING = _dtype("LaneCrossing")
OBSTACLE_EVENT = _dtype("ObstacleEvent")
ACTOR = _dtype("ActorRecord")
VEHICLE_PART = _dtype("VehiclePart")
TRAFFIC_LIGHT_PART = _dtype("TrafficLightPart")
WALKER_PART = _dtype("WalkerPart")
VEHICLE_CONTROL = _dtype("VehicleControlRecord")
BOX2D = _dtype("Box2d")
BOX3D = _dtype("Box3d")
TRACK = _dtype("Track")
MASK = _dtype("MaskRecord")
KEYPOINT_SET = _dtype("KeypointSet")
KEYPOINT = _dtype("Keypoint")
POSE_ESTIMATE = _dtype("PoseEstimate")
ODOMETRY = _dtype("Odometry")
PATH_POINT = _dtype("PathPoint")
SCALAR = _dtype("Scalar")
RUN = np.dtype("<u4")

# By modality: the type of an element's parts and their number; 0 stands for an element that is one
# scalar or struct.
ELEMENTS: dict[str, tuple[np.dtype[Any], int]] = {
    "rgb": (np.dtype("u1"), 4),
    "depth": (np.dtype("<f4"), 0),
    "semantic": (np.dtype("u1"), 0),
    "instance": (np.dtype("<u4"), 0),
    "flow": (np.dtype("<f4"), 2),
    "normals": (np.dtype("<f2"), 4),
    "dvs": (DVS_EVENT, 0),
    "lidar": (LIDAR_POINT, 0),
    "semantic_lidar": (SEMANTIC_LIDAR_POINT, 0),
    "imu": (IMU_SAMPLE, 0),
    "gnss": (GNSS_SAMPLE, 0),
    "radar": (RADAR_DETECTION, 0),
    "collision": (COLLISION_EVENT, 0),
    "lane_invasion": (LANE_CROSSING, 0),
    "obstacle": (OBSTACLE_EVENT, 0),
    "lidar_returns": (LIDAR_RETURN, 0),
}
native.set_elements([(name, dtype, parts) for name, (dtype, parts) in ELEMENTS.items()])

# The same by the name of a pixel format.
PIXELS: dict[str, tuple[np.dtype[Any], int]] = {
    "bgra8": (np.dtype("u1"), 4),
    "depth": ELEMENTS["depth"],
    "class": ELEMENTS["semantic"],
    "id": ELEMENTS["instance"],
    "flow": ELEMENTS["flow"],
    "normals": ELEMENTS["normals"],
    "bgr8": (np.dtype("u1"), 3),
    "rgb8": (np.dtype("u1"), 3),
    "rgba8": (np.dtype("u1"), 4),
    "mono8": (np.dtype("u1"), 0),
    "mono16": (np.dtype("<u2"), 0),
    "mono32f": (np.dtype("<f4"), 0),
}

# Pixel format of the types of results that have only one.
ONLY_FORMAT = {"flow": "flow", "depth": "depth", "semantic": "class", "instance": "id"}

# Elements of tensors and of points' fields, by name.
SCALARS: dict[str, np.dtype[Any]] = {
    "u8": np.dtype("u1"),
    "i8": np.dtype("i1"),
    "u16": np.dtype("<u2"),
    "i16": np.dtype("<i2"),
    "u32": np.dtype("<u4"),
    "i32": np.dtype("<i4"),
    "u64": np.dtype("<u8"),
    "i64": np.dtype("<i8"),
    "f16": np.dtype("<f2"),
    "f32": np.dtype("<f4"),
    "f64": np.dtype("<f8"),
    "bool": np.dtype("?"),
}

# Records of the types of results that are lists.
RECORDS: dict[str, np.dtype[Any]] = {
    "boxes2d": BOX2D,
    "boxes3d": BOX3D,
    "tracks": TRACK,
    "masks": MASK,
    "keypoints": KEYPOINT_SET,
    "pose": POSE_ESTIMATE,
    "odometry": ODOMETRY,
    "path": PATH_POINT,
    "control": VEHICLE_CONTROL,
    "scalars": SCALAR,
}

# What lies behind the records, of the types that have it.
TAILS: dict[str, np.dtype[Any]] = {"masks": RUN, "keypoints": KEYPOINT}


def scalar_name(dtype: np.dtype[Any]) -> str | None:
    """Returns the name of a tensor's elements of this type; None if there is no such tensor."""
    return next((name for name, known in SCALARS.items() if known == dtype), None)
