"""From the log of a robot to gains on it, by the commands as they are typed."""

import dataclasses
import json

import pytest

import drives
from commands import ROOT
from tuning import config as configuration
from tuning.cli.main import main
from tuning.export import artefact

pytestmark = pytest.mark.slow
LAW = """[controller]
type = "sampled"
period = 0.05
vehicle = "base"
[controller.inner]
type = "regulated_pure_pursuit"
desired_linear_vel = 0.8
use_velocity_scaled_lookahead_dist = true
"""
BETTER = LAW + "lookahead_time = 0.7\nmin_lookahead_dist = 0.49\nmax_lookahead_dist = 1.8\n"


def asked(folder, *words):
    settings = ["apply.vehicles=60", "apply.samples=16", "identify.memory=0.4"]
    files = ["--config", "base", "--config", str(ROOT / "benchmarks" / "days.toml")]
    return [*words, *files, *(x for s in settings for x in ("--set", s)), "--out", str(folder), "--quiet"]


def test_better_gains_are_accepted_by_a_log_and_the_worse_ones_refused(tmp_path):
    """Nav2's defaults look 1.5 s ahead and cut the corners of a base of 0.8 m/s that is slow to turn."""
    base = drives.drawn(1)
    base = dataclasses.replace(base, motors=tuple(dataclasses.replace(m, delay=0.08) for m in base.motors))
    log = drives.recorded(tmp_path / "today.csv", base, 1, seconds=60.0)
    good, old = tmp_path / "new.toml", tmp_path / "old.toml"
    good.write_text(BETTER)
    old.write_text(LAW)
    on = main(asked(tmp_path / "on", "apply", str(good), "--over", str(old), "--log", log))
    assert on == 0, (tmp_path / "on" / "report.md").read_text()
    assert (tmp_path / "on" / "gains.toml").read_bytes() == good.read_bytes()
    assert (tmp_path / "on" / "back.toml").read_bytes() == old.read_bytes()
    known = configuration.load([str(tmp_path / "on" / "config.toml")])
    for side, motor in zip(("left", "right"), base.motors, strict=True):
        found = known.scenario.deadzone[side].threshold_right
        assert float(found) == pytest.approx(motor.threshold_right, rel=0.15)
    assert artefact.read(str(tmp_path / "on" / "gains.toml"), [], [], [], print)  # as `agvjax export` reads them

    assert main(asked(tmp_path / "found", "identify", log)) == 0
    back = asked(tmp_path / "off", "apply", str(old), "--over", str(tmp_path / "on"), "--identified")
    back.insert(back.index("--identified") + 1, str(tmp_path / "found"))
    assert main(back) == 1
    told = json.loads((tmp_path / "off" / "decision.json").read_text())
    assert told["worse"] == 60 and "60 of 60 vehicles" in told["reasons"][0]
    assert not (tmp_path / "off" / "gains.toml").exists()
