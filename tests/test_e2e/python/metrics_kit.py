"""What the judges of metrics share: cases from a file, every figure compared, and a last line that counts them."""

import importlib.util
import json
import math
import sys
import types
from pathlib import Path

import numpy as np


def judge(figures_of):
    """Compares the figures of each case with those of the function for its kind, and says how many.

    A function gives figures by name, and NaN or nothing for those that do not exist.
    """
    n, n_there, largest = 0, 0, 0.0
    for number, line in enumerate(Path(sys.argv[1]).read_text().splitlines()):
        case = json.loads(line)
        wanted = {name: value for name, value in figures_of[case["kind"]](case["input"]).items() if not math.isnan(value)}
        found = case["figures"]
        assert found.keys() == wanted.keys(), (number, case["kind"], sorted(found.keys() ^ wanted.keys()))
        for name, value in wanted.items():
            off = abs(found[name] - value) / max(1.0, abs(value))
            assert off <= 1e-6, (number, case["kind"], name, found[name], value)
            largest = max(largest, off)
            n_there += value not in (0, 1, 100)
            n += 1
    assert n_there > n / 4, f"only {n_there} of {n} figures are neither 0, 1 nor 100: too easy"
    print(f"compared {n} figures of which {n_there} are neither 0, 1 nor 100; largest difference {largest:.1e}")


def array(values):
    """Numbers, with NaN for null."""
    return np.array([math.nan if value is None else value for value in values], float)


def share(part, whole):
    return part / whole if whole else math.nan


def mean(values):
    return float(np.mean(values)) if len(values) else math.nan


def one_file_of(package, path, **stands_in):
    """A module of an installed package by itself, where the package as a whole asks for far more than the module does.

    What the module imports without using it here is stood in for by empty modules.
    """
    for name in stands_in.values():
        parts = name.split(".")
        for end in range(1, len(parts) + 1):
            sys.modules.setdefault(".".join(parts[:end]), types.ModuleType(parts[end - 1]))
        for end in range(1, len(parts)):
            setattr(sys.modules[".".join(parts[:end])], parts[end], sys.modules[".".join(parts[: end + 1])])
    folder = Path(importlib.util.find_spec(package).origin).parent
    spec = importlib.util.spec_from_file_location(f"{package}_{Path(path).stem}", folder / path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
