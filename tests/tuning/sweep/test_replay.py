"""A vehicle of a sweep, rolled out again: the sweep's own vehicle, at the sweep's own rate."""

import json

import numpy as np
import pytest

import agvjax
from tuning import Config, OneOf, Simulate, Span, run_sweep
from tuning import config as configuration
from tuning.cli.main import main
from tuning.config.settings import Sweep
from tuning.sweep.replay import retimed

LEAF, VALUES = "deadzone.position.threshold_right", (0.5, 1.0)


def test_law_and_sensor_look_as_often_at_another_step():
    swept = Simulate(dt=1e-3, control_every=20, horizon=2.0)
    assert retimed(swept, {}) == swept
    assert retimed(swept, {"dt": 5e-3}) == Simulate(dt=5e-3, control_every=4, horizon=2.0)
    assert retimed(swept, {"dt": 5e-3, "control_every": 2}).control_every == 2
    assert retimed(Simulate(dt=1e-3), {"dt": 5e-3}).control_every == 1
    with pytest.raises(agvjax.InputError, match="simulate.dt = 0.003: must be a whole fraction .* 0.02 s"):
        retimed(swept, {"dt": 3e-3})


@pytest.mark.slow
def test_a_replay_keeps_the_control_interval_and_the_settings_of_the_sweep(tmp_path):
    """A law that jumps at control instants, 20 ms apart: what single runs in Python give, whatever the step."""
    law = agvjax.FractionalBackstepping()
    over = ({LEAF: Span(OneOf(VALUES), 2)},)
    sweep = Sweep(over=over, metrics=("total_rmse",), shard=2)
    config = Config(controller=law, simulate=Simulate(dt=2e-3, control_every=10, horizon=2.0), sweep=sweep, seed=3)
    swept = run_sweep(config, tmp_path / "sweep").metrics["total_rmse"][0]
    out, place = tmp_path / "out", ["--from", str(tmp_path / "sweep"), "--index", "1"]
    assert main(["simulate", *place, "--set", "simulate.dt=0.01", "--out", str(out), "--quiet"]) == 0
    assert json.loads((out / "metrics.json").read_text())["total_rmse"] == pytest.approx(swept[1], rel=1e-9)
    scenario = agvjax.replace(agvjax.Scenario(), {LEAF: VALUES[1]})
    assert abs(float(agvjax.evaluate(law, scenario, dt=1e-2, n_steps=200).total_rmse) - swept[1]) > 1e-4  # it matters
    written, wanted = configuration.load([str(out / "config.toml")], []), configuration.check(config)
    assert (written.seed, written.ensemble) == (3, wanted.ensemble)
    assert (written.simulate.dt, written.simulate.control_every, written.simulate.horizon) == (1e-2, 2, 2.0)
    assert np.allclose(agvjax.leaves(written.scenario)[LEAF], VALUES[1])
