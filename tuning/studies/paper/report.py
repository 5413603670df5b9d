"""What the reproduction leaves in its folder: tables, figures, `tables.json`, the report."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

import agvjax

from ...io import files
from ...io.files import Json
from ...io.pages import publish
from ...io.pictures import Drawing, write_figures
from ..captions import caption
from . import cases, figures, tables
from .page import markdown
from .reproduce import Reproduction, sampled_bounds


def write(found: Reproduction, out: Path, command: str, progress: Callable[[str], None]) -> list[str]:
    """Tables, figures and pages into a folder; returns what could not be drawn."""
    content = {name: tables.plain(made) for name, made in found.tables.items()} | data(found)
    for name, made in (*found.tables.items(), ("extras", found.extras)):
        files.write(out / f"{name}.md", tables.markdown(made) + "\n\n" + tables.reasons(made) + "\n")
        files.write_csv(out / f"{name}.csv", tables.COLUMNS, tables.rows(made))
    files.write_json(out / "tables.json", content)
    lost = []
    for name, drawing in _drawings(found).items():
        lost += write_figures(out, {name: lambda name=name, drawing=drawing: caption(name, drawing(), command)})
        progress(f"{name}.png")
    text = markdown(found, command)
    publish(out, text)
    progress("report")
    return lost


def _drawings(found: Reproduction) -> dict[str, Drawing]:
    """The figures by name, not yet drawn."""
    drawings = figures.paper({name: found.trajectories[name] for name in (*figures.ACTUATED, *figures.UNPREPARED)})
    readings = {name: run.trajectory for name, run in found.readings.items()}
    return drawings | {
        "b1": lambda: figures.b1(found.network, float(np.asarray(found.law.k2))),
        "bandwidth": lambda: figures.bandwidth(found.judged),
        "readings": lambda: figures.readings(readings),
        "lyapunov": lambda: figures.lyapunov(found.trajectories["proposed"], *found.lyapunov[:3]),
        "vacuity": lambda: figures.vacuity(found.bounds),
        "event": lambda: figures.event(found.trajectories["event"], found.trajectories["proposed"]),
        "fractional": lambda: figures.fractional(found.judged),
    }


def data(found: Reproduction) -> Json:
    """What `tables.json` holds besides the paper's own tables."""
    nominal = found.lyapunov.report
    return {
        "extras": tables.plain(found.extras),
        "readings": {name: _metrics(run.judged) for name, run in found.readings.items()},
        "table1_cost": found.cost,
        "facts": {
            "a_network": found.network,
            "b_bandwidth": found.bandwidth,
            "c_compensator": {"largest_sensitivity": found.lyapunov.sensitivity, "largest_xi2": found.lyapunov.xi2},
            "d_bounds": sampled_bounds(found),
        },
        "lyapunov": {
            "constants": {k: float(v) for k, v in vars(found.lyapunov.constants).items()},
            "margins": found.lyapunov.margins,
            "nominal": {k: np.asarray(getattr(nominal, k)).tolist() for k in ("observed", "printed", "corrected")},
        },
        "event": found.updates | {"zeno": found.zeno},
        "fractional": {f"{lam:g}": _metrics(found.judged[f"lam={lam:g}"].judged) for lam in cases.ORDERS},
    }


def _metrics(metrics: agvjax.Metrics) -> Json:
    names = ("settling_time", "rmse", "rmse_late", "rms_command", "peak_command", "chatter")
    said = {
        name: [tables.number(v, name) if np.isinf(v) else v for v in np.asarray(getattr(metrics, name)).tolist()]
        for name in names
    }
    return said | {"ok": bool(metrics.ok)}
