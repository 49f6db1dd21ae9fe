"""Reading a topic of frames or of results: every sample in order, or the newest one."""

from __future__ import annotations

import warnings
import weakref
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, AsyncIterator, Generic, Iterator, Literal, TypeVar, overload

from ._asyncio import Readable
from ._domain import split
from ._errors import GantryError, TimedOutError
from ._frame import Frame
from ._load import native
from ._patience import LIFE_SECS, PATIENCE, Life, appear
from ._result import Result, class_names
from ._topics import BatchCamera, cameras_of

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

    `for frame in topic` blocks a thread, `async for frame in topic` a task. The loop waits for as
    long as the writer lives, paused or not, and ends when it has ended: when none has come back for
    `PATIENCE` seconds, so that a restarted one is followed; and when the topic is closed. Several
    threads and tasks may read one topic; each sample goes to one of them. It yields `Frame`s, or
    `Result`s if the topic has results.
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

    @overload
    def next(self, timeout: float | None = PATIENCE, busy_wait: float = 0.0, *, or_none: Literal[False] = False) -> S: ...
    @overload
    def next(self, timeout: float | None = PATIENCE, busy_wait: float = 0.0, *, or_none: bool) -> S | None: ...

    def next(self, timeout: float | None = PATIENCE, busy_wait: float = 0.0, *, or_none: bool = False) -> S | None:
        """Takes the next sample; waits up to `timeout` seconds for it (None: without a limit).

        Raises `TimedOutError` if none arrived in time; with `or_none` it returns None instead. For the
        first `busy_wait` seconds the reader looks again and again instead of sleeping: it has the
        frame some 50 µs earlier, because it need not be woken, but keeps a processor busy. Other
        threads run meanwhile. Raises as `poll`.
        """
        sample: S | None = native.Reader.next(self, timeout, busy_wait)
        return sample if sample is not None or or_none else self._timed_out(timeout)

    @overload
    def latest(self, timeout: float | None = PATIENCE, busy_wait: float = 0.0, *, or_none: Literal[False] = False) -> S: ...
    @overload
    def latest(self, timeout: float | None = PATIENCE, busy_wait: float = 0.0, *, or_none: bool) -> S | None: ...

    def latest(self, timeout: float | None = PATIENCE, busy_wait: float = 0.0, *, or_none: bool = False) -> S | None:
        """Takes the newest sample, and waits as `next` does if there is none.

        Older ones are dropped and counted in `counts.skipped`. Raises as `next`.
        """
        sample: S | None = native.Reader.latest(self, timeout, busy_wait)
        return sample if sample is not None or or_none else self._timed_out(timeout)

    def _timed_out(self, timeout: float | None) -> S:
        writer = "its writer sends nothing: it is paused, or waits for somebody" if self.has_writer else "nobody writes it"
        raise TimedOutError(f"topic {f'{self._domain}/{self.name}'!r} sent nothing within {timeout} s; {writer}. Pass a longer timeout=, or or_none=True")

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

    @overload
    async def anext(self, timeout: float | None = PATIENCE, *, or_none: Literal[False] = False) -> S: ...
    @overload
    async def anext(self, timeout: float | None = PATIENCE, *, or_none: bool) -> S | None: ...

    async def anext(self, timeout: float | None = PATIENCE, *, or_none: bool = False) -> S | None:
        """As `next`, in an event loop: other tasks run while it waits, and no thread is used."""
        import asyncio

        try:
            sample = await asyncio.wait_for(self._anext(), timeout)
        except asyncio.TimeoutError:
            return None if or_none else self._timed_out(timeout)
        if sample is None and not or_none:
            raise GantryError(f"topic {f'{self._domain}/{self.name}'!r} is closed")
        return sample

    def _life(self) -> Life:
        # A weak reference, because what waits may outlive the topic.
        this = weakref.ref(self)
        return Life(lambda: (topic := this()) is not None and topic.has_writer, lambda: native.clean(self._domain))

    def _next_or_end(self, life: Life, newest: bool = False) -> S | None:
        """Returns the next sample, or None when the writer has ended or the topic was closed."""
        take = native.Reader.latest if newest else native.Reader.next
        while not self._closed:
            try:
                sample: S | None = take(self, LIFE_SECS)
            except GantryError:
                if self._closed:
                    return None
                raise
            if sample is not None:
                life.came()
                return sample
            if life.has_ended():
                return None
        return None

    async def _anext(self, life: Life | None = None) -> S | None:
        """Returns the next sample, or None when the topic was closed or, with `life`, when the writer has ended."""
        look_secs = self._look_secs if life is None else LIFE_SECS
        while not self._closed:
            sample: S | None = native.Reader.next(self, 0.0)
            if sample is not None:
                if life is not None:
                    life.came()
                return sample
            if life is not None and life.has_ended():
                return None
            # A writer that ends announces nothing.
            await self._readable.wait(look_secs)
        return None

    def __iter__(self) -> Iterator[S]:
        life = self._life()
        while (sample := self._next_or_end(life)) is not None:
            yield sample
            sample = None

    def newest(self) -> Iterator[S]:
        """Iterates over the newest samples: those that came while the loop was busy are skipped.

        It ends as the loop over the topic itself does.
        """
        life = self._life()
        while (sample := self._next_or_end(life, newest=True)) is not None:
            yield sample
            sample = None

    async def __aiter__(self) -> AsyncIterator[S]:
        life = self._life()
        while (sample := await self._anext(life)) is not None:
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
def open(topic: str, domain: str | None = None, timeout: float = PATIENCE, *, result: None = None, device: str | None = None) -> Topic[Frame]: ...
@overload
def open(topic: str, domain: str | None = None, timeout: float = PATIENCE, *, result: str, device: str | None = None) -> Topic[Result]: ...


def open(topic: str, domain: str | None = None, timeout: float = PATIENCE, *, result: str | None = None, device: str | None = None) -> Topic[Any]:
    """Opens a topic such as `ego/front/rgb`; waits up to `timeout` seconds for it to appear (0: it must be there).

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
    opened: Topic[Any] = appear(lambda: Topic(topic, domain, device), timeout)
    if opened.fallback is not None:
        _say_fallback(opened.name, opened.fallback)
    if result is not None and opened.result != result:
        opened.close()
        raise GantryError(f"topic {opened.name!r} has {'results of type ' + repr(opened.result) if opened.result else 'frames'}, not results of type {result!r}")
    return opened
