"""Figures that cannot be drawn become pictures that say so; those of the commands are drawn whatever their numbers."""

import io
import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from runs import trajectory
from tuning.identify import figures as identify
from tuning.identify.excitation import Drive
from tuning.identify.predict import Prediction
from tuning.io.pictures import write_figures
from tuning.studies.paper import figures as paper
from tuning.tune import figures as tune
from tuning.tune import pareto
from tuning.tune.methods.method import Progress
from tuning.tune.rounds import Run

ODD = [np.nan, *(pytest.param(x, marks=pytest.mark.slow) for x in (7.0, 5e-324, 1e99, 1e300, np.inf))]
T = np.linspace(0.0, 1.0, 11)


def sound():
    figure = Figure()
    figure.subplots().plot([0, 1], [0, 1])
    return figure


def limits_of_no_number():
    figure = sound()
    figure.axes[0].set_ylim(0, np.nan)
    return figure


def ticks_at_infinity():
    figure = sound()
    figure.axes[0].set(yscale="log", ylim=(1e-300, 1.7e308))
    return figure


def test_what_cannot_be_drawn_is_said_in_its_place_and_the_others_are_drawn(tmp_path):
    drawings = {"a": sound, "b": limits_of_no_number, "c": ticks_at_infinity, "d": lambda: [][0], "e": sound}
    with pytest.raises(IndexError):  # a mistake of the program is none of the numbers
        write_figures(tmp_path, drawings)
    (tmp_path / "c.png").unlink()
    del drawings["d"]
    said = write_figures(tmp_path, drawings)
    assert [text.partition(" could not be drawn")[0] for text in said] == ["b.png", "c.png"]
    sizes = [imread(tmp_path / f"{name}.png").shape[:2] for name in drawings]
    assert sizes[0] == sizes[3] and sizes[1] == sizes[2] != sizes[0]
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"{name}.png" for name in sorted(drawings)]


def test_a_busy_machine_is_told_nothing_of_legends(tmp_path, monkeypatch):
    """Matplotlib warns where the best place of a legend takes it a second, here by a clock that runs fast."""

    def with_legend():
        figure = sound()
        figure.axes[0].plot([0, 1], label="one")
        figure.axes[0].legend()
        return figure

    monkeypatch.setattr("matplotlib.legend.time", SimpleNamespace(perf_counter=itertools.count(step=2).__next__))
    with pytest.warns(UserWarning, match="Creating legend"):
        with_legend().savefig(io.BytesIO())
    assert write_figures(tmp_path, {"a": with_legend}) == []  # a warning is an error here


def odd(value):
    one, pair, each = (np.full((T.size, *shape), value) for shape in ((), (2,), (3,)))
    places = {"position": pair, "heading": one, "reference_position": 0 * pair if value < 1e99 else -pair}
    return trajectory(T, **places, velocity=pair, command=each, reference_heading=-one, weight_norm=pair)


def search(value):
    point = np.zeros(2)
    row = (0, value, value, value, 0.0, 1.0, 0, 0, 3, 1.0, value)
    return Progress(1, point, (), point, point, (0.0, value), 0, 0, 0, 3, [row], np.ones(2, bool))


@pytest.mark.parametrize("value", ODD)
def test_the_figures_of_commands_are_drawn_whatever_their_numbers(value, tmp_path):
    run, ordinary = odd(value), odd(7.0)
    points = [pareto.Point(f, value, f < 2, False, None, [], 1) for f in (0.5, 1.0, 2.0)]
    drive = Drive(T, ("torque",), np.full((T.size, 1), value), np.full((T.size, 2), value), T, {}, 1)
    runs = {name: run for name in (*paper.ACTUATED, *paper.UNPREPARED)}
    drawings = {
        "tracking": lambda: tune.tracking_figure(ordinary, run, "title"),
        "history": lambda: tune.history_figure(("k1", "k2"), (1.0, 1.0), Run(0, (search(value),), {}, (), ())),
        "pareto": lambda: pareto.figure(points, np.full((4, 2), value), np.full((4, 2), value), "effort", "rmse"),
        "predictions": lambda: identify.predictions(
            [Prediction("log", 1.0, 1, value, value, T[None], value + 0 * T[None])]
        ),
        "drive": lambda: identify.drive(drive),
        "readings": lambda: paper.readings({"default": ordinary, "other": run}),
        "event": lambda: paper.event(run, ordinary),
        **{
            name: drawing for name, drawing in paper.paper(runs).items() if name in ("fig03", "fig07", "fig08", "fig10")
        },
    }
    said = write_figures(tmp_path, drawings)
    assert {path.stem for path in tmp_path.iterdir()} == set(drawings)
    assert said == []
