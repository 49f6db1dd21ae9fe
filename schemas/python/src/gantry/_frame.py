"""One frame: a typed header and a read-only view of its payload that keeps the sample alive."""

from __future__ import annotations

import struct
import zlib
from typing import Any, NamedTuple, Optional

import numpy as np

from . import _layout
from ._dtypes import ELEMENTS, FRAME_HEADER, IMAGES, unpacker
from ._errors import FrameFormatError, SchemaVersionError


_UNPACK_HEADER = unpacker("FrameHeader").unpack


class Pose(NamedTuple):
    """A rigid transform: metres and a unit quaternion [x, y, z, w]."""

    translation_m: tuple[float, float, float]
    rotation_xyzw: tuple[float, float, float, float]

    def matrix(self) -> np.ndarray:
        """As a 4 × 4 matrix, target_from_source."""
        x, y, z, w = self.rotation_xyzw
        out = np.eye(4)
        out[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        out[:3, 3] = self.translation_m
        return out


class Header(NamedTuple):
    """The fields of `GantryFrameHeader`, see SPEC.md §3."""

    magic: int
    schema_version: int
    header_bytes: int
    sensor_id: int
    kind: int
    encoding: int
    tick: int
    sim_nanos: int
    seq: int
    episode: int
    flags: int
    payload_bytes: int
    width: int
    height: int
    row_stride: int
    element_bytes: int
    window_nanos: int
    world_from_sensor: Pose
    intrinsics_px: tuple[float, float, float, float]
    range_limit_m: float
    azimuth_rad: float
    parent_id: int
    n_channels: int
    epoch: int
    rendered_mono_nanos: int
    published_mono_nanos: int
    cpu_copies: int
    ticks_in_flight: int
    payload_place: int

    @classmethod
    def from_bytes(cls, data: Any) -> "Header":
        """Reads 256 bytes (any buffer); call `check` before believing them."""
        numbers = _UNPACK_HEADER(data)
        pose = Pose(numbers[17:20], numbers[20:24])
        return cls(*numbers[:17], pose, numbers[24:28], *numbers[28:])

    @property
    def modality(self) -> str:
        """Last segment of the topic: `rgb`, `depth`, …"""
        return _layout.MODALITIES[self.encoding][0]

    @property
    def intrinsics(self) -> np.ndarray:
        """3 × 3 camera matrix; pixel centres lie at half numbers."""
        fx, fy, cx, cy = self.intrinsics_px
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])

    def check(self, sample_bytes: int) -> None:
        """Refuses a header that contradicts itself or its sample. Same rules as in Rust."""
        if self.magic != _layout.FRAME_MAGIC:
            raise FrameFormatError(f"frame starts with {self.magic:#010x}, not with the magic \"GFRM\"; the publisher is not Gantry's")
        if self.schema_version != _layout.SCHEMA_VERSION or self.header_bytes != FRAME_HEADER.itemsize:
            raise SchemaVersionError(
                f"frame carries schema {self.schema_version}, this reader understands {_layout.SCHEMA_VERSION}; "
                "install the gantry package of the simulator's version"
            )
        if self.encoding not in _layout.MODALITIES:
            raise FrameFormatError(f"frame has encoding {self.encoding}, known are 1 to {max(_layout.MODALITIES)}")
        if self.payload_bytes > sample_bytes:
            raise FrameFormatError(f"frame claims {self.payload_bytes} payload bytes, its sample holds {sample_bytes}")
        row = self.width * self.element_bytes
        needed = 0 if self.height == 0 else (self.height - 1) * self.row_stride + row
        wrong_element = self.element_bytes != _layout.MODALITIES[self.encoding][1]
        if wrong_element or (self.height > 1 and self.row_stride < row) or needed > self.payload_bytes:
            raise FrameFormatError(
                f"frame of {self.width} × {self.height} elements of {self.element_bytes} bytes, {self.row_stride} bytes a row, "
                f"does not fit its {self.payload_bytes} payload bytes"
            )


class _Hold:
    """numpy's base object: as long as an array is alive, so is the sample whose memory it shows."""

    __slots__ = ("sample", "__array_interface__")

    def __init__(self, sample: Any, n_bytes: int) -> None:
        self.sample = sample
        # True: read-only. The mapping is, and a write through numpy would be a segmentation fault instead of an exception.
        self.__array_interface__ = {"version": 3, "shape": (n_bytes,), "typestr": "|u1", "data": (sample.payload_ptr, True)}


def _view(header: Header, data: np.ndarray) -> np.ndarray:
    """The payload as an array of its modality; honours padded rows; never copies."""
    name = header.modality
    if name not in ELEMENTS:
        return data[: header.payload_bytes].reshape(-1, header.element_bytes)
    dtype, parts = ELEMENTS[name]
    tail_shape, tail_strides = ((parts,), (dtype.itemsize,)) if parts else ((), ())
    if name in IMAGES:
        shape, strides = (header.height, header.width), (header.row_stride, header.element_bytes)
    else:
        shape, strides = (header.width,), (header.element_bytes,)
    shape, strides = shape + tail_shape, strides + tail_strides
    if 0 in shape:
        empty = np.empty(shape, dtype)
        empty.flags.writeable = False
        return empty
    return np.ndarray(shape, dtype, buffer=data, strides=strides)


class Frame:
    """A frame in shared memory.

    `array` and everything made from it by slicing keep the frame's memory borrowed, and a reader may hold only a few frames
    (3 of images and clouds): keep `copy()` instead.
    """

    __slots__ = ("header", "topic", "_data", "_array")

    def __init__(self, header: Header, data: Any, topic: str = "") -> None:
        #: Every field of the header.
        self.header = header
        #: Topic it came from.
        self.topic = topic
        self._data = data
        self._array: Optional[np.ndarray] = None

    @property
    def array(self) -> np.ndarray:
        """Read-only view. Images: (h, w), (h, w, 2) flow, (h, w, 4) rgb as B G R A and normals; lists: structured, (n,)."""
        if self._array is None:
            self._array = _view(self.header, np.asarray(self._data))
        return self._array

    @classmethod
    def of_sample(cls, sample: Any, header_bytes: Any, sample_bytes: int, topic: str) -> "Frame":
        """Checks and wraps a sample of iceoryx2."""
        header = Header.from_bytes(header_bytes)
        header.check(sample_bytes)
        return cls(header, _Hold(sample, sample_bytes), topic)

    @property
    def tick(self) -> int:
        """Simulation step this frame shows."""
        return self.header.tick

    @property
    def sim_time(self) -> float:
        """Simulated time, seconds since the daemon started."""
        return self.header.sim_nanos * 1e-9

    @property
    def modality(self) -> str:
        """`rgb`, `depth`, …"""
        return self.header.modality

    @property
    def image(self) -> np.ndarray:
        """`array` of an image; raises for a list."""
        if self.modality not in IMAGES:
            raise FrameFormatError(f"a frame of {self.modality} is a list, not an image; use frame.array")
        return self.array

    @property
    def rgb(self) -> np.ndarray:
        """An `rgb` frame as (h, w, 3) in the order R G B, still a view."""
        if self.modality != "rgb":
            raise FrameFormatError(f"frame.rgb needs a frame of rgb, this is {self.modality}")
        return self.array[..., 2::-1]

    def copy(self) -> np.ndarray:
        """The payload as an array of its own: writeable, and it keeps nothing borrowed."""
        return self.array.copy()

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> np.ndarray:
        if copy or (dtype is not None and np.dtype(dtype) != self.array.dtype):
            return np.array(self.array, dtype=dtype)
        return self.array

    def __len__(self) -> int:
        return len(self.array)

    def __repr__(self) -> str:
        h = self.header
        return f"<gantry.Frame {self.topic or self.modality} tick={h.tick} seq={h.seq} {h.width}×{h.height}>"

    def _repr_png_(self) -> Optional[bytes]:
        """A picture for Jupyter."""
        from ._classes import colour_classes

        if self.modality == "rgb":
            return _png(np.ascontiguousarray(self.rgb))
        if self.modality == "semantic":
            return _png(colour_classes(self.array))
        if self.modality == "depth":
            with np.errstate(divide="ignore"):
                grey = np.clip(255.0 * 2.0 / (2.0 + np.maximum(self.array, 0.0)), 0, 255).astype(np.uint8)
            return _png(np.repeat(grey[..., None], 3, axis=2))
        return None


def _png(rgb: np.ndarray) -> bytes:
    """Encodes (h, w, 3) bytes."""
    height, width, _ = rgb.shape

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    rows = np.zeros((height, 1 + 3 * width), np.uint8)
    rows[:, 1:] = rgb.reshape(height, -1)
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows.tobytes(), 1)) + chunk(b"IEND", b"")


def frame_from_bytes(data: bytes, topic: str = "") -> Frame:
    """A frame from 256 header bytes and its payload, for example out of a recording. No copy; read-only."""
    if len(data) < FRAME_HEADER.itemsize:
        raise FrameFormatError(f"{len(data)} bytes are no frame; its header alone has {FRAME_HEADER.itemsize}")
    header = Header.from_bytes(data[: FRAME_HEADER.itemsize])
    header.check(len(data) - FRAME_HEADER.itemsize)
    return Frame(header, np.frombuffer(data, np.uint8, offset=FRAME_HEADER.itemsize), topic)
