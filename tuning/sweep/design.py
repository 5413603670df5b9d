"""Which scenarios a sweep looks at: a grid of axes, with samples at every node of it, numbered from 0.

A scenario depends on the design and on its number alone, so that any process can make any of them.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import ArrayLike

import agvjax
from agvjax.leaves import get, unit_of
from agvjax.protocols import Law
from agvjax.scenario import unit_in

from ..config.ends import LAW, element_of
from ..config.settings import Config
from ..ensemble.draws import Draw, places, together, uniform

PART = "sweep"  # of the random numbers: other scenarios than those that were tuned and validated on
LEVELS = 4  # of the grid that Morris' trajectories walk on
SENSITIVITY = ("saltelli", "morris")
Leaves = Mapping[str, ArrayLike]  # of scenarios and controllers, by name, each (n, ...)


class Target(NamedTuple):
    """A leaf, or one element of it, and what an axis makes of it."""

    leaf: str
    element: int | None
    draw: Draw

    @property
    def name(self) -> str:
        """As it is written in TOML: `start.position[0]`."""
        return self.leaf if self.element is None else f"{self.leaf}[{self.element}]"


class Axis(NamedTuple):
    """What moves together, along one number from 0 to 1."""

    targets: tuple[Target, ...]
    points: int  # of a grid; 0: sampled

    @property
    def name(self) -> str:
        """The names of its targets, joined by +."""
        return "+".join(target.name for target in self.targets)

    @property
    def places(self) -> np.ndarray:
        """Where the points of a grid lie, (P,); of a distribution all but its tails."""
        return places([target.draw for target in self.targets], self.points)


def targets_of(axes: Iterable[Axis]) -> list[tuple[Axis, Target]]:
    """The targets of all axes, each with its axis."""
    return [(axis, target) for axis in axes for target in axis.targets]


class Design(NamedTuple):
    """All scenarios of a sweep: number = node of the grid (the last axis fastest) * samples + sample."""

    controller: Law
    scenario: agvjax.Scenario
    grid: tuple[Axis, ...]
    sampled: tuple[Axis, ...]
    method: str = "random"
    base: int = 1  # samples asked for; methods of sensitivity take several for each
    seed: int = 0

    @property
    def shape(self) -> tuple[int, ...]:
        """Points of every axis of the grid."""
        return tuple(axis.points for axis in self.grid)

    @property
    def samples(self) -> int:
        """Scenarios at every node."""
        if not self.sampled:
            return 1
        more = {"saltelli": len(self.sampled) + 2, "morris": len(self.sampled) + 1}
        return self.base * more.get(self.method, 1)

    @property
    def size(self) -> int:
        """Scenarios of the sweep."""
        return int(np.prod(self.shape, dtype=int)) * self.samples

    def whole(self, values: np.ndarray) -> np.ndarray:
        """Values (..., N) of all scenarios by place in the grid and sample: (..., *shape, samples)."""
        return values.reshape(*values.shape[:-1], *self.shape, self.samples)

    @property
    def names(self) -> tuple[str, ...]:
        """The leaves that vary; a controller's begin with `controller.`."""
        return tuple(dict.fromkeys(target.leaf for _, target in targets_of((*self.grid, *self.sampled))))

    def nominal(self, leaf: str) -> np.ndarray:
        """The nominal value of a leaf."""
        return np.asarray(get(*self._home(leaf)), float)

    @property
    def leaf_shapes(self) -> dict[str, tuple[int, ...]]:
        """The shape of one value of every leaf that varies."""
        return {name: self.nominal(name).shape for name in self.names}

    def nominal_of(self, target: Target) -> np.ndarray:
        """The nominal value of a target."""
        nominal = self.nominal(target.leaf)
        return nominal if target.element is None else nominal[target.element]

    def unit(self, leaf: str) -> str:
        """The unit of a leaf."""
        home, name = self._home(leaf)
        return unit_in(home, name) if isinstance(home, agvjax.Scenario) else unit_of(home, name)

    def _home(self, leaf: str) -> tuple[Law | agvjax.Scenario, str]:
        return (self.controller, leaf.removeprefix(LAW)) if leaf.startswith(LAW) else (self.scenario, leaf)

    def value(self, target: Target, share: float | np.ndarray) -> np.ndarray:
        """What a target is at shares (n,) of its axis: (n,), or (n, ...) where it is a whole array."""
        return target.draw.along(np.atleast_1d(share), self.nominal_of(target))

    def shares(self, first: int, count: int) -> np.ndarray:
        """Where scenarios lie along every axis, (count, grid axes + sampled axes)."""
        number = np.arange(first, first + count)
        node, sample = number // self.samples, number % self.samples
        places = np.unravel_index(node, self.shape) if self.grid else ()
        columns = [axis.places[place] for axis, place in zip(self.grid, places, strict=True)]
        if self.sampled and sample[0] + count <= self.samples:  # all at one node: no more than these
            columns += list(_points(self.method, self.sampled, self.base, self.seed, int(sample[0]), count).T)
        elif self.sampled:
            every = _points(self.method, self.sampled, self.base, self.seed, 0, self.samples)
            columns += list(every[sample].T)
        return np.stack(columns, axis=1)

    def values(self, first: int, count: int) -> dict[str, np.ndarray]:
        """Leaves of the scenarios from number `first`, each (count, ...)."""
        return self.leaves(self.shares(first, count))

    def leaves(self, shares: np.ndarray) -> dict[str, np.ndarray]:
        """Leaves of scenarios that lie at shares (n, grid axes + sampled axes), each (n, ...)."""
        nominal = {leaf: self.nominal(leaf) for leaf in self.names}
        values = {leaf: np.tile(x, (len(shares), *[1] * x.ndim)) for leaf, x in nominal.items()}
        for axis, share in zip((*self.grid, *self.sampled), self._tied(shares.T), strict=True):
            for target in axis.targets:
                if self.method in SENSITIVITY and target.draw.tailed:
                    tail = target.draw.ends[0]
                    share = tail + (1 - 2 * tail) * share  # their points lie on the ends too
                place = (slice(None),) if target.element is None else (slice(None), target.element)
                values[target.leaf][place] = self.value(target, share)
        return values

    def _tied(self, shares: np.ndarray) -> np.ndarray:
        """Shares (axes, n) of sampled leaves that are drawn together, by the correlations of those among them."""
        tied, places, partners = shares.copy(), {}, {}
        for place, axis in enumerate(self.sampled, len(self.grid)):
            row = axis.targets[0].draw.partners(axis.name)
            if len(row) > 1:
                places[axis.name], partners[axis.name] = place, row
        for name, leaves in partners.items():
            there = [leaf for leaf in leaves if leaf in partners]
            rows = np.array([list(partners[leaf].values()) for leaf in there])
            factor = np.linalg.cholesky(rows @ rows.T)
            tied[places[name]] = together(shares[[places[leaf] for leaf in there]], factor[there.index(name)].tolist())
        return tied

    @staticmethod
    def split(values: Leaves) -> tuple[dict[str, ArrayLike], dict[str, ArrayLike]]:
        """Leaves of the controller, by their names in it, and of the scenario."""
        law = {leaf.removeprefix(LAW): x for leaf, x in values.items() if leaf.startswith(LAW)}
        return law, {leaf: x for leaf, x in values.items() if not leaf.startswith(LAW)}


def design(config: Config) -> Design:
    """The design that a configuration asks for, found sound before."""
    settings = config.sweep
    axes = []
    for table in settings.over:
        targets = tuple(Target(*element_of(name), span.draw) for name, span in table.items())
        axes.append(Axis(targets, max(span.points for span in table.values())))
    taken = {target.leaf for _, target in targets_of(axes)}
    if settings.ensemble:
        for name in sorted(set(config.ensemble.draws) - taken):
            shape = np.shape(get(config.scenario, name))
            elements = range(shape[0]) if shape else (None,)
            draw = config.ensemble.draws[name]
            axes += [Axis((Target(name, i, draw if i is None else draw.of(i)),), 0) for i in elements]
    grid, sampled = (tuple(a for a in axes if bool(a.points) is whole) for whole in (True, False))
    return Design(config.controller, config.scenario, grid, sampled, settings.design, settings.samples, config.seed)


def _points(method: str, axes: tuple[Axis, ...], base: int, seed: int, first: int, count: int) -> np.ndarray:
    """Points from number `first` of the unit cube of some axes, (count, axes)."""
    if method == "random":
        return np.concatenate([uniform(seed, f"{a.name}#{PART}", count, 1, first) for a in axes], axis=1)
    if method == "sobol":  # shifted as a whole, at random, which keeps what Sobol points have in common
        from scipy.stats import qmc  # late: a second that few runs need

        sequence = qmc.Sobol(len(axes), scramble=False)
        whole = count if first else 1 << (count - 1).bit_length()  # the first power of two: else SciPy warns
        points = (sequence.fast_forward(first) if first else sequence).random(whole)[:count]
        return (points + uniform(seed, f"shift#{PART}", 1, len(axes))) % 1
    return _table(method, len(axes), base, seed)[first : first + count]


@functools.lru_cache(2)
def _table(method: str, width: int, base: int, seed: int) -> np.ndarray:
    """A design that is made as a whole; by SALib for Sobol indices (Saltelli's scheme) or for Morris' screening."""
    if method == "latin":
        from scipy.stats import qmc

        random: Any = {"seed": np.random.default_rng(seed)}  # `rng` since SciPy 1.15, which takes either
        return qmc.LatinHypercube(width, **random).random(base)
    from SALib.sample import morris, sobol  # an extra, and slow to import

    problem = unit_problem([f"x{i}" for i in range(width)])
    if method == "saltelli":
        return sobol.sample(problem, base, calc_second_order=False, seed=seed)
    return morris.sample(problem, base, num_levels=LEVELS, seed=seed)


def unit_problem(names: list[str]) -> dict[str, object]:
    """SALib's description of a unit cube."""
    return {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}


def scene(design: Design, number: int) -> tuple[dict[str, ArrayLike], agvjax.Scenario]:
    """Gains and scenario of one number, to be looked at again."""
    law, scenario = design.split({name: value[0] for name, value in design.values(number, 1).items()})
    return law, agvjax.replace(design.scenario, scenario)
