"""What is made of a fit: whether what is left is noise, and whether the measurements agree."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import agvjax
from tuning.identify import verdict
from tuning.identify.fit import Fit
from tuning.identify.left import white
from tuning.identify.log import Log
from tuning.identify.model import Sums
from tuning.identify.parameters import Parameter, parameters
from tuning.identify.segments import Segments
from tuning.identify.verdict import Z95, Estimate, _estimate, advice


def test_what_is_left_is_correlated_from_one_measurement_to_the_next():
    """Of a channel that is measured every second row too: 0.6, by which it was made."""
    rng, rows = np.random.default_rng(0), np.zeros((50, 200))
    for k in range(2, 200, 2):
        rows[:, k] = 0.6 * rows[:, k - 2] + rng.normal(size=50)
    there = np.tile(np.arange(200) % 2 == 0, (50, 1))
    other = np.where(there, np.nan, rng.normal(size=(50, 200)))  # white, in the rows between
    fit: Any = SimpleNamespace(
        model=SimpleNamespace(channels=("x", "y")),
        sums=SimpleNamespace(residual=np.stack([rows, other], axis=-1)),
        segments=SimpleNamespace(weight=np.stack([there, ~there], axis=-1).astype(float)),
    )
    assert white(fit) == pytest.approx({"x": 0.6, "y": 0.0}, abs=0.04)


@pytest.mark.parametrize(("turns", "doubted"), [(0.09, True), (0.24, False), (0.16, False)])
def test_a_number_on_which_going_and_turning_disagree_is_none(turns, doubted, monkeypatch):
    """Forty stretches, each of which measures one number twice; the two delays are doubted together."""
    rng = np.random.default_rng(0)
    seen = np.array([0.25, turns]) + 0.05 * rng.normal(size=(40, 2))
    names = ("actuators.a.delay.time", "actuators.b.delay.time", "plant.L")
    parameters = tuple(Parameter(name, "s", 0.2, 0.0, 0.5, 0.1, 0.025) for name in names)
    p, one = np.full(3, 0.2), np.eye(3)

    def told(p, states, segments):
        weight = segments.weight[:, 0]  # (S, C)
        slope = -np.sum(weight * (seen - p[0]), axis=1)[:, None] * one[0]
        count = weight.sum(axis=1)[:, None, None]
        return Sums(count * one, slope, np.zeros(40), states, (seen - p[0])[:, None])

    weight = np.full((40, 1, 2), 0.05**-2)
    segments = Segments(*[weight] * len(Segments._fields))
    sums, model = told(p, np.zeros((40, 1)), segments), SimpleNamespace(channels=("x", "heading"))
    fit = Fit(
        parameters, p, np.full(3, True), sums, segments, *[cast(Any, None)] * 4, model=cast(Any, model), absent={}
    )
    monkeypatch.setattr(verdict, "compiled", lambda model: told)
    given = [Estimate(q.name, q.unit, 0.2, 0.005, identified=True) for q in parameters]
    found = verdict._agreed(fit, given, 50, 0)
    assert [e.identified for e in found] == [not doubted, not doubted, True]
    assert not doubted or f"how it turns {turns:.2f}"[:-1] in found[0].reason


LEVER = Parameter("plant.L", "m", 0.3, 0.006, 6.3, 0.3, 0.0, "it must be above 0: shift the pose", "")
DELAY = Parameter("actuators.a.delay.time", "s", 0.02, 0.0, 0.5, 0.1, 0.01, "", "longer than 0.5 s")


@pytest.mark.parametrize(
    ("parameter", "value", "push", "words"),
    [
        (LEVER, 0.006, 0.0, "ends at 0.006, the edge of where it was looked for: it must be above 0: shift the pose"),
        (LEVER, 0.31, 0.0, "never excited"),
        (DELAY, 0.0, 0.0, "ends at 0, the least that it can be: at most 0.1"),
        (DELAY, 0.0, -5.0, "ends at 0, the edge of what it can be, and the log pushes beyond it"),
        (DELAY, 0.021, 0.0, "never excited"),
        (DELAY, 0.5, 0.0, "ends at 0.5, the edge of where it was looked for: longer than 0.5 s"),
    ],
)
def test_what_ends_at_an_edge_is_called_so_however_little_it_is_felt(parameter, value, push, words):
    """All of these change the log by 2 deviations at most; that it ended at an edge says more."""
    fit: Any = SimpleNamespace(parameters=[parameter], p=np.array([value]), free=np.array([True]), absent={})
    e = _estimate(fit, 0, 0.06, 0.06, 2.0, 0.06 * push, np.ones(1), Z95)
    assert not e.identified and e.reason.startswith(words)


def test_what_would_tell_a_number_of_a_base_is_a_drive_of_its_commands():
    assert advice("plant.time_constant") == "steps of the commands up and down"
    assert advice("actuators.left.delay.time") == "steps of left up and down"
    assert "so large" in advice("plant.acceleration") and "so large" in advice("plant.steering_rate")
    assert advice("plant.track") == "turns to both sides while driving"


def test_a_drift_that_is_known_to_be_small_is_known():
    """0 within 0.008 rad/s either way, which is twice what is negligible; no share of the value could be asked for."""
    scenario = agvjax.Scenario.of(agvjax.Base())
    log = Log("a", 0.0, 0.02 * np.arange(3), np.ones((3, 2)), ("left", "right"), {})
    (drift,) = parameters(scenario, ["plant.drift"], [log], 0.01, 0.5)
    fit: Any = SimpleNamespace(parameters=[drift], p=np.array([1e-3]), free=np.array([True]), absent={})
    assert _estimate(fit, 0, 0.004, 0.004, 1e3, 0.0, np.ones(1), Z95).identified
    assert not _estimate(fit, 0, 0.02, 0.02, 1e3, 0.0, np.ones(1), Z95).identified
