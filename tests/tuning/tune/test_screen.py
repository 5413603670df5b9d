"""Where a search begins: of many gain sets the better ones get more scenarios, and what was lost is counted."""

import dataclasses

import numpy as np
import pytest

import agvjax
from agvjax import NeuroBackstepping, Scenario, Timing
from laws import Proportional
from tuning import (
    Between,
    Config,
    Ensemble,
    Objective,
    Requirement,
    Search,
    Simulate,
    Tune,
    Tuner,
    pose,
    sample,
    within,
)
from tuning.tune import rounds
from tuning.tune.checkpoint import load, save
from tuning.tune.gains import Gains
from tuning.tune.problem import TuningProblem
from tuning.tune.rounds import begin, solve
from tuning.tune.screen import KEPT, LANES, Screen

pytestmark = pytest.mark.usefixtures("promotion_as_optax_has_it")

SIZE = 64  # scenarios; what varies in them is the disturbance's amplitude alone
GAINS = Gains(("k1", "k3"), np.zeros(2), np.full(2, np.inf))
OBJECTIVE = Objective((Requirement("total_rmse", "mean", 1.0),), within({"effort": 1.0}))


def far_from(bowl, start=(20.0, 12.0), count=511, objective=OBJECTIVE):
    """A screening whose runs `bowl(z, amplitude)` -> (values (M, B), ok) answers, and what it was asked."""
    batch = sample(Scenario(), {"disturbance.amplitude": Between(0.0, 1.0)}, SIZE, 0)
    settings = Tune(screen=count)
    law = NeuroBackstepping(k1=start[0], k3=start[1])
    tuner = Tuner(controller=law, batch=batch, gains=GAINS, objective=objective, settings=settings, timing=Timing())
    asked = []

    def runs(z, scenarios):
        assert z.shape == (LANES, 2)
        asked.append(z)
        return bowl(np.asarray(z), np.asarray(scenarios["disturbance.amplitude"]))

    return Screen(tuner, SIZE, 0, runs), asked


def valley(target):
    """The squared distance to a target in the coordinates, and the scenario's amplitude; an effort that is the same."""

    def bowl(z, amplitude):
        distance = np.sum((z - target) ** 2, axis=1)
        return np.stack([distance + 0.1 * amplitude, np.ones_like(distance)]), np.ones(len(z), bool)

    return bowl


def test_a_valley_hundreds_of_times_away_is_found_and_paid_for_as_said():
    target = np.log([20.0 * 300, 12.0 / 50])
    screen, asked = far_from(valley(target))
    told = []
    seen = screen.look(lambda runs, sets: told.append((runs, sets)))
    assert np.sum((seen.places[0] - target) ** 2) < 2.0  # the start is 5.7 and 3.9 away from it
    assert seen.looked == 512 and seen.lost == 0
    # 512 sets in 8 scenarios, 128 or 129 in 24 more, 32 to 34 in the other 32
    runs = sum(runs for runs, _ in told)
    assert told[0] == (LANES, 512) and 512 * 8 + 128 * 24 + 32 * 32 <= runs <= 512 * 8 + 129 * 24 + 34 * 32
    assert seen.rollouts == -(-runs // SIZE) and len(asked) == len(told)
    goals = np.sum((seen.places - target) ** 2, axis=1)
    assert np.all(np.diff(goals) > -0.11) and KEPT <= len(seen.places) <= 34


def test_the_configured_gains_are_among_those_looked_at_and_stay():
    screen, _ = far_from(valley(np.log([20.0, 12.0])))
    seen = screen.look()
    np.testing.assert_allclose(seen.places[0], np.log([20.0, 12.0]))
    assert seen.ranks[0].tolist() == [0.0, pytest.approx(1.0)]  # goals are multiples of the start's


def test_a_set_within_its_limits_comes_before_a_better_one_beyond_them():
    def bowl(z, amplitude):
        error = np.exp(-z[:, 0])  # less error the larger k1, and more effort
        return np.stack([error + 0 * amplitude, np.exp(z[:, 0])]), np.ones(len(z), bool)

    seen = far_from(bowl)[0].look()
    assert seen.ranks[0, 0] == 0 and np.exp(seen.places[0, 0]) <= 20.0 * (1 + 1e-3)
    assert np.all(np.diff(seen.ranks[:, 0]) >= 0)


def test_sets_that_lose_every_run_are_counted_and_what_the_start_cannot_say_the_soundest_does():
    middle = np.log([20.0, 12.0])

    def bowl(z, amplitude):
        values, _ = valley(middle - [4.0, 0.0])(z, amplitude)
        return values, z[:, 0] < middle[0] - 1.0  # the start, and all with a larger k1, diverge

    screen, _ = far_from(bowl)
    seen = screen.look()
    points = screen.points()
    assert seen.lost == np.sum(points[:, 0] >= middle[0] - 1.0) > 256
    assert seen.unit[0] < middle[0] - 1.0 and np.isfinite(seen.ranks[0, 1])
    assert seen.places[0, 0] == pytest.approx(middle[0] - 4.0, abs=1.0)
    assert np.isinf(seen.ranks[-1, 1])  # the start stays, at the end


def test_where_every_run_of_every_set_diverges_there_is_nothing_to_tune():
    screen, _ = far_from(lambda z, amplitude: (np.ones((2, len(z))), np.zeros(len(z), bool)))
    with pytest.raises(RuntimeError, match="every run diverges, with the starting gains and with 511 other gain sets"):
        screen.look()


def test_places_to_begin_at_lie_apart():
    two = np.log([[20.0, 12.0], [20.0 / 25, 12.0 * 25]])

    def bowl(z, amplitude):
        distance = np.min(np.sum((z[:, None] - two) ** 2, axis=2), axis=1)
        return np.stack([1 + distance + 0 * amplitude, np.ones(len(z))]), np.ones(len(z), bool)

    places = far_from(bowl)[0].look().apart(3)
    gaps = np.abs(places[:, None] - places[None]).max(axis=2)[np.triu_indices(len(places), 1)]
    assert 2 <= len(places) <= 3 and np.all(gaps > np.log(2))
    assert all(np.min(np.abs(places - valley).max(axis=1)) < 1.0 for valley in two)


def test_a_look_about_tuned_gains_gives_what_was_added_to_every_set_first_and_counts_it_in_no_mean():
    """The added scenario is lost wherever k1 is larger than a half of what was tuned, and its error is enormous."""
    tuned = np.log([40.0, 6.0])
    screen, asked = far_from(None)
    size, amplitudes = SIZE + 1, np.r_[np.linspace(0, 1, SIZE), 7.0]
    batch = agvjax.batch(Scenario(), {"disturbance.amplitude": amplitudes})
    objective = OBJECTIVE._replace(weights=np.r_[np.ones(SIZE), 0.0])
    tuner = dataclasses.replace(screen.tuner, batch=batch, objective=objective)
    told = []

    def runs(z, scenarios):
        amplitude = np.asarray(scenarios["disturbance.amplitude"])
        told.append(np.sum(amplitude == 7.0))
        error = np.sum((z - tuned) ** 2, axis=1) + np.where(amplitude == 7.0, 1e6, 1.0)
        return np.stack([error, np.ones(len(z))]), (amplitude != 7.0) | (z[:, 0] < tuned[0] - np.log(2))

    seen = dataclasses.replace(screen, tuner=tuner, compiled=runs).look(about=tuned, added=size - SIZE)
    assert sum(told) >= 513  # every set has met it
    np.testing.assert_allclose(seen.places[0, 0], tuned[0] - np.log(2), atol=0.3)
    assert seen.places[0, 0] < tuned[0] - np.log(2) and abs(seen.places[0, 1] - tuned[1]) < 0.5
    # 1 and the distance, over the same at the configured gains, which have no part in the added one's million
    middle = np.log([20.0, 12.0])
    worth = (1 + np.sum((seen.places[0] - tuned) ** 2)) / (1 + np.sum((middle - tuned) ** 2))
    assert seen.ranks[0].tolist() == pytest.approx([0.0, worth])


# ------------------------------------------------------------------------------------------------- a whole tuning


def rocking(**gains):
    """A proportional law, four scenarios of two seconds."""
    draws = {"start.heading": Between(-0.5, 1.0), "disturbance.amplitude": Between(0.0, 0.5)}
    steps = {"dt": 5e-3, "integrator": "euler"}
    search = Search(scouts=4, checks=0, starts=1, iterations=1)
    return Config(
        controller=Proportional(**gains),
        simulate=Simulate(horizon=2.0, **steps),
        ensemble=Ensemble(size=4, validation_size=4, draws=draws),
        tune=Tune(gains=("stiffness", "damping"), limits={}, screen=32, iterations=6, search=search, **steps),
    )


@pytest.mark.slow
def test_a_law_that_loses_every_run_is_tuned_all_the_same_and_goes_on_where_it_stood(tmp_path):
    """With a damping beyond 2/dt Euler's step makes the speed grow, whatever the vehicle."""
    posed = pose(rocking(stiffness=4000.0, damping=1000.0))  # Euler: 1 - 5 ms 1000/s = -4 a step
    kept = []
    whole = solve(posed, each=lambda run: kept.append(run))
    assert np.isfinite(whole.progress.best[1]) and whole.run.screened.lost > 0
    start = posed.tuner.gains.coordinates(posed.config.controller)
    assert not np.array_equal(whole.run.screened.unit, start)
    save(tmp_path, kept[1])
    again = solve(posed, load(tmp_path, begin(posed)))
    np.testing.assert_array_equal(again.progress.best_z, whole.progress.best_z)
    assert again.run.history == whole.run.history
    np.testing.assert_array_equal(again.run.screened.places, whole.run.screened.places)


class Nobody:
    """Looks for no worst scenario."""

    def search(self, z, round_):
        return []


@pytest.mark.parametrize(("floor", "others", "starts"), [(1.0, True, 1), (3.0, False, 1), (1.0, True, 64)])
def test_a_search_that_gains_little_is_followed_by_one_from_elsewhere(floor, others, starts, monkeypatch):
    """A plateau at `floor` about the start, without slopes, in a cone with a round tip that falls to .2 elsewhere."""
    for name in ("before_and_after", "tighter"):  # what answers has no finer step
        monkeypatch.setattr(rounds, name, lambda *arguments: None)
    middle, tip = np.log([20.0, 12.0]), np.log([20.0, 12.0]) + [2.0, -1.5]

    def runs(z, amplitude):
        gap = np.sqrt(np.sum((z - tip) ** 2, axis=-1) + 0.09) - 0.3
        level = np.where(np.linalg.norm(z - middle, axis=-1) < 1, floor, 0.2 + 0.9 * gap) + 0 * amplitude
        return np.stack([level, np.ones_like(level)]), np.ones(len(level), bool)

    def model(z, scenarios):
        flat = np.linalg.norm(z - middle) < 1
        slope = np.where(flat, 0.0, 0.9 * (z - tip) / np.sqrt(np.sum((z - tip) ** 2) + 0.09))
        slopes = np.stack([slope, np.zeros(2)], axis=1)[:, :, None]
        return *runs(z, np.zeros(SIZE)), np.broadcast_to(slopes, (2, 2, SIZE))

    def at_once(tuner):
        return lambda points, scenarios: tuple(np.stack(x) for x in zip(*(model(z, 0) for z in points), strict=True))

    monkeypatch.setattr(Tuner, "push_all", property(at_once))  # several searches look in one call, which is asked here
    screen, _ = far_from(runs, count=7)
    tuner = dataclasses.replace(screen.tuner, compiled=model)
    config = Config(tune=Tune(screen=7, starts=starts), ensemble=Ensemble(size=SIZE))
    outcome = solve(TuningProblem(config, tuner, Nobody(), dataclasses.replace(screen, tuner=tuner)))
    assert (len(outcome.run.searches) > 1) == others
    np.testing.assert_allclose(outcome.progress.best_z, tip, atol=0.05)
    assert outcome.run.total("rollouts") > sum(p.rollouts for p in outcome.run.searches)
