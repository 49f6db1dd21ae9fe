"""Compares figures of tracks with those of TrackEval and, where it defines the same, of motmetrics.

Identity measures are one for both. CLEAR's counts are, where no truth overlaps two results that could be its own;
fragmentations are, where also every frame has truths and results, since TrackEval passes over the others.
"""

import contextlib
import io
import math

import motmetrics
import numpy as np
from metrics_kit import judge

with contextlib.redirect_stdout(io.StringIO()):
    from trackeval.datasets._base_dataset import _BaseDataset
    from trackeval.metrics import CLEAR, HOTA, Identity

    METRICS = [HOTA(), CLEAR({"PRINT_CONFIG": False}), Identity({"PRINT_CONFIG": False})]
N_CLEAR = {"same": 0, "full": 0}


def without_ignored(frame):
    """Takes out ignored truths and what falls to them, as TrackEval's MOTChallenge does with its distractors."""
    from scipy.optimize import linear_sum_assignment

    similarity = np.array(frame["similarity"], float).reshape(len(frame["truths"]), len(frame["results"]))
    truths, results = np.array(frame["truths"], int), np.array(frame["results"], int)
    ignored = np.array(frame["ignored"], bool)
    worth = np.where(similarity < 0.5 - np.finfo(float).eps, 0, similarity)
    rows, columns = linear_sum_assignment(-worth)
    fallen = columns[(worth[rows, columns] > 0) & ignored[rows]]
    kept = ~np.isin(np.arange(len(results)), fallen)
    return truths[~ignored], results[kept], similarity[~ignored][:, kept]


def check_likeness(frame):
    """The likeness that was given is that of TrackEval's own functions."""
    truths, results = np.array(frame["truth_boxes"], float), np.array(frame["result_boxes"], float)
    if len(truths) and len(results):
        similarity = np.array(frame["similarity"]).reshape(len(truths), len(results))
        if frame["is_overlap"]:
            wanted = _BaseDataset._calculate_box_ious(truths, results, box_format="x0y0x1y1")
        else:
            centres = [(boxes[:, :2] + boxes[:, 2:]) / 2 for boxes in (truths, results)]
            wanted = _BaseDataset._calculate_euclidean_similarity(*centres, zero_distance=40.0)
        assert np.abs(similarity - wanted).max() < 1e-9


def numbered(lists):
    names = {name: number for number, name in enumerate(sorted({int(name) for names in lists for name in names}))}
    return [np.array([names[int(name)] for name in part], int) for part in lists], len(names)


def tracking(case):
    per_sequence = [{}, {}, {}]
    counts = np.zeros(2, int)
    accumulators, is_clear, is_full = [], True, True
    for at, sequence in enumerate(case):
        for frame in sequence:
            check_likeness(frame)
        frames = [without_ignored(frame) for frame in sequence]
        truths, n_truths = numbered([frame[0] for frame in frames])
        results, n_results = numbered([frame[1] for frame in frames])
        data = {
            "gt_ids": truths,
            "tracker_ids": results,
            "similarity_scores": [frame[2] for frame in frames],
            "num_gt_ids": n_truths,
            "num_tracker_ids": n_results,
            "num_gt_dets": sum(map(len, truths)),
            "num_tracker_dets": sum(map(len, results)),
            "num_timesteps": len(frames),
        }
        counts += [data["num_gt_dets"], data["num_tracker_dets"]]
        for metric, of_sequence in zip(METRICS, per_sequence):
            of_sequence[at] = metric.eval_sequence(data)
        accumulator = motmetrics.MOTAccumulator(auto_id=True)
        for names, found, similarity in frames:
            accumulator.update(names, found, np.where(similarity >= 0.5, 1 - similarity, np.nan))
            could = similarity >= 0.5
            is_clear &= could.sum(0).max(initial=0) <= 1 and could.sum(1).max(initial=0) <= 1
            is_full &= len(found) > 0 and len(names) > 0
        accumulators.append(accumulator)
    if not counts.any():
        return {}
    hota, clear, identity = (metric.combine_sequences(found) for metric, found in zip(METRICS, per_sequence))
    check_motmetrics(accumulators, clear, identity, is_clear, is_full)
    n_truths, n_results = counts
    only = {True: lambda value: value, False: lambda value: math.nan}
    return {
        **{name: np.mean(hota[name]) for name in ("HOTA", "DetA", "AssA", "DetRe", "DetPr", "AssRe", "AssPr")},
        "LocA": only[hota["HOTA_TP"][0] > 0](np.mean(hota["LocA"])),
        **{f"HOTA@{at}": value for at, value in enumerate(hota["HOTA"])},
        "MOTA": only[n_truths > 0](clear["MOTA"]),
        "MOTP": only[clear["CLR_TP"] > 0](clear["MOTP"]),
        "precision": only[n_results > 0](clear["CLR_Pr"]),
        "recall": only[n_truths > 0](clear["CLR_Re"]),
        **{name: clear[name] for name in ("IDSW", "Frag", "MT", "PT", "ML")},
        "IDF1": identity["IDF1"],
        "IDP": only[n_results > 0](identity["IDP"]),
        "IDR": only[n_truths > 0](identity["IDR"]),
    }


def check_motmetrics(accumulators, clear, identity, is_clear, is_full):
    host = motmetrics.metrics.create()
    names = ["idtp", "idfp", "idfn"]
    if is_clear:
        names += ["num_switches", "num_misses", "num_false_positives", "mostly_lost"]
        names += ["num_fragmentations"] if is_full else []
    found = host.compute_many(accumulators, metrics=names, generate_overall=True).loc["OVERALL"]
    wanted = {"idtp": identity["IDTP"], "idfp": identity["IDFP"], "idfn": identity["IDFN"]}
    wanted |= {"num_switches": clear["IDSW"], "num_misses": clear["CLR_FN"], "num_false_positives": clear["CLR_FP"]}
    wanted |= {"num_fragmentations": clear["Frag"], "mostly_lost": clear["ML"]}
    for name in names:
        assert found[name] == wanted[name], (name, found[name], wanted[name])
    N_CLEAR["same"] += is_clear
    N_CLEAR["full"] += is_clear and is_full


def main():
    # The packages write too; what is said last comes last.
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        judge({"tracking": tracking})
    assert min(N_CLEAR.values()) >= 5, f"too few cases are clear enough for motmetrics' counts: {N_CLEAR}"
    print(f"{N_CLEAR['same']} cases have the counts of motmetrics too, {N_CLEAR['full']} of them its fragmentations")
    print(said.getvalue().splitlines()[-1])


main()
