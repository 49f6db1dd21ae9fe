"""Structured numpy types of everything on the bus, from the generated layout."""

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
    """One call that reads a whole struct into a flat tuple of numbers; fields called `reserved…` are passed over.

    Reading a numpy record field by field costs thirty times as much, which a reader that has just been woken feels.
    """
    parts, at = ["<"], 0
    for code, count, offset in _flat(name, 0):
        parts.append(f"{offset - at}x{count}{_STRUCT_CODES[code]}")
        at = offset + count * np.dtype(code).itemsize
    return struct.Struct("".join([*parts, f"{_layout.STRUCTS[name][1] - at}x"]))


_STRUCT_CODES = {"u1": "B", "<u2": "H", "<u4": "I", "<u8": "Q", "<i4": "i", "<i8": "q", "<f4": "f", "<f8": "d"}


def _flat(name: str, base: int) -> list[tuple[str, int, int]]:
    """(numpy code, count, offset) of every field, nested structs opened."""
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

# Modality name -> (type of one element's parts, how many parts; 0: one structured or scalar element).
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
