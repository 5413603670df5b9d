"""Prediction in a computer: its model of the vehicle is stepped with the inputs that are under way."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from .._pytree import Real
from ..errors import Fault
from ..integrate import RK4
from ..messages import Start
from ..protocols import Inputs, Plant

MOST_SLOTS = 64  # inputs remembered; each may be a step of the model, written out


def under_way(sent: Inputs, slots: int) -> dict[str, Array]:
    """By actuator so many zeros: nothing is under way; the newest come first."""
    return {name: jnp.zeros((slots, *jnp.shape(u)), jnp.result_type(u)) for name, u in sent.items()}


def joined(way: dict[str, Array], sent: Inputs) -> dict[str, Array]:
    """With one more input, and without the oldest."""
    return {n: jnp.concatenate([jnp.asarray(sent[n])[None], line[:-1]]) for n, line in way.items()}


def stepped(vehicle: Plant, state: PyTree, delivered: Inputs, h: Real) -> PyTree:
    """The state of a vehicle without memory after one step of RK4, `h` [s] long, without disturbance."""

    def rate(x: PyTree, inputs: Inputs) -> tuple[PyTree, tuple[()]]:
        return vehicle.derivative(x, (), inputs, jnp.zeros(3, x.heading.dtype)), ()

    return RK4.advance(rate, state, jnp.asarray(h), [delivered] * len(RK4.nodes))[0]


def memoryless(vehicle: Plant, holder: object) -> list[Fault]:
    """A vehicle that remembers, which cannot be stepped from what is measured."""
    if not jax.tree.leaves(jax.eval_shape(lambda: vehicle.hold(vehicle.start(Start())))):
        return []
    rule = "none: the computer's model of the vehicle has a memory, which no measurement shows"
    return [Fault("type", type(holder).__name__, rule)]
