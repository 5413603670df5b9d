"""Derivatives of a run: forward against reverse mode, and both against central differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import Cosine, NeuroBackstepping, Scenario, batch, check, evaluate, leaves, replace, simulate
from agvjax.engine.xla import FAST
from agvjax.gradient import MOST_FORWARD

GAINS = "k1 k2 k3 Lam Lam_psi omega_n zeta gamma1 gamma2 eta1 eta2 b1 b2".split()
NUMBERS = "slope_right slope_left threshold_right threshold_left".split()
DEADZONE = [f"deadzone.{channel}.{name}" for channel in ("position", "heading") for name in NUMBERS]
N_STEPS = 1000
# Where a derivative jumps: a command at a node of the integrator that crosses a threshold, wrap at +-pi, and the
# metrics made with max or with a last time (peak, overshoot, settling). The costs below use none of these metrics; iae
# has a kink where an error passes 0 at a sample. With a step of 1e-5 one node in 500 still changes its side within the
# difference (4e-6 off); with 1e-6 none does, and rounding costs 3e-10 of the largest slope.
STEP = 1e-6
SHAKEN = Cosine(amplitude=np.array([0.2, 0.2, 3.0]), omega=6.0)  # within 1 s every deadzone number acts


def cost(metrics):
    return jnp.sum(metrics.rmse) + jnp.sum(metrics.iae) + 1e-3 * metrics.effort


def at(logs):
    """Controller and scenario whose named leaves are the defaults times exp(logs)."""
    controller, scenario = check(NeuroBackstepping()), check(Scenario(disturbance=SHAKEN))
    values = {name: (leaves(controller) | leaves(scenario))[name] * jnp.exp(x) for name, x in logs.items()}
    gains = {name: values[name] for name in GAINS if name in values}
    rest = {name: values[name] for name in DEADZONE if name in values}
    return replace(controller, gains), replace(scenario, rest)


@jax.jit
def of_logs(x):
    controller, scenario = at(dict(zip([*GAINS, *DEADZONE], x, strict=True)))
    return cost(evaluate(controller, scenario, n_steps=N_STEPS))


def central(function, x, step=STEP):
    """Central differences along every coordinate."""
    eye = np.eye(len(x)) * step
    return np.array([(float(function(x + e)) - float(function(x - e))) / (2 * step) for e in eye])


@pytest.fixture(scope="session")
def forward():
    return np.asarray(jax.jacfwd(of_logs)(jnp.zeros(len(GAINS) + len(DEADZONE))))


@pytest.mark.slow
def test_forward_mode_is_the_slope_of_the_cost(forward):
    slope = central(of_logs, jnp.zeros(forward.size))
    np.testing.assert_allclose(forward, slope, rtol=0, atol=1e-7 * np.abs(slope).max())
    assert (forward != 0).all()
    assert (np.abs(forward[[*range(7), *range(13, 21)]]) > 1e-5).all()  # all but the adaptation's, which hardly matter


@pytest.mark.slow
def test_reverse_mode_is_forward_mode(forward):
    reverse = np.asarray(jax.grad(of_logs)(jnp.zeros(forward.size)))
    np.testing.assert_allclose(reverse, forward, rtol=0, atol=1e-10 * np.abs(forward).max())


@pytest.mark.slow
def test_an_integer_gain_can_be_differentiated_after_check():
    controller = check(NeuroBackstepping(k1=25))  # jax.grad refuses an integer

    @jax.jit
    def late(c):
        run = simulate(c, Scenario(), n_steps=300)
        return jnp.sum(run.position**2) * 1e-3 + jnp.sum(run.heading[100::50] ** 2)

    gradient = jax.grad(late)(controller)
    assert gradient.k1.dtype == jnp.float64

    def along(step):
        return late(replace(controller, {"k1": 25.0 + step}))

    slope = (along(1e-4) - along(-1e-4)) / 2e-4
    np.testing.assert_allclose(gradient.k1, slope, rtol=1e-6)
    with pytest.raises(TypeError, match="int"):
        jax.grad(late)(NeuroBackstepping(k1=25))


@pytest.mark.slow
def test_gradient_of_a_batch_in_gains_and_in_its_own_leaves():
    """Three scenarios, rolled out in blocks of two, in either mode."""
    limits, amplitudes, headings = [0.3, 0.5, 0.6], [0.0, 0.2, 0.4], [-0.4, 0.1, 0.9]
    weights = jnp.array([1.0, 2.0, 3.0])  # the rows must not be exchanged
    names = ("deadzone.position.threshold_right", "disturbance.amplitude", "start.heading")

    @jax.jit
    def function(x):
        controller = replace(NeuroBackstepping(), {"k1": 20 * jnp.exp(x[0]), "Lam_psi": 9 * jnp.exp(x[1])})
        values = dict(zip(names, x[2:].reshape(3, 3), strict=True))
        metrics = evaluate(controller, batch(Scenario(), values), n_steps=500, block=2)
        return jnp.sum(weights * (jnp.sum(metrics.rmse, axis=-1) + 1e-3 * metrics.effort))

    x = jnp.array([0.0, 0.0, *limits, *amplitudes, *headings])
    slope, forward, reverse = central(function, x), jax.jacfwd(function)(x), jax.grad(function)(x)
    np.testing.assert_allclose(forward, slope, rtol=0, atol=1e-7 * np.abs(slope).max())
    assert (np.abs(forward) > 1e-6).all()
    np.testing.assert_allclose(reverse, forward, rtol=0, atol=1e-10 * np.abs(forward).max())


@pytest.mark.slow
def test_evaluate_maps_over_controllers():
    k1 = jnp.array([10.0, 20.0, 30.0])

    def of_k1(value):
        return evaluate(replace(NeuroBackstepping(), {"k1": value}), Scenario(), n_steps=500)

    rows, single = jax.vmap(of_k1)(k1), jax.jit(of_k1)
    for i, value in enumerate(k1):
        for row, alone in zip(jax.tree.leaves(rows), jax.tree.leaves(single(value)), strict=True):
            np.testing.assert_allclose(row[i], alone, rtol=1e-11, atol=1e-13)
    assert len(set(np.asarray(rows.iae[:, 0]).round(6))) == 3


def squared(numbers, offset=0.0):
    """The sum of squares, by a loop through which reverse mode does not go."""
    total = jax.lax.while_loop(
        lambda s: s[0] < 2, lambda s: (s[0] + 1, s[1] + sum(x**2 for x in numbers) / 2), (0, offset)
    )
    return total[1]


def test_value_and_gradient_of_few_numbers_are_taken_forwards():
    numbers = {f"k{i}": float(i) for i in range(MOST_FORWARD)}
    value, slope = agvjax.value_and_grad(lambda tree, **more: squared(tree.values(), **more))(numbers, offset=3.0)
    assert value == 3.0 + sum(i**2 for i in range(MOST_FORWARD))
    assert {name: float(x) for name, x in slope.items()} == {f"k{i}": 2.0 * i for i in range(MOST_FORWARD)}


def test_value_and_gradient_of_many_numbers_are_taken_backwards(monkeypatch):
    many = np.arange(MOST_FORWARD + 1.0)
    monkeypatch.setenv("XLA_FLAGS", "")
    with pytest.raises(ValueError, match="Reverse-mode"):
        agvjax.value_and_grad(squared)(many)
    (value, other), slope = agvjax.value_and_grad(lambda x: (x @ x, x[1]), has_aux=True)(many)
    np.testing.assert_array_equal(slope, 2 * many)
    assert value == many @ many and other == 1.0
    monkeypatch.setenv("XLA_FLAGS", FAST)  # which make reverse mode slower still
    np.testing.assert_array_equal(agvjax.value_and_grad(squared)(many)[1], 2 * many)
    (value, other), slope = agvjax.value_and_grad(lambda x: (x @ x, x[1]), has_aux=True)(many[:3])
    np.testing.assert_array_equal(slope, [0.0, 2.0, 4.0])
    assert value == 5.0 and other == 1.0


@pytest.mark.slow
def test_value_and_gradient_of_a_controller_is_a_controller():
    law = agvjax.check(agvjax.NeuroBackstepping())

    def cost(law):
        return agvjax.simulate(law, agvjax.check(agvjax.Scenario()), n_steps=20).position[-1] @ jnp.ones(2)

    value, slope = agvjax.value_and_grad(cost)(law)
    h = 1e-4
    ends = [float(cost(agvjax.replace(law, {"k1": law.k1 + s}))) for s in (h, -h)]
    np.testing.assert_allclose(slope.k1, (ends[0] - ends[1]) / (2 * h), rtol=1e-6)
    assert value == cost(law)
