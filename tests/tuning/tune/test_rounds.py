"""Runs of several starts and rounds: which search leads, and what is said of a round that came to nothing."""

from types import SimpleNamespace

import numpy as np
import pytest

from tuning.tune import rounds
from tuning.tune.figures import history_figure
from tuning.tune.methods.method import Progress
from tuning.tune.rounds import Run


def search(cost):
    """One iteration of two gains that came to this cost."""
    point = np.zeros(2)
    row = (0, cost, cost, 0.0, 0.0, 1.0, 0, 0, 3, 1.0, 2.0)  # HISTORY, then the gains
    return Progress(1, point, (), point, point, (0.0, cost), 0, 0, 0, 3, [row], np.ones(2, bool))


@pytest.mark.parametrize("costs", [(1.0, 2.0, 3.0), (3.0, 1.0, 2.0), (2.0, 3.0, 1.0), (1.0, 1.0, 1.0)])
def test_the_history_of_whichever_start_leads_is_drawn(costs):
    run = Run(0, tuple(search(cost) for cost in costs), {}, (), ())
    figure = history_figure(("k1", "k2"), (2.0, 4.0), run)
    (goal,) = (line for line in figure.axes[0].get_lines() if line.get_label() == "goal")
    assert goal.get_ydata() == [min(costs)]
    gains = {line.get_label(): line.get_ydata()[0] for line in figure.axes[2].get_lines()}
    assert gains == {"k1": 0.5, "k2": 0.5}  # 1 and 2, in multiples of the gains that a user began with


def test_an_earlier_round_is_drawn_by_the_search_that_it_went_on_from():
    """Start 1 kept the limits, at a higher goal than start 0, which did not."""
    past = [(0, start, *search(cost).history[0]) for start, cost in ((0, 1.0), (1, 2.0))]
    past[0] = (*past[0][:5], 0.3, *past[0][6:])  # its excess
    figure = history_figure(("k1", "k2"), (1.0, 1.0), Run(1, (search(1.5),), {}, (), tuple(past)))
    drawn = [line.get_ydata()[0] for line in figure.axes[0].get_lines() if line.get_label() in ("goal", "_goal")]
    assert drawn == [2.0, 1.5]


def test_a_history_without_gradients_says_so_and_draws_the_rest():
    """As generations of CMA-ES leave it; a logarithmic axis of no positive number would warn."""
    found = search(1.0)
    row = (*found.history[0][:5], np.nan, *found.history[0][6:])
    figure = history_figure(("k1", "k2"), (1.0, 1.0), Run(0, (found._replace(history=[row]),), {}, (), ()))
    figure.draw_without_rendering()
    assert [text.get_text() for text in figure.axes[1].texts] == ["best gains: found without gradients"]
    assert len(figure.axes[2].get_lines()) == 2


@pytest.mark.parametrize(("tightened", "leads"), [(0.58, 0.58), (0.65, 0.6)])
def test_gains_whose_limits_hold_at_the_finer_step_stay_beside_those_of_tighter_bounds(tightened, leads, monkeypatch):
    """Of searches that came to .5, .62, .6 and .55 those to .6 and .62 hold there, and what tighter bounds lead to."""
    begun = search(0.0)._replace(best=(np.inf, np.inf), history=[])

    def searched(problem, run, each, looking):
        return run._replace(
            searches=(*run.searches[:4], *(p._replace(best=(0.0, tightened)) for p in run.searches[4:]))
        )

    monkeypatch.setattr(rounds, "_searched", searched)
    monkeypatch.setattr(rounds, "judged_with", lambda problem, goal: goal)
    monkeypatch.setattr(rounds, "before_and_after", lambda problem, goal: ("start", goal))
    monkeypatch.setattr(rounds, "tighter", lambda problem, seen, factors: np.ones(1) if seen[1] < 0.57 else None)
    monkeypatch.setattr(rounds, "tightened", lambda problem, factors: problem)
    monkeypatch.setattr(rounds.Tuner, "begin", lambda tuner, z, moving: begun)
    tuner = SimpleNamespace(best=lambda p: p.best[1])
    run = Run(0, tuple(search(goal) for goal in (0.5, 0.62, 0.6, 0.55)), {}, (), ())
    run, seen = rounds._held(SimpleNamespace(tuner=tuner), run, lambda run: None, lambda runs, sets: None)
    assert run.lead.best == (0.0, leads) and seen == ("start", leads)
    assert len(run.tightened) == 1 and run.held == 2
    assert (run.factors_found is None) == (leads == 0.6)  # it is judged by the bounds that were asked for
