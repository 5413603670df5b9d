"""What is wrong with a vehicle at the ends of what is drawn and swept: what would be refused if it stood there."""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import ArrayLike

import agvjax
from agvjax import Fault
from agvjax.timing import whole

from ..ensemble.draws import Draw, Span, places
from . import rules
from .settings import Config

LAW = "controller."  # what the names of gains begin with
MOST_TOGETHER = 8  # axes whose ends are looked at in every combination; of more, one by one from either side
Corner = Mapping[str, np.ndarray]  # values of leaves, or of elements of them, by name


def element_of(name: str) -> tuple[str, int | None]:
    """`start.position[0]` -> its leaf and which element of it; the leaf without `scenario.`."""
    match = re.fullmatch(r"(.+)\[(\d+)\]", name)
    leaf, element = (match[1], int(match[2])) if match else (name, None)
    return leaf.removeprefix("scenario."), element


DRAWS = "ensemble.draws"


class Moving(NamedTuple):
    """Leaves that move as one, along one number from 0 to 1."""

    key: str  # of the settings that say so
    spans: Mapping[str, Span]

    @classmethod
    def drawn(cls, draws: Mapping[str, Draw]) -> list[Moving]:
        """Those of an ensemble, each alone."""
        return [cls(DRAWS, {name: Span(draw)}) for name, draw in draws.items()]

    def values(self, config: Config) -> dict[str, np.ndarray]:
        """Where each leaf stands: at all points of a grid, else at some that stand for all; (n, ...)."""
        shares = places([s.draw for s in self.spans.values()], max(s.points for s in self.spans.values()))
        return {name: span.draw.along(shares, _nominal(config, name)) for name, span in self.spans.items()}

    def ends(self, config: Config) -> list[Corner]:
        """The first and the last of these."""
        values = self.values(config)
        return [{name: x[i] for name, x in values.items()} for i in (0, -1)]


def faults(config: Config, moving: Sequence[Moving], sections: Sequence[str]) -> list[Fault]:
    """What breaks a rule at an end of what moves, or at a corner of what belongs together.

    Args:
        config: found sound at its nominal values.
        moving: what moves.
        sections: whose steps are used: simulate, tune, sweep.
    """
    wrong, clocks = [], []
    for axis in moving:
        if any(name.startswith(LAW) for name in axis.spans):
            values = axis.values(config)
            periods = _periods(config, values)
            wrong += [f for s in sections for f in _uneven(config, axis, values, periods, s)]
            clocks += [{name: x[int(np.argmin(periods))] for name, x in values.items()}] if periods.size else []
    if wrong:
        return wrong
    fastest = {name: x for clock in clocks for name, x in clock.items()}
    keys = {name: axis.key for axis in moving for name in axis.spans}
    for group in _groups(moving):
        lawful = any(name.startswith(LAW) for axis in group for name in axis.spans)
        for corner in _corners([axis.ends(config) for axis in group]):
            wrong += _at(config, corner if lawful else {**fastest, **corner}, keys, sections)
    return list({_what(fault): fault for fault in wrong}.values())


def elsewhere(config: Config, moving: Sequence[Moving]) -> list[str]:
    """Of every leaf that is drawn somewhere else than where it is configured, as one that a preset draws."""
    said = []
    for axis in (axis for axis in moving if axis.key == DRAWS):
        for name, values in axis.values(config).items():
            nominal, low, high = _nominal(config, name), values.min(axis=0), values.max(axis=0)
            room = 1e-6 * np.abs(nominal)
            if np.any((nominal < low - room) | (nominal > high + room)):
                where, ends = (np.array2string(np.asarray(x), precision=4) for x in (nominal, np.array([low, high])))
                rule = f"not between the ends that it is drawn from, {ends} ({DRAWS})"
                said.append(f"{name} = {where} is {rule}: no vehicle that is tuned for is like the configured one")
    return said


def placed(config: Config, corner: Corner) -> Config:
    """The configuration with these leaves of its law and its scenario, or elements of them."""
    trees = {True: config.controller, False: config.scenario}
    for name, value in corner.items():
        (leaf, element), lawful = element_of(name), name.startswith(LAW)
        leaf = leaf.removeprefix(LAW)
        if element is not None:
            whole = np.array(agvjax.leaves(trees[lawful])[leaf], float)
            whole[element] = value
            value = whole
        trees[lawful] = agvjax.replace(trees[lawful], {leaf: value})
    return dataclasses.replace(config, controller=trees[True], scenario=trees[False])


def _nominal(config: Config, name: str) -> np.ndarray:
    leaf, element = element_of(name)
    tree = config.controller if leaf.startswith(LAW) else config.scenario
    nominal = np.asarray(agvjax.leaves(tree)[leaf.removeprefix(LAW)], float)
    return nominal if element is None else nominal[element]


def _periods(config: Config, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """The law's periods [s] at all values of what moves as one; empty where it does not move them."""
    gains: dict[str, ArrayLike] = {name.removeprefix(LAW): x for name, x in values.items() if name.startswith(LAW)}
    singles = {name: x for name, x in gains.items() if np.ndim(x) == 1 and element_of(name)[1] is None}  # not arrays
    period = agvjax.replace(config.controller, singles).control_period()
    return np.asarray([] if period is None or not np.ndim(period) else period, float)


def _uneven(
    config: Config, axis: Moving, values: Mapping[str, np.ndarray], periods: np.ndarray, section: str
) -> list[Fault]:
    """The first period that is no whole number of steps."""
    dt = getattr(config, section).dt
    bad = np.flatnonzero(~whole(periods / dt))
    if not bad.size:
        return []
    name = next(name for name in values if name.startswith(LAW))
    return [Fault(f"{axis.key}.{name}", f"{values[name][bad[0]]:g}", f"a whole multiple of {section}.dt = {dt:g} s")]


def _groups(moving: Sequence[Moving]) -> list[list[Moving]]:
    """What moves a number of the same object belongs together; a law is one object."""
    groups: list[tuple[set[str], list[Moving]]] = []
    for axis in moving:
        holders = {LAW if name.startswith(LAW) else element_of(name)[0].rpartition(".")[0] for name in axis.spans}
        touched = [group for group in groups if group[0] & holders]
        groups = [group for group in groups if not group[0] & holders]
        groups.append((holders.union(*(g[0] for g in touched)), [*(a for g in touched for a in g[1]), axis]))
    return [group for _, group in groups]


def _corners(ends: Sequence[Sequence[Corner]]) -> Iterable[Corner]:
    """Every combination of the ends of some axes, the last ends last; of many axes only one that differs."""
    which = itertools.product((0, 1), repeat=len(ends))
    if len(ends) > MOST_TOGETHER:
        unit = np.eye(len(ends), dtype=int)
        which = [*unit.tolist(), [0] * len(ends), *(1 - unit).tolist(), [1] * len(ends)]
    for sides in which:
        yield {name: x for end, side in zip(ends, sides, strict=True) for name, x in end[side].items()}


def _what(fault: Fault) -> tuple[str, ...]:
    """What a fault is about, of which the last corner, with the longest delays, asks for most."""
    rule, _, elsewhere = fault.rule.partition(rules.WHERE)
    return (fault.key,) if elsewhere and not fault.key.endswith(".dt") else (fault.key, str(fault.value), rule)


def _at(config: Config, corner: Corner, keys: Mapping[str, str], sections: Sequence[str]) -> list[Fault]:
    """What is wrong at one corner: of a leaf that moves in the words of its own key, of another one with the corner."""
    there = placed(config, corner)
    wrong = rules.vehicle_faults(there) or [f for s in sections for f in rules.step_faults(there, s)]
    own = {f"{'' if name.startswith(LAW) else 'scenario.'}{element_of(name)[0]}": name for name in corner}
    place = ", ".join(f"{name} = {np.asarray(x).tolist()}" for name, x in corner.items())
    return [
        fault._replace(key=f"{keys[own[fault.key]]}.{own[fault.key]}")
        if fault.key in own
        else fault._replace(rule=f"{fault.rule}{rules.WHERE}{place}, {keys[next(iter(corner))]})")
        for fault in wrong
    ]
