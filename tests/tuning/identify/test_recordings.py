"""A drive as a robot records it gives what the CSV file of the same drive gives."""

import csv
import json

import numpy as np
import pytest

import commands
import recorded

pytestmark = pytest.mark.slow

TRACK, DELAY, LAG, EDGE, MOST = 0.5, 0.08, 0.15, 0.05, 0.9  # m, s, s, m/s, m/s^2


def drive(seconds=80.0, dt=0.001):
    """Commands (v, w) at 20 Hz and what a base on two wheels does of them, stepped by Euler at 1 ms."""
    random, n = np.random.default_rng(1), round(seconds / dt)
    told = np.zeros((n, 2))
    for begin in range(0, n, 1000):
        low, high = ((-0.12, -0.3), (0.12, 0.3)) if random.random() < 0.25 else ((-0.7, -1.0), (0.8, 1.0))
        told[begin : begin + 1000] = random.uniform(low, high)
    asked = told @ np.array([[1.0, 1.0], [-TRACK / 2, TRACK / 2]])
    late = np.vstack([np.zeros((round(DELAY / dt), 2)), asked[: -round(DELAY / dt)]])
    delivered = np.sign(late) * np.maximum(np.abs(late) - EDGE, 0.0)
    wheels, pose, seen = np.zeros(2), np.zeros(3), np.zeros((n, 5))
    for i in range(n):
        v, w = wheels.mean(), (wheels[1] - wheels[0]) / TRACK
        seen[i] = *pose, v, w
        pose = pose + dt * np.array([v * np.cos(pose[2]), v * np.sin(pose[2]), w])
        wheels = wheels + dt * np.clip((delivered[i] - wheels) / LAG, -MOST, MOST)
    measured = seen[::20] + random.normal(0, [0.002, 0.002, 0.001, 0.004, 0.004], (n // 20, 5))
    return told, measured


def identified(log, out):
    small = ["identify.drives=0", "identify.bootstrap=200", "identify.starts=1"]
    line = commands.arguments("identify", out, small, "--config", "base", "--fit", "deadzone,delay,vehicle", log)
    commands.run(line)
    return json.loads((out / "estimates.json").read_text())


def test_a_bag_of_either_storage_gives_what_the_csv_of_the_drive_gives(tmp_path):
    told, measured = drive()
    with open(tmp_path / "drive.csv", "w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow("t x y heading speed yaw_rate cmd_v cmd_w".split())
        rows.writerows([0.02 * k, *row, *told[20 * k]] for k, row in enumerate(measured))
    plain = identified(tmp_path / "drive.csv", tmp_path / "plain")
    found = {}
    for storage in ("SQLITE3", "MCAP"):
        recorded.write(tmp_path / storage, storage, told, measured)
        found[storage] = identified(tmp_path / storage, tmp_path / f"of-{storage}")
    assert found["SQLITE3"]["parameters"] == found["MCAP"]["parameters"]  # the same numbers are in both
    mean = recorded.JITTER / 2  # a command without a stamp is known by its arrival, later on average by as much
    for name, one in found["MCAP"]["parameters"].items():
        other = plain["parameters"][name]
        wide = np.hypot(*((e["high"] - e["low"]) / 2 for e in (one, other)))
        off = one["value"] - other["value"] + (mean if name.endswith("delay.time") else 0.0)
        assert abs(off) < 2 * wide + (0.003 if name.endswith("delay.time") else 0.01 * abs(other["value"])), name
    for name, true in (("deadzone.left.threshold_right", EDGE), ("plant.track", TRACK), ("plant.time_constant", LAG)):
        assert found["MCAP"]["parameters"][name]["value"] == pytest.approx(true, rel=0.03), name
