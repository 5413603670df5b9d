"""What the search for rare failures needs of a sweep."""

from __future__ import annotations

from collections.abc import Iterator

from agvjax import Fault

from ...compute.memory import too_much
from ...config import ends
from ...config import rules as vehicle_rules
from ...config.settings import Config
from .. import rules
from ..design import Axis, Design, design
from .problem import BEYOND


def faults(config: Config) -> list[Fault]:
    """What is wrong with a configuration whose rare failures are looked for."""
    return rules.faults(config) or vehicle_rules.unique([*_settings(config), *_axes(config), *_size(config)])


def _settings(config: Config) -> Iterator[Fault]:
    sweep = config.sweep
    if sweep.controllers:
        yield Fault("sweep.controllers", ", ".join(sweep.controllers), "empty with --rare: one controller at a time")
    if sweep.design != "random":
        yield Fault("sweep.design", sweep.design, "random with --rare, which makes its own draws")


def _size(config: Config) -> list[Fault]:
    """More draws than fit into memory: their normal numbers, weights and outcomes are held at once, twice."""
    rollouts = config.sweep.rollouts
    much = too_much(2 * rollouts * (len(design(config).sampled) + 3) * 8)
    return [Fault("sweep.rollouts", rollouts, f"fewer: so many draws take {much}")] if much else []


def _axes(config: Config) -> Iterator[Fault]:
    """Axes that no normal number stands behind, or that may not go as far as one does."""
    plan = design(config)
    for axis in plan.grid:
        rule = "without points, LEAF=LOW:HIGH, or left out for --ensemble: --rare needs draws, not a grid"
        yield Fault("sweep.over", f"{axis.name} ({axis.points} points)", rule)
    for axis in plan.sampled:
        if not all(target.draw.moves for target in axis.targets):
            rule = "a range or a distribution with --rare: one of some values has no density"
            yield Fault(_key(config, axis), "one of some values", rule)
        elif any(target.draw.tailed for target in axis.targets):
            yield from _tails(config, plan, axis)


def _tails(config: Config, plan: Design, axis: Axis) -> Iterator[Fault]:
    """What breaks a rule of a vehicle as far out in a distribution as draws are looked at."""
    for share in (BEYOND, 1 - BEYOND):
        try:
            corner = {target.name: plan.value(target, share)[0] for target in axis.targets}
        except ValueError as error:
            yield Fault(_key(config, axis), f"share {share:.10f}", f"a distribution that has it ({error})")
            return
        for fault in vehicle_rules.vehicle_faults(ends.placed(config, corner)):
            shown = ", ".join(f"{name} = {value:.4g}" for name, value in corner.items())
            rule = (
                f"{fault.rule}, also {BEYOND:g} of the draws out, where --rare looks: one that ends before, truncnorm"
            )
            yield Fault(_key(config, axis), shown, f"{rule}, or lognorm")


def _key(config: Config, axis: Axis) -> str:
    swept = {name for table in config.sweep.over for name in table}
    home = "sweep.over" if axis.targets[0].name in swept else "ensemble.draws"
    return f"{home}.{axis.name}"
