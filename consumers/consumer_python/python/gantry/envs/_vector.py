"""Many worlds as a vector environment of gymnasium."""

from __future__ import annotations

import os
from typing import Any, Sequence

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from ._single import check_options, spaces
from ._step import Reward, Step, rewarded
from ._worlds import Arrays, Held, seed_of


class DriveVectorEnv(VectorEnv[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[Any]]):
    """Many worlds of a task, what `gym.make_vec("gantry/LaneKeeping-v0", num_envs=1024)` gives.

    `task`, `reward` and `routes_seed` are those of `DriveEnv`. `autoreset_mode` is gymnasium's; with
    `SAME_STEP`, the usual one, `final_obs` and `final_info` of the infos hold the end of episodes that ended.
    `threads` is that of the processors if it is None; results do not depend on it. Each call returns new
    arrays; with `copy=False` it fills those of the call before.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}

    def __init__(
        self,
        task: str | os.PathLike[str],
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        threads: int | None = None,
        copy: bool = True,
        reward: Reward | None = None,
        routes_seed: int = 1,
        render_mode: str | None = None,
    ) -> None:
        if render_mode is not None:
            raise ValueError(f"render_mode is {render_mode!r}; these worlds have no pictures, so that it can only be None")
        try:
            self._mode = AutoresetMode(autoreset_mode)
        except ValueError:
            modes = ", ".join(repr(mode.value) for mode in AutoresetMode)
            raise ValueError(f"autoreset_mode is {autoreset_mode!r}; it must be one of {modes}") from None
        self._held = Held(task, num_envs, threads, self._mode.value, routes_seed, copy)
        self.metadata = {**type(self).metadata, "autoreset_mode": self._mode}
        self.num_envs = self._held.n_worlds
        #: Steps after which an episode is truncated, and the length of a step.
        self.limit_steps, self.step_secs = self._held.limit_steps, self._held.step_secs
        self.single_observation_space, self.single_action_space = spaces()
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._reward = reward
        self._has_begun = np.zeros(self.num_envs, np.bool_)
        self._has_ended = np.zeros(self.num_envs, np.bool_)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[npt.NDArray[np.float32], dict[str, Any]]:
        """Begins the worlds of `options["reset_mask"]` anew, or all: world k with `seed + k`, or the k-th of a list.

        Without a seed, worlds begin the next episode of their last one.
        """
        check_options(options, ("reset_mask",))
        mask = self._mask((options or {}).get("reset_mask"))
        seeds = self._seeds(seed)
        super().reset(seed=seed if isinstance(seed, int) else None)
        if not (mask | self._has_begun).all():
            left_out = int(np.flatnonzero(~(mask | self._has_begun))[0])
            raise ValueError(f"options['reset_mask'] leaves out world {left_out}, which was never reset; reset all worlds first")
        fresh = mask & ~self._has_begun
        for world in np.flatnonzero(fresh):
            if seeds[world] is None:
                seeds[world] = int(self.np_random.integers(1 << 63))
        seeded = mask & np.array([seed is not None for seed in seeds])
        if (mask & ~seeded).any():
            arrays = self._held.begin_next(mask & ~seeded)
        if seeded.any():
            arrays = self._held.reset(seeded, [seed or 0 for seed in seeds])
        self._has_begun |= mask
        self._has_ended &= ~mask
        infos = arrays.infos(np.zeros(self.num_envs, np.bool_))
        return arrays.state, _with_masks(infos, mask)

    def step(
        self, actions: npt.ArrayLike
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.bool_], npt.NDArray[np.bool_], dict[str, Any]]:
        """Steps all worlds."""
        arrays = self._held.step(actions)
        ended = arrays.terminated | arrays.truncated
        reward = arrays.reward
        if self._reward is not None:
            reward = self._rewarded(self._reward, arrays)
        infos = _with_masks(arrays.infos(~arrays.has_final), np.ones(self.num_envs, np.bool_))
        if arrays.has_final.any():
            infos["final_obs"] = _rows(arrays)
            infos["_final_obs"] = arrays.has_final.copy()
            infos["final_info"] = _with_masks(arrays.infos(arrays.has_final), arrays.has_final)
            infos["_final_info"] = arrays.has_final.copy()
        self._has_ended = ended if self._mode != AutoresetMode.SAME_STEP else np.zeros_like(ended)
        return arrays.state, reward, arrays.terminated, arrays.truncated, infos

    def fork(self, source: int, into: Sequence[int]) -> npt.NDArray[np.float32]:
        """Makes the worlds `into` futures of the world `source`: they go on from its present moment. Returns the observations.

        The seeds of their later episodes stay their own.
        """
        arrays = self._held.fork(source, into)
        for world in into:
            self._has_begun[world] = True
            self._has_ended[world] = self._has_ended[source]
        return arrays.state

    def close_extras(self, **kwargs: Any) -> None:
        """Lets go of the worlds."""
        self._held.close()

    def _rewarded(self, reward: Reward, arrays: Arrays) -> npt.NDArray[np.float32]:
        state = np.where(arrays.has_final[:, None], arrays.final_state, arrays.state)
        made = rewarded(reward, Step(state, arrays.infos(), arrays.reward, arrays.terminated, arrays.truncated))
        # The step in which a world begins anew is worth nothing.
        return np.where(self._has_ended, np.float32(0), made)

    def _mask(self, mask: Any) -> npt.NDArray[np.bool_]:
        if mask is None:
            return np.ones(self.num_envs, np.bool_)
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (self.num_envs,) or not mask.any():
            kind = f"{mask.dtype} {mask.shape}" if isinstance(mask, np.ndarray) else type(mask).__name__
            raise ValueError(f"options['reset_mask'] is {kind}; it must be an array of bool of the shape ({self.num_envs},) that names at least one world")
        return np.ascontiguousarray(mask)

    def _seeds(self, seed: Any) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, (int, np.integer)):
            first = seed_of("seed", seed)
            return [(first + k) & ((1 << 64) - 1) for k in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"seed has {len(seed)} seeds for {self.num_envs} worlds")
        return [None if one is None else seed_of(f"seed of world {world}", one) for world, one in enumerate(seed)]


def _with_masks(infos: dict[str, Any], mask: npt.NDArray[np.bool_]) -> dict[str, Any]:
    return {key: value for name, column in infos.items() for key, value in ((name, column), (f"_{name}", mask.copy()))}


def _rows(arrays: Arrays) -> npt.NDArray[np.object_]:
    """An array of observations, None where no episode ended, as gymnasium's own vectors have it."""
    rows = np.full(len(arrays.has_final), None, object)
    for world in np.flatnonzero(arrays.has_final):
        rows[world] = arrays.final_state[world].copy()
    return rows

