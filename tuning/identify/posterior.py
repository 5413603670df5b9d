"""What the log says, as the problem to tune for: the scenario it names, and an ensemble that is its uncertainty."""

from __future__ import annotations

import dataclasses

import numpy as np

import agvjax
from agvjax.leaves import leaves

from ..config.settings import Config
from ..ensemble.draws import Between, Correlation, Distribution, Draw, correlated, default_draws
from .fit import Fit
from .parameters import MOUNTING, SINUSOID, parts_of, sinusoidal
from .verdict import Estimate, FitVerdict

TAIL = 4.0  # standard deviations from its bound within which a parameter's distribution is cut off there
SHRUNK = 1e-3  # by which correlations are drawn towards 0, so that their matrix has a factor
SCENARIO, ESTIMATES = "scenario.toml", "estimates.json"  # of a run of `agvjax identify`: this problem, and why
CHANNELS = {"position": ("x", "y"), "velocity": ("vx", "vy"), "heading": ("heading",), "yaw_rate": ("yaw_rate",)}


def posterior(config: Config, fit: Fit, verdict: FitVerdict) -> Config:
    """The configuration with what was identified in place of what was assumed, and as its ensemble how surely.

    What the log did not tell stays as it was assumed, with the draws that it had; a number of a deadzone that had none
    is drawn within a half of it. The phase of a sinusoid is drawn: nobody knows when in it the next drive begins.
    """
    known = {e.name: e for e in verdict.estimates if e.identified}
    absent = {e.name for e in verdict.estimates if e.absent}  # what was looked for and is not there is 0
    fixed = {q.name: float(x) for q, x in zip(fit.parameters, fit.p, strict=True) if q.name in absent}
    fixed |= {name: e.value for name, e in known.items()}
    scenario = agvjax.replace(_structure(config, fit, known, absent), fixed)
    kept = set(leaves(scenario)) - set(known)
    draws: dict[str, Draw] = {name: draw for name, draw in config.ensemble.draws.items() if name in kept}
    assumed = default_draws(scenario.plant.actuators, scenario.start, scenario.path)
    unknown = [e.name for e in verdict.estimates if not e.identified]
    draws |= {name: assumed[name] for name in unknown if name in assumed and name not in draws}
    low = {q.name: q.low for q in fit.parameters}
    draws |= {name: distribution(e, low[name]) for name, e in known.items()}
    if any(sinusoidal(name) and name.endswith(SINUSOID) for name in known):
        draws["disturbance.phase"] = Between(0.0, float(2 * np.pi))
    correlation = _correlation(verdict)
    draws = draws if correlation is None else correlated(draws, correlation)
    ensemble = dataclasses.replace(config.ensemble, draws=draws, correlation=correlation)
    controller = config.controller.believing(scenario.plant, scenario.deadzone)
    return dataclasses.replace(config, scenario=scenario, ensemble=ensemble, controller=controller)


def distribution(estimate: Estimate, low: float) -> Distribution:
    """Normal, cut off at the parameter's bound where that is near."""
    e = estimate
    if e.value - TAIL * e.deviation > low:
        return Distribution("norm", {"loc": e.value, "scale": e.deviation})
    a = (low - e.value) / e.deviation
    return Distribution("truncnorm", {"a": a, "b": max(TAIL, a + TAIL), "loc": e.value, "scale": e.deviation})


def _structure(config: Config, fit: Fit, known: dict[str, Estimate], absent: set[str]) -> agvjax.Scenario:
    """The fitted scenario with the path, start and sensor of the configured one, and delay lines as long as needed."""
    fitted, before = fit.model.scenario, config.scenario
    steps = min(config.simulate.dt, config.tune.dt)  # a law without a period asks anew at every one
    of_law = config.controller.control_period()
    period = min(steps if of_law is None else float(of_law), float(fit.segments.h.mean()))
    chains = {}
    for name, chain in fitted.actuators.items():
        kept, configured = {}, parts_of(before.actuators[name]) if name in before.actuators else {}
        for key, part in parts_of(chain).items():
            place = f"actuators.{name}.{key}."
            if key not in configured and not any(place in leaf for leaf in known):
                continue  # added to be looked for, and not found
            if isinstance(part, agvjax.Delay):
                e = known.get(f"{place}time")
                longest = (float(part.time) if e is None else e.value + TAIL * e.deviation) + float(part.jitter)
                part = dataclasses.replace(part, slots=2 + int(np.ceil(longest / period)))
            kept[key] = part
        if kept:
            chains[name] = agvjax.Chain(**kept)
    sought = any(name.startswith("disturbance.") for name in {*known, *absent})
    disturbance, sensor = (fitted if sought else before).disturbance, before.sensor
    sensor = fitted.sensor if any(name in MOUNTING for name in {*known, *absent}) else sensor
    if isinstance(sensor, agvjax.Noise):
        sigma = dict(zip(fit.model.channels, fit.sigma, strict=True))
        seen = {n: [sigma[c] for c in own if c in sigma] for n, own in CHANNELS.items()}
        sensor = dataclasses.replace(sensor, **{n: float(np.mean(x)) for n, x in seen.items() if x})
    return dataclasses.replace(before, actuators=chains, disturbance=disturbance, sensor=sensor)


def _correlation(verdict: FitVerdict) -> Correlation | None:
    places = [i for i, e in enumerate(verdict.estimates) if e.identified]
    if len(places) < 2:
        return None
    matrix = (1 - SHRUNK) * verdict.correlation[np.ix_(places, places)] + SHRUNK * np.eye(len(places))
    matrix = (matrix + matrix.T) / 2
    return Correlation(tuple(verdict.estimates[i].name for i in places), tuple(map(tuple, matrix.round(6).tolist())))
