"""Steps a second of gantry.envs by gymnasium's own stopwatch, and the curve of its learner.

    envs.py steps [--json FILE] [--secs S]       benchmark_vector_step: our vector, and gymnasium's of single environments
    envs.py learn [--json FILE] [--seeds 0,1]    python -m gantry.envs.ars on lane keeping, a policy per seed

The curve is in docs/benchmarks/worlds.md.
"""

import argparse
import json
import os
import platform
import subprocess

import gymnasium as gym
import numpy as np
from gymnasium.utils.performance import benchmark_vector_step

import gantry.envs
from gantry.envs import ars

#: Vectors that are measured: number of worlds, and what makes the vector.
VECTORS = [(1, None), (16, "sync"), (16, None), (256, None), (1024, None)]
#: The curve's points that are kept: every so many iterations, and the last.
EVERY = 10


def machine(words):
    """The same form as launch_cli::bench writes: on which machine, from which commit, with which command."""
    models = [line.split(": ", 1)[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")]
    commit = subprocess.run(["git", "describe", "--always", "--dirty", "--abbrev=10"], capture_output=True, text=True)
    return {
        "cpu": models[0] if models else "unknown",
        "n_cores": len(os.sched_getaffinity(0)),
        "kernel": platform.release(),
        "load_1min": open("/proc/loadavg").read().split()[0],
        "commit": commit.stdout.strip() or "unknown",
        "command": f"envs.py {words} with Python {platform.python_version()}, numpy {np.__version__}, gymnasium {gym.__version__}",
    }


def steps(args):
    rows = []
    for task in gantry.envs.task_names():
        for n, mode in VECTORS:
            envs = gym.make_vec(f"gantry/{task}-v0", num_envs=n, vectorization_mode=mode)
            per_sec = benchmark_vector_step(envs, target_duration=args.secs, seed=1)
            envs.close()
            rows.append({"name": task, "worlds": n, "vector": "gymnasium's SyncVectorEnv" if mode else "ours", "steps_per_sec": per_sec})
            print(f"{task}, {n} worlds, {rows[-1]['vector']}: {per_sec:.0f} steps/s", flush=True)
    return rows


def learn(args):
    rows = []
    for seed in map(int, args.seeds.split(",")):
        policy, curve = ars.train("LaneKeeping", seed=seed, report=ars.show)
        judged = gantry.envs.evaluate(policy, "LaneKeeping", range(200))
        print(f"seed {seed}: {judged.verdict}", flush=True)
        points = [point._asdict() for point in curve if point.iteration % EVERY == 0 or point is curve[-1]]
        rows.append({"name": f"seed {seed}", "secs": curve[-1].secs, "world_steps": curve[-1].world_steps, "score": judged.score._asdict(),
                     "failed": judged.failed._asdict(), "solved": "yes" if judged.solved else "no", "curve": points})  # fmt: skip
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["steps", "learn"])
    parser.add_argument("--json", help="write the results into this file")
    parser.add_argument("--secs", type=int, default=5, help="seconds of each vector [default: 5]")
    parser.add_argument("--seeds", default="0,1", help="seeds of the learner [default: 0,1]")
    args = parser.parse_args()
    at = machine(args.what)
    rows = {"steps": steps, "learn": learn}[args.what](args)
    if args.json:
        with open(args.json, "w") as file:
            json.dump({"bench": f"envs.py {args.what}", "machine": at, "rows": rows}, file, indent=2)


if __name__ == "__main__":
    main()
