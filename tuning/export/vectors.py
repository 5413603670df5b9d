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

from . import program
from .program import Program

DRIVEN, ANYWHERE = 32, 32  # rows
AHEAD, WIDE = 0.1, 1.0  # s between the rows of the drive; deviation of numbers anywhere


def table(controller: Sampled, step: Program) -> tuple[list[str], np.ndarray]:
    """Names of columns, and rows: state, measurement, reference, later state, inputs, whether limited."""
    if jnp.zeros(()).dtype != jnp.float64:
        raise ValueError("vectors are made in double precision: set jax_enable_x64")
    names = []
    for group in ("state", "measurement", "reference"):
        names += [v for field in step.arguments[group] for v in field.variables]
    names += [f"later_{v}" for field in step.arguments["state"] for v in field.variables]
    names += [
        f"input_{field.member}{i if field.shape else ''}"
        for field in step.results["inputs"]
        for i in range(max(1, int(np.prod(field.shape))))
    ]
    rows = [row(controller, *given) for given in (*_driven(controller), *_anywhere(controller))]
    return [str(name) for name in (*names, "limited")], np.array(rows)


def row(controller: Sampled, state: PyTree, measurement: Measurement, reference: Reference) -> np.ndarray:
    """One row."""
    done = _step(controller, state, measurement, reference)
    parts = (state, measurement, reference, done.law, done.command.inputs, done.limited)
    return np.concatenate([np.ravel(np.asarray(x, float)) for x in jax.tree.leaves(parts)])


_step = jax.jit(lambda controller, *given: controller.step(*given))


def _driven(controller: Sampled) -> list[tuple[PyTree, Measurement, Reference]]:
    """States on the way of a vehicle that starts beside a circle and goes straight on."""
    path, found = agvjax.Circle(radius=3.0, omega=0.3), []
    state, seen, _ = program.examples(controller)
    speed = jnp.array([0.0, 0.9])
    for k in range(DRIVEN):
        t = jnp.asarray(AHEAD * k)
        asked = reference(path, agvjax.Tangent(), t)
        here = dataclasses.replace(
            seen, position=jnp.array([2.6, 0.2]) + t * speed, velocity=speed, heading=jnp.asarray(1.5)
        )
        state = controller.inner.init(here, asked) if k == 0 else state
        found.append((state, here, asked))
        state = _step(controller, state, here, asked).law
    return found


def _anywhere(controller: Sampled) -> list[tuple[PyTree, Measurement, Reference]]:
    rng = np.random.default_rng(0)
    given = program.examples(controller)
    return [jax.tree.map(lambda x: jnp.asarray(WIDE * rng.normal(size=np.shape(x))), given) for _ in range(ANYWHERE)]
