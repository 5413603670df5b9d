"""Steps whose results are known: some of a drive, some anywhere, as the JAX step has them in double precision."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

import agvjax
from agvjax import Measurement, Reference, Route, Sampled
from agvjax.geometry import direction
from agvjax.paths.heading import reference
from agvjax.paths.place import Place

from . import guard, program, tables
from .artefact import Artefact
from .program import Program

GROUPS = ("state", "measurement", "reference")
DRIVEN, ANYWHERE = 32, 32  # rows
AHEAD, WIDE = 0.1, 1.0  # s between the rows of the drive; deviation of numbers anywhere
BESIDE = 0.1  # deviation of a vehicle on a route: m, rad, m/s


def table(artefact: Artefact, step: Program) -> tuple[list[str], np.ndarray]:
    """Names of columns, and rows: state, measurement, reference, later state, inputs, whether limited.

    Those of a law that follows a route are steps along the artefact's, and have no reference.
    """
    controller, route = artefact.controller, artefact.route
    if jnp.zeros(()).dtype != jnp.float64:
        raise ValueError("vectors are made in double precision: set jax_enable_x64")
    state, *seen = (step.arguments[group] for group in GROUPS if group in step.arguments)
    names = [str(v) for fields in (state, *seen) for field in fields for v in field.variables]
    names += [f"later_{v}" for field in state for v in field.variables]
    for field in step.results["inputs"]:
        names += [f"input_{field.member}{i if field.shape else ''}" for i in range(len(field.variables))]
    now = [*_driven(controller), *_anywhere(controller)] if route is None else _along(controller, route)
    rows = [row(controller, *arguments) for arguments in now]
    return [*names, "limited"], np.array(rows)


def row(controller: Sampled, state: PyTree, measurement: Measurement, reference: Reference) -> np.ndarray:
    """State, measurement, reference, later state, inputs and whether limited of one step, as one flat array."""
    later = step(controller, state, measurement, reference)
    parts = (state, measurement, _plain(reference), later["state"], later["inputs"], later["limited"])
    return np.concatenate([np.ravel(np.asarray(x, float)) for x in jax.tree.leaves(parts)])


def _plain(reference: Reference) -> Reference | None:
    return reference if reference.route is None else None


step, _init, _at = jax.jit(guard.step), jax.jit(guard.begun), jax.jit(Route.at)


def _driven(controller: Sampled) -> list[tuple[PyTree, Measurement, Reference]]:
    """States on the way of a vehicle that starts beside a circle and goes straight on."""
    path, steps = agvjax.Circle(radius=3.0, omega=0.3), []
    state, seen, _ = program.examples(controller)
    start, speed, heading = jnp.array([2.6, 0.2]), jnp.array([0.0, 0.9]), jnp.asarray(1.5)
    for k in range(DRIVEN):
        t = jnp.asarray(AHEAD * k)
        asked = reference(path, agvjax.Tangent(), t)
        here = dataclasses.replace(seen, position=start + t * speed, velocity=speed, heading=heading)
        state = guard.begun(controller, here, asked) if k == 0 else state
        steps.append((state, here, asked))
        state = step(controller, state, here, asked)["state"]
    return steps


def _anywhere(controller: Sampled) -> list[tuple[PyTree, Measurement, Reference]]:
    rng, shapes = np.random.default_rng(0), program.examples(controller)
    return [jax.tree.map(lambda x: jnp.asarray(WIDE * rng.normal(size=np.shape(x))), shapes) for _ in range(ANYWHERE)]


def _along(controller: Sampled, route: Route) -> list[tuple[PyTree, Measurement, Reference]]:
    """States of a vehicle beside a route, from its beginning to its end; the first is that of a law that starts."""
    rng, (_, shape, _) = np.random.default_rng(0), program.examples(controller)
    given, steps = tables.to_follow(route), []
    for leg, arc, ahead in _spots(route):
        place, later = (_at(route, jnp.asarray(x), jnp.asarray(leg)) for x in (arc, arc + ahead))
        if not ahead:  # where a leg is done, after some of the time that it may have to wait
            place = dataclasses.replace(place, waited=jnp.asarray(float(rng.integers(60))))
        off = BESIDE * rng.normal(size=3)
        heading = later.heading() + off[0]
        seen = dataclasses.replace(
            _random(rng, shape),
            position=later.position + off[1] * jnp.stack([-later.tangent[1], later.tangent[0]]),
            heading=heading,
            velocity=later.sign * (later.speed + off[2]) * direction(heading),
        )
        begun = _init(controller, seen, given)
        steps.append((_placed(_random(rng, begun), place) if steps else begun, seen, given))
    return steps


def _placed(state: PyTree, place: Place) -> PyTree:
    if isinstance(state, guard.Kept):
        return dataclasses.replace(state, law=_placed(state.law, place))
    return dataclasses.replace(state, place=place)


def _random(rng: np.random.Generator, tree: PyTree) -> PyTree:
    return jax.tree.map(lambda x: jnp.asarray(BESIDE * rng.normal(size=np.shape(x))), tree)


def _spots(route: Route) -> list[tuple[float, float, float]]:
    """Leg, arc length [m], and how far [m] a vehicle has come since: all along, and where each leg is done.

    Not at the very end of a leg: the speed there is the root of a number that is 0 but for rounding.
    """
    begins = np.asarray(route.legs)[0]
    ends = np.append(begins[1:], float(np.asarray(route.length)))
    count = DRIVEN + ANYWHERE - len(ends)
    apart = ends[-1] / count
    arcs = apart * np.arange(count)
    legs = np.searchsorted(begins, arcs, side="right") - 1.0
    done = ends - 0.1 * float(route.reached)
    ahead = np.clip(done[legs.astype(int)] - arcs, 0.0, min(BESIDE, apart / 2))
    along = list(zip(legs.tolist(), arcs.tolist(), ahead.tolist(), strict=True))
    return along + [(float(leg), end, 0.0) for leg, end in enumerate(done.tolist())]
