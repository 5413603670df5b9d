"""Steps whose results are known: some of a drive, some anywhere, as the JAX step has them in double precision."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

import agvjax
from agvjax import Measurement, Reference, Sampled
from agvjax.paths.heading import reference

from . import guard, program
from .program import Program

DRIVEN, ANYWHERE = 32, 32  # rows
AHEAD, WIDE = 0.1, 1.0  # s between the rows of the drive; deviation of numbers anywhere


def table(controller: Sampled, step: Program) -> tuple[list[str], np.ndarray]:
    """Names of columns, and rows: state, measurement, reference, later state, inputs, whether limited."""
    if jnp.zeros(()).dtype != jnp.float64:
        raise ValueError("vectors are made in double precision: set jax_enable_x64")
    state, *seen = (step.arguments[group] for group in ("state", "measurement", "reference"))
    names = [str(v) for fields in (state, *seen) for field in fields for v in field.variables]
    names += [f"later_{v}" for field in state for v in field.variables]
    for field in step.results["inputs"]:
        names += [f"input_{field.member}{i if field.shape else ''}" for i in range(len(field.variables))]
    rows = [row(controller, *arguments) for arguments in (*_driven(controller), *_anywhere(controller))]
    return [*names, "limited"], np.array(rows)


def row(controller: Sampled, state: PyTree, measurement: Measurement, reference: Reference) -> np.ndarray:
    """State, measurement, reference, later state, inputs and whether limited of one step, as one flat array."""
    later = _step(controller, state, measurement, reference)
    parts = (state, measurement, reference, later["state"], later["inputs"], later["limited"])
    return np.concatenate([np.ravel(np.asarray(x, float)) for x in jax.tree.leaves(parts)])


_step = jax.jit(guard.step)


def _driven(controller: Sampled) -> list[tuple[PyTree, Measurement, Reference]]:
    """States on the way of a vehicle that starts beside a circle and goes straight on."""
    path, steps = agvjax.Circle(radius=3.0, omega=0.3), []
    state, seen, _ = program.examples(controller)
    start, speed, heading = jnp.array([2.6, 0.2]), jnp.array([0.0, 0.9]), jnp.asarray(1.5)
    for k in range(DRIVEN):
        t = jnp.asarray(AHEAD * k)
        asked = reference(path, agvjax.Tangent(), t)
        here = dataclasses.replace(seen, position=start + t * speed, velocity=speed, heading=heading)
        state = controller.inner.init(here, asked) if k == 0 else state
        steps.append((state, here, asked))
        state = _step(controller, state, here, asked)["state"]
    return steps


def _anywhere(controller: Sampled) -> list[tuple[PyTree, Measurement, Reference]]:
    rng, shapes = np.random.default_rng(0), program.examples(controller)
    return [jax.tree.map(lambda x: jnp.asarray(WIDE * rng.normal(size=np.shape(x))), shapes) for _ in range(ANYWHERE)]
