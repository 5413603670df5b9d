"""Which searches go on where several begin at places of their own: told from hand-made histories."""

from types import SimpleNamespace

import numpy as np
import pytest

from tuning.tune import populations, race
from tuning.tune.race import RUNGS
from tuning.tune.tuner import HISTORY


def search(goals, excess=0.0, finished=False, optimiser=()):
    """A search that saw these goals, one an iteration."""
    rows = [(i, goal, goal, excess, *([0.0] * (len(HISTORY) - 4))) for i, goal in enumerate(goals)]
    assert HISTORY[1:4] == ("cost", "goal", "excess")
    best = (max(excess, 0.0), min(goals))
    return SimpleNamespace(history=rows, iteration=len(rows), finished=finished, best=best, optimiser=optimiser)


def population(goals):
    """A population whose best set in each generation had these goals."""
    return search(goals, optimiser=populations.state(np.zeros(2)))


def going(searches, **run):
    tuner = SimpleNamespace(finished=lambda p: p.finished)
    config = SimpleNamespace(tune=SimpleNamespace(starts=1, screen=512))
    run = {"round": 0, "turns": 0, "tightened": None, "screened": SimpleNamespace(looked=513)} | run
    return race._going(SimpleNamespace(tuner=tuner, config=config), SimpleNamespace(searches=searches, **run))


FIRST = search([1.0] * 20, finished=True)
GOALS = [0.9, 0.3, 0.7, 0.5, 0.8, 0.4, 0.6, 0.95]


def test_all_run_to_the_first_rung_and_the_better_half_beyond():
    young = [search([goal] * 2) for goal in GOALS]
    assert going([FIRST, *young]) == [False] + [True] * 8
    waiting = [search([goal] * RUNGS[0]) for goal in GOALS]
    mixed = [waiting[0], young[1], *waiting[2:]]
    assert going([FIRST, *mixed]) == [False, False, True] + [False] * 6  # the others wait for it
    assert going([FIRST, *waiting]) == [False] + [goal <= 0.6 for goal in GOALS]


def test_of_those_that_went_on_half_again_and_two_to_the_end():
    first, second = RUNGS[:2]
    later = [search([goal] * (second if goal <= 0.6 else first)) for goal in GOALS]
    assert going([FIRST, *later]) == [False] + [goal <= 0.4 for goal in GOALS]
    to_the_end = [search([goal] * (40 if goal <= 0.4 else second if goal <= 0.6 else first)) for goal in GOALS]
    assert going([FIRST, *to_the_end]) == [False] + [goal <= 0.4 for goal in GOALS]


def test_limits_count_before_the_goal_and_what_came_after_a_rung_does_not():
    first = RUNGS[0]
    outside = [search([goal] * first, excess=0.1) for goal in GOALS[:4]]
    within = [search([2 + goal] * first) for goal in GOALS[:4]]
    assert going([FIRST, *outside, *within]) == [False] + [False] * 4 + [True] * 4
    late = search([0.9] * first + [0.1] * 10)  # was among the worse at the rung
    others = [search([goal] * first) for goal in (0.2, 0.3, 0.4)]
    assert going([FIRST, late, *others]) == [False, False, True, True, False]


@pytest.mark.parametrize("later", [{"turns": 1}, {"tightened": np.ones((1, 1))}])
def test_what_follows_a_race_goes_on_alone(later):
    searches = [FIRST, *(search([goal] * RUNGS[0]) for goal in GOALS), search([0.5])]
    assert going(searches, **later) == [False] * 9 + [True]


def test_of_two_populations_the_better_goes_on_to_the_end():
    (rung,) = populations.RUNGS
    raced = [FIRST, *(search([goal] * RUNGS[0]) for goal in GOALS)]
    assert going([*raced, *(population([goal]) for goal in GOALS[:2])]) == [False] * 9 + [True, True]
    waiting = [population([goal] * rung) for goal in GOALS[:2]]  # .9, .3
    assert going([*raced, *waiting]) == [False] * 9 + [False, True]
    later = [waiting[0], population([GOALS[1]] * (populations.PATIENCE - 1))]
    assert going([*raced, *later]) == [False] * 9 + [False, True]
    assert going([*raced, *waiting, search([0.2])]) == [False] * 11 + [True]  # along slopes from the better of them


def test_a_population_ends_where_it_gained_little_for_a_while():
    """By a hundredth of its goal or less in so many generations."""
    level = [1.0] * populations.PATIENCE
    assert not populations.finished(population([1.0, *level[1:]]))
    assert populations.finished(population([1.0, *level, 0.995]))
    assert not populations.finished(population([1.0, *level, 0.98]))
    assert populations.finished(population([1.0] * populations.MOST))


def test_a_search_that_only_lowered_a_cost_outside_the_limits_gained_nothing():
    fell = SimpleNamespace(history=search([1.4]).history + search([0.7], excess=0.2).history, best=(0.0, 1.4))
    assert race._gained(fell) == 0
    came_in = SimpleNamespace(history=search([0.7], excess=0.2).history, best=(0.0, 1.4))
    assert race._gained(came_in) == 1
    np.testing.assert_allclose(race._gained(SimpleNamespace(history=search([2.0, 1.5]).history, best=(0.0, 1.5))), 0.25)
