"""Tasks by name or file, and the names of their columns."""

from __future__ import annotations

import os
import pathlib

from .._load import native

_COLUMNS = native.columns()
#: What an action holds: steering (1 is to the left as far as it goes), and pedals (1 full throttle, -1 full brake).
ACTION_NAMES = tuple(_COLUMNS[0])
#: What an observation holds. Distances and speeds are divided by the number in the name.
STATE_NAMES = tuple(_COLUMNS[1])
#: What an info holds: how the episode ends, and figures of the step.
INFO_NAMES = tuple(_COLUMNS[2])
#: Those of INFO_NAMES that are true or false.
FLAG_NAMES = ("contact", "off_lane", "needless_stop", "safe_stop")

#: A task's file has less than 1 KiB.
_MOST_BYTES = 1 << 20


def task_names() -> list[str]:
    """Names of the built-in tasks."""
    return [name for name, _ in native.tasks()]


def task_text(task: str | os.PathLike[str]) -> str:
    """The file of a task: of a built-in one by its name, otherwise of the path. A task of your own is a changed copy.

    >>> text = gantry.envs.task_text("LaneKeeping")                  # doctest: +SKIP
    >>> pathlib.Path("night.toml").write_text(text.replace('"Town04"', '"Town06"'))
    >>> gym.make("gantry/Task-v0", task="night.toml")
    """
    built_in = dict(native.tasks())
    if isinstance(task, str) and task in built_in:
        return built_in[task]
    path = pathlib.Path(task)
    if not path.is_file():
        raise ValueError(f"task {os.fspath(task)!r} is neither a file nor one of {', '.join(built_in)}")
    if path.stat().st_size > _MOST_BYTES:
        raise ValueError(f"{path} has {path.stat().st_size} bytes, too many for a task; the most is {_MOST_BYTES}")
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as cause:
        raise ValueError(f"{path} is no text: {cause}") from cause
