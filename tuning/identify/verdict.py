"""How surely each parameter is known: Gauss-Newton covariance, bootstrap over stretches, and what was not excited."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..config.settings import Identify
from .fit import SETTLED, WORTH, Fit, Task, fit, information, refitted
from .left import NOTHING, TURNING, Left, left
from .log import moved
from .model import compiled
from .parameters import OMEGA, Parameter, sinusoidal, values, widths

Z95 = 1.959964  # of a normal distribution
PRECISE = 0.25  # half a 95 % interval, relative to the value, up to which a parameter counts as identified
SHARPER = 0.5  # of the width of what is believed without the log
FELT = 3.0  # standard deviations that its size, or what is believed of it, must change the log by to be excited
CHECKED = "the same drive with the unit and sign of the commands, and the model, checked"
NEAR = 1e-3  # of where a parameter was looked for: at its edge
DIFFER = "where the vehicle goes says {:.3g}, how it turns {:.3g}: the model lacks something, which bends this"
MENDED = "the model mended: fit more (--fit), or another kind of vehicle"
STILL = "nothing that is measured moves by more than its noise: with any value the log would look the same"
DISAGREE = 3.5  # deviations of their difference, beyond which what these two say of a number is no chance
SELF = 0.1  # of a stretch's own pull, that remains at least of what it says
FEWEST = 3.0  # stretches that count as telling a number, however few do
ALIKE = 0.8  # correlation from which two parameters are named together


class Estimate(NamedTuple):
    """What the log says of one parameter."""

    name: str
    unit: str
    value: float  # where the search ended; means nothing unless identified
    deviation: float = 0.0  # standard, the larger of the two below
    gauss_newton: float = 0.0
    bootstrap: float = 0.0
    low: float = np.nan  # of the 95 % interval
    high: float = np.nan
    identified: bool = False
    reason: str = ""  # why not; empty where it is
    drive: str = ""  # what drive would tell; empty where none is needed
    alike: tuple[str, ...] = ()  # numbers that make up for it in this drive

    @property
    def absent(self) -> bool:
        """Whether it was looked for and is not there."""
        return not (self.identified or self.drive)


class FitVerdict(NamedTuple):
    """All estimates, and how they go together."""

    estimates: tuple[Estimate, ...]
    correlation: np.ndarray  # (P, P), of Gauss-Newton; unit rows for what was not free
    left: Left = NOTHING  # what is left of the measurements

    @property
    def identified(self) -> int:
        """How many are."""
        return sum(e.identified for e in self.estimates)


def judge(fit: Fit, draws: int, seed: int) -> FitVerdict:
    """Intervals and identifiability of every parameter."""
    parameters, free = fit.parameters, fit.free
    H, place = information(fit.sums, parameters), np.ix_(free, free)
    covariance = np.zeros_like(H)
    covariance[place] = inverse(H[place])
    deviation = np.sqrt(np.diag(covariance))
    bootstrapped = bootstrap(fit, draws, seed)
    scale = np.where(deviation > 0, deviation, 1.0)
    correlation = covariance / np.outer(scale, scale)
    np.fill_diagonal(correlation, 1.0)
    felt = np.sqrt(np.diag(fit.sums.matrix.sum(axis=0)))
    slope = fit.sums.slope.sum(axis=0) + (fit.p - values(parameters)) / widths(parameters) ** 2
    step = -np.diag(covariance) * slope  # of each alone, where nothing stands in its way
    numbers = zip(deviation, bootstrapped, felt, step, correlation, _quantile(fit, covariance), strict=True)
    estimates = [_estimate(fit, i, *row) for i, row in enumerate(numbers)]
    return FitVerdict(tuple(_agreed(fit, estimates, draws, seed)), correlation)


def settled(
    task: Task, settings: Identify, seed: int, tick: Callable[[str], object] = lambda text: None
) -> tuple[Fit, FitVerdict]:
    """Fit and judge; then once more without a sinusoid, and without the constant pushes, that may as well be 0.

    A vehicle that never moved tells nothing, whatever fits best. At last what is left is looked at.
    """
    best = fit(task, settings.starts, settings.outlier, seed, tick)
    verdict = judge(best, settings.bootstrap, seed)
    if not any(moved(log) for log in task.logs):
        still = [Estimate(q.name, q.unit, q.nominal, reason=STILL, drive=advice(q.name)) for q in best.parameters]
        return best, verdict._replace(estimates=tuple(still))
    for doubted in (_doubtful_sinusoid, _doubtful_constants):
        if absent := doubted(best, verdict):
            gone = np.array([q.name in absent for q in best.parameters])
            zero = gone & np.array([q.name != OMEGA for q in best.parameters])
            best = refitted(best, np.where(zero, 0.0, best.p), best.free & ~gone, absent)
            verdict = judge(best, settings.bootstrap, seed)
    return best, verdict._replace(left=left(best, task.logs, seed))


def _doubtful_sinusoid(fit: Fit, verdict: FitVerdict) -> dict[str, str]:
    """The sinusoid that was looked for, if by the deviations of the bootstrap it is not worth its place either."""
    names = [e.name for e in verdict.estimates]
    if OMEGA not in names or not fit.free[names.index(OMEGA)]:
        return {}
    wavy = [i for i, name in enumerate(names) if sinusoidal(name) and name != OMEGA]
    deviation = np.array([verdict.estimates[i].deviation for i in wavy])
    size = fit.p[wavy] / deviation
    if size @ np.linalg.solve(verdict.correlation[np.ix_(wavy, wavy)], size) >= WORTH:
        return {}
    why = f"the one of {fit.p[names.index(OMEGA)]:.3g} rad/s that explains most is no clearer than chance"
    return {OMEGA: why} | {names[i]: f"{why}; taken as 0" for i in wavy}


def _doubtful_constants(fit: Fit, verdict: FitVerdict) -> dict[str, str]:
    """Constant pushes whose intervals hold 0."""
    return {
        e.name: f"no constant push found, at most {max(abs(e.low), abs(e.high)):.2g}; taken as 0"
        for e in verdict.estimates
        if e.name.startswith("disturbance.") and e.name.endswith(".constant") and e.low <= 0 <= e.high
    }


def inverse(H: np.ndarray) -> np.ndarray:
    """The inverse of a positive definite matrix whose rows have very different sizes."""
    scale = np.sqrt(np.diag(H))
    return np.linalg.inv(H / np.outer(scale, scale)) / np.outer(scale, scale)


def bootstrap(fit: Fit, draws: int, seed: int) -> np.ndarray:
    """Standard deviations (P,) over resampled stretches, one Gauss-Newton step each from the fit.

    Stretches begin in states of their own, so that each is a sample of its own: errors that go together within one, by
    noise that lasts or by what the model lacks, widen these deviations and not Gauss-Newton's. How far one pulls the
    fit to itself is made up for (`_alone`).
    """
    rng = np.random.default_rng([seed, 0xB007])
    width, free = widths(fit.parameters), fit.free
    prior, pull = np.diag(width**-2.0), (fit.p - values(fit.parameters)) / width**2
    count, steps, place, slope = len(fit.sums.cost), [], np.ix_(free, free), _alone(fit)
    for _ in range(draws):
        times = np.bincount(rng.integers(count, size=count), minlength=count).astype(float)
        H = np.tensordot(times, fit.sums.matrix, axes=1) + prior
        g = times @ slope + pull[free]
        scale = np.sqrt(np.diag(H)[free])
        steps.append(-np.linalg.solve(H[place] / np.outer(scale, scale), g / scale) / scale)
    spread = np.zeros(len(fit.p))
    spread[free] = np.std(steps, axis=0, ddof=1) if draws > 1 else 0.0
    return spread


def _alone(fit: Fit) -> np.ndarray:
    """Slopes of the stretches (S, free), each as large as it would be had the stretch not pulled the fit to itself.

    (I - H_s H^-1)^-1/2 g_s, in coordinates in which H is the unit matrix: unbiased where noise is white (Bell and
    McCaffrey 2002).
    """
    place = np.ix_(fit.free, fit.free)
    H = information(fit.sums, fit.parameters)[place]
    scale = np.sqrt(np.diag(H))
    sizes, turned = np.linalg.eigh(H / np.outer(scale, scale))
    into = turned / np.sqrt(sizes) / scale[:, None]  # of which into into^T is H^-1
    part, way = np.linalg.eigh(into.T @ np.stack([own[place] for own in fit.sums.matrix]) @ into)
    more = 1 / np.sqrt(np.maximum(1 - part, SELF))
    slopes = fit.sums.slope[:, fit.free] @ into
    mended = np.einsum("sij,sj,skj,sk->si", way, more, way, slopes)
    return mended @ np.linalg.inv(into)


def _quantile(fit: Fit, covariance: np.ndarray) -> np.ndarray:
    """How many deviations a 95 % interval reaches (P,): of Student, as the stretches are few that tell a number.

    Their number is (sum a)^2 / sum a^2, where a_s is what a stretch has part in a number's variance.
    """
    from scipy.stats import t as student  # late: a second that few runs need

    part = np.einsum("ij,sjk,ki->si", covariance, fit.sums.matrix, covariance)
    total = np.maximum(part.sum(axis=0), 1e-300)
    some = np.where(part.any(axis=0), total**2 / np.maximum((part**2).sum(axis=0), 1e-300), np.inf)
    return np.asarray(student.ppf(0.975, np.maximum(some, FEWEST)))


def _estimate(
    fit: Fit, i: int, gauss_newton: float, bootstrapped: float, felt: float, step: float, row: np.ndarray, wide: float
) -> Estimate:
    """Of the i-th parameter, by its deviations, what it changes in the log, where it would go, and its correlations."""
    q, value = fit.parameters[i], float(fit.p[i])
    if not fit.free[i]:
        return Estimate(q.name, q.unit, value if q.name == OMEGA else 0.0, reason=fit.absent[q.name])
    deviation = max(gauss_newton, bootstrapped)
    half = wide * deviation
    sharper = deviation < SHARPER * q.width  # or it is what was believed before
    identified, reason, drive = sharper and half <= max(PRECISE * abs(value), 2 * q.floor), "", advice(q.name)
    near, others = NEAR * (q.high - q.low), []
    sank = value - q.low < near < q.nominal - value  # to the least that it can be: the log felt that much
    if words := _edge(q, value, half if identified else 0.0, step / max(deviation, 1e-300)):
        identified, reason = False, words  # asked first: what ends there is no value, however much it is felt
        drive = drive if ".threshold_" in q.name else CHECKED
    elif not identified and not sank and felt * max(abs(value), q.floor, q.width) < FELT:
        reason = "never excited: with any value the log would look the same"
    elif not identified and value - q.low < near:
        reason = f"ends at {value:.4g}, the least that it can be: at most {value + half:.4g}, if the model is right"
    elif not identified:
        others = [fit.parameters[j].name for j in np.argsort(-np.abs(row)) if j != i and abs(row[j]) >= ALIKE][:3]
        reason = f"looks like {', '.join(others)} in this drive" if others else "hardly excited: its interval is wide"
    interval = max(value - half, q.low), min(value + half, q.high)
    numbers = (value, deviation, gauss_newton, bootstrapped, *interval)
    return Estimate(q.name, q.unit, *numbers, bool(identified), reason, "" if identified else drive, tuple(others))


def _edge(q: Parameter, value: float, half: float, push: float) -> str:
    """Why a value is none since it, or its interval of `half` to each side, lies at an edge of where it was looked for.

    At an edge beyond which nothing can be, as at a delay of 0, it is one unless the log pushes it on, by `push`
    deviations to higher values.
    """
    near = NEAR * (q.high - q.low)
    for edge, off, words, outwards in ((q.low, value - q.low, q.least, -push), (q.high, q.high - value, q.most, push)):
        if words and off <= max(near, q.floor):
            return f"ends at {value:.4g}, the edge of where it was looked for: {words}"
        if words and off <= half:
            return f"its interval reaches {edge:.4g}, the edge of where it was looked for: {words}"
        if off <= near and outwards > FELT:
            return f"ends at {value:.4g}, the edge of what it can be, and the log pushes beyond it: a wrong model?"
    return ""


def _agreed(fit: Fit, estimates: Sequence[Estimate], draws: int, seed: int) -> list[Estimate]:
    """Numbers are none on which where the vehicle goes and how it turns disagree, by more than is negligible.

    What a model lacks in one of them bends what it shares with the other, and no interval counts that. All numbers of
    the kind are doubted: the delays of all actuators.
    """
    turning = np.array([name in TURNING for name in fit.model.channels])
    (p, deviation), (q, other) = (_told_by(fit, channels, draws, seed) for channels in (~turning, turning))
    apart = np.abs(p - q)
    least = np.array([max(PRECISE * abs(e.value), 2 * x.floor) for e, x in zip(estimates, fit.parameters, strict=True)])
    clear = fit.free & (apart > DISAGREE * np.hypot(deviation, other)) & (apart > 2 * least)
    doubted = {e.name.rpartition(".")[2] for e, far in zip(estimates, clear, strict=True) if far}
    return [
        e._replace(identified=False, reason=DIFFER.format(p[i], q[i]), drive=MENDED)
        if e.identified and e.name.rpartition(".")[2] in doubted
        else e
        for i, e in enumerate(estimates)
    ]


def _told_by(fit: Fit, channels: np.ndarray, draws: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Parameters (P,) by some of the measurements alone, one Gauss-Newton step from the fit, and their deviations."""
    function, free = compiled(fit.model), fit.free
    segments = fit.segments._replace(weight=fit.segments.weight * channels)
    sums = fit.sums
    for _ in range(SETTLED):
        sums = function(fit.p, sums.states, segments)
    part = fit._replace(sums=sums, segments=segments)
    place = np.ix_(free, free)
    covariance = inverse(information(sums, fit.parameters)[place])
    slope = sums.slope.sum(axis=0) + (fit.p - values(fit.parameters)) / widths(fit.parameters) ** 2
    p, deviation = fit.p.copy(), bootstrap(part, draws, seed)
    p[free] -= covariance @ slope[free]
    deviation[free] = np.maximum(deviation[free], np.sqrt(np.diag(covariance)))
    return p, deviation


def advice(name: str) -> str:
    """What drive would tell a parameter."""
    head, _, last = name.rpartition(".")
    if head.startswith("deadzone."):
        actuator, side = head.split(".")[1], "positive" if last.endswith("right") else "negative"
        return f"{side} commands of {actuator} at several levels, some just beyond the threshold"
    if last in ("time", "time_constant", "steering_time"):
        return f"steps of {'the commands' if head == 'plant' else name.split('.')[1]} up and down"
    if name in ("plant.acceleration", "plant.steering_rate"):
        return "steps of the commands so large that the vehicle is as slow as it can be in following them"
    if sinusoidal(name):
        return "a drive of several periods of the disturbance"
    if last in ("friction", "viscous", "creep"):
        return "forwards and backwards, at several speeds"
    if head in ("plant", "sensor"):
        return "turns to both sides while driving"
    return "a longer drive, in several headings"
