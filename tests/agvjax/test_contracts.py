"""The base classes of laws, plants and what stands between: defaults, laws around laws, classes that name no base."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import Command, EventTriggered, FractionalBackstepping, Measurement, NeuroBackstepping, Scenario


@agvjax.pytree
class Counting(agvjax.Law):
    """Commands the number of control instants it has seen, kept in a memory and in no state."""

    step: float = agvjax.number(1.0)

    def init(self, measurement, reference):
        return ()

    def hold(self, measurement, reference):
        return jnp.zeros_like(measurement.heading)

    def jump(self, flow, memory, measurement, reference, h):
        return memory + self.step

    def law(self, flow, memory, measurement, reference):
        return Command(position=jnp.stack([memory, -memory]), heading=memory), ()

    def limited(self, memory):
        return memory > 5


def test_step_warnings_of_a_law_around_a_law_are_those_of_the_inner_law():
    (plain,) = agvjax.step_warnings(NeuroBackstepping(), 2e-2, agvjax.RK4)
    assert "omega_n (7%)" in plain
    for law in (EventTriggered(), FractionalBackstepping()):
        assert agvjax.step_warnings(law, 2e-2, agvjax.RK4) == [plain.replace("omega_n", "inner.omega_n")]
    (twice,) = agvjax.step_warnings(FractionalBackstepping(inner=EventTriggered()), 2e-2, agvjax.RK4)
    assert "inner.inner.omega_n (7%)" in twice
    assert agvjax.step_warnings(agvjax.Sampled(), 2e-2, agvjax.RK4) == []


def test_a_law_around_a_law_is_bounded_as_the_inner_law_is():
    plain, around = NeuroBackstepping(), EventTriggered()
    assert around.fastest == plain.fastest
    np.testing.assert_array_equal(around.poles(), plain.poles())
    assert around.stability_bounds(0.6, 0.72) == {
        f"inner.{name}": bound for name, bound in plain.stability_bounds(0.6, 0.72).items()
    }
    gains = FractionalBackstepping().gains_to_tune
    assert set(gains()) - set(gains(heading=False)) == {"inner.k3", "inner.Lam_psi"}
    assert EventTriggered().gains_to_tune() == ()


def test_event_trigger_sends_what_a_law_with_memory_asks_for():
    law = EventTriggered(inner=Counting(), delta=0.0, m=2.5)
    run = agvjax.simulate(law, Scenario(), n_steps=10)
    np.testing.assert_array_equal(run.command[:, 2], [0, 0, 3, 3, 3, 6, 6, 6, 9, 9, 9])
    np.testing.assert_array_equal(run.limited, np.arange(1, 12) > 5)  # whatever is sent, the inner law counts on


@pytest.mark.slow
def test_event_trigger_and_fractional_integral_may_be_put_around_in_either_order():
    one = EventTriggered(inner=FractionalBackstepping(), m=0.5)
    other = FractionalBackstepping(inner=EventTriggered(m=0.5))
    runs = [agvjax.simulate(law, Scenario(), n_steps=300, control_every=3) for law in (one, other)]
    np.testing.assert_allclose(runs[0].command, runs[1].command, rtol=1e-9, atol=1e-9)
    assert np.unique(runs[0].command[:, 0]).size < 60  # it is held most of the time
    plain = agvjax.simulate(EventTriggered(m=0.5), Scenario(), n_steps=300, control_every=3)
    assert np.abs(plain.position - runs[0].position).max() > 1e-6


def test_a_digital_loop_refuses_a_law_whose_memory_it_would_lose():
    with pytest.raises(ValueError, match="Sampled runs laws without memory; EventTriggered has some"):
        agvjax.simulate(agvjax.Sampled(inner=EventTriggered()), Scenario(), n_steps=2)


def test_what_does_not_suit_a_plant_or_a_path_is_said_by_the_part_itself():
    law = agvjax.Sampled(vehicle=agvjax.Unicycle(), anti_windup=agvjax.BackCalculation(limits=np.ones(3)))
    first, second = law.faults(agvjax.Decoupled())
    assert (first.key, first.value, second.key) == ("vehicle", "Unicycle", "anti_windup.limits")
    assert law.believing(agvjax.Unicycle(L=0.3), {}).vehicle.L == 0.3
    assert law.believing(agvjax.Decoupled(), {}) is law
    assert [f.key for f in EventTriggered(inner=law).faults(agvjax.Unicycle())] == ["inner.anti_windup.limits"]
    assert [f.key for f in agvjax.Bearing().faults(agvjax.Circle())] == ["heading"]
    assert agvjax.Bearing().faults(agvjax.Dumbbell()) == []
    assert agvjax.Delay(time=0.1, slots=3).faults(0.02)[0].key == "slots"


def of_a_base(name, body):
    """A class with a base and the same without, each under the decorator."""
    with pytest.warns(DeprecationWarning, match=rf"class Mine\(agvjax\.{name}\)"):
        without = agvjax.pytree(type("Mine", (), dict(body)))
    return without, agvjax.pytree(type("Mine", (getattr(agvjax, name),), dict(body)))


def proportional(self, flow, held, measurement, reference):
    error = self.stiffness * (reference.position - measurement.position) - 5 * measurement.velocity
    return Command(position=error, heading=reference.heading - measurement.heading), ()


OLD = {
    "Law": {
        "__annotations__": {"stiffness": float},
        "stiffness": 4.0,
        "init": lambda self, measurement, reference: (),
        "law": proportional,
    },
    "Path": {"__call__": lambda self, t: jnp.stack([0.3 * t, jnp.sin(t)])},
    "Disturbance": {"__call__": lambda self, t: jnp.stack([jnp.sin(t)] * 3)},
    "Heading": {"__call__": lambda self, path, t: path(t)[0]},
    "Element": {"deliver": lambda self, flow, held, u: (0.5 * u, ()), "limited": lambda self, u: jnp.any(u > 1)},
    "Sensor": {
        "__call__": lambda self, held, measurement: dataclasses.replace(measurement, heading=measurement.heading + 0.1)
    },
}


def scene(kind, part):
    if kind == "Law":
        return part, Scenario()
    field = {"Element": "actuators"}.get(kind, kind.lower())
    value = {"position": part} if kind == "Element" else part
    return NeuroBackstepping(), dataclasses.replace(Scenario(), **{field: value})


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=() if kind == "Element" else pytest.mark.slow) for kind in OLD]
)
def test_a_class_that_names_no_base_is_given_one_and_told_so(kind):
    without, derived = of_a_base(kind, OLD[kind])
    assert issubclass(without, getattr(agvjax, kind))
    if kind == "Element":
        new = {**OLD[kind], "limited": lambda self, flow, memory, u: jnp.any(u > 1)}
        derived = agvjax.pytree(type("Mine", (agvjax.Element,), new))
    one, other = (agvjax.simulate(*scene(kind, cls()), n_steps=30) for cls in (without, derived))
    for name in ("position", "command", "delivered", "limited"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    plain = agvjax.simulate(NeuroBackstepping(), Scenario(), n_steps=30)
    assert np.abs(np.asarray(one.delivered - plain.delivered)).max() > 1e-3
    if kind == "Law":
        assert without().gains_to_tune() == ("stiffness",)
        assert jax.tree.leaves(without(stiffness=2.0)) == [2.0]


def test_old_names_of_a_law_without_a_base_still_say_the_same():
    body = OLD["Law"] | {"tunable": ("stiffness", "turn"), "of_heading": ("turn",), "period": 0.05}
    body["__annotations__"] = {"stiffness": float, "period": float}
    without, _ = of_a_base("Law", body)
    assert without().gains_to_tune(heading=False) == ("stiffness",)
    assert without().control_period() == 0.05
    (fault,) = agvjax.step_faults(without(), 0.03, 1.0, agvjax.RK4)
    assert fault.key == "dt" and "0.05 s" in fault.rule


def test_a_plant_without_a_base_moves():
    body = {name: part for name, part in vars(agvjax.Decoupled).items() if not name.startswith("__")}
    fields = {"L": float, "yaw_rate": agvjax.DeliveredYawRate, "coupling": agvjax.TurnedVelocity}
    body |= {"__annotations__": fields}
    body["needs"] = lambda self, v, w, a, alpha: {"position": v + a}
    without, _ = of_a_base("Plant", body)
    one = agvjax.simulate(NeuroBackstepping(), Scenario(plant=without()), n_steps=30)
    np.testing.assert_array_equal(one.position, agvjax.simulate(NeuroBackstepping(), Scenario(), n_steps=30).position)
    np.testing.assert_array_equal(without().needs(agvjax.Motion(*np.eye(4)))["position"], [1, 0, 1, 0])
    assert without().commands_heading


def test_what_keeps_no_contract_is_refused_by_name():
    @agvjax.pytree
    class Something:
        size: float = 1.0

    for wrong, said in (
        ({"path": Something()}, r"path: Something must derive from agvjax\.Path"),
        ({"plant": Something()}, r"plant: Something must derive from agvjax\.Plant"),
        ({"actuators": {"position": Something()}}, r"actuators.position: Something must derive from agvjax\.Element"),
    ):
        with pytest.raises(TypeError, match=said):
            agvjax.simulate(NeuroBackstepping(), dataclasses.replace(Scenario(), **wrong), n_steps=2)
    with pytest.raises(TypeError, match=r"controller: Something must derive from agvjax\.Law"):
        agvjax.simulate(Something(), Scenario(), n_steps=2)


def test_a_base_says_what_is_missing():
    class Empty(agvjax.Law):
        pass

    with pytest.raises(NotImplementedError, match=r"Empty needs law\(flow, memory, measurement, reference\)"):
        Empty().law((), (), Measurement(position=0, velocity=0, heading=0, yaw_rate=0), None)


def test_numbers_used_in_double_precision_are_single_where_that_is_set():
    """JAX keeps what it made of a NumPy array while that is in use: here by a jitted function."""
    law, scenario = NeuroBackstepping(), Scenario()  # their arrays are the defaults', those of every other law too

    def end(law, scenario):
        return agvjax.simulate(law, scenario, dt=0.01, n_steps=1, integrator=agvjax.EULER).position[-1]

    run = jax.jit(lambda: end(law, scenario))
    double = run()
    with jax.enable_x64(False):
        for single in (run(), end(law, scenario), end(NeuroBackstepping(), Scenario())):
            assert single.dtype == jnp.float32
            np.testing.assert_allclose(single, double, rtol=1e-5)
