"""One world as an environment of gymnasium."""

from __future__ import annotations

import os
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt

from ._step import Reward, Step, rewarded
from ._tasks import ACTION_NAMES, FLAG_NAMES, INFO_NAMES, STATE_NAMES
from ._worlds import Arrays, Held, seed_of

_ALL = np.ones(1, np.bool_)


def spaces() -> tuple[gym.Space[npt.NDArray[np.float32]], gym.Space[npt.NDArray[np.float32]]]:
    """Those of the observations and actions of one world."""
    observation: Any = gym.spaces.Box(-np.inf, np.inf, (len(STATE_NAMES),), np.float32)
    action: Any = gym.spaces.Box(-1.0, 1.0, (len(ACTION_NAMES),), np.float32)
    return observation, action


def check_options(options: dict[str, Any] | None, known: tuple[str, ...]) -> None:
    """A key that does nothing would be a mistake that nobody sees."""
    for key in options or {}:
        if key not in known:
            raise ValueError(f"options has {key!r}; it may hold {' and '.join(map(repr, known)) or 'nothing'}")


class DriveEnv(gym.Env[npt.NDArray[np.float32], npt.NDArray[np.float32]]):
    """One world of a task, what `gym.make("gantry/LaneKeeping-v0")` gives.

    `task` is the name of a built-in task or the path of a file. `reward` is a function that makes a number
    for each row of a `Step`, in place of the task's own reward. `routes_seed` draws the 64 routes of the
    task in its town: other seeds than 1 are roads that were not trained on. The world of the episode
    follows from the `seed` of `reset`; a reset without one begins the next episode of that seed.
    """

    metadata = {"render_modes": []}

    def __init__(
        self, task: str | os.PathLike[str], *, reward: Reward | None = None, routes_seed: int = 1, render_mode: str | None = None
    ) -> None:
        if render_mode is not None:
            raise ValueError(f"render_mode is {render_mode!r}; these worlds have no pictures, so that it can only be None")
        self.observation_space, self.action_space = spaces()
        self.render_mode = None
        self._held = Held(task, 1, 1, "Disabled", routes_seed, copy=True)
        self._reward = reward
        self._has_begun = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[npt.NDArray[np.float32], dict[str, Any]]:
        """Begins the episode of a seed, or the next one."""
        check_options(options, ())
        if seed is not None:
            seed = seed_of("seed", seed)
        super().reset(seed=seed)
        if seed is None and not self._has_begun:
            seed = int(self.np_random.integers(1 << 63))
        arrays = self._held.begin_next(_ALL) if seed is None else self._held.reset(_ALL, [seed])
        self._has_begun = True
        return arrays.state[0], _info(arrays)

    def step(self, action: npt.NDArray[np.float32]) -> tuple[npt.NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Takes a step."""
        arrays = self._held.step(np.asarray(action)[None])
        reward = arrays.reward
        if self._reward is not None:
            reward = rewarded(self._reward, Step(arrays.state, arrays.infos(), reward, arrays.terminated, arrays.truncated))
        return arrays.state[0], float(reward[0]), bool(arrays.terminated[0]), bool(arrays.truncated[0]), _info(arrays)

    def close(self) -> None:
        """Lets go of the world."""
        self._held.close()


def _info(arrays: Arrays) -> dict[str, Any]:
    values = zip(INFO_NAMES, arrays.info[0])
    return {name: bool(value) if name in FLAG_NAMES else float(value) for name, value in values}
