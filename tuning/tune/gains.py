"""Gains as unconstrained coordinates: whatever the optimiser does, every gain stays inside its bounds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

import agvjax
from agvjax import Law, Scenario
from agvjax.leaves import element, get, rule_of, spread, stands_for
from agvjax.schedule import extremes

from ..config.settings import Config, Tune
from ..ensemble.draws import Draw, lowest


class Gains(NamedTuple):
    """The tuned gains and their open intervals; a gain with one bound moves in the logarithm of its distance to it.

    A gain that is `tied` follows a tuned one at a fixed ratio: name -> (which, ratio).
    """

    names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    tied: Mapping[str, tuple[str, float]] = {}
    stability: Mapping[str, float] = {}  # what they must exceed by the law's own conditions, times the margin

    @classmethod
    def of(cls, config: Config) -> Gains:
        """The gains of a configuration, with every bound: rules, stability, step, and the user's own."""
        settings, law, timing = config.tune, config.controller, config.timing("tune")
        conditions = stability_bounds(law, config.scenario, config.ensemble.draws)
        stability = {name: settings.stability_margin * bound for name, bound in conditions.items()}
        tuned = names_of(config)
        names = (*tuned, *settings.tied)
        bounds = default_bounds(law, names, stability, _slowest(settings), timing.integrator)
        for name, (low, high) in settings.bounds.items():
            if rule_of(law, element(name)[0]) is not None:  # a gain without a rule may go wherever the user says
                low, high = max(low, bounds[name][0]), min(high, bounds[name][1])
            bounds[name] = (low, high)
        tied = tie(law, settings.tied, bounds)
        lower, upper = (np.array([bounds[name][side] for name in tuned]) for side in (0, 1))
        return cls(tuned, lower, upper, tied, stability)

    def coordinates(self, controller: Law) -> Float[Array, " K"]:
        """Where a controller stands. Its gains must lie strictly inside the bounds; see `faults`."""
        x = np.array([value_of(controller, name) for name in self.names])
        low, high = np.isfinite(self.lower), np.isfinite(self.upper)
        above = np.log(np.where(low, x - self.lower, 1.0))
        below = np.log(np.where(high, self.upper - x, 1.0))
        return jnp.asarray(np.where(low | high, above - below, x))

    def controller(self, z: Float[Array, " K"], like: Law) -> Law:
        """The controller at z; what is not tuned is taken from `like`."""
        return agvjax.replace(like, self._named(self._gains(z), like))

    def controllers(self, z: Float[Array, "B K"], like: Law) -> agvjax.Batch:
        """The controllers at every row of z."""
        return agvjax.batch(like, self._named(self._gains(z).T, like))

    def _named(self, columns: Float[Array, " K *B"], like: Law) -> dict[str, Array]:
        """The leaves that tuned gains, and those tied to them, are or are elements of."""
        gains = dict(zip(self.names, columns, strict=True))
        gains |= {name: ratio * gains[which] for name, (which, ratio) in self.tied.items()}
        named: dict[str, Array] = {}
        for name, column in gains.items():
            leaf, place = element(name)
            if place is None:
                named[leaf] = column
                continue
            whole = jnp.asarray(get(like, leaf), column.dtype)
            whole = named.get(leaf, jnp.broadcast_to(whole, (*column.shape, *whole.shape)))
            named[leaf] = whole.at[..., place].set(column)
        return named

    def _gains(self, z: Float[Array, "*B K"]) -> Float[Array, "*B K"]:
        low, high = np.isfinite(self.lower), np.isfinite(self.upper)
        lower, upper = (
            jnp.asarray(np.where(fine, x, 0.0), z.dtype) for fine, x in ((low, self.lower), (high, self.upper))
        )
        return _between(z, lower, upper, low, high)

    def values(self, z: Float[Array, " K"], like: Law) -> list[float]:
        """The tuned gains at z, in the order of their names."""
        law = self.controller(z, like)
        return [value_of(law, name) for name in self.names]

    def scales(self, z: Float[Array, " K"]) -> np.ndarray:
        """D z / d log(gain): turns slopes in the coordinates into slopes per relative change of a gain."""
        x, slope = jax.jit(lambda z: jax.jvp(self._gains, (z,), (jnp.ones_like(z),)))(z)
        moves = np.asarray(slope) != 0
        return np.where(moves, np.asarray(x) / np.where(moves, slope, 1.0), 0.0)

    def faults(self, controller: Law) -> list[agvjax.Fault]:
        """Gains that do not lie strictly inside their bounds."""
        source = "its bounds and those of what is tied to it; the stability conditions (48), (52), (70) for the"
        source += " smallest slope drawn; what a step of tune.dt, or of 1 / tune.sample_rate, integrates"
        faults = []
        for name, low, high in zip(self.names, self.lower, self.upper, strict=True):
            value = value_of(controller, name)
            if not low < value < high:
                rule = f"> {low:.6g}" if np.isinf(high) else f"inside ({low:.6g}, {high:.6g})"
                faults.append(agvjax.Fault(f"controller.{name}", value, rule, source))
        return faults


@jax.jit
def _between(
    z: Float[Array, "*B K"],
    lower: Float[Array, " K"],
    upper: Float[Array, " K"],
    low: Bool[Array, " K"],
    high: Bool[Array, " K"],
) -> Float[Array, "*B K"]:
    """Gains at z, between those of the bounds that there are: `low` and `high` say which. One program, not twenty."""
    edge = -0.9 * float(np.log(np.finfo(z.dtype).eps))  # beyond, a gain would lie on its bound
    inside = lower + (upper - lower) * jax.nn.sigmoid(jnp.clip(z, -edge, edge))
    cases = [low & high, low & ~high, ~low & high]
    above, below = (jnp.exp(jnp.where(case, sign * z, 0.0)) for case, sign in zip(cases[1:], (1, -1), strict=True))
    return jnp.select(cases, [inside, lower + above, upper - below], z)


def own(config: Config) -> tuple[str, ...]:
    """The gains that the law names to be tuned, without those that are tied."""
    heading = config.scenario.plant.commands_heading
    return tuple(
        n for n in spread(config.controller, config.controller.gains_to_tune(heading)) if n not in config.tune.tied
    )


def names_of(config: Config) -> tuple[str, ...]:
    """The names of the gains that are tuned, or where `tune.gains` is a word those that may be.

    By a word these are the law's own and every other number of it that lies strictly inside what it may be, also those
    that stand in an array; but for those that are tied, and those that set the control period.
    """
    law, chosen = config.controller, config.tune.gains
    if not isinstance(chosen, str):
        return chosen
    mine, timing = own(config), config.timing("tune")
    others = [name for name in numbers_of(law) if name not in {*mine, *config.tune.tied} and not sets_period(law, name)]
    bounds = default_bounds(law, tuple(others), {}, _slowest(config.tune), timing.integrator)
    return (*mine, *(name for name in others if bounds[name][0] < value_of(law, name) < bounds[name][1]))


def numbers_of(law: Law) -> list[str]:
    """The names of all numbers of a law; of those in an array with their place, `heading_network.centers[0]`."""
    names = []
    for name, value in agvjax.leaves(law).items():
        size = np.shape(value)
        names += [f"{name}[{i}]" for i in range(size[0])] if len(size) == 1 else [name] if not size else []
    return names


def sets_period(law: Law, name: str) -> bool:
    """Whether another value of a gain is another control period."""
    leaf, _ = element(name)
    return agvjax.replace(law, {leaf: 2 * get(law, leaf)}).control_period() != law.control_period()


def _slowest(settings: Tune) -> float:
    """The longest step [s] that must integrate what the gains set."""
    return max(settings.dt, 1 / settings.sample_rate) if settings.sample_rate else settings.dt


def value_of(law: Law, name: str) -> float:
    """A gain, or an element of one that is several numbers, by its name."""
    leaf, place = element(name)
    value = get(law, leaf)
    return float(value if place is None else np.asarray(value)[place])


def smallest_slopes(scenario: Scenario, draws: Mapping[str, Draw]) -> tuple[float, float]:
    """Pi_min of position and heading: the smallest slopes that occur in the ensemble."""
    sides = ("slope_right", "slope_left")
    position, heading = (
        min(lowest(scenario, draws, f"deadzone.{channel}.{side}") for side in sides)
        for channel in ("position", "heading")
    )
    return position, heading


def stability_bounds(controller: Law, scenario: Scenario, draws: Mapping[str, Draw]) -> dict[str, float]:
    """What the law's own stability conditions ask of its gains; empty for a law or a plant without any."""
    if set(scenario.deadzone) != {"position", "heading"}:
        return {}
    return extremes(controller)[0].stability_bounds(*smallest_slopes(scenario, draws))


def default_bounds(
    controller: Law, names: tuple[str, ...], stability: Mapping[str, float], dt: float, integrator: agvjax.Integrator
) -> dict[str, tuple[float, float]]:
    """What each gain's own rule allows, the stability conditions, and what a step of `dt` can integrate of the law."""
    upper = extremes(controller)[1].upper_bounds(lambda poles: integrator.stable_step(poles) >= dt)
    bounds = {}
    for name in names:
        allowed = rule_of(controller, element(name)[0])
        least = 0.0 if value_of(controller, name) > 0 else -np.inf  # without a rule a gain > 0 stays so
        low, high = (least, np.inf) if allowed is None else (allowed.low, allowed.high)
        of = stands_for(controller, name)
        bounds[name] = (max(low, stability.get(of, low)), min(high, upper.get(of, high)))
    return bounds


def tie(
    controller: Law, tied: Mapping[str, str], bounds: dict[str, tuple[float, float]]
) -> dict[str, tuple[str, float]]:
    """Ratios of the tied gains to those they follow, whose `bounds` are narrowed to what the tied ones allow."""
    ratios = {}
    for name, which in tied.items():
        ratio = value_of(controller, name) / value_of(controller, which)
        (low, high), (tied_low, tied_high) = bounds[which], bounds[name]
        bounds[which] = (max(low, tied_low / ratio), min(high, tied_high / ratio))
        ratios[name] = (which, ratio)
    return ratios
