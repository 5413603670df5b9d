"""Rare failures: the bounds by hand, the draws, and problems whose probability a formula gives."""

import re

import numpy as np
import pytest
from scipy import stats

from tuning.io.statements import exceeding
from tuning.sweep.rare import bounds, nearest, page, prepare
from tuning.sweep.rare.estimate import Drawn, drawn, estimate
from tuning.sweep.rare.mixture import Mixture
from tuning.sweep.rare.problem import Problem

BUDGET = 100_000


def linear(direction, distance):
    """Fails beyond a plane at this distance: with probability Phi(-distance)."""
    way = np.asarray(direction, float) / np.linalg.norm(direction)

    def look(u):
        return u @ way - distance

    return Problem(len(way), look, lambda u: (look(u), np.tile(way, (len(u), 1))))


def solved(problem, budget=BUDGET, seed=0):
    """What is prepared, what is drawn, and the estimate."""
    prepared = prepare.prepare(problem, budget, seed)
    draws = drawn(problem, prepared, seed, 0, prepared.draws)
    return prepared, draws, estimate(prepared, draws, problem.tail)


# ------------------------------------------------------------------------------------------------------------ bounds


def test_a_bet_on_zeros_grows_to_twenty_as_by_hand():
    """The stake is .75 / 2 of the money: (1 + .375 m)^100 = 20 at the bound m."""
    bound = bounds.mean_at_most(np.zeros(100), 2.0, 0.0, 1000)
    assert bound == pytest.approx((20**0.01 - 1) / 0.375, rel=1e-9)


def test_a_bet_on_equal_values_grows_to_twenty_as_by_hand():
    """With all values .4 the largest stake .75 / m gives (1 + .75 (.4 / m - 1))^50 = 20."""
    bound = bounds.mean_at_least(np.full(50, 0.4), 1.0, 0.0, 1000)
    assert bound == pytest.approx(0.75 * 0.4 / (20 ** (1 / 50) - 0.25), rel=1e-9)


def test_shares_are_bounded_as_clopper_and_pearson_have_it():
    assert bounds.share_at_most(0, 100) == pytest.approx(1 - 0.05**0.01, rel=1e-12)
    assert bounds.share_at_least(100, 100) == pytest.approx(0.05**0.01, rel=1e-12)
    assert (bounds.share_at_least(0, 7), bounds.share_at_most(7, 7)) == (0.0, 1.0)
    assert stats.binom.cdf(3, 10, bounds.share_at_most(3, 10)) == pytest.approx(0.05, rel=1e-9)
    assert stats.binom.sf(2, 10, bounds.share_at_least(3, 10)) == pytest.approx(0.05, rel=1e-9)


def test_the_largest_of_draws_leaves_the_share_above_it_that_wilks_gives():
    assert exceeding(59) < 0.05 < exceeding(58)  # the classic 59 runs of a nuclear code
    assert exceeding(256) == pytest.approx(0.01163, abs=1e-5)


@pytest.mark.parametrize("variance", [0.1, 1.0, 10.0])
def test_bounds_hold_in_nineteen_of_twenty_whatever_the_pilot_says_of_the_variance(variance):
    """Of 400: 20 misses are allowed on average, 33 are three standard deviations more."""
    random = np.random.default_rng(0)
    of_one = 0.05 / 3 - 0.025**2  # of a uniform number that is kept with 5 %
    missed = [0, 0]
    for _ in range(400):
        values = random.random(200) * (random.random(200) < 0.05)
        missed[0] += bounds.mean_at_most(values, 1.0, variance * of_one, 1000) < 0.025
        missed[1] += bounds.mean_at_least(values, 1.0, variance * of_one, 1000) > 0.025
    assert max(missed) <= 33


def test_the_effective_size_is_that_of_kish():
    assert bounds.effective(np.array([1.0, 1, 1, 1, 0])) == pytest.approx(4)
    assert bounds.effective(np.array([2.0, 1])) == pytest.approx(9 / 5)
    assert bounds.effective(np.zeros(3)) == 0


# ------------------------------------------------------------------------------------------------------------- draws


def test_weights_are_the_ratio_of_densities():
    mixture, u = Mixture.about(np.array([[3.0, 0.0]])), np.array([[3.0, 0.5], [0.0, 0.0]])
    wide = 3 / np.sqrt(2)
    density = [
        0.5 * stats.multivariate_normal.pdf(x, [0, 0])
        + 0.1 * stats.multivariate_normal.pdf(x, [0, 0], wide**2)
        + 0.4 * stats.multivariate_normal.pdf(x, [3, 0])
        for x in u
    ]
    np.testing.assert_allclose(mixture.weights(u), stats.multivariate_normal.pdf(u, [0, 0]) / density, rtol=1e-12)


def test_weights_are_bounded_and_average_to_one():
    mixture = Mixture.about(np.array([[3.0, 0, 0], [0, -4.0, 0]]))
    u, plain = mixture.draw(1, "here", 0, 20_000)
    weights = mixture.weights(u)
    assert weights.max() <= 2 and abs(weights.mean() - 1) < 4 * weights.std() / np.sqrt(20_000)
    assert stats.kstest(u[plain].ravel(), "norm").pvalue > 1e-3 and abs(plain.mean() - 0.5) < 0.015


def test_a_draw_hangs_on_its_number_alone():
    mixture = Mixture.about(np.array([[3.0, 0, 0], [0, -4.0, 0]]))
    whole = mixture.draw(1, "here", 0, 100)
    parts = [mixture.draw(1, "here", first, 20) for first in range(0, 100, 20)]
    np.testing.assert_array_equal(whole[0], np.concatenate([u for u, _ in parts]))
    np.testing.assert_array_equal(whole[1], np.concatenate([plain for _, plain in parts]))


# --------------------------------------------------------------------------------------------------- what is found


def test_the_nearest_point_of_a_plane_is_found_from_anywhere():
    problem = linear([3.0, -1, 2], 4.0)
    found = nearest.search(problem, np.array([[0.0, 0, 0], [2, 2, -3]]), 10_000)
    np.testing.assert_allclose(found[0], 4 * np.array([3, -1, 2]) / np.sqrt(14), atol=0.05)
    assert (problem.look(found) > 0).all()


def test_a_gradient_counts_its_tangents():
    problem = linear([1.0, 0, 0], 4.0)
    problem.slopes(np.zeros((5, 3)))
    assert problem.rollouts == 5 * 4
    problem.levels(np.array([[0.0, 0, 0], [0, 0, 7]]))  # the second lies too far out to be rolled out
    assert problem.rollouts == 5 * 4 + 1


def test_two_opposite_ways_to_fail_are_both_found():
    def look(u):
        return np.maximum(u[:, 0] - 4.0, -u[:, 0] - 4.2)

    def climb(u):
        return look(u), np.where(u[:, :1] - 4.0 > -u[:, :1] - 4.2, [[1.0, 0]], [[-1.0, 0]])

    prepared, _, made = solved(Problem(2, look, climb))
    ways = prepared.mixture.points[:, 0]
    assert ways.max() == pytest.approx(4.0, abs=0.2) and ways.min() == pytest.approx(-4.2, abs=0.2)
    assert made.low < stats.norm.sf(4.0) + stats.norm.sf(4.2) < made.high < 1.2 * made.probability


@pytest.mark.parametrize("sides", [1, 12])
def test_one_in_a_million_is_bounded_tightly_by_a_hundred_thousand_rollouts(sides):
    problem = linear(np.arange(1, sides + 1), stats.norm.isf(1e-6))
    _, _, made = solved(problem)
    assert problem.rollouts <= BUDGET and not made.refused
    assert 0.85e-6 < made.low < 1e-6 < made.high < 1.2e-6
    assert made.plain_high > 3e-5  # what plain draws alone can say


def test_a_level_without_slopes_is_no_obstacle():
    def look(u):
        return np.where(u[:, 0] + u[:, 1] > 4.0 * np.sqrt(2), 1.0, np.floor(u[:, 0] + u[:, 1]) - 10)

    _, _, made = solved(Problem(3, look))
    assert made.low < stats.norm.sf(4.0) < made.high < 1.3 * stats.norm.sf(4.0) and not made.refused


def test_plain_draws_meet_what_no_search_leads_to_and_then_nothing_else_is_stated():
    """A plane at 4.5, 3.4e-6, and an island that slopes point away from, 3e-4: the searches see the first alone."""

    def look(u):
        island = np.linalg.norm(u - [-3.2, 0.0], axis=1) < 0.3
        return np.where(island, 1.0, u[:, 0] - 4.5)

    def climb(u):
        return look(u), np.tile([1.0, 0.0], (len(u), 1))

    draws = np.random.default_rng(0).normal(size=(1_000_000, 2))
    true = (look(draws) > 0).mean()
    problem = Problem(2, look, climb)
    start = prepare.prepare(problem, BUDGET, 0)
    only = Mixture.about(np.array([[4.5, 0.0]]))  # as if trial draws had met no island either
    blind = start._replace(mixture=only, cut=1e-3, covered=1.0, pilot=0.0)
    made = estimate(blind, drawn(problem, blind, 0, 0, 60_000), problem.tail)
    assert made.outside > 0 and any("outside" in why for why in made.refused)
    assert made.bound == made.plain_high > true


# ------------------------------------------------------------------------------------------- what is not stated


def by_hand(failed, weights, prepared):
    """Draws of a single number of which only weights and failures count."""
    count = len(failed)
    return estimate(prepared, Drawn(np.zeros((count, 1)), weights, failed, np.arange(count) % 2 == 0), 0.0)


@pytest.fixture
def prepared():
    """Of a plane 4 away: about 3.2e-5, and the pilot says so."""
    mixture = Mixture.about(np.array([[4.0]]))
    return prepare.Prepared(mixture, 0.01, 3e-5, 1e-8, 4000, 3e-5, 1.0, 1000, 20_000)


def test_few_effective_failures_are_not_enough(prepared):
    weights, failed = np.full(1000, 1e-4), np.arange(1000) % 20 == 1
    assert not by_hand(failed, weights, prepared._replace(pilot=5e-6)).refused  # 50 of equal weight
    weights[1] = 9e-3
    assert "the effective sample size is 2, less than 50" in by_hand(failed, weights, prepared).refused


def test_a_pilot_that_disagrees_is_not_overruled(prepared):
    weights, failed = np.full(1000, 1e-4), np.arange(1000) % 4 == 1  # 2.5e-5
    assert not by_hand(failed, weights, prepared).refused
    for pilot in (2e-6, 3e-4):
        (why,) = by_hand(failed, weights, prepared._replace(pilot=pilot)).refused
        assert "more than 10 times apart" in why
    (why,) = by_hand(failed, weights, prepared._replace(covered=0.8)).refused
    assert why == "only 80% of the failures of subset simulation lie in the explored region"


def test_plain_draws_that_contradict_an_estimate_refuse_it(prepared):
    weights, failed = np.full(1000, 1e-4), np.arange(1000) % 4 == 0  # all of the failures are plain draws: 250 of 500
    assert any("plain draws contradict it: 250 of 500" in why for why in by_hand(failed, weights, prepared).refused)


def test_two_upper_bounds_hold_at_once_as_draws_choose_the_one_that_is_stated(prepared):
    """4 % and 1 % are missed: (1 + 75 m)^1000 = 25 of the weighted draws, (1 - p)^500 = .01 of the plain ones."""
    made = by_hand(np.zeros(1000, bool), np.full(1000, 1e-4), prepared)
    assert made.high == pytest.approx((25**0.001 - 1) / 75, rel=1e-9)
    assert made.plain_high == pytest.approx(1 - 0.01**0.002, rel=1e-9)


def test_how_far_a_draw_at_the_edge_of_the_region_moves_an_estimate_is_computed(prepared):
    """Of 1000 draws 250 weigh 1e-4: one more of weight .01 adds .01 / .025."""
    made = by_hand(np.arange(1000) % 4 == 1, np.full(1000, 1e-4), prepared)
    assert "would move the estimate by 40.0%" in page.edge(prepared, made)
    assert page.edge(prepared, made._replace(probability=0.0)) == ""


def test_where_nothing_fails_only_plain_draws_speak():
    prepared, _, made = solved(Problem(2, lambda u: np.full(len(u), -1.0)), 20_000)
    assert prepared.everywhere and made.failures == 0 and made.refused
    assert made.bound == pytest.approx(1 - 0.01 ** (1 / made.plain_runs), abs=1e-8)


def test_a_frequent_failure_is_bounded_wherever_it_lies():
    prepared, _, made = solved(linear([1.0, 1.0], stats.norm.isf(1e-2)))
    assert prepared.everywhere and made.low < 1e-2 < made.high < 1.05e-2
    assert bounds.share_at_least(made.plain_failures, made.plain_runs) < 1e-2 < made.plain_high


def test_the_verdict_says_what_its_bound_rests_on():
    class Outcome:
        pass

    said = {}
    for level in (1e-2, 1e-5):
        outcome = Outcome()
        *_, outcome.estimate = solved(linear([1.0, 1.0], stats.norm.isf(level)))
        said[level] = " ".join(page.verdict(outcome))
    assert "This holds wherever the failures lie." in said[1e-2] and "all failures lie" not in said[1e-2]
    stated = r"\*\*With probability at most [\d.e-]+ \(95 %\), a vehicle drawn from this ensemble fails"
    assert re.search(rf"^{stated}\*\*", said[1e-2])
    assert re.search(rf"^{stated}, if all failures lie in the explored region\*\*", said[1e-5])
    assert "cannot be excluded" in said[1e-5]
