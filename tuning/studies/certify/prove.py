"""The search for a proof: boxes split where one is too large, and the largest share of the box that is proved."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from ...config.settings import Config
from . import checker
from .found import CLOSE, Seeker, nominal_error
from .problem import Ends, Numbers, box, problem
from .rules import unproved

Steep = Mapping[str, float]  # by leaf, how much the worst error grows over the whole side of the box
LEANS = (0.3, 9.0)  # how much less a tube counts what comes from the unknowns than what is only bounded


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


class Prover:
    """Proves bounds over boxes by tubes, branch and bound."""

    def __init__(self, config: Config, steep: Steep) -> None:
        """Of a configuration; `steep` is the slope of the worst error that the search found."""
        self.problem, self.most, self.steep = checker.Problem(problem(config)), config.certify.boxes, steep
        self.claim = (config.certify.within, config.certify.within, config.certify.within_heading)
        self.whole, self.why = box(config), ""

    def tree(self, ends: Ends) -> Numbers | None:
        """A tree of splits whose leaves prove the claim; None where it needs more than `boxes` leaves."""
        self.left = self.most
        return self._branch(checker.Box(ends), self.most)

    def _branch(self, part: checker.Box, budget: int) -> Numbers | None:
        if (leaf := self._leaf(part)) is not None:
            self.left -= 1
            return leaf
        name = self._split(part)
        if budget < 2 or not name:
            return None
        at = sum(part.intervals[name]) / 2
        below, above = part.halves(name, at)
        first, second = (above, below) if self.steep.get(name, 0.0) > 0 else (below, above)  # the worse half first
        nodes = [self._branch(half, budget // 2) for half in (first,)]
        if nodes[0] is None or (other := self._branch(second, budget - budget // 2)) is None:
            return None
        low, high = (other, nodes[0]) if first is above else (nodes[0], other)
        return {"split": name, "at": at, "below": low, "above": high}

    def _leaf(self, part: checker.Box) -> Numbers | None:
        """A tube that proves the claim."""
        slopes = [_mean_slope(part, name) for name in ("position", "heading")]
        for lean in LEANS:
            try:
                bounds = self.problem.bounds(part, [*slopes, lean])
            except checker.Refused as why:
                self.why = str(why)
                continue
            worst = max(bound / limit for bound, limit in zip(bounds, self.claim, strict=True))
            if worst * (1 + 1e-6) <= 1:  # another machine's sums differ in their last digits
                return {"leaf": [*slopes, lean], "bounds": [bound * (1 + 1e-6) for bound in bounds]}
            i = max(range(3), key=lambda i: bounds[i] / self.claim[i])
            self.why = f"the error in {checker.CHANNELS[i]} is bounded by {bounds[i]:.4g} only"
        return None

    def _split(self, part: checker.Box) -> str:
        """The leaf along which the worst error changes most over the part, by the adversary's gradient."""
        shares = {}
        for name, (low, high) in part.intervals.items():
            whole = self.whole[name][1] - self.whole[name][0]
            if high - low > 1e-3 * whole > 0:
                shares[name] = (abs(self.steep.get(name, 0.0)) + 1e-9) * (high - low) / whole
        return max(shares, key=shares.__getitem__) if shares else ""


def _mean_slope(part: checker.Box, channel: str) -> float:
    return sum(sum(part.intervals[f"deadzone.{channel}.slope_{side}"]) for side in ("right", "left")) / 4


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


def leaves(tree: Numbers) -> list[Numbers]:
    """The leaves of a tree."""
    return [tree] if "leaf" in tree else [*leaves(tree["below"]), *leaves(tree["above"])]


def certify(config: Config, tick: Callable[[str], None] = lambda what: None) -> Certified:
    """Search for violations, then for a proof: of the whole box, else of the largest share of it.

    Args:
        config: completed and sound by `rules.faults`.
        tick: told of each step.
    """
    if why := unproved(config):
        return Certified(why, 0.0, 0.0, {}, (), 0, "", {})
    seeker = Seeker.of(config)
    try:
        prover = Prover(config, {})
    except checker.Refused as refused:
        return Certified(str(refused), 0.0, 0.0, {}, (), 0, "", {})
    found = seeker.share()
    tick(f"no violation found up to {found:.2f} of the box")
    prover.steep = seeker.steepest(min(found, 1.0))
    low, best, high, failed = 0.0, None, None, ""
    tries = [1.0, 0.0]
    for _ in range(2 + config.certify.halvings):
        share = tries.pop(0) if tries else (low + (1.0 if high is None else high)) / 2
        ends = box(config, share)
        tree = prover.tree(ends)
        tick(f"{share:.3f} of the box: {'proved' if tree else 'not proved'}")
        if tree is None:
            high, failed = share, prover.why
            if share == 0:
                break
        else:
            low, best = share, (ends, tree)
            if share == 1:
                break
    if best is None:
        return Certified("", 0.0, found, {}, (), 0, failed, {})
    ends, tree = best
    parts = leaves(tree)
    bounds = tuple(max(part["bounds"][i] for part in parts) for i in range(3))
    made = certificate(prover.claim, prover.problem.numbers, ends, tree)
    inside = found < low * (1 - 2 * CLOSE) or not nominal_error(config) <= 1
    return Certified("", low, found, ends, bounds, len(parts), failed, made, inside)
