"""The one law as a straight line of scalar operations: its jaxpr with arrays taken apart, nothing written twice."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core
from jaxtyping import PyTree

import agvjax
from agvjax import Measurement, Sampled
from agvjax.engine.scalarise import scalarise, split_tree
from agvjax.messages import Reference

from ..io.files import Json
from . import guard

SAME = frozenset({"copy", "copy_p", "stop_gradient", "optimization_barrier"})
GATHERED = frozenset({"broadcast_in_dim", "concatenate", "reshape", "slice", "squeeze", "stack"})  # around a whole one
INLINED = frozenset({"jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call"})
Operand = str | float | bool


class Operation(NamedTuple):
    """One scalar operation: name = primitive(inputs)."""

    name: str
    primitive: str
    inputs: tuple[Operand, ...]
    params: Json
    flag: bool  # whether it is a truth value; else a real number


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
    operations: tuple[Operation, ...]
    results: dict[str, tuple[Field, ...]]

    @property
    def read(self) -> set[Operand]:
        """What operations and results take."""
        taken = {v for operation in self.operations for v in operation.inputs}
        return taken | {v for fields in self.results.values() for field in fields for v in field.variables}


def examples(controller: Sampled) -> tuple[PyTree, Measurement, Reference]:
    """State, measurement and reference of the right shapes."""
    zero, pair = jnp.zeros(()), jnp.zeros(2)
    vehicle = controller.vehicle
    now = vehicle.output(vehicle.start(agvjax.Start()), dict.fromkeys(vehicle.actuators, zero))
    angle = None if now.steering_angle is None else zero
    seen = agvjax.Measurement(position=pair, velocity=pair, heading=zero, yaw_rate=zero, steering_angle=angle)
    reference = Reference(position=pair, velocity=pair, acceleration=pair, heading=zero, heading_rate=zero)
    return controller.inner.init(seen, reference), seen, reference


def step(controller: Sampled) -> Program:
    """One period: the state afterwards, the inputs of the actuators, whether anything was limited, the status."""
    state, measurement, reference = examples(controller)
    arguments = {"gains": controller, "state": state, "measurement": measurement, "reference": reference}
    return _program(guard.step, arguments)


def start(controller: Sampled) -> Program:
    """The state of a law that starts now."""
    _, measurement, reference = examples(controller)
    arguments = {"gains": controller, "measurement": measurement, "reference": reference}
    return _program(lambda *now: {"state": guard.start(*now)}, arguments)


def _program(function: Callable[..., PyTree], arguments: Json) -> Program:
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
    values: dict[PyTree, Operand] = dict(zip(closed.jaxpr.invars, names, strict=True))
    values |= zip(closed.jaxpr.constvars, map(_constant, closed.consts), strict=True)
    writer = _Writer()
    outputs = iter(writer.run(closed.jaxpr, values))
    results = {
        group: tuple(f._replace(variables=tuple(next(outputs) for _ in f.variables)) for f in _fields(group, tree))
        for group, tree in jax.eval_shape(function, *trees).items()
    }
    return Program(fields, writer.used(results), results)


def _fields(group: str, tree: PyTree) -> tuple[Field, ...]:
    """The leaves of a tree, their elements named after them."""
    fields = []
    for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
        name, shape = jax.tree_util.keystr(path, simple=True, separator="."), tuple(np.shape(leaf))
        places = ("".join(f"_{i}" for i in index) for index in np.ndindex(shape))
        fields.append(Field(name, shape, tuple(f"{group[0]}_{name.replace('.', '_')}{place}" for place in places)))
    return tuple(fields)


def _constant(value: PyTree) -> Operand:
    array = np.asarray(value)
    return bool(array) if array.dtype == bool else float(array)


class _Writer:
    """Collects operations, each distinct one once."""

    def __init__(self) -> None:
        self.operations: list[Operation] = []
        self.seen: dict[PyTree, str] = {}

    def run(self, jaxpr: core.Jaxpr, values: dict[PyTree, Operand]) -> list[Operand]:
        """All equations of a jaxpr on scalars, calls inlined; its results."""

        def read(atom: core.Var | core.Literal) -> Operand:
            return _constant(atom.val) if isinstance(atom, core.Literal) else values[atom]

        for equation in jaxpr.eqns:
            name, inputs = equation.primitive.name, [read(v) for v in equation.invars]
            if name in INLINED:
                inner: PyTree = equation.params.get("jaxpr", equation.params.get("call_jaxpr"))
                consts = dict(zip(inner.jaxpr.constvars, map(_constant, inner.consts), strict=True))
                outputs = self.run(inner.jaxpr, consts | dict(zip(inner.jaxpr.invars, inputs, strict=True)))
                values |= zip(equation.outvars, outputs, strict=True)
            elif name in SAME:
                values |= zip(equation.outvars, inputs, strict=True)
            else:
                values[equation.outvars[0]] = self.write(equation, name, inputs)
        return [read(v) for v in jaxpr.outvars]

    def write(self, equation: core.JaxprEqn, name: str, inputs: list[Operand]) -> Operand:
        """One operation; what is there already is not computed again."""
        aval: PyTree = equation.outvars[0].aval
        if aval.shape != () or len(equation.outvars) > 1:
            raise ValueError(f"the law uses {name} on arrays, which cannot be taken apart into numbers")
        flag = aval.dtype == bool
        if not flag and not jnp.issubdtype(aval.dtype, jnp.floating):
            raise ValueError(f"the law uses {name} with a result of type {aval.dtype}, where only real numbers can be")
        source: PyTree = equation.invars[0].aval if equation.invars else aval
        if name == "convert_element_type" and flag == (source.dtype == bool):
            return inputs[0]
        params = {key: equation.params[key] for key in ("y", "rounding_method") if key in equation.params}
        key = name, tuple(map(repr, inputs)), tuple(map(repr, params.items()))
        if key not in self.seen:
            self.seen[key] = f"v{len(self.operations)}"
            self.operations.append(Operation(self.seen[key], name, tuple(inputs), params, bool(flag)))
        return self.seen[key]

    def used(self, results: dict[str, tuple[Field, ...]]) -> tuple[Operation, ...]:
        """The operations that something comes of."""
        wanted = {v for fields in results.values() for field in fields for v in field.variables}
        kept = []
        for operation in reversed(self.operations):
            if operation.name in wanted:
                wanted |= set(operation.inputs)
                kept.append(operation)
        return tuple(kept[::-1])
