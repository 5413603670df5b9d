"""Many scenarios at once: rows equal single runs, a diverging one spoils no other, memory does not grow with time."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agvjax import Batch, NeuroBackstepping, Scenario, batch, evaluate, leaves, replace, simulate

VALUES = {
    "deadzone.heading.slope_left": np.array([0.4, 0.72, 1.0]),
    "disturbance.amplitude": np.array([0.0, 0.2, 0.4]),
    "start.position": np.array([[-0.5, 0.5], [0.2, 0.1], [0.4, -0.3]]),
}


@pytest.mark.slow
@pytest.mark.parametrize(("dtype", "tolerance"), [(jnp.float64, 1e-12), (jnp.float32, 1e-5)])
def test_rows_of_a_mapped_simulation_are_single_runs(dtype, tolerance):
    many, controller = batch(Scenario(), VALUES), NeuroBackstepping()
    run = functools.partial(simulate, n_steps=500, dtype=dtype)
    rows = jax.vmap(run, in_axes=(None, many.axes))(controller, many.scenario)
    assert rows.t.shape == (3, 501) and rows.position.dtype == dtype
    for i in range(3):
        alone = run(controller, replace(Scenario(), {name: value[i] for name, value in VALUES.items()}))
        for row, single in zip(jax.tree.leaves(rows), jax.tree.leaves(alone), strict=True):
            # relative to the largest of the signal: near 0 a difference of large numbers has no digits of its own
            np.testing.assert_allclose(row[i], single, rtol=0, atol=tolerance * max(1.0, float(np.abs(single).max())))


@pytest.mark.slow
def test_blocks_change_no_metric_whether_they_divide_the_batch_or_not():
    heading = np.linspace(-0.5, 1.0, 5)
    many = batch(Scenario(), {"start.heading": heading, "start.position": np.linspace(-0.5, 0.5, 10).reshape(5, 2)})
    rows = evaluate(NeuroBackstepping(), many, n_steps=500, block=2)
    assert rows.rmse.shape == (5, 3) and rows.ok.shape == (5,)
    for i in range(5):
        single = evaluate(NeuroBackstepping(), many[i], n_steps=500)
        for row, alone in zip(jax.tree.leaves(rows), jax.tree.leaves(single), strict=True):
            np.testing.assert_allclose(row[i], alone, rtol=1e-12, atol=1e-12)
    assert len(set(np.asarray(rows.rmse[:, 2]))) == 5


def test_batch_picks_rows_and_slices():
    many = batch(Scenario(), VALUES)
    assert many.size == 3 and many.names == tuple(sorted(VALUES))
    assert leaves(many[2])["disturbance.amplitude"] == 0.4
    np.testing.assert_array_equal(leaves(many[2])["start.position"], [0.4, -0.3])
    part = many[np.array([2, 0])]
    assert isinstance(part, Batch) and part.size == 2
    np.testing.assert_array_equal(leaves(part.scenario)["deadzone.heading.slope_left"], [1.0, 0.4])
    axes = leaves(many.axes)
    assert axes["start.position"] == 0 and set(axes) == set(VALUES)


def test_batch_refuses_what_does_not_vary_together():
    with pytest.raises(KeyError, match="did you mean deadzone.position.threshold_right"):
        batch(Scenario(), {"deadzone.position.treshold_right": np.zeros(3)})
    with pytest.raises(ValueError, match="same length"):
        batch(Scenario(), {"start.heading": np.zeros(3), "disturbance.amplitude": np.zeros(4)})
    with pytest.raises(ValueError, match="leading axis"):
        batch(Scenario(), {"start.heading": 0.1})
    with pytest.raises(ValueError, match="at least one"):
        batch(Scenario(), {})
    for name, shape in (("start.position", (4,)), ("disturbance.omega", (4, 2)), ("start.heading", (4, 1))):
        with pytest.raises(ValueError, match=f"value of {name}"):
            batch(Scenario(), {name: np.ones(shape)})


@pytest.mark.slow
def test_a_list_of_values_is_a_batch():
    one, two = (
        evaluate(NeuroBackstepping(), batch(Scenario(), {"disturbance.amplitude": values}), n_steps=50)
        for values in ([0.1, 0.3], np.array([0.1, 0.3]))
    )
    np.testing.assert_array_equal(one.rmse, two.rmse)


SOUND = {
    "deadzone.position.slope_right": np.array([0.6, 0.7, 0.5, 0.9]),
    "start.heading": np.array([0.1, 0.2, 0.3, 0.4]),
}
# a negative slope drives the vehicle the wrong way: it diverges exponentially; NaN is wrong from the first step on
BAD = {
    "diverging": {**SOUND, "deadzone.position.slope_right": np.array([0.6, -30.0, 0.5, 0.9])},
    "nan": {**SOUND, "start.heading": np.array([0.1, np.nan, 0.3, 0.4])},
}


def judge(controller, values):
    return evaluate(controller, batch(Scenario(), values), n_steps=500)


judge_jit = jax.jit(judge)


def cost(controller, values, weights):
    """The mean over the runs that hold out, by a mask: 0 * inf would be NaN."""
    metrics = judge(controller, values)
    each = jnp.sum(metrics.rmse, axis=-1) + 1e-3 * metrics.effort + 1e-3 * jnp.sum(metrics.peak_command, axis=-1)
    return jnp.sum(jnp.where((weights > 0) & metrics.ok, weights * each, 0.0))


WEIGHTS = jnp.array([1.0, 0.0, 1.0, 1.0])
GAINS = {"k1": 20.0, "k3": 12.0, "Lam": 16.0}


def of_gains(gains, values, weights):
    return cost(replace(NeuroBackstepping(), gains), values, weights)


@pytest.mark.parametrize("kind", BAD)
def test_a_diverging_run_leaves_the_others_alone(kind):
    sound, bad = (judge_jit(NeuroBackstepping(), v) for v in (SOUND, BAD[kind]))
    assert sound.ok.all()
    np.testing.assert_array_equal(bad.ok, [True, False, True, True])
    others = np.array([0, 2, 3])
    for name, before in leaves(sound).items():
        after = leaves(bad)[name]
        np.testing.assert_allclose(after[others], before[others], rtol=1e-12, atol=1e-14, err_msg=name)
    late = {"ok", "settled", "rmse_late"}
    assert all(np.isinf(np.asarray(value[1])).all() for name, value in leaves(bad).items() if name not in late)
    assert not bad.settled[1].any()


# in three gains, and in the batch's own leaves; compiled once
forward, reverse = jax.jit(jax.jacfwd(of_gains)), jax.jit(jax.grad(of_gains, argnums=(0, 1)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", BAD)
def test_a_diverging_run_leaves_derivatives_of_either_mode_alone(kind):
    sound, bad = (forward(GAINS, values, WEIGHTS) for values in (SOUND, BAD[kind]))
    (gains, leaves_of_sound), (bad_gains, leaves_of_bad) = (reverse(GAINS, v, WEIGHTS) for v in (SOUND, BAD[kind]))
    for name, value in sound.items():
        assert value != 0
        np.testing.assert_allclose([bad[name], gains[name], bad_gains[name]], [value] * 3, rtol=1e-9, err_msg=name)
    for name, value in leaves_of_sound.items():  # those of the bad run are 0
        np.testing.assert_allclose(leaves_of_bad[name], value, rtol=1e-9, atol=1e-14, err_msg=name)


@pytest.mark.slow
def test_a_controller_that_diverges_spoils_no_other():
    omega_n = jnp.array([90.0, 90.0 * 60, 60.0])  # 5400 rad/s: far outside what RK4 carries at 1 ms

    def one(value):
        return evaluate(replace(NeuroBackstepping(), {"omega_n": value}), Scenario(), n_steps=500)

    mapped = jax.jit(jax.vmap(one))
    rows, sound = mapped(omega_n), mapped(omega_n.at[1].set(80.0))
    np.testing.assert_array_equal(rows.ok, [True, False, True])
    assert np.isinf(np.asarray(rows.rmse[1])).all() and np.isinf(np.asarray(rows.chatter[1])).all()
    assert sound.ok.all()
    others = np.array([0, 2])
    for name, before in leaves(sound).items():
        np.testing.assert_allclose(leaves(rows)[name][others], before[others], rtol=1e-12, atol=1e-14, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["value", "forward derivative", "reverse derivative"])
def test_memory_of_evaluate_does_not_grow_with_the_horizon(mode):
    def temporary(n_steps):
        def value(k1):
            many = batch(Scenario(), {"start.heading": jnp.linspace(0.0, 1.0, 4)})
            return evaluate(replace(NeuroBackstepping(), {"k1": k1}), many, n_steps=n_steps).rmse

        if mode == "reverse derivative":
            function = jax.grad(lambda k1: value(k1).sum())
        else:
            function = value if mode == "value" else lambda k1: jax.jvp(value, (k1,), (jnp.ones_like(k1),))[1]
        return jax.jit(function).lower(jnp.array(20.0)).compile().memory_analysis().temp_size_in_bytes

    short, long = temporary(2000), temporary(20_000)
    assert short > 0
    assert abs(long - short) <= 0.1 * short
