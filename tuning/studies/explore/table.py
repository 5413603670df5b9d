"""The table of metrics: the run, and the ensemble's mean and worst, now and as configured."""

from __future__ import annotations

import math
from collections.abc import Mapping

from agvjax.metric_table import metrics_of
from agvjax.metric_units import units_in

from ...config.settings import FOLLOWED_METRICS, SWEPT_METRICS, Config
from .rollout import VEHICLES, Judged

STYLE = """<style>
table.m { border-collapse: collapse; font-size: 12.5px; font-variant-numeric: tabular-nums; }
table.m td, table.m th { padding: 1px 6px; text-align: right; border-bottom: 1px solid #e2e2e2; }
table.m td, table.m th { white-space: nowrap; }
table.m td:first-child, table.m th:first-child { text-align: left; }
table.m span { color: #777; font-size: 11.5px; margin-left: 6px; }
p.m { font-size: 12px; color: #444; margin: 4px 0; }
p.lost { color: #a11212; font-weight: bold; margin: 4px 0; }
</style>"""


def table(config: Config, now: Judged, before: Judged, serial: int = 0) -> str:
    """The table as HTML; `serial` says how often it was written."""
    heads = ("metric", "this run", f"mean of {VEHICLES}", f"worst of {VEHICLES}")
    lines = ["<tr>" + "".join(f"<th>{head}</th>" for head in heads) + "</tr>"]
    units = units_in(config.scenario)
    for name in rows(config):
        pairs = ((now.metrics, before.metrics), (now.mean, before.mean), (now.worst, before.worst))
        label = f"{name.replace('_', ' ')}<span>{units[name].replace('share of', 'of')}</span>"
        cells = [label, *(_cell(name, *pair) for pair in pairs)]
        lines.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    note = f"Grey: as configured, if different. {VEHICLES} vehicles, drawn and simulated as by agvjax tune."
    inner = f'{_lost(now)}<table class="m">{"".join(lines)}</table><p class="m">{note}</p>'
    return f'{STYLE}<div data-serial="{serial}">{inner}</div>'


def rows(config: Config) -> list[str]:
    """The metrics that are shown: those that tuning works on first, then those of every table."""
    there = metrics_of(config.scenario)
    wanted = [*config.tune.goals, *config.tune.limits, *SWEPT_METRICS, *FOLLOWED_METRICS]
    wanted += [f"rmse_{axis}" for axis in ("x", "y", "heading")] + ["reversals", "limited"]
    return [name for name in dict.fromkeys(wanted) if name in there]


def _cell(name: str, now: Mapping[str, float], before: Mapping[str, float]) -> str:
    here, there = _number(name, now[name]), _number(name, before[name])
    return here if here == there else f"{here}<span>{there}</span>"


def _number(name: str, value: float) -> str:
    if math.isfinite(value):
        return f"{value:.4g}"
    return "not settled" if "settling" in name else "not finished" if "finish" in name else "-"


def _lost(now: Judged) -> str:
    """What has diverged, in words; empty where nothing has."""
    said = [] if now.ok else ["This run diverged and is frozen where it exceeded scenario.limit."]
    said += [f"{now.lost} of the {VEHICLES} vehicles diverged."] if now.lost else []
    return f'<p class="lost">{" ".join(said)}</p>' if said else ""
