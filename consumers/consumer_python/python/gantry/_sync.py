"""Samples of several topics that show the same tick."""

from __future__ import annotations

import asyncio
import time
from typing import Any, AsyncIterator, Generator, Iterator, Literal, Sequence, overload

from ._errors import GantryError, TimedOutError
from ._frame import Frame
from ._load import native
from ._patience import PATIENCE, Life, appear
from ._result import Result
from ._topic import Topic, open as open_topic
from ._world import Snapshot, parse_snapshot


class Row(dict[str, Frame]):
    """Samples of one tick, by topic: `row["ego/front/rgb"]`, and `row.result("mine/boxes")`."""

    def __init__(self, samples: dict[str, Frame], snapshot: Snapshot | None = None) -> None:
        super().__init__(samples)
        of = next(iter(samples.values())) if snapshot is None else snapshot
        #: Tick that all samples show.
        self.tick: int = of.tick
        #: Simulated time, seconds.
        self.sim_time: float = of.sim_time
        #: The world at this tick; None without `snapshots=True`, or if it did not come.
        self.snapshot: Snapshot | None = snapshot

    @property
    def world(self) -> Snapshot:
        """The world at this tick, which `snapshot` has. Raises `GantryError` if it has none."""
        if self.snapshot is None:
            raise GantryError(f"this row of tick {self.tick} has no world: pass snapshots=True to sync; a reader that fell far behind, or a file, may lack it")
        return self.snapshot

    def result(self, topic: str) -> Result:
        """Returns the sample of a topic of results. Raises `KeyError` without one, `TypeError` for a frame."""
        sample: Any = self[topic]
        if not isinstance(sample, Result):
            raise TypeError(f"{topic} has frames; use row[{topic!r}]")
        return sample


class Sync:
    """Iterates over the ticks of which every topic has a sample; the slowest one sets the pace.

    `for row in sync` blocks a thread, `async for row in sync` a task. The loop ends when the writer
    of one of the topics has ended, as that over a `Topic`.
    """

    def __init__(self, topics: Sequence[str], domain: str | None, timeout: float, snapshots: bool) -> None:
        if not topics:
            raise ValueError("sync needs at least one topic")
        self._topics: dict[str, Topic[Any]] = {}
        self._heads: dict[str, Frame] = {}
        self._snapshots: native.Snapshots | None = None
        try:
            for topic in topics:
                self._topics[topic] = open_topic(topic, domain, timeout)
            if snapshots:
                of = next(iter(self._topics.values()))._domain
                self._snapshots = appear(lambda: native.Snapshots(of), timeout)
        except Exception:
            self.close()
            raise

    def __enter__(self) -> Sync:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes all topics."""
        topics, self._topics, self._heads = self._topics, {}, {}
        for topic in topics.values():
            topic.close()
        if self._snapshots is not None:
            self._snapshots.close()

    @overload
    def next(self, timeout: float | None = PATIENCE, *, or_none: Literal[False] = False) -> Row: ...
    @overload
    def next(self, timeout: float | None = PATIENCE, *, or_none: bool) -> Row | None: ...

    def next(self, timeout: float | None = PATIENCE, *, or_none: bool = False) -> Row | None:
        """Returns the samples of the next complete tick.

        Raises `TimedOutError` if they did not arrive within `timeout` seconds (None: without a
        limit), or returns None with `or_none`; the next call goes on with those that did. Raises as
        `Topic.poll`.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        steps = self._steps()
        try:
            topic = next(steps)
            while True:
                left = None if deadline is None else max(0.0, deadline - time.monotonic())
                sample = topic.next(left, or_none=True)
                if sample is None:
                    return None if or_none else self._timed_out(timeout)
                topic = steps.send(sample)
        except StopIteration as done:
            return self._row(done.value)

    @overload
    async def anext(self, timeout: float | None = PATIENCE, *, or_none: Literal[False] = False) -> Row: ...
    @overload
    async def anext(self, timeout: float | None = PATIENCE, *, or_none: bool) -> Row | None: ...

    async def anext(self, timeout: float | None = PATIENCE, *, or_none: bool = False) -> Row | None:
        """As `next`, in an event loop: other tasks run while it waits, and no thread is used."""
        try:
            row = await asyncio.wait_for(self._anext(None), timeout)
        except asyncio.TimeoutError:
            return None if or_none else self._timed_out(timeout)
        if row is None and not or_none:
            raise GantryError("the topics were closed")
        return row

    def _timed_out(self, timeout: float | None) -> Row:
        missing = ", ".join(name for name in self._topics if name not in self._heads) or "a topic"
        raise TimedOutError(f"no tick was complete within {timeout} s; {missing} sent nothing that fits the others. Pass a longer timeout=, or or_none=True")

    async def _anext(self, lives: dict[str, Life] | None) -> Row | None:
        steps = self._steps()
        try:
            topic = next(steps)
            while True:
                sample = await topic._anext(None if lives is None else lives[topic.name])
                if sample is None:
                    return None
                topic = steps.send(sample)
        except StopIteration as done:
            return self._row(done.value)

    def _next_or_end(self, lives: dict[str, Life]) -> Row | None:
        steps = self._steps()
        try:
            topic = next(steps)
            while True:
                sample = topic._next_or_end(lives[topic.name])
                if sample is None:
                    return None
                topic = steps.send(sample)
        except StopIteration as done:
            return self._row(done.value)

    def _lives(self) -> dict[str, Life]:
        return {topic.name: topic._life() for topic in self._topics.values()}

    def _steps(self) -> Generator[Topic[Any], Frame, dict[str, Frame]]:
        """Yields the topic whose next sample is needed, and returns the samples of one tick."""
        if not self._topics:
            raise GantryError("the topics were closed")
        heads = self._heads
        while len(heads) < len(self._topics):
            for name, topic in self._topics.items():
                while name not in heads:
                    sample = yield topic
                    place = (sample.epoch, sample.tick)
                    newest = max(heads.values(), key=lambda head: head.tick, default=None)
                    # A sample of another epoch: the simulator restarted and counts its ticks from 1
                    # again, so the samples collected so far are dropped.
                    if newest is None or place[0] != newest.epoch or place[1] >= newest.tick:
                        for other in [other for other, head in heads.items() if (head.epoch, head.tick) != place]:
                            del heads[other]
                        heads[name] = sample
                    del sample, newest
        self._heads = {}
        return {name: heads[name] for name in self._topics}

    def _row(self, samples: dict[str, Frame]) -> Row:
        snapshot = None
        if self._snapshots is not None:
            first = next(iter(samples.values()))
            try:
                # It was sent before any frame of its tick.
                found = self._snapshots.at(first.tick, first.epoch, 1.0)
            except GantryError:
                # This reader fell so far behind that it is gone.
                found = None
            snapshot = None if found is None else parse_snapshot(*found)
        return Row(samples, snapshot)

    def __iter__(self) -> Iterator[Row]:
        lives = self._lives()
        while self._topics and (row := self._next_or_end(lives)) is not None:
            yield row
            row = None

    async def __aiter__(self) -> AsyncIterator[Row]:
        lives = self._lives()
        while self._topics and (row := await self._anext(lives)) is not None:
            yield row
            row = None


def sync(topics: Sequence[str], domain: str | None = None, timeout: float = PATIENCE, *, snapshots: bool = False) -> Sync:
    """Opens several topics, to be read tick by tick.

    Waits up to `timeout` seconds for each to appear. With `snapshots` each row has the world of its
    tick as `row.snapshot`. Raises as `open`.
    """
    return Sync(topics, domain, timeout, snapshots)
