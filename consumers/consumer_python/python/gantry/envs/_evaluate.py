"""How well a policy does a task: episodes of given seeds, with intervals, judged by the task."""

from __future__ import annotations

import dataclasses
import math
import os
from typing import Callable, Iterable, NamedTuple

import numpy as np
import numpy.typing as npt
from typing_extensions import TypeAlias

from ._tasks import FLAG_NAMES, INFO_NAMES
from ._worlds import Held, seed_of

#: Actions for a batch of observations: (n, len(STATE_NAMES)) to (n, len(ACTION_NAMES)).
Policy: TypeAlias = Callable[[npt.NDArray[np.float32]], npt.ArrayLike]

#: Standard normal deviate of a two-sided interval of 95 %.
_Z95 = 1.959963984540054
_N_RESAMPLES = 10_000
_MOST_WORLDS = 256


class Interval(NamedTuple):
    """A mean or a share with its interval of 95 %."""

    value: float
    low: float
    high: float


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """What came of `evaluate`: arrays have an entry per seed, in their order."""

    #: Name of the task.
    task: str
    #: The seeds.
    seeds: npt.NDArray[np.uint64]
    #: Sum of the rewards over the limit of steps, which the task's `solved` is about.
    scores: npt.NDArray[np.float64]
    #: Steps of each episode.
    steps: npt.NDArray[np.int64]
    #: How each episode ended: by contact, off the lane, by a needless and by a safe stop; none of them if it was cut off.
    contact: npt.NDArray[np.bool_]
    off_lane: npt.NDArray[np.bool_]
    needless_stop: npt.NDArray[np.bool_]
    safe_stop: npt.NDArray[np.bool_]
    #: Mean score; its interval is the percentile bootstrap's over episodes, 10 000 resamples.
    score: Interval
    #: Share of episodes that ended by contact or off the lane, with Wilson's score interval.
    failed: Interval
    #: Share of episodes that ended by a needless stop, with Wilson's score interval.
    needless: Interval
    #: Whether the task is solved by its own rule; None if there are fewer seeds than it asks for.
    solved: bool | None
    #: The rule's figures beside what was found, a sentence.
    verdict: str


def evaluate(
    policy: Policy, task: str | os.PathLike[str], seeds: Iterable[int], *, threads: int | None = None, routes_seed: int = 1
) -> Evaluation:
    """Lets a policy drive one episode of each seed, and judges it by the task's own rule.

    `policy` is given a batch of observations and returns as many actions; it must not remember anything between calls,
    because rows of later calls may be other episodes. Use seeds that were not trained on: environments that train from
    `reset(seed=s)` use s, s + 1, … and seeds that are drawn from them.

    >>> result = gantry.envs.evaluate(policy, "LaneKeeping", range(10_000, 10_020))     # doctest: +SKIP
    >>> result.score, result.solved
    """
    wanted = [seed_of(f"seeds[{i}]", seed) for i, seed in enumerate(seeds)]
    if not wanted:
        raise ValueError("seeds is empty; name at least one")
    n = min(len(wanted), _MOST_WORLDS)
    held = Held(task, n, threads, "Disabled", routes_seed, copy=True)
    try:
        figures = _episodes(policy, held, wanted)
        return _judged(held, wanted, figures)
    finally:
        held.close()


class _Figures(NamedTuple):
    returns: npt.NDArray[np.float64]
    steps: npt.NDArray[np.int64]
    flags: npt.NDArray[np.bool_]


def _episodes(policy: Policy, held: Held, seeds: list[int]) -> _Figures:
    n, n_all = held.n_worlds, len(seeds)
    figures = _Figures(np.zeros(n_all), np.zeros(n_all, np.int64), np.zeros((n_all, len(FLAG_NAMES)), np.bool_))
    columns = [INFO_NAMES.index(name) for name in FLAG_NAMES]
    # Which episode a world has; beyond the last one it drives for nothing.
    episode = np.arange(n)
    n_begun, n_ended = n, 0
    state = held.reset(np.ones(n, np.bool_), seeds[:n]).state
    while n_ended < n_all:
        out = held.step(policy(state.copy()))
        state = out.state
        counts = np.flatnonzero(episode < n_all)
        # In double precision, and in the order of the steps, so that neighbours change nothing.
        figures.returns[episode[counts]] += out.reward[counts]
        figures.steps[episode[counts]] += 1
        ended = out.terminated | out.truncated
        if not ended.any():
            continue
        for world in np.flatnonzero(ended):
            if episode[world] < n_all:
                figures.flags[episode[world]] = out.info[world, columns] != 0
                n_ended += 1
            episode[world] = n_begun
            n_begun = min(n_begun + 1, n_all)
        state = held.reset(ended, [seeds[one] if one < n_all else seeds[0] for one in episode]).state
    return figures


def _judged(held: Held, seeds: list[int], figures: _Figures) -> Evaluation:
    contact, off_lane, needless, safe = figures.flags.T
    scores = figures.returns / held.limit_steps
    n_asked, least_score, most_failed, most_needless = held.worlds.solved()
    score, failed, idle = _bootstrap(scores), _wilson(contact | off_lane), _wilson(needless)
    met = score.value >= least_score and failed.value <= most_failed and idle.value <= most_needless
    solved = met if len(seeds) >= n_asked else None
    word = {True: "solved", False: "not solved", None: f"not judged: the task asks for {n_asked} episodes"}[solved]
    verdict = (
        f"{held.name}, {len(seeds)} episodes: {word}. Mean score {score.value:.3f} (at least {least_score:g}), contact or off the lane "
        f"{failed.value:.1%} (at most {most_failed:.1%}), needless stops {idle.value:.1%} (at most {most_needless:.1%})."
    )
    return Evaluation(
        held.name, np.array(seeds, np.uint64), scores, figures.steps, contact, off_lane, needless, safe, score, failed, idle, solved, verdict
    )


def _wilson(happened: npt.NDArray[np.bool_]) -> Interval:
    """Wilson's score interval of a share (Wilson 1927)."""
    n = len(happened)
    share = float(happened.mean())
    middle = (share + _Z95**2 / (2 * n)) / (1 + _Z95**2 / n)
    half = _Z95 / (1 + _Z95**2 / n) * math.sqrt(share * (1 - share) / n + _Z95**2 / (4 * n**2))
    # Rounding must not move the ends past the share that they enclose.
    return Interval(share, min(max(middle - half, 0.0), share), max(min(middle + half, 1.0), share))


def _bootstrap(scores: npt.NDArray[np.float64]) -> Interval:
    """Percentile bootstrap of a mean, with lots of a fixed seed."""
    lots = np.random.default_rng(0)
    n = len(scores)
    # A part at a time, so that 10 000 episodes need no gigabyte.
    part = max(1, 4_000_000 // n)
    means = [scores[lots.integers(n, size=(min(part, _N_RESAMPLES - at), n))].mean(axis=1) for at in range(0, _N_RESAMPLES, part)]
    low, high = np.quantile(np.concatenate(means), [0.025, 0.975])
    return Interval(float(scores.mean()), float(low), float(high))
