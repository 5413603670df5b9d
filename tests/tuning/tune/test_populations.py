"""Populations where slopes are of no use: they find a valley, are paid for as counted, and resume to the same end."""

import dataclasses
from collections import defaultdict

import numpy as np
import pytest

from agvjax import NeuroBackstepping, Scenario, Timing
from tuning import Between, Config, Ensemble, Objective, Requirement, Tune, Tuner, sample, within
from tuning.tune import choice, populations, race, rounds, tables
from tuning.tune.analysis import analyse, conflict
from tuning.tune.checkpoint import load, save
from tuning.tune.gains import Gains
from tuning.tune.methods import sqp
from tuning.tune.problem import TuningProblem
from tuning.tune.rounds import begin, solve
from tuning.tune.screen import LANES, Screen

pytestmark = pytest.mark.usefixtures("promotion_as_optax_has_it")

SCENARIOS = 16
MIDDLE = np.log([20.0, 12.0])
TIP = MIDDLE + [2.0, -1.5]
GAINS = Gains(("k1", "k3"), np.zeros(2), np.full(2, np.inf))
OBJECTIVE = Objective((Requirement("total_rmse", "mean", 1.0),), within({"effort": 1.0}))


class Nobody:
    """Looks for no worst scenario."""

    def search(self, z, round_):
        return []


def cone(z, amplitude):
    """The distance from the tip and .2; an effort that is the same everywhere."""
    level = 0.2 + np.linalg.norm(z - TIP, axis=-1) + 0 * amplitude
    return np.stack([level, np.ones_like(level)]), np.ones(level.shape, bool)


def steep(z, amplitude):
    """An error that falls with k1, and an effort that rises with it."""
    error = np.exp(-z[..., 0]) + 0 * amplitude
    return np.stack([error, np.exp(z[..., 0]) + 0 * amplitude]), np.ones(error.shape, bool)


def posed(monkeypatch, surface=cone, count=7):
    """A problem without a slope of use, which the surface answers, and the runs that it was asked for."""
    for name in ("before_and_after", "tighter"):  # what answers has no finer step
        monkeypatch.setattr(rounds, name, lambda *arguments: None)
    asked = {"runs": 0, "models": 0}

    def runs(z, scenarios):
        assert z.shape == (LANES, 2)
        amplitude = np.asarray(scenarios["disturbance.amplitude"])
        lanes = np.column_stack([z, amplitude])
        asked["runs"] += 1 + int(np.any(np.diff(lanes, axis=0) != 0, axis=1).sum())  # what fills a call is repeated
        return surface(np.asarray(z), amplitude)

    def model(z, scenarios):
        asked["models"] += 1
        return *surface(np.asarray(z), np.zeros(SCENARIOS)), np.full((2, 2, SCENARIOS), np.nan)

    config = Config(tune=Tune(screen=count), ensemble=Ensemble(size=SCENARIOS))
    batch = sample(Scenario(), {"disturbance.amplitude": Between(0.0, 1.0)}, SCENARIOS, 0)
    law, timing = NeuroBackstepping(k1=20.0, k3=12.0), Timing()
    tuner = Tuner(law, batch, GAINS, OBJECTIVE, config.tune, timing, compiled=model)
    return TuningProblem(config, tuner, Nobody(), Screen(tuner, SCENARIOS, 0, runs)), asked


@pytest.mark.parametrize("count", [1, 7])
def test_a_valley_without_slopes_is_found_and_every_run_is_counted(count, monkeypatch):
    problem, asked = posed(monkeypatch, count=count)
    outcome = solve(problem)
    assert populations.drawn(outcome.progress) and not outcome.stopped
    np.testing.assert_allclose(outcome.progress.best_z, TIP, atol=0.05)
    found = 0.2 + np.linalg.norm(outcome.progress.best_z - TIP)  # goals are multiples of the start's, 2.7
    assert outcome.progress.best == (0.0, pytest.approx(found / (0.2 + np.hypot(2.0, 1.5))))
    # one model at the start for the unit of goals, and one for the worst at the end, are no iterations
    paid = asked["runs"] / SCENARIOS + 3 * (asked["models"] - 2)
    assert outcome.run.total("rollouts") == paid


def test_interrupted_among_its_generations_it_goes_on_to_the_same_end(monkeypatch, tmp_path):
    problem, _ = posed(monkeypatch)
    kept = []
    whole = solve(problem, each=kept.append)
    middle = next(run for run in kept if run.searches[-1].iteration == 4 and populations.drawn(run.searches[-1]))
    save(tmp_path, middle)
    populations._method.cache_clear()  # another process
    back = load(tmp_path, begin(problem))
    assert [populations.drawn(p) for p in back.searches] == [populations.drawn(p) for p in middle.searches]
    again = solve(problem, back)
    np.testing.assert_array_equal(again.run.history, whole.run.history)  # where no gradient is finite, NaN
    np.testing.assert_array_equal(again.progress.best_z, whole.progress.best_z)
    assert again.run.total("rollouts") == whole.run.total("rollouts")


def test_sets_within_their_limits_come_first(monkeypatch):
    """A smaller error costs more effort than the start's, to which it is limited."""
    problem, _ = posed(monkeypatch, steep)
    outcome = solve(problem)
    assert outcome.progress.best[0] == 0
    np.testing.assert_allclose(np.exp(outcome.progress.best_z[0]), 20.0 * (1 + 5e-4), rtol=1e-3)


def test_what_finds_nothing_better_leaves_the_lead_where_it_was(monkeypatch):
    problem, _ = posed(monkeypatch)
    run = begin(problem)
    seen = problem.screen.look()
    lead = run.searches[0]._replace(best=(0.0, 1e-3), iteration=5)  # no set comes near
    run = race._populations(run._replace(searches=(lead,), screened=seen), seen, problem.screen)
    assert len(run.searches) == 1 + 2
    while (after := race.advanced(problem, run)) is not None:
        run = after
    assert run.lead is lead
    assert race._populations(run, seen, problem.screen) is None


def test_only_the_gains_that_move_are_drawn(monkeypatch):
    problem, _ = posed(monkeypatch)
    screen, moving = problem.screen, np.array([True, False])
    begun = [populations.begin(problem.tuner, z, moving) for z in populations.places(screen, MIDDLE, moving)]
    after = populations.advance(screen, begun)
    for p in after:
        assert p.z[1] == MIDDLE[1] and p.z[0] != MIDDLE[0]
        assert p.optimiser.strategy.begin.shape == (1,)


def test_places_are_the_best_and_others_within_the_square_of_the_spread(monkeypatch):
    problem, _ = posed(monkeypatch)
    best, *others = populations.places(problem.screen, TIP, np.ones(2, bool))
    np.testing.assert_array_equal(best, TIP)
    gaps = np.array(others) - MIDDLE
    assert np.abs(gaps).max() <= np.log(9.0) and len(np.unique(np.sign(gaps), axis=0)) > 1


def test_what_goes_on_begins_at_the_best_and_at_the_best_set_that_is_twice_as_far_in_a_gain(monkeypatch):
    problem, _ = posed(monkeypatch)
    sets = TIP + np.array([[0.0, 0.0], [0.6, 0.5], [0.1, -0.8], [2.0, 2.0]])
    seen = problem.screen.look()._replace(places=sets, ranks=np.column_stack([np.zeros(4), np.arange(4.0)]))
    np.testing.assert_array_equal(populations.again(seen, TIP), [TIP, sets[2]])
    (alone,) = populations.again(seen._replace(places=sets[:2], ranks=seen.ranks[:2]), TIP)
    np.testing.assert_array_equal(alone, TIP)


def test_the_screening_knows_the_ranks_that_the_tuner_has(monkeypatch):
    problem, _ = posed(monkeypatch, steep)
    points = MIDDLE + np.array([[0.0, 0.0], [0.1, 0.0], [-0.3, 1.0]])
    _, excess, goal = problem.screen.scores(points)
    # effort e^k1 over the start's less 1, in mean and worst, beyond 5e-4; error e^-k1 over the start's
    np.testing.assert_allclose(excess, [0.0, 2 * (np.exp(0.1) - 1 - 5e-4), 0.0], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(goal, np.exp([0.0, -0.1, 0.3]))


def test_slopes_of_a_chattering_run_lose_no_tuned_gains(monkeypatch):
    """They are no slopes, the linear problem has no solution, and what hangs on it is said not to be known."""
    problem, _ = posed(monkeypatch, steep)
    tuner, wild = problem.tuner, np.random.default_rng(0).normal(size=(2, 2, SCENARIOS)) * 1e30
    push = (*steep(np.asarray(MIDDLE), np.zeros(SCENARIOS)), wild)
    tuner = dataclasses.replace(tuner, compiled=lambda z, scenarios: push)
    with pytest.raises(RuntimeError, match="could not be solved"):
        sqp.solve(push, OBJECTIVE, tuner.baseline, radius=0.01)
    findings = analyse(tuner, MIDDLE)
    assert [s.price for s in findings.standings if s.limit] == [None] * 2
    assert all(s.met for s in findings.standings)
    assert tables.standings(findings, defaultdict(str)).count("not known") == 2
    assert conflict(tuner, MIDDLE) == []
    one = np.array([True, False])
    assert not choice.promises(tuner, tuner.begin(MIDDLE, one), one).any()


HOLE, RADIUS = MIDDLE + np.array([1.6, -1.2]), 0.4


def pitted(z, amplitude):
    """A wide bowl about the start, whose slopes lead away from a small and deep hole."""
    bowl = 1 + np.linalg.norm(z - MIDDLE, axis=-1)
    error = np.where(np.linalg.norm(z - HOLE, axis=-1) < RADIUS, 0.1, bowl) + 0 * amplitude
    return np.stack([error, np.ones_like(error)]), np.ones(error.shape, bool)


def test_wide_populations_pass_through_a_hole_that_the_screening_missed(monkeypatch):
    problem, _ = posed(monkeypatch, pitted)
    seen, both = problem.screen.look(), np.ones(2, bool)
    assert np.linalg.norm(seen.places - HOLE, axis=1).min() > RADIUS
    found = populations.further(problem.screen, seen, both, lambda runs, sets: None)
    more = populations.POPULATIONS * populations.WIDE * populations.CLOSING
    assert (found.looked, found.rollouts) == (seen.looked + more, seen.rollouts + more)
    assert len(found.places) == len(seen.places) + more and found.lost == 0
    np.testing.assert_array_equal(found.ranks[:, 1], np.sort(found.ranks[:, 1]))
    assert np.linalg.norm(found.apart(2) - HOLE, axis=1).min() < RADIUS
    one = populations.further(problem.screen, seen, np.array([True, False]), lambda runs, sets: None)
    assert set(one.places[:, 1]) <= {MIDDLE[1], *seen.places[:, 1]}


def rugged(z, amplitude):
    """A bowl about the tip with a step at every tenth: its slopes are true and promise what no step keeps."""
    far = np.linalg.norm(z - TIP, axis=-1)
    return 0.2 + far**2 + 0.3 * np.modf(np.abs(z[..., 0]) * 10)[0], far


def rough(monkeypatch, near=np.inf, **settings):
    """A problem whose slopes lead far and end short of the tip; runs diverge that are not near it."""

    def surface(z, amplitude):
        level, far = rugged(z, amplitude)
        level = level + 0 * amplitude
        return np.stack([level, np.ones_like(level)]), np.broadcast_to(far < near, level.shape)

    problem, asked = posed(monkeypatch, surface)

    def model(z, scenarios):
        asked["models"] += 1
        slope = 2 * (np.asarray(z) - TIP) + np.array([3.0 * np.sign(z[0]), 0.0])
        slopes = np.stack([slope, np.zeros(2)], axis=1)[:, :, None]
        return *surface(np.asarray(z), np.zeros(SCENARIOS)), np.broadcast_to(slopes, (2, 2, SCENARIOS))

    def at_once(tuner):
        return lambda points, scenarios: tuple(np.stack(x) for x in zip(*(model(z, 0) for z in points), strict=True))

    monkeypatch.setattr(Tuner, "push_all", property(at_once))  # several searches look in one call
    tune = dataclasses.replace(problem.config.tune, **settings)
    tuner = dataclasses.replace(problem.tuner, compiled=model, settings=tune)
    config = dataclasses.replace(problem.config, tune=tune)
    screen = dataclasses.replace(problem.screen, tuner=tuner)
    return problem._replace(config=config, tuner=tuner, screen=screen), asked


def test_where_slopes_end_before_their_promise_turns_follow_and_resume_to_the_same_end(monkeypatch, tmp_path):
    problem, asked = rough(monkeypatch, screen=512)
    kept = []
    whole = solve(problem, each=kept.append)
    kinds = [populations.drawn(p) for p in whole.run.searches]
    assert kinds[0] is False and kinds[1::2] == [True] * len(kinds[1::2]) and not any(kinds[0::2])  # by turns
    assert len(kinds) >= 3 and whole.run.lead.best < whole.run.searches[0].best
    assert asked["runs"] / SCENARIOS + 3 * (asked["models"] - 2) == pytest.approx(whole.run.total("rollouts"), rel=0.05)
    for count in (2, 3):  # in a population, and in the slopes after it
        middle = next(run for run in kept if len(run.searches) == count and run.searches[-1].iteration == 2)
        save(tmp_path, middle)
        populations._method.cache_clear()
        again = solve(problem, load(tmp_path, begin(problem)))
        np.testing.assert_array_equal(again.progress.best_z, whole.progress.best_z)
        assert again.run.total("rollouts") == whole.run.total("rollouts")


def test_a_search_that_its_number_of_iterations_ended_promises_nothing(monkeypatch):
    problem, _ = rough(monkeypatch, screen=512)
    first = solve(problem).run.searches[0]
    assert race._promises(problem, first)
    assert not race._promises(problem, first._replace(optimiser=first.optimiser._replace(radius=np.array(0.1))))


def test_turns_follow_fewer_searches_than_were_asked_for_too(monkeypatch):
    """Of 40 there are as many as places that lie apart; the turns after these are not taken for some of them."""
    problem, _ = rough(monkeypatch, near=2.6, screen=512, starts=40)
    run = solve(problem).run
    assert 1 < run.first < 40
    drawn = [populations.drawn(p) for p in run.searches]
    assert not any(drawn[: run.first]) and len(drawn) > run.first + 1
    turns = drawn[run.first :]
    assert turns[0::2] == [True] * len(turns[0::2]) and not any(turns[1::2])
