"""Waiting in an event loop: for a descriptor that the native half makes readable."""

from __future__ import annotations

import asyncio
import os
from typing import Callable


class Readable:
    """Wakes the tasks of any event loops when a descriptor can be read.

    It waits on duplicates of the descriptor, so that closing the port takes none away from a loop.
    """

    def __init__(self, fileno: Callable[[], int]) -> None:
        self._fileno = fileno
        self._waiting: dict[asyncio.AbstractEventLoop, tuple[int, set[asyncio.Future[None]]]] = {}

    async def wait(self, timeout: float | None = None) -> None:
        """Returns when the descriptor can be read, after `wake`, or after `timeout` seconds."""
        loop = asyncio.get_running_loop()
        if loop not in self._waiting:
            own = os.dup(self._fileno())
            self._waiting[loop] = (own, set())
            loop.add_reader(own, self._wake, loop)
        waiters = self._waiting[loop][1]
        future = loop.create_future()
        waiters.add(future)
        try:
            if timeout is None:
                await future
            else:
                await asyncio.wait([future], timeout=timeout)
        finally:
            waiters.discard(future)
            if not waiters:
                self._wake(loop)

    def wake(self) -> None:
        """Wakes all tasks, of this and of other threads."""
        for loop in list(self._waiting):
            if not loop.is_closed():
                loop.call_soon_threadsafe(self._wake, loop)

    def _wake(self, loop: asyncio.AbstractEventLoop) -> None:
        own, waiters = self._waiting.pop(loop, (-1, set()))
        if own >= 0:
            loop.remove_reader(own)
            os.close(own)
        for future in waiters:
            if not future.done():
                future.set_result(None)
