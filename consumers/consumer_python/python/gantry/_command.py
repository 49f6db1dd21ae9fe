"""Commands to the simulator, as JSON over `control/world`."""

from __future__ import annotations

import json
from typing import Any

from . import _layout
from ._domain import resolve
from ._errors import GantryError
from ._load import native
from ._patience import PATIENCE


def command(*commands: dict[str, Any], domain: str | None = None, timeout: float = PATIENCE) -> list[dict[str, Any]]:
    """Sends commands, e.g. `gantry.command({"do": "step", "n": 1})`, and returns their replies.

    SPEC.md §7 lists commands and replies; there is one reply per command, in order. Raises
    `NoSuchTopicError` at once without a simulator, `TimedOutError` after `timeout` seconds without an
    answer, and `GantryError` with the simulator's sentence for a refused command; the commands before
    and after a refused one were done.
    """
    batch = json.dumps({"v": _layout.COMMAND_VERSION, "commands": list(commands)})
    answer = native.command(resolve(domain), batch, timeout)
    replies: list[dict[str, Any]] = json.loads(answer)["replies"]
    for reply in replies:
        if reply.get("is") == "refused":
            raise GantryError(f"the simulator refused: {reply['error']}")
    return replies
