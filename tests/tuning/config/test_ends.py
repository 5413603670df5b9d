"""What is drawn or swept is held against the rules of what is configured, at its ends and at every period."""

import dataclasses

import numpy as np
import pytest

import agvjax
from agvjax import InputError
from tuning.config import load
from tuning.config.ends import MOST_TOGETHER, Moving, elsewhere, placed
from tuning.config.load import resolve
from tuning.ensemble.draws import Between, OneOf, Span, places
from tuning.sweep import rules as sweep_rules
from tuning.tune import rules as tune_rules

LEFT, RIGHT = (f"actuators.torque_{side}.delay.time" for side in ("left", "right"))
PUSH = "actuators.acceleration"


def refused(files, axes, settings=(), rules=sweep_rules.faults):
    """The message on a sweep over axes."""
    with pytest.raises(InputError) as caught:
        load(files, list(settings), rules, {"sweep.over": axes})
    return str(caught.value)


def accepted(files, axes, settings=()):
    return load(files, list(settings), sweep_rules.faults, {"sweep.over": axes})


def span(low, high, points=0):
    return {"between": [low, high]} | ({"points": points} if points else {})


@pytest.mark.parametrize("points", [0, 1000])
def test_a_delay_longer_than_its_memory_is_refused_with_the_slots_it_needs(points):
    longest = span(0.02, 0.3, points)
    message = refused(["robot"], [{LEFT: longest, RIGHT: longest}])
    for side in ("left", "right"):  # 1 + .3 s / .02 s
        assert f"scenario.actuators.torque_{side}.delay.slots = 3: must be at least 16" in message
    enough = [f"scenario.actuators.torque_{side}.delay.slots=16" for side in ("left", "right")]
    accepted(["robot"], [{LEFT: longest, RIGHT: longest}], enough)


def test_delay_and_jitter_are_looked_at_together():
    jitter = f"{PUSH}.delay.jitter"
    for axis in ({f"{PUSH}.delay.time": span(0.0, 0.04)}, {jitter: span(0.0, 0.02, 3)}):
        accepted(["unicycle"], [axis])  # three slots last for .04 s
    message = refused(["unicycle"], [{f"{PUSH}.delay.time": span(0.0, 0.04)}, {jitter: span(0.0, 0.02, 3)}])
    assert message.count("slots = 3: must be at least 4") == 1 and "1 bad value" in message


def test_what_tuning_draws_is_looked_at_with_its_own_step():
    drawn = f'ensemble.draws={{"{PUSH}.delay.time"={{between=[0.02,0.2]}}}}'
    with pytest.raises(InputError, match=r"acceleration.delay.slots = 3: must be at least 11"):
        load(["unicycle"], [drawn], tune_rules.faults)
    quick = f'ensemble.draws={{"{PUSH}.lag.time_constant"={{one_of=[0.05,0.001]}}}}'
    with pytest.raises(InputError, match=rf"tune.dt = 0.005: .*{PUSH}.lag diverge .*time_constant = 0.001"):
        load(["unicycle"], [quick, f"scenario.{PUSH}={{lag={{time_constant=0.05}}}}"], tune_rules.faults)


def test_every_period_of_a_sweep_is_a_whole_number_of_steps():
    message = refused(["unicycle"], [{"controller.period": span(0.01, 0.03, 6)}])  # ends fit, 14 ms does not
    assert "sweep.over.controller.period = 0.014: must be a whole multiple of sweep.dt = 0.01 s" in message
    accepted(["unicycle"], [{"controller.period": span(0.01, 0.03, 3)}])
    assert "whole multiple" in refused(["unicycle"], [{"controller.period": span(0.02, 0.04)}])  # anywhere in between
    accepted(["unicycle"], [{"controller.period": {"one_of": [0.02, 0.04], "points": 0}}])
    message = refused(["unicycle"], [{"controller.period": {"one_of": [0.02, 0.033, 0.04]}}])
    assert "controller.period = 0.033" in message


def test_a_shorter_period_needs_more_slots_and_with_a_delay_that_is_swept_too():
    late, period = {f"{PUSH}.delay.time": span(0.01, 0.04, 4)}, {"controller.period": {"one_of": [0.01, 0.02]}}
    assert "acceleration.delay.slots = 3: must be at least 5" in refused(["unicycle"], [late, period])
    message = refused(["unicycle"], [period], [f"scenario.{PUSH}.delay.time=0.03", f"scenario.{PUSH}.delay.slots=3"])
    assert "acceleration.delay.slots = 3: must be at least 4" in message


def test_the_period_is_no_gain_to_tune():
    with pytest.raises(InputError, match=r"tune.gains = period: must be a gain"):
        load(["unicycle"], ['tune.gains=["inner.k1","period"]'], tune_rules.faults)


def test_limits_that_cross_are_refused_whichever_of_them_moves():
    lower, upper = f"{PUSH}.saturation.lower", f"{PUSH}.saturation.upper"
    low, high = span(-5.0, 4.0, 6), span(1.0, 8.0, 6)
    assert f"scenario.{upper} = 3.0: must be above lower = 4.0 (where {lower} = 4.0" in refused(
        ["unicycle"], [{lower: low}]
    )
    message = refused(["unicycle"], [{lower: low}, {upper: high}])
    assert f"sweep.over.{upper} = 1.0: must be above lower = 4.0" in message
    accepted(["unicycle"], [{lower: low, upper: high}])  # as one they never cross


def test_elements_of_one_leaf_move_apart():
    config = load([])
    there = placed(config, {"start.position[1]": np.array(3.0), "start.position[0]": np.array(2.0)})
    assert there.scenario.start.position.tolist() == [2.0, 3.0]
    moving = Moving("sweep.over", {"start.position[1]": Span(Between(0.0, 1.0), 3)})
    assert moving.values(config)["start.position[1]"].tolist() == [0.0, 0.5, 1.0]


def test_what_is_sampled_is_looked_at_at_its_ends_and_choices_one_by_one():
    assert places([Between(0.0, 1.0)]).tolist()[::3] == [0.0, 1.0]
    np.testing.assert_allclose(places([OneOf((1.0, 2.0, 3.0))]), [1 / 6, 1 / 2, 5 / 6])


def test_many_leaves_of_one_object_are_looked_at_from_either_side():
    known = [f"plant.{name}" for name in agvjax.leaves(load(["robot"]).scenario.plant)]
    assert len(known) > MOST_TOGETHER
    axes = [{name: {"times": [0.9, 1.1]}} for name in known]
    accepted(["robot"], axes)
    axes[known.index("plant.mass")] = {"plant.mass": {"between": [-1.0, 1.0]}}
    assert "sweep.over.plant.mass = -1.0" in refused(["robot"], axes)


def test_python_is_refused_with_the_same_words():
    config = load(["unicycle"])
    draws = {f"{PUSH}.delay.time": Between(0.02, 0.2)}
    drawn = dataclasses.replace(config, ensemble=dataclasses.replace(config.ensemble, draws=draws))
    assert [fault.key for fault in tune_rules.faults(drawn)] == [f"scenario.{PUSH}.delay.slots"]
    assert resolve({}, tune_rules.faults).ensemble.draws  # the default problem is sound


def test_a_leaf_that_is_drawn_somewhere_else_than_it_is_configured_is_said():
    late = [f"scenario.actuators.{name}.delay.time = 0.15" for name in ("speed", "steering_angle")]
    config = load(["ackermann"], late)
    said = elsewhere(config, tune_rules.moving(config))
    assert len(said) == 2 and "actuators.speed.delay.time = 0.15 is not between the ends" in said[0]
    assert "[0.02 0.08]" in said[0]
    for preset in ("base", "ackermann", "forklift", "unicycle", "car"):
        config = load([preset], [])
        assert elsewhere(config, tune_rules.moving(config)) == []


def test_a_step_that_is_wrong_everywhere_is_said_once():
    with pytest.raises(InputError) as said:
        load(["base"], ["tune.dt=0.007"], rules=tune_rules.faults)
    (fault,) = said.value.faults
    assert fault.key == "tune.dt" and fault.rule == "a whole fraction of the law's period, 0.05 s"
