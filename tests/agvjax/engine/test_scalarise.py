"""The rewriting of vectors into scalars changes no value and no derivative."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from agvjax.engine.scalarise import join, scalarise, split, split_tree


@jax.custom_jvp
def odd(x):
    return x**3


@odd.defjvp
def odd_jvp(primals, tangents):
    return odd(primals[0]), 7 * tangents[0]  # wrong on purpose: a rewriting that looked inside would lose it


CONSTANT = np.arange(6.0).reshape(2, 3)


def arithmetic(x, y, M):
    both = jnp.concatenate([x, y[::-1]])
    stacked = jnp.stack([x, jnp.where(y > 0, y, -2 * x)], axis=1)
    return {
        "sum": jnp.sum(stacked, axis=0),
        "all": jnp.prod(1 + both**2),
        "outer": x[:, None] * y[None, :] + M,
        "max": both.max(),
    }


def linear(x, y, M):
    return M @ x + y @ M, M.T[0], jnp.einsum("ij,ij->", M, M), jnp.broadcast_to(x[:1], (4,)), jnp.asarray(CONSTANT) @ x


def accumulating(x, y, M):
    return (
        jnp.cumsum(x) * jnp.cumsum(y[::-1])[::-1],
        jnp.sort(y),
        jnp.min(M, axis=(0, 1)),
        jnp.argmax(x),
        M[1, ::2],
        jnp.mean(M),
    )


def elementary(x, y, M):
    smooth = jnp.sin(x) + jnp.arctan2(y, x) * jnp.exp(-jnp.abs(y)) + jnp.tanh(x) ** 2 / jnp.sqrt(1 + y**2)
    return (
        smooth,
        jnp.clip(M, -0.5, 0.5),
        jnp.sign(y) * jnp.maximum(x, y),
        jnp.round(10 * x),
        jnp.linalg.norm(M[0]),
        jnp.log1p(x * x),
    )


def custom(x, y, M):
    return jax.nn.relu(x), jax.nn.softplus(y), odd(x), jnp.hypot(x, y), jax.nn.silu(M)


def branching(x, y, M):
    chosen = jax.lax.cond(x[0] > 0, lambda v: v * 2, lambda v: v - 1, y)
    looped = jax.lax.fori_loop(0, 3, lambda i, v: v + jnp.sin(v), x)
    return chosen, looped, jax.lax.select(y > 0, x, y), x[jnp.array([2, 0])]


def scalars(x, y, M):
    return x[0] * y[1], (jnp.float64(2.0) * M[0, 0], x > y), ()


FUNCTIONS = [arithmetic, linear, accumulating, elementary, custom, branching, scalars]
INPUTS = [np.random.default_rng(seed) for seed in range(3)]
INPUTS = [(r.normal(size=3), r.normal(size=3), r.normal(size=(3, 3))) for r in INPUTS]


def rewritten(function):
    """The rewritten function on the original's arguments."""
    new, pack = scalarise(function, *map(jnp.asarray, INPUTS[0]))
    return lambda *arguments: pack(new(*split_tree(arguments)))


def same(a, b):
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for left, right in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert left.shape == right.shape and left.dtype == right.dtype
        np.testing.assert_allclose(left, right, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("function", FUNCTIONS)
def test_value_is_the_originals(function):
    new = jax.jit(rewritten(function))
    for arguments in INPUTS:  # the branches taken differ between them
        arguments = tuple(map(jnp.asarray, arguments))
        same(new(*arguments), function(*arguments))


@pytest.mark.parametrize("function", FUNCTIONS)
def test_derivatives_are_the_originals(function):
    def real(f):
        return lambda *a: [x for x in jax.tree.leaves(f(*a)) if jnp.issubdtype(x.dtype, jnp.floating)]

    old, new = real(function), real(rewritten(function))
    arguments = tuple(map(jnp.asarray, INPUTS[1]))
    tangents = tuple(map(jnp.asarray, INPUTS[2]))
    same(jax.jvp(new, arguments, tangents)[1], jax.jvp(old, arguments, tangents)[1])
    if function is branching:
        return  # a fori_loop with a known count has a reverse mode only as a scan; forward is what it promises
    same(jax.vjp(new, *arguments)[1](new(*arguments)), jax.vjp(old, *arguments)[1](old(*arguments)))


def test_a_custom_derivative_is_kept():
    slope = jax.grad(lambda x: rewritten(custom)(x, jnp.ones(3), jnp.ones((3, 3)))[2].sum())(jnp.ones(3))
    np.testing.assert_array_equal(slope, [7.0, 7.0, 7.0])


def test_the_rewriting_maps_over_a_batch():
    x, y, M = (jnp.stack([jnp.asarray(a[i]) for a in INPUTS]) for i in range(3))
    for function in (arithmetic, elementary, branching):
        same(jax.vmap(rewritten(function))(x, y, M), jax.vmap(function)(x, y, M))


def test_join_is_the_inverse_of_split():
    for x in (jnp.array(3.0), jnp.arange(4.0), jnp.arange(6).reshape(2, 3)):
        same(join(split(x)), x)


def largest(x, y):
    return jnp.stack([x, y]).max(axis=0)


EXTREMES = [(jnp.maximum, np.maximum), (jnp.minimum, np.minimum), (largest, np.maximum)]


@pytest.mark.parametrize(("extreme", "plain"), EXTREMES)
def test_the_larger_of_two_numbers_has_its_slope_whatever_it_is_rounded_to(extreme, plain):
    """JAX asks which of both equals the result: where the compiler rounds it in two ways, neither does."""
    x, y = jnp.array([1.0, 2.0, jnp.nan, 3.0]), jnp.array([2.0, 1.0, 0.0, jnp.nan])
    rewritten, pack = scalarise(lambda x, y: extreme(x, y), x, y)

    def function(x, y):
        return pack(rewritten(split_tree(x), split_tree(y)))

    along = jnp.full(4, 10.0), jnp.full(4, 20.0)
    value, slope = jax.jvp(function, (x, y), along)
    np.testing.assert_array_equal(value, plain(x, y))
    np.testing.assert_array_equal(slope[:2], np.where(plain(x, y) == y, 20, 10)[:2])
    assert " eq " not in str(jax.make_jaxpr(lambda *x: jax.jvp(function, x, along))(x, y))


@pytest.mark.parametrize(("bound", "plain"), [(jnp.maximum, np.maximum), (jnp.minimum, np.minimum)])
def test_a_bound_keeps_its_value_and_lets_nan_through(bound, plain):
    x = jnp.array([-2.0, -0.0, 0.0, 3.0, jnp.nan])
    for function in (lambda v: bound(v, 0.5), lambda v: bound(0.5, v), lambda v: bound(v, v[::-1])):
        rewritten, pack = scalarise(function, x)
        np.testing.assert_array_equal(pack(rewritten(split_tree(x))), function(x))
    np.testing.assert_array_equal(bound(x, 0.5), plain(np.asarray(x), 0.5))


def test_what_follows_from_constants_is_computed_once_however_often_it_is_written():
    k = jnp.array([1.0, 2.0, 3.0])

    def law(x):
        return jnp.sum(jnp.exp(x[0] * (k[None, :] - 0.5)[0]))

    rewritten, _ = scalarise(lambda x: (law(x), 2 * law(x)), jnp.ones(2))
    text = str(jax.make_jaxpr(rewritten)(split_tree(jnp.ones(2))))
    assert text.count("agvjax_exp") == 3
