"""Compares figures of lines of lanes with those of OpenLane-V2's development kit.

Its solver (OR-tools' minimum cost flow) is stood in for by SciPy's assignment, which solves the same problem. Errors of
partners, which the kit no longer has, are computed with SciPy's interpolation.
"""

import math

import numpy as np
from metrics_kit import judge, mean, one_file_of
from scipy.interpolate import interp1d
from scipy.optimize import linear_sum_assignment

kit = one_file_of("openlanev2", "centerline/evaluation/f_score.py", solver="ortools.graph.pywrapgraph")
STEPS = np.linspace(3, 103, num=100, endpoint=False)
PARTNERS = []


def solve(_, costs):
    PARTNERS[:] = [(row, column, costs[row, column]) for row, column in zip(*linear_sum_assignment(costs))]
    return PARTNERS


kit.SolveMinCostFlow = solve


def visible(line):
    return (line[:, 0].min() <= STEPS) & (STEPS <= line[:, 0].max())


def lanes(case):
    figures = {}
    for threshold in (0.5, 1.0, 1.5):
        kit_eval = kit.LaneEval()
        kit_eval.x_samples, kit_eval.dist_th = STEPS, threshold
        counts = np.zeros(4)
        errors = [[], [], [], []]
        for frame in case["frames"]:
            lines = [[np.array(line) for line in frame[name]] for name in ("truths", "results")]
            if not case["use_height"]:
                lines = [[line * [1, 1, 0] for line in part] for part in lines]
            truths, results = ([line for line in part if visible(line).sum() > 1] for part in lines)
            PARTNERS.clear()
            categories = [[1] * len(part) for part in lines]
            found, right, _, n_truths, n_results, _ = kit_eval.bench(list(lines[1]), categories[1], list(lines[0]), categories[0])
            assert (n_truths, n_results) == (len(truths), len(results))
            counts += [found, right, n_truths, n_results]
            whole = [[np.array(line) for line in frame[name]] for name in ("truths", "results")]
            truths, results = ([line for line in part if visible(line).sum() > 1] for part in whole)
            for row, column, cost in PARTNERS:
                if cost < threshold * len(STEPS):
                    both = visible(truths[row]) & visible(results[column])
                    off = [np.abs(np.subtract(*(interp1d(line[:, 0], line[:, axis])(STEPS[both]) for line in (truths[row], results[column])))) for axis in (1, 2)]
                    far = STEPS[both] > 40
                    for place, part in enumerate([off[0][~far], off[0][far], off[1][~far], off[1][far]]):
                        if len(part):
                            errors[place].append(part.mean())
        found, right, n_truths, n_results = counts
        recall = found / n_truths if n_truths else math.nan
        precision = right / n_results if n_results else math.nan
        both = np.nan_to_num([recall, precision])
        f1 = math.nan if math.isnan(recall) and math.isnan(precision) else 2 * both.prod() / max(both.sum(), 1e-12)
        named = {"F1": f1, "precision": precision, "recall": recall}
        named |= dict(zip(("lateral_near", "lateral_far", "height_near", "height_far"), map(mean, errors)))
        figures |= {f"{name}@{threshold:g}m": value for name, value in named.items()}
        figures |= named
    return figures


judge({"lanes": lanes})
