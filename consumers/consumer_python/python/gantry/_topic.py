"""Reading a topic of frames or of results: every sample in order, or the newest one."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, AsyncIterator, Generic, Iterator, TypeVar, cast, overload

from ._asyncio import Readable
from ._domain import split
from ._errors import GantryError, NoSuchTopicError
from ._frame import Frame
from ._load import native
from ._result import Description, Result

#: Seconds between two looks for a topic that does not exist yet.
_LOOK_SECS = 0.05


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


class Topic(Generic[S]):
    """An open topic: a context manager, and an iterator over every sample in order.

    `for frame in topic` blocks a thread, `async for frame in topic` a task. Several threads and
    tasks may read one topic; each sample goes to one of them. It yields `Frame`s, or `Result`s if
    the topic has results.
    """

    def __init__(self, topic: str, domain: str | None = None) -> None:
        self._domain, name = split(topic, domain)
        #: Name without the domain.
        self.name: str = name
        self._reader = native.Reader(self._domain, name)
        #: Type of the topic's results; None for a topic of frames.
        self.result: str | None = self._reader.result
        self._about = Description(self._reader.about)
        self._readable = Readable(self._reader.fileno)
        self._closed = False
        self._counts = Counts()

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
        self._reader.close()
        self._readable.wake()

    @property
    def counts(self) -> Counts:
        """Counters since the topic was opened."""
        counts = self._reader.counts()
        return self._counts if counts is None else Counts(*counts)

    @property
    def has_writer(self) -> bool:
        """Whether a process writes the topic now."""
        return self._reader.has_writer()

    @property
    def classes(self) -> list[str]:
        """Names of the classes that the topic's results number."""
        return self._about.classes()

    def fileno(self) -> int:
        """Returns a descriptor that can be read when a sample may wait, for select and poll.

        Reading nothing with `next(timeout=0)` takes the wake-ups.
        """
        return self._reader.fileno()

    def poll(self) -> S | None:
        """Takes the oldest sample that waits, or returns None if none does.

        Raises `BorrowLimitError` if too many samples are held, `FrameFormatError` or
        `SchemaVersionError` for one that breaks the contract; the next call continues after it.
        """
        return self._wrap(self._reader.poll())

    def next(self, timeout: float | None = None, busy_wait: float = 0.0) -> S | None:
        """Takes the next sample; waits up to `timeout` seconds for it (None: without a limit).

        Returns None if none arrived in time. For the first `busy_wait` seconds the reader looks
        again and again instead of sleeping: it has the frame some 50 µs earlier, because it need
        not be woken, but keeps a processor busy. Other threads run meanwhile. Raises as `poll`.
        """
        return self._wrap(self._reader.next(timeout, busy_wait))

    def latest(self, timeout: float | None = None, busy_wait: float = 0.0) -> S | None:
        """Takes the newest sample, and waits as `next` does if there is none.

        Older ones are dropped and counted in `counts.skipped`. Raises as `poll`.
        """
        return self._wrap(self._reader.latest(timeout, busy_wait))

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
            sample = self._wrap(self._reader.next(0.0, 0.0))
            if sample is not None:
                return sample
            await self._readable.wait()
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

    def _wrap(self, sample: native.Sample | native.Outcome | None) -> S | None:
        if sample is None:
            return None
        if self.result is None:
            return cast(S, Frame(cast(native.Sample, sample), self.name))
        return cast(S, Result(cast(native.Outcome, sample), self.name, self._about))


@overload
def open(topic: str, domain: str | None = None, timeout: float = 0.0, *, result: None = None) -> Topic[Frame]: ...
@overload
def open(topic: str, domain: str | None = None, timeout: float = 0.0, *, result: str) -> Topic[Result]: ...


def open(topic: str, domain: str | None = None, timeout: float = 0.0, *, result: str | None = None) -> Topic[Any]:
    """Opens a topic such as `ego/front/rgb`; waits up to `timeout` seconds for it to appear.

    A topic of frames yields `Frame`s, a topic of results `Result`s. With `result="boxes2d"` it must
    be a topic of results of this type; type checkers learn from it that results come. Raises
    `NoSuchTopicError` if it does not appear, `TooManyReadersError` if it has no place left,
    `SchemaVersionError` if the simulator has another version, `GantryError` for another type.
    """
    deadline = time.monotonic() + timeout
    while True:
        try:
            opened: Topic[Any] = Topic(topic, domain)
            break
        except NoSuchTopicError:
            if time.monotonic() >= deadline:
                raise
            time.sleep(_LOOK_SECS)
    if result is not None and opened.result != result:
        opened.close()
        raise GantryError(f"topic {opened.name!r} has {'results of type ' + repr(opened.result) if opened.result else 'frames'}, not results of type {result!r}")
    return opened
