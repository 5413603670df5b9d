"""Speeds that were tried: what each came to, and what they say together."""

from __future__ import annotations

from typing import NamedTuple


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
