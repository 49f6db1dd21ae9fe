"""The worlds beneath both kinds of environment: arrays that the simulator fills, and checks of what goes in."""

from __future__ import annotations

import os
from typing import Any, NamedTuple, Sequence

import numpy as np
import numpy.typing as npt

from .._load import native
from ._tasks import ACTION_NAMES, FLAG_NAMES, INFO_NAMES, STATE_NAMES, task_text

#: Worlds for each thread at least; fewer are not worth a thread.
_WORLDS_PER_THREAD = 4
#: Seeds are as many bits as the simulator's.
_MOST_SEED = (1 << 64) - 1


class Arrays(NamedTuple):
    """What came of a call, a row per world."""

    state: npt.NDArray[np.float32]
    reward: npt.NDArray[np.float32]
    terminated: npt.NDArray[np.bool_]
    truncated: npt.NDArray[np.bool_]
    info: npt.NDArray[np.float32]
    final_state: npt.NDArray[np.float32]
    has_final: npt.NDArray[np.bool_]

    @classmethod
    def empty(cls, n: int) -> Arrays:
        numbers = np.empty((2, n, len(STATE_NAMES)), np.float32)
        flags = np.empty((3, n), np.bool_)
        return cls(
            numbers[0], np.empty(n, np.float32), flags[0], flags[1], np.empty((n, len(INFO_NAMES)), np.float32), numbers[1], flags[2]
        )

    def infos(self, rows: npt.NDArray[np.bool_] | None = None) -> dict[str, npt.NDArray[Any]]:
        """The columns of the info by name; 0 beside `rows`."""
        info = self.info if rows is None else np.where(rows[:, None], self.info, np.float32(0))
        return {name: info[:, i] != 0 if name in FLAG_NAMES else info[:, i].astype(np.float64) for i, name in enumerate(INFO_NAMES)}


def threads_of(threads: int | None, n_worlds: int) -> int:
    """The number of threads, by the processors of this process and the number of worlds if none is given."""
    if threads is None:
        return max(1, min(len(os.sched_getaffinity(0)), n_worlds // _WORLDS_PER_THREAD))
    return whole("threads", threads, 1024)


def whole(what: str, value: Any, most: int, least: int = 1) -> int:
    """A whole number within limits."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not least <= value <= most:
        raise ValueError(f"{what} is {value!r}; it must be a whole number from {least} to {most}")
    return int(value)


def seed_of(what: str, seed: Any) -> int:
    """A seed, checked."""
    return whole(what, seed, _MOST_SEED, 0)


class Held:
    """Worlds of a task, with arrays of their own or new ones for each call."""

    def __init__(self, task: str | os.PathLike[str], n_worlds: int, threads: int | None, autoreset: str, town_seed: int, copy: bool) -> None:
        n_worlds = whole("num_envs", n_worlds, 65_536)
        self.n_worlds = n_worlds
        self.worlds = native.Worlds(task_text(task), n_worlds, threads_of(threads, n_worlds), autoreset, seed_of("routes_seed", town_seed))
        self.name, self.limit_steps, self.step_secs = self.worlds.task()
        self._own = None if copy else Arrays.empty(n_worlds)

    def _arrays(self) -> Arrays:
        return self._own or Arrays.empty(self.n_worlds)

    def step(self, actions: Any) -> Arrays:
        arrays = self._arrays()
        self.worlds.step(self._actions(actions), arrays)
        return arrays

    def reset(self, mask: npt.NDArray[np.bool_], seeds: Sequence[int]) -> Arrays:
        arrays = self._arrays()
        self.worlds.reset(mask, np.array(seeds, np.uint64), arrays)
        return arrays

    def begin_next(self, mask: npt.NDArray[np.bool_]) -> Arrays:
        arrays = self._arrays()
        self.worlds.begin_next(mask, arrays)
        return arrays

    def fork(self, source: int, into: Sequence[int]) -> Arrays:
        last = self.n_worlds - 1
        for world in (source, *into):
            if isinstance(world, bool) or not isinstance(world, (int, np.integer)) or not 0 <= world <= last:
                raise ValueError(f"there is no world {world!r}; there are 0 to {last}")
        arrays = self._arrays()
        self.worlds.fork(int(source), [int(world) for world in into], arrays)
        return arrays

    def close(self) -> None:
        self.worlds.close()

    def _actions(self, actions: Any) -> npt.NDArray[np.float32]:
        shape = (self.n_worlds, len(ACTION_NAMES))
        needed = f"{' and '.join(ACTION_NAMES)} of each of {self.n_worlds} worlds, an array of the shape {shape}"
        if isinstance(actions, (list, tuple)) and len(actions) == self.n_worlds:
            for world, one in enumerate(actions):
                if np.shape(one) != shape[1:]:
                    raise ValueError(f"the action of world {world} has the shape {np.shape(one)}, but {shape[1:]} is needed: {needed}")
        try:
            with np.errstate(over="ignore"):
                array = np.ascontiguousarray(actions, np.float32)
        except (TypeError, ValueError) as cause:
            raise ValueError(f"the actions are no numbers ({cause}); needed are {needed}") from cause
        if array.shape != shape:
            raise ValueError(f"the actions have the shape {array.shape}; needed are {needed}")
        return array

