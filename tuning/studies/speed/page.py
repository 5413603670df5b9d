"""What was found of the highest speed: sentences, table, figures, page, and the configuration of the answer."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import NamedTuple

import agvjax

from ...config import dump
from ...config.names import in_words
from ...io import files
from ...io.pages import grid, meanings, picture, publish
from ...io.pictures import Drawing, write_figures
from ...io.statements import of_draws, worst_of
from ...io.statements import said as said_of
from ...tune.meanings import of_gains
from . import figures
from .place import Place, place
from .study import Study, at
from .tried import Answer, Tried, answer

FASTEST = "fastest.toml"
CHOSEN = "the speed was chosen with the same vehicles, so that at the speed that holds the share may be larger"
CURVE = "Largest distance to the route of all unseen vehicles over the reference speed: tuned, configured gains."
PLACE = "Where on the route the vehicle that is farthest off is farthest from it."


class Told(NamedTuple):
    """What is printed, and why nothing holds; empty where something does."""

    text: str
    failure: str


def asked(within: float) -> str:
    """What a vehicle is to keep, in words."""
    return f"within {1e3 * within:g} mm of the route" if within else "within the corridor"


def sentences(tried: list[Tried], found: Answer, within: float, size: int) -> list[str]:
    """The answer, and what should be known of it."""
    best, above = found
    if best is None:
        slow = tried[0]
        return [f"At no speed tried do all {size} unseen vehicles stay {asked(within)}. {_why(slow, within, size)}"]
    first = (
        f"Up to {best.speed:.3g} m/s ({best.factor:.3g} times the configured speed, lateral acceleration of the profile"
        f" {best.lateral:.3g} m/s^2) each of {size} unseen vehicles stays {asked(within)}:"
        f" {worst_of(size)} {1e3 * best.worst:.1f} mm, driven at {best.driven:.3g} m/s on average."
    )
    said = [first]
    if above is None:
        said.append("That is the highest speed tried: it may go faster; speed.high sets how fast to try.")
    else:
        said.append(_why(above, within, size))
    lost = [t for t in tried if t.factor < best.factor and not t.holds(within)]
    if lost:
        slower = ", ".join(f"{t.speed:.3g}" for t in lost)
        said.append(f"Not every lower speed holds: {slower} m/s does not. Look at the curve.")
    if best.short:
        rule = "the rest of the route is untested (simulate.horizon is too short, or a vehicle stands still)"
        said.append(f"{best.short} of the {size} vehicles do not drive the whole route at that speed: {rule}.")
    quicker = [t for t in tried if t.factor < best.factor and t.driven >= 0.99 * best.driven and t.holds(within)]
    if quicker:
        least = quicker[0]
        rule = "the law or the vehicle limits it"
        said.append(f"A reference above {least.speed:.3g} m/s hardly makes it drive faster: {rule}.")
    return said


def _why(tried: Tried, within: float, size: int) -> str:
    """Why a speed does not hold."""
    begun = f"At {tried.speed:.3g} m/s"
    if tried.why:
        return f"{begun} nothing could be tuned: {tried.why}."
    if tried.diverged:
        return f"{begun} {tried.diverged} diverge."
    far = f"{begun} the {worst_of(size)} vehicles is {1e3 * tried.worst:.1f} mm off"
    if not within:
        far += f", {1e3 * tried.outside:.1f} mm beyond the corridor"
    return f"{far}, and the limits are not met." if tried.excess else f"{far}."


def table(tried: list[Tried], within: float, size: int) -> str:
    """A row a speed."""
    header = ["speed [m/s]", "times", "lateral [m/s^2]", "driven [m/s]", f"{worst_of(size)} [mm]", "mean [mm]"]
    header += [f"{worst_of(size)}, configured gains [mm]", "holds", "limits", "not the whole route", "iterations"]
    rows = [
        [t.speed, t.factor, t.lateral, t.driven, 1e3 * t.worst, 1e3 * t.mean, 1e3 * t.start]
        + ["yes" if t.holds(within) else "no", "met" if t.excess == 0 else "not met", t.short, t.iterations]
        for t in tried
    ]
    return grid(header, rows)


def write(study: Study, tried: list[Tried], out: Path) -> Told:
    """Everything into the folder of a run."""
    config, within = study.config, study.config.speed.within
    found = answer(tried, within)
    places = [place(study, t) for t in found if t is not None and not t.why]
    names = study.names
    columns = [name for name in Tried._fields if name not in ("z", "gains", "why")]
    rows = [[*(t._asdict()[name] for name in columns), t.holds(within), *t.gains] for t in tried if not t.why]
    files.write_csv(out / "speed.csv", [*columns, "holds", *names], rows)
    if found.best is not None:
        quick = at(config, found.best.factor)
        files.write(out / FASTEST, dump(dataclasses.replace(quick, controller=study.law(found.best))))
    drawings: dict[str, Drawing] = {"speed": lambda: figures.curve(tried, found, config)}
    if places:
        drawings["place"] = lambda: figures.places(places, config)
    lost = write_figures(out, drawings)
    said = sentences(tried, found, within, config.ensemble.validation_size)
    said += [f"At {p.tried.speed:.3g} m/s the largest distance is {p.words}." for p in places]
    text = _page(study, tried, said, places)
    publish(out, text, ("Every speed that was tried", "The gains"))
    return Told("\n".join([*said, *lost]), "" if found.best is not None else said[0])


# long: one template
def _page(study: Study, tried: list[Tried], said: list[str], places: list[Place]) -> str:
    config, within = study.config, study.config.speed.within
    names, lines = study.names, "\n".join(f"* {line}" for line in said[1:])
    law = config.controller.inner if isinstance(config.controller, agvjax.Sampled) else config.controller
    gains = grid(["speed [m/s]", *names], [[t.speed, *t.gains] for t in tried if not t.why])
    limits, unseen = ", ".join(config.tune.limits) or "none", config.ensemble.validation_size
    where = f"{picture('place.png', PLACE)}\n" if places else ""
    run = ""
    if answer(tried, within).best is not None:
        run = f"\nThe fastest that holds is `{FASTEST}`: `agvjax simulate --config {FASTEST}`, in this folder.\n"
    return f"""# How fast can it go?

**{said[0]}**

{lines}
{run}
Law: {in_words(law)}. Vehicle: {in_words(config.scenario.plant)}. Runs of {config.simulate.horizon:g} s.
Distances are the largest of a run to the nearest point of the route, for {unseen} vehicles not used for tuning. They
count after the start-up phase: from {config.speed.after:g} s at the configured speed, and from the same distance at any
other.

{said_of(of_draws(unseen), CHOSEN)}

{picture("speed.png", CURVE)}

{where}
## Every speed that was tried

{table(tried, within, unseen)}

"Times" is the factor on the route's speed; its square is the factor on the lateral acceleration that the route allows.
Limits on longitudinal acceleration stay. At every speed the {len(names)} gains are tuned anew on {config.ensemble.size}
vehicles, from the best of {config.tune.screen} screened gain sets and from the gains of the nearest speed tried before,
for the goal of the configuration. Its limits ({limits}) are multiples of the values of the configured gains **at that
same speed**: a gain set cannot gain accuracy by driving slower than they would there. "Driven" is the mean speed along
the route, which may be lower than the reference: laws slow down in turns, and the vehicle's acceleration is limited. A
speed holds if every validation vehicle stays {asked(within)} and the limits are met on the tuning vehicles.

The search covers {config.speed.points} speeds from {config.speed.low:g} to {config.speed.high:g} times, then halves the
gap above the highest that holds up to {config.speed.halvings} times. Between the speeds tried nothing is known.

## The gains

{gains}

{meanings(of_gains(config.controller, names))}

Made by `agvjax speed`, seed {config.seed}.
"""
