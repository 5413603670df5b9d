"""The parameters under which a scenario looks most like a log: trust-region least squares over all stretches."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from agvjax import InputError

from ..io.csv_file import Column
from . import parameters as wanted
from .log import Log
from .misread import misread
from .model import Model, Says, Sums, compiled
from .parameters import OMEGA, SINUSOID, Parameter, sinusoidal
from .segments import Counts, Segments, noise, with_inputs
from .states import first_states

SETTLED = 2  # steps in which the states of the stretches follow the parameters
TRIALS, LAST = 40, 25  # evaluations of a search from one start, and of those that refine it
EASE = 1e-12  # of the diagonal: what a log without noise tells may outweigh by 1e16 what it does not
ROUNDS = 3  # of leaving out what fits too badly, and of weighing the channels by what is left
FASTEST, SCANNED = 2 * np.pi, 60.0  # rad/s and s: where and in how much of the log a frequency is looked for
SMALL = 5e-3  # of how far a channel moves within a stretch: less is no outlier, however little noise a log has
WORTH = 30.0  # what the sum of squares must fall by, in variances, for a frequency to be believed


class Task(NamedTuple):
    """What is to be fitted to what."""

    logs: tuple[Log, ...]
    one_clock: bool  # of all logs: a sinusoid in the disturbance has the same phase in all
    segments: Segments
    brief: Segments  # shorter ones: over them the starts end at the same place, over longer ones often not
    counts: Counts
    model: Model
    parameters: tuple[Parameter, ...]
    columns: Mapping[str, Column]  # of the files, where the configuration names them
    memory: float  # s, for which actuators remember commands


class Fit(NamedTuple):
    """The best parameters, and what they rest on."""

    parameters: tuple[Parameter, ...]
    p: np.ndarray  # (P,)
    free: np.ndarray  # (P,), False for those that were left where they were
    sums: Sums  # with weights 1 / sigma^2
    segments: Segments
    sigma: np.ndarray  # (C,), standard deviation of what is left in each channel
    counts: Counts
    arrived: tuple[int, int]  # how many of how many starts ended at the best sum of squares, within 1 %
    evaluations: int
    model: Model
    absent: Mapping[str, str]  # parameters that were left at 0 since nothing of them is there, and in words


@dataclasses.dataclass
class Search:
    """One least-squares problem; remembers the states of the stretches where it was best."""

    function: Says
    segments: Segments
    parameters: Sequence[Parameter]
    states: np.ndarray
    evaluations: int = 0
    best: float = np.inf
    seen: tuple[bytes, Sums] | None = None

    def sums(self, p: np.ndarray) -> Sums:
        """What all stretches say at p."""
        if self.seen is not None and self.seen[0] == p.tobytes():
            return self.seen[1]
        states = self.states
        for _ in range(SETTLED):
            states = self.function(p, states, self.segments).states
        sums = self.function(p, states, self.segments)
        self.evaluations += 1
        if sums.cost.sum() < self.best:
            self.best, self.states = float(sums.cost.sum()), sums.states
        self.seen = (p.tobytes(), sums)
        return sums

    def over(self, segments: Segments, states: np.ndarray) -> Search:
        """The same parameters over other stretches; evaluations are counted on."""
        return dataclasses.replace(self, segments=segments, states=states, best=np.inf, seen=None)

    def triangle(self, p: np.ndarray, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals and Jacobian of a small problem with the same sums of squares and products as the whole one."""
        sums, width = self.sums(p), wanted.widths(self.parameters)
        off = (p - wanted.values(self.parameters)) / width
        H, g = information(sums, self.parameters)[np.ix_(free, free)], (sums.slope.sum(axis=0) + off / width)[free]
        c = float(sums.cost.sum() + off[free] @ off[free])
        scale = np.sqrt(np.diag(H))
        upper = np.linalg.cholesky(H / np.outer(scale, scale) + EASE * np.eye(len(g))).T
        r = np.linalg.solve(upper.T, g / scale)
        rest = np.sqrt(max(c - r @ r, 0.0))
        return np.append(r, rest), np.vstack([upper * scale, np.zeros(len(g))])

    def run(self, p: np.ndarray, free: np.ndarray, most: int) -> tuple[np.ndarray, float]:
        """The best p with only the free ones moved, from p on."""
        from scipy.optimize import least_squares  # late, as below: `agvjax log` fits nothing

        low, high = np.array([(q.low, q.high) for q in self.parameters])[free].T

        def whole(x: np.ndarray) -> np.ndarray:
            full = p.copy()
            full[free] = x
            return full

        gap = 1e-6 * (high - low)
        first = np.clip(p[free], low + gap, high - gap)
        done = least_squares(
            lambda x: self.triangle(whole(x), free)[0],
            first,
            jac=lambda x: self.triangle(whole(x), free)[1],  # pyright: ignore[reportArgumentType]
            bounds=(low, high),
            x_scale=wanted.widths(self.parameters)[free],
            ftol=1e-7,
            xtol=1e-7,
            gtol=1e-12,
            max_nfev=most,
        )
        return whole(done.x), 2 * float(done.cost)


def information(sums: Sums, parameters: Sequence[Parameter]) -> np.ndarray:
    """Gauss and Newton's matrix (P, P) of all stretches, with what is believed without the log."""
    return sums.matrix.sum(axis=0) + np.diag(wanted.widths(parameters) ** -2.0)


def weighed(segments: Segments, sigma: np.ndarray) -> Segments:
    """The same stretches, each measurement that counts weighed by the variance of its channel."""
    return segments._replace(weight=(segments.weight > 0) / sigma**2)


def fit(task: Task, starts: int, outlier: float, seed: int, tick: Callable[[str], object] = lambda text: None) -> Fit:
    """The best parameters from several starts; a frequency is looked for and kept only where it explains something.

    Raises:
        agvjax.InputError: the commands do not explain the log, but would with another sign, unit or order.
    """
    parameters, segments, model = task.parameters, task.segments, task.model
    names = [q.name for q in parameters]
    wavy = np.array([sinusoidal(name) and OMEGA in names for name in names])  # at a known frequency they are linear
    sigma = noise(task.logs)
    states = first_states(model, task.logs, task.brief)
    search = Search(compiled(model), weighed(task.brief, sigma), parameters, states)
    ends = []
    for i, p in enumerate(_starts(parameters, wavy, starts, seed)):
        search = search.over(search.segments, states)
        ends.append(search.run(p, ~wavy, TRIALS))
        tick(f"start {i + 1} of {starts}")
    p, cost = min(ends, key=lambda end: end[1])
    _doubt(task, search, cost, states, ~wavy)
    arrived, free = sum(end[1] <= 1.01 * cost for end in ends), ~wavy
    search = search.over(weighed(segments, sigma), first_states(model, task.logs, segments))
    p, _ = search.run(p, free, TRIALS)
    for k in range(ROUNDS):
        search = _judged(search, p, model.begun, outlier)
        if k == 0 and wavy.any() and task.one_clock:
            p, free = _sinusoid(search, p, wavy, names)
        p, _ = search.run(p, free, LAST)
        tick("refined")
    left = int((segments.weight > 0).sum() - (search.segments.weight > 0).sum())
    counts = task.counts._replace(outliers=task.counts.outliers + left)
    sums, ended = search.sums(p), (arrived, starts)
    best = Fit(parameters, p, free, sums, search.segments, sigma, counts, ended, search.evaluations, model, {})
    why = "no frequency in the disturbance explains what is left"
    why = why if task.one_clock else "not looked for, since the logs have no clock in common"
    lost = [name for name, moves in zip(names, free, strict=True) if not moves]
    return refitted(best, p, free, {name: why if name == OMEGA else f"{why}; taken as 0" for name in lost})


def _doubt(task: Task, search: Search, cost: float, states: np.ndarray, free: np.ndarray) -> None:
    """Raise `InputError` where another reading of the commands explains a log that they do not explain as given."""
    measurements, names = int((search.segments.weight > 0).sum()), task.logs[0].sent.names
    substep = max(log.step for log in task.logs) / task.model.substeps

    def fitted(matrix: np.ndarray) -> float:
        logs = [log._replace(inputs=log.sent.inputs(log.sent.values @ matrix.T)) for log in task.logs]
        segments = with_inputs(search.segments, logs)
        parameters = wanted.parameters(task.model.scenario, task.model.names, logs, substep, task.memory)
        p = np.where(free | np.isin(task.model.names, OMEGA), wanted.values(parameters), 0.0)
        _, squares = Search(search.function, segments, parameters, states).run(p, free, TRIALS)
        return float(np.sqrt(squares / measurements))

    if wrong := misread(names, task.columns, float(np.sqrt(cost / measurements)), fitted):
        raise InputError(wrong)


def refitted(before: Fit, p: np.ndarray, free: np.ndarray, absent: Mapping[str, str]) -> Fit:
    """The fit over the same measurements from p on with other parameters free, channels weighed by what is left."""
    function, states = compiled(before.model), before.sums.states
    search = Search(function, before.segments, before.parameters, states, before.evaluations)
    p, _ = search.run(p, free, LAST)
    sums = search.sums(p)
    sigma = _spread(sums, before.segments.weight > 0, before.model.begun, int(free.sum()))
    final = search.over(weighed(before.segments, sigma), sums.states)
    after = before._replace(p=p, free=free, sums=final.sums(p), segments=final.segments, sigma=sigma)
    return after._replace(evaluations=final.evaluations, absent={**before.absent, **absent})


def _starts(parameters: Sequence[Parameter], wavy: np.ndarray, count: int, seed: int) -> list[np.ndarray]:
    """Nominal first, then Sobol points: slopes within three times, thresholds up to a half of the largest command."""
    from scipy.stats import qmc

    amplitudes = wavy & np.array([q.name != OMEGA for q in parameters])
    p = np.where(amplitudes, 0.0, wanted.values(parameters))
    shares = qmc.Sobol(len(p), rng=seed).random_base2(int(np.ceil(np.log2(max(count, 2)))))[: count - 1]

    def moved(q: Parameter, nominal: float, share: float) -> float:
        last = q.name.rpartition(".")[2]
        if last.startswith("threshold_") or last in ("time", "time_constant"):
            return q.low + 0.5 * (q.high - q.low) * share
        reach = 3.0 if last.startswith("slope_") else 1.5 if q.name.startswith("plant.") else 1.0
        return float(np.clip(nominal * reach ** (2 * share - 1), q.low, q.high)) if reach > 1 else nominal

    return [p, *(np.array(list(map(moved, parameters, p, share))) for share in shares)]


def _spread(sums: Sums, kept: np.ndarray, begun: int, free: int) -> np.ndarray:
    """Standard deviation of each channel (C,), unbiased: what states and free parameters took up is not counted."""
    share = 1 - (len(sums.states) * begun + free) / max(kept.sum(), 1)
    counted = np.maximum(kept.sum(axis=(0, 1)) * share, 1)
    return np.maximum(np.sqrt((sums.residual**2 * kept).sum(axis=(0, 1)) / counted), 1e-9)


def _judged(search: Search, p: np.ndarray, begun: int, outlier: float) -> Search:
    """The problem with what lies further off than `outlier` standard deviations left out, channels weighed anew."""
    sums, kept = search.sums(p), search.segments.weight > 0
    middle = np.array([_usual(np.abs(sums.residual[..., c][kept[..., c]])) for c in range(kept.shape[-1])])
    usual = np.maximum(outlier * np.maximum(1.4826 * middle, 1e-9), SMALL * _travel(search.segments))
    kept = kept & (np.abs(sums.residual) <= usual)
    sigma = _spread(sums, kept, begun, len(p))
    return search.over(search.segments._replace(weight=kept / sigma**2), sums.states)


def _travel(segments: Segments) -> np.ndarray:
    """How far each channel (C,) usually moves within a stretch."""
    kept, seen = segments.weight > 0, segments.seen
    most = np.max(seen, axis=1, where=kept, initial=-np.inf)
    least = np.min(seen, axis=1, where=kept, initial=np.inf)
    return np.median(np.maximum(most - least, 0.0), axis=0)


def _usual(size: np.ndarray) -> float:
    """The median of some sizes; where a channel stands exactly still it says nothing."""
    moving = size[size > 1e-3 * np.sqrt(np.mean(size**2))] if size.size else size
    return float(np.median(moving)) if moving.size else 1.0


def _sinusoid(search: Search, p: np.ndarray, wavy: np.ndarray, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """The frequency that explains most, and a fit with it; or none where it explains too little."""
    linear = np.array([w and name.endswith(SINUSOID) for w, name in zip(wavy, names, strict=True)])
    plain, cost = search.run(p, ~wavy, LAST)
    at, begins, rest = names.index(OMEGA), search.segments.t[:, 0], ~wavy
    span, early = search.segments.t.max() - begins.min(), begins < begins.min() + SCANNED
    some = search.over(Segments(*(x[early] for x in search.segments)), search.states[early])
    step, gains = np.pi / min(span, SCANNED), []  # what a frequency lowers the sum of squares by, it, and how large
    for omega in np.arange(step, FASTEST, step):
        q = plain.copy()
        q[at] = omega
        sums = some.sums(q)
        H, g = sums.matrix.sum(axis=0), sums.slope.sum(axis=0)
        solved = np.linalg.lstsq(H[np.ix_(rest, rest)], H[np.ix_(rest, linear)], rcond=1e-12)[0]
        A = H[np.ix_(linear, linear)] - H[np.ix_(linear, rest)] @ solved
        b = g[linear] - solved.T @ g[rest]
        push = -np.linalg.lstsq(A, b, rcond=1e-10)[0]
        gains.append((float(-b @ push), omega, push))
    _, omega, push = max(gains, key=lambda row: row[0])
    q = plain.copy()
    q[at], q[linear] = omega, push
    search.best = np.inf
    after, lower = search.run(q, np.ones(len(p), bool), TRIALS)
    return (plain, ~wavy) if cost - lower < WORTH else (after, np.ones(len(p), bool))
