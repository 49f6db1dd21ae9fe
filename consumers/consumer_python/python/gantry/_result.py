"""Results: what programs say about frames, read in place."""

from __future__ import annotations

import functools
import importlib
import json
from typing import Any, Iterable, NamedTuple

import numpy as np
import numpy.typing as npt

from . import _layout
from ._classes import CLASS_NAMES
from ._dtypes import INPUT_RECORD, PIXELS, RECORDS, SCALARS, TAILS, unpacker
from ._errors import FrameFormatError
from ._frame import camera_matrix
from ._load import native
from ._pose import Pose

_UNPACK_HEADER = unpacker("ResultHeader").unpack
#: Offset and length of the header's numbers, bytes.
_PLACES = {name: (offset, np.dtype(kind).itemsize) for name, kind, sizes, offset in _layout.STRUCTS["ResultHeader"][2] if kind[1] == "u" and not sizes}
#: Fields of points whose topic names none.
_USUAL_POINT = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity")])


class ResultHeader(NamedTuple):
    """The fields of `GantryResultHeader` by name; SPEC.md §9 says what they mean."""

    magic: int
    schema_version: int
    header_bytes: int
    result_type: int
    encoding: int
    flags: int
    tick: int
    sim_nanos: int
    seq: int
    episode: int
    n_inputs: int
    payload_bytes: int
    body_bytes: int
    width: int
    height: int
    row_stride: int
    element_bytes: int
    n_items: int
    n_dims: int
    shape: tuple[int, ...]
    world_from_space: Pose
    intrinsics_px: tuple[float, float, float, float]
    space: int
    epoch: int
    writer_epoch: int
    origin_mono_nanos: int
    taken_mono_nanos: int
    published_mono_nanos: int
    payload_place: int

    @classmethod
    def from_bytes(cls, data: Any) -> ResultHeader:
        """Reads 320 bytes from any buffer, whatever they are; results were checked before."""
        numbers: tuple[Any, ...] = _UNPACK_HEADER(data)
        pose = Pose(numbers[27:30], numbers[30:34])
        return cls._make((*numbers[:19], numbers[19:27][: numbers[18]], pose, numbers[34:38], *numbers[38:]))

    @property
    def intrinsics(self) -> npt.NDArray[np.float64]:
        """Camera matrix of the image that it answers, 3 × 3, pixels."""
        return camera_matrix(self.intrinsics_px)


class Input(NamedTuple):
    """A frame or a result that a result was computed from."""

    #: Topic without the domain.
    topic: str
    #: Its tick.
    tick: int
    #: Its number.
    seq: int
    #: Its simulated time, nanoseconds.
    sim_nanos: int
    #: Its epoch; of a result that of its writer.
    epoch: int
    #: `CLOCK_MONOTONIC` just before it was sent.
    published_mono_nanos: int
    #: `CLOCK_MONOTONIC` at which the writer of the result had it in hand.
    taken_mono_nanos: int


class About:
    """A description that was given instead of read, for results from bytes."""

    def __init__(self, known: dict[str, Any]) -> None:
        self._text = json.dumps(known)

    def text(self) -> str | None:
        """Returns the description as JSON."""
        return self._text


@functools.lru_cache(maxsize=64)
def _parsed(text: str | None) -> dict[str, Any]:
    return {} if text is None else dict(json.loads(text))


def class_names(about: native.About | About | None) -> list[str]:
    """Returns the names of a topic's classes, which are CARLA's if it names none."""
    return list(_parsed(about.text() if about else None).get("classes") or CLASS_NAMES)


@functools.lru_cache(maxsize=64)
def _point(text: str | None, element_bytes: int) -> np.dtype[Any]:
    """Returns the type of a point of this many bytes."""
    fields = _parsed(text).get("fields")
    if not fields:
        return _USUAL_POINT if element_bytes == _USUAL_POINT.itemsize else np.dtype(f"V{element_bytes}")
    spec: Any = {
        "names": [field["name"] for field in fields],
        "formats": [SCALARS[field["type"]] for field in fields],
        "offsets": [field["offset"] for field in fields],
        "itemsize": element_bytes,
    }
    dtype: np.dtype[Any] = np.dtype(spec)
    return dtype


def _padded_text(data: Any) -> str:
    return bytes(data).split(b"\0", 1)[0].decode(errors="replace")


class Result:
    """A result in shared memory, or on the GPU if its topic was opened with `device="cuda"`.

    `array` and its slices keep it borrowed, and a reader may hold only a few (usually 3 of large
    types, 4 of others). To keep the data, keep `copy()`. On the GPU there is no `array`: `torch()`,
    `cupy.from_dlpack(result)` and their like show it where it is.
    """

    __slots__ = ("topic", "_outcome", "_about", "_header", "_array")

    def __init__(self, outcome: native.Outcome, topic: str, about: native.About | About) -> None:
        #: Topic without the domain; empty for a result from bytes.
        self.topic = topic
        self._outcome = outcome
        self._about = about
        self._header: ResultHeader | None = None
        self._array: npt.NDArray[Any] | None = None

    @property
    def type(self) -> str:
        """Type of the result: `boxes2d`, `tensor`, …"""
        return self._outcome.kind

    @property
    def header(self) -> ResultHeader:
        """All fields of the header by name."""
        if self._header is None:
            self._header = ResultHeader.from_bytes(self._outcome.header_bytes())
        return self._header

    @property
    def tick(self) -> int:
        """Tick that the result is about."""
        return self._outcome.tick

    @property
    def seq(self) -> int:
        """Number of the result, counted by its writer from 1; a gap is a loss."""
        return self._outcome.seq

    @property
    def epoch(self) -> int:
        """Epoch of the simulator whose frames it answers; 0 without one."""
        return self._outcome.epoch

    @property
    def sim_time(self) -> float:
        """Simulated time of its tick, seconds."""
        return self._outcome.sim_nanos * 1e-9

    @property
    def age_ms(self) -> float | None:
        """Age of the oldest frame behind it, through all results between, when it was sent; None without one."""
        origin = self.header.origin_mono_nanos
        return (self.header.published_mono_nanos - origin) * 1e-6 if origin else None

    @property
    def device(self) -> str | None:
        """Device of the body: `cuda:0` and so on; None in shared memory."""
        return self._outcome.device

    @property
    def shape(self) -> tuple[int, ...]:
        """Sizes of the array or tensor."""
        on_gpu = self._outcome.device_shape()
        return tuple(self.array.shape) if on_gpu is None else tuple(on_gpu)

    @property
    def space(self) -> str:
        """Space of its numbers: `image`, `sensor`, `vehicle`, `world` or `none`."""
        return _layout.SPACES[self.header.space]

    @property
    def inputs(self) -> list[Input]:
        """The frames and results that it was computed from."""
        records = np.frombuffer(self._outcome.inputs_bytes(), INPUT_RECORD)
        names = [name for name in Input._fields if name != "topic"]
        return [Input(_padded_text(record["topic"]), *(int(record[name]) for name in names)) for record in records]

    @property
    def classes(self) -> list[str]:
        """Names of the classes that the result numbers."""
        return class_names(self._about)

    @property
    def array(self) -> npt.NDArray[Any]:
        """The body as a read-only view.

        `image` (h, w) or (h, w, c) in its format (`format`); `depth`, `semantic`, `instance`, `flow`
        as of a frame; `tensor` its own type and shape; `points` a structured array (n,) with the
        topic's fields; `text`, `json` and `bytes` (n,) uint8; all others a structured array (n,) of
        their records (`gantry.BOX2D`, …), for which SPEC.md §9 has units.
        """
        if self._array is None:
            self._array = self._view()
        return self._array

    @property
    def format(self) -> str:
        """Pixel format of an image, element type of a tensor; otherwise empty."""
        tables: dict[str, dict[int, tuple[str, int]]] = {"tensor": _layout.ELEMENT_TYPES}
        table = tables.get(self.type, _layout.PIXEL_FORMATS)
        return table.get(self.header.encoding, ("", 0))[0]

    def _view(self) -> npt.NDArray[Any]:
        header, kind = self.header, self.type
        if kind in ("image", "depth", "semantic", "instance", "flow"):
            dtype, parts = PIXELS[self.format]
            tail = ((parts,), (dtype.itemsize,)) if parts else ((), ())
            return self._outcome.array(
                dtype, (header.height, header.width, *tail[0]), (header.row_stride, header.element_bytes, *tail[1]), 0
            )
        if kind == "tensor":
            return self._packed(SCALARS[self.format], header.shape, 0)
        if kind == "points":
            return self._packed(_point(self._about.text(), header.element_bytes), (header.n_items,), 0)
        return self._packed(RECORDS.get(kind, np.dtype("u1")), (header.n_items,), 0)

    def _packed(self, dtype: np.dtype[Any], shape: Iterable[int], offset: int) -> npt.NDArray[Any]:
        sizes, strides, by = tuple(shape), [], dtype.itemsize
        for size in reversed(sizes):
            strides.append(by)
            by *= size
        return self._outcome.array(dtype, sizes, strides[::-1], offset)

    @property
    def tail(self) -> npt.NDArray[Any]:
        """What lies behind the records: all runs of `masks` (n,) uint32, all points of `keypoints`."""
        if self.type not in TAILS:
            raise FrameFormatError(f"a result of {self.type} has no tail; masks and keypoints have")
        dtype, start = TAILS[self.type], self.header.n_items * self.header.element_bytes
        return self._packed(dtype, ((self._outcome.body_bytes - start) // dtype.itemsize,), start)

    @property
    def masks(self) -> list[npt.NDArray[np.bool_]]:
        """The masks as images (h, w) of bool, decoded from their runs.

        Raises `FrameFormatError` for another type, and for runs that are not there or too long.
        """
        self._expect("masks")
        height, width = self.header.height, self.header.width
        decoded = []
        for record in self.array:
            runs = self._part(record["first_run"], record["n_runs"])
            values = np.repeat(np.arange(len(runs)) % 2 == 1, runs) if int(runs.sum(dtype=np.uint64)) == height * width else None
            if values is None:
                raise FrameFormatError(f"the runs of a mask make {int(runs.sum(dtype=np.uint64))} pixels, its image has {height * width}")
            decoded.append(values.reshape(width, height).T)
        return decoded

    @property
    def keypoints(self) -> list[npt.NDArray[Any]]:
        """The key points of each object, structured arrays (n,) of `gantry.KEYPOINT`.

        Raises `FrameFormatError` for another type, and for points that are not there.
        """
        self._expect("keypoints")
        return [self._part(record["first_point"], record["n_points"]) for record in self.array]

    def _part(self, first: Any, n: Any) -> npt.NDArray[Any]:
        tail = self.tail
        if int(first) + int(n) > len(tail):
            raise FrameFormatError(f"a record names {n} elements from {first} on, there are {len(tail)}; the writer is broken")
        return tail[int(first) : int(first) + int(n)]

    @property
    def data(self) -> bytes:
        """A copy of the body."""
        return self._packed(np.dtype("u1"), (self._outcome.body_bytes,), 0).tobytes()

    @property
    def text(self) -> str:
        """The text of `text` and `json`. Raises `FrameFormatError` for another type."""
        self._expect("text", "json")
        return self.data.decode(errors="replace")

    def json(self) -> Any:
        """Parses the text as JSON. Raises `FrameFormatError` for another type."""
        return json.loads(self.text)

    @property
    def scalars(self) -> dict[str, float]:
        """The numbers of `scalars` by name. Raises `FrameFormatError` for another type."""
        self._expect("scalars")
        return {_padded_text(record["name"]): float(record["value"]) for record in self.array}

    def _expect(self, *types: str) -> None:
        if self.type not in types:
            raise FrameFormatError(f"this result is of type {self.type}, not {' or '.join(types)}; use result.array")

    def copy(self) -> npt.NDArray[Any]:
        """Returns a writeable copy of `array`, which keeps no memory borrowed; of a result on a GPU, too."""
        data = self._outcome.device_bytes()
        if data is None:
            return self.array.copy()
        return _in_memory(self._outcome.header_bytes(), data).array.copy()

    def torch(self) -> Any:
        """Returns the result as a tensor of torch, without a copy.

        On a GPU it is in hand sooner than by `torch.from_dlpack`, because the bytes were complete
        before the result was sent, and torch need not look for streams to wait for. Its memory is
        other readers', too: do not write to it. It stays as it is until the last tensor is gone and
        the device has done what it was given until then.
        """
        tensor = self._outcome.device_torch()
        if tensor is None:
            tensor = importlib.import_module("torch").from_dlpack(self)
        return tensor

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[Any]:
        if copy or (dtype is not None and np.dtype(dtype) != self.array.dtype):
            return np.array(self.array, dtype=dtype)
        return self.array

    def __dlpack__(self, **options: Any) -> Any:
        """Hands the array to another library without a copy, as `Frame.__dlpack__`."""
        if self.device is not None:
            return self._outcome.device_capsule(options.get("stream"))
        return self.array.__dlpack__(**options)

    def __dlpack_device__(self) -> tuple[int, int]:
        """Returns DLPack's kind and number of the device."""
        on_gpu = self._outcome.device_number()
        if on_gpu is not None:
            return on_gpu
        kind, number = self.array.__dlpack_device__()
        return int(kind), int(number)

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        found = self._outcome.device_interface()
        if found is None:
            raise AttributeError("__cuda_array_interface__: this result is not on a device of CUDA")
        address, shape, strides, kind = found
        # The bytes were complete before the result was sent, so nothing has to be waited for.
        return {"shape": tuple(shape), "typestr": kind, "data": (address, True), "version": 3, "strides": tuple(strides), "stream": None}

    def __len__(self) -> int:
        return self.shape[0]

    def __repr__(self) -> str:
        return f"<gantry.Result {self.topic or self.type} tick={self.tick} seq={self.seq} n={self.header.n_items}>"


def _in_memory(header: bytes, body: bytes) -> Result:
    """Makes a result of a checked header and of the body that was on a GPU, without its inputs."""
    own = bytearray(header)
    for name, value in (("n_inputs", 0), ("payload_bytes", (len(body) + 7) & ~7), ("payload_place", 0)):
        at, n = _PLACES[name]
        own[at : at + n] = value.to_bytes(n, "little")
    return result_from_bytes(bytes(own) + body + bytes(-len(body) % 8))


def result_from_bytes(data: bytes, topic: str = "", about: dict[str, Any] | None = None) -> Result:
    """Makes a result from the 320 bytes of its header and its payload, for example of a recording.

    `about` is the JSON of the topic's description. The arrays are read-only views of `data`. Raises
    `FrameFormatError` or `SchemaVersionError`.
    """
    return Result(native.outcome_from_bytes(bytes(data), topic), topic, About(about or {}))


native.set_result_class(Result)
