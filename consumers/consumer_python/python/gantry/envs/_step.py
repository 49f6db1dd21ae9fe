"""What a reward of the user's own is computed from."""

from __future__ import annotations

from typing import Any, Callable, Mapping, NamedTuple

import numpy as np
import numpy.typing as npt
from typing_extensions import TypeAlias


class Step(NamedTuple):
    """A step of all worlds: arrays with a row per world. Where an episode ended, they are those of its last step."""

    #: Columns are STATE_NAMES.
    state: npt.NDArray[np.float32]
    #: Columns by INFO_NAMES.
    info: Mapping[str, npt.NDArray[Any]]
    #: The task's own reward.
    reward: npt.NDArray[np.float32]
    terminated: npt.NDArray[np.bool_]
    truncated: npt.NDArray[np.bool_]


#: A reward of the user's own: a number for each row of a step.
Reward: TypeAlias = Callable[[Step], npt.ArrayLike]


def rewarded(reward: Reward, step: Step) -> npt.NDArray[np.float32]:
    """What a user's function makes of a step, checked."""
    n = len(step.reward)
    made = np.asarray(reward(step), np.float32)
    if made.shape != (n,):
        raise ValueError(f"reward= made an array of the shape {made.shape} of {n} worlds; it must be {(n,)}")
    if not np.isfinite(made).all():
        world = int(np.flatnonzero(~np.isfinite(made))[0])
        raise ValueError(f"reward= made {made[world]} of the step of world {world}; it must be a finite number")
    return made
