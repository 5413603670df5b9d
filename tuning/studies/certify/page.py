"""What was proved, what was found and what neither says: sentences, tables, certificate, report."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from ...config.settings import Config
from ...io import files
from ...io.pages import grid, picture, publish
from ...io.pictures import write_figures
from ...io.statements import PROVED, of_kind, said
from . import checker, figures
from .problem import nominal
from .prove import Certified

CAPTION = (
    "Largest error over its bound, simulated on planes through the nominal scenario (black line: the bound), the box"
    " that is proved, the one in which no violation was found, and the one asked about."
)
MEANS = said(
    of_kind(PROVED), "no violation found: a search by gradient ascent and samples met none, and there may be one"
)


class Told(NamedTuple):
    """What is printed, and why the bounds should not be relied upon; empty where they are proved in the whole box."""

    text: str
    failure: str


def write(config: Config, found: Certified, out: Path) -> Told:
    """Everything into the folder of a run."""
    if found.why:
        why = f"Nothing can be proved of this loop: {found.why}."
        publish(out, f"# What is certain?\n\n**{why}**\n\nSee docs/certify.md for what a proof needs.\n")
        return Told("", why)
    if found.contradicted:
        why = contradiction(config, found)
        publish(out, f"# What is certain?\n\n**{why}.**\n\nNo certificate is written.\n")
        return Told("", f"{why}.")
    lines, failure = sentences(config, found)
    if found.certificate:
        files.write(out / "certificate.json", files.as_json(found.certificate))
        files.write(out / "checker.py", Path(checker.__file__).read_text(encoding="utf-8"))
    seen = figures.planes(config, found)
    lost = write_figures(out, {"map": lambda: figures.boxes(config, found, seen)}) if seen else []
    publish(out, _page(config, found, lines, bool(seen)))
    return Told("\n".join([*lines, *lost]), failure)


def claim(config: Config) -> str:
    """The bounds in words, with all their digits: 0.020001 is not 0.02."""
    settings = config.certify
    return (
        f"|x| and |y| <= {settings.within:.15g} m and |heading| <= {settings.within_heading:.15g} rad from"
        f" {config.criteria.late:.15g} s to {config.simulate.horizon:.15g} s"
    )


def contradiction(config: Config, found: Certified) -> str:
    """That the search met a violation inside what was proved."""
    where = "at the nominal scenario or next to it"
    if 0 < found.found < found.share:
        where = f"a little beyond {found.found:.3g} of the box"
    return (
        f"Proof and search contradict each other, so one of them is wrong, or the simulator's step (sweep.dt) is too"
        f" coarse; rely on neither. A proof was found of {claim(config)}"
        f" in {found.share:.3g} of the box, and a simulated run that violates it {where}"
    )


def sentences(config: Config, found: Certified) -> tuple[list[str], str]:
    """What is proved and found, the most important first, and why that is not all that was asked."""
    searched = f"No violation of the same bounds was found up to {found.found:.3g} times the box asked about"
    if not found.found:
        searched = "A violation of the same bounds was found at the nominal scenario or next to it"
    if found.proved:
        return [f"Proved in the whole box: {claim(config)}.", f"{searched}."], ""
    step = f"; beyond that the proof fails: {found.failed}"
    if not found.certificate:
        none = f"Not proved, not even for the nominal scenario: {found.failed}"
        return [f"{none}.", f"{searched}."], f"{none}."
    ratio = f", {found.share / found.found:.2f} of the box in which none is found" if found.found else ""
    part = f"Proved in {found.share:.3g} of the box around nominal{ratio}: {claim(config)}"
    return [f"{part}{step}.", f"{searched}."], f"Not proved in the whole box, only in {found.share:.3g} of it{step}."


def _parts(boxes: int) -> str:
    return "the box as a whole" if boxes == 1 else f"{boxes} parts of the box"


def _page(config: Config, found: Certified, lines: list[str], drawn: bool) -> str:
    rows = []
    middle = nominal(config)
    for name, (low, high) in found.box.items():
        if high > low:
            rows.append([name, low, middle[name], high])
    parts = [f"# What is certain?\n\n**{lines[0]}**", "\n".join(lines[1:]), MEANS]
    if drawn:
        parts.append(picture("map.png", CAPTION))
    if rows:
        parts += ["## The box that is proved", grid(["side", "from", "nominal", "to"], rows)]
        names = ("x [m]", "y [m]", "heading [rad]")
        limits = (config.certify.within, config.certify.within, config.certify.within_heading)
        bounds = [[n, b, m] for n, b, m in zip(names, found.bounds, limits, strict=True)]
        parts.append(grid(["error", "largest that is proved", "asked"], bounds))
    if found.certificate:
        parts.append(
            f"The proof, on {_parts(found.boxes)}, is in `certificate.json`; `python checker.py certificate.json`, in"
            " this folder, checks it anew, by Python and NumPy alone."
        )
    parts.append(
        "Assumed: the loop in continuous time, of which the simulation is an approximation; the law and the decoupled"
        " plant as in docs/certify.md; parameters that stay as they are during a run; a disturbance that is the"
        " configured cosine with any amplitude of the box. Nothing is said before the transient is over, or after the"
        " horizon."
    )
    return "\n\n".join(parts) + "\n"
