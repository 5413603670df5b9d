"""Are these numbers usable? Asked on the host, before a run; nothing under `jit` validates or raises."""

from __future__ import annotations

from typing import TypeVar

import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import PyTree

from .errors import Fault, InputError, told_apart
from .integrate import Integrator
from .leaves import cast, children, fits, metadata_of
from .protocols import Law
from .scenario import Scenario
from .schedule import Schedule, extremes
from .timing import whole

T = TypeVar("T")
LARGEST = 1e30  # of a number in size: products of several larger ones are beyond what a computer holds
COARSE = 0.01  # error of a mode beyond which a step gets a note


def faults(tree: PyTree, name: str = "") -> list[Fault]:
    """Every number in a controller or scenario that breaks the rule written beside its field."""
    listed = []
    for part, value in children(tree).items():
        key = f"{name}.{part}" if name else part
        if isinstance(value, Schedule):
            listed += faults(value, key) or value.faults(key) or _misplaced(key, tree, part, value)
        elif children(value):
            listed += faults(value, key)
        elif "rule" in metadata_of(tree, part):
            listed += _broken(key, tree, part)
    return listed


def _misplaced(key: str, tree: PyTree, part: str, schedule: Schedule) -> list[Fault]:
    """A schedule where no single number of a law stands, or whose values break the rule of that number."""
    field = metadata_of(tree, part)
    if () not in field.get("shapes", ()) or part == "period" or key.split(".")[0] == "scenario":
        return [Fault(key, "a schedule", "one or several plain numbers: schedules stand for single numbers of a law")]
    values = np.asarray(schedule.values)
    broken = not np.all(field["rule"].holds(values))
    return [Fault(f"{key}.values", values.tolist(), f"each {field['rule'].text}", field["source"])] if broken else []


def _broken(key: str, tree: PyTree, part: str) -> list[Fault]:
    field, value = metadata_of(tree, part), children(tree)[part]
    rule, source, shapes = field["rule"], field["source"], field["shapes"]
    wanted = " or ".join(dict.fromkeys("a number" if s == () else f"an array of shape {s}" for s in shapes))
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        return [Fault(key, value, wanted, source)]
    if not (jnp.issubdtype(array.dtype, jnp.integer) or jnp.issubdtype(array.dtype, jnp.floating)):
        return [Fault(key, repr(value), f"a number, {rule.text}", source)]
    if not fits(tree, part, array.shape) or array.size == 0:
        return [Fault(key, f"shape {array.shape}", wanted, source)]
    if not np.all(np.isfinite(array)) or not np.all(rule.holds(array)):
        text = rule.text if "finite" in rule.text else f"finite and {rule.text}"
        return [Fault(key, value if array.ndim == 0 else array.tolist(), text, source)]
    if np.any(np.abs(array) > LARGEST):
        text = f"{rule.text}, and at most {LARGEST:g} in size"
        return [Fault(key, value if array.ndim == 0 else array.tolist(), text, source)]
    least = field["above"]
    low = np.asarray(children(tree)[least] if least and not _broken(least, tree, least) else -np.inf)
    if np.any(array <= low):
        return [Fault(key, array.tolist(), f"above {least} = {low.tolist()}", source)]
    return []


def step_faults(
    controller: Law, dt: float, horizon: float, integrator: Integrator, scenario: Scenario | None = None
) -> list[Fault]:
    """What is wrong with a step and a horizon, for this controller, integrator and, if given, scenario."""
    found = []
    if not (np.isfinite(dt) and dt > 0):
        return [Fault("dt", dt, "finite and > 0", "reading R10")]
    if not (np.isfinite(horizon) and horizon >= dt):
        found.append(Fault("horizon", horizon, f"finite and at least one step, {dt:g} s", "reading R10"))
    period = controller.control_period()
    interval = dt if period is None else float(period)  # s between changes of what is asked of the actuators
    steps = interval / dt
    if not whole(steps):
        found.append(Fault("dt", dt, f"a whole fraction of the law's period, {interval:g} s", "zero-order hold"))
    fastest, source = controller.fastest
    poles = np.concatenate([law.poles() for law in extremes(controller)])
    found += _unstable(f"the {fastest}", poles, dt, integrator, source)
    for name, part in {} if scenario is None else scenario.actuators.items():
        for key, element in part.elements(f"actuators.{name}"):
            found += [fault._replace(key=f"{key}.{fault.key}") for fault in element.faults(interval)]
            found += _unstable(key, np.array(element.poles()), dt, integrator)
    return found


def _unstable(part: str, poles: np.ndarray, dt: float, integrator: Integrator, source: str = "") -> list[Fault]:
    """A step of `dt` [s] that makes a part with these poles [1/s] diverge."""
    limit = integrator.stable_step(poles)
    rule = f"at most {told_apart(limit, dt)} s: beyond, {integrator.name} makes {part} diverge"
    return [Fault("dt", dt, rule, source)] if dt > limit else []


def step_warnings(controller: Law, dt: float, integrator: Integrator) -> list[str]:
    """Gains that a stable step follows badly: a mode they set is off by more than 1 % over its own time constant."""
    errors: dict[str, float] = {}
    for gain, poles in (item for law in extremes(controller) for item in law.rates().items()):
        errors[gain] = max([errors.get(gain, 0.0), *(integrator.error(pole * dt) for pole in poles)])
    coarse = [f"{gain} ({error:.0%})" for gain, error in errors.items() if error > COARSE]
    return [f"dt = {dt:g} s is coarse: error of the modes that gains set, {', '.join(coarse)}"] if coarse else []


def check(tree: T, dtype: DTypeLike | None = None) -> T:
    """A controller or scenario, validated, its numbers in the run's dtype (an integer gain would stop `jax.grad`).

    Raises:
        InputError: a ValueError that lists every bad leaf, its value, the rule and its source.
    """
    found = faults(tree)
    if found:
        raise InputError(found)
    return cast(tree, jnp.result_type(float) if dtype is None else dtype)
