"""The search for a proof: the largest share of the box that is proved, beside what a search finds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import NamedTuple

from ...compute.jobs import Engine, Here
from ...config.settings import Config
from . import checker
from .found import CLOSE, Seeker, nominal_error
from .problem import Ends, Numbers, box
from .rules import unproved
from .tree import Prover, leaves


class Certified(NamedTuple):
    """What is proved of a configuration, beside what a search finds."""

    why: str  # nothing can be proved, because; empty where something is tried
    share: float  # of the box around nominal that is proved; 0: not even the nominal scenario
    found: float  # of the box in which the search finds no violation of the same bounds
    box: Ends  # that is proved
    bounds: tuple[float, ...]  # that were proved in it: x, y [m], heading [rad]
    boxes: int  # parts of it
    failed: str  # at the smallest share that was not proved: which step failed
    certificate: Numbers  # empty where nothing is proved
    contradicted: bool = False  # the search met a violation inside what was proved: one of the two is wrong

    @property
    def proved(self) -> bool:
        """Whether the bounds hold in the whole box that was asked about."""
        return self.share >= 1 and not self.contradicted


def certificate(claim: Sequence[float], numbers: Numbers, ends: Ends, tree: Numbers) -> Numbers:
    """What the checker reads, signed with its digest."""
    content = {
        "version": checker.VERSION,
        "claim": dict(zip(checker.CHANNELS, map(float, claim), strict=True)),
        "problem": dict(numbers),
        "box": {name: list(pair) for name, pair in ends.items()},
        "tree": tree,
    }
    return {**content, "digest": checker.digest(content)}


def certify(
    config: Config,
    tick: Callable[[str], None] = lambda what: None,
    opened: Callable[[], AbstractContextManager[Engine]] = lambda: nullcontext(Here()),
) -> Certified:
    """Search for violations, then for a proof: of the whole box, else of the largest share of it.

    Args:
        config: completed and sound by `rules.faults`.
        tick: told of each step.
        opened: who looks at the parts of the box; called when there are some. Their proofs are the same whoever does.

    Raises:
        tuning.compute.jobs.WorkFailed: workers failed; nothing is proved, and nothing lost but time.
    """
    if why := unproved(config):
        return Certified(why, 0.0, 0.0, {}, (), 0, "", {})
    seeker = Seeker.of(config)
    try:
        prover = Prover.of(config, {})
    except checker.Refused as refused:
        return Certified(str(refused), 0.0, 0.0, {}, (), 0, "", {})
    found = seeker.share()
    tick(f"no violation found up to {found:.2f} of the box")
    prover = prover._replace(steep=seeker.steepest(min(found, 1.0)))
    with opened() as engine:
        low, best, failed = _largest(config, prover, engine, tick)
    if best is None:
        return Certified("", 0.0, found, {}, (), 0, failed, {})
    ends, tree = best
    parts = leaves(tree)
    bounds = tuple(max(part["bounds"][i] for part in parts) for i in range(3))
    made = certificate(prover.claim, prover.problem.numbers, ends, tree)
    inside = found < low * (1 - 2 * CLOSE) or not nominal_error(config) <= 1
    return Certified("", low, found, ends, bounds, len(parts), failed, made, inside)


def _largest(
    config: Config, prover: Prover, engine: Engine, tick: Callable[[str], None]
) -> tuple[float, tuple[Ends, Numbers] | None, str]:
    """The largest share that is proved, its box and tree, and why the smallest that is not was not."""
    low, best, high, failed = 0.0, None, None, ""
    tries = [1.0, 0.0]
    for _ in range(2 + config.certify.halvings):
        share = tries.pop(0) if tries else (low + (1.0 if high is None else high)) / 2
        ends = box(config, share)
        tree, why = prover.tree(ends, engine)
        tick(f"{share:.3f} of the box: {'proved' if tree else 'not proved'}")
        if tree is None:
            high, failed = share, why
            if share == 0:
                break
        else:
            low, best = share, (ends, tree)
            if share == 1:
                break
    return low, best, failed
