"""Runs of several starts and rounds: which search leads, and what is said of a round that came to nothing."""

import numpy as np
import pytest

from tuning.tune.figures import history_figure
from tuning.tune.methods.method import Progress
from tuning.tune.rounds import Run


def search(cost):
    """One iteration of two gains that came to this cost."""
    point = np.zeros(2)
    row = (0, cost, cost, 0.0, 0.0, 1.0, 0, 0, 3, 1.0, 2.0)  # HISTORY, then the gains
    return Progress(1, point, (), point, point, (0.0, cost), 0, 0, 0, 3, [row])


@pytest.mark.parametrize("costs", [(1.0, 2.0, 3.0), (3.0, 1.0, 2.0), (2.0, 3.0, 1.0), (1.0, 1.0, 1.0)])
def test_the_history_of_whichever_start_leads_is_drawn(costs):
    run = Run(0, tuple(search(cost) for cost in costs), {}, (), ())
    figure = history_figure(("k1", "k2"), run)
    (goal,) = (line for line in figure.axes[0].get_lines() if line.get_label() == "goal")
    assert goal.get_ydata() == [min(costs)]
