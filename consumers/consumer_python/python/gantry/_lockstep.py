"""Lockstep: the simulator begins no tick before this program is done with the last one."""

from __future__ import annotations

import asyncio
import json
import time
from typing import AsyncIterator, Iterator

from . import _layout
from ._asyncio import Readable
from ._control import note_tick
from ._domain import resolve
from ._errors import GantryError
from ._load import native
from ._world import Snapshot, parse_snapshot

#: Between two questions whether a tick has ended, seconds.
_ASK_AGAIN_SECS = 0.0005


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
    run is joined under the same name.
    """

    def __init__(self, name: str, domain: str, timeout: float) -> None:
        #: Name of the participant.
        self.name: str = name
        self._domain = domain
        self._native = native.Lockstep(domain, name, timeout)
        self._readable = Readable(self._native.fileno)
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
        `GantryError` after `timeout` seconds without an answer, and if lockstep was left.
        """
        if self._closed:
            raise GantryError(f"lockstep {self.name!r} was left")
        ping = json.dumps({"v": _layout.COMMAND_VERSION, "commands": [{"do": "ping"}]})
        deadline = time.monotonic() + timeout
        # Whoever keeps the ticks answers between two of them only, when all of the last was sent.
        while json.loads(native.command(self._domain, ping, max(0.0, deadline - time.monotonic())))["tick"] < self._last:
            time.sleep(_ASK_AGAIN_SECS)

    def next(self, timeout: float | None = None) -> Tick | None:
        """Acknowledges the last tick, and waits for the next one (None: without a limit).

        Returns None if none has come after `timeout` seconds: the simulator is paused, or waits for
        another participant. Raises `GantryError` if the bus fails or lockstep was left.
        """
        found = self._native.next(timeout)
        if found is None:
            return None
        number, _, parts = found
        self._last = number
        note_tick(self._domain, number)
        return Tick.of(number, parse_snapshot(*parts))

    async def anext(self, timeout: float | None = None) -> Tick | None:
        """As `next`, in an event loop: other tasks run while it waits, and no thread is used."""
        try:
            return await asyncio.wait_for(self._anext(), timeout)
        except asyncio.TimeoutError:
            return None

    async def _anext(self) -> Tick | None:
        while not self._closed:
            tick = self.next(0.0)
            if tick is not None:
                return tick
            await self._readable.wait()
        return None

    def __iter__(self) -> Iterator[Tick]:
        while not self._closed:
            try:
                tick = self.next()
            except GantryError:
                if self._closed:
                    return
                raise
            if tick is not None:
                yield tick

    async def __aiter__(self) -> AsyncIterator[Tick]:
        while not self._closed:
            tick = await self._anext()
            if tick is not None:
                yield tick


def lockstep(name: str, domain: str | None = None, timeout: float = 5.0) -> Lockstep:
    """Joins lockstep as `name`, which no other process may use (at most 40 bytes).

        with gantry.lockstep("planner") as lockstep, gantry.open("ego/front/rgb") as camera:
            for tick in lockstep:           # the world stands still until the next turn
                frame = camera.next(timeout=1.0)
                gantry.vehicle(ego).control(throttle=0.3)

    Raises `GantryError` without a simulator, after `timeout` seconds without an answer, and if the
    name is taken.
    """
    return Lockstep(name, resolve(domain), timeout)
