"""A configuration in the numbers of a certificate, which the checker reads without this package."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import agvjax
from agvjax.controllers.filters import LiteralFilter
from agvjax.leaves import get

from ...config.ends import element_of
from ...config.settings import Config
from ...ensemble.draws import Span
from . import checker

Numbers = dict[str, Any]  # a part of a certificate, as JSON has it
Ends = dict[str, tuple[float, float]]


def problem(config: Config) -> Numbers:
    """Law, path, disturbance and grid of a configuration of which `unproved` says nothing."""
    law, scenario, settings = config.controller, config.scenario, config.certify
    wave, step = agvjax.leaves(scenario.disturbance), float(settings.step)
    numbers = {
        "law": {agvjax.DFC: "dfc", agvjax.OSFC: "osfc"}.get(type(law), "neuro_backstepping"),
        "gains": {name: float(value) for name, value in agvjax.leaves(law).items() if not np.ndim(value)},
        "step": step,
        "cells": math.ceil(config.simulate.horizon / step - 1e-9),
        "late": float(config.criteria.late),
        "path": _path(scenario.path),
        "disturbance": {name: float(wave[name]) for name in ("omega", "phase")},
        "wrapped": True,
    }
    if isinstance(law, agvjax.NeuroBackstepping):
        numbers["networks"] = _networks(law)
        numbers["wrapped"] = law.wrapped
        gains = (*(law.tunable or ()), "Pi_hat", "Pi_psi_hat")
        numbers["gains"] = {name: float(get(law, name)) for name in gains}
        numbers["gains"]["literal"] = float(isinstance(law.filter, LiteralFilter))
    return numbers


def _path(path: agvjax.Path) -> Numbers:
    if isinstance(path, agvjax.Circle):
        return {"type": "circle", "radius": float(path.radius), "omega": float(path.omega)}
    return {"type": "dumbbell", "amplitude": float(get(path, "amplitude")), "omega": float(get(path, "omega"))}


def _networks(law: agvjax.NeuroBackstepping) -> Numbers:
    rows = {
        "position": (law.gamma1, law.b1, law.varphi_start, law.position_network),
        "heading": (law.gamma2, law.b2, law.varphi_psi_start, law.heading_network),
    }
    return {
        name: {
            "gamma": float(gamma),
            "b": float(b),
            "start": float(start),
            "centers": np.asarray(net.centers, float).tolist(),
            "width": float(net.width),
        }
        for name, (gamma, b, start, net) in rows.items()
    }


def nominal(config: Config) -> dict[str, float]:
    """The configured value of every unknown of a certificate."""
    values = {}
    for name in checker.LEAVES:
        leaf, element = element_of(name)
        value = np.asarray(get(config.scenario, leaf), float)
        values[name] = float(value if element is None else value[element])
    return values


def over(config: Config) -> dict[str, Span]:
    """The sides of the box by leaf: those asked for, else those of the ensemble."""
    asked = {name: span for table in config.certify.over for name, span in table.items()}
    return asked or {name: Span(draw) for name, draw in config.ensemble.draws.items()}


def box(config: Config, share: float = 1.0) -> Ends:
    """The box of a configuration, or the share of it around nominal: every side the share of the way to either end."""
    ends = {name: (value, value) for name, value in nominal(config).items()}
    for name, span in over(config).items():
        leaf, element = element_of(name)
        middle = np.asarray(get(config.scenario, leaf), float)
        middle = middle if element is None else middle[element]
        low, high = (np.ravel(x) for x in span.draw.box(middle))
        flat = np.ravel(middle)
        for i in range(flat.size):
            own = f"{leaf}[{i}]" if element is None and np.ndim(middle) else name
            below, above = min(low[i], flat[i]), max(high[i], flat[i])
            ends[own] = float(flat[i] - share * (flat[i] - below)), float(flat[i] + share * (above - flat[i]))
    return ends
