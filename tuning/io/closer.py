"""Runs and recordings as interactive figures: those of `agvjax explore`, and pages to look closer, without a network.

Bokeh, of the extra `explore`, is imported with this module.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.embed import file_html
from bokeh.layouts import column, row
from bokeh.models import BasicTicker, ColumnDataSource, Div, Range1d, UIElement
from bokeh.plotting import figure
from bokeh.resources import INLINE

import agvjax
from agvjax.draw.plot import outline, shown
from agvjax.protocols import Plant

from .curves import Track, columns, error_labels, of_run
from .files import write

HEIGHT = 140  # px, of a curve over time
NOW, BEFORE, DELIVERED = "#1f4e9c", "#8c8c8c", "#e08a00"  # dark, grey and dashed, light: told apart without colour too
TOOLS = "pan,box_zoom,wheel_zoom,reset,save"
MOST = 4000  # samples of a run; of more, every second, third, ...
HELP = (
    "Draw a box to look closer; wheel: zoom; reset at the top right of each figure. All curves over time move together."
)
Keywords = dict[str, Any]
Figures = tuple[figure, list[figure], list[figure]]


def write_page(path: Path, scenes: Mapping[str, tuple[agvjax.Scenario, Sequence[agvjax.Trajectory]]]) -> None:
    """A page of HTML that needs no other file.

    Args:
        path: of the file.
        scenes: by title, a scenario and its runs with the starting and with the tuned gains.
    """
    parts: list[UIElement] = [Div(text=f"<h1>Runs</h1><p>{HELP}</p>")]
    for title, (scenario, runs) in scenes.items():
        every = -(-len(np.asarray(runs[0].t)) // MOST)
        title += f", one sample in {every}" if every > 1 else ""
        before, now = (ColumnDataSource(data=_table(run, every)) for run in runs)
        time = Range1d(start=0, end=float(np.asarray(runs[0].t)[-1]))
        track, errors, actuators = figures(scenario, time, now, before, ("tuned", "starting gains"))
        curves = column(*errors, *actuators, sizing_mode="stretch_width")
        parts += [Div(text=f"<h2>{escape(title)}</h2>"), row(track, curves, sizing_mode="stretch_width")]
    text = file_html(column(*parts, sizing_mode="stretch_width"), INLINE, "agvjax: runs")
    write(path, _numbered(text))


def write_logs(path: Path, logs: Sequence[tuple[str, Track, Track]]) -> None:
    """Such a page of recordings and what a model makes of them.

    Args:
        path: of the file.
        logs: the name of each, what was measured and sent, and the model, with how far off it was.
    """
    parts: list[UIElement] = [Div(text=f"<h1>Recordings and the model</h1><p>{HELP}</p>")]
    for title, *tracks in logs:
        every = [-(-len(track.t) // MOST) for track in tracks]
        for what, one in zip(("what was measured", "the model"), every, strict=True):
            title += f"; of {what} one sample in {one}" if one > 1 else ""
        plane, *others = _compared(*map(_thinned, tracks, every))
        curves = column(*others, sizing_mode="stretch_width")
        parts += [Div(text=f"<h2>{escape(title)}</h2>"), row(plane, curves, sizing_mode="stretch_width")]
    text = file_html(column(*parts, sizing_mode="stretch_width"), INLINE, "agvjax: recordings")
    write(path, _numbered(text))


def _thinned(track: Track, every: int) -> Track:
    numbers = {name: x[::every] for name, x in track.numbers.items()}
    return track._replace(t=track.t[::every], pose=track.pose[::every], numbers=numbers)


def _compared(measured: Track, model: Track) -> list[figure]:
    """The plane; over time what is left of position and heading, and each command that was sent."""
    plane = _plane("Measured and modelled")
    plane.scatter(*measured.pose.T[:2], color=BEFORE, size=3, legend_label="measured")
    plane.line(*_gaps(model.t, model.pose).T[:2], color=NOW, line_width=1.6, legend_label="model")
    _legend(plane, "top_right")
    time, found = Range1d(start=float(measured.t[0]), end=float(measured.t[-1])), [plane]
    off = {"Off in position [mm]": ("position", 1e3), "Off in heading [deg]": ("heading", np.degrees(1.0))}
    for title, (name, scale) in off.items():
        found.append(_over_time(title, time))
        found[-1].scatter(model.t, shown(scale * model.numbers[f"error/{name}"]), color=NOW, size=2)
    for name, values in measured.numbers.items():
        found.append(_over_time(f"Sent: {name.rpartition('/')[2].replace('_', ' ')}", time))
        found[-1].step(measured.t, shown(values), mode="after", color=DELIVERED, line_width=1.4)
    return _timed(found)


def _gaps(t: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Poses with a gap wherever a stretch ends: the model begins the next one anew."""
    ends = np.flatnonzero(np.diff(t) > 2.5 * np.median(np.diff(t))) + 1 if len(t) > 2 else []
    return np.insert(shown(pose), ends, np.nan, axis=0)


def _table(run: agvjax.Trajectory, every: int) -> Keywords:
    return dict(columns({name: shown(x)[::every] for name, x in of_run(run).items()}))


def _numbered(text: str) -> str:
    """The page with its parts named by number, not at random or on from the last page: the same runs, the same file."""
    head, body = text.split("</head>", 1)
    names = dict.fromkeys(re.findall(r"[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}|\bp\d{4,}\b", body))
    numbers = {name: f"part{i}" for i, name in enumerate(names)}
    body = re.sub("|".join(rf"\b{name}\b" for name in numbers), lambda match: numbers[match[0]], body)
    return f"{head}</head>{body}"


def figures(
    scenario: agvjax.Scenario,
    time: Range1d,
    now: ColumnDataSource,
    before: ColumnDataSource,
    names: tuple[str, str] = ("now", "configured"),
) -> Figures:
    """The path, a figure for each error, and one for each actuator; those over time show the same `time`.

    Args:
        scenario: whose errors and actuators there are.
        time: the range [s] that all curves over time show.
        now: a run, by `curves.columns`.
        before: another, drawn in grey.
        names: of these.
    """
    path = _plane("Path")
    black: Keywords = {"color": "black", "line_width": 1, "legend_label": "path"}
    if isinstance(scenario.path, agvjax.Route):  # whole, however far a run came
        path.line(*outline(scenario.path)[0].T, **black)
    else:
        path.line("path0", "path1", source=before, **black)
    path.line("position0", "position1", source=before, legend_label=names[1], **_grey())
    path.line("position0", "position1", source=now, color=NOW, line_width=2, legend_label=names[0])
    _legend(path, "top_right")
    errors = []
    for i, (name, unit) in enumerate(error_labels(scenario)):
        errors.append(_over_time(f"{name[0].upper()}{name[1:]} [{unit}]", time))
        errors[-1].line("t", f"errors{i}", source=before, **_grey())
        errors[-1].line("t", f"errors{i}", source=now, color=NOW, line_width=1.8)
    return path, errors, _actuators(scenario.plant, time, now, before, names[1])


def _actuators(plant: Plant, time: Range1d, now: ColumnDataSource, before: ColumnDataSource, name: str) -> list[figure]:
    parts = [(part, plant.units.get(part, plant.units.get(a, ""))) for a in plant.actuators for part in plant.parts(a)]
    found = []
    for i, (part, unit) in enumerate(parts):
        drawn = _over_time(f"Command of {part.replace('_', ' ')} [{unit}]", time)
        drawn.line("t", f"asked{i}", source=before, legend_label=name, **_grey())
        drawn.line("t", f"asked{i}", source=now, color=NOW, line_width=1.6, legend_label="asked")
        drawn.line("t", f"delivered{i}", source=now, color=DELIVERED, line_width=1.4, legend_label="delivered")
        drawn.legend.visible = not i
        _legend(drawn, "bottom_right")
        found.append(drawn)
    return _timed(found)


def _timed(figures: list[figure]) -> list[figure]:
    """The figures, the lowest with the name of the axis below all."""
    figures[-1].xaxis.axis_label = "time [s]"
    figures[-1].height = HEIGHT + 20
    return figures


def _plane(title: str) -> figure:
    """An empty figure of the plane."""
    drawn = figure(height=380, match_aspect=True, title=title, x_axis_label="x [m]", y_axis_label="y [m]", **_usual())
    drawn.toolbar.update(autohide=True, logo=None)
    return drawn


def _over_time(title: str, time: Range1d) -> figure:
    """An empty figure over time, whose height fits what its width shows."""
    drawn = figure(height=HEIGHT, title=title, x_range=time, window_axis="x", **_usual())
    drawn.yaxis.ticker = BasicTicker(desired_num_ticks=4)
    drawn.axis.minor_tick_line_color = None
    drawn.toolbar.update(autohide=True, logo=None)
    return drawn


def _usual() -> Keywords:
    size = {"sizing_mode": "stretch_width", "min_width": 300}
    return size | {"tools": TOOLS, "active_drag": "box_zoom"}


def _grey() -> Keywords:
    return {"color": BEFORE, "line_width": 1.3, "line_dash": "dashed"}


def _legend(drawn: figure, where: str) -> None:
    drawn.legend.update(location=where, orientation="horizontal", label_text_font_size="12px", padding=3, margin=4)
    drawn.legend.background_fill_alpha = 0.75
