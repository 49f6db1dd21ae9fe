"""Augmented random search (Mania, Guy and Recht 2018, V2-t) in NumPy: a policy learns a task in front of one's eyes.

    python -m gantry.envs.ars                                  lane keeping, about a minute on two processors
    python -m gantry.envs.ars EmergencyBrake --seed 3 --json curve.json --save policy.npz

The policy is linear in normalised observations, and mirrored as the world is: steering depends on what changes its sign
in a mirror, the pedals on the rest and on sizes, because a car brakes before a curve to either side. Each iteration
tries directions from it, both ways, in one vector of worlds, and moves along the best of them. The same seed gives the
same policy, whatever the number of threads. The last lines judge it by the task's own rule, over episodes that it was
not trained on.
"""

from __future__ import annotations

import argparse
import json
import os
import pathlib
import sys
import time
from typing import Any, Callable, NamedTuple

import numpy as np
import numpy.typing as npt

from . import ACTION_NAMES, STATE_NAMES, DriveVectorEnv, Evaluation, Interval, evaluate

#: What is looked at: where the car is and whither the way leads, its speed, and the obstacle. The rates and last actions
#: that are left out would only feed an action back into the next.
_USED = [i for i, name in enumerate(STATE_NAMES) if not name.startswith(("yaw rate", "last", "cos"))]
#: Columns that change their sign in a mirrored world, and those that do not.
_ODD = [i for i in _USED if "offset" in STATE_NAMES[i] or "left" in STATE_NAMES[i] or STATE_NAMES[i] == "sin heading"]
_EVEN = [i for i in _USED if i not in _ODD]
#: Features: odd columns, even columns, sizes of the odd ones that are ahead, a constant.
_SIZED = [i for i in _ODD if STATE_NAMES[i].startswith(("way", "obstacle"))]
_N_ODD, _N_FEATURES = len(_ODD), len(_ODD) + len(_EVEN) + len(_SIZED) + 1
#: A mirrored car steers the other way and drives as fast: which features an action may depend on.
_ALLOWED = np.zeros((len(ACTION_NAMES), _N_FEATURES))
_ALLOWED[ACTION_NAMES.index("steer"), :_N_ODD] = 1
_ALLOWED[ACTION_NAMES.index("accelerate"), _N_ODD:] = 1
#: Training begins its episodes at seeds from here on, evaluation at seeds below.
FIRST_TRAINING_SEED = 1 << 32

Floats = npt.NDArray[np.float64]


class Policy:
    """Actions that are linear in normalised features."""

    def __init__(self) -> None:
        self.weights: Floats = np.zeros((len(ACTION_NAMES), _N_FEATURES))
        self.n = 0.0
        self.mean: Floats = np.zeros(_N_FEATURES - 1)
        self.spread: Floats = np.zeros(_N_FEATURES - 1)

    def features(self, observations: npt.NDArray[np.float32]) -> Floats:
        """What the weights are multiplied by: normalised, with a constant 1."""
        raw = _raw(observations)
        deviation = np.sqrt(self.spread / max(self.n, 1.0))
        # What never changed says nothing.
        scale = np.where(deviation > 1e-6, 1.0 / np.maximum(deviation, 1e-6), 0.0)
        return np.concatenate([(raw - self.mean) * scale, np.ones((len(raw), 1))], axis=1)

    def see(self, observations: npt.NDArray[np.float32]) -> None:
        """Takes observations into the normalisation (Chan, Golub and LeVeque 1983)."""
        raw = _raw(observations)
        n, mean = len(raw), raw.mean(axis=0)
        # Of what changes its sign with the mirror, it is 0.
        mean[:_N_ODD] = 0
        apart = mean - self.mean
        both = self.n + n
        self.spread += ((raw - mean) ** 2).sum(axis=0) + apart**2 * self.n * n / both
        self.mean += apart * n / both
        self.n = both

    def __call__(self, observations: npt.NDArray[np.float32]) -> Floats:
        return self.features(observations) @ self.weights.T

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes it as an .npz file, which `Policy.load` reads."""
        np.savez(path, weights=self.weights, n=self.n, mean=self.mean, spread=self.spread)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Policy:
        """Reads what `save` wrote."""
        policy = cls()
        with np.load(path, allow_pickle=False) as file:
            for name in ("weights", "mean", "spread"):
                if file[name].shape != getattr(policy, name).shape:
                    raise ValueError(f"{os.fspath(path)}: {name} has the shape {file[name].shape}, but {getattr(policy, name).shape} is needed")
                setattr(policy, name, file[name])
            policy.n = float(file["n"])
        return policy


class Settings(NamedTuple):
    """How `train` searches."""

    iterations: int = 40
    #: Directions that are tried, each both ways.
    directions: int = 8
    #: The best of them, which count.
    best: int = 8
    #: Episodes of each try; all tries of an iteration drive the same ones.
    episodes: int = 4
    step: float = 0.12
    noise: float = 0.08
    #: Most steps of an episode in training; what helps shows early, and shorter episodes are more of them.
    horizon: int = 200
    #: What is left of step and noise in the last iteration; they fall evenly.
    left: float = 0.2


class Point(NamedTuple):
    """A point of the curve that `train` returns."""

    iteration: int
    #: Steps of all worlds so far.
    world_steps: int
    #: Wall clock so far.
    secs: float
    #: Mean score of all tries of this iteration: sum of rewards over the most steps of an episode.
    mean_score: float
    #: That of the best try.
    best_score: float


def train(
    task: str | os.PathLike[str],
    settings: Settings = Settings(),
    *,
    seed: int = 0,
    threads: int | None = None,
    report: Callable[[Point], None] | None = None,
) -> tuple[Policy, list[Point]]:
    """Trains a policy; `report` is called with each point of the curve."""
    lots = np.random.default_rng(seed)
    policy, curve = Policy(), []
    envs = DriveVectorEnv(task, 2 * settings.directions, autoreset_mode="Disabled", threads=threads)
    begin, n_steps = time.monotonic(), 0
    try:
        for iteration in range(settings.iterations):
            scale = 1 - (1 - settings.left) * iteration / max(settings.iterations - 1, 1)
            apart = lots.standard_normal((settings.directions, *policy.weights.shape)) * _ALLOWED
            tries = policy.weights + settings.noise * scale * np.concatenate([apart, -apart])
            first = FIRST_TRAINING_SEED + iteration * settings.episodes
            scores, seen = _scores(envs, policy, tries, [first + k for k in range(settings.episodes)], settings)
            n_steps += len(seen)
            ahead, back = scores[: settings.directions], scores[settings.directions :]
            order = np.argsort(-np.maximum(ahead, back), kind="stable")[: settings.best]
            deviation = np.concatenate([ahead[order], back[order]]).std()
            gain = np.tensordot(ahead[order] - back[order], apart[order], axes=1)
            policy.weights = policy.weights + settings.step * scale / (settings.best * max(deviation, 1e-6)) * gain
            policy.see(seen)
            curve.append(Point(iteration, n_steps, time.monotonic() - begin, float(scores.mean()), float(scores.max())))
            if report is not None:
                report(curve[-1])
    finally:
        envs.close()
    return policy, curve


def _scores(envs: DriveVectorEnv, policy: Policy, tries: Floats, seeds: list[int], settings: Settings) -> tuple[Floats, npt.NDArray[np.float32]]:
    """Mean score of each try over episodes of these seeds, and the observations on the way to them.

    There are fewer worlds than episodes, so that a world whose episode ends early begins the next one.
    """
    n_all, n, horizon = len(tries) * len(seeds), envs.num_envs, min(settings.horizon, envs.limit_steps)
    totals, seen = np.zeros(n_all), []
    # Episodes in progress: entry i is try i // len(seeds) with seed i % len(seeds).
    episode, age = np.arange(n), np.zeros(n, np.int64)
    n_begun = n
    observations, _ = envs.reset(seed=[seeds[i % len(seeds)] for i in episode])
    while (drives := episode < n_all).any():
        seen.append(observations[drives])
        weights = tries[np.minimum(episode, n_all - 1) // len(seeds)]
        actions = (weights @ policy.features(observations)[:, :, None])[:, :, 0]
        observations, rewards, terminated, truncated, _ = envs.step(actions)
        totals[episode[drives]] += rewards[drives]
        age += 1
        ended = terminated | truncated | (age >= horizon)
        if ended.any():
            age[ended] = 0
            for world in np.flatnonzero(ended):
                episode[world] = n_begun
                n_begun = min(n_begun + 1, n_all)
            observations, _ = envs.reset(seed=[seeds[i % len(seeds)] for i in episode], options={"reset_mask": ended})
    return totals.reshape(len(tries), -1).mean(axis=1) / horizon, np.concatenate(seen)


def _raw(observations: npt.NDArray[np.float32]) -> Floats:
    wide = observations.astype(np.float64)
    return np.concatenate([wide[:, _ODD], wide[:, _EVEN], np.abs(wide[:, _SIZED])], axis=1)


def show(point: Point) -> None:
    """Prints a point of the curve as a line with a bar."""
    bar = "#" * max(0, round(40 * point.mean_score))
    print(f"{point.iteration:4} {point.secs:6.1f} s {point.world_steps:9} steps  mean {point.mean_score:6.3f}  best {point.best_score:6.3f} {bar}", flush=True)


def main(words: list[str] | None = None) -> int:
    """The program."""
    parser = argparse.ArgumentParser(prog="python -m gantry.envs.ars", description="Trains a policy by augmented random search, and judges it.")
    parser.add_argument("task", nargs="?", default="LaneKeeping", help="built-in task, or the path of a task's file [default: LaneKeeping]")
    parser.add_argument("--iterations", type=int, default=Settings().iterations, metavar="N", help="moves of the policy [default: %(default)s]")
    parser.add_argument("--seed", type=int, default=0, help="of the search [default: 0]")
    parser.add_argument("--threads", type=int, metavar="N", help="of the worlds [default: that of the processors]")
    parser.add_argument("--save", type=pathlib.Path, metavar="FILE", help="write the policy into this .npz file")
    parser.add_argument("--json", type=pathlib.Path, metavar="FILE", help="write the curve and the judgement into this file")
    args = parser.parse_args(words)
    try:
        if args.iterations < 1 or args.seed < 0:
            raise ValueError(f"--iterations is {args.iterations} and --seed {args.seed}; they must be at least 1 and 0")
        policy, curve = train(args.task, Settings(iterations=args.iterations), seed=args.seed, threads=args.threads, report=show)
        judged = evaluate(policy, args.task, range(200), threads=args.threads)
        print(judged.verdict)
        print(f"Score {_words(judged.score)}, contact or off the lane {_words(judged.failed)}; intervals of 95 %.")
        if args.save is not None:
            policy.save(args.save)
        if args.json is not None:
            args.json.write_text(json.dumps(_record(args, curve, judged), indent=1) + "\n")
    except (ValueError, OSError) as cause:
        print(f"error: {cause}", file=sys.stderr)
        return 2
    return 0


def _words(interval: Interval) -> str:
    return f"{interval.value:.3f} ({interval.low:.3f} to {interval.high:.3f})"


def _record(args: argparse.Namespace, curve: list[Point], judged: Evaluation) -> dict[str, Any]:
    figures = {name: getattr(judged, name)._asdict() for name in ("score", "failed", "needless")}
    return {
        "task": judged.task,
        "seed": args.seed,
        "curve": [point._asdict() for point in curve],
        "evaluation": {"episodes": len(judged.seeds), **figures, "solved": judged.solved},
    }


if __name__ == "__main__":
    sys.exit(main())
