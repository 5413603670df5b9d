"""The report of `agvjax vehicles`: tables, figures and an animation."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from agvjax.draw import plot

from ... import config as configuration
from ...io import files
from ...io.files import Json
from ...io.pages import grid, picture, publish
from ...io.panels import panels
from ...io.pictures import Drawing, write_figures
from ...io.statements import of_draws, worst_of
from ...io.statements import said as said_of
from .study import BAND, CAR_LATE, CAR_STARTS, LATE, UNSEEN, G, Study, Told, distance

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MEASURED = ("largest after 4 s [mm]", "RMSE [m]", "settles [s]")
CAPTIONS = {
    "paper": "Distance to the reference over time with the paper's gains, at several periods and delays.",
    "limits": "The same with limits and 20 ms of delay: the paper's gains, and those tuned for it.",
    "car": "The car's path over two laps, and the distance of its front axle to the reference.",
    "robot": "Paths of the robot in MuJoCo, with the paper's and the tuned gains.",
    "moving": "The robot in MuJoCo on the circle, with the paper's and the tuned gains.",
}
SHOWN = "circle"  # of the robot's paths the one that is animated


def write(study: Study, out: Path) -> str:
    """Everything into a folder; returns what is printed."""
    for name, (_, after) in study.tuned.items():
        files.write(out / f"gains-{name}.toml", configuration.gains_table(after))
    files.write_json(out / "findings.json", findings(study))
    drawings: dict[str, Drawing] = {
        "paper": lambda: _errors(study.runs["paper"]),
        "limits": lambda: _errors(study.runs["unicycle"]),
        "car": lambda: _paths(study.runs["car"]),
    }
    if study.robot:
        drawings["robot"] = lambda: _robots(study)
    lost = write_figures(out, drawings)
    if study.robot:
        from agvjax.draw import animate  # late: no other command's page moves

        moving = _robot_runs(study, SHOWN)
        files.write_by(out / "robot.gif", lambda file: animate.write_gif(animate.animation(moving), file))
    text = page(study)
    publish(out, text)
    return "\n\n".join([_limited(study), _brief_car(study), *study.without, *lost])


def findings(study: Study) -> Json:
    """The numbers, for scripts."""
    return {
        "paper": {name: told._asdict() for name, told in study.paper.items()},
        "peaks": study.peaks,
        "lost": study.lost,
        "starts": study.starts,
        "limited": {name: told._asdict() for name, told in study.limited.items()},
        "unseen": study.unseen._asdict(),
        "car": study.car,
        "robot": study.robot,
    }


# long: one template
def page(study: Study) -> str:
    """`report.md`."""
    missing = "".join(f"\nNot run: {text}.\n" for text in study.without)
    peak = study.peaks["acceleration"]
    robot = (
        f"{_robot(study)}\n\n{picture('robot.png', CAPTIONS['robot'])}\n\n{picture('robot.gif', CAPTIONS['moving'])}"
        if study.robot
        else "Not run."
    )
    return f"""# Does the law work on a realistic vehicle?
{missing}
## A vehicle that rolls, the paper's gains

{_paper(study)}

The first command asks for {study.peaks["virtual"]:.0f} m/s^2 in the plane, in the body for {peak:.0f} m/s^2 and
{study.peaks["yaw_acceleration"]:.0f} rad/s^2: {peak / G:.0f} g, beyond any vehicle. With 20 ms of delay
{study.lost} of {study.starts} starts within 0.5 m diverge. The heading is internal: it follows from the motion of the
reference point and is not scored against the bearing. delta_psi adds to its rate, a drift that turns body and velocity.

{picture("paper.png", CAPTIONS["paper"])}

## The same vehicle with limits of 3 m/s^2 and 6 rad/s^2 and 20 ms of delay

{_limited(study)}

{said_of(of_draws(UNSEEN))}

Anti-windup bounds the correction velocity of the virtual control, subtracts from the command filter what could not be
applied, and freezes the integral meanwhile.

{picture("limits.png", CAPTIONS["limits"])}

## A car: BMW 320i, front axle on a dumbbell of 80 m by 80 m, two laps at 50 Hz, 20 ms late

{_car(study)}

Largest distance of the front axle after {CAR_LATE:g} s, over {CAR_STARTS} starts within 0.5 m with deadzones drawn
within 30 %, not used for tuning. Centre of gravity and rear axle cut corners; their distances to the path are those
columns. "Limited" is the largest share of a run in which an actuator or the law itself was at its limit.

{picture("car.png", CAPTIONS["car"])}

## A robot in MuJoCo, tuned on our plant

{robot}

With measurement noise of 2 mm and 4 mm/s, 50 Hz, 20 ms late; RMSE, torque and its variation over 12 s on paths
not used for tuning. "Paper's gains" have the anti-windup of the tuned ones; "as it is" is the sampled law without.
"""


def _row(name: str, told: Told) -> list[Any]:
    if not told.ok:
        return [name, "diverges", "", ""]
    settles = f"{told.settling:.2f}" if np.isfinite(told.settling) else f"not within {BAND:g} m"
    return [name, f"{1e3 * told.late:.1f}", f"{told.rmse:.4f}", settles]


def _paper(study: Study) -> str:
    return grid(["", *MEASURED], [_row(name, told) for name, told in study.paper.items()])


def _limited(study: Study) -> str:
    rows = [_row(name, told) for name, told in study.limited.items()]
    return grid(
        ["unicycle with limits", *MEASURED], [*rows, _row(f"tuned, {worst_of(UNSEEN)} unseen vehicles", study.unseen)]
    )


def _car(study: Study) -> str:
    header = ["car", "front axle [m]", "acceleration [m/s^2]", "steering rate [rad/s]", "limited"]
    rows = []
    for name, row in study.car.items():
        cells = [f"{row['late']:.3f}" if row["ok"] else "diverges", f"{row['acceleration']:.1f}"]
        cells += [f"{row['steering_rate']:.2f}", f"{row['limited']:.1%}"]
        rows.append([name, *cells, f"{row['center of gravity']:.2f}", f"{row['rear axle']:.2f}"])
    return grid([*header, "centre of gravity [m]", "rear axle [m]"], rows)


def _brief_car(study: Study) -> str:
    rows = [[name, f"{row['late']:.3f}" if row["ok"] else "diverges"] for name, row in study.car.items()]
    return grid(["car", "front axle, largest distance [m]"], rows)


def _robot(study: Study) -> str:
    header = ["path", "law", "RMSE [m]", f"largest after {LATE:g} s [mm]", "without noise [mm]", "rms torque [Nm]"]
    rows = []
    for r in study.robot:
        late = [f"{1e3 * r[name]:.0f}" for name in ("late", "late_without_noise")]
        rows.append([r["path"], r["law"], f"{r['rmse']:.3f}", *late, f"{r['rms_torque']:.2f}", f"{r['variation']:.0f}"])
    return grid([*header, "torque variation [Nm]"], rows)


def _errors(drawn: Mapping[str, Any]) -> Figure:
    figure, ((axes,),) = panels(1, 1, (8, 3.6))
    for (name, run), color in zip(drawn.items(), COLOURS, strict=False):
        style = {"ls": "--"} if "3 m" in name else {}
        axes.semilogy(np.asarray(run.t), np.maximum(distance(run), 1e-5), label=name, color=color, lw=1.2, **style)
    axes.axhline(BAND, color="0.6", lw=0.8, ls=":")
    axes.set(xlabel="time [s]", ylabel="distance to the reference [m]", ylim=(1e-4, 30))
    axes.legend(fontsize=8, ncols=2)
    return figure


COLOURS = ("tab:blue", "tab:orange", "tab:red", "tab:purple", "tab:brown", "tab:green")


def _paths(drawn: Mapping[str, Any]) -> Figure:
    figure = plot.sheet((9, 4))
    left, right = figure.subplots(1, 2, width_ratios=[1, 1.6])
    plot.draw_path(left, drawn)
    for name, run in drawn.items():
        right.semilogy(run.t, np.maximum(distance(run), 1e-5), label=name, lw=1)
    right.axhline(0.1, color="0.6", lw=0.8, ls=":")
    right.set(xlabel="time [s]", ylabel="front axle to the reference [m]", ylim=(1e-3, None))
    right.grid(alpha=0.3)
    right.legend(fontsize=8)
    return figure


def _robot_runs(study: Study, path: str) -> dict[str, Any]:
    return {name: study.runs["robot"][path, name] for name in ("paper's gains", "tuned gains")}


def _robots(study: Study) -> Figure:
    paths = list(dict.fromkeys(row["path"] for row in study.robot))
    figure = plot.sheet((9, 3.4))
    places = figure.subplots(1, len(paths))
    for axes, path in zip(places, paths, strict=True):
        plot.draw_path(axes, _robot_runs(study, path))
        axes.get_legend().remove()
        axes.set_title(path, fontsize=9)
    figure.legend(*places[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8)
    return figure
