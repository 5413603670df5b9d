"""Which scenarios to tune for: distributions over any leaf of a scenario, and samples of them."""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

import agvjax
from agvjax.leaves import get

TAIL = 1e-3  # of a distribution, left out on either side of its box
LEAST = 2.0**-53  # the smallest share above 0 that is drawn, and 1 - LEAST the largest
WITHIN = (0.0, 0.382, 0.618, 1.0)  # shares of a range that stand for all of it: its ends, and two that are no fractions

Numbers = float | np.ndarray
End = float | tuple[float, ...]  # of a range: of a number, or of all elements of an array, or of each


@dataclasses.dataclass(frozen=True)
class Draw:
    """How a leaf of a scenario varies: needs `quantile`."""

    tailed: ClassVar[bool] = False  # whether its box leaves out a `TAIL` of the draws on either side
    moves: ClassVar[bool] = True  # whether every value in its box is allowed

    def quantile(self, share: Numbers, nominal: Numbers) -> np.ndarray:
        """The value below which a `share` of the draws lies, of a leaf whose nominal value is `nominal`."""
        raise NotImplementedError(f"{type(self).__name__} needs quantile(share, nominal)")

    def box(self, nominal: Numbers) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest value; of a distribution all but a `TAIL` of the draws on either side."""
        low, high = (self.quantile(np.full(np.shape(nominal), share), nominal) for share in self.ends)
        return low, high

    @property
    def ends(self) -> tuple[float, float]:
        """The shares of the draws below either end of the box."""
        tail = TAIL if self.tailed else 0.0
        return tail, 1 - tail

    def along(self, shares: Sequence[float] | np.ndarray, nominal: np.ndarray) -> np.ndarray:
        """The values of a leaf (n, ...) at shares (n,), the same for all its elements."""
        shares = np.asarray(shares, float).reshape(-1, *[1] * nominal.ndim)
        return np.asarray(self.quantile(shares + 0 * nominal, nominal), float)

    def partners(self, leaf: str) -> Mapping[str, float]:
        """By leaf, how much of its normal number goes into that of this `leaf`; see `together`."""
        return {leaf: 1.0}

    def alone(self) -> Draw:
        """The same draw, independent of those of other leaves."""
        return self

    def of(self, element: int) -> Draw:
        """That of one element of an array."""
        return self

    @property
    def width(self) -> int | None:
        """The number of elements that it has a range for each of; None: any will do."""
        return None


@dataclasses.dataclass(frozen=True)
class Range(Draw):
    """A uniform draw between two ends."""

    low: End
    high: End

    def of(self, element: int) -> Draw:
        """That of one element of an array."""
        return self if self.width is None else type(self)(*(np.asarray(x)[element].item() for x in vars(self).values()))

    @property
    def width(self) -> int | None:
        """The number of elements that it has a range for each of; None: any will do."""
        return len(self.low) if isinstance(self.low, tuple) else None


@dataclasses.dataclass(frozen=True)
class Between(Range):
    """Uniform between two values, in the unit of the leaf."""

    def quantile(self, share: Numbers, nominal: Numbers) -> np.ndarray:
        """The value below which a `share` of the draws lies."""
        low, high = np.asarray(self.low), np.asarray(self.high)
        return np.asarray(low + (high - low) * share + 0 * nominal)


@dataclasses.dataclass(frozen=True)
class Plus(Range):
    """The nominal value plus a uniform part, in the unit of the leaf."""

    def quantile(self, share: Numbers, nominal: Numbers) -> np.ndarray:
        """The value below which a `share` of the draws lies."""
        low, high = nominal + np.asarray(self.low), nominal + np.asarray(self.high)
        return np.asarray(low + (high - low) * share)


@dataclasses.dataclass(frozen=True)
class Times(Range):
    """The nominal value, which is not negative, times a uniform factor."""

    def quantile(self, share: Numbers, nominal: Numbers) -> np.ndarray:
        """The value below which a `share` of the draws lies."""
        low, high = np.asarray(self.low) * nominal, np.asarray(self.high) * nominal
        return np.asarray(low + (high - low) * share)


@dataclasses.dataclass(frozen=True)
class Distribution(Draw):
    """Any continuous distribution of `scipy.stats` by its name and parameters; times the nominal value if so asked."""

    tailed: ClassVar[bool] = True

    name: str
    parameters: Mapping[str, float]
    times: bool = False

    def quantile(self, share: Numbers, nominal: Numbers) -> np.ndarray:
        """The value below which a `share` of the draws lies.

        Raises:
            ValueError: no such distribution, or not with these parameters.
        """
        from scipy import stats  # late: half a second that few runs need

        family = getattr(stats, self.name, None)
        if not isinstance(family, stats.rv_continuous):
            raise ValueError(f"scipy.stats has no continuous distribution {self.name}")
        try:
            with np.errstate(all="ignore"):  # what comes of bad parameters is looked at below
                value = family(**self.parameters).ppf(share)
        except TypeError as error:
            raise ValueError(f"{self.name} takes other parameters ({error})") from error
        if not np.all(np.isfinite(value[np.asarray(share) > 0] if np.ndim(share) else value)):
            raise ValueError(f"{self.name} is not defined for {dict(self.parameters)}")
        return value * nominal if self.times else value + 0 * nominal


@dataclasses.dataclass(frozen=True)
class OneOf(Draw):
    """One of some values, each as likely as the others."""

    moves: ClassVar[bool] = False

    values: tuple[float, ...]

    def quantile(self, share: Numbers, nominal: Numbers) -> np.ndarray:
        """The value below which a `share` of the draws lies."""
        place = np.minimum((np.asarray(share) * len(self.values)).astype(int), len(self.values) - 1)
        return np.asarray(sorted(self.values))[place] + 0 * nominal


class Correlation(NamedTuple):
    """Which leaves are drawn together: the correlations of the normal numbers behind their draws (Gaussian copula)."""

    leaves: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]


@dataclasses.dataclass(frozen=True)
class Correlated(Draw):
    """A distribution whose draws go with those of other leaves."""

    tailed: ClassVar[bool] = True

    marginal: Draw
    leaves: tuple[str, ...]  # those it goes with, itself among them, in the order of the factor
    row: tuple[float, ...]  # of the Cholesky factor of their correlations

    def quantile(self, share: Numbers, nominal: Numbers) -> np.ndarray:
        """The value below which a `share` of the draws lies, whatever the others are."""
        return self.marginal.quantile(share, nominal)

    def partners(self, leaf: str) -> Mapping[str, float]:
        """Its row of the factor, by leaf."""
        return dict(zip(self.leaves, self.row, strict=True))

    def alone(self) -> Draw:
        """The distribution, independent of those of other leaves."""
        return self.marginal


class Span(NamedTuple):
    """A draw as an axis of a sweep: so many points of it, or, without points, samples."""

    draw: Draw
    points: int = 0


def places(draws: Sequence[Draw], points: int = 0) -> np.ndarray:
    """Shares at which leaves that move as one stand: of a grid its `points`, of a distribution all but its tails.

    What is sampled, without points, stands anywhere: its ends and two shares within are what is looked at, or, where
    there are only some values, each of them.
    """
    if isinstance(draws[0], OneOf):
        count = points or len(draws[0].values)
        return (np.arange(count) + 0.5) / count
    tail = max(draw.ends[0] for draw in draws)
    if points:
        return np.linspace(tail, 1 - tail, points) if points > 1 else np.array([0.5])
    return tail + (1 - 2 * tail) * np.array(WITHIN)


@dataclasses.dataclass(frozen=True)
class Usual(Draw):
    """As `default_draws` has it; nothing that uses draws meets it, `complete` puts the other in its place."""


def default_draws(
    actuators: Iterable[str] = ("position", "heading"),
    start: agvjax.Start | None = None,
    path: agvjax.Path | None = None,
) -> dict[str, Draw]:
    """The default tuning problem: every deadzone number within a half of nominal, disturbance and start drawn too.

    The start is drawn about the beginning of the paper's path, where the nominal `start` lies in what is drawn there;
    a start elsewhere, or on a path through points of one's own, is drawn as far about itself.
    """
    parts = ("slope_right", "slope_left", "threshold_right", "threshold_left")
    draws: dict[str, Draw] = {f"deadzone.{c}.{p}": Times(0.5, 1.5) for c in actuators for p in parts}
    there = {"start.position": Between(-0.5, 0.5), "start.heading": Between(-0.5, 1.0)}
    start = agvjax.Start() if start is None or agvjax.faults(start) else start
    nominal = {name: np.asarray(get(start, name.removeprefix("start.")), float) for name in there}
    own = isinstance(path, (agvjax.Waypoints, agvjax.Route))
    inside = not own and all(np.all((x >= there[name].low) & (x <= there[name].high)) for name, x in nominal.items())
    elsewhere = {"start.position": Plus(-0.5, 0.5), "start.heading": Plus(-0.75, 0.75)}
    return draws | {"disturbance.amplitude": Between(0.0, 0.4)} | (there if inside else elsewhere)


def uniform(seed: int, stream: str, size: int, width: int = 1, first: int = 0) -> np.ndarray:
    """Numbers in [0, 1) (size, width) of the scenarios from number `first`: keyed by seed, stream and place alone."""
    skipped = first * width
    counter = np.random.Philox(key=[seed, zlib.crc32(stream.encode())]).advance(skipped // _DRAWS)
    ahead = skipped % _DRAWS
    return np.random.Generator(counter).random(ahead + size * width)[ahead:].reshape(size, width)


_DRAWS = 4  # numbers that Philox makes of one state of its counter


def sample(scenario: Any, draws: Mapping[str, Draw], size: int, seed: int, part: int = 0) -> agvjax.Batch:
    """`size` scenarios with the named leaves drawn independently.

    A number depends on the seed, the name of its leaf, the part and its place in the ensemble alone: a larger ensemble
    begins with the smaller one, and another draw added changes none of the others. Another `part` is drawn anew.
    """
    values = {}
    for name, draw in draws.items():
        nominal = np.asarray(get(scenario, name), float)
        partners = draw.partners(name)
        streams = [leaf if part == 0 else f"{leaf}#{part}" for leaf in partners]
        shares = np.stack([uniform(seed, stream, size, nominal.size) for stream in streams])
        drawn = together(shares, tuple(partners.values())).reshape(size, *nominal.shape)
        values[name] = draw.quantile(drawn, nominal)
    return agvjax.batch(scenario, values)


def together(shares: np.ndarray, row: Sequence[float]) -> np.ndarray:
    """Shares of a leaf (n, ...), from the independent ones of all it goes with (K, n, ...)."""
    if len(row) == 1:
        return shares[0]
    from scipy.special import ndtr, ndtri  # late: half a second that few runs need

    return ndtr(np.tensordot(np.asarray(row), ndtri(shares), axes=1))


def correlated(draws: Mapping[str, Draw], correlation: Correlation) -> dict[str, Draw]:
    """The draws, those that are correlated tied together.

    Raises:
        ValueError: a leaf is not drawn from a distribution, or these are no correlations.
    """
    matrix, size = np.asarray(correlation.matrix, float), len(correlation.leaves)
    loose = [n for n in correlation.leaves if n not in draws or not draws[n].tailed]
    if loose:
        raise ValueError(f"{', '.join(loose)} must each be drawn from a distribution")
    if matrix.shape != (size, size) or not np.allclose(matrix, matrix.T) or not np.allclose(np.diag(matrix), 1):
        raise ValueError(f"the matrix must be symmetric, {size} by {size}, with 1 on its diagonal")
    try:
        factor = np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError as error:
        raise ValueError("the matrix must be positive definite") from error
    tied = dict(draws)
    for name, row in zip(correlation.leaves, factor, strict=True):
        tied[name] = Correlated(draws[name].alone(), correlation.leaves, tuple(row.tolist()))
    return tied


def lowest(scenario: Any, draws: Mapping[str, Draw], name: str) -> float:
    """The smallest value that a leaf can take in the ensemble."""
    nominal = np.asarray(get(scenario, name), float)
    return float(np.min(draws[name].box(nominal)[0] if name in draws else nominal))
