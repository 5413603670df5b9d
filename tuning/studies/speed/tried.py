"""Speeds that were tried: what each came to, what they say together, and a file each, so that a stopped run goes on."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

from agvjax import Fault, InputError

from ...io import files
from ...io.plain import from_json

FOLDER = "speeds"


class Tried(NamedTuple):
    """What a speed came to, on vehicles that were not tuned on; distances are the largest of a run after its start."""

    factor: float  # times the route's own speed
    speed: float  # m/s, the highest of the profile
    lateral: float  # m/s^2, the largest speed^2 times curvature of the profile
    driven: float  # m/s along the route, mean over the runs
    worst: float  # m, largest distance; infinite where a run diverges
    mean: float  # m, mean over the vehicles of their largest distance
    outside: float  # m, the most beyond the corridor; 0 without one
    start: float  # m, `worst` with the configured gains at this speed
    diverged: int  # runs
    short: int  # runs that do not see the whole route
    excess: float  # sum of what limits are exceeded by, on the tuning scenarios; 0: all are met
    iterations: int
    vehicle: int  # number of the one that binds
    z: tuple[float, ...]  # coordinates of the tuned gains
    gains: tuple[float, ...]
    why: str = ""  # nothing could be tuned

    def holds(self, within: float) -> bool:
        """Whether every vehicle stays within so many metres, or where that is 0 within the corridor, limits met."""
        kept = self.worst <= within if within else self.outside <= 0
        return bool(kept and self.excess == 0 and not self.diverged)


class Answer(NamedTuple):
    """The highest speed that holds, and the next one tried above it; None where there is none."""

    best: Tried | None
    above: Tried | None


def answer(tried: list[Tried], within: float) -> Answer:
    """What the speeds tried say."""
    rising = sorted(tried)
    held = [i for i, t in enumerate(rising) if t.holds(within)]
    if not held:
        return Answer(None, rising[0] if rising else None)
    return Answer(rising[held[-1]], rising[held[-1] + 1] if held[-1] + 1 < len(rising) else None)


class Saved:
    """The speeds tried of a run folder.

    Attributes:
        tried: by factor, as far as the run has come.
    """

    def __init__(self, out: Path):
        """Read what is there.

        Raises:
            InputError: a file is damaged.
        """
        self.folder, self.tried = out / FOLDER, {}
        for path in sorted(self.folder.glob("*.json")):
            try:
                found = _read(files.text(path))
            except (OSError, ValueError, TypeError, KeyError) as error:
                rule = f"a run whose files are whole; {path} cannot be read ({error})"
                raise InputError([Fault("--resume", str(out), rule)]) from error
            self.tried[found.factor] = found

    def keep(self, tried: Tried) -> None:
        """Write a speed."""
        self.folder.mkdir(exist_ok=True)
        files.write_json(self.folder / f"{tried.factor:.6f}.json", tried._asdict())


def _read(text: str) -> Tried:
    """A speed of its file; a number that JSON has no word for was infinite."""
    table: dict[str, Any] = from_json(text)
    if set(table) != set(Tried._fields):
        raise ValueError(f"it must hold {', '.join(Tried._fields)}")
    for name, value in table.items():
        if isinstance(value, list):
            table[name] = tuple(float(x) for x in value)
        elif value is None:
            table[name] = math.inf
    return Tried(**table)
