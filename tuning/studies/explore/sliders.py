"""What can be moved on the page, from where to where; and what cannot, and why."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

import agvjax
from agvjax import Delay
from agvjax.leaves import get, unit_of
from agvjax.scenario import unit_in

from ...config.ends import LAW, element_of
from ...config.ends import placed as put
from ...config.settings import Config
from ...tune.gains import Gains, sets_period, value_of

DECADE = 10.0  # either side, where nothing says how far
INSIDE = 1e-3  # of itself, that a gain stays away from a bound, which it must not reach
TIMES = 2.5  # the configured value: the end of what begins at 0, unless more is drawn


class Slider(NamedTuple):
    """One number that is moved, and every leaf that moves with it.

    Attributes:
        names: leaves, or elements of them, as `[ensemble.draws]` calls them; those of the law begin with `controller.`.
        label: what stands on the page.
        unit: of the value.
        value: as configured.
        low: its lower end.
        high: its upper end.
        log: whether it moves by its logarithm.
    """

    names: tuple[str, ...]
    label: str
    unit: str
    value: float
    low: float
    high: float
    log: bool

    @property
    def key(self) -> str:
        """What it is known by: the first of its names."""
        return self.names[0]

    @property
    def of_law(self) -> bool:
        """Whether it is a gain."""
        return self.key.startswith(LAW)


class Movable(NamedTuple):
    """All sliders of a problem, and a sentence on each thing that stays."""

    sliders: tuple[Slider, ...]
    fixed: tuple[str, ...]
    tied: Mapping[str, tuple[str, float]]  # gain -> the one that it follows, and its ratio to that

    def placed(self, config: Config, values: Mapping[str, float]) -> Config:
        """The configuration with sliders at these values, by `Slider.key`; gains that are tied follow."""
        moved = {name: values[s.key] for s in self.sliders for name in s.names}
        tied = {LAW + name: ratio * moved[LAW + which] for name, (which, ratio) in self.tied.items()}
        return put(config, {name: np.asarray(x, float) for name, x in (moved | tied).items()})

    @property
    def leaves(self) -> tuple[str, ...]:
        """The leaves that move, without their elements; each once."""
        names = [name for s in self.sliders for name in s.names] + [LAW + name for name in self.tied]
        return tuple(dict.fromkeys(element_of(name)[0] for name in names))


def movable(config: Config) -> Movable:
    """The tuned gains first, then deadzones, delays, disturbance, and what else of the vehicle is drawn."""
    gains, fixed = Gains.of(config), []
    sliders = []
    for name, low, high in zip(gains.names, gains.lower, gains.upper, strict=True):
        if sets_period(config.controller, name):
            fixed.append(f"{name}: it sets the control period, of which simulate.dt must be a whole fraction")
            continue
        label = name.rpartition(".")[2]  # without the laws that stand around the one that has it
        alone = [other.rpartition(".")[2] for other in gains.names].count(label) == 1 and "[" not in label
        sliders.append(_gain(config, name, label if alone else name, float(low), float(high)))
    short: list[str] = []
    sliders += _together(config, list(_numbers(config, short)))
    fixed += short + ["path, step, horizon, control period and the number of slots of a delay: set them in the file"]
    return Movable(tuple(sliders), tuple(fixed), gains.tied)


def _gain(config: Config, name: str, label: str, low: float, high: float) -> Slider:
    """The tuner's box where it has both ends above 0; else a decade either side, within its bounds."""
    value, unit = value_of(config.controller, name), unit_of(config.controller, name.partition("[")[0])
    log = value > 0
    if log:
        box = low > 0 and math.isfinite(high)
        low, high = (low, high) if box else (max(low, value / DECADE), min(high, value * DECADE))
        low, high = low * (1 + INSIDE), high * (1 - INSIDE)
    else:
        far = DECADE * abs(value) or 1.0
        low, high = max(low, value - far), min(high, value + far)
        low, high = low + INSIDE * (high - low), high - INSIDE * (high - low)
    return Slider((LAW + name,), label, unit, value, min(low, value), max(high, value), log)


class _Number(NamedTuple):
    """A number of the scenario: its name, what it is, whose it is."""

    name: str
    what: str
    whose: str
    unit: str
    value: float
    low: float
    high: float
    log: bool


def _numbers(config: Config, fixed: list[str]) -> Iterator[_Number]:
    """Numbers of the scenario that have a slider, in the order of the page; `fixed` gets those that cannot move."""
    leaves, draws = agvjax.leaves(config.scenario), config.ensemble.draws
    kinds = ("deadzone.", "actuators.", "disturbance.")
    names = [n for kind in kinds for n in leaves if n.startswith(kind)]
    usual = [n for n in names if _usual(config, n)]
    drawn = [n for n in draws if n not in usual and not n.endswith("seed")]
    for name in (*usual, *drawn):
        nominal = np.asarray(leaves[name], float)
        box = draws[name].box(nominal) if name in draws else (nominal, nominal)
        for place in np.ndindex(nominal.shape):
            value, low, high = (float(np.asarray(x)[place]) for x in (nominal, *box))
            if name in usual and place and not value or name in drawn and not low < high:
                continue  # a channel without a disturbance; what is drawn as one value
            element = name + "".join(f"[{i}]" for i in place)
            if element.count("[") > 1:
                continue
            number = _ranged(config, element, name, value, min(low, value), max(high, value))
            if number.low < number.high:
                yield number
            else:
                fixed.append(f"{element}: its slots cannot store a longer delay")


def _usual(config: Config, name: str) -> bool:
    """Whether a number has a slider also where it is not drawn: slopes, thresholds, delays, size of a disturbance."""
    if name.startswith("actuators."):
        holder, _, last = name.rpartition(".")
        return last == "time" and isinstance(get(config.scenario, holder), Delay)
    if name.startswith("disturbance."):
        return name.rpartition(".")[2] in ("amplitude", "amplitudes")
    return name.partition(".")[2].rpartition(".")[2].startswith(("slope_", "threshold_"))


def _ranged(config: Config, name: str, leaf: str, value: float, low: float, high: float) -> _Number:
    """A number with its range: from none of it to more than there is, or a decade either side, or what is drawn."""
    kind, *middle, last = leaf.split(".")
    unit, log = unit_in(config.scenario, leaf), False
    if kind == "deadzone":
        actuator, (what, _, side) = ".".join(middle), last.partition("_")
        what, whose = f"deadzone {what}", f"{actuator} {side}"
        if what.endswith("slope"):
            low, high, log = value / DECADE, value * DECADE, True
    elif kind == "actuators":
        what, whose = "delay", middle[0]
    else:
        what, whose = leaf, name.removeprefix(leaf)
    if kind in ("deadzone", "actuators", "disturbance") and not log and value >= 0:
        low, high = 0.0, max(TIMES * value, high) or 1.0
    if kind == "actuators":
        high = min(high, _longest(config, leaf.rpartition(".")[0]))
    return _Number(name, what, whose, unit, value, low, high, log)


def _longest(config: Config, holder: str) -> float:
    """The longest delay [s] whose commands an element's slots hold, at the shorter of the steps that are used."""
    delay, period = get(config.scenario, holder), config.controller.control_period()
    steps = [config.timing(section).dt for section in ("simulate", "tune")]
    interval = min(steps) if period is None else float(period)
    return (delay.slots - 1) * interval - float(delay.jitter)


def _together(config: Config, numbers: list[_Number]) -> list[Slider]:
    """Numbers that are the same of the same value and unit, of several actuators or sides, move as one."""
    groups: dict[tuple[str, str, float], list[_Number]] = {}
    for number in numbers:
        groups.setdefault((number.what, number.unit, number.value), []).append(number)
    kinds = [number.what for number in numbers]
    sliders = []
    for (what, unit, value), group in groups.items():
        whose = ", ".join(n.whose for n in group)
        alone = len(group) == kinds.count(what)  # nobody else has one
        label = f"{what} of all" if alone and len(group) > 1 else f"{what} {whose}".strip()
        low, high = min(n.low for n in group), min(n.high for n in group)
        names = tuple(n.name for n in group)
        sliders.append(Slider(names, label, unit, value, low, high, group[0].log))
    return sliders


def held(config: Config, name: str) -> float:
    """What a leaf, or an element of it, holds in a configuration, by its name on a slider."""
    leaf, place = element_of(name)
    if leaf.startswith(LAW):
        value = get(config.controller, leaf.removeprefix(LAW))
    else:
        value = get(config.scenario, leaf)
    return float(np.asarray(value) if place is None else np.asarray(value)[place])
