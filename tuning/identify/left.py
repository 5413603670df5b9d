"""What a fit leaves: noise of the sensors, which intervals count, or what the model lacks, which they do not.

A pose that a robot makes itself is off by nearly the same from one measurement to the next, so that what is left is not
white even where the model is right. Two things noise does not do: go with the commands, and be far larger in some
stretches than in others. And the numbers of a machine that stays the same do not shift along the log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from .fit import Fit, information
from .log import Log
from .parameters import widths
from .segments import Segments, thinned

GOES, TURNS = "where it goes", "how it turns"
TURNING = ("heading", "yaw_rate", "steering_angle")  # measurements of how a vehicle turns, not of where it goes
LASTS = 0.3  # correlation from one measurement to the next above which noise is not white
SPAN = 0.1  # s, over which what is left grows
EARLIER = np.arange(0.1, 1.25, 0.1)  # s, before which commands are looked at
ENOUGH, COMPARED = 20, 200  # stretches below which nothing can be said, and above which only some are compared
CHANCE, RARE = 2.5, 0.95  # deviations from what chance does, and share of the cases of chance, to be exceeded
UNEVEN = 1.75  # times what noise does, that what is left may vary from stretch to stretch
ORDERS, SURE = 200, 0.99  # of the stretches, that are tried; share of them that must shift less
EDGE, BREAKS = 0.1, 40  # share of the stretches before and behind a change, at least; how many places are tried
EASE = 1e-9  # of the matrix's own size, added where a half tells nothing of a number


class Change(NamedTuple):
    """Numbers that are others from some time on."""

    t: float  # s
    name: str  # of the number that changes most surely
    by: float  # how much it changes


class Left(NamedTuple):
    """What is left of the measurements."""

    white: Mapping[str, float]  # by channel the correlation with itself one measurement later
    follows: Mapping[str, float]  # of where it goes and how it turns: the share that goes with the commands, no chance
    uneven: Mapping[str, tuple[float, float]]  # the same: where [s] it is far larger than elsewhere, how many times
    change: Change | None  # None: none is seen

    @property
    def lacks(self) -> list[str]:
        """In what the model lacks something."""
        return [kind for kind in (GOES, TURNS) if kind in self.follows or kind in self.uneven]

    @property
    def lasting(self) -> list[str]:
        """Channels whose noise lasts from one measurement to the next."""
        return [name for name, x in self.white.items() if x > LASTS]


NOTHING = Left({}, {}, {}, None)


def left(fit: Fit, logs: Sequence[Log], seed: int) -> Left:
    """All that is to be said of what a fit leaves."""
    return Left(white(fit), follows(fit, logs), uneven(fit), changed(fit, seed))


def against(left: Left) -> list[str]:
    """What is left of the measurements that speaks against the model, or that only looks so."""
    said = [
        f"What is left of {kind} goes with the commands, {share:.0%} of it more than by chance: the model lacks"
        " something there, and values may be off by more than their intervals say. Fit more (--fit), or another kind of"
        " vehicle."
        for kind, share in left.follows.items()
    ]
    said += [
        f"What is left of {kind} is {times:.0f} times as large from t = {t:.0f} s on for one stretch as it usually is,"
        " which noise is not: the model lacks something there (friction that sticks, slip), or a sensor failed."
        for kind, (t, times) in left.uneven.items()
    ]
    if left.change:
        said.append(
            f"From t = {left.change.t:.0f} s on the machine behaves differently: {left.change.name} by"
            f" {left.change.by:+.2g} if it alone has changed. Fit what is before and what is behind alone: another"
            " floor, load or battery?"
        )
    if left.lasting and not left.lacks:
        said.append(
            f"Noise of {', '.join(left.lasting)} lasts from one measurement to the next, as that of a pose that a robot"
            " makes itself does: it does not go with the commands, and the intervals count it."
        )
    return said


def white(fit: Fit) -> dict[str, float]:
    """What is left, measurement by measurement: correlation with the one before, by channel."""
    return {name: float(_correlations(fit, c)[1]) for c, name in enumerate(fit.model.channels)}


def follows(fit: Fit, logs: Sequence[Log]) -> dict[str, float]:
    """The share of what is left that goes with the commands, where that is more than with those of other stretches.

    How what is left of the pose grows, along, aside and in heading, is compared with the commands of the last second,
    as they are and by the roots of their steps (least squares). How much of it chance explains, whatever the noise, the
    commands of other stretches tell: the stretches are turned round against each other.
    """
    channels, pose = fit.model.channels, ("x", "y", "heading")
    if len(fit.segments.t) < ENOUGH or not {*pose} <= {*channels}:
        return {}
    places = [channels.index(name) for name in pose]
    segments = thinned(fit.segments._replace(seen=_beside(fit, places)), COMPARED)
    grown, span = _grown(segments, places)
    basis = _basis(segments, logs, grown.shape[1], span)
    total = np.maximum((grown**2).sum(axis=(0, 1)), 1e-300)
    total = total * (grown != 0).any(axis=-1).mean()  # as if it were known in every row

    def explained(turned: int) -> np.ndarray:
        gone = np.roll(basis, turned, axis=0).reshape(-1, basis.shape[-1])
        return ((gone.T @ grown.reshape(-1, 3)) ** 2).sum(axis=0) / total

    chance = np.array([explained(k) for k in range(1, len(segments.t))])
    usual, spread = chance.mean(axis=0), np.maximum(chance.std(axis=0), 1e-300)
    share = explained(0) - usual
    most = ((chance - usual) / spread).max(axis=1)
    clear = share / spread > max(CHANCE, float(np.quantile(most, RARE)))
    kinds = {GOES: [0, 1], TURNS: [2]}
    return {kind: float(share[of_it].max()) for kind, of_it in kinds.items() if clear[of_it].any()}


def uneven(fit: Fit) -> dict[str, tuple[float, float]]:
    """Where [s] far more is left than in most stretches, and how many times, if it varies more than noise does.

    A mean square over n measurements of noise with correlations r_l varies by sqrt(2 (1 + 2 sum (1 - l/n) r_l^2) / n).
    """
    found: dict[str, tuple[float, float]] = {}
    begins = _begins(fit.segments)
    for c, name in enumerate(fit.model.channels):
        kept = fit.segments.weight[..., c] > 0
        count = kept.sum(axis=1)
        some = count >= max(4, 0.5 * np.median(count))
        if some.sum() < ENOUGH:
            continue
        square = (fit.sums.residual[..., c] ** 2 * kept).sum(axis=1)[some] / count[some]
        n = float(count[some].mean())
        r = _correlations(fit, c)[1 : int(n)]
        noise = np.sqrt(2 * (1 + 2 * np.sum((1 - np.arange(1, len(r) + 1) / n) * r**2)) / n)
        times, kind = square / max(square.mean(), 1e-300), TURNS if name in TURNING else GOES
        if times.std() > UNEVEN * noise and times.max() > found.get(kind, (0.0, 0.0))[1]:
            found[kind] = float(begins[some][times.argmax()]), float(times.max())
    return found


def changed(fit: Fit, seed: int) -> Change | None:
    """Whether numbers shift along the log: more than if the same stretches had come in any other order.

    What is before and what is behind some stretch is fitted for itself, one Gauss-Newton step each: how much less is
    left then is compared with what that comes to in other orders (Quandt 1960, judged by permutations).
    """
    place, count = np.ix_(fit.free, fit.free), len(fit.sums.slope)
    if count < ENOUGH:
        return None
    scale = np.sqrt(np.diag(information(fit.sums, fit.parameters)[place]))
    H = np.stack([own[place] for own in fit.sums.matrix]) / np.outer(scale, scale)
    g = fit.sums.slope[:, fit.free] / scale
    prior = np.diag((widths(fit.parameters)[fit.free] * scale) ** -2.0) + EASE * np.eye(len(scale))
    first, last = max(2, int(EDGE * count)), int((1 - EDGE) * count)
    k = np.unique(np.linspace(first, last, min(BREAKS, last - first + 1)).round().astype(int))

    def halves(order: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where numbers go behind and before each k (2, k, P), by how sure (2, k, P, P), how much less is left (k)."""
        sums, slopes = np.cumsum(H[order], axis=0), np.cumsum(g[order], axis=0)
        both = np.stack([sums[-1] - sums[k - 1], sums[k - 1]]) + prior
        pull = np.stack([slopes[-1] - slopes[k - 1], slopes[k - 1]])
        moves = -np.linalg.solve(both, pull[..., None])[..., 0]
        return moves, both, -(moves * pull).sum(axis=(0, -1))

    rng = np.random.default_rng([seed, 0xC4A])
    chance = [float(halves(rng.permutation(count))[2].max()) for _ in range(ORDERS)]
    moves, both, gain = halves(np.arange(count))
    if gain.max() <= np.quantile(chance, SURE):
        return None
    at = int(gain.argmax())
    by, spread = moves[0, at] - moves[1, at], np.linalg.inv(both[:, at]).sum(axis=0).diagonal()
    i = int(np.argmax(np.abs(by) / np.sqrt(spread)))
    names = [q.name for q, free in zip(fit.parameters, fit.free, strict=True) if free]
    return Change(float(_begins(fit.segments)[k[at]]), names[i], float(by[i] / scale[i]))


def _begins(segments: Segments) -> np.ndarray:
    """When each stretch begins to move (S,) [s]."""
    return np.min(segments.t, axis=1, where=segments.live > 0, initial=np.inf)


def _correlations(fit: Fit, channel: int) -> np.ndarray:
    """Of what is left of a channel with itself so many measurements later, from 0 on, within stretches."""
    both = zip(fit.sums.residual[..., channel], fit.segments.weight[..., channel] > 0, strict=True)
    rows = [left[kept] for left, kept in both]  # of a channel that is measured less often than others too
    square = float(np.mean(np.concatenate(rows) ** 2)) if any(map(len, rows)) else 0.0
    r = np.zeros(max(2, *map(len, rows)))
    for lag in range(len(r)):
        products = [row[lag:] * row[: len(row) - lag] for row in rows if len(row) > lag]
        r[lag] = np.concatenate(products).mean() / max(square, 1e-30) if products else 0.0
    return r


def _beside(fit: Fit, pose: Sequence[int]) -> np.ndarray:
    """What is left of the pose, along and aside of where the vehicle looks, and in heading (S, K, 3)."""
    (x, y, heading), looks = (fit.sums.residual[..., c] for c in pose), fit.segments.seen[..., pose[2]]
    c, s = np.cos(looks), np.sin(looks)
    return np.stack([x * c + y * s, y * c - x * s, heading], axis=-1)


def _live(segments: Segments, values: np.ndarray) -> np.ndarray:
    """Of values (S, K, ...) those from the first row on in which the vehicle moves, as many for each."""
    first = np.argmax(segments.live > 0, axis=1)
    rows = np.minimum(first[:, None] + np.arange(values.shape[1] - first.min()), values.shape[1] - 1)
    return values[np.arange(len(values))[:, None], rows]


def _grown(segments: Segments, pose: Sequence[int]) -> tuple[np.ndarray, int]:
    """How what is left of the pose grows over a SPAN (S, k, 3), 0 where that is not known; and rows of the span."""
    kept = _live(segments, segments.weight[..., pose].min(axis=-1)) > 0
    off, step = _live(segments, segments.seen), float(np.median(segments.h))
    rows = np.flatnonzero(kept.any(axis=0))
    apart = int(np.median(np.diff(rows))) if rows.size > 1 else 1  # rows from pose to pose
    span = apart * max(1, round(SPAN / (step * apart)))
    grown, there = off[:, span:] - off[:, :-span], (kept[:, span:] & kept[:, :-span])[..., None]
    return np.where(there, grown - grown.mean(axis=(0, 1), where=there), 0.0), span


def _basis(segments: Segments, logs: Sequence[Log], rows: int, span: int) -> np.ndarray:
    """What could explain it (S, rows, F), orthonormal: earlier commands, and sums of the roots of their steps."""
    tables = []
    for log in logs:
        steps = np.diff(log.inputs, axis=0, prepend=log.inputs[:1])
        parts = np.hstack([log.inputs, np.cumsum(np.sign(steps) * np.sqrt(np.abs(steps)), axis=0)])
        summed, columns = np.cumsum(parts, axis=0), []
        for lag in np.unique(np.round(EARLIER / log.step).astype(int)):
            at = np.maximum(np.arange(len(parts)) - lag, 0)
            columns.append(summed[np.maximum(at + span, 0).clip(max=len(parts) - 1)] - summed[at])
        tables.append(np.hstack(columns))
    at = np.maximum(_live(segments, segments.rows), 0)[:, :rows]
    table = np.stack([tables[which][own] for which, own in zip(segments.log, at, strict=True)])
    flat = table.reshape(-1, table.shape[-1])
    flat = flat - flat.mean(axis=0)
    flat = flat / np.maximum(flat.std(axis=0), 1e-12)
    squares, ways = np.linalg.eigh(flat.T @ flat)
    some = squares > 1e-6 * squares[-1]
    return (flat @ (ways[:, some] / np.sqrt(squares[some]))).reshape(*table.shape[:2], -1)
