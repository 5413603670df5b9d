"""The one law as a straight line of scalar operations: its jaxpr with arrays taken apart, nothing written twice."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

import agvjax
from agvjax import Measurement, Sampled
from agvjax.engine.scalarise import scalarise, split_tree
from agvjax.messages import Reference

from ..io.files import Json
from . import guard, tables
from .operations import INLINED, Block, Operand, Statement, Writer, flat, kept

GATHERED = frozenset({"broadcast_in_dim", "concatenate", "reshape", "slice", "squeeze", "stack"})  # around a whole one


class Field(NamedTuple):
    """A named number or array at the border of a program."""

    name: str  # dotted, as in `agvjax.leaves`
    shape: tuple[int, ...]
    variables: tuple[Operand, ...]  # one for each element, in C order

    @property
    def member(self) -> str:
        """Its name in C."""
        return self.name.replace(".", "_")

    @property
    def elements(self) -> list[tuple[str, Operand]]:
        """What follows the name of the array for each element, as [0][1], nothing for a number; and its variable."""
        places = ("".join(f"[{i}]" for i in index) for index in np.ndindex(self.shape))
        return list(zip(places, self.variables, strict=True))


class Program(NamedTuple):
    """Arguments, operations in order, and results; groups of fields by what they are."""

    arguments: dict[str, tuple[Field, ...]]
    operations: tuple[Statement, ...]
    results: dict[str, tuple[Field, ...]]

    @property
    def read(self) -> set[Operand]:
        """What operations and results take."""
        results = [v for fields in self.results.values() for field in fields for v in field.variables]
        return Block(self.operations, tuple(results)).taken

    @property
    def given(self) -> str:
        """The group of what is asked for: `reference`, or the `route` of a law that follows one."""
        return list(self.arguments)[-1]


def examples(controller: Sampled) -> tuple[PyTree, Measurement, PyTree]:
    """State, measurement, and reference or the sizes of a route, of the right shapes."""
    zero, pair = jnp.zeros(()), jnp.zeros(2)
    vehicle = controller.vehicle
    now = vehicle.output(vehicle.start(agvjax.Start()), dict.fromkeys(vehicle.actuators, zero))
    angle = None if now.steering_angle is None else zero
    seen = agvjax.Measurement(position=pair, velocity=pair, heading=zero, yaw_rate=zero, steering_angle=angle)
    if controller.follows():
        given = tables.Sizes(pieces=zero, legs=zero, closed=zero, length=zero, reached=zero)
        state = jax.eval_shape(lambda m, sizes: guard.begun(controller, m, tables.asked(sizes)), seen, given)
        return jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), state), seen, given
    reference = Reference(position=pair, velocity=pair, acceleration=pair, heading=zero, heading_rate=zero)
    return guard.begun(controller, seen, reference), seen, reference


def step(controller: Sampled) -> Program:
    """One period: the state afterwards, the inputs of the actuators, whether anything was limited, the status."""
    state, measurement, given = examples(controller)
    arguments = {"gains": controller, "state": state, "measurement": measurement, _given(controller): given}

    def function(law: Sampled, state: PyTree, measurement: Measurement, given: PyTree) -> Json:
        return guard.step(law, state, measurement, _asked(controller, given))

    return program_of(function, arguments)


def start(controller: Sampled) -> Program:
    """The state of a law that starts now."""
    _, measurement, given = examples(controller)
    arguments = {"gains": controller, "measurement": measurement, _given(controller): given}

    def function(law: Sampled, measurement: Measurement, given: PyTree) -> Json:
        return {"state": guard.start(law, measurement, _asked(controller, given))}

    return program_of(function, arguments)


def _given(controller: Sampled) -> str:
    return "route" if controller.follows() else "reference"


def _asked(controller: Sampled, given: PyTree) -> Reference:
    return tables.asked(given) if controller.follows() else given


def program_of(function: Callable[..., PyTree], arguments: Json) -> Program:
    """A function of trees of numbers, by the names of its arguments; its result is trees by the names of their groups.

    Raises:
        ValueError: it cannot be taken apart into numbers.
    """
    trees = tuple(jax.tree.map(jnp.asarray, tree) for tree in arguments.values())
    numbers, _ = scalarise(function, *trees)
    closed = jax.make_jaxpr(numbers)(*(split_tree(tree) for tree in trees))
    for equation in closed.jaxpr.eqns:
        name, atoms = equation.primitive.name, (*equation.invars, *equation.outvars)
        if name not in GATHERED | INLINED and any(v.aval.shape for v in atoms):
            raise ValueError(f"the law uses {name} on arrays, which cannot be taken apart into numbers")
    fields = {group: _fields(group, tree) for group, tree in zip(arguments, trees, strict=True)}
    names = [str(name) for group in fields.values() for field in group for name in field.variables]
    if odd := [name for name in names if not name.isidentifier() or names.count(name) > 1]:
        raise ValueError(f"the law calls a number {odd[0][2:42]!r}, which is no name, or that of two")
    writer = Writer(data=[str(name) for field in fields.get("route", ()) for name in field.variables])
    taken = iter(outputs := writer.run(closed, names))
    results = {
        group: tuple(f._replace(variables=tuple(next(taken) for _ in f.variables)) for f in _fields(group, tree))
        for group, tree in jax.eval_shape(function, *trees).items()
    }
    operations = kept(writer.written, outputs)
    if any(operation.params.get("table") == tables.CORRIDOR for operation in flat(operations)):
        raise ValueError("the law looks at the corridor of the route, which is not exported")
    return Program(fields, operations, results)


def _fields(group: str, tree: PyTree) -> tuple[Field, ...]:
    """The leaves of a tree, their elements named after them."""
    fields = []
    for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
        name, shape = jax.tree_util.keystr(path, simple=True, separator="."), tuple(np.shape(leaf))
        places = ("".join(f"_{i}" for i in index) for index in np.ndindex(shape))
        fields.append(Field(name, shape, tuple(f"{group[0]}_{name.replace('.', '_')}{place}" for place in places)))
    return tuple(fields)
