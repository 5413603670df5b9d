"""CMA-ES as a method: it finds what has no slope, counts what it looks at, and resumes to the same result."""

import jax.numpy as jnp
import numpy as np
import pytest

from agvjax import InputError
from tuning import Config, Objective, Requirement, Tune, pose
from tuning.tune.methods.cma import Cma
from tuning.tune.methods.method import Look, Progress

GOAL = Objective((Requirement("total_rmse", "mean", 1.0),), ())
TARGET = np.array([1.5, -0.7, 0.2])


def stairs(z):
    """Steps of .02 down to a bowl's ground: the slope is 0 wherever there is one."""
    return jnp.floor(50 * jnp.sum((z - TARGET) ** 2)) / 50


def progress(method, z):
    return Progress(0, z, method.begin(z, 4), z, z, (np.inf, np.inf), 0, 0, 0, 0, [], np.ones(z.size, bool))


def generations(method, p, count):
    look, points = Look(None, jnp.zeros(3)), []
    for _ in range(count):
        z, state = method.step(p, look, True, np.ones((3, 1)), {})
        p = p._replace(z=z, optimiser=state)
        points.append(np.asarray(z))
    return p, points


def make(**settings):
    return Cma(Tune(optimizer="cma", **{"iterations": 80} | settings), GOAL, lambda scenarios: stairs)


def test_stairs_without_a_slope_are_descended():
    p, points = generations(make(), progress(make(), jnp.zeros(3)), 60)
    assert float(stairs(points[-1])) == 0.0  # within .14 of the target in every direction
    assert p.optimiser.costs.shape == (80, 4 + int(3 * np.log(3)))
    assert int(p.optimiser.generations) == 60 and np.all(np.isfinite(p.optimiser.costs[:60]))
    assert make().step_rollouts(p.optimiser, 3) == 7 and make().look_rollouts(3) == 1


def test_from_what_it_was_told_it_goes_on_to_the_same_points():
    method = make()
    half, _ = generations(method, progress(method, jnp.zeros(3)), 10)
    _, straight = generations(method, half, 5)
    _, resumed = generations(make(), half, 5)  # another process: nothing but the state is left
    np.testing.assert_array_equal(straight, resumed)


@pytest.mark.parametrize(
    ("options", "key"),
    [
        ({"popsize": 3}, "popsize"),
        ({"popsize": 8.5}, "popsize"),
        ({"sigma": 0.0}, "sigma"),
        ({"sigma": "wide"}, "sigma"),
        ({"learning_rate": 0.1}, "one of popsize, sigma"),
    ],
)
def test_options_it_does_not_have_are_refused(options, key):
    with pytest.raises(InputError, match=key):
        pose(Config(tune=Tune(optimizer="cma", options=options)))


def test_its_own_options_are_taken():
    method = make(options={"popsize": 24, "sigma": 1.0}, iterations=5)
    state = method.begin(jnp.zeros(3), 4)
    assert state.costs.shape == (5, 24) and float(state.spread) == 1.0
    assert not pose(Config(tune=Tune(optimizer="cma", options={"popsize": 24}))).tuner.forward
