"""All that is said of a finished sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from ..settings import Config
from . import findings, radius
from .design import SENSITIVITY
from .findings import Failures, Index
from .radius import Radius
from .results import Results
from .work import Judge


class Verdict(NamedTuple):
    """Besides the results themselves."""

    nominal: list[dict[str, float]]  # metrics of the nominal run, of every controller
    bounds: dict[str, float]  # beyond which a run has failed
    which: np.ndarray  # (C, N), which have
    failures: list[Failures]
    indices: dict[str, dict[str, list[Index]]]  # by controller and metric
    radii: list[Radius]  # empty where they are not asked for


def judge(config: Config, found: Results, laws: Mapping[str, Any], judges: Sequence[Judge]) -> Verdict:
    """The verdict on a sweep.

    Args:
        config: whose `sweep.fails` and `sweep.radius` count, whatever they were when the shards were made.
        found: the sweep.
        laws: its controllers.
        judges: what judged them.
    """
    nominal = _nominal(found, judges)
    bounds = findings.absolute(config.sweep.fails, nominal[0])
    which = findings.failed(found, bounds)
    return Verdict(
        nominal=nominal,
        bounds=bounds,
        which=which,
        failures=findings.failures(found, which),
        indices=_indices(found),
        radii=_radii(config, found, which, bounds, laws),
    )


def _nominal(found: Results, judges: Sequence[Judge]) -> list[dict[str, float]]:
    """Metrics of the nominal run, of every controller, by what judged the others."""
    size = min(found.manifest.shard, found.manifest.size)
    values = {name: np.stack([found.design.nominal(name)] * size) for name in found.leaves}
    values = {name: value.astype(jax.numpy.result_type(float)) for name, value in values.items()}
    return [{name: float(np.asarray(x)[0]) for name, x in judge(values).items()} for judge in judges]


def _indices(found: Results) -> dict[str, dict[str, list[Index]]]:
    """Sensitivities of every metric, where the design is one for them."""
    if found.design.method not in SENSITIVITY or not found.design.sampled:
        return {}
    return {
        name: {metric: findings.sensitivity(found, values[i]) for metric, values in found.metrics.items()}
        for i, name in enumerate(found.names)
    }


def _radii(
    config: Config, found: Results, which: np.ndarray, bounds: Mapping[str, float], laws: Mapping[str, Any]
) -> list[Radius]:
    """The largest boxes, where they are asked for and something can move."""
    if not (config.sweep.radius and bounds and radius.Reach.of(found.design).axes):
        return []
    seeker = radius.adversary(config, found.design, bounds)
    return [radius.radius(found, which[i], law, seeker) for i, law in enumerate(laws.values())]
