"""The report: what of the paper holds, in the paper's order; every number in it is computed."""

from __future__ import annotations

import numpy as np

from ...io.pages import grid
from ..captions import image
from . import tables
from .bounds import VACUOUS
from .cases import LABELS
from .published import CHANNELS
from .reproduce import Reproduction, sampled_bounds


def summary(found: Reproduction) -> str:
    """How many cells of Tables 1 and 2 hold, and what to say in one breath."""
    lines = []
    for name, word in (("table1", "Table 1"), ("table2", "Table 2")):
        pairs = tables.pairs(found.judged, tables.PRINTED[name])
        for metric, count in tables.counts(found.tables[name]).items():
            lines.append([word, metric, *count.values(), "{} of {}".format(*pairs[metric])])
    return grid(
        ["", "metric", "reproduced", "ordering only", "not", "comparisons of two controllers as printed"], lines
    )


def horizons(found: Reproduction) -> str:
    """Over which horizon our RMSE is the printed one: there is no common one, which is why RMSE is not reproduced."""
    lines, spread = [], []
    for name, printed in tables.TABLE2.items():
        values = [tables.horizon(found.trajectories[name], i, printed.rmse[i]) for i in range(3)]
        settled = found.judged[name].judged.settling_time
        spread += [v for v in values if not np.isnan(v)]
        cells = ["none" if np.isnan(v) else f"{v:.2f}" for v in values]
        lines.append([LABELS[name], *cells, *(tables.number(float(s), "settling_time") for s in settled)])
    table = grid(["controller", *(f"{c} [s]" for c in CHANNELS), *(f"settles {c}" for c in CHANNELS)], lines)
    if not spread:
        return f"{table}\n\n"
    span = f"{min(spread):.2f} s to {max(spread):.2f} s"
    return f"{table}\n\nThey range from {span}: no one horizon gives the printed column."


def network(found: Reproduction) -> str:
    """Fact (a)."""
    header = ["b1 = b2", "slopes", "largest network gain, position [1/s]", "heading [1/s]", "RMSE x", "y", "psi"]
    lines = []
    for row in found.network:
        b1 = "no network" if row["b1"] is None else f"{row['b1']:g}"
        slopes = "known" if row["known_slopes"] else "assumed"
        errors = [f"{row[f'rmse_{c}']:.5f}" for c in CHANNELS]
        lines.append([b1, slopes, row["gain_position"], row["gain_heading"], *errors])
    return grid(header, lines)


def bandwidth(found: Reproduction) -> str:
    """Fact (b): which law beats the proposed one at matched gains, in how many of the three channels."""
    header = ["p [1/s]", "law", "RMSE better in", "RMSE after 4 s better in", "settles earlier in"]
    lines = []
    for row in found.bandwidth:
        better = [", ".join(row[f"better_{m}"]) or "none" for m in ("rmse", "rmse_late", "settling_time")]
        lines.append([f"{row['p']:g}", LABELS[row["law"]], *better, row["peak_law"], row["peak_proposed"]])
    return grid([*header, "peak command", "proposed"], lines)


def readings(found: Reproduction) -> str:
    """Every reading with its RMSE and settling times."""
    header = ["reading", "RMSE x", "y", "psi", "after 4 s x", "y", "psi", "settles x [s]", "y", "psi"]
    lines = []
    for name, run in found.readings.items():
        m = run.judged
        settled = [tables.number(float(s), "settling_time") for s in m.settling_time]
        lines.append([name, *(f"{v:.4f}" for v in (*m.rmse, *m.rmse_late)), *settled])
    return grid(header, lines)


def bounds(found: Reproduction) -> str:
    """Printed and corrected bounds beside what was observed."""
    nominal, sampled = found.lyapunov.report, sampled_bounds(found)
    header = ["", "observed", "printed bound", "/ observed", "corrected bound", "/ observed"]
    lines = []
    for i, name in enumerate(("position, sup of the norm of Z1 after 4 s [m]", "heading, sup of Z3 after 4 s [rad]")):
        seen, printed, corrected = (float(x[i]) for x in (nominal.observed, nominal.printed, nominal.corrected))
        lines.append([name, seen, printed, printed / seen, corrected, corrected / seen])
    text = grid(header, lines) + "\n\n"
    header = ["bound / observed", "median", "smallest", "largest", f"vacuous (> {VACUOUS:g})", "violated (< 1)"]
    lines = []
    for which in ("printed", "corrected"):
        for i, channel in enumerate(("position", "heading")):
            row = sampled[which]
            values = [row[k][i] for k in ("median", "smallest", "largest")]
            counts = [f"{row[k][i]} of {sampled['scenarios']}" for k in ("vacuous", "violated")]
            lines.append([f"{which}, {channel}", *values, *counts])
    return text + grid(header, lines)


def constants(found: Reproduction) -> str:
    """a1..a6 and what they are made of; the margins."""
    values, margins = found.lyapunov.constants, found.lyapunov.margins
    first = grid(["constant", "value"], [[k, float(v)] for k, v in vars(values).items()])
    second = grid(["stability condition, must be > 0", "margin"], [list(row) for row in margins.items()])
    return f"{first}\n\n{second}"


def event(found: Reproduction) -> str:
    """Updates saved, and the Zeno check."""
    u, z = found.updates, found.zeno
    lines = []
    for i, channel in enumerate(("u_x", "u_y", "omega")):
        shortest = [f"{row['shortest'][i]:.3g}" for row in z["steps"]]
        verdict = "grid-limited" if z["grid_limited"][i] else "its own"
        saved = f"{1 - u['updates'][i] / u['of']:.1%}"
        lines.append([channel, u["updates"][i], saved, *shortest, f"{z['bound'][i]:.2g}", verdict])
    header = ["command", "updates", f"saved of {u['of']}"]
    header += [f"shortest interval [s] at step {row['dt']:.3g} s" for row in z["steps"]]
    return grid([*header, "bound m / sup of the rate [s]", "shortest is"], lines)


def relative(found: Reproduction, name: str) -> str:
    """RMSE of a case relative to the proposed law's, by channel."""
    mine, base = (np.asarray(found.judged[n].judged.rmse) for n in (name, "proposed"))
    return ", ".join(f"{c} {m / b - 1:+.1%}" for c, m, b in zip(CHANNELS, mine, base, strict=True))


def cost(found: Reproduction) -> str:
    """Table 1's argument, measured."""
    header = ["adapted weights of each network", "numbers adapted", "states of the law"]
    lines = [
        [name, row["adapted"], row["states"], f"{row['time']:.2f}", "{:.2f} to {:.2f}".format(*row["time_spread"])]
        for name, row in found.cost.items()
    ]
    return grid([*header, "run time of a step / one parameter's", "spread"], lines)


def paper_section(found: Reproduction, first: int, last: int) -> str:
    """Figures of the paper by number."""
    return "\n\n".join(image(f"fig{i:02}") for i in range(first, last + 1))


# long: one template
def markdown(found: Reproduction, command: str) -> str:
    """`report.md`."""
    config, sweep = found.config, found.network
    default = next(r for r in sweep if r["b1"] == 1.0 and not r["known_slopes"])
    k2 = float(np.asarray(found.law.k2))
    without = sweep[-1]
    change = max(abs(default[f"rmse_{c}"] / without[f"rmse_{c}"] - 1) for c in CHANNELS)
    return f"""# Can the paper be reproduced? Its tables and figures, rebuilt

Maaruf & Mysorewala, *Neuro-adaptive path following control of autonomous ground vehicles with input deadzone*, Discover
Applied Sciences 6:415 (2024). Made by `{command}`: {config.simulate.horizon:g} s,
{config.simulate.integrator.upper()} at {config.simulate.dt:g} s, {config.precision}-bit. No gain and no
reading was tuned to match a printed number.

{summary(found)}

{tables.RULES} RMSE is over the whole lap by the trapezoidal rule; a channel has settled when it stays within 0.05 (m or
rad) to the end, and is unsettled when it leaves that band in the last second. Where the paper is silent or contradicts
itself a reading was chosen (R1 to R18); those that matter are compared below. OSFC, ASMC, DFC and FTSMC are laws
of the class that the paper names, with gains of our choice, since it gives neither their equations nor their gains.

## The paper's figures and tables, in its order

{paper_section(found, 3, 11)}

### Table 1. The proposed law with one parameter, 5 and 50 weights

{tables.markdown(found.tables["table1"])}

{tables.reasons(found.tables["table1"])}

The computational cost, which the table is about, measured in one run with the laws interleaved:

{cost(found)}

{paper_section(found, 12, 16)}

### Table 2. The controllers

{tables.markdown(found.tables["table2"])}

{tables.reasons(found.tables["table2"])}

The longest horizon over which our RMSE equals the printed one, and when each law settles here:

{horizons(found)}

Without the deadzone the laws that the paper calls unprepared for it give:

{tables.markdown(tables.table(found.judged, {}, ("dfc without deadzone", "ftsmc without deadzone")))}

## What matters

### (a) The missing b1 decides whether the controller is neural

The paper does not print b1 and b2. At 1, our default, the network's gain is at most
{default["gain_position"]:.3g}, against k2 = {k2:g}; removing the network changes no RMSE
by more than {change:.2%}.

{network(found)}

{image("b1")}

### (b) The ranking is mostly one of gains

Every law with gains for the same closed-loop bandwidth p: the channels in which it beats the proposed law.

{bandwidth(found)}

{image("bandwidth")}

Which law is better at equal command effort is answered by `agvjax compare`, not by this table nor by Table 2.

### (c) The compensator (23) changes no command

Largest derivative of a command in xi1 along the run: {found.lyapunov.sensitivity:g}; largest |xi2|:
{found.lyapunov.xi2:g}.

### (d) The printed ultimate bound says nothing

{bounds(found)}

{image("vacuity")}

{image("lyapunov")}

The corrected bounds, their proof and their conditions are in `tuning/studies/paper/bounds.py` (R14).

{constants(found)}

### Readings

{readings(found)}

{image("readings")}

### Ablations and extras

{tables.markdown(found.extras)}

## The paper's future work

### Event-triggered

Held until it differs by 10 % and 0.1; RMSE against the continuous law: {relative(found, "event")}.

{event(found)}

The shortest interval is determined at ever finer steps; if it keeps shrinking with the step, it is that of the grid
and not of the law.

{image("event")}

### Fractional-order integral

Order 0.8 instead of 1; RMSE against the paper's law: {relative(found, "fractional")}.

{image("fractional")}

## Data

`tables.json`: controller -> channel -> metric -> ours, paper, verdict, why; and every fact above. `table1.csv`,
`table2.csv`, `extras.csv`, the same tables as Markdown, `config.toml`.
"""
