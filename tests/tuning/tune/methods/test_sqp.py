"""The sequential quadratic tuner on problems whose solution is known, against SciPy, and where there is none."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import LinearConstraint, linprog, minimize

from tuning import Objective, Requirement, within
from tuning.tune.methods import sqp
from tuning.tune.methods.quadratic import Columns

MEAN, WORST = (Requirement("total_rmse", "mean", 1.0),), (Requirement("total_rmse", "worst", 1.0),)
EFFORT = (Requirement("effort", "mean", 1.0),)  # a limit
SOUND = np.array([True])  # of the only run


pytestmark = pytest.mark.usefixtures("promotion_as_optax_has_it")


def descend(model, start, objective, iterations=80):
    """Drive the search on a hand-made model: z -> (values (M, B), slopes (K, M, B)), reference 1."""
    z = np.asarray(start, float)
    values, _ = model(z)
    reference, ok = np.ones((3, values.shape[0])), np.ones(values.shape[1], bool)
    state = sqp.State.begin(len(start), *values.shape, objective.penalty)
    for looks in range(1, iterations + 1):
        values, slopes = model(z)
        levels = np.asarray(objective.levels(jnp.asarray(values), jnp.asarray(ok), reference))
        z, state = sqp.step(state, z, levels, (values, ok, slopes), objective, reference)
        if state.converged:
            return state, looks
    return state, iterations


def test_it_stops_on_the_limit():
    # the point of z1 + z2 <= 1 nearest to (1, 2) is (0, 1)
    def model(z):
        goal = (z[0] - 1) ** 2 + (z[1] - 2) ** 2
        values = np.array([[goal], [z[0] + z[1]]])
        return values, np.array([[[2 * (z[0] - 1)], [1.0]], [[2 * (z[1] - 2)], [1.0]]])

    state, looks = descend(model, (0.0, 0.0), Objective(MEAN, EFFORT, penalty=10.0))
    np.testing.assert_allclose(state.center, [0.0, 1.0], atol=1e-2)
    np.testing.assert_allclose(state.goal, 2.0, rtol=1e-4)
    assert state.over < 1e-6 and looks < 20


def test_it_balances_the_worst():
    centers = np.array([-1.0, 2.0])  # the largest of (z + 1)^2 and (z - 2)^2 is least half-way

    def model(z):
        return (z[0] - centers)[None, :] ** 2, 2 * (z[0] - centers)[None, None, :]

    state, _ = descend(model, (3.0,), Objective(WORST, ()))
    np.testing.assert_allclose(state.center, [0.5], atol=1e-3)


def test_slopes_promise_nothing_at_an_optimum_and_their_fall_elsewhere():
    # of (z - 1)^2 + 1 at 3: 5 and slope 4, so within .25 it falls by 1 of 5; of the two parabolas above, at .5, neither
    # way lowers both
    def at(z, values, slopes, objective):
        state = sqp.State.begin(1, *values.shape, 1.0)
        levels = objective.levels(jnp.asarray(values), jnp.ones(values.shape[1], bool), np.ones((3, 1)))
        model = (values, np.ones(values.shape[1], bool), slopes)
        _, state = sqp.step(state, np.array(z), np.asarray(levels), model, objective, np.ones((3, 1)))
        return sqp.promise(state, objective, np.ones((3, 1)))

    one, two = Objective(MEAN, ()), Objective(WORST, ())
    np.testing.assert_allclose(at([3.0], np.array([[5.0]]), np.array([[[4.0]]]), one), 4 * sqp.FIRST / 5, rtol=1e-6)
    np.testing.assert_allclose(at([1.0], np.array([[1.0]]), np.array([[[0.0]]]), one), 0.0, atol=1e-6)
    assert at([0.0], np.array([[0.0]]), np.array([[[1.0]]]), one) == 0.0  # a corridor that is never left
    np.testing.assert_allclose(at([0.5], np.array([[2.25, 2.25]]), np.array([[[3.0, -3.0]]]), two), 0.0, atol=1e-6)


def test_it_learns_what_is_curved():
    """Rosenbrock's valley inside a disc: steps that are linear alone creep along it."""

    def model(z):
        x, y = z
        values = np.array([[1 + (1 - x) ** 2 + 100 * (y - x**2) ** 2], [(x**2 + y**2)]])
        return values, np.array([[[-2 * (1 - x) - 400 * x * (y - x**2)], [2 * x]], [[200 * (y - x**2)], [2 * y]]])

    state, looks = descend(model, (-0.5, 0.6), Objective(MEAN, EFFORT, penalty=10.0), 120)
    disc = {"type": "ineq", "fun": lambda z: 1 - z @ z}
    wanted = minimize(lambda z: model(z)[0][0, 0], (0.5, 0.5), method="SLSQP", constraints=disc, tol=1e-12)
    np.testing.assert_allclose(state.center, wanted.x, atol=5e-3)
    assert looks < 80


@pytest.mark.parametrize("least", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("statistic", ["mean", "worst", "cvar"])
def test_its_model_is_the_linear_programme_that_scipy_solves(statistic, least):
    random = np.random.default_rng(3)
    values, slopes = 1 + random.random((2, 7)), random.normal(size=(3, 2, 7))
    values[1] *= -1 if least else 1
    bound = Requirement("effort", statistic, 1.7, True, True) if least else Requirement("effort", statistic, 1.2)
    goals, limits = (Requirement("total_rmse", statistic, 2.0),), (bound,)
    objective, ok, ones = Objective(goals, limits, tail=0.3), np.ones(7, bool), np.ones((3, 2))
    found = sqp.solve((values, ok, slopes), objective, ones, radius=0.2)

    def cost(d):
        linear = values + np.tensordot(d, slopes, 1)
        level = np.asarray(objective.levels(jnp.asarray(linear), jnp.asarray(ok), ones))
        return 2 * level[0] + objective.penalty * max(level[1] - 1, 0)

    np.testing.assert_allclose(cost(found.change), found.cost, rtol=1e-6)  # what is promised is what the model gives
    for direction in random.normal(size=(300, 3)):  # and no neighbour, nor any corner of the region, is better
        near = np.clip(found.change + 1e-3 * direction, -0.2, 0.2)
        assert cost(near) >= found.cost - 1e-7
        assert cost(0.2 * np.sign(direction)) >= found.cost - 1e-7


def test_prices_are_the_duals_that_scipy_finds():
    slope, limit = np.array([-1.0, -2.0]), np.array([1.0, 1.0])
    values = np.array([[1.0], [0.95]])
    slopes = np.array([[[slope[0]], [limit[0]]], [[slope[1]], [limit[1]]]])
    found = sqp.solve((values, SOUND, slopes), Objective(MEAN, EFFORT, penalty=50.0), np.ones((3, 2)), radius=0.1)
    wanted = linprog(slope, limit[None], [0.05], bounds=[(-0.1, 0.1)] * 2)
    np.testing.assert_allclose(found.change, wanted.x, atol=1e-7)
    np.testing.assert_allclose(found.prices, -wanted.ineqlin.marginals, rtol=1e-6)


def test_curvature_enters_as_scipy_has_it():
    hessian, slope = np.array([[4.0, 1.0], [1.0, 3.0]]), np.array([-1.0, 2.0])
    look = np.ones((1, 1)), SOUND, slope[:, None, None]
    found = sqp.solve(look, Objective(MEAN, ()), np.ones((3, 1)), 0.3, hessian)
    box = {"constraints": LinearConstraint(np.eye(2), -0.3, 0.3), "method": "trust-constr", "tol": 1e-12}
    wanted = minimize(lambda d: slope @ d + d @ hessian @ d / 2, np.zeros(2), **box)
    np.testing.assert_allclose(found.change, wanted.x, atol=1e-5)


def test_the_curvature_learned_fits_the_last_step_and_stays_positive():
    random = np.random.default_rng(0)
    truth = np.diag([1.0, 5.0, 20.0])
    hessian = 1e-3 * np.eye(3)
    for change in random.normal(size=(20, 3)):
        hessian = sqp.curved(hessian, change, truth @ change)
        assert np.linalg.eigvalsh(hessian).min() > 0
    np.testing.assert_allclose(hessian @ change, truth @ change, rtol=1e-9)  # the secant condition
    bent = sqp.curved(hessian, np.array([1.0, 0.0, 0.0]), np.array([-5.0, 0.0, 0.0]))  # downward: damped
    assert np.linalg.eigvalsh(bent).min() > 0


def test_a_useless_look_is_stepped_back_from():
    objective, reference = Objective(MEAN, ()), np.ones((3, 1))
    state = sqp.State.begin(1, 1, 1, 3.0)
    good = (np.array([[1.0]]), SOUND, np.array([[[1.0]]]))
    z, state = sqp.step(state, np.array([0.0]), np.array([1.0]), good, objective, reference)
    np.testing.assert_allclose(z[0], -sqp.FIRST, rtol=1e-6)  # downhill, to the edge of the trust region
    again, state = sqp.step(state, z, None, None, objective, reference)
    assert state.center[0] == 0.0 and z[0] < again[0] < 0.0
    assert sqp.usable(good, np.ones(1))
    assert not sqp.usable((None, None, np.array([[[np.nan]]])), np.ones(1))
    assert not sqp.usable((None, None, np.array([[[1e9]]])), np.ones(1))


def test_slopes_that_leave_no_problem_to_solve_end_the_search_at_its_best_point():
    wild = np.random.default_rng(0).normal(size=(2, 2, 16)) * 1e30
    state, looks = descend(lambda z: (np.ones((2, 16)), wild), (0.3, -0.2), Objective(MEAN, EFFORT))
    assert looks == 1 and state.converged
    np.testing.assert_array_equal(state.center, [0.3, -0.2])


def test_a_penalty_that_is_too_small_is_raised_until_the_limit_is_kept():
    # at the limit the goal falls by 40 per unit: more than ten times what the penalty asks at first
    def model(z):
        return np.array([[10 * (z[0] - 3) ** 2], [z[0]]]), np.array([[[20 * (z[0] - 3)], [1.0]]])

    state, _ = descend(model, (0.5,), Objective(MEAN, EFFORT, penalty=3.0))
    np.testing.assert_allclose(state.center, [1.0], atol=1e-4)
    assert state.over <= 1e-4 and state.penalty > 30


def test_limits_that_cannot_be_kept_end_where_the_excess_is_least():
    # z <= 1/2 and 1/z <= 1/2 exclude each other; the sum of the excesses 2 z - 1 and 2 / z - 1 is least at z = 1
    def model(z):
        return np.array([[z[0] ** 2], [z[0]], [1 / z[0]]]), np.array([[[2 * z[0]], [1.0], [-1 / z[0] ** 2]]])

    limits = (Requirement("effort", "mean", 0.5), Requirement("total_chatter", "mean", 0.5))
    state, _ = descend(model, (0.7,), Objective(MEAN, limits))
    np.testing.assert_allclose(state.center, [1.0], atol=2e-2)
    assert state.penalty >= sqp.DEAREST and state.over > 1.9


def test_limits_on_mean_and_worst_are_two():
    names = ["mean effort", "mean total_chatter", "worst effort", "worst total_chatter"]
    assert [r.name for r in within({"effort": 1.0, "total_chatter": 2.0})] == names


def test_a_matrix_is_handed_over_as_scipy_would():
    draw = np.random.default_rng(2)
    matrix = draw.standard_normal((30, 12)) * (draw.random((30, 12)) > 0.6)
    matrix[:, [3, 11]] = 0.0  # also columns of nothing, the last too
    ours, theirs = Columns.of(matrix), sparse.csc_matrix(matrix)
    assert (ours.nnz, ours.shape) == (theirs.nnz, theirs.shape)
    for name in ("data", "indices", "indptr"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
