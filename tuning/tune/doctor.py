"""Is the gradient of a problem right, and if a run is not finite, where does it begin? Asked of the starting gains."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import agvjax
from agvjax.leaves import cast

from ..io.pages import grid
from .analysis import relative_slopes
from .tuner import Tuner

MOST = 6  # slopes that disagree which a terminal is told
FLAT = 1e-9  # relative slope below which a requirement does not depend on a gain


class Slope(NamedTuple):
    """The slope of one requirement in one gain, relative change per relative change, by gradient and by differences."""

    requirement: str
    gain: str
    gradient: float
    difference: float  # central, of the step that agrees best
    left: float  # one-sided, of the smallest step
    right: float
    verdict: str  # "agree", "kink" or "DISAGREE"


class Sick(NamedTuple):
    """Where a run stops being finite."""

    scenario: int  # in the ensemble
    step: int
    time: float  # s
    what: str  # which signal, or the slope of which signal in which gain


class Diagnosis(NamedTuple):
    """What the doctor found."""

    slopes: list[Slope]
    sick: list[Sick]
    diverged: int
    bad: int  # runs that diverge, or whose metrics or slopes are not finite
    size: int

    @property
    def healthy(self) -> bool:
        """Whether everything can be trusted."""
        return not self.bad and all(s.verdict != "DISAGREE" for s in self.slopes)


def diagnose(tuner: Tuner) -> Diagnosis:
    """Gradients against finite differences, and the first step of every run that is not finite, up to three runs."""
    z = tuner.gains.coordinates(tuner.controller)
    values, ok, slopes = model = tuple(np.asarray(x) for x in tuner.push(z, tuner.scenarios()))
    bad = np.flatnonzero(~ok | ~np.isfinite(values).all(0) | ~np.isfinite(slopes).all((0, 1)))
    sick = [s for i in bad[:3] for s in [first_bad(tuner, int(i))] if s is not None]
    fine = ok.any() and np.isfinite(slopes).all()
    return Diagnosis(list(_slopes(tuner, z, model)) if fine else [], sick, int((~ok).sum()), bad.size, ok.size)


def _slopes(tuner: Tuner, z: Any, model: Any) -> Iterator[Slope]:
    objective, reference, names = tuner.objective, tuner.baseline, tuner.gains.names
    level = jax.jit(lambda values, ok: objective.levels(values, ok, reference))

    def levels(at: Any) -> np.ndarray:
        return np.asarray(level(*tuner.roll(at, tuner.scenarios())), float)

    scale = tuner.gains.scales(z)
    here, gradient = relative_slopes(tuner, model, scale)
    per = scale / np.where(here == 0, 1.0, here)[:, None]
    accuracy = float(np.finfo(z.dtype).eps)
    steps, tolerance = accuracy ** np.array([0.25, 1 / 3, 0.42]), max(1e-4, 30 * accuracy**0.5)
    for k, name in enumerate(names):
        unit = np.eye(len(names))[k]
        ends = [(levels(z + h * unit), levels(z - h * unit)) for h in steps]
        central = np.array([(up - down) / (2 * h) for h, (up, down) in zip(steps, ends, strict=True)]) * per[:, k]
        right, left = ((ends[-1][0] - here), (here - ends[-1][1]))
        right, left = (side / steps[-1] * per[:, k] for side in (right, left))
        for r, requirement in enumerate(objective.requirements):
            g = gradient[r, k]
            near = central[np.argmin(np.abs(central[:, r] - g)), r]
            room = tolerance * max(abs(g), abs(near), np.abs(gradient[r]).max() * 1e-2, FLAT)
            between = min(left[r], right[r]) - room <= g <= max(left[r], right[r]) + room
            verdict = "agree" if abs(near - g) <= room else "kink" if between else "DISAGREE"
            yield Slope(requirement.name, name, g, near, left[r], right[r], verdict)


def first_bad(tuner: Tuner, index: int) -> Sick | None:
    """The first step of a scenario of the ensemble at which a signal or its slope in a gain is not finite."""
    z, dtype = tuner.gains.coordinates(tuner.controller), jnp.result_type(float)
    scenario = cast(tuner.batch[index], dtype)
    run = functools.partial(agvjax.simulate, **tuner.timing)

    def rolled(z: Any) -> Any:
        return run(tuner.gains.controller(z, tuner.controller), scenario)

    along = jax.jit(jax.vmap(lambda v: jax.jvp(rolled, (z,), (v,)), out_axes=(None, 0)))
    trajectory, tangent = along(jnp.eye(z.size, dtype=z.dtype))
    not_finite = list(_not_finite(trajectory, "", tuner.timing.dt, index))
    for k, name in enumerate(tuner.gains.names):
        rows = jax.tree.map(lambda x, k=k: x[k], tangent)
        not_finite += _not_finite(rows, f"slope in {name} of ", tuner.timing.dt, index)
    if not_finite:
        return min(not_finite, key=lambda s: s.step)
    if not bool(trajectory.ok):
        state = np.concatenate([np.asarray(trajectory.position), np.asarray(trajectory.velocity)], axis=1)
        held = np.all(state == state[-1], axis=1)
        step = int(len(held) - np.argmin(held[::-1])) if not held.all() else 0
        return Sick(index, step, step * tuner.timing.dt, "the state exceeds scenario.limit: diverged, frozen here")
    return None


def _not_finite(trajectory: Any, of: str, dt: float, index: int) -> Iterator[Sick]:
    for path, leaf in jax.tree_util.tree_leaves_with_path(trajectory):
        array = np.asarray(leaf)
        if array.ndim and np.issubdtype(array.dtype, np.floating):
            rows = ~np.isfinite(array.reshape(len(array), -1)).all(1)
            if rows.any():
                step = int(np.argmax(rows))
                yield Sick(index, step, step * dt, f"{of}{jax.tree_util.keystr(path).lstrip('.')} is not finite")


def brief(diagnosis: Diagnosis) -> str:
    """For a terminal: the verdict, and what speaks against trust."""
    verdict, *rest = reversed([line for line in page(diagnosis).splitlines() if line and not line.startswith("|")])
    bad = [s for s in diagnosis.slopes if s.verdict == "DISAGREE"]
    rows = [[s.requirement, s.gain, f"{s.gradient:+.6f}", f"{s.difference:+.6f}"] for s in bad[:MOST]]
    more = [f"and {len(bad) - MOST} more, in doctor.md"] if len(bad) > MOST else []
    table = ["", grid(["disagree", "gain", "gradient", "differences"], rows), *more] if bad else []
    return "\n".join([verdict, *reversed(rest), *table])


def page(diagnosis: Diagnosis) -> str:
    """For a person."""
    lines = [f"{diagnosis.diverged} of {diagnosis.size} runs diverge with the starting gains."]
    lines += [f"Scenario {s.scenario}, step {s.step}, t = {s.time:.4g} s: {s.what}." for s in diagnosis.sick]
    if diagnosis.bad > diagnosis.diverged:
        lines.append(f"{diagnosis.bad - diagnosis.diverged} others have metrics or slopes that are not finite.")
    if diagnosis.slopes:
        rows = [
            [*s[:2], f"{s.gradient:+.6f}", f"{s.difference:+.6f}", f"{s.left:+.4f}", f"{s.right:+.4f}", s.verdict]
            for s in diagnosis.slopes
        ]
        lines += ["", grid(["requirement", "gain", "gradient", "differences", "left", "right", ""], rows), ""]
        count = {v: sum(s.verdict == v for s in diagnosis.slopes) for v in ("agree", "kink", "DISAGREE")}
        lines.append(
            f"{count['agree']} slopes agree with central differences, {count['kink']} lie at a kink between the slopes"
            f" of either side, {count['DISAGREE']} disagree. Slope: relative change of a requirement per relative"
            " change of a gain."
        )
    lines.append(
        "Gradients can be trusted." if diagnosis.healthy else "**Do not trust the gradients of this problem.**"
    )
    return "\n".join(lines)
