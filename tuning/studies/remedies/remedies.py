"""The remedies against a deadzone that a configured law and its vehicle can have, each as a law to be tuned."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import agvjax
from agvjax.leaves import spread

from ...config.settings import Config
from ..paper.cases import B1, true_slopes
from ..paper.facts import network_gains

LABELS = {
    "nothing": "nothing",
    "network": "network, b1 as configured",
    "network_strong": "network, b1 at which it matters",
    "network_tuned": "network, b1 tuned",
    "known_slopes": "slopes known, of each vehicle",
    "observer": "extended-state observer (OSFC)",
    "nominal": "inverse, nominal deadzone",
    "fitted": "inverse, one for all, tuned",
    "identified": "inverse, each vehicle's own deadzone",
    "too_large": "inverse, thresholds assumed 1.5 times",
    "too_small": "inverse, thresholds assumed 0.5 times",
    "adaptive": "adaptive inverse, starts nominal",
}
WRONG = {"too_large": 1.5, "too_small": 0.5}  # times each vehicle's own thresholds
PERIOD = 0.01  # s, of the computer that an adaptive inverse needs if the law is in continuous time
FIXED = ("compensation.slope", "compensation.threshold")  # tuned, they would correct a wrong assumption
QUIET = 2.0  # dead-band of an adaptive inverse, in standard deviations of the velocity's noise


class Known(NamedTuple):
    """A number of the law that is a vehicle's own, or the nominal vehicle's."""

    leaf: str  # of the scenario; "" for the nominal vehicle's
    value: float  # the nominal one
    factor: float = 1.0  # times either


class Remedy(NamedTuple):
    """A law with a remedy, and what of it is tuned."""

    law: agvjax.Law
    gains: tuple[str, ...]
    known: Mapping[str, Known] = {}  # by leaf of the law


class Remedies(NamedTuple):
    """Those that there are, and why there are no others."""

    found: dict[str, Remedy]
    left_out: dict[str, str]
    mattering_b1: float | None  # where the network's gain exceeds k2


def core(config: Config) -> agvjax.Law:
    """The law without its computer."""
    return config.controller.inner if isinstance(config.controller, agvjax.Sampled) else config.controller


def deadzones(config: Config) -> dict[str, agvjax.Deadzone]:
    """By actuator the deadzones of eq. (11) that the vehicle has."""
    return {name: zone for name, zone in config.scenario.deadzone.items() if isinstance(zone, agvjax.Deadzone)}


def without(law: agvjax.Law) -> agvjax.Law:
    """The law without a network against the deadzone."""
    if type(law) is not agvjax.NeuroBackstepping:
        return law
    return agvjax.Backstepping(**{f.name: getattr(law, f.name) for f in dataclasses.fields(agvjax.Backstepping)})


def remedies(config: Config, noise: float) -> Remedies:
    """All remedies, `noise` [m/s] being the standard deviation of the velocity's noise that is to be borne."""
    mine, plain, left = core(config), without(core(config)), {}
    found = {"nothing": _plain(config, plain)}
    b1 = None
    if isinstance(mine, agvjax.NeuroBackstepping):
        b1 = mattering_b1(config, mine)
        found |= _networks(config, mine, b1)
        if b1 is None:
            left["network_strong"] = f"at no b1 from {B1[-1]:g} to {B1[0]:g} does the network's gain exceed k2"
        if set(deadzones(config)) == {"position", "heading"}:
            found["known_slopes"] = _slopes(config, plain)
        else:
            left["known_slopes"] = "the law divides by slopes of its own channels, and these are not the actuators"
        found["observer"] = _plain(config, agvjax.OSFC())
    else:
        why = f"{type(mine).__name__} has none; it is a part of the paper's law"
        left |= dict.fromkeys(("network", "network_strong", "network_tuned", "known_slopes"), why)
        left["observer"] = f"there is none that {type(mine).__name__} could be put upon"
    found |= _inverses(config, plain)
    found["adaptive"] = _adaptive(config, plain, noise)
    for name, remedy in list(found.items()):
        if wrong := [] if name == "nothing" else remedy.law.faults(config.scenario.plant):
            left[name] = "; ".join(str(fault) for fault in wrong)
            del found[name]
    return Remedies(found, left, b1)


def mattering_b1(config: Config, law: agvjax.NeuroBackstepping) -> float | None:
    """The largest of `B1` at which the network adds more than k2 to the gain of (41), somewhere on the nominal run."""
    run = jax.jit(functools.partial(agvjax.simulate, **config.timing()))
    for b1 in sorted(B1, reverse=True):
        inner = agvjax.replace(law, {"b1": b1, "b2": b1})
        trajectory = jax.tree.map(np.asarray, run(agvjax.check(_around(config, inner)), agvjax.check(config.scenario)))
        measured = agvjax.Measurement(
            position=trajectory.position,
            velocity=trajectory.velocity,
            heading=trajectory.heading,
            yaw_rate=np.zeros_like(trajectory.heading),  # no network looks at it
        )
        if network_gains(trajectory, measured, inner)[0] > float(law.k2):
            return b1
    return None


def _around(config: Config, law: agvjax.Law) -> agvjax.Law:
    """In the configured computer, if there is one."""
    given = config.controller
    return dataclasses.replace(given, inner=law) if isinstance(given, agvjax.Sampled) else law


def _plain(config: Config, law: agvjax.Law, more: tuple[str, ...] = (), known: Mapping[str, Known] = {}) -> Remedy:
    made = _around(config, law)
    prefix = "inner." if made is not law else ""
    names = (*_own(config, made), *(prefix + name for name in more))
    return Remedy(made, spread(made, names), {prefix + leaf: value for leaf, value in known.items()})


def _own(config: Config, law: agvjax.Law) -> tuple[str, ...]:
    return tuple(law.gains_to_tune(config.scenario.plant.commands_heading))


def _networks(config: Config, law: agvjax.NeuroBackstepping, b1: float | None) -> dict[str, Remedy]:
    found = {"network": _plain(config, law)}
    strong = law if b1 is None else agvjax.replace(law, {"b1": b1, "b2": b1})
    if b1 is not None:
        found["network_strong"] = _plain(config, strong)
    more = ("b1", "b2") if config.scenario.plant.commands_heading else ("b1",)
    return found | {"network_tuned": _plain(config, strong, more)}


def _slopes(config: Config, law: Any) -> Remedy:
    """Each vehicle's own slopes (readings R2, R3)."""
    zones, known = deadzones(config), {}
    for belief, channel in (("Pi_hat", "position"), ("Pi_psi_hat", "heading")):
        zone = zones[channel]
        for side, slope in (("right", zone.slope_right), ("left", zone.slope_left)):
            known[f"{belief}.{side}"] = Known(f"deadzone.{channel}.slope_{side}", float(slope))
    return _plain(config, true_slopes(law, config.scenario), known=known)


def _inverses(config: Config, law: agvjax.Law) -> dict[str, Remedy]:
    """One law; those that differ only in the assumed deadzone differ only in data, and share the compiled program."""
    zones, found = deadzones(config), {}
    made = _compensated(config, law, agvjax.Inverse(believed=zones))
    own = _own(config, made)
    gains = spread(made, [gain for gain in own if gain not in FIXED])
    found = {"nominal": Remedy(made, gains, truths(zones, nominal=True)), "fitted": Remedy(made, spread(made, own))}
    factors = {"identified": 1.0, **WRONG}
    return found | {name: Remedy(made, gains, truths(zones, factor)) for name, factor in factors.items()}


def truths(zones: Mapping[str, agvjax.Deadzone], factor: float = 1.0, nominal: bool = False) -> dict[str, Known]:
    """The deadzone that an inverse assumes: each vehicle's own or the nominal one, thresholds times `factor`."""
    known = {}
    for name, zone in zones.items():
        for part, value in agvjax.leaves(zone).items():
            times = factor if part.startswith("threshold") else 1.0
            leaf = "" if nominal else f"deadzone.{name}.{part}"
            known[f"compensation.believed.{name}.{part}"] = Known(leaf, float(value), times)
    return known


def _compensated(config: Config, law: agvjax.Law, compensation: Any) -> agvjax.Law:
    """The law with what a computer does about deadzones; in continuous time where the configured one is."""
    if isinstance(config.controller, agvjax.Sampled):
        return dataclasses.replace(config.controller, inner=law, compensation=compensation)
    return agvjax.Compensated(inner=law, vehicle=config.scenario.plant, compensation=compensation)


def _adaptive(config: Config, law: agvjax.Law, noise: float) -> Remedy:
    """Beliefs that begin nominal and learn; in a computer, whose delay is that of the nominal actuators."""
    given, zones, numbers = config.controller, deadzones(config), agvjax.leaves(config.scenario)
    sampled = isinstance(given, agvjax.Sampled)
    period = float(given.period) if sampled else period_of(config)
    late = max((float(np.max(x)) for n, x in numbers.items() if n.endswith(".delay.time")), default=0.0)
    compensation = agvjax.AdaptiveInverse(
        believed=zones,
        usual=usual_inputs(config, law),
        dead_band=max(QUIET * noise, float(agvjax.AdaptiveInverse().dead_band)),
        delay=late,
        slots=max(int(np.ceil(late / period - 1e-9)) + 2, 2),
    )
    computer = given if sampled else agvjax.Sampled(inner=law, vehicle=config.scenario.plant, period=period)
    made = dataclasses.replace(computer, inner=law, compensation=compensation)
    return Remedy(made, spread(made, _own(config, made)))


def period_of(config: Config) -> float:
    """Period [s] of the computer that a law in continuous time is put into: near `PERIOD`, whole steps of tuning."""
    return max(1, round(PERIOD / config.tune.dt)) * config.tune.dt


def usual_inputs(config: Config, law: agvjax.Law) -> np.ndarray:
    """Of each actuator the RMS of what it delivers on the nominal run; at least twice its threshold."""
    scenario, made = agvjax.check(config.scenario), agvjax.check(_around(config, law))
    run: Callable[..., agvjax.Trajectory] = jax.jit(functools.partial(agvjax.simulate, **config.timing("tune")))
    driven = jax.tree.map(np.asarray, run(made, scenario))
    zones, usual = deadzones(config), []
    for i, name in enumerate(config.scenario.plant.actuators):
        zone = zones.get(name, agvjax.Deadzone())
        least = 2 * max(float(jnp.max(jnp.asarray(x))) for x in (zone.threshold_right, zone.threshold_left))
        usual.append(max(_delivered_rms(config, driven, i), least))
    return np.array(usual)


def _delivered_rms(config: Config, run: agvjax.Trajectory, place: int) -> float:
    """RMS of what one actuator delivers; 0 where that is not finite."""
    plant = config.scenario.plant
    columns = [len(plant.parts(name)) for name in plant.actuators]
    first = sum(columns[:place])
    values = np.asarray(run.delivered)[:, first : first + columns[place]]
    return float(np.sqrt(np.mean(values**2))) if np.all(np.isfinite(values)) else 0.0
