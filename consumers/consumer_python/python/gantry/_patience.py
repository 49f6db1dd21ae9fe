"""How long calls wait, and how loops learn that what they read has ended."""

from __future__ import annotations

import time
from typing import Callable, TypeVar

from ._errors import NoSuchTopicError

#: Seconds that calls wait if they are told nothing else, so that a script that is started a few
#: seconds before the simulator works; and how long a writer may be away, as one that is restarted
#: is, before a loop over its samples ends.
PATIENCE = 10.0

#: Seconds between two looks for a topic that does not exist yet.
_LOOK_SECS = 0.05
#: Seconds between two looks of a loop whether its writer still lives.
LIFE_SECS = 0.5
#: Seconds between two removals of what killed processes left, without which they seem to live.
_CLEAN_SECS = 2.0

T = TypeVar("T")


def appear(make: Callable[[], T], timeout: float | None) -> T:
    """Calls `make` until the topic that it needs has appeared, at most for `timeout` seconds (None: without a limit)."""
    deadline = None if timeout is None else time.monotonic() + timeout
    while True:
        try:
            return make()
        except NoSuchTopicError:
            if deadline is not None and time.monotonic() >= deadline:
                raise
            time.sleep(_LOOK_SECS)


class Life:
    """Tells a writer that has ended from one that is silent, paused or restarted."""

    def __init__(self, is_there: Callable[[], bool], clean: Callable[[], object]) -> None:
        self._is_there, self._clean = is_there, clean
        self._is_known = False
        self._gone_since: float | None = None
        self._cleaned = time.monotonic()

    def came(self) -> None:
        """Notes that it has sent something."""
        self._is_known, self._gone_since = True, None

    def has_ended(self) -> bool:
        """Returns whether the writer was there and has been away for `PATIENCE`; asked while nothing comes."""
        now = time.monotonic()
        if now - self._cleaned >= _CLEAN_SECS:
            self._cleaned = now
            self._clean()
        if self._is_there():
            self.came()
            return False
        if not self._is_known:
            return False
        if self._gone_since is None:
            self._gone_since = now
        return now - self._gone_since >= PATIENCE
