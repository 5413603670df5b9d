"""What is refused: values, and steps that the integrator does not carry."""

import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import EULER, RK4, InputError, NeuroBackstepping, Scenario, check, faults, replace, step_faults
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
