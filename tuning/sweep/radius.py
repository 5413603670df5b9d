"""How far the vehicle may drift: the largest box around nominal in which no failure is found.

The box grows with one number r: along every axis from nominal by the share r of the way to either end of it. For an r
the worst scenario in the box is looked for by gradient ascent from several starts; bisection over r; samples check.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

import agvjax

from ..config.ends import LAW
from ..config.settings import Config
from ..ensemble.draws import Between
from ..ensemble.worst import Adversary
from .design import Axis, Design, Target, targets_of
from .results import Results

CLOSE, LEAST = 0.01, 1e-3  # between the box that stands and the failure next to it: a share of it, at least so much
BLOCK = 64  # scenarios rolled out together, each with its tangents


class Radius(NamedTuple):
    """How far one controller keeps all bounds, and the nearest failure that was met."""

    radius: float  # nothing was found to fail within; 1: in the whole of every axis; 0: the nominal run fails
    failure: float | None  # how far out the nearest failure lies that was found
    scenario: dict[str, Any]  # that failure's leaves
    searches: int
    samples: int  # that fell into the box
    ends: dict[str, tuple[float, float]]  # of the box, by target


class Reach(NamedTuple):
    """The axes that can be moved, and where their ends lie."""

    plan: Design
    axes: tuple[Axis, ...]  # those of the scenario with a range
    fixed: tuple[str, ...]  # names of the others

    @classmethod
    def of(cls, plan: Design) -> Reach:
        """Of a design; choices and gains stay where they are."""
        every = (*plan.grid, *plan.sampled)
        moves = [a for a in every if all(t.draw.moves and not t.leaf.startswith(LAW) for t in a.targets)]
        return cls(plan, tuple(moves), tuple(a.name for a in every if a not in moves))

    def ends(self, target: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Lower end, nominal, upper end of a target."""
        nominal = self.plan.nominal_of(target)
        low, high = target.draw.box(nominal)
        return np.minimum(low, nominal), nominal, np.maximum(high, nominal)

    def leaves(self, moves: Any) -> dict[str, Any]:
        """Leaves of B scenarios moved from nominal by (B, axes), each from -1 to 1."""
        leaves: dict[str, Any] = {}
        for axis, target in targets_of(self.axes):
            low, nominal, high = (jnp.asarray(x, moves.dtype) for x in self.ends(target))
            move = moves[:, self.axes.index(axis)].reshape(-1, *[1] * nominal.ndim)
            value = nominal + jnp.maximum(move, 0) * (high - nominal) + jnp.minimum(move, 0) * (nominal - low)
            if target.element is not None:
                whole = jnp.asarray(self.plan.nominal(target.leaf), moves.dtype)
                whole = leaves.get(target.leaf, jnp.broadcast_to(whole, (len(moves), *whole.shape)))
                value = whole.at[:, target.element].set(value)
            leaves[target.leaf] = value
        return leaves

    def distance(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """How far out scenarios lie, (N,): the r of the smallest box that holds them."""
        far = [np.zeros(len(next(iter(values.values()))))]
        for _, target in targets_of(self.axes):
            low, nominal, high = self.ends(target)
            value = values[target.leaf] if target.element is None else values[target.leaf][:, target.element]
            room = np.where(value >= nominal, high - nominal, nominal - low)
            move = np.abs(value - nominal) / np.where(room > 0, room, 1.0)
            far.append(move.reshape(len(move), -1).max(axis=1))
        return np.max(far, axis=0)


def adversary(config: Config, plan: Design, bounds: Mapping[str, float]) -> Adversary:
    """Looks for the scenario nearest to failing, or beyond, in the box of z = (controller, r)."""
    reach = Reach.of(plan)
    labels = [f"axis{i}" for i in range(len(reach.axes))]

    def rollout(z: Any, moves: Any) -> tuple[Any, Any]:
        law, r = z
        leaves = reach.leaves(r * jnp.stack([moves[label] for label in labels], axis=1))
        metrics = agvjax.evaluate(
            law,
            agvjax.batch(plan.scenario, leaves),
            criteria=agvjax.Criteria.of(bounds, like=config.judged()),
            block=BLOCK,
            **config.timing("sweep"),
        )
        return jnp.stack([metrics[name] / bound for name, bound in bounds.items()]), metrics.ok

    return Adversary(
        rollout=rollout,
        names=tuple(bounds),
        scenario=dict.fromkeys(labels, 0.0),
        draws=dict.fromkeys(labels, Between(-1.0, 1.0)),
        metrics=tuple(bounds),
        settings=dataclasses.replace(config.tune.search, checks=0),
        seed=config.seed,
    )


# long: a bisection whose steps share all they know
def radius(results: Results, which: np.ndarray, law: Any, seeker: Adversary) -> Radius:
    """Bisection between the largest box that stands and the nearest failure known.

    Args:
        results: of the sweep, whose samples count.
        which: its failures with this controller, (N,).
        law: the controller.
        seeker: from `adversary`, for the bounds that `which` was found with.
    """
    reach, law = Reach.of(results.design), agvjax.check(law)
    distance = np.where(_with_nominal(results, reach), reach.distance(results.leaves), np.inf)
    near = np.where(which & (distance <= 1), distance, np.inf)  # a distribution draws beyond the ends too
    number = int(np.argmin(near))
    high, nearest = float(near[number]), {name: np.asarray(x[number]) for name, x in results.leaves.items()}
    rounds, searches, low, stood = 0, 0, 0.0, 0

    def seek(r: float) -> tuple[float, dict[str, Any]] | None:
        """The failure in the box of r that the search meets, if there is one, and how far out it lies."""
        nonlocal rounds, searches, stood
        worst = seeker.search((law, jnp.asarray(r, jnp.result_type(float))), rounds)
        rounds += 1
        searches += sum(scenario.searches for scenario in worst)
        failures = [scenario for scenario in worst if not scenario.value <= 1]
        if not failures:
            stood += 1
            return None
        moves = [np.array([failure.scenario[label] for label in seeker.scenario]) for failure in failures]
        move = min(moves, key=lambda move: np.abs(move).max())
        leaves = {name: np.asarray(x)[0] for name, x in reach.leaves(jnp.asarray(r * move)[None]).items()}
        return float(r * np.abs(move).max()), leaves

    if (at := seek(0.0)) is not None:
        high, nearest = at
    while low < 1 and high - low > max(CLOSE * min(high, 1.0), LEAST):
        middle = 1.0 if np.isinf(high) else (low + high) / 2
        if (at := seek(middle)) is None:
            low = middle
        elif at[0] < high:
            high, nearest = at
    inside = int((distance <= low).sum()) + stood * seeker.settings.scouts
    ends: dict[str, tuple[float, float]] = {}
    for _, target in targets_of(reach.axes):
        ends |= _spans(target, reach.ends(target), low)
    failure, nearest = (high, nearest) if np.isfinite(high) else (None, {})
    return Radius(low, failure, nearest, searches, inside, ends)


def _with_nominal(results: Results, reach: Reach) -> np.ndarray:
    """Scenarios of the sweep in which whatever cannot be moved is at its nominal value."""
    moved = {(target.leaf, target.element) for _, target in targets_of(reach.axes)}
    same = np.ones(results.design.size, bool)
    for leaf, value in results.leaves.items():
        near = np.isclose(value, results.design.nominal(leaf)).reshape(len(value), -1)
        free = [(leaf, None) in moved or (leaf, element) in moved for element in range(near.shape[1])]
        same &= (near | np.array(free)).all(axis=1)
    return same


def _spans(target: Target, ends: tuple[np.ndarray, ...], r: float) -> dict[str, tuple[float, float]]:
    """From where to where a target may go, by its name; by element where it is an array."""
    low, nominal, high = ends
    names = [f"{target.name}[{i}]" for i in range(nominal.size)] if nominal.ndim else [target.name]
    edges = np.ravel(nominal - r * (nominal - low)), np.ravel(nominal + r * (high - nominal))
    return dict(zip(names, zip(*(edge.tolist() for edge in edges), strict=True), strict=True))
