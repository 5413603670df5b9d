"""What is refused: values, and steps that the integrator does not carry."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import EULER, RK4, InputError, NeuroBackstepping, Scenario, check, faults, replace, step_faults
from agvjax.errors import told_apart
from agvjax.readings import LiteralFilter


def test_literal_filter_has_the_poles_of_the_printed_equation():
    poles = NeuroBackstepping(filter=LiteralFilter()).poles()
    natural = 90**1.5  # reading R5: 854 rad/s, damping .079
    np.testing.assert_allclose(np.abs(poles), natural, rtol=1e-12)
    np.testing.assert_allclose(-poles.real / natural, 0.75 / np.sqrt(90), rtol=1e-12)


def test_problems_name_every_bad_leaf():
    controller = NeuroBackstepping(k1=-1.0, Lam=float("nan"), b1="1", Pi_hat=np.array([0.5, -0.5]))
    assert {p.key for p in faults(controller)} == {"k1", "Lam", "b1", "Pi_hat"}
    scenario = replace(
        Scenario(), {"deadzone.heading.slope_left": 0.0, "start.position": np.zeros(3), "start.heading": True}
    )
    assert {p.key for p in faults(scenario)} == {"deadzone.heading.slope_left", "start.position", "start.heading"}
    with pytest.raises(InputError, match=r"4 bad values:(.|\n)*k1 = -1.0: must be finite and > 0 \[after eq. \(32\)\]"):
        check(controller)
    assert issubclass(InputError, ValueError)
    assert faults(NeuroBackstepping()) == [] and faults(Scenario()) == []
    assert check(NeuroBackstepping(k1=25)).k1.dtype == jnp.float64
    assert check(NeuroBackstepping(k1=25), jnp.float32).k1.dtype == jnp.float32


@pytest.mark.parametrize(
    ("part", "said"),
    [
        (agvjax.Saturation(upper=-3.0, lower=3.0), "upper = -3.0: must be above lower = 3.0"),
        (agvjax.Saturation(upper=-3.0), "upper = -3.0: must be above lower = -1.0"),
        (agvjax.BandLimitedNoise(low=4.0, high=2.0), "high = 2.0: must be above low = 4.0"),
        (agvjax.Oustaloup(low=1.0, high=1.0), "high = 1.0: must be above low = 1.0"),
        (agvjax.Start(position=0.0), r"position = shape (): must be an array of shape (2,)"),
        (agvjax.Line(velocity=1.0), r"velocity = shape (): must be an array of shape (2,)"),
        (agvjax.DifferentialDrive(road_slope=0.0), r"road_slope = shape (): must be an array of shape (2,)"),
        (agvjax.Cosine(amplitude=[0.1, 0.2]), r"amplitude = shape (2,): must be a number or an array of shape (3,)"),
        (agvjax.Start(heading=1j), "heading = 1j: must be a number, finite"),
        (agvjax.Harmonic(omega=1e31), "omega = 1e+31: must be >= 0, and at most 1e+30 in size"),
        (NeuroBackstepping(zeta=1e308), "zeta = 1e+308: must be > 0, and at most 1e+30 in size"),
        (agvjax.Start(position=[[0.0], [1.0, 2.0]]), "position = [[0.0], [1.0, 2.0]]: must be an array of shape (2,)"),
    ],
)
def test_limits_the_wrong_way_round_and_wrong_shapes_are_named(part, said):
    (fault,) = faults(part)
    assert str(fault).startswith(said)


@pytest.mark.parametrize(
    ("bound", "value", "text"),
    [
        (0.02, 0.01, "0.02"),
        (0.00100004, 0.001, "0.00100004"),
        (2 / 3, 0.667, "0.6667"),
        (1 + 2**-52, 1.0, "1.0000000000000002"),
    ],
)
def test_a_bound_is_told_from_the_value_that_breaks_it(bound, value, text):
    assert told_apart(bound, value) == text


@pytest.mark.slow
def test_lists_of_numbers_are_as_good_as_arrays():
    lists = Scenario(
        start=agvjax.Start(position=[-0.4, 0.3], velocity=(0.1, 0.2)),
        path=agvjax.Line(velocity=[0.5, 0.1]),
        disturbance=agvjax.Cosine(amplitude=[0.1, 0.2, 0.3]),
    )
    arrays = Scenario(
        start=agvjax.Start(position=np.array([-0.4, 0.3]), velocity=np.array([0.1, 0.2])),
        path=agvjax.Line(velocity=np.array([0.5, 0.1])),
        disturbance=agvjax.Cosine(amplitude=np.array([0.1, 0.2, 0.3])),
    )
    law, runs = NeuroBackstepping(), []
    for scenario in (lists, check(lists), arrays):
        runs.append(agvjax.simulate(law, scenario, n_steps=20).position)
    np.testing.assert_array_equal(runs[0], runs[2])
    np.testing.assert_array_equal(runs[1], runs[2])


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda c, s: agvjax.simulate(s, c), "scenario must be one agvjax.Scenario, after the controller"),
        (lambda c, s: agvjax.simulate(c, agvjax.batch(s, {"limit": [1.0, 2.0]})), "must be one agvjax.Scenario"),
        (lambda c, s: agvjax.evaluate(c, s, n_steps=10.5), "n_steps and control_every must be whole"),
        (lambda c, s: agvjax.simulate(c, s, control_every=1.5), "n_steps and control_every must be whole"),
        (lambda c, s: agvjax.simulate(c, s, integrator="rk4"), "integrator must be agvjax.RK4, HEUN or EULER"),
        (lambda c, s: agvjax.simulate(c, replace(s, {"start.position": np.zeros(3)})), r"start.position must have"),
        (lambda c, s: agvjax.simulate(agvjax.FractionalBackstepping(inner=agvjax.OSFC()), s), "integrals"),
    ],
)
def test_mistakes_in_a_call_are_named(call, said):
    with pytest.raises((TypeError, ValueError), match=said):
        call(NeuroBackstepping(), Scenario())


def test_a_fractional_integral_needs_a_law_that_integrates():
    law = agvjax.EventTriggered(inner=agvjax.FractionalBackstepping(inner=agvjax.EventTriggered(inner=agvjax.OSFC())))
    assert [fault.key for fault in law.faults(agvjax.Decoupled())] == ["inner.inner"]
    assert agvjax.FractionalBackstepping(inner=agvjax.EventTriggered()).faults(agvjax.Decoupled()) == []


def test_step_problems_know_what_the_integrator_carries():
    law, literal = NeuroBackstepping(), NeuroBackstepping(filter=LiteralFilter())
    assert step_faults(law, 1e-3, 12.0, RK4) == [] and step_faults(literal, 1e-3, 12.0, RK4) == []
    assert [p.key for p in step_faults(law, 0.05, 12.0, RK4)] == ["dt"]
    # Euler carries the literal filter only up to 2 zeta / omega_n^2: 1.9e-4 s
    assert [p.key for p in step_faults(literal, 1e-3, 12.0, EULER)] == ["dt"]
    assert step_faults(literal, 1.8e-4, 12.0, EULER) == []
    assert [p.key for p in step_faults(law, 1e-3, 5e-4, RK4)] == ["horizon"]
    assert [p.key for p in step_faults(law, float("nan"), 1.0, RK4)] == ["dt"]


def test_stability_bounds_are_those_of_the_paper():
    assert NeuroBackstepping().stability_bounds(0.6, 0.72) == {"k1": 1.0, "k2": 0.5 / 0.6, "k3": 0.5 / 0.72}
    assert agvjax.NeuroBackstepping().stability_bounds(2.0, 0.5)["k2"] == 0.5


def test_a_coarse_step_names_the_gains_it_is_too_coarse_for():
    law = agvjax.NeuroBackstepping()
    assert agvjax.step_warnings(law, 5e-3, agvjax.RK4) == []  # the step of `tune`
    (said,) = agvjax.step_warnings(law, 2e-2, agvjax.RK4)
    assert "dt = 0.02 s" in said and "omega_n" in said and "k1" not in said
    (said,) = agvjax.step_warnings(law, 5e-3, agvjax.EULER)
    assert "k1 (5%)" in said  # 20/s times 5 ms, halved
    assert agvjax.step_warnings(agvjax.OSFC(), 5e-3, agvjax.EULER) == []  # names no modes


@pytest.mark.parametrize("dt", [0.0, -0.1, np.nan, np.float32(-1.0)])
@pytest.mark.parametrize("run", [agvjax.simulate, agvjax.evaluate])
def test_a_step_that_is_none_is_refused_before_it_is_traced(run, dt):
    with pytest.raises(ValueError, match="dt must be finite and > 0 s; got"):
        run(agvjax.Backstepping(), agvjax.Scenario(), dt=dt, n_steps=10)


def test_a_name_in_place_of_an_object_is_refused_before_it_is_traced():
    scenario = dataclasses.replace(agvjax.Scenario(), path="circle")
    with pytest.raises(TypeError, match=r"scenario\.path = 'circle': names are for TOML"):
        agvjax.simulate(agvjax.Backstepping(), scenario, n_steps=10)
