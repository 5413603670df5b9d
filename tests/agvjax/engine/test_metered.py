"""A run that is only metered: as many steps as asked, whatever they are shared out into, and the end counted once."""

import numpy as np
import pytest

import agvjax
from agvjax import Criteria, Scenario
from agvjax.engine.rollout import _shared_out


def with_memory():
    """A computer with an integral, behind a delay, a rate limit and a noisy sensor."""
    late = agvjax.Chain(delay=agvjax.Delay(time=0.03), rate=agvjax.RateLimit(rate=20.0))
    plant = agvjax.Unicycle()
    scenario = Scenario.of(plant, actuators=dict.fromkeys(plant.actuators, late), sensor=agvjax.Noise(position=0.01))
    return agvjax.Sampled(vehicle=plant, period=0.02), scenario


def along_a_route():
    """Pure pursuit of an open route, which ends during the longer runs."""
    route = agvjax.Route.through([[0.0, 0.0], [0.5, 0.0], [1.0, 0.2]], 0.8)
    base = agvjax.Base()
    law = agvjax.Sampled(inner=agvjax.RegulatedPurePursuit(), vehicle=base, period=0.04)
    return law, Scenario.of(base, path=route)


@pytest.mark.slow
@pytest.mark.parametrize("loop", [with_memory, along_a_route])
@pytest.mark.parametrize("n_steps", [1, 99, 301, 6498])  # 2 looks, 100, 302 in 303, 6499 in 6552
def test_metrics_are_those_of_the_trajectory(loop, n_steps):
    law, scenario = loop()
    timing = {"dt": 0.01, "n_steps": n_steps}
    criteria = Criteria(late=0.5, delivered=True)
    metered = agvjax.evaluate(law, scenario, criteria=criteria, **timing)
    run = agvjax.simulate(law, scenario, **timing)
    sampled = agvjax.measure(run, criteria)
    np.testing.assert_allclose(metered.chatter, np.abs(np.diff(run.command, axis=0)).sum(axis=0), rtol=1e-9)
    for name, value in agvjax.leaves(metered).items():
        np.testing.assert_allclose(value, agvjax.leaves(sampled)[name], rtol=1e-9, atol=1e-12, err_msg=name)


def test_few_steps_are_taken_for_nothing():
    for looks in (*range(2, 3000), 6401, 6500, 9001, 12_001, 99_991, 1_000_001):
        groups, inner, size = _shared_out(looks)
        assert looks <= groups * inner * size < looks + groups * inner
        assert groups * inner * size <= 1.02 * looks
