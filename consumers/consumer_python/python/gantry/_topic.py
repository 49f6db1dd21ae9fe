"""Reading a topic of frames or of results: every sample in order, or the newest one."""

from __future__ import annotations

import time
import warnings
import weakref
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, AsyncIterator, Generic, Iterator, TypeVar, overload

from ._asyncio import Readable
from ._domain import split
from ._errors import GantryError, NoSuchTopicError
from ._frame import Frame
from ._load import native
from ._result import Result, class_names
from ._topics import BatchCamera, cameras_of

#: Seconds between two looks for a topic that does not exist yet.
_LOOK_SECS = 0.05
#: Seconds between two looks of a task whether frames still come to the GPU the way they did.
_LOOK_ON_GPU_SECS = 0.5
#: What was warned of.
_SAID: dict[str, bool] = {}


@dataclass
class Counts:
    """What a reader has received and missed."""

    #: Samples that were returned.
    taken: int = 0
    #: Samples that `latest` passed over.
    skipped: int = 0
    #: Samples that never arrived: gaps in `seq`.
    lost: int = 0
    #: Samples that broke the contract.
    refused: int = 0
    #: Number of times that the writer restarted.
    restarts: int = 0


S = TypeVar("S")


class Topic(native.Reader, Generic[S]):
    """An open topic: a context manager, and an iterator over every sample in order.

    `for frame in topic` blocks a thread, `async for frame in topic` a task. Several threads and
    tasks may read one topic; each sample goes to one of them. It yields `Frame`s, or `Result`s if
    the topic has results.
    """

    def __new__(cls, topic: str, domain: str | None = None, device: str | None = None) -> Topic[S]:
        domain, name = split(topic, domain)
        return super().__new__(cls, domain, name, device)

    def __init__(self, topic: str, domain: str | None = None, device: str | None = None) -> None:
        self._domain, _ = split(topic, domain)
        # A weak reference, because the native half does not take part in collecting cycles.
        this = weakref.ref(self)
        self._readable = Readable(lambda: _fileno(this()))
        self._closed = False
        self._look_secs = None if device is None else _LOOK_ON_GPU_SECS
        self._counts = Counts()

    if TYPE_CHECKING:

        def poll(self) -> S | None: ...

        def next(self, timeout: float | None = None, busy_wait: float = 0.0) -> S | None: ...

        def latest(self, timeout: float | None = None, busy_wait: float = 0.0) -> S | None: ...

    def __enter__(self) -> Topic[S]:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<gantry.Topic {self._domain}/{self.name} {'closed' if self._closed else 'open'}>"

    def close(self) -> None:
        """Closes the topic. Samples that are still held stay valid until they are dropped."""
        self._counts = self.counts
        self._closed = True
        self.close_ports()
        self._readable.wake()

    @property
    def counts(self) -> Counts:
        """Counters since the topic was opened."""
        numbers = self.numbers()
        return self._counts if numbers is None else Counts(*numbers)

    @property
    def classes(self) -> list[str]:
        """Names of the classes that the topic's results number; CARLA's if it names none."""
        return class_names(self.about)

    @property
    def cameras(self) -> list[BatchCamera]:
        """Cameras of a batch (`batch/fleet/rgb`) in the order of its images; empty for any other topic.

        The snapshot of a frame's tick has the poses of their actors. Raises `GantryError` if no simulator says what
        the batch holds.
        """
        return cameras_of(self.name, self._domain)

    async def anext(self, timeout: float | None = None) -> S | None:
        """As `next`, in an event loop: other tasks run while it waits, and no thread is used."""
        if timeout is None:
            return await self._anext()
        import asyncio

        try:
            return await asyncio.wait_for(self._anext(), timeout)
        except asyncio.TimeoutError:
            return None

    async def _anext(self) -> S | None:
        while not self._closed:
            sample = self.next(0.0)
            if sample is not None:
                return sample
            # A writer that ends announces nothing.
            await self._readable.wait(self._look_secs)
        return None

    def __iter__(self) -> Iterator[S]:
        while not self._closed:
            try:
                sample = self.next()
            except GantryError:
                if self._closed:
                    return
                raise
            if sample is not None:
                yield sample
            sample = None

    async def __aiter__(self) -> AsyncIterator[S]:
        while not self._closed:
            sample = await self._anext()
            if sample is not None:
                yield sample
            sample = None


def _say_fallback(name: str, why: str, level: int = 2) -> None:
    if not _SAID.get(why):
        _SAID[why] = True
        warnings.warn(f"{name!r} is uploaded, it does not stay on the GPU: {why}", RuntimeWarning, stacklevel=level + 1)


def _fileno(topic: Topic[Any] | None) -> int:
    if topic is None:
        raise GantryError("the topic is gone")
    return topic.fileno()


@overload
def open(topic: str, domain: str | None = None, timeout: float = 0.0, *, result: None = None, device: str | None = None) -> Topic[Frame]: ...
@overload
def open(topic: str, domain: str | None = None, timeout: float = 0.0, *, result: str, device: str | None = None) -> Topic[Result]: ...


def open(topic: str, domain: str | None = None, timeout: float = 0.0, *, result: str | None = None, device: str | None = None) -> Topic[Any]:
    """Opens a topic such as `ego/front/rgb`; waits up to `timeout` seconds for it to appear.

    A topic of frames yields `Frame`s, a topic of results `Result`s. With `result="boxes2d"` it must
    be a topic of results of this type; type checkers learn from it that results come. Raises
    `NoSuchTopicError` if it does not appear, `TooManyReadersError` if it has no place left,
    `SchemaVersionError` if the simulator has another version, `GantryError` for another type.

    With `device="cuda"` frames of cameras and lidars stay on the GPU that the simulator draws on,
    and results that were published with a device on that of their writer: `frame.torch()` is a
    tensor there, and nothing is copied. Where CUDA computes on another GPU, or the writer publishes
    in shared memory only, they are uploaded through page-locked memory, with one warning that says
    why. The same when another process takes the topic over, as render workers do: the topic goes on
    by itself, and `fallback` tells. Raises `GantryError` where there is no CUDA.
    """
    deadline = time.monotonic() + timeout
    while True:
        try:
            opened: Topic[Any] = Topic(topic, domain, device)
            break
        except NoSuchTopicError:
            if time.monotonic() >= deadline:
                raise
            time.sleep(_LOOK_SECS)
    if opened.fallback is not None:
        _say_fallback(opened.name, opened.fallback)
    if result is not None and opened.result != result:
        opened.close()
        raise GantryError(f"topic {opened.name!r} has {'results of type ' + repr(opened.result) if opened.result else 'frames'}, not results of type {result!r}")
    return opened
