"""Compares figures of drives: derivatives with SciPy's Savitzky-Golay filter, times to collision with its convex hulls.

No package computes the CARLA leaderboard's score and nuPlan's comfort; their formulas stand here in NumPy.
"""

import math

import numpy as np
from metrics_kit import judge
from scipy.signal import savgol_filter
from scipy.spatial import ConvexHull

PENALTIES = {"walker": 0.50, "vehicle": 0.60, "static": 0.65, "red_lights": 0.70, "stop_signs": 0.80}


def corners(body):
    turn = np.array([[math.cos(body["heading"]), math.sin(body["heading"])], [-math.sin(body["heading"]), math.cos(body["heading"])]])
    return body["centre"] + np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) * body["half"] @ turn


def time_to_collision(ego, other):
    """When the point that stands for the way of the one to the other enters all places at which they touch."""
    touching = (corners(ego)[:, None] - corners(other)[None]).reshape(-1, 2)
    normals, offsets = np.split(ConvexHull(touching).equations, [2], axis=1)
    way = np.subtract(other["velocity"], ego["velocity"])
    speeds, gaps = normals @ way, -offsets[:, 0]
    # Within each edge while speed · t <= gap.
    if np.any((speeds == 0) & (gaps < 0)):
        return math.inf
    ends = np.min(gaps[speeds > 0] / speeds[speeds > 0], initial=math.inf)
    begins = np.max(gaps[speeds < 0] / speeds[speeds < 0], initial=0.0)
    return begins if begins <= ends else math.inf


def derivative(values, interval, order):
    n = len(values)
    half = min(max(1, round(1.5 / interval / 2)), (n - 1) // 2)
    return savgol_filter(values, 2 * half + 1, 2, deriv=order, delta=interval, mode="interp")


def driving(drives):
    scores, completions, penalties, comforts, times = [], [], [], [], []
    n_collisions, path, rules = 0, 0.0, np.zeros(2)
    impulses = []
    along = {1: [], 2: []}
    across = {1: [], 2: []}
    for drive in drives:
        penalty = math.prod(PENALTIES[name] for name, _ in drive["collisions"])
        penalty *= math.prod(PENALTIES[name] ** drive[name] for name in ("red_lights", "stop_signs"))
        completion = np.clip((drive["completed"] - drive["off_road"]) / drive["route"], 0, 1)
        scores.append(penalty * completion)
        completions.append(completion)
        penalties.append(penalty)
        n_collisions += len(drive["collisions"])
        impulses += [impulse for _, impulse in drive["collisions"]]
        rules += [drive["red_lights"], drive["stop_signs"]]
        moments = drive["moments"]
        path += np.linalg.norm(np.diff([moment["ego"]["centre"] for moment in moments], axis=0), axis=1).sum()
        for moment in moments:
            times.append(min((time_to_collision(moment["ego"], other) for other in moment["others"]), default=math.inf))
        velocity = np.array([complex(*moment["ego"]["velocity"]) for moment in moments])
        turn = np.exp(-1j * np.array([moment["ego"]["heading"] for moment in moments]))
        of = {}
        for order in (1, 2):
            of[order] = turn * sum(derivative(part, drive["interval"], order) * unit for part, unit in ((velocity.real, 1), (velocity.imag, 1j)))
            along[order] += list(np.abs(of[order].real))
            across[order] += list(np.abs(of[order].imag))
        yaw_rate = np.array([moment["yaw_rate"] for moment in moments])
        comforts.append(
            of[1].real.min() >= -4.05
            and of[1].real.max() <= 2.40
            and np.abs(of[1].imag).max() <= 4.89
            and np.abs(of[2].real).max() <= 4.13
            and np.abs(of[2]).max() <= 8.37
            and np.abs(yaw_rate).max() <= 0.95
            and np.abs(derivative(yaw_rate, drive["interval"], 1)).max() <= 1.93
        )
    times = np.array(times)
    spreads = {"jerk_lon": along[2], "jerk_lat": across[2], "acc_lon": along[1], "acc_lat": across[1]}
    return {
        "driving_score": np.mean(scores),
        "route_completion": np.mean(completions),
        "infraction_penalty": np.mean(penalties),
        "collisions": n_collisions,
        "collisions_per_km": n_collisions / (path / 1000),
        "impulse_max": max(impulses, default=math.nan),
        "ttc_min": times.min() if np.isfinite(times).any() else math.nan,
        "ttc_below_1.5s": np.mean(times < 1.5),
        "comfortable": np.mean(comforts),
        "red_lights": rules[0],
        "stop_signs": rules[1],
        **{f"{name}_p{at}": np.percentile(values, at) for name, values in spreads.items() for at in (50, 95)},
        **{f"{name}_max": max(values) for name, values in spreads.items()},
    }


judge({"driving": driving})
