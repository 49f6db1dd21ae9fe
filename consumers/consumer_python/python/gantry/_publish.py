"""Publishing results: what a program says, on a topic of its own."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Iterable, Mapping, Sequence, Union, overload

import numpy as np
import numpy.typing as npt

from . import _layout, _records
from ._domain import split
from ._dtypes import ONLY_FORMAT, PIXELS, RECORDS, TAILS, scalar_name
from ._errors import GantryError
from ._frame import Frame
from ._load import native
from ._pose import Pose
from ._records import RecordsAndTail
from ._result import Result

if TYPE_CHECKING:
    from typing_extensions import Self

    from ._publish_gpu import GpuPublisher

#: What a result can name as its input.
Answered = Union[Frame, Result, Mapping[str, Any], Iterable[Union[Frame, Result]], None]

_PIXEL_TYPES = ("image", *ONLY_FORMAT)
_TEXTS = ("text", "json", "bytes")


@dataclass(frozen=True)
class BytesSchema:
    """What the messages of a topic of `bytes` are, in MCAP's words."""

    #: Name of the message type, for example `perception.Detections`.
    name: str
    #: How a message is encoded: `protobuf`, `json`, `flatbuffer`, `cbor`, `msgpack`, `ros1`, `cdr`, …
    message_encoding: str
    #: How the schema is written: `protobuf`, `jsonschema`, `flatbuffer`, `ros2msg`, or empty.
    schema_encoding: str = ""
    #: The schema: a text, or bytes where it is none (a protobuf FileDescriptorSet).
    schema: str | bytes = ""

    def _json(self) -> dict[str, str]:
        body = {"text": self.schema} if isinstance(self.schema, str) else {"base64": base64.b64encode(self.schema).decode()}
        return {"name": self.name, "message_encoding": self.message_encoding, "schema_encoding": self.schema_encoding, **body}


class Loan:
    """A slot of shared memory that is filled in place: a context manager that gives its array.

    Leaving the `with` block sends the result, an exception in it gives the slot back unsent. After
    that the array must not be written; it is made read-only, its slices are not.
    """

    def __init__(self, loan: Any, array: Any, type_: str) -> None:
        #: The memory, writeable. Lists of records are zeros at first; other bytes are of an earlier result.
        self.array: npt.NDArray[Any] = array
        #: Number of records, points or bytes that are sent, if they are fewer than were loaned.
        self.n_items: int | None = None
        #: Number of readers that received the result, once it is sent.
        self.n_received: int | None = None
        self._loan, self._type = loan, type_

    def __enter__(self) -> npt.NDArray[Any]:
        return self.array

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self.send()
        else:
            self.give_back()

    def answers(self, *inputs: Answered) -> None:
        """Names frames or results that this one was computed from, besides those named at `loan`."""
        for one in inputs:
            _name_inputs(self._loan, one)

    def send(self) -> int:
        """Sends the result and returns the number of readers that received it.

        Raises `GantryError` if it was sent or given back before, or has more items than loaned.
        """
        if self.n_items is not None:
            if not 0 <= self.n_items <= len(self.array):
                raise GantryError(f"n_items is {self.n_items}; it must be 0 to {len(self.array)}, the number that was loaned")
            self._loan.set_list(self.n_items, self.array.dtype.itemsize, 0)
        self.array.flags.writeable = False
        self.n_received = n_received = int(self._loan.send())
        return n_received

    def give_back(self) -> None:
        """Gives the slot back unsent."""
        self.array.flags.writeable = False
        self._loan.give_back()


class Publisher:
    """The one writer of a topic of results: a context manager."""

    def __init__(self, topic: str, type: str, domain: str | None, about: dict[str, Any], capacities: dict[str, int], point: np.dtype[Any]) -> None:
        self._domain, self.name = split(topic, domain)
        #: Type of its results.
        self.type: str = type
        self._point = point
        #: Device of its results: `cuda:0` and so on; None for shared memory.
        self.device: str | None = None
        self._native: Any = self._open(about, capacities)

    def _open(self, about: dict[str, Any], capacities: dict[str, int]) -> Any:
        return native.Publisher(self._domain, self.name, self.type, about=json.dumps(about), **capacities)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<gantry.Publisher {self._domain}/{self.name} {self.type}>"

    def close(self) -> None:
        """Closes the topic, at the latest when the last array of its loans is gone."""
        self._native.close()

    @property
    def n_readers(self) -> int:
        """Number of readers now; without one a result need not be computed."""
        return int(self._native.n_readers())

    @property
    def device_bytes(self) -> int:
        """Memory of the GPU that the topic has for its slots now, bytes; 0 without a device."""
        return 0

    def loan(
        self,
        shape: int | Sequence[int],
        dtype: npt.DTypeLike | None = None,
        *,
        format: str | None = None,
        answers: Answered = None,
        tick: int | None = None,
        sim_time: float | None = None,
        space: str | None = None,
        pose: Pose | None = None,
        intrinsics_px: Sequence[float] | None = None,
    ) -> Loan:
        """Loans shared memory for one result, to be filled in place:

            with topic.loan(image.shape, image.dtype, answers=frame) as a:
                np.subtract(image, background, out=a)

        `shape` is that of an image (h, w) or (h, w, c) or of a tensor, for records, points, texts
        and bytes their largest number. `dtype` is needed for tensors and images of other than
        uint8. `format` is an image's pixel format (`rgb8` for 3 parts, `bgra8` for 4, `mono8`,
        `mono16` or `mono32f` for none). `answers` names the frames or results that it is computed
        from: one, several, or a row of `sync`; tick, times, pose and intrinsics are taken over from
        them unless they are given here. Raises `BorrowLimitError` if two loans are open, `ValueError`
        for a shape or type that does not fit the topic, `GantryError` if `/dev/shm` is full.
        """
        sizes = (shape,) if isinstance(shape, (int, np.integer)) else tuple(shape)
        if self.type in TAILS:
            raise ValueError(f"{self.type} have a length that is known only at their end; use send(gantry.{self.type}(...))")
        item, format = self._item(sizes, dtype, format)
        n_bytes = item.itemsize
        for size in sizes:
            n_bytes *= int(size)
        loan = self._native.loan(n_bytes)
        try:
            if self.type in _PIXEL_TYPES:
                loan.set_image(sizes[1], sizes[0], format)
            elif self.type == "tensor":
                loan.set_tensor(format, sizes)
            else:
                loan.set_list(sizes[0], item.itemsize, 0)
            _name_inputs(loan, answers)
            loan.describe(said(tick, sim_time, space, pose, intrinsics_px))
            strides, by = [], item.itemsize
            for size in reversed(sizes):
                strides.append(by)
                by *= int(size)
            array = loan.array(item, sizes, strides[::-1], 0)
        except BaseException:
            loan.give_back()
            raise
        if self.type in RECORDS:
            array[...] = np.zeros((), item)
        return Loan(loan, array, self.type)

    def send(
        self,
        data: Any,
        *,
        format: str | None = None,
        answers: Answered = None,
        tick: int | None = None,
        sim_time: float | None = None,
        space: str | None = None,
        pose: Pose | None = None,
        intrinsics_px: Sequence[float] | None = None,
        size_px: tuple[int, int] | None = None,
    ) -> int:
        """Copies one result into shared memory, sends it, and returns the number of readers.

        `data` is an array for images, tensors, points and records (`gantry.boxes2d(...)` and its
        like make them), what `gantry.masks` and `gantry.keypoints` return, a text, a value for
        `json`, a mapping for `scalars`, or bytes. `size_px` is the (width, height) of the image of
        masks and key points, if they answer no frame. The rest, and errors, are as those of `loan`.
        """
        if self.type in TAILS:
            return self._send_with_tail(data, answers, tick, sim_time, space, pose, intrinsics_px, size_px)
        array = self._array(data)
        loan = self.loan(
            array.shape, array.dtype, format=format, answers=answers, tick=tick, sim_time=sim_time, space=space, pose=pose, intrinsics_px=intrinsics_px
        )
        with loan as memory:
            memory[...] = array
        assert loan.n_received is not None
        return loan.n_received

    def _send_with_tail(
        self,
        data: Any,
        answers: Answered,
        tick: int | None,
        sim_time: float | None,
        space: str | None,
        pose: Pose | None,
        intrinsics_px: Sequence[float] | None,
        size_px: tuple[int, int] | None,
    ) -> int:
        if not isinstance(data, RecordsAndTail) or data.records.dtype != RECORDS[self.type] or data.tail.dtype != TAILS[self.type]:
            raise ValueError(f"a topic of {self.type} sends what gantry.{self.type}(...) returns")
        records, tail = data.records.tobytes(), data.tail.tobytes()
        loan = self._native.loan(len(records) + len(tail))
        try:
            loan.set_list(len(data.records), data.records.dtype.itemsize, len(tail))
            loan.write(0, records)
            loan.write(len(records), tail)
            _name_inputs(loan, answers)
            loan.describe(said(tick, sim_time, space, pose, intrinsics_px, size_px))
            return int(loan.send())
        finally:
            loan.give_back()

    def _array(self, data: Any) -> npt.NDArray[Any]:
        """Returns the data of any type but masks and key points as an array."""
        if self.type == "text":
            data = str(data).encode()
        elif self.type == "json":
            data = json.dumps(data).encode()
        elif self.type == "scalars" and isinstance(data, Mapping):
            data = _records.scalars(data)
        if self.type in _TEXTS:
            return np.frombuffer(data, np.uint8)
        array = np.asarray(data)
        return np.atleast_1d(array) if self.type in RECORDS else array

    def _item(self, sizes: Sequence[int], dtype: npt.DTypeLike | None, format: str | None) -> tuple[np.dtype[Any], str]:
        """Returns the type of one element of the loaned array, and the name of format or element."""
        if self.type == "tensor":
            item = np.dtype(np.float32 if dtype is None else dtype)
            name = scalar_name(item)
            if name is None or len(sizes) > 8:
                raise ValueError(f"a tensor of {item} with {len(sizes)} dimensions cannot be sent; up to 8 of bool, int, uint and float of 8 to 64 bits can")
            return item, name
        if self.type in _PIXEL_TYPES:
            return self._pixel(sizes, dtype, format)
        item = np.dtype("u1") if self.type in _TEXTS else self._point if self.type == "points" else RECORDS[self.type]
        if len(sizes) != 1 or (dtype is not None and np.dtype(dtype) != item):
            raise ValueError(f"a topic of {self.type} sends arrays (n,) of {item}, not {tuple(sizes)} of {dtype}")
        return item, ""

    def _pixel(self, sizes: Sequence[int], dtype: npt.DTypeLike | None, format: str | None) -> tuple[np.dtype[Any], str]:
        if self.type in ONLY_FORMAT:
            format = ONLY_FORMAT[self.type]
        elif format is None:
            parts = sizes[2] if len(sizes) == 3 else 0
            item = np.dtype("u1" if dtype is None else dtype)
            usual = ("rgb8", "bgra8", "mono8", "mono16", "mono32f")
            format = next((name for name in usual if PIXELS[name] == (item, parts)), None)
            if format is None:
                raise ValueError(f"an image {tuple(sizes)} of {item} has no usual pixel format; give format=, one of {', '.join(PIXELS)}")
        if format not in PIXELS:
            raise ValueError(f"{format!r} is no pixel format; it must be one of {', '.join(PIXELS)}")
        item, parts = PIXELS[format]
        if tuple(sizes[2:]) != ((parts,) if parts else ()) or len(sizes) < 2 or (dtype is not None and np.dtype(dtype) != item):
            shape = f"(h, w, {parts})" if parts else "(h, w)"
            raise ValueError(f"pixels of {format} are arrays {shape} of {item}, not {tuple(sizes)} of {dtype}")
        return item, format


def said(
    tick: int | None,
    sim_time: float | None,
    space: str | None,
    pose: Pose | None,
    intrinsics_px: Sequence[float] | None,
    size_px: tuple[int, int] | None = None,
) -> native.Said:
    """Returns what a result says besides what its inputs do."""
    nanos = None if sim_time is None else round(sim_time * 1e9)
    return native.Said(tick=tick, sim_nanos=nanos, size_px=size_px, space=space, pose=pose, intrinsics_px=intrinsics_px)


def _name_inputs(loan: native.Loan | native.GpuLoan, answers: Answered) -> None:
    if answers is None:
        return
    if isinstance(answers, Frame):
        loan.answers(answers)
    elif isinstance(answers, Result):
        loan.answers(answers._outcome)
    else:
        for one in answers.values() if isinstance(answers, Mapping) else answers:
            if not isinstance(one, (Frame, Result)):
                raise ValueError(f"a result answers frames and results, not {type(one).__name__}")
            _name_inputs(loan, one)


@overload
def publish(
    topic: str,
    type: str,
    *,
    domain: str | None = None,
    classes: Sequence[str] = (),
    fields: npt.DTypeLike | None = None,
    bones: Sequence[tuple[int, int]] = (),
    schema: BytesSchema | None = None,
    note: str = "",
    max_bytes: int = 0,
    loans: int = 0,
    readers: int = 0,
    buffer: int = 0,
    borrowed: int = 0,
    device: None = None,
    gpu_readers: int = 0,
) -> Publisher: ...
@overload
def publish(
    topic: str,
    type: str,
    *,
    domain: str | None = None,
    classes: Sequence[str] = (),
    fields: npt.DTypeLike | None = None,
    bones: Sequence[tuple[int, int]] = (),
    schema: BytesSchema | None = None,
    note: str = "",
    max_bytes: int = 0,
    loans: int = 0,
    readers: int = 0,
    buffer: int = 0,
    borrowed: int = 0,
    device: str,
    gpu_readers: int = 0,
) -> GpuPublisher: ...
def publish(
    topic: str,
    type: str,
    *,
    domain: str | None = None,
    classes: Sequence[str] = (),
    fields: npt.DTypeLike | None = None,
    bones: Sequence[tuple[int, int]] = (),
    schema: BytesSchema | None = None,
    note: str = "",
    max_bytes: int = 0,
    loans: int = 0,
    readers: int = 0,
    buffer: int = 0,
    borrowed: int = 0,
    device: str | None = None,
    gpu_readers: int = 0,
) -> Publisher:
    """Opens a topic of your own for results of one type; the process becomes its one writer.

    `topic` is any name outside `world/` and `control/`; `type` one of `gantry.RESULT_TYPES`.
    `classes` names what records number, `fields` is the structured type of `points` (default x, y,
    z, intensity as float32), `bones` are pairs of key points, `schema` describes `bytes`, and `note`
    is a sentence for people. `max_bytes` is the longest body expected; slots grow when a longer one
    comes. `loans` is how many may be open at a time (2), `readers`, `buffer` and `borrowed` are the
    topic's places, the samples that wait for a reader, and those that it may hold; 0 is the usual
    number of the type, and who finds the topic there joins it as it is.

    With `device="cuda"` (or `"cuda:N"`) a tensor or an image stays on the GPU: `send` takes anything
    with `__dlpack__` or `__cuda_array_interface__` and copies it within the device, `loan` gives a
    slot of the GPU's memory. Readers with a device get that memory, all others, the recorder and the
    viewer among them, a copy in shared memory, which is made while one of them reads. The slots are
    `gpu_readers` (2) times 5, and one for each loan and `send`; with `max_bytes` they are made at
    once, otherwise for the first result that is read there.

    Raises `TopicTakenError` if another process writes it, `ValueError` for an unknown type,
    `GantryError` for a name or a description that cannot be, if `/dev/shm` or the GPU has no room,
    and without CUDA for a device.
    """
    about, point = described(classes, fields, bones, schema, note)
    capacities = {"body_bytes": max_bytes, "loans": loans, "readers": readers, "buffer": buffer, "borrowed": borrowed, "gpu_readers": gpu_readers}
    negative = next((name for name, value in capacities.items() if value < 0), None)
    if negative is not None:
        raise ValueError(f"{negative} is {capacities[negative]}; it must be 0 (the usual number) or more")
    if device is not None:
        from ._publish_gpu import GpuPublisher

        return GpuPublisher(topic, type, domain, about, capacities, point, device)
    del capacities["gpu_readers"]
    return Publisher(topic, type, domain, about, capacities, point)


def described(
    classes: Sequence[str], fields: npt.DTypeLike | None, bones: Sequence[tuple[int, int]], schema: BytesSchema | None, note: str
) -> tuple[dict[str, Any], np.dtype[Any]]:
    """Returns the description of a topic, and the type of its points."""
    point = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity")]) if fields is None else np.dtype(fields)
    about: dict[str, Any] = {"classes": list(classes), "bones": [list(bone) for bone in bones], "note": note}
    if fields is not None:
        about["fields"] = _point_fields(point)
    if schema is not None:
        about["schema"] = schema._json()
    return about, point


def _point_fields(point: np.dtype[Any]) -> list[dict[str, Any]]:
    if point.fields is None:
        raise ValueError(f"the fields of points are a structured type, not {point}")
    found = []
    for name in point.names or ():
        of, offset = point.fields[name][:2]
        element = scalar_name(of)
        if element is None:
            raise ValueError(f"field {name!r} of a point has the type {of}; it must be one number, little-endian or bool")
        found.append({"name": name, "type": element, "offset": offset})
    return found


#: Names of all types of results.
RESULT_TYPES: list[str] = list(_layout.RESULT_TYPES.values())
