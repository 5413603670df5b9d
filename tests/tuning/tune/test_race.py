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
    run = {"round": 0, "first": 1, "turns": 0, "tightened": None, "screened": SimpleNamespace(looked=513)} | run
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


def turned(monkeypatch, *bests, rollouts=1000):
    """The run after a first search and turns of a population and slopes, which came to these goals."""
    begun = {"populations": [], "slopes": []}

    def begin(tuner, z, moving):
        begun["populations"].append(np.array(z))
        return population([1.0])

    def slopes(z, moving):
        begun["slopes"].append(np.array(z))
        return search([1.0])

    monkeypatch.setattr(populations, "begin", begin)
    searches = [search([2.0, bests[0]])]
    for goal in bests[1:]:
        searches += [population([goal + 0.1]), search([goal])]
    for i, p in enumerate(searches):
        p.best_z = np.array([float(i), 7.0])
    lead = min(searches, key=lambda p: p.best)
    run = SimpleNamespace(searches=tuple(searches), lead=lead, moving=np.array([True, False]))
    run.total, run._replace = lambda name: rollouts, lambda searches: searches
    settings = SimpleNamespace(screen=512)
    screen = SimpleNamespace(tuner=SimpleNamespace(begin=slopes, settings=settings), seed=0, size=16)
    return run, screen, begun


def test_a_turn_begins_near_the_best_and_never_twice_at_the_same_sets(monkeypatch):
    near = []
    for bests, lead in (((1.0,), 0), ((1.0, 0.9), 2), ((1.0, 1.1), 0)):
        run, screen, begun = turned(monkeypatch, *bests)
        assert len(race._by_turns(run, screen, 1)) == 2 * len(bests)
        (z,) = begun["populations"]
        assert z[1] == 7.0 and 0 < abs(z[0] - lead) < 0.5  # only what moves; five times the deviation
        near.append(z[0] - lead)
    np.testing.assert_allclose(near[1], near[2])  # by the number of the turn
    assert abs(near[0] - near[1]) > 1e-3


def test_slopes_follow_a_population_from_its_best_though_another_leads(monkeypatch):
    run, screen, begun = turned(monkeypatch, 1.0, 0.9)
    run.searches = run.searches[:2]
    assert len(race._by_turns(run, screen, 1)) == 3
    np.testing.assert_array_equal(begun["slopes"], [[1.0, 7.0]])


@pytest.mark.parametrize(
    ("bests", "rollouts", "last"),
    [
        ((1.0, 0.999), 1000, False),  # one turn that gained little
        ((1.0, 0.999, 0.998), 1000, True),  # two
        ((1.0, 0.999, 0.98), 1000, False),
        ((1.0, 0.5, 0.499, 0.4985), 1000, True),
        ((1.0, 0.9), 2112, False),  # (2112 + 768) 16 = 90 512
        ((1.0, 0.9), 2113, True),
    ],
)
def test_turns_end_where_two_gained_little_or_enough_was_spent(monkeypatch, bests, rollouts, last):
    run, screen, _ = turned(monkeypatch, *bests, rollouts=rollouts)
    assert (race._by_turns(run, screen, 1) is None) == last


def test_slopes_after_a_population_go_on_alone_and_so_does_the_next_population():
    first, drawn = search([2.0, 1.0], finished=True), population([0.9] * populations.MOST)
    assert going([first, drawn, search([0.8])]) == [False, False, True]
    assert going([first, drawn, search([0.8], finished=True), population([0.95])]) == [False, False, False, True]
