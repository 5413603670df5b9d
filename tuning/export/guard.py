"""The step as it is exported: a number that is not finite never enters the state of the law."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, PyTree

import agvjax
from agvjax import Measurement, Sampled
from agvjax.controllers.following import Followed
from agvjax.controllers.sampled import Remembered
from agvjax.messages import Reference
from agvjax.schedule import scheduled

from ..io.files import Json

STATUS = {  # words of `output.status` and what they mean; a step's flags after the first have their order
    "OK": "the step was taken",
    "NOT_FINITE": "a number of measurement or reference is NaN or infinite, or what the law makes of them is:"
    " the state stays as it was, all inputs are 0",
    "STARTED": "the state was not finite: the law began anew with this measurement, and the step was taken",
}


@agvjax.pytree
class Kept:
    """The state of a computer that remembers more than the law inside does."""

    law: PyTree
    memory: Remembered


def start(controller: Sampled, measurement: Measurement, reference: Reference) -> PyTree:
    """The state of a law that starts now; NaN all over where a number is not finite, so that a later step starts."""
    state = begun(controller, measurement, reference)
    return _chosen(
        _finite((measurement, _asked(reference))), state, jax.tree.map(lambda x: jnp.full_like(x, jnp.nan), state)
    )


def step(controller: Sampled, state: PyTree, measurement: Measurement, reference: Reference) -> Json:
    """State afterwards, inputs, whether limited, and the flags of the status; groups of a `program.Program`."""
    going, controller = _finite(_own(state)), scheduled(controller, measurement)
    if controller.follows():  # it searches the whole route, which no period but the first has time for
        before = jax.lax.cond(going, lambda: state, lambda: begun(controller, measurement, reference))
    else:
        before = _chosen(going, state, begun(controller, measurement, reference))
    state_of_law, memory = (before.law, before.memory) if isinstance(before, Kept) else (before, None)
    computed = controller.step(state_of_law, measurement, reference, memory)
    later, inputs = _kept(computed.law, computed.memory), computed.command.inputs
    sound = _finite((measurement, _asked(reference))) & _finite((_own(later), inputs))
    return {
        "state": _chosen(sound, later, state),
        "inputs": _chosen(sound, inputs, jax.tree.map(jnp.zeros_like, inputs)),
        "limited": {"limited": sound & computed.limited},
        "status": {"not_finite": ~sound, "started": sound & ~going},
    }


def begun(controller: Sampled, measurement: Measurement, reference: Reference) -> PyTree:
    """The state of a computer that starts here."""
    computed = scheduled(controller, measurement).hold(measurement, reference)
    return _kept(computed.law, computed.memory)


def _kept(law: PyTree, memory: Remembered) -> PyTree:
    law = without_corridor(law)
    return Kept(law=law, memory=memory) if jax.tree.leaves(memory) else law


def without_corridor(state: PyTree) -> PyTree:
    """A state as it is exported: how wide the route is where the vehicle is, no law needs to remember."""
    if isinstance(state, Followed):
        return dataclasses.replace(state, place=dataclasses.replace(state.place, room=None))
    return state


def _asked(reference: Reference) -> Reference:
    """What is asked for at an instant, without the route, which stays as it is."""
    return dataclasses.replace(reference, route=None)


def _own(state: PyTree) -> PyTree:
    """A state without what is left of a leg: infinite on a closed route, and never read."""
    if isinstance(state, Kept):
        return dataclasses.replace(state, law=_own(state.law))
    if isinstance(state, Followed):
        return dataclasses.replace(state, place=dataclasses.replace(state.place, remaining=state.place.arc))
    return state


def _finite(tree: PyTree) -> Bool[Array, ""]:
    """Whether every number is: 0 times a number is 0, of NaN and infinity NaN, and so is a sum that has it.

    One comparison for all of them, where a chain of `and` would make two branches of each number.
    """
    numbers = [x[i] for x in map(jnp.asarray, jax.tree.leaves(tree)) for i in np.ndindex(x.shape)]
    zeros = [0.0 * x for x in numbers]
    return sum(zeros[1:], start=zeros[0]) == 0.0 if zeros else jnp.asarray(True)


def _chosen(condition: Bool[Array, ""], yes: PyTree, no: PyTree) -> PyTree:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), yes, no)
