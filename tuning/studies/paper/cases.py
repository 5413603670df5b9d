"""Who runs what: the laws of the paper, ablations, readings and sweeps, and how they are rolled out together."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import agvjax
from agvjax.leaves import cast

from ...config.settings import Config
from .proof import papers_deadzones

LABELS = {
    "proposed": "Proposed",
    "osfc": "OSFC",
    "asmc": "ASMC",
    "ftsmc": "FTSMC",
    "dfc": "DFC",
    "weights_5": "5 weights",
    "weights_50": "50 weights",
    "super_twisting": "super-twisting FTSMC (extra)",
    "event": "event-triggered",
    "fractional": "fractional integral",
    "no_network": "no network",
    "no_integral": "no integral",
    "no_filter": "no command filter",
    "known_slopes": "known slopes",
}
BANDWIDTHS = (5.0, 6.3, 8.0, 10.0, 12.5, 16.0, 20.0, 25.0, 32.0, 40.0)  # 1/s
B1 = (0.05, 0.07, 0.1, 0.2, 0.5, 1.0, 2.0)
FINER = {"b1": 5, "known b1": 5}  # steps to one of the others: a small b1 makes the adaptation stiff at the start
ORDERS = (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)


class Case(NamedTuple):
    """One run: a law in a scenario."""

    controller: agvjax.Law
    scenario: agvjax.Scenario


def papers_law(config: Config) -> agvjax.NeuroBackstepping:
    """The paper's law of a configuration; see `faults`."""
    law = config.controller
    if not isinstance(law, agvjax.NeuroBackstepping):
        raise agvjax.InputError(faults(law, config.scenario))
    return law


def faults(controller: agvjax.Law, scenario: agvjax.Scenario) -> list[agvjax.Fault]:
    """What the laws of the paper need of a configuration."""
    found = []
    if type(controller) is not agvjax.NeuroBackstepping:
        rule = "neuro_backstepping: the paper's law, whose gains and readings may be set"
        found.append(agvjax.Fault("controller", type(controller).__name__, rule))
    if not isinstance(scenario.plant, agvjax.Decoupled):
        found.append(agvjax.Fault("scenario.plant", type(scenario.plant).__name__, "decoupled, as in the paper"))
    return found


def matched(law: str, p: float, like: agvjax.Law) -> agvjax.Law:
    """A law's gains for the closed-loop bandwidth p [1/s] ; what p does not set is that of `like`."""
    gains: dict[str, dict[str, float]] = {
        "proposed": {"k1": p, "k2": p, "Lam": 0.04 * p**2, "k3": 0.6 * p, "Lam_psi": 0.0625 * (0.6 * p) ** 2},
        "osfc": {"kp": p**2, "kd": 2 * p, "kpsi": 0.6 * p, "wo": max(20.0, 3 * p), "wow": max(20.0, 3 * p)},
        "asmc": {"c": p, "k": p, "kw": 0.6 * p},
        "dfc": {"kp": p**2, "kd": 2 * p, "kpsi": 0.6 * p},
        "ftsmc": {"a": 0.75 * p, "k1": 0.75 * p, "b": 0.25 * p, "k2": 0.25 * p, "kw1": 0.45 * p, "kw2": 0.15 * p},
    }
    return agvjax.replace(like, gains[law])


def true_slopes(controller: agvjax.NeuroBackstepping, scenario: agvjax.Scenario) -> agvjax.NeuroBackstepping:
    """A backstepping law that knows the scenario's slopes (readings R2, R3)."""
    beliefs = {}
    for name, channel in (("Pi_hat", "position"), ("Pi_psi_hat", "heading")):
        actuator = papers_deadzones(scenario)[channel]
        beliefs[name] = agvjax.readings.KnownSlopes(right=actuator.slope_right, left=actuator.slope_left)
    return dataclasses.replace(controller, **beliefs)


def no_deadzone(scenario: agvjax.Scenario) -> agvjax.Scenario:
    """The same scenario with actuators that deliver what they are asked for."""
    return dataclasses.replace(scenario, deadzone={name: agvjax.Deadzone() for name in scenario.deadzone})


def groups(proposed: agvjax.NeuroBackstepping, scenario: agvjax.Scenario) -> dict[str, dict[str, Case]]:
    """All runs of the reproduction, in groups of one structure, each rolled out as one batch: group -> name -> case."""
    change = functools.partial(dataclasses.replace, proposed)
    laws = {"osfc": agvjax.OSFC(), "asmc": agvjax.ASMC(), "dfc": agvjax.DFC(), "ftsmc": agvjax.FTSMC()}

    def alone(**controllers: agvjax.Law) -> dict[str, Case]:
        return {name: Case(controller, scenario) for name, controller in controllers.items()}

    def swept(law: str, like: agvjax.Law) -> dict[str, Case]:
        return alone(**{law: like}, **{f"{law} p={p:g}": matched(law, p, like) for p in BANDWIDTHS})

    found = {"proposed": swept("proposed", proposed)}
    found["proposed"] |= alone(no_integral=change(Lam=0.0, Lam_psi=0.0))
    found["proposed"]["R1 literal"] = Case(proposed, literal_thresholds(scenario))
    for law, like in laws.items():
        found[law] = swept(law, like)
        if law in ("dfc", "ftsmc"):
            found[law][f"{law} without deadzone"] = Case(like, no_deadzone(scenario))
    found["super_twisting"] = alone(super_twisting=agvjax.SuperTwistingFTSMC())
    shared = {f.name: getattr(proposed, f.name) for f in dataclasses.fields(agvjax.Backstepping)}
    for nodes in (5, 50):
        law = agvjax.FullWeightBackstepping.with_nodes(nodes, **shared)
        found[f"weights_{nodes}"] = alone(**{f"weights_{nodes}": law})
    found["no_network"] = alone(no_network=agvjax.Backstepping(**shared))
    found["no_filter"] = alone(no_filter=change(filter=agvjax.NoFilter()))
    found["known_slopes"] = alone(known_slopes=true_slopes(proposed, scenario))
    sweep = {f"b1={b1:g}": change(b1=b1, b2=b1) for b1 in B1}
    found["b1"] = alone(**sweep)
    found["known b1"] = alone(**{f"known {name}": true_slopes(law, scenario) for name, law in sweep.items()})
    found["event"] = alone(event=agvjax.EventTriggered(inner=proposed))
    orders = {f"lam={lam:g}": agvjax.FractionalBackstepping(inner=proposed, lam=lam) for lam in ORDERS}
    found["fractional"] = alone(fractional=agvjax.FractionalBackstepping(inner=proposed), **orders)
    return found | {name: {name: case} for name, case in readings(proposed, scenario).items()}


def literal_thresholds(scenario: agvjax.Scenario) -> agvjax.Scenario:
    """Reading R1, selectable: the left thresholds negative, as section 4 prints them."""
    zones = papers_deadzones(scenario)
    signed = {name: dataclasses.replace(d, threshold_left=-d.threshold_left) for name, d in zones.items()}
    return dataclasses.replace(scenario, deadzone=signed)


def readings(proposed: agvjax.NeuroBackstepping, scenario: agvjax.Scenario) -> dict[str, Case]:
    """Readings R5, R8 and R9 that are not the default, each alone."""
    see = functools.partial(dataclasses.replace, scenario)
    decoupled: Any = scenario.plant  # see `faults`
    plant = functools.partial(dataclasses.replace, decoupled)
    return {
        "R5 literal filter": Case(dataclasses.replace(proposed, filter=agvjax.readings.LiteralFilter()), scenario),
        "R8 raw bearing": Case(proposed, see(heading=agvjax.readings.RawBearing())),
        "R8 swapped bearing": Case(proposed, see(heading=agvjax.readings.SwappedBearing())),
        "R8 tangent": Case(proposed, see(heading=agvjax.Tangent())),
        "R9 literal (4)": Case(proposed, see(plant=plant(coupling=agvjax.readings.ForwardSpeed()))),
        "R9 yaw rate from velocities": Case(proposed, see(plant=plant(yaw_rate=agvjax.readings.KinematicYawRate()))),
    }


class Run(NamedTuple):
    """A case's trajectory, and its metrics by settling band."""

    trajectory: agvjax.Trajectory
    metrics: dict[str, agvjax.Metrics]

    @property
    def judged(self) -> agvjax.Metrics:
        """The metrics with the band of 0.05 m and rad (reading R10)."""
        return self.metrics["0.05"]


Judged = Mapping[str, Run]  # by case


@functools.partial(jax.jit, static_argnames=("n_steps", "save_every", "control_every", "integrator"))
def _roll(
    controllers: agvjax.Law, deadzones: dict[str, agvjax.Deadzone], scenario: agvjax.Scenario, **timing: Any
) -> Run:
    def one(controller: agvjax.Law, deadzone: dict[str, agvjax.Deadzone]) -> Run:
        run = agvjax.simulate(controller, dataclasses.replace(scenario, deadzone=deadzone), **timing)
        judged = [agvjax.measure(run, agvjax.Criteria(**band)) for band in BANDS.values()]
        return Run(run, dict(zip(BANDS, judged, strict=True)))

    return jax.vmap(one)(controllers, deadzones)


BANDS: dict[str, dict[str, Any]] = {  # reading R10: the paper does not say which
    "0.05": {},
    "5 % of the first error": {"band": 0.05, "relative": True},
    "2 % of the first error": {"band": 0.02, "relative": True},
}


def roll(cases: Mapping[str, Case], timing: Mapping[str, Any]) -> dict[str, Run]:
    """Run cases of one structure as one batch, by name, as NumPy arrays.

    They may differ in the numbers of the law and of the deadzones; the rest of the scenario is that of the first.
    """
    names, dtype = list(cases), jnp.result_type(float)
    trees = [cast((c.controller, c.scenario.deadzone), dtype) for c in cases.values()]
    controllers, deadzones = jax.tree.map(lambda *x: jnp.stack(x), *trees)
    scenario = cast(cases[names[0]].scenario, dtype)
    out = jax.tree.map(np.asarray, _roll(controllers, deadzones, scenario, **timing))
    return {name: jax.tree.map(lambda x, i=i: x[i], out) for i, name in enumerate(names)}
