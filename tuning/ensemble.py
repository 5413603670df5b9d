"""Which scenarios to tune for: distributions over any leaf of a scenario, and samples of them."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

import agvjax
from agvjax.leaves import get

TAIL = 1e-3  # of a distribution, left out on either side of its box


class Between(NamedTuple):
    """Uniform between two values, in the unit of the leaf."""

    low: float
    high: float

    def quantile(self, share: Any, nominal: Any) -> Any:
        """The value below which a `share` of the draws lies."""
        return self.low + (self.high - self.low) * share + 0 * nominal


class Times(NamedTuple):
    """The nominal value, which is not negative, times a uniform factor."""

    low: float
    high: float

    def quantile(self, share: Any, nominal: Any) -> Any:
        """The value below which a `share` of the draws lies."""
        low, high = self.low * nominal, self.high * nominal
        return low + (high - low) * share


class Distribution(NamedTuple):
    """Any continuous distribution of `scipy.stats` by its name and parameters; times the nominal value if so asked."""

    name: str
    parameters: Mapping[str, float]
    times: bool = False

    def quantile(self, share: Any, nominal: Any) -> Any:
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


class OneOf(NamedTuple):
    """One of some values, each as likely as the others."""

    values: tuple[float, ...]

    def quantile(self, share: Any, nominal: Any) -> Any:
        """The value below which a `share` of the draws lies."""
        place = np.minimum((np.asarray(share) * len(self.values)).astype(int), len(self.values) - 1)
        return np.asarray(sorted(self.values))[place] + 0 * nominal


Draw = Between | Times | Distribution | OneOf


class Span(NamedTuple):
    """A draw as an axis of a sweep: so many points of it, or, without points, samples."""

    draw: Draw
    points: int = 0


def box(draw: Draw, nominal: Any) -> tuple[Any, Any]:
    """Smallest and largest value; of a distribution all but a `TAIL` of the draws on either side."""
    tail = TAIL if isinstance(draw, Distribution) else 0.0
    low, high = (draw.quantile(np.full(np.shape(nominal), share), nominal) for share in (tail, 1 - tail))
    return low, high


def default_draws(actuators: Iterable[str] = ("position", "heading")) -> dict[str, Draw]:
    """The default tuning problem: every deadzone number within a half of nominal, disturbance and start drawn too."""
    parts = ("slope_right", "slope_left", "threshold_right", "threshold_left")
    draws: dict[str, Draw] = {f"deadzone.{c}.{p}": Times(0.5, 1.5) for c in actuators for p in parts}
    return draws | {
        "disturbance.amplitude": Between(0.0, 0.4),
        "start.position": Between(-0.5, 0.5),
        "start.heading": Between(-0.5, 1.0),
    }


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
        stream = name if part == 0 else f"{name}#{part}"
        shares = uniform(seed, stream, size, nominal.size).reshape(size, *nominal.shape)
        values[name] = draw.quantile(shares, nominal)
    return agvjax.batch(scenario, values)


def lowest(scenario: Any, draws: Mapping[str, Draw], name: str) -> float:
    """The smallest value that a leaf can take in the ensemble."""
    nominal = np.asarray(get(scenario, name), float)
    return float(np.min(box(draws[name], nominal)[0] if name in draws else nominal))
