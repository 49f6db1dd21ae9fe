"""Gantry for Python: sensor frames as read-only numpy arrays in shared memory, without a copy.

`open` reads one topic, `sync` several topics tick by tick, `attach` the sensor of a CARLA client.
`snapshot` and `document` read the world, `command` changes it. Units are SI (metres, seconds,
radians); world, vehicle and sensor axes are x forward, y left, z up. Every error is a `GantryError`
whose message says what to do. `schemas/schema_frames/SPEC.md` describes every field.

>>> import gantry
>>> with gantry.open("ego/front/rgb") as camera:        # doctest: +SKIP
...     for frame in camera:
...         print(frame.tick, frame.array.shape)
"""

from ._attach import attach
from ._bus import TopicDetails, topics
from ._checkpoint import reset, restore_checkpoint, save_checkpoint
from ._classes import CLASS_COLOURS, CLASS_NAMES, colour_classes
from ._command import command
from ._dtypes import (
    ACTOR,
    COLLISION_EVENT,
    DVS_EVENT,
    GNSS_SAMPLE,
    IMU_SAMPLE,
    LANE_CROSSING,
    LIDAR_POINT,
    OBSTACLE_EVENT,
    RADAR_DETECTION,
    SEMANTIC_LIDAR_POINT,
    TRAFFIC_LIGHT_PART,
    VEHICLE_PART,
    WALKER_PART,
)
from ._errors import (
    BorrowLimitError,
    FrameFormatError,
    GantryError,
    NoSuchTopicError,
    SchemaVersionError,
    TooManyReadersError,
)
from ._frame import Frame, Header, Pose, frame_from_bytes
from ._layout import SCHEMA_VERSION
from ._query import cast_rays, clear_drawing, draw
from ._topic import Counts, Topic, open
from ._sync import Row, Sync, sync
from ._world import Document, Snapshot, document, snapshot

__all__ = [
    "ACTOR", "BorrowLimitError", "CLASS_COLOURS", "CLASS_NAMES", "COLLISION_EVENT", "Counts", "DVS_EVENT", "Document", "Frame", "FrameFormatError", "GNSS_SAMPLE",
    "GantryError", "Header", "IMU_SAMPLE", "LANE_CROSSING", "LIDAR_POINT", "NoSuchTopicError", "OBSTACLE_EVENT", "Pose", "RADAR_DETECTION", "Row", "SCHEMA_VERSION", "SEMANTIC_LIDAR_POINT",
    "SchemaVersionError", "Snapshot", "Sync", "TRAFFIC_LIGHT_PART", "TooManyReadersError", "Topic", "TopicDetails", "VEHICLE_PART",
    "WALKER_PART", "attach", "cast_rays", "clear_drawing", "colour_classes", "command", "document", "draw", "frame_from_bytes", "open",
    "reset", "restore_checkpoint", "save_checkpoint", "snapshot", "sync", "topics",
]
