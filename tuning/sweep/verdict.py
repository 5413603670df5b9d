"""All that is said of a finished sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import numpy as np

from agvjax import Fault, InputError
from agvjax.protocols import Law

from ..config.settings import Config
from . import findings, radius
from .design import SENSITIVITY, Design
from .findings import Failures, Index
from .radius import Radius
from .results import Results
from .work import Judge


class SweepVerdict(NamedTuple):
    """What the results of a sweep show, of every controller."""

    nominal: list[dict[str, float]]  # metrics of the nominal run, of every controller
    bounds: dict[str, float]  # beyond which a run has failed
    which: np.ndarray  # (C, N), which have
    failures: list[Failures]
    indices: dict[str, dict[str, list[Index]]]  # by controller and metric
    radii: list[Radius]
    unmoved: str  # why there is no radius, or what stays at nominal in it


def judge(config: Config, results: Results, laws: Mapping[str, Law], judges: Sequence[Judge]) -> SweepVerdict:
    """The verdict on a sweep.

    Args:
        config: whose `sweep.fails` and `sweep.radius` count, whatever they were when the shards were made.
        results: of the sweep.
        laws: its controllers.
        judges: what judged them.
    """
    plan, size = results.design, results.manifest.block
    bounds = bounds_of(config, plan, judges[0], size)
    which = findings.failed(results, bounds)
    reach, radii = radius.Reach.of(plan), []
    if config.sweep.radius and bounds and reach.axes:
        seeker = radius.adversary(config, plan, bounds)
        radii = [radius.radius(results, failed, law, seeker) for failed, law in zip(which, laws.values(), strict=True)]
    return SweepVerdict(
        nominal=[_nominal(plan, judge, size) for judge in judges],
        bounds=bounds,
        which=which,
        failures=findings.failures(results, which),
        indices=_indices(results),
        radii=radii,
        unmoved=_unmoved(config, reach),
    )


def _unmoved(config: Config, reach: radius.Reach) -> str:
    if not config.sweep.radius:
        return "No largest box was looked for: sweep.radius is false."
    if not config.sweep.fails:
        return "No largest box was looked for: nothing counts as a failure, sweep.fails is empty."
    if not reach.axes:
        return "No largest box was looked for: only leaves of the scenario with a range can move."
    return f"Fixed at nominal in the box: {', '.join(reach.fixed)}." if reach.fixed else ""


def bounds_of(config: Config, plan: Design, judge: Judge, size: int) -> dict[str, float]:
    """Beyond which a run has failed, in the metrics' units.

    Raises:
        InputError: a bound is relative to a nominal run that has no value, or 0.
    """
    nominal = _nominal(plan, judge, size)
    left = (
        f" (with sweep.dt = {config.sweep.dt:g} it diverges, past scenario.limit = {float(config.scenario.limit):g}, or"
        f" never gets there; simulate.dt is {config.simulate.dt:g}, and a plant may need a step as short)"
    )
    why = {name: left if np.isinf(value) else "" for name, value in nominal.items()}
    bad = [
        Fault(f"sweep.fails.{name}", bound.value, f"absolute: the nominal run's {name} is {nominal[name]:g}{why[name]}")
        for name, bound in config.sweep.fails.items()
        if not bound.absolute and not 0 < nominal[name] < np.inf
    ]
    if bad:
        raise InputError(bad)
    return findings.absolute(config.sweep.fails, nominal)


def _nominal(plan: Design, judge: Judge, size: int) -> dict[str, float]:
    """Metrics of the nominal run, by what judges `size` of them at once."""
    dtype = jax.numpy.result_type(float)
    values = {name: np.stack([plan.nominal(name)] * size).astype(dtype) for name in plan.names}
    return {name: float(np.asarray(x)[0]) for name, x in judge(values).items()}


def _indices(results: Results) -> dict[str, dict[str, list[Index]]]:
    """Sensitivities of every metric, where the design is one for them."""
    if results.design.method not in SENSITIVITY or not results.design.sampled:
        return {}
    return {
        name: {metric: findings.sensitivity(results, values[i]) for metric, values in results.metrics.items()}
        for i, name in enumerate(results.names)
    }
