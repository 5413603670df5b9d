"""Limit cycles that describing functions predict: where 1 + L(jw) N(A) = 0."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import control
import numpy as np

from agvjax.linear import input_names, places

from ...config.settings import Config
from .describing import Way, amplitudes, delivered, describing, wanted, way
from .harmonics import balanced
from .loops import GROWTH, SLOWEST, frequencies
from .study import Found, vehicles

AT_REST = 1e-3  # rad/s, as slow as what fixes the mean of an input
ROUNDS = 2  # until the mean is taken over the period that was found


class Cycle(NamedTuple):
    """A limit cycle, at the input of an actuator; of a law with an inverse of the deadzone at what it wants instead."""

    amplitude: float  # in the unit of the input
    frequency: float  # rad/s
    mean: float  # in the unit of the input
    stable: bool  # it comes back after a push; else what is larger grows, and what is smaller fades
    harmonics: bool  # whether its harmonics are in it; else it is that of the describing function alone


Crossing = tuple[int, int, float, float, bool]  # segments in A and w, how far along each, whether it is stable there


class Curve(NamedTuple):
    """What a loop meets: 1 + L N = 0 at a limit cycle."""

    omega: np.ndarray  # (F,), rad/s
    response: np.ndarray  # (F,), L
    amplitude: np.ndarray  # (A,)
    N: np.ndarray  # (A,), as a multiple of the slope that L has; NaN where there is none
    mean: np.ndarray  # (A,)

    def nearest(self) -> tuple[float, int, int]:
        """The least of |1 + L N|, and where it is: frequency and amplitude."""
        apart = np.abs(1 + self.response[:, None] * self.N[None])
        w, a = np.unravel_index(np.nanargmin(apart), apart.shape)
        return float(apart[w, a]), int(w), int(a)


class Predicted(NamedTuple):
    """Limit cycles of V vehicles at K instants and m inputs."""

    names: list[str]  # m, of the inputs
    missing: dict[str, str]  # by input why it is not covered
    cycles: list[list[list[list[Cycle]]]]  # V of K of m; empty where nothing is predicted
    shown: tuple[int, int, int, Curve] | None  # vehicle, instant, input: the largest stable one, or the closest loop
    inverted: dict[str, bool]  # by input whether amplitudes are of what is wanted, before an inverse


def crossings(curve: Curve) -> list[Crossing]:
    """Where N(A) crosses -1 / L(jw).

    It is where N(A), A growing, leaves -1 / L(jw), w growing, on its right to its left: then what is larger fades.

    Source: Slotine and Li, Applied Nonlinear Control, 1991, sec. 5.4; Gelb and Vander Velde, 1968, sec. 3.2 (Loeb).
    """
    N = curve.N
    with np.errstate(invalid="ignore", divide="ignore"):
        Z = -1 / curve.response
        dZ, dN = np.diff(Z)[:, None], np.diff(N)[None]
        apart = N[None, :-1] - Z[:-1, None]
        across = np.imag(dN * np.conj(dZ))
        along_w = np.imag(np.conj(dN) * apart) / np.imag(np.conj(dN) * dZ)
        along_a = np.imag(np.conj(dZ) * apart) / -across
        near = np.abs(dZ) < np.nanmax(np.abs(N), initial=1.0)  # straight between far points means nothing
        hits = (0 <= along_w) & (along_w < 1) & (0 <= along_a) & (along_a < 1) & near
    return [
        (int(a), int(w), float(along_a[w, a]), float(along_w[w, a]), bool(across[w, a] > 0))
        for w, a in zip(*np.nonzero(hits), strict=True)
    ]


class Loop(NamedTuple):
    """One loop, and the course of its input through what is not linear."""

    space: control.StateSpace
    changing: float  # rad/s
    way: Way
    slope: float  # that L has of the way
    wanted: np.ndarray  # (N,), the input of the way
    delivered: np.ndarray  # (N,)
    now: int  # step of the instant
    first: int  # from which step on the course counts
    step: float  # s

    def balance(self, omega: float) -> tuple[float, float]:
        """Level and share of `describing`, from means over a period of that frequency about the instant."""
        length = min(len(self.wanted) - self.first, max(1, round(2 * np.pi / omega / self.step)))
        begin = int(np.clip(self.now - length // 2, self.first, len(self.wanted) - length))
        over = slice(begin, begin + length)
        rest = float(np.real(self.space(np.exp(AT_REST * float(self.space.dt))))) / self.slope
        share = rest / (1 + rest)
        return float((1 - share) * self.wanted[over].mean() + share * self.delivered[over].mean()), share

    def curve(self, omega: float) -> Curve:
        """L and N, by the means over a period of that frequency."""
        period = float(self.space.dt)
        level, share = self.balance(omega)
        A = amplitudes(self.way.whole, level).astype(self.wanted.dtype)
        N, mean = describing(self.way, level, share, A)
        w = frequencies(period, self.changing)
        return Curve(w, self.response(w), A, N / self.slope, mean)

    def refined(self, curve: Curve, found: Crossing, omega: float) -> Cycle:
        """The limit cycle at a crossing, with its harmonics where the balance of these is solved nearby."""
        a, w, along_a, along_w, stable = found
        A = float(curve.amplitude[a] * (curve.amplitude[a + 1] / curve.amplitude[a]) ** along_a)
        at = float(curve.omega[w] * (curve.omega[w + 1] / curve.omega[w]) ** along_w)
        mean = float(curve.mean[a] + along_a * (curve.mean[a + 1] - curve.mean[a]))
        stable = stable and self._alone(-1 / self.response(np.array([at]))[0], at)
        solved = None
        if stable:
            solved = balanced(
                self.way,
                lambda w: self.response(w) / self.slope,
                self.balance(omega),
                (mean, A, at),
                np.pi / float(self.space.dt),
            )
        if solved is not None:
            mean, A, at = solved
        return Cycle(A, at, mean, stable, solved is not None)

    def response(self, omega: np.ndarray) -> np.ndarray:
        """L (F,) at frequencies (F,) [rad/s], all at once: python-control takes them one by one."""
        A, B, C, D = (np.asarray(x) for x in (self.space.A, self.space.B, self.space.C, self.space.D))
        z = np.exp(1j * omega * float(self.space.dt))[:, None, None]
        return np.ravel(C @ np.linalg.solve(z * np.eye(len(A)) - A, np.broadcast_to(B, (len(z), *B.shape))) + D)

    def _alone(self, N: complex, omega: float) -> bool:
        """Whether nothing but the cycle itself stays in the loop closed by N."""
        A, B, C, D = (np.asarray(x) for x in (self.space.A, self.space.B, self.space.C, self.space.D))
        modes = np.linalg.eigvals(A - B @ C * N / (1 + N * D[0, 0]))
        period = float(self.space.dt)
        modes = np.delete(modes, np.argmin(np.abs(modes - np.exp(1j * omega * period))))
        upper = np.abs(modes[np.imag(modes) > -1e-9])  # what N says of a frequency below 0 is its conjugate
        return bool(np.max(np.log(np.maximum(upper, 1e-300)) / period, initial=-np.inf) <= GROWTH + self.changing)

    def cycles(self) -> tuple[list[Cycle], Curve]:
        """All that are predicted; each with the mean over its own period."""
        first = max(SLOWEST, self.changing)
        whole = self.curve(first)
        return [c for hit in crossings(whole) if (c := self._settled(whole, hit, first)) is not None], whole

    def _settled(self, curve: Curve, hit: Crossing, omega: float) -> Cycle | None:
        """A limit cycle, or None where it is not there with the mean over its own period."""
        if not hit[-1]:
            return self.refined(curve, hit, omega)
        for _ in range(ROUNDS):
            at = float(np.interp(hit[1] + hit[3], np.arange(len(curve.omega)), curve.omega))
            curve, omega = self.curve(at), at
            hits = [h for h in crossings(curve) if h[-1]]
            if not hits:
                return None
            hit = min(hits, key=lambda h: abs(h[1] - hit[1]) + abs(h[0] - hit[0]))
        return self.refined(curve, hit, omega)


def predict(config: Config, found: Found, tick: Callable[[str], object] = lambda text: None) -> Predicted:
    """Limit cycles of every loop that margins were found of."""
    tick("limit cycles")
    run = (config.controller, config.scenario, config.timing("tune"))
    batch, names = vehicles(config), input_names(*run)
    missing: dict[str, str] = {}
    cycles = [[[[] for _ in names] for _ in found.t] for _ in found.ok]
    best: tuple[float, float, tuple[int, int, int, Curve]] | None = None
    inverted = {}
    for i, (name, index, shape) in enumerate(places(*run)):
        for v in np.flatnonzero(found.ok):
            one = way(config.controller, batch[int(v)], name, index or 0, shape)
            if isinstance(one, str):
                missing[names[i]] = one
                break
            inverted[names[i]] = len(one.before) > 0
            for k, loop in _loops(found, one, int(v), i, config.criteria.late):
                cycles[v][k][i], curve = loop.cycles()
                largest = max((c.amplitude for c in cycles[v][k][i] if c.stable), default=0.0)
                if np.isfinite(curve.N).any():
                    rank = (-largest, curve.nearest()[0])
                    if best is None or rank < best[:2]:
                        best = (*rank, (int(v), k, i, curve))
    return Predicted(names, missing, cycles, None if best is None else best[2], inverted)


def _loops(found: Found, one: Way, v: int, i: int, late: float) -> list[tuple[int, Loop]]:
    """The loops of a vehicle that are cut at an input, by instant; those that are left out, without."""
    loops, step = found.loops, float(found.loops.step[v])
    asked = np.asarray(loops.asked[v][:, i])
    course, _ = wanted(one, asked)
    after, first = delivered(one, asked), round(late / step)
    inputs = np.asarray(loops.inputs[v][:, i])
    slopes = np.asarray(loops.slope[v][:, i]) * wanted(one, inputs)[1]
    return [
        (
            k,
            Loop(
                found.spaces(v, k)[i],
                float(loops.changing[v, k]),
                one,
                float(slopes[k]),
                course,
                after,
                round(float(found.t[k]) / step),
                first,
                step,
            ),
        )
        for k in range(len(found.t))
        if not found.left_out[v, k] and np.isfinite(slopes[k]) and slopes[k] != 0
    ]
