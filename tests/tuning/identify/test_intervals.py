"""Drives by another program: intervals hold the truth, and what is said of the model is so.

`DRIVES=200 pytest -m slow -rP tests/tuning/identify/test_intervals.py` looks at as many.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

from commands import ROOT

pytestmark = pytest.mark.slow

DRIVES = int(os.environ.get("DRIVES", "40"))
FEW = max(10, DRIVES // 10)
LACKS = "the model lacks something in"


def many(kind, count, folder):
    """What is said of so many drives of a kind."""
    program = Path(__file__).parents[2] / "helpers" / "many_drives.py"
    paths = os.pathsep.join(map(str, (ROOT, ROOT / "tests" / "helpers", ROOT / "tests" / "reference")))
    line = [sys.executable, str(program), kind, str(count), str(folder)]
    done = subprocess.run(line, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": paths})
    assert done.returncode == 0, done.stderr
    return [json.loads(row) for row in done.stdout.splitlines() if row.startswith("{")]


@pytest.fixture(scope="module")
def right(tmp_path_factory):
    return many("right", DRIVES, tmp_path_factory.mktemp("right"))


def held(told):
    """Of every number how often its interval holds the truth, of how many (printed)."""
    found = {}
    for row in told:
        for name, (true, _, low, high) in row["numbers"].items():
            found.setdefault(name, []).append(low <= true <= high)
    for name, holds in found.items():
        print(f"{name}: {np.mean(holds):.1%} of {len(holds)}")
    print(f"all: {np.mean(np.concatenate([*found.values()])):.1%}")
    return found


def test_intervals_hold_the_truth_though_the_noise_lasts(right):
    """95 % of them; those of one drive go together, so that each number is judged for itself too."""
    found = held(right)
    assert 0.9 <= np.mean(np.concatenate([*found.values()])) <= 0.99
    for name, holds in found.items():
        assert sum(holds) >= binom.ppf(1e-4, len(holds), 0.93), name
    assert sum(len(row["numbers"]) for row in right) >= 0.98 * sum(row["asked"] for row in right)


def test_delays_and_thresholds_are_found_though_the_pose_comes_at_10_hz(right):
    """Delays of 250 ms within 10 ms, every threshold within 10 %."""
    numbers = [(name, true, value) for row in right for name, (true, value, _, _) in row["numbers"].items()]
    late = max(abs(value - true) for name, true, value in numbers if name.endswith("delay.time"))
    off = max(abs(value / true - 1) for name, true, value in numbers if ".threshold_" in name)
    print(f"delays within {1e3 * late:.1f} ms, thresholds within {off:.1%}")
    assert late < 0.01 and off < 0.1


def test_a_model_that_is_right_is_seldom_said_to_lack_something(right):
    wrong = [i for i, row in enumerate(right) if LACKS in row["said"] or row["change"]]
    print(f"{len(wrong)} of {len(right)} right models doubted: drives {wrong}")
    assert len(wrong) <= 0.1 * len(right)


@pytest.mark.parametrize("kind", ["lag", "sticks"])
def test_a_model_that_is_wrong_is_said_to_lack_something(kind, tmp_path):
    """A lag of .2 s before the motors; a wheel that takes 8 cm/s more to break away than to keep turning."""
    told = many(kind, FEW, tmp_path)
    seen = sum(LACKS in row["said"] for row in told)
    print(f"{kind}: {seen} of {FEW} seen")
    assert seen >= 0.9 * FEW


def test_another_floor_is_seen_and_from_when_on(tmp_path):
    """From the middle of two minutes on the wheels roll a fifth less."""
    told = many("floor", FEW, tmp_path)
    seen = [row["change"]["t"] for row in told if row["change"] and "behaves differently" in row["said"]]
    print(f"floor: {len(seen)} of {FEW} seen, from {min(seen):.1f} to {max(seen):.1f} s on")
    assert len(seen) >= 0.9 * FEW and np.all(np.abs(np.array(seen) - 60) < 6)


def test_intervals_hold_the_truth_where_the_noise_is_white_and_are_no_wider_for_it(tmp_path, right):
    told = many("white", FEW, tmp_path)
    assert np.mean(np.concatenate([*held(told).values()])) >= 0.9
    pairs = [(a["numbers"], b["numbers"]) for a, b in zip(told, right, strict=False)]
    wide = [(a[name][3] - a[name][2]) / (b[name][3] - b[name][2]) for a, b in pairs for name in a if name in b]
    print(f"width beside lasting noise: {np.median(wide):.2f}")
    assert np.median(wide) < 1.0
