"""Driving tasks for learning, as environments of gymnasium: many worlds in one process, with full physics.

    import gymnasium as gym, gantry.envs

    envs = gym.make_vec("gantry/LaneKeeping-v0", num_envs=1024)
    observations, infos = envs.reset(seed=7)
    observations, rewards, terminated, truncated, infos = envs.step(envs.action_space.sample())

The import registers `gantry/LaneKeeping-v0`, `gantry/EmergencyBrake-v0`, and `gantry/Task-v0`, which takes
`task=` the path of a file like the built-in ones (`task_text`). `gym.make` gives one world. World k of a
vector is, to the byte, the world that has its seed and actions alone, whatever the number of threads.
An observation has the columns STATE_NAMES, an action ACTION_NAMES, and an info INFO_NAMES. `evaluate`
judges a policy, and `python -m gantry.envs.ars` trains one. No simulator is started: worlds live in
the process itself, without bus and pictures. It needs gymnasium: `pip install 'gantry-sim[envs]'`.
"""

try:
    import gymnasium as _gymnasium
except ImportError as cause:
    raise ImportError(f"gantry.envs needs gymnasium, which cannot be imported ({cause}); pip install 'gantry-sim[envs]'") from cause

from ._evaluate import Evaluation, Interval, Policy, evaluate
from ._single import DriveEnv
from ._step import Reward, Step
from ._tasks import ACTION_NAMES, INFO_NAMES, STATE_NAMES, task_names, task_text
from ._vector import DriveVectorEnv

__all__ = [
    "ACTION_NAMES", "DriveEnv", "DriveVectorEnv", "Evaluation", "INFO_NAMES", "Interval", "Policy", "Reward", "STATE_NAMES", "Step", "evaluate",
    "task_names", "task_text",
]  # fmt: skip


def _register() -> None:
    names = {f"gantry/{name}-v0": {"task": name} for name in task_names()}
    for name, kwargs in {**names, "gantry/Task-v0": {}}.items():
        if name not in _gymnasium.registry:
            _gymnasium.register(name, entry_point="gantry.envs:DriveEnv", vector_entry_point="gantry.envs:DriveVectorEnv", kwargs=dict(kwargs))


_register()
