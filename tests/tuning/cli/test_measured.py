"""What is said of one run."""

import dataclasses

import numpy as np
import pytest

import agvjax
from agvjax.geometry import wrap
from tuning.cli.measured import divergence


@pytest.mark.parametrize("limit", [2.0, 20.0])
def test_a_divergence_says_when_and_what_was_passed(limit):
    """The last instant at which speed, heading and the place counted from the path are within, by hand."""
    law, scenario, timing = agvjax.NeuroBackstepping(k2=-30.0), agvjax.Scenario(), {"dt": 1e-3, "n_steps": 1000}
    free = agvjax.simulate(law, dataclasses.replace(scenario, limit=1e9), **timing)
    off = np.asarray(free.position - free.reference_position)
    size = np.sqrt((off**2).sum(axis=1) + (np.asarray(free.velocity) ** 2).sum(axis=1) + wrap(free.heading) ** 2)
    last = int(np.flatnonzero(size >= limit)[0]) - 1
    run = agvjax.simulate(law, dataclasses.replace(scenario, limit=limit), **timing)
    assert not run.ok and 0 < last < 900
    said = divergence(run, limit)
    assert f"at t = {1e-3 * last:.4g} s" in said and f"exceeded scenario.limit = {limit:g}" in said


def test_a_divergence_says_what_it_looks_like():
    """Feedback of the wrong sign runs away; one far too high for its delay throws the command to and fro."""
    timing = {"dt": 1e-3, "n_steps": 1000}
    scenario = dataclasses.replace(agvjax.Scenario(), limit=20.0)
    run = agvjax.simulate(agvjax.NeuroBackstepping(k2=-30.0), scenario, **timing)
    assert "did not oscillate: gains may be of the wrong sign" in divergence(run, 20.0)
    late = dataclasses.replace(scenario, actuators={"position": agvjax.Delay(time=0.05, slots=52)})
    run = agvjax.simulate(agvjax.Backstepping(k2=40.0), late, **timing)
    assert not run.ok and "times in the last" in (said := divergence(run, 20.0)) and "too high for the delay" in said
