"""Gantry for Python: sensor frames and results in shared memory as numpy arrays, without a copy.

`open` reads one topic, `sync` several topics tick by tick, `attach` the sensor of a CARLA client,
each blocking, in threads, or with `async for`. `publish` writes results on a topic of your own.
`lockstep` steps with the simulator, `vehicle` and `control` drive. `snapshot`, `snapshot_at` and
`document` read the world, `command` changes it; `pause`, `step`, `set_speed` and `seek` rule its time.
`Recording` reads a file. Units are SI (metres, seconds, radians); world, vehicle and sensor axes are
x forward, y left, z up. Without `domain=` the domain is that of the environment's `GANTRY_DOMAIN`,
else `gantry`. Whatever waits has `PATIENCE`, 10 s, unless it is given a `timeout`; loops end when
what they read has ended. Every error of the bus is a `GantryError` whose message says what to do.
`schemas/schema_frames/SPEC.md` describes every field. A process that was forked after the import
cannot use this package: start processes with `multiprocessing`'s "spawn".

>>> import gantry
>>> with gantry.open("ego/front/rgb") as camera:        # doctest: +SKIP
...     for frame in camera:
...         print(frame.tick, frame.array.shape)
"""

from ._load import native as _native_module  # noqa: F401 - first, because it checks the native half
from ._actors import Actor, World, ego, spawn, world
from ._attach import attach
from ._calibration import Calibration
from ._checkpoint import reset, restore_checkpoint, save_checkpoint
from ._classes import CLASS_COLOURS, CLASS_NAMES, colour_classes
from ._command import command
from ._control import Vehicle, control, vehicle
from ._dtypes import (
    ACTOR,
    BOX2D,
    BOX3D,
    COLLISION_EVENT,
    DVS_EVENT,
    GNSS_SAMPLE,
    IMU_SAMPLE,
    KEYPOINT,
    KEYPOINT_SET,
    LANE_CROSSING,
    LIDAR_POINT,
    LIDAR_RETURN,
    MASK,
    OBSTACLE_EVENT,
    ODOMETRY,
    PATH_POINT,
    POSE_ESTIMATE,
    RADAR_DETECTION,
    SCALAR,
    SEMANTIC_LIDAR_POINT,
    TRACK,
    TRAFFIC_LIGHT_PART,
    VEHICLE_CONTROL,
    VEHICLE_PART,
    WALKER_PART,
)
from ._errors import (
    BorrowLimitError,
    FrameFormatError,
    GantryError,
    NoSuchTopicError,
    SchemaVersionError,
    TimedOutError,
    TooManyReadersError,
    TopicTakenError,
)
from ._frame import Frame, Header, frame_from_bytes
from ._layout import SCHEMA_VERSION
from ._lockstep import Lockstep, LockstepRow, LockstepRows, Tick, lockstep
from ._patience import PATIENCE
from ._play import pause, resume, seek, set_speed, step
from ._pose import Pose
from ._publish import RESULT_TYPES, BytesSchema, Loan, Publisher, publish
from ._publish_gpu import GpuArray, GpuLoan, GpuPublisher
from ._query import cast_rays, clear_drawing, draw
from ._records import RecordsAndTail, boxes2d, boxes3d, keypoints, masks, odometry, path, pose, scalars, tracks
from ._recording import Message, RecordedTopic, Recording
from ._rerun import rerun
from ._result import Input, Result, ResultHeader, result_from_bytes
from ._result_file import ResultFile
from ._sync import Row, Sync, sync
from ._topic import Counts, Topic, open
from ._topics import BatchCamera, TopicDetails, topics
from ._world import Document, Snapshot, document, snapshot, snapshot_at

__all__ = [
    "ACTOR", "Actor", "BOX2D", "BOX3D", "BatchCamera", "BorrowLimitError", "BytesSchema", "Calibration", "CLASS_COLOURS", "CLASS_NAMES", "COLLISION_EVENT", "Counts", "DVS_EVENT",
    "Document", "Frame", "FrameFormatError", "GNSS_SAMPLE", "GantryError", "GpuArray", "GpuLoan", "GpuPublisher", "Header", "IMU_SAMPLE", "Input", "KEYPOINT", "KEYPOINT_SET",
    "LANE_CROSSING", "LIDAR_POINT", "LIDAR_RETURN", "Loan", "Lockstep", "LockstepRow", "LockstepRows", "MASK", "Message", "NoSuchTopicError", "OBSTACLE_EVENT", "ODOMETRY", "PATH_POINT", "PATIENCE",
    "POSE_ESTIMATE", "Pose", "Publisher", "RADAR_DETECTION", "RESULT_TYPES", "RecordedTopic", "Recording", "RecordsAndTail", "Result", "ResultFile", "ResultHeader", "Row", "SCALAR",
    "SCHEMA_VERSION", "SEMANTIC_LIDAR_POINT", "SchemaVersionError", "Snapshot", "Sync", "TRACK", "TRAFFIC_LIGHT_PART", "Tick", "TimedOutError",
    "TooManyReadersError", "Topic", "TopicDetails", "TopicTakenError", "VEHICLE_CONTROL", "VEHICLE_PART", "Vehicle", "WALKER_PART", "World", "attach",
    "boxes2d", "boxes3d", "cast_rays", "clear_drawing", "colour_classes", "command", "control", "document", "draw", "ego", "frame_from_bytes",
    "keypoints", "lockstep", "masks", "odometry", "open", "path", "pause", "pose", "publish", "rerun", "reset", "restore_checkpoint", "result_from_bytes",
    "resume", "save_checkpoint", "scalars", "seek", "set_speed", "snapshot", "snapshot_at", "spawn", "step", "sync", "topics", "tracks", "vehicle",
    "world",
]  # fmt: skip
