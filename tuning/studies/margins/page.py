"""What the margins of a loop say: sentences, table, figures, page."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import control
import numpy as np

from agvjax.linear import JUMP, SLOWEST

from ...config.settings import Config
from ...io import files, statements
from ...io.pages import grid, picture, publish
from ...io.pictures import write_figures
from . import cycles_page, figures
from .cycles import Predicted
from .harmonics import HARMONICS
from .loops import Margins
from .study import Found

USUAL = {"gain": 2.0, "phase": np.radians(30), "sensitivity": 2.0}  # Astrom and Murray, Feedback Systems, sec. 10.3

CAPTIONS = {
    "along": "Smallest delay margin and largest Ms of every actuator's loop along the run.",
    "bode": "Bode plot of the tightest loop, and of the configured vehicle's at the same instant.",
    "cycles": "The loop L(jw) and -1/N of the nonlinear elements: where they cross, a limit cycle is predicted.",
}
WHY = "something is at a limit there, the command jumps, or a derivative is not finite"


class Told(NamedTuple):
    """What is printed, and why the gains should not be used; empty where nothing speaks against them."""

    text: str
    failure: str


class Worst(NamedTuple):
    """Where a loop is tightest."""

    vehicle: int  # 0: the configured one
    instant: int
    input: int
    margins: Margins


def tightest(found: Found) -> Worst | None:
    """The loop with the smallest delay margin; None if no loop could be linearised."""
    delays = found.values("delay")
    if not np.isfinite(delays).any():
        return None
    v, k, i = np.unravel_index(np.nanargmin(delays), delays.shape)
    return Worst(int(v), int(k), int(i), found.margins[v][k][i])


def sentences(found: Found, names: list[str]) -> tuple[list[str], str]:
    """What is found, the most important first, and why that is a failure."""
    vehicles, worst, said, failure = len(found.ok), tightest(found), [], ""
    lost = int(np.sum(~found.ok))
    unstable = int(np.sum(np.any(found.values("sensitivity") == np.inf, axis=(1, 2))))
    if lost:
        failure = f"{lost} of {vehicles} runs diverge."
    elif unstable:
        failure = f"The loop of {unstable} of {vehicles} vehicles is unstable somewhere along its run."
    if failure:
        said.append(failure)
    if worst is None:
        said.append(f"No loop could be linearised at any instant: {WHY}.")
        return said, failure or said[-1]
    m, whose = worst.margins, f"vehicle {worst.vehicle}" if worst.vehicle else "the configured vehicle"
    where = f"of {whose} at {found.t[worst.instant]:.4g} s, at {names[worst.input]}"
    if m.delay > 0:
        said.append(
            f"The tightest loop, {where}, tolerates {1e3 * m.delay:.3g} ms more delay, {_times(m.gain)} gain and"
            f" {np.degrees(m.phase):.3g} degrees of lag."
        )
    else:
        said.append(f"The tightest loop is {where}.")
    said += _below(found)
    left = int(np.sum(found.left_out))
    if left:
        said.append(f"{left} of {found.left_out.size} instants are left out: {WHY}.")
    return said, failure


def _below(found: Found) -> list[str]:
    """How many vehicles fall below what is usual."""
    said, vehicles = [], len(found.ok)
    bulk = float(np.nanquantile(found.values("delay"), 0.05, method="nearest"))
    said.append(f"95 % of the loops tolerate at least {1e3 * bulk:.3g} ms more delay.")
    for name, unit in (("gain", "a gain margin below"), ("phase", "a phase margin below")):
        values = found.values(name)
        below = int(np.sum(np.nanmin(np.where(np.isnan(values), np.inf, values), axis=(1, 2)) < USUAL[name]))
        bound = f"{USUAL[name]:g}" if name == "gain" else f"{np.degrees(USUAL[name]):g} degrees"
        if below:
            said.append(f"{below} of {vehicles} vehicles have {unit} the usual {bound}.")
    peaks = found.values("sensitivity")
    high = int(np.sum(np.nanmax(np.where(np.isnan(peaks), 0, peaks), axis=(1, 2)) > USUAL["sensitivity"]))
    if high:
        said.append(f"{high} of {vehicles} vehicles have an Ms above the usual {USUAL['sensitivity']:g}.")
    return said


def _times(gain: float) -> str:
    return f"{gain:.3g} times its" if np.isfinite(gain) else "any more"


def table(found: Found, names: list[str]) -> str:
    """By input the tightest of each margin, the one that 5 % of the loops fall below, and the median."""
    rows = []
    for i, name in enumerate(names):
        row: list[object] = [name]
        for key, scale, least in (("gain", 1, True), ("less", 1, False), ("phase", 180 / np.pi, True)):
            row += _ends(found.values(key)[:, :, i] * scale, least)
        rows.append(
            row + _ends(found.values("delay")[:, :, i] * 1e3, True) + _ends(found.values("sensitivity")[:, :, i], False)
        )
    heads = ["gain up", "gain down", "phase [degrees]", "more delay [ms]", "Ms"]
    return grid(["input", *(f"{head}, {what}" for head in heads for what in ("tightest", "5 %", "median"))], rows)


def brief(found: Found, names: list[str]) -> str:
    """By input the tightest of each margin, for a terminal."""
    kinds = (("gain", 1, True), ("less", 1, False), ("phase", 180 / np.pi, True), ("delay", 1e3, True))
    kinds += (("sensitivity", 1, False),)
    rows = [
        [name, *(_ends(found.values(key)[:, :, i] * scale, least)[0] for key, scale, least in kinds)]
        for i, name in enumerate(names)
    ]
    return grid(["tightest at", "gain up", "gain down", "phase [degrees]", "more delay [ms]", "Ms"], rows)


def _ends(values: np.ndarray, least: bool) -> list[float]:
    known = values[~np.isnan(values)]
    if not known.size:
        return [np.nan] * 3
    shares = (0.0, 0.05, 0.5) if least else (1.0, 0.95, 0.5)
    return [float(x) for x in np.quantile(known, shares, method="nearest")]


def write(config: Config, found: Found, predicted: Predicted, out: Path) -> Told:
    """Everything into the folder of a run."""
    names = predicted.names
    said, failure = sentences(found, names)
    said += cycles_page.sentences(predicted, found, config.scenario.plant.units)
    rows = [
        [v, float(found.t[k]), names[i], bool(found.left_out[v, k]), bool(found.ok[v]), *m]
        for v, vehicle in enumerate(found.margins)
        for k, now in enumerate(vehicle)
        for i, m in enumerate(now)
    ]
    header = ["vehicle", "t [s]", "input", "left out", "ok", "gain", "less", "phase [rad]", "delay [s]", "Ms"]
    files.write_csv(out / "margins.csv", [*header, "crossover [rad/s]", "growth [1/s]"], rows)
    files.write_csv(out / "cycles.csv", cycles_page.HEADER, cycles_page.rows(predicted, found.t))
    drawings = {}
    worst = tightest(found)
    if worst is not None:
        drawings["along"] = lambda: figures.along(found.t, found.values("delay"), found.values("sensitivity"), names)
        drawings["bode"] = lambda: figures.bode(_shown(found, worst, names), found.period)
    if (shown := predicted.shown) is not None:
        drawings["cycles"] = lambda: figures.cycles(shown[3], f"vehicle {shown[0]}, {names[shown[2]]}")
    lost = write_figures(out, drawings)
    text = _page(config, found, said, table(found, names), list(drawings))
    publish(out, text)
    return Told("\n".join([*said, "", brief(found, names), *lost]), failure)


def _shown(found: Found, worst: Worst, names: list[str]) -> list[tuple[str, control.StateSpace]]:
    """The loops of the Bode plot: the configured vehicle's at the same instant, and the tightest."""
    shown = [(f"configured vehicle, {names[worst.input]}", found.spaces(0, worst.instant)[worst.input])]
    if worst.vehicle:
        label = f"vehicle {worst.vehicle}, the tightest"
        shown.append((label, found.spaces(worst.vehicle, worst.instant)[worst.input]))
    return shown


def _words(others: int) -> str:
    """What the claims of this report mean; nothing where no vehicle was drawn."""
    return f"{statements.said(statements.of_least(others, 'tightest'))}\n\n" if others else ""


# long: one template
def _page(config: Config, found: Found, said: list[str], margins: str, drawn: list[str]) -> str:
    lines, others = "\n".join(f"* {line}" for line in said[1:]), len(found.ok) - 1
    pictures = "".join(f"{picture(f'{name}.png', CAPTIONS[name])}\n\n" for name in drawn)
    return f"""# How far from instability?

**{said[0]}**

{lines}

{margins}

{_words(others)}{pictures}
Linearised at {len(found.t)} instants from {config.criteria.late:g} s on (`criteria.late`), for the configured vehicle
and {others} others not used for tuning. The loop is opened at one actuator, all others stay closed. A margin says how
much of one change at that actuator the loop tolerates if nothing else changes: gain up or down, phase lag at the
crossover frequency, delay. Ms is the largest amplification of a disturbance there. A deadzone counts with the slope of
its side, backlash and rounding with 1; the limit cycles cover motions that are small compared with them. A margin is
that of the loop frozen at one instant: if the vehicle turns or changes its speed faster, simulate as well.
Where a route speeds up, a vehicle that is ahead of another gets further ahead; that is not an instability.
Left out are instants at which something is at a limit, and those where an input changes by more than {JUMP:g} times its
largest in a second, as at the beginning of a corner. Near these the tightest loop may last for an instant only, and the
5 % column says more. Frequencies at which the loop is slower than the vehicle turns or changes its speed, or below
{SLOWEST:g} rad/s, do not count.

A limit cycle is a solution of 1 + L(jw) N(A) = 0, with N the describing function of the nonlinear elements at one
actuator (deadzone, backlash, rounding, saturation, and the inverse of a deadzone in the computer) at the mean input of
the run there. A stable one is refined by {HARMONICS} harmonics; its amplitude is half the range of the input.
`cycles.csv` has all of them, also the unstable ones, above which a motion grows. Not covered: two actuators together,
limits of the plant itself, and cycles slower than the frequencies considered.

Made by `agvjax margins`, seed {config.seed}.
"""
