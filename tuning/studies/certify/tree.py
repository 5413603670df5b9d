"""The tree of a proof: a box is split until every part of it is proved, by whoever is there to look at parts."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ...compute.jobs import Engine, Here, Jobs, Make
from ...config.settings import Config
from . import checker
from .problem import Ends, Numbers, box, problem

Place = tuple[Numbers, str]  # in a tree: a node, and which of its sides
Steep = Mapping[str, float]  # by leaf, how much the worst error grows over the whole side of the box
LEANS = (0.3, 9.0)  # how much less a tube counts what comes from the unknowns than what is only bounded


class Part(NamedTuple):
    """A box to be proved.

    Attributes:
        ends: of its sides.
        most: leaves that its tree may have.
    """

    ends: Mapping[str, Sequence[float]]
    most: int


class Prover(NamedTuple):
    """Proves bounds over boxes by tubes, branch and bound; plain data, so that any process can look at a part.

    Attributes:
        numbers: of the problem, as a certificate has them.
        claim: the bounds: x, y [m], heading [rad].
        whole: the box asked about, in whose sides lengths are counted.
        most: parts of a box.
        steep: slopes of the worst error that the search found.
    """

    numbers: Numbers
    claim: tuple[float, float, float]
    whole: Ends
    most: int
    steep: Steep

    @classmethod
    def of(cls, config: Config, steep: Steep) -> Prover:
        """Of a configuration.

        Raises:
            checker.Refused: there is no proof for its law or loop.
        """
        settings, numbers = config.certify, problem(config)
        _problem(json.dumps(numbers))
        claim = (settings.within, settings.within, settings.within_heading)
        return cls(numbers, claim, box(config), settings.boxes, steep)

    @property
    def problem(self) -> checker.Problem:
        """What the checker makes of the numbers."""
        return _problem(json.dumps(self.numbers))

    def tree(self, ends: Ends, engine: Engine | None = None) -> tuple[Numbers | None, str]:
        """A tree of splits whose leaves prove the claim; None where it would need too many leaves, and why.

        In rounds: each of the parts of a round is followed down to one leaf, and what is left beside the way are the
        parts of the next. Which round fails, and by which part, does not hang on who is first.
        """
        engine, root = engine or Here(), {}
        left: list[tuple[Part, Place]] = [(Part(ends, self.most), (root, "tree"))]
        while left:
            ways, why = self._round([part for part, _ in left], engine)
            if why:
                return None, why
            left = [more for way, (_, place) in zip(ways, left, strict=True) for more in _hung(way, place)]
        return root["tree"], ""

    def _round(self, parts: Sequence[Part], engine: Engine) -> tuple[list[Numbers], str]:
        """The way down from every part; empty where one of them fails, and why the first of those does."""
        ways: dict[int, Numbers] = {}
        asked = Asked(self, parts)
        for number, data in engine.each(Jobs("part", prepare(asked), prepare, asked), range(len(parts))):
            ways[number] = json.loads(data)
            failed = min((n for n, way in ways.items() if "why" in way), default=len(parts))
            if failed < len(parts) and all(n in ways for n in range(failed)):
                return [], ways[failed]["why"]
        return [ways[n] for n in range(len(parts))], ""

    def way(self, part: Part) -> Numbers:
        """From a part to the worse half, and on, to a leaf that is proved: the splits on the way, and the leaf.

        Where the leaf would be one too many: why it is not proved.
        """
        here, most, splits = checker.Box(part.ends), part.most, []
        while True:
            leaf, why = self._leaf(here)
            if leaf is not None:
                return {"splits": splits, "leaf": leaf}
            name = self._split(here)
            if most < 2 or not name:
                return {"why": why}
            at = sum(here.intervals[name]) / 2
            below, above = here.halves(name, at)
            rising = self.steep.get(name, 0.0) > 0
            here, other = (above, below) if rising else (below, above)
            beside = Part(other.intervals, most - most // 2)
            splits.append({"split": name, "at": at, "side": "below" if rising else "above", "beside": beside})
            most //= 2

    def _leaf(self, part: checker.Box) -> tuple[Numbers | None, str]:
        """A tube that proves the claim, or why none does."""
        slopes, why = [_mean_slope(part, name) for name in ("position", "heading")], ""
        for lean in LEANS:
            try:
                bounds = self.problem.bounds(part, [*slopes, lean])
            except checker.Refused as refused:
                why = str(refused)
                continue
            worst = max(bound / limit for bound, limit in zip(bounds, self.claim, strict=True))
            if worst * (1 + 1e-6) <= 1:  # another machine's sums differ in their last digits
                return {"leaf": [*slopes, lean], "bounds": [bound * (1 + 1e-6) for bound in bounds]}, ""
            i = max(range(3), key=lambda i: bounds[i] / self.claim[i])
            why = f"the error in {checker.CHANNELS[i]} is bounded by {bounds[i]:.4g} only"
        return None, why

    def _split(self, part: checker.Box) -> str:
        """The leaf along which the worst error changes most over the part, by the adversary's gradient."""
        shares = {}
        for name, (low, high) in part.intervals.items():
            whole = self.whole[name][1] - self.whole[name][0]
            if high - low > 1e-3 * whole > 0:
                shares[name] = (abs(self.steep.get(name, 0.0)) + 1e-9) * (high - low) / whole
        return max(shares, key=shares.__getitem__) if shares else ""


class Asked(NamedTuple):
    """Parts, and what proves them, as they are sent to another process."""

    prover: Prover
    parts: Sequence[Part]


def prepare(asked: Asked) -> Make:
    """What finds the way down from each of the parts."""
    return lambda number: json.dumps(asked.prover.way(asked.parts[number])).encode()


@functools.lru_cache(1)  # a worker is sent the same one for every round
def _problem(numbers: str) -> checker.Problem:
    return checker.Problem(json.loads(numbers))


def _hung(way: Numbers, place: Place) -> list[tuple[Part, Place]]:
    """Put a way into the tree; the parts left beside it, the smallest first, each with its place there."""
    node, key = place
    beside = []
    for split in way["splits"]:
        node[key] = {"split": split["split"], "at": split["at"], "below": None, "above": None}
        node, side = node[key], split["side"]
        beside.append((Part(*split["beside"]), (node, side)))
        key = "above" if side == "below" else "below"
    node[key] = way["leaf"]
    return beside[::-1]


def _mean_slope(part: checker.Box, channel: str) -> float:
    return sum(sum(part.intervals[f"deadzone.{channel}.slope_{side}"]) for side in ("right", "left")) / 4


def leaves(tree: Numbers) -> list[Numbers]:
    """The leaves of a tree."""
    return [tree] if "leaf" in tree else [*leaves(tree["below"]), *leaves(tree["above"])]
