"""A frame: a typed header, and a read-only view of the payload that keeps the sample alive."""

from __future__ import annotations

import struct
import zlib
from typing import Any, Callable, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from . import _layout
from ._calibration import Calibration, of_header
from ._dtypes import unpacker
from ._errors import FrameFormatError
from ._load import native
from ._patience import PATIENCE
from ._pose import Pose
from ._tensor import Colour, Dtype, Layout, tensor

_UNPACK_HEADER = unpacker("FrameHeader").unpack
_OFFSETS = {name: offset for name, _, _, offset in _layout.STRUCTS["FrameHeader"][2]}
_PLACE_AT, _LENGTH_AT = _OFFSETS["payload_place"], _OFFSETS["payload_bytes"]


def camera_matrix(intrinsics_px: tuple[float, float, float, float]) -> npt.NDArray[np.float64]:
    """Returns the 3 × 3 matrix of `[fx, fy, cx, cy]`, pixels."""
    fx, fy, cx, cy = intrinsics_px
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


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
    #: Focal length and principal point of a pinhole; 0 where it has no meaning, as through a lens that `optics` names.
    intrinsics_px: tuple[float, float, float, float]
    range_limit_m: float
    azimuth_rad: float
    parent_id: int
    n_channels: int
    n_images: int
    #: Bits 0 to 7: number of the lens's model, 0 without one; bit 16: depth is the distance along the ray.
    optics: int
    epoch: int
    rendered_mono_nanos: int
    published_mono_nanos: int
    cpu_copies: int
    ticks_in_flight: int
    payload_place: int
    #: CARLA's distortion; NaN if `optics` names a lens's model, which these four cannot say.
    lens: tuple[float, float, float, float]
    #: CRC-32 of the lens that `optics` names, whose numbers `frame.calibration` has; 0 without one.
    calibration_crc: int

    @classmethod
    def from_bytes(cls, data: Any) -> Header:
        """Reads 256 bytes from any buffer, whatever they are; frames were checked before."""
        numbers: tuple[Any, ...] = _UNPACK_HEADER(data)
        pose = Pose(numbers[17:20], numbers[20:24])
        return cls._make((*numbers[:17], pose, numbers[24:28], *numbers[28:-5], numbers[-5:-1], numbers[-1]))

    @property
    def modality(self) -> str:
        """Name of the modality, which is the last segment of the topic: `rgb`, `depth`, …"""
        return _layout.MODALITIES[self.encoding][0]

    @property
    def intrinsics(self) -> npt.NDArray[np.float64]:
        """Camera matrix, 3 × 3, pixels. The centre of the top-left pixel is (0.5, 0.5)."""
        return camera_matrix(self.intrinsics_px)


class Frame(native.Sample):
    """A frame in shared memory, or on the GPU if its topic was opened with `device="cuda"`.

    `array` and its slices keep the frame's memory borrowed, and a reader may hold only a few frames
    (3 of images and clouds, 4 of small sensors). To keep the data, keep `copy()`. On the GPU there is
    no `array`: `torch()` is the frame as a tensor of torch, sooner than by `torch.from_dlpack`, and
    cupy and jax take it by `from_dlpack`.
    """

    __slots__ = ("_header", "_look")

    _header: Header
    #: Finds the text of `world/info` for a frame that was not read from shared memory.
    _look: Callable[[], str | None]

    @property
    def header(self) -> Header:
        """All fields of the header by name."""
        try:
            return self._header
        except AttributeError:
            self._header = Header.from_bytes(self.header_bytes())
            return self._header

    @property
    def calibration(self) -> Calibration:
        """What the camera's pixels show: its lens, with `project(points)` and `unproject(pixels)`.

        The header says it of a pinhole; the numbers of a lens with a model are in `world/info`, which the
        first frame of a lens looks for, live and in a recording. Raises `FrameFormatError` for a frame
        that is no camera's, or of a batch; `GantryError` if no `world/info` describes the lens.
        """
        header = self.header
        look = getattr(self, "_look", None) or self._look_live
        return of_header(self.header_bytes(), header.optics & 0xFF, header.calibration_crc, look)

    def _look_live(self) -> str | None:
        if self.domain is None:
            return None
        return native.document(self.domain, "world/info", PATIENCE)[3]

    @property
    def image(self) -> npt.NDArray[Any]:
        """`array` of an image. Raises `FrameFormatError` for a list."""
        if not self.is_image:
            raise FrameFormatError(f"a frame of {self.modality} is a list, not an image; use frame.array")
        return self.array

    @property
    def rgb(self) -> npt.NDArray[np.uint8]:
        """The `array` of an `rgb` frame as a view (h, w, 3) uint8 in the order R G B; of a batch, (n, h, w, 3).

        Its last stride is negative, which `torch.from_numpy` does not take: `tensor()` is the copy for
        networks. Raises `FrameFormatError` for another modality.
        """
        if self.modality != "rgb":
            raise FrameFormatError(f"frame.rgb needs a frame of rgb, this is {self.modality}")
        return self.array[..., 2::-1]

    def tensor(
        self,
        *,
        dtype: Dtype = "uint8",
        layout: Layout = "chw",
        colour: Colour = "rgb",
        scale: float | None = None,
        out: Any = None,
        device: Any = None,
    ) -> Any:
        """Returns an `rgb` frame as the dense input of a network, in one pass over the image.

        Planes (3, h, w) with `layout="chw"`, pixels (h, w, 3) with `"hwc"`; 4 colours with `"bgra"`; of a
        batch of cameras with the images in front. `uint8` keeps the bytes; floats are multiplied by
        `scale`, by default 1 / 255, so that they are 0 to 1; `bfloat16` is for torch. The result is an array of numpy, with
        `device` (`"cpu"`, `"cuda"`) a tensor of torch there, and with `out`, an array or a tensor of that
        shape and type which is filled and returned, nothing is allocated; a device gets it through pinned
        memory. It keeps no memory of the frame borrowed. Raises `FrameFormatError` for another modality
        and for a frame that is on the GPU already, whose tensor is `torch()`; `ValueError` for an argument
        that does not fit.
        """
        return tensor(self, dtype, layout, colour, scale, out, device)

    def copy(self) -> npt.NDArray[Any]:
        """Returns a writeable copy of `array`, which keeps no memory borrowed; of a frame on a GPU, too."""
        data = self.device_bytes()
        if data is None:
            return self.array.copy()
        return _array_of(self.header_bytes(), data).copy()

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[Any]:
        array = self.array
        if copy or (dtype is not None and np.dtype(dtype) != array.dtype):
            return np.array(array, dtype=dtype)
        return array

    def __dlpack__(self, **options: Any) -> Any:
        """Hands `array` to another library without a copy: `cupy.from_dlpack(frame)`; see `torch()`.

        The memory is marked as read-only, which takes numpy 2.1 and DLPack 1. Raises `BufferError`
        for a library that cannot say that it reads only, and for structured arrays; hand over
        `frame.copy()` there.

        A frame on a GPU is handed over as memory of its device, lists as bytes (n, element bytes).
        Its memory is other readers', too: do not write to it. It stays as it is until the last
        tensor is gone and the device has done what it was given until then.
        """
        if self.device is not None:
            return self.device_capsule(options.get("stream"))
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self) -> tuple[int, int]:
        """Returns DLPack's kind and number of the device."""
        on_gpu = self.device_number()
        if on_gpu is not None:
            return on_gpu
        kind, number = self.array.__dlpack_device__()
        return int(kind), int(number)

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        found = self.device_interface()
        if found is None:
            raise AttributeError("__cuda_array_interface__: this frame is not on a device of CUDA")
        address, shape, strides, kind = found
        # The bytes were complete before the frame was sent, so nothing has to be waited for.
        return {"shape": tuple(shape), "typestr": kind, "data": (address, True), "version": 3, "strides": tuple(strides), "stream": None}

    @property
    def shape(self) -> tuple[int, ...]:
        """Sizes of the array or tensor."""
        on_gpu = self.device_shape()
        return tuple(self.array.shape) if on_gpu is None else tuple(on_gpu)

    def __len__(self) -> int:
        return self.shape[0]

    def __repr__(self) -> str:
        width, height = self.size
        images = f"{self.n_images}×" if self.n_images else ""
        return f"<gantry.Frame {self.topic or self.modality} tick={self.tick} seq={self.seq} {images}{width}×{height}>"

    def _repr_png_(self) -> bytes | None:
        """Returns a PNG for Jupyter, or None for modalities without an obvious picture; images of a batch one below the other."""
        from ._classes import colour_classes

        if not self.is_image:
            return None
        shown = self.array
        if self.n_images:
            shown = shown.reshape(-1, *shown.shape[2:])
        if self.modality == "rgb":
            return _png(np.ascontiguousarray(shown[..., 2::-1]))
        if self.modality == "semantic":
            return _png(colour_classes(shown))
        if self.modality == "depth":
            with np.errstate(divide="ignore"):
                grey = np.clip(255.0 * 2.0 / (2.0 + np.maximum(shown, 0.0)), 0, 255).astype(np.uint8)
            return _png(np.repeat(grey[..., None], 3, axis=2))
        return None


def _png(rgb: npt.NDArray[np.uint8]) -> bytes:
    """Encodes (h, w, 3) uint8 as PNG."""
    height, width, _ = rgb.shape

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    rows = np.zeros((height, 1 + 3 * width), np.uint8)
    rows[:, 1:] = rgb.reshape(height, -1)
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows.tobytes(), 1)) + chunk(b"IEND", b"")


def _array_of(header: bytes, payload: bytes) -> npt.NDArray[Any]:
    """Shows bytes as the array of a frame with this header, which was checked."""
    own = bytearray(header)
    own[_PLACE_AT : _PLACE_AT + 4] = bytes(4)
    own[_LENGTH_AT : _LENGTH_AT + 8] = len(payload).to_bytes(8, "little")
    return cast(Frame, native.sample_from_bytes(bytes(own) + payload, "")).array


def frame_from_bytes(data: bytes, topic: str = "") -> Frame:
    """Makes a frame from the 256 bytes of its header and its payload, for example of a recording.

    The arrays are read-only views of `data`. Raises `FrameFormatError` or `SchemaVersionError`.
    """
    return cast(Frame, native.sample_from_bytes(bytes(data), topic))


native.set_frame_class(Frame)
