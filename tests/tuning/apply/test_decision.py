"""Accepting and refusing, by numbers that are worked out by hand."""

import numpy as np
import pytest
from scipy.stats import binom

from tuning.apply.decision import Limited, decide, least_share, provable, worse
from tuning.apply.known import against
from tuning.config.settings import Apply

ASKED = Apply(vehicles=59)
BETTER = np.stack([np.ones(59), np.full(59, 0.8)])
NOWHERE = np.zeros((2, 0))


def test_fifty_nine_vehicles_show_nineteen_of_twenty():
    """0.95^58 = 0.0510 and 0.95^59 = 0.0485: the first below 0.05."""
    assert provable(0.95, 0.95) == 59
    assert provable(0.5, 0.75) == 2


@pytest.mark.parametrize(("good", "count"), [(59, 59), (92, 93), (250, 256), (1, 30)])
def test_the_share_that_is_good_at_least_is_the_exact_bound(good, count):
    """So many or more good ones have a chance of 5 % under it."""
    assert binom.sf(good - 1, count, least_share(good, count, 0.95)) == pytest.approx(0.05, rel=1e-9)


def test_nothing_good_shows_nothing():
    assert least_share(0, 100, 0.95) == 0


def test_a_bound_holds_as_often_as_it_says():
    """Of a share of 0.9 the bound from 80 draws lies above it in no more than 5 % of the cases."""
    good = np.arange(81)
    over = np.array([least_share(int(k), 80, 0.95) > 0.9 for k in good])
    assert binom.pmf(good, 80, 0.9)[over].sum() <= 0.05


def test_worse_is_any_rise_beyond_the_margin_and_every_divergence():
    before = np.array([1.0, 1.0, 1.0, np.inf, np.inf])
    after = np.array([1.0, 1.02, np.inf, 1.0, np.inf])
    assert worse(before, after, 0.0).tolist() == [False, True, True, False, True]
    assert worse(before, after, 0.05).tolist() == [False, False, True, False, True]


def test_gains_that_are_better_everywhere_are_accepted():
    found = decide(BETTER, np.array([[1.4, 1.3], [1.1, 1.2]]), [Limited("mean effort", 1.0, 0.9)], ASKED)
    assert found.accepted and not found.reasons and (found.worse, found.vehicles) == (0, 59)
    assert found.least == pytest.approx(0.05 ** (1 / 59))


def test_one_of_fifty_nine_that_is_worse_is_one_too_many():
    costs = BETTER.copy()
    costs[1, 7] = 1.01
    found = decide(costs, NOWHERE, [], ASKED)
    assert not found.accepted and "1 of 59" in found.reasons[0]
    assert decide(costs, NOWHERE, [], Apply(vehicles=59, margin=0.02)).accepted


def test_gains_that_are_worse_where_it_is_worst_are_refused():
    found = decide(BETTER, np.array([[1.5], [1.6]]), [], ASKED)
    assert not found.accepted and "6.7 % worse" in found.reasons[0]
    costs = np.stack([np.full(59, 2.0), np.full(59, 2.0 + 6e-6)])
    found = decide(costs, costs[:, :1], [], ASKED)  # by three millionths
    assert not found.accepted and "; by 0.0003 % at most, which with apply.margin = 0.001 would" in found.reasons[0]
    assert "0.0003 % worse" in found.reasons[1]
    assert decide(costs, costs[:, :1], [], Apply(vehicles=59, margin=0.001)).accepted


def test_gains_that_diverge_once_are_refused_however_many_do_not():
    costs = np.stack([np.ones(10_000), np.full(10_000, 0.5)])
    costs[1, 3] = np.inf
    found = decide(costs, NOWHERE, [], Apply(vehicles=10_000))
    assert not found.accepted and any("diverge" in reason for reason in found.reasons)


@pytest.mark.parametrize(
    ("before", "after", "kept"),
    [(0.9, 1.0, True), (0.9, 1.019, True), (0.9, 1.03, False), (1.3, 1.31, False), (1.3, 1.3, True), (1.3, 0.5, True)],
)
def test_a_limit_that_holds_must_hold_and_another_must_not_be_exceeded_further(before, after, kept):
    """The first but for 2 % of the bound, the second exactly."""
    found = decide(BETTER, NOWHERE, [Limited("worst effort", before, after)], ASKED)
    assert found.accepted == kept
    assert kept or "worst effort" in found.reasons[0]


def test_nothing_is_decided_by_a_log_that_tells_nothing_or_of_two_machines():
    assert against(True, "fine", None) == ()
    assert "does not tell" in against(False, "These numbers are not good: they are none.", None)[0]
    assert "t = 12 s" in against(True, "fine", 12.0)[0]


def test_the_slack_of_a_limit_does_not_add_up_from_change_to_change():
    level = 1.0
    for _ in range(20):
        if decide(BETTER, NOWHERE, [Limited("worst effort", level, 1.015 * level)], ASKED).accepted:
            level *= 1.015
    assert level == pytest.approx(1.015)
