"""May new gains replace the current ones? By a vehicle's last log, and by nothing that cannot be shown."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import agvjax

from .compare import Compared, compare, vehicles_differ
from .decision import Decision, decide
from .known import Known

ALIKE = (
    "the log leaves one vehicle alone, or none of its numbers is drawn: copies of one vehicle show nothing of others"
)


class Applied(NamedTuple):
    """What was decided, and by what."""

    known: Known
    current: agvjax.Law
    new: agvjax.Law
    compared: Compared | None  # None: the log does not tell the vehicle, so that nothing was simulated
    decision: Decision


def apply(
    known: Known, current: agvjax.Law, new: agvjax.Law, tick: Callable[[str], object] = lambda text: None
) -> Applied:
    """Whether `new` may replace `current` on a vehicle that is known by a log.

    Args:
        known: the vehicle; of its configuration goals and limits.
        current: the law on the robot.
        new: the law that is to replace it.
        tick: is told the name of each part of the work as it ends.

    Raises:
        RuntimeError: every run diverges with the current gains.
    """
    alike = () if vehicles_differ(known.config) else (ALIKE,)
    if against := (*known.against, *alike):
        return Applied(known, current, new, None, Decision(False, against, 0, 0, 0.0))
    found = compare(known.config, current, new, tick)
    return Applied(known, current, new, found, decide(found.costs, found.worst, found.limits, known.config.apply))
