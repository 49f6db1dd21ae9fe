"""Lockstep: the simulator begins no tick before this program is done with the last one."""

from __future__ import annotations

import asyncio
import functools
import time
from typing import Any, AsyncIterator, Iterator, Literal, Sequence, overload

from ._asyncio import Readable
from ._control import note_tick
from ._domain import resolve
from ._errors import GantryError, TimedOutError
from ._frame import Frame
from ._load import native
from ._patience import LIFE_SECS, PATIENCE, Life, appear
from ._sync import Row
from ._topic import Counts, Topic, open as open_topic
from ._world import Snapshot, parse_snapshot


class Tick(int):
    """A tick: its number, with the world after it."""

    #: The world after this tick.
    snapshot: Snapshot
    #: Simulated time, seconds.
    sim_time: float

    @classmethod
    def of(cls, number: int, snapshot: Snapshot) -> Tick:
        """Makes a tick of its number and its snapshot."""
        tick = cls(number)
        tick.snapshot, tick.sim_time = snapshot, snapshot.sim_time
        return tick


class Lockstep:
    """A place in lockstep: a context manager, and an iterator over ticks.

    Asking for the next tick acknowledges the last one. Leaving the `with` block, an exception in
    it, `close` and the end of the process free the world. If the simulator is restarted, its new
    run is joined under the same name; if none comes back for `PATIENCE` seconds, the loop ends.
    """

    # Whether a tick is waited for until every frame of it was sent.
    _is_whole = False

    def __init__(self, name: str, domain: str, timeout: float) -> None:
        #: Name of the participant.
        self.name: str = name
        self._domain = domain
        self._native = appear(lambda: native.Lockstep(domain, name, timeout), timeout)
        # Not by way of `self`: a place that nobody holds any more frees the world at once.
        self._readable = Readable(functools.partial(self._native.fileno, self._is_whole))
        self._closed = False
        self._last = 0

    def __enter__(self) -> Lockstep:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<gantry.Lockstep {self.name} {'left' if self._closed else 'joined'}>"

    def close(self) -> None:
        """Leaves: the simulator no longer waits for this program."""
        self._closed = True
        self._native.close()
        self._readable.wake()

    @property
    def first_tick(self) -> int | None:
        """First tick that waits for this program; None while a restarted simulator is joined."""
        return self._native.first_tick

    @property
    def restarts(self) -> int:
        """Number of times that the simulator was restarted and joined again."""
        return self._native.restarts

    def acknowledge(self) -> None:
        """Says that this program is done with the last tick, before the next one is asked for."""
        self._native.acknowledge()

    def wait_frames(self, timeout: float = 60.0) -> None:
        """Waits until every frame of the last tick was sent, also those that cameras still draw.

        Afterwards an input without a frame of this tick has none: its sensor did not fire. Raises
        `TimedOutError` if that has not come after `timeout` seconds, and `GantryError` if lockstep was left.
        """
        if self._closed:
            raise GantryError(f"lockstep {self.name!r} was left")
        if not self._native.wait_complete(timeout):
            raise TimedOutError(
                f"tick {self._last} was not complete within {timeout} s; the simulator draws slowly, or has ended. Pass a longer timeout="
            )

    @overload
    def next(self, timeout: float | None = PATIENCE, *, or_none: Literal[False] = False) -> Tick: ...
    @overload
    def next(self, timeout: float | None = PATIENCE, *, or_none: bool) -> Tick | None: ...

    def next(self, timeout: float | None = PATIENCE, *, or_none: bool = False) -> Tick | None:
        """Acknowledges the last tick, and waits up to `timeout` seconds for the next one (None: without a limit).

        Raises `TimedOutError` if none has come, or returns None with `or_none`: the simulator is
        paused, or waits for another participant. Raises `GantryError` if the bus fails or lockstep
        was left.
        """
        tick = self._take(timeout)
        return tick if tick is not None or or_none else self._timed_out(timeout)

    def _timed_out(self, timeout: float | None) -> Tick:
        raise TimedOutError(
            f"no tick came within {timeout} s for {self.name!r} in lockstep; the simulator is paused, waits for another participant, or has ended. "
            "Pass a longer timeout=, or or_none=True"
        )

    def _take(self, timeout: float | None) -> Tick | None:
        return self._tick(self._native.next(timeout, self._is_whole))

    def _tick(self, found: tuple[int, int, tuple[bytes, bytes]] | None) -> Tick | None:
        if found is None:
            return None
        number, _, parts = found
        self._last = number
        note_tick(self._domain, number)
        return Tick.of(number, parse_snapshot(*parts))

    @overload
    async def anext(self, timeout: float | None = PATIENCE, *, or_none: Literal[False] = False) -> Tick: ...
    @overload
    async def anext(self, timeout: float | None = PATIENCE, *, or_none: bool) -> Tick | None: ...

    async def anext(self, timeout: float | None = PATIENCE, *, or_none: bool = False) -> Tick | None:
        """As `next`, in an event loop: other tasks run while it waits, and no thread is used."""
        try:
            tick = await asyncio.wait_for(self._anext(None), timeout)
        except asyncio.TimeoutError:
            return None if or_none else self._timed_out(timeout)
        if tick is None and not or_none:
            raise GantryError(f"lockstep {self.name!r} was left")
        return tick

    def _life(self) -> Life:
        life = Life(self._simulator_lives, lambda: None)
        life.came()
        return life

    def _simulator_lives(self) -> bool:
        try:
            return native.publisher_alive(self._domain, "world/info")
        except GantryError:
            # It is being made or removed.
            return True

    async def _anext(self, life: Life | None) -> Tick | None:
        while not self._closed:
            tick = self._take(0.0)
            if tick is not None or (life is not None and life.has_ended()):
                return tick
            await self._readable.wait(None if life is None else LIFE_SECS)
        return None

    def _next_or_end(self, life: Life) -> Tick | None:
        while not self._closed:
            try:
                tick = self._take(LIFE_SECS)
            except GantryError:
                if self._closed:
                    return None
                raise
            if tick is not None or life.has_ended():
                return tick
        return None

    def __iter__(self) -> Iterator[Tick]:
        while not self._closed and (tick := self._next_or_end(self._life())) is not None:
            yield tick

    async def __aiter__(self) -> AsyncIterator[Tick]:
        while not self._closed and (tick := await self._anext(self._life())) is not None:
            yield tick


class _WholeTicks(Lockstep):
    """Ticks that are waited for until every frame of them was sent: one wake-up for each."""

    _is_whole = True

    def begun(self) -> Tick | None:
        """Returns the next tick if it has begun, though frames of it are still made."""
        return self._tick(self._native.next(0.0, False))


class LockstepRow(Row):
    """What the topics sent of one tick in lockstep, by topic; a topic that sent nothing is not in it."""

    #: The world after this tick.
    snapshot: Snapshot


class LockstepRows:
    """A place in lockstep with the topics that are read in it: an iterator over a row for each tick.

    The world stands still until the next row is asked for. Frames of ticks before the first row are
    dropped, so that nothing has to be drained. Otherwise as `Lockstep`.
    """

    def __init__(self, name: str, topics: Sequence[str], domain: str, timeout: float, results_secs: float) -> None:
        self._topics: dict[str, Topic[Any]] = {}
        self._heads: dict[str, Any] = {}
        self._results_secs = results_secs
        self._lockstep: _WholeTicks | None = None
        try:
            for topic in topics:
                self._topics[topic] = open_topic(topic, domain, timeout)
            # Joined last, so that every topic is open at the first tick.
            self._lockstep = _WholeTicks(name, domain, timeout)
        except BaseException:
            self.close()
            raise
        self._place: _WholeTicks = self._lockstep

    def __enter__(self) -> LockstepRows:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<gantry.LockstepRows {self._place!r} {', '.join(self._topics)}>"

    def close(self) -> None:
        """Leaves lockstep and closes the topics."""
        if self._lockstep is not None:
            self._lockstep.close()
        topics, self._topics, self._heads = self._topics, {}, {}
        for topic in topics.values():
            topic.close()

    @property
    def restarts(self) -> int:
        """Number of times that the simulator was restarted and joined again."""
        return self._place.restarts

    @property
    def counts(self) -> dict[str, Counts]:
        """What was received and missed, by topic."""
        return {name: topic.counts for name, topic in self._topics.items()}

    def acknowledge(self) -> None:
        """Says that this program is done with the last tick, before the next row is asked for."""
        self._place.acknowledge()

    @overload
    def next(self, timeout: float | None = PATIENCE, *, or_none: Literal[False] = False) -> LockstepRow: ...
    @overload
    def next(self, timeout: float | None = PATIENCE, *, or_none: bool) -> LockstepRow | None: ...

    def next(self, timeout: float | None = PATIENCE, *, or_none: bool = False) -> LockstepRow | None:
        """Acknowledges the last row, and waits for the next. Raises as `Lockstep.next`."""
        tick = self._place.next(timeout, or_none=True) or self._place.begun()
        if tick is None and not or_none:
            self._place._timed_out(timeout)
        return None if tick is None else self._row(tick)

    def _row(self, tick: Tick) -> LockstepRow:
        self._place.wait_frames()
        samples: dict[str, Frame] = {}
        deadline = time.monotonic() + self._results_secs
        for name, topic in self._topics.items():
            sample = self._of_tick(name, topic, tick, deadline)
            if sample is not None:
                samples[name] = sample
            del sample
        return LockstepRow(samples, tick.snapshot)

    def _of_tick(self, name: str, topic: Topic[Any], tick: Tick, deadline: float) -> Any:
        """Returns the newest sample of a topic that is of this tick; older ones are dropped, later ones kept."""
        found = None
        while True:
            sample = self._heads.pop(name, None)
            if sample is None:
                sample = topic.poll()
            if sample is None and found is None and topic.result is not None and topic.has_writer:
                # Another participant may still work on it.
                left = deadline - time.monotonic()
                sample = topic.next(left, or_none=True) if left > 0.0 else None
            if sample is None:
                return found
            # A result that answers no frame has the epoch 0.
            is_of_run = sample.epoch in (0, tick.snapshot.epoch)
            if is_of_run and sample.tick > tick:
                self._heads[name] = sample
                return found
            if is_of_run and sample.tick == tick:
                found = sample
            del sample

    def __iter__(self) -> Iterator[LockstepRow]:
        for tick in self._place:
            row = self._row_or_none(tick)
            if row is not None:
                yield row
            del row

    def _row_or_none(self, tick: Tick) -> LockstepRow | None:
        try:
            return self._row(tick)
        except GantryError:
            if self._topics and self._place._simulator_lives():
                raise
            # It ended with this tick, or this place was left; what comes next is up to the ticks.
            return None

    async def __aiter__(self) -> AsyncIterator[LockstepRow]:
        async for tick in self._place:
            row = await asyncio.to_thread(self._row_or_none, tick)
            if row is not None:
                yield row
            del row


@overload
def lockstep(name: str, domain: str | None = None, timeout: float = PATIENCE, *, topics: None = None, results_secs: float = 1.0) -> Lockstep: ...
@overload
def lockstep(name: str, domain: str | None = None, timeout: float = PATIENCE, *, topics: Sequence[str], results_secs: float = 1.0) -> LockstepRows: ...


def lockstep(
    name: str, domain: str | None = None, timeout: float = PATIENCE, *, topics: Sequence[str] | None = None, results_secs: float = 1.0
) -> Lockstep | LockstepRows:
    """Joins lockstep as `name`, which no other process may use (at most 40 bytes).

    With `topics` it yields a row for each tick, with what they sent of it and the world:

        with gantry.lockstep("planner", topics=["ego/front/rgb"]) as rows:
            car = gantry.ego()
            for row in rows:                # the world stands still until the next turn
                car.control(throttle=0.3, steer=where_to(row["ego/front/rgb"].rgb))

    Frames are complete then: a topic that is not in the row did not fire. A topic of results is
    waited for while it has a writer, for all of them at most `results_secs` seconds of a tick.
    Without `topics` it yields ticks.

    Waits up to `timeout` seconds for a simulator and for each topic. Raises `NoSuchTopicError`
    without one, `TimedOutError` after `timeout` seconds without an answer, and `GantryError` if the
    name is taken.
    """
    if topics is None:
        return Lockstep(name, resolve(domain), timeout)
    return LockstepRows(name, topics, resolve(domain), timeout, results_secs)
