"""Laws are written with short vectors; compilers want scalars. This rewrites the one into the other.

A step of the closed loop works on arrays of shape (2,), (3,) or (5,). Batched over scenarios they become (B, 2) or
(B, 5), and the compiler makes kernels of many shapes out of one step, with reductions over short axes between them.
Rewritten so that every number is an array of its own, all have the shape (B,) and fuse. The arithmetic is the same.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend import core
from jaxtyping import PyTree

from .elementary import exp_p
from .once import Once, Scalar, extreme, plain

ELEMENTWISE = frozenset(
    "abs add add_any and atan2 ceil clamp convert_element_type copy cos cosh div eq exp exp2 expm1 floor ge gt "
    "integer_pow is_finite le log log1p logistic lt max min mul ne neg not or pow rem round rsqrt select_n sign sin "
    "sinh sqrt square stop_gradient sub tan tanh xor".split()
)
CALLS = frozenset({"pjit", "jit", "closed_call", "core_call"})
MOST_SCALARS = 128  # in the state of a loop; with more (many adapted weights) compiling takes longer than it saves
Shape = tuple[int, ...]
Scalars = np.ndarray  # of dtype object: one scalar in each place


def split(x: Scalar) -> Scalars:
    """An array as an object array of its scalars."""
    shape = np.shape(x)
    out = np.empty(shape, object)
    for i in np.ndindex(shape):
        out[i] = np.asarray(x[i]) if isinstance(x, np.ndarray) else x[i] if isinstance(x, jax.Array) and shape else x
    return out


def is_whole(x: Scalars) -> bool:
    """Whether an array has been left as it is, a table that is looked up in."""
    return x.dtype != object


def kept(x: Scalar) -> Scalars:
    """An array as its scalars, or where these are too many as it is."""
    whole: Any = x
    return whole if np.size(x) > MOST_SCALARS else split(x)


def join(x: Scalars) -> Scalar:
    """The array again."""
    if is_whole(x):
        return x
    return x[()] if not x.shape else jnp.stack([jnp.asarray(v) for v in x.ravel()]).reshape(x.shape)


def _each(function: Callable[..., Scalar], inputs: Sequence[Scalars]) -> Scalars:
    arrays = np.broadcast_arrays(*inputs)
    out = np.empty(arrays[0].shape, object)
    for i in np.ndindex(out.shape):
        out[i] = function(*(a[i] for a in arrays))
    return out


def _reduce(combine: Callable[..., Scalar], x: Scalars, axes: tuple[int, ...], once: Once) -> Scalars:
    kept = [i for i in range(x.ndim) if i not in axes]
    x = np.transpose(x, [*kept, *axes]).reshape([x.shape[i] for i in kept] + [-1])
    out = np.empty(x.shape[:-1], object)
    for i in np.ndindex(out.shape):
        total = x[i][0]
        for term in x[i][1:]:
            total = combine(once, total, term)
        out[i] = total
    return out


def _broadcast(x: Scalars, *, shape: Shape, broadcast_dimensions: Shape, **_: object) -> Scalars:
    into = [1] * len(shape)
    for axis, size in zip(broadcast_dimensions, x.shape, strict=True):
        into[axis] = size
    return np.broadcast_to(x.reshape(into), shape)


def _slice(x: Scalars, *, start_indices: Shape, limit_indices: Shape, strides: Shape | None, **_: object) -> Scalars:
    strides = strides or (1,) * x.ndim
    return x[tuple(slice(*s) for s in zip(start_indices, limit_indices, strides, strict=True))]


STRUCTURAL: dict[str, Callable[..., Scalars]] = {
    "broadcast_in_dim": _broadcast,
    "concatenate": lambda *x, dimension, **_: np.concatenate(x, axis=dimension),
    "expand_dims": lambda x, *, dimensions, **_: np.expand_dims(x, dimensions),
    "reshape": lambda x, *, new_sizes, **_: x.reshape(new_sizes),
    "rev": lambda x, *, dimensions, **_: np.flip(x, dimensions),
    "slice": _slice,
    "squeeze": lambda x, *, dimensions, **_: np.squeeze(x, dimensions),
    "stack": lambda *x, axis, **_: np.stack(x, axis),
    "transpose": lambda x, *, permutation, **_: np.transpose(x, permutation),
}


CHEAPER: dict[str, Callable[..., Scalar]] = {
    "exp": lambda once, x: once.bind(exp_p, {}, (x,)),
    "max": extreme(lax.max_p, lax.gt_p),
    "min": extreme(lax.min_p, lax.lt_p),
}
REDUCTIONS = {"reduce_max": CHEAPER["max"], "reduce_min": CHEAPER["min"], "reduce_sum": plain(lax.add_p)}
REDUCTIONS |= {"reduce_and": plain(lax.and_p), "reduce_or": plain(lax.or_p)}


def _apply(equation: core.JaxprEqn, jaxpr: core.Jaxpr, inputs: list[Scalars], once: Once) -> list[Scalars]:
    name, params = equation.primitive.name, equation.params
    if name in CALLS:
        inner = params["jaxpr"] if "jaxpr" in params else params["call_jaxpr"]
        return _interpret(inner.jaxpr, [kept(c) for c in inner.consts], inputs, once)
    if name == "cond":
        return _cond(equation, inputs)
    if any(map(is_whole, inputs)):
        return [kept(x) for x in _whole(equation, jaxpr)(*(join(x) for x in inputs))]
    if name in CHEAPER:
        return [_each(functools.partial(CHEAPER[name], once), inputs)]
    if name in ELEMENTWISE:
        return [_each(lambda *x: once.bind(equation.primitive, params, x), inputs)]
    if name in REDUCTIONS:
        return [_reduce(REDUCTIONS[name], inputs[0], params["axes"], once)]
    if name in STRUCTURAL:
        return [STRUCTURAL[name](*inputs, **params)]
    return [split(x) for x in _whole(equation, jaxpr)(*(join(x) for x in inputs))]


def _cond(equation: core.JaxprEqn, inputs: list[Scalars]) -> list[Scalars]:
    """A branch, its numbers kept apart: stacked for it they would have to be taken apart again."""
    index, *operands = inputs
    shapes: list[Shape | None] = [None if is_whole(x) else x.shape for x in operands]
    avals: list[Any] = [v.aval for v in equation.outvars]

    def scalar(branch: core.ClosedJaxpr) -> Callable[..., list[Scalar]]:
        def run(*numbers: Scalar) -> list[Scalar]:
            out = _interpret(branch.jaxpr, [kept(c) for c in branch.consts], _regroup(numbers, shapes), Once())
            each = [(v, aval.dtype) for x, aval in zip(out, avals, strict=True) for v in x.ravel()]
            return [jnp.asarray(v, dtype) if isinstance(v, np.generic | np.ndarray) else v for v, dtype in each]

        return run

    numbers = [v for x in operands for v in ([x] if is_whole(x) else x.ravel())]
    out = lax.switch(index[()], [scalar(branch) for branch in equation.params["branches"]], *numbers)
    return _regroup(out, [aval.shape for aval in avals])


def _regroup(numbers: Sequence[Scalar], shapes: Sequence[Shape | None]) -> list[Scalars]:
    """Scalars in a row as arrays of these shapes; None stands for an array that was left whole."""
    arrays, at = [], 0
    for shape in shapes:
        n = 1 if shape is None else int(np.prod(shape))
        part = np.empty(n, object)
        for i in range(n):  # one by one: NumPy would try to look into the tracers
            part[i] = numbers[at + i]
        arrays.append(part[0] if shape is None else part.reshape(shape))
        at += n
    return arrays


def _whole(equation: core.JaxprEqn, jaxpr: core.Jaxpr) -> Callable[..., list[Scalar]]:
    """Any other equation as it stands, on whole arrays: run from a jaxpr of its own it keeps custom derivatives."""
    inputs: list[Any] = [core.Var(v.aval) if isinstance(v, core.Literal) else v for v in equation.invars]
    names = {"constvars": [], "invars": inputs, "outvars": equation.outvars, "eqns": [equation.replace(invars=inputs)]}
    alone = jaxpr.replace(**names, effects=equation.effects)
    return core.jaxpr_as_fun(core.ClosedJaxpr(alone, []))


def _interpret(jaxpr: core.Jaxpr, consts: Sequence[Scalars], inputs: Sequence[Scalars], once: Once) -> list[Scalars]:
    known = dict(zip([*jaxpr.constvars, *jaxpr.invars], [*consts, *inputs], strict=True))

    def read(atom: core.Var | core.Literal) -> Scalars:
        return kept(np.asarray(atom.val)) if isinstance(atom, core.Literal) else known[atom]

    for equation in jaxpr.eqns:
        known |= zip(equation.outvars, _apply(equation, jaxpr, [read(v) for v in equation.invars], once), strict=True)
    return [read(v) for v in jaxpr.outvars]


def _used(jaxpr: core.Jaxpr) -> list[core.JaxprEqn]:
    """The equations that something comes of."""
    wanted, used = {v for v in jaxpr.outvars if not isinstance(v, core.Literal)}, []
    for equation in reversed(jaxpr.eqns):
        if equation.effects or not wanted.isdisjoint(equation.outvars):
            wanted.update(v for v in equation.invars if not isinstance(v, core.Literal))
            used.append(equation)
    return used[::-1]


def _constants(equation: core.JaxprEqn, jaxpr: core.Jaxpr, inputs: tuple[Scalar, ...], once: Once) -> list[Scalar]:
    """An equation on constants; once, or the loop would carry two numbers, and then all that follows from them."""
    name = equation.primitive.name
    if name in STRUCTURAL and not any(isinstance(x, jax.Array) for x in inputs):
        return [STRUCTURAL[name](*map(np.asarray, inputs), **equation.params)]
    simple = name in ELEMENTWISE
    outputs = once.bind(equation.primitive, equation.params, inputs, None if simple else _whole(equation, jaxpr))
    return [outputs] if simple else outputs


def _hoist(closed: core.ClosedJaxpr) -> tuple[core.Jaxpr, list[Scalars]]:
    """What depends on constants alone, computed here and once: a jaxpr without it, and its longer list of constants."""
    jaxpr, known, rest, once = closed.jaxpr, dict(zip(closed.jaxpr.constvars, closed.consts, strict=True)), [], Once()
    for equation in _used(jaxpr):
        if all(isinstance(v, core.Literal) or v in known for v in equation.invars) and not equation.effects:
            inputs = [v.val if isinstance(v, core.Literal) else known[v] for v in equation.invars]
            known |= zip(equation.outvars, _constants(equation, jaxpr, tuple(inputs), once), strict=True)
        else:
            rest.append(equation)
    read = {v for equation in rest for v in equation.invars if not isinstance(v, core.Literal)}
    wanted = [v for v in known if v in read or v in jaxpr.outvars]  # the others would be split for nothing
    numbers = {id(x): kept(x) for x in (known[v] for v in wanted)}  # one constant under two names is one
    return jaxpr.replace(constvars=wanted, eqns=rest), [numbers[id(known[v])] for v in wanted]


def split_tree(tree: PyTree) -> PyTree:
    """A tree of arrays as a tree of lists of scalars."""
    return jax.tree.map(lambda x: list(split(x).ravel()), tree)


def scalarise(
    function: Callable[..., PyTree], *example: PyTree
) -> tuple[Callable[..., PyTree], Callable[[PyTree], PyTree]]:
    """`function` on trees of arrays, rewritten for trees of scalars as `split_tree` makes them.

    Args:
        function: takes and returns trees of arrays.
        example: arguments of the right shapes; constants the function closes over are split here, once.

    Returns:
        The rewritten function, and `pack`, which turns its result back into the tree of arrays.
    """
    closed, shapes = jax.make_jaxpr(function, return_shape=True)(*example)
    jaxpr, consts = _hoist(closed)
    places = [np.shape(x) for x in jax.tree.leaves(example)]
    treedef = jax.tree.structure(shapes)

    def rewritten(*numbers: PyTree) -> PyTree:
        out = _interpret(jaxpr, consts, _regroup(jax.tree.leaves(numbers), places), Once())
        return jax.tree.unflatten(treedef, [list(x.ravel()) for x in out])

    def pack(numbers: PyTree) -> PyTree:
        flat, leaves = jax.tree.leaves(numbers), []
        for leaf in jax.tree.leaves(shapes):
            n = int(np.prod(leaf.shape))
            leaves.append(jnp.stack(flat[:n]).reshape(leaf.shape) if leaf.shape else flat[0])
            flat = flat[n:]
        return jax.tree.unflatten(treedef, leaves)

    return rewritten, pack
