"""A number that is a curve over what is measured: the curve against SciPy's, the law with it, and what is refused."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

import agvjax
from agvjax import Measurement, NeuroBackstepping, PathPID, Sampled, Scenario, Schedule
from agvjax.schedule import extremes, scheduled
from tuning.config import dump, load
from tuning.tune.gains import Gains
from tuning.tune.rules import faults

NODES = np.array([0.0, 0.3, 0.5, 1.2, 2.0])
VALUES = np.array([4.0, 6.0, 6.5, 2.0, 2.0])


def seen(velocity=(0.6, 0.8), heading=0.0, yaw_rate=-0.4):
    return Measurement(
        position=jnp.zeros(2),
        velocity=jnp.array(velocity),
        heading=jnp.asarray(heading),
        yaw_rate=jnp.asarray(yaw_rate),
    )


def test_the_curve_is_that_of_scipy_with_level_ends():
    slopes = PchipInterpolator(NODES, VALUES).derivative()(NODES)
    slopes[[0, -1]] = 0.0
    x = np.linspace(-0.5, 2.5, 3001)
    wanted = CubicHermiteSpline(NODES, VALUES, slopes)(np.clip(x, 0, 2))
    curve = Schedule(nodes=NODES, values=VALUES)
    np.testing.assert_allclose(jax.vmap(curve)(jnp.asarray(x)), wanted, atol=1e-13)
    slope = jax.vmap(jax.grad(curve))(jnp.asarray(x))
    assert np.abs(np.diff(slope)).max() < 0.5  # no jump at a node, nor beyond the ends
    rising = x[:-1] < 0.5
    assert np.all(np.diff(wanted)[rising] > -1e-12) and np.all(np.diff(wanted)[~rising] < 1e-12)


def test_equal_values_are_exactly_that_number_and_slopes_in_them_add_up_to_one():
    flat = Schedule(nodes=NODES, values=np.full(5, 0.1))
    assert {float(flat(jnp.asarray(x))) for x in (-1.0, 0.0, 0.123, 0.5, 1.7, 9.0)} == {0.1}
    bent = VALUES - np.array([0, 0, 0, 0, 0.5])  # between equal values the curve has a kink in them
    slopes = jax.grad(lambda v: Schedule(nodes=NODES, values=v)(jnp.asarray(0.7)))(jnp.asarray(bent))
    differences = []
    for i in range(5):
        ends = [bent + np.eye(5)[i] * h for h in (1e-6, -1e-6)]
        up, down = (float(Schedule(nodes=NODES, values=v)(jnp.asarray(0.7))) for v in ends)
        differences.append((up - down) / 2e-6)
    np.testing.assert_allclose(slopes, differences, atol=1e-8)
    assert float(slopes.sum()) == pytest.approx(1.0)


@pytest.mark.parametrize(("over", "wanted"), [("speed", 1.0), ("velocity", 0.6), ("yaw_rate", 0.4)])
def test_what_it_is_over(over, wanted):
    line = Schedule(over=over, nodes=np.array([-9.0, 9.0]), values=np.array([0.0, 1.0]))
    t = (wanted + 9) / 18
    assert float(line.of(seen())) == pytest.approx(t * t * (3 - 2 * t), rel=1e-12)


def test_a_vehicle_that_does_not_measure_it_is_refused():
    with pytest.raises(ValueError, match="steering_angle"):
        Schedule(over="steering_angle").of(seen())


def test_a_standing_vehicle_has_finite_slopes():
    slope = jax.grad(lambda v: Schedule().of(seen(velocity=v)))(jnp.zeros(2))
    assert np.isfinite(np.asarray(slope)).all()


RUN = {"dt": 0.01, "n_steps": 300}


@pytest.mark.slow  # also since with little optimisation the runs are not equal to the bit
def test_a_level_schedule_is_the_plain_law_and_one_far_from_its_nodes_that_of_its_end():
    law, scenario = NeuroBackstepping(), Scenario()
    flat = dataclasses.replace(law, k1=Schedule(values=np.full(2, law.k1)), Lam=Schedule(values=np.full(2, law.Lam)))
    plain = agvjax.simulate(law, scenario, **RUN)
    np.testing.assert_array_equal(agvjax.simulate(flat, scenario, **RUN).position, plain.position)
    fast = dataclasses.replace(law, k1=Schedule(nodes=np.array([-5.0, -4.0]), values=np.array([1.0, law.k1])))
    np.testing.assert_array_equal(agvjax.simulate(fast, scenario, **RUN).position, plain.position)
    bent = dataclasses.replace(law, k1=Schedule(nodes=np.array([0.0, 0.5]), values=np.array([1.0, law.k1])))
    assert float(jnp.abs(agvjax.simulate(bent, scenario, **RUN).position - plain.position).max()) > 1e-3


def test_in_a_computer_the_number_is_that_of_the_instant():
    """A proportional law over a Sampled: its command is k(|v|) times the error, by hand."""

    @agvjax.pytree
    class Pulling(agvjax.Law):
        k: agvjax.Real = agvjax.number(1.0, "1/s^2", agvjax.POSITIVE)
        tunable = ("k",)

        def init(self, measurement, reference):
            return ()

        def law(self, flow, memory, measurement, reference):
            pull = self.k * (reference.position - measurement.position)
            return agvjax.Command(position=pull, heading=jnp.zeros(())), ()

    curve = Schedule(nodes=np.array([0.0, 0.2, 0.6]), values=np.array([3.0, 2.0, 0.5]))
    law = Sampled(inner=Pulling(k=curve), vehicle=agvjax.Decoupled(), period=0.05)
    run = agvjax.simulate(law, Scenario(), dt=0.01, n_steps=200)
    held = np.asarray(run.command[:, :2])[5::5]  # what was computed at the instants
    at = slice(5, None, 5)
    speed = np.linalg.norm(np.asarray(run.velocity)[at], axis=1)
    slopes = PchipInterpolator(curve.nodes, curve.values).derivative()(curve.nodes)
    slopes[[0, -1]] = 0
    k = CubicHermiteSpline(curve.nodes, curve.values, slopes)(np.clip(speed, 0, 0.6))
    error = np.asarray(run.reference_position - run.position)[at]
    np.testing.assert_allclose(held, k[:, None] * error, rtol=1e-9, atol=1e-12)
    assert np.ptp(k) > 0.5


TABLE = 'controller.inner.k_y={over="speed", nodes=[0.2, 0.8], values=[8.0, 5.0]}'


def test_it_is_written_in_toml_tuned_by_its_values_and_taken_back(tmp_path):
    config = load(["base"], ['controller.inner="path_pid"', TABLE], faults)
    k_y = config.controller.inner.k_y
    assert isinstance(k_y, Schedule) and k_y.nodes.tolist() == [0.2, 0.8]
    file = tmp_path / "again.toml"
    file.write_text(dump(config))
    again = load([str(file)], [], faults)
    np.testing.assert_array_equal(again.controller.inner.k_y.values, [8.0, 5.0])
    gains = Gains.of(config)
    assert gains.names[:3] == ("inner.k_y.values[0]", "inner.k_y.values[1]", "inner.k_psi")
    z = gains.coordinates(config.controller)
    moved = gains.controller(z.at[1].add(np.log(2.0)), config.controller)  # of a gain > 0 the logarithm
    np.testing.assert_allclose(moved.inner.k_y.values, [8.0, 10.0], rtol=1e-12)
    named = load([str(file)], ['tune.gains=["inner.k_y"]'], faults)
    assert Gains.of(named).names == ("inner.k_y.values[0]", "inner.k_y.values[1]")
    plain = load([str(file)], ["controller.inner.k_y=7", 'tune.gains=["inner.k_y"]'], faults)
    assert plain.controller.inner.k_y == 7.0
    other = load([str(file)], ["controller.inner.k_y.values=[3, 4]"], faults)
    assert other.controller.inner.k_y.nodes.tolist() == [0.2, 0.8]


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        (TABLE.replace("speed", "load"), r"k_y\.over = load: must be one of speed, velocity"),
        (TABLE.replace("speed", "steering_angle"), r"k_y\.over = steering_angle: must be what the vehicle measures"),
        (TABLE.replace("[0.2, 0.8]", "[0.8, 0.2]"), r"k_y\.nodes = \[0\.8, 0\.2\]: must be at least two"),
        (TABLE.replace("[8.0, 5.0]", "[8.0]"), r"k_y\.values = \[8\.0\]: must be one for each node, 2"),
        (TABLE.replace("5.0]", "-5.0]"), r"k_y\.values = \[8\.0, -5\.0\]: must be each > 0"),
        ('controller.period={over="speed"}', r"controller\.period"),
        (TABLE.replace('over="speed", ', 'ovr="speed", '), r"k_y\.ovr"),
    ],
)
def test_what_is_no_schedule_is_refused_by_name(setting, message):
    with pytest.raises(agvjax.InputError, match=message):
        load(["base"], ['controller.inner="path_pid"', setting], faults)


def test_the_conditions_of_a_law_hold_for_every_value():
    law = NeuroBackstepping(k1=Schedule(values=np.array([1.0, 5.0])))
    low, high = extremes(law)
    assert low.k1 == 1.0 and high.k1 == 5.0 and extremes(NeuroBackstepping())[0].k1 == NeuroBackstepping().k1
    fast = agvjax.step_warnings(NeuroBackstepping(k1=Schedule(values=np.array([1.0, 80.0]))), 0.02, agvjax.RK4)
    assert any("k1" in text for text in fast) and not agvjax.step_warnings(low, 0.001, agvjax.RK4)
    config = load([], ["controller.k1={values=[3.0, 4.0]}"], faults)
    bounds, plain = Gains.of(config), Gains.of(load([], [], faults))
    k1 = plain.names.index("k1")
    assert bounds.lower[:2].tolist() == [plain.lower[k1]] * 2  # that of the stability condition


def test_no_schedule_costs_nothing():
    law = PathPID()
    assert scheduled(law, seen()) is law
