"""The figures of the page, and what they look like."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

import numpy as np
from bokeh.models import BasicTicker, ColumnDataSource, Div, Range1d
from bokeh.plotting import figure

from ...config.settings import Config
from .rollout import Shown, error_labels

LEFT = 330  # px, of the sliders
HEIGHT = 140  # px, of a curve over time
NOW, BEFORE, DELIVERED = "#1f4e9c", "#8c8c8c", "#e08a00"  # dark, grey and dashed, light: told apart without colour too
GOOD, BAD = "font-size: 14px; color: #1c5c2e", "font-size: 14px; color: #a11212; font-weight: bold"
SMALL = ":host { font-size: 12px }"
SCROLLS = {"max-height": "calc(100vh - 60px)", "overflow-y": "auto", "overflow-x": "hidden", "padding-right": "6px"}
BUTTONS = {"tune": "Tune from here", "save": "Save", "reset": "Reset"}
TOOLS = "pan,box_zoom,wheel_zoom,reset,save"
Figures = tuple[figure, list[figure], list[figure]]


def columns(shown: Shown) -> dict[str, np.ndarray]:
    """The curves as columns (n,) of one source."""
    found = {}
    for name, curve in shown.curves.items():
        found |= {name: curve} if curve.ndim == 1 else {f"{name}{i}": x for i, x in enumerate(curve.T)}
    return found


def figures(config: Config, time: Range1d, now: ColumnDataSource, before: ColumnDataSource) -> Figures:
    """The path, a figure for each error, and one for each actuator; those over time show the same `time`."""
    path = figure(height=380, match_aspect=True, title="Path", x_axis_label="x [m]", y_axis_label="y [m]", **_usual())
    path.line("path0", "path1", source=before, color="black", line_width=1, legend_label="path")
    path.line("position0", "position1", source=before, legend_label="configured", **_grey())
    path.line("position0", "position1", source=now, color=NOW, line_width=2, legend_label="now")
    path.toolbar.update(autohide=True, logo=None)
    _legend(path, "top_right")
    errors = []
    for i, (name, unit) in enumerate(error_labels(config)):
        errors.append(_over_time(f"{name[0].upper()}{name[1:]} [{unit}]", time))
        errors[-1].line("t", f"errors{i}", source=before, **_grey())
        errors[-1].line("t", f"errors{i}", source=now, color=NOW, line_width=1.8)
    return path, errors, _actuators(config, time, now, before)


def _actuators(config: Config, time: Range1d, now: ColumnDataSource, before: ColumnDataSource) -> list[figure]:
    plant = config.scenario.plant
    parts = [(part, plant.units.get(part, plant.units.get(a, ""))) for a in plant.actuators for part in plant.parts(a)]
    found = []
    for i, (part, unit) in enumerate(parts):
        drawn = _over_time(f"Command of {part.replace('_', ' ')} [{unit}]", time)
        drawn.line("t", f"asked{i}", source=before, legend_label="configured", **_grey())
        drawn.line("t", f"asked{i}", source=now, color=NOW, line_width=1.6, legend_label="asked")
        drawn.line("t", f"delivered{i}", source=now, color=DELIVERED, line_width=1.4, legend_label="delivered")
        drawn.legend.visible = not i
        _legend(drawn, "bottom_right")
        found.append(drawn)
    found[-1].xaxis.axis_label = "time [s]"
    found[-1].height += 20
    return found


def _over_time(title: str, time: Range1d) -> figure:
    """An empty figure over time, whose height fits what its width shows."""
    drawn = figure(height=HEIGHT, title=title, x_range=time, window_axis="x", **_usual())
    drawn.yaxis.ticker = BasicTicker(desired_num_ticks=4)
    drawn.axis.minor_tick_line_color = None
    drawn.toolbar.update(autohide=True, logo=None)
    return drawn


def _usual() -> dict[str, Any]:
    size = {"sizing_mode": "stretch_width", "min_width": 300}
    return size | {"tools": TOOLS, "active_drag": "box_zoom"}


def _grey() -> dict[str, Any]:
    return {"color": BEFORE, "line_width": 1.3, "line_dash": "dashed"}


def _legend(drawn: figure, where: str) -> None:
    drawn.legend.update(location=where, orientation="horizontal", label_text_font_size="12px", padding=3, margin=4)
    drawn.legend.background_fill_alpha = 0.75


def heading(text: str) -> Div:
    """A heading above sliders."""
    return Div(text=f"<b style='font-size: 15px'>{text}</b>", margin=(8, 8, 2, 8))


def fixed(sentences: Sequence[str]) -> Div:
    """What cannot be moved here."""
    lines = "".join(f"<li>{html.escape(text)}</li>" for text in sentences)
    style = "font-size: 12px; color: #444; padding-left: 16px; margin: 2px 0"
    return Div(text=f"<b>Fixed here</b><ul style='{style}'>{lines}</ul>", width=LEFT - 50, margin=(10, 8, 8, 8))
