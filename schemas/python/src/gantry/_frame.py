"""A frame: a typed header, and a read-only view of the payload that keeps the sample alive."""

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
    """A rigid transform target_from_source."""

    #: Position of the source's origin in the target, metres.
    translation_m: tuple[float, float, float]
    #: Unit quaternion [x, y, z, w].
    rotation_xyzw: tuple[float, float, float, float]

    def matrix(self) -> np.ndarray:
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


class Header(NamedTuple):
    """The fields of `GantryFrameHeader` by name; SPEC.md §3 says what they mean."""

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
        """Reads 256 bytes from any buffer. Call `check` before relying on the values."""
        numbers = _UNPACK_HEADER(data)
        pose = Pose(numbers[17:20], numbers[20:24])
        return cls(*numbers[:17], pose, numbers[24:28], *numbers[28:])

    @property
    def modality(self) -> str:
        """Name of the modality, which is the last segment of the topic: `rgb`, `depth`, …"""
        return _layout.MODALITIES[self.encoding][0]

    @property
    def intrinsics(self) -> np.ndarray:
        """Camera matrix, 3 × 3, pixels. The centre of the top-left pixel is (0.5, 0.5)."""
        fx, fy, cx, cy = self.intrinsics_px
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])

    def check(self, sample_bytes: int) -> None:
        """Checks the header against itself and the sample's length, by the same rules as in Rust.

        Raises `FrameFormatError`, or `SchemaVersionError` for another version of the layouts.
        """
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
    """The base object of arrays: it keeps the sample alive whose memory they show."""

    __slots__ = ("sample", "__array_interface__")

    def __init__(self, sample: Any, n_bytes: int) -> None:
        self.sample = sample
        # True means read-only. The mapping is read-only, so that a write through numpy would be a
        # segmentation fault instead of an exception.
        self.__array_interface__ = {"version": 3, "shape": (n_bytes,), "typestr": "|u1", "data": (sample.payload_ptr, True)}


def _view(header: Header, data: np.ndarray) -> np.ndarray:
    """Returns the payload as an array of its modality, without a copy, also of padded rows."""
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

    `array` and its slices keep the frame's memory borrowed, and a reader may hold only a few frames
    (3 of images and clouds, 4 of small sensors). To keep the data, keep `copy()`.
    """

    __slots__ = ("header", "topic", "_data", "_array")

    def __init__(self, header: Header, data: Any, topic: str = "") -> None:
        #: The header.
        self.header = header
        #: Topic without the domain; empty for a frame from bytes.
        self.topic = topic
        self._data = data
        self._array: Optional[np.ndarray] = None

    @property
    def array(self) -> np.ndarray:
        """The payload as a read-only view.

        Images by modality: `rgb` (h, w, 4) uint8 in the order B G R A; `depth` (h, w) float32,
        metres along the optical axis, +inf where nothing was hit; `semantic` (h, w) uint8 class
        numbers; `instance` (h, w) uint32 object ids; `flow` (h, w, 2) float32 pixels, x right and
        y down; `normals` (h, w, 4) float16, unit normal in world space and a zero.
        All others: a structured array (n,) with the fields of SPEC.md §4.
        """
        if self._array is None:
            self._array = _view(self.header, np.asarray(self._data))
        return self._array

    @classmethod
    def of_sample(cls, sample: Any, header_bytes: Any, sample_bytes: int, topic: str) -> "Frame":
        """Wraps a sample of iceoryx2, whose header is checked. Raises as `Header.check`."""
        header = Header.from_bytes(header_bytes)
        header.check(sample_bytes)
        return cls(header, _Hold(sample, sample_bytes), topic)

    @property
    def tick(self) -> int:
        """Tick this frame shows."""
        return self.header.tick

    @property
    def sim_time(self) -> float:
        """Simulated time, seconds since the daemon started."""
        return self.header.sim_nanos * 1e-9

    @property
    def modality(self) -> str:
        """Name of the modality: `rgb`, `depth`, …"""
        return self.header.modality

    @property
    def image(self) -> np.ndarray:
        """`array` of an image. Raises `FrameFormatError` for a list."""
        if self.modality not in IMAGES:
            raise FrameFormatError(f"a frame of {self.modality} is a list, not an image; use frame.array")
        return self.array

    @property
    def rgb(self) -> np.ndarray:
        """The `array` of an `rgb` frame as a view (h, w, 3) uint8 in the order R G B.

        Raises `FrameFormatError` for another modality.
        """
        if self.modality != "rgb":
            raise FrameFormatError(f"frame.rgb needs a frame of rgb, this is {self.modality}")
        return self.array[..., 2::-1]

    def copy(self) -> np.ndarray:
        """Returns a writeable copy of `array`, which keeps no shared memory borrowed."""
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
        """Returns a PNG for Jupyter, or None for modalities without an obvious picture."""
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
    """Encodes (h, w, 3) uint8 as PNG."""
    height, width, _ = rgb.shape

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    rows = np.zeros((height, 1 + 3 * width), np.uint8)
    rows[:, 1:] = rgb.reshape(height, -1)
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows.tobytes(), 1)) + chunk(b"IEND", b"")


def frame_from_bytes(data: bytes, topic: str = "") -> Frame:
    """Makes a frame from the 256 bytes of its header and its payload, for example of a recording.

    The arrays are read-only views of `data`. Raises `FrameFormatError` or `SchemaVersionError`.
    """
    if len(data) < FRAME_HEADER.itemsize:
        raise FrameFormatError(f"{len(data)} bytes are no frame; its header alone has {FRAME_HEADER.itemsize}")
    header = Header.from_bytes(data[: FRAME_HEADER.itemsize])
    header.check(len(data) - FRAME_HEADER.itemsize)
    return Frame(header, np.frombuffer(data, np.uint8, offset=FRAME_HEADER.itemsize), topic)
