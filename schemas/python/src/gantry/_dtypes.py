"""Structured numpy types of all records on the bus, made from the generated layout."""

from __future__ import annotations

import struct

import numpy as np

from . import _layout


def _dtype(name: str) -> np.dtype:
    _, size, fields = _layout.STRUCTS[name]
    formats = [(_dtype("Pose") if code == "Pose" else np.dtype(code), shape) for _, code, shape, _ in fields]
    return np.dtype({
        "names": [field[0] for field in fields],
        "formats": [(base, shape) if shape else base for base, shape in formats],
        "offsets": [field[3] for field in fields],
        "itemsize": size,
    })


def unpacker(name: str) -> struct.Struct:
    """Returns a `struct.Struct` that reads all fields but `reserved…` as a flat tuple of numbers.

    Reading a numpy record field by field takes thirty times as long, which delays a reader that
    has just been woken.
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
DOCUMENT_HEADER = _dtype("DocumentHeader")
REQUEST_HEADER = _dtype("RequestHeader")
DVS_EVENT = _dtype("DvsEvent")
LIDAR_POINT = _dtype("LidarPoint")
SEMANTIC_LIDAR_POINT = _dtype("SemanticLidarPoint")
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

# By modality: the type of an element's parts and their number; 0 stands for an element that is one
# scalar or struct.
ELEMENTS: dict[str, tuple[np.dtype, int]] = {
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
}

IMAGES = ("rgb", "depth", "semantic", "instance", "flow", "normals")
