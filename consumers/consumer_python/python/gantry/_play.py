"""How time goes on: pauses, steps and speed of a simulator or a replay, and jumps of a replay."""

from __future__ import annotations

import json
import time

from . import _layout
from ._command import command
from ._domain import resolve
from ._errors import TimedOutError
from ._load import native
from ._patience import PATIENCE

#: How often `step` asks whether its ticks are done, seconds.
_ASK_EVERY = 0.002


def pause(domain: str | None = None, timeout: float = PATIENCE) -> None:
    """Stops between two ticks: each further tick waits for `step`.

    A simulator goes on by itself 10 s after its last client has gone, unless it was started with
    `--on-lost-client wait`; a replay stands still. Raises as `command`.
    """
    command({"do": "configure", "mode": "stepped"}, domain=domain, timeout=timeout)


def resume(domain: str | None = None, timeout: float = PATIENCE) -> None:
    """Lets ticks follow one another by the clock again. Raises as `command`."""
    command({"do": "configure", "mode": "free_running"}, domain=domain, timeout=timeout)


def step(n: int = 1, domain: str | None = None, timeout: float = 60.0) -> int:
    """Makes `n` ticks and waits until everything of them was sent; returns the last one's number.

    Needs `pause` before it. Raises as `command`, and `TimedOutError` if the ticks are not done
    within `timeout` seconds: a replay is at its end, or a lockstep participant is slow.
    """
    deadline = time.monotonic() + timeout
    (reply,) = command({"do": "step", "n": n}, domain=domain, timeout=timeout)
    last = int(reply["last_tick"])
    ping = json.dumps({"v": _layout.COMMAND_VERSION, "commands": [{"do": "ping"}]})
    while True:
        tick = int(json.loads(native.command(resolve(domain), ping, max(deadline - time.monotonic(), 0.1)))["tick"])
        if tick >= last:
            return tick
        if time.monotonic() > deadline:
            raise TimedOutError(f"tick {last} was not reached within {timeout} s; the world is at tick {tick}")
        time.sleep(_ASK_EVERY)


def set_speed(ratio: float, domain: str | None = None, timeout: float = PATIENCE) -> None:
    """Sets how many simulated seconds go by in a second, 0.01 to 100. Raises as `command`."""
    command({"do": "set_speed", "ratio": float(ratio)}, domain=domain, timeout=timeout)


def seek(sim_time: float, domain: str | None = None, timeout: float = 60.0) -> None:
    """Goes to a time of a replay, seconds: the next tick is the first at that time or later.

    Frames have another `epoch` afterwards, as after a restart. Raises as `command`, also on a live
    simulator, which cannot.
    """
    command({"do": "seek", "sim_nanos": round(sim_time * 1e9)}, domain=domain, timeout=timeout)
