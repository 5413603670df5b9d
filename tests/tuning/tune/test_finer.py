"""Limits that hold at the step of tuning and not at the finer one: bounds are tightened until both hold."""

import dataclasses
import types

import jax
import numpy as np
import pytest

from agvjax import Scenario
from laws import Proportional
from tuning import Between, Config, Ensemble, Limit, Objective, Requirement, Search, Simulate, Tune, pose, sample
from tuning.tune import rounds
from tuning.tune.checkpoint import load, save
from tuning.tune.finer import tighter
from tuning.tune.judge import judge
from tuning.tune.page import markdown
from tuning.tune.rounds import begin, solve

pytestmark = pytest.mark.usefixtures("promotion_as_optax_has_it")


def coarse():
    """Four scenarios of two seconds, tuned by Euler's method at a step that is felt, judged at a tenth of it."""
    return Config(
        controller=Proportional(),
        simulate=Simulate(horizon=2.0, dt=2.5e-3, integrator="euler"),
        ensemble=Ensemble(size=4, validation_size=4, draws={"start.heading": Between(-0.5, 1.0)}),
        tune=Tune(
            gains=("stiffness", "damping"),
            limits={"effort": Limit(mean=1.1)},
            search=Search(scouts=4, checks=0, starts=1, iterations=1),
            screen=0,
            iterations=20,
            dt=0.025,
            integrator="euler",
        ),
    )


def effort_over(outcome):
    """By which factor the mean effort on the scenarios tuned on, at the finer step, exceeds 1.1 times the start's."""
    before, after = (np.asarray(m.effort)[:4].mean() for m in outcome.metrics)
    return after / (1.1 * before)


@pytest.mark.slow
def test_a_limit_that_fails_at_the_finer_step_is_met_in_the_end(monkeypatch):
    outcome = solve(pose(coarse()))
    tightened = outcome.run.tightened
    assert 1 <= len(tightened) <= 3
    assert effort_over(outcome) <= 1.001
    verdict = judge(outcome)
    assert not verdict.over
    assert f"were tightened once: mean effort to {tightened[-1, 0]:.5f} of it" in markdown(outcome, verdict)
    monkeypatch.setattr(rounds, "TURNS", 0)
    before = solve(pose(coarse()))
    assert before.run.tightened is None
    assert effort_over(before) > 1.01  # a hundredth: what the tightening was for
    assert "but not at simulate.dt" in " ".join(judge(before).conflict)


@pytest.mark.slow
def test_it_is_resumed_to_the_same_bits(tmp_path):
    runs = []
    whole = solve(pose(coarse()), each=runs.append)
    for i in (len(runs) - 2, runs.index(next(r for r in runs if r.tightened is not None)) - 1):
        save(tmp_path, runs[i])
        problem = pose(coarse())
        resumed = solve(problem, load(tmp_path, begin(problem)))
        np.testing.assert_array_equal(resumed.run.tightened, whole.run.tightened)
        np.testing.assert_array_equal(resumed.run.lead.best_z, whole.run.lead.best_z)
        assert resumed.run.history == whole.run.history


def test_bounds_are_tightened_by_their_own_excess_and_others_stay():
    # levels at the finer step: mean effort 2.1 / 2 = 1.05, worst effort 2.2 / 2.2 = 1, mean peak .9
    batch = sample(Scenario(), {"disturbance.amplitude": Between(0.0, 1.0)}, 2, 0)
    limits = (
        Requirement("effort", "mean", 2.0, True),
        Requirement("effort", "worst", 2.2, True),
        Requirement("peak_position", "mean", 1.0, True),
    )
    objective = Objective((Requirement("total_rmse", "mean", 1.0),), limits)

    class Seen:
        ok = np.ones(2, bool)
        table = {"total_rmse": [1.0, 1.0], "effort": [2.0, 2.2], "peak_position": [0.9, 0.9]}

        def __getitem__(self, name):
            return jax.numpy.array(self.table[name])

    jax.tree_util.register_pytree_node(Seen, lambda x: ((), None), lambda aux, children: Seen())
    problem = types.SimpleNamespace(tuner=types.SimpleNamespace(objective=objective, batch=batch, budget=None))
    found = tighter(problem, (Seen(), Seen()), None)
    np.testing.assert_allclose(found, [0.9995 / 1.05, 1.0, 1.0], rtol=1e-12)
    again = tighter(problem, (Seen(), Seen()), found)
    np.testing.assert_allclose(again, [(0.9995 / 1.05) ** 2, 1.0, 1.0], rtol=1e-12)
    Seen.table = Seen.table | {"effort": [1.9, 2.0]}
    assert tighter(problem, (Seen(), Seen()), found) is None


def test_a_round_without_a_usable_gradient_keeps_the_gains_that_it_began_with_also_when_resumed(tmp_path, monkeypatch):
    """It used to take the best gain set of the screening when resumed, or to end where there was none."""
    search = Search(scouts=4, checks=0, starts=1, iterations=1, rounds=1, tolerance=0.0)
    tune = dataclasses.replace(coarse().tune, search=search, iterations=4, limits={})
    problem = pose(dataclasses.replace(coarse(), tune=tune))
    method, again, tuned, runs = type(problem.tuner.method), rounds._again, [], []

    def spoil(outcome):
        tuned.append(outcome)
        monkeypatch.setattr(method, "usable", lambda *given: False)
        return again(outcome)

    monkeypatch.setattr(rounds, "_again", spoil)
    whole = solve(problem, each=runs.append)
    (first,) = tuned
    assert "round 1, with the worst scenarios added, made no progress" in whole.stopped
    assert first.run.lead.best_iteration > 0  # it had gained something, which the starting gains are without
    save(tmp_path, next(run for run in runs if run.round == 1))
    resumed = solve(problem, load(tmp_path, begin(problem)))
    for outcome in (whole, resumed):
        np.testing.assert_array_equal(outcome.run.lead.best_z, first.run.lead.best_z)
        assert np.isfinite(outcome.run.lead.best[1])
    assert (whole.stopped, whole.rounds, whole.run.history) == (resumed.stopped, resumed.rounds, resumed.run.history)
    assert "the gains are those of the previous round" in markdown(whole, judge(whole))
