"""Checks a certificate of `agvjax certify`, alone: `python checker.py certificate.json`; needs only NumPy.

What is proved, for the closed loop in continuous time and for every scenario of the box: from `late` to `horizon`
each tracking error stays within the certificate's bound. The argument, in docs/certify.md at length:

1. A channel is x' = A x + b W + e a, with a constant slope m in A, the path's acceleration a, and all else in W: what
   the deadzone delivers less m times the linear part of the command, disturbance, coupling. The response to W is that
   of a linear system, so errors and commands are affine in the unknowns of the box and in W's rest.
2. In each cell of a time grid W is enclosed by an affine form of the unknowns plus a rest, given such a form for the
   commands. If the enclosure of W that follows from a tube for W lies strictly inside that tube, no solution leaves it.
3. The rest of W acts by the integral of the |impulse response|, enclosed cell by cell.

The tube is searched for here, in plain arithmetic; the last pass checks it. Rounding: powers of exp(A h) are computed
with integers, errors bounded; each operation on floats widens its result by `REL` of its operands, which is more than
its roundings (at most 32 of 2^-53).
"""

from __future__ import annotations

import functools
import hashlib
import itertools
import json
import math
import sys
from fractions import Fraction

import numpy as np

VERSION = 1
REL, SUM, CELLS = 1e-14, 1e-12, 9000  # of magnitudes: of a few operations; of sums over a grid, CELLS 2^-53 at most
ORDER, STIFF, BITS = 40, 6.0, 320  # of Taylor polynomials over a cell; the largest norm of A h they serve
ROUNDS, FIRST, LAST, GROW = 300, 80, 25, 2e-3  # of the search: rounds, of them rough, to settle; widening
FAR, TURNS = 1e7, 1e4  # the largest error; the largest angle of path and disturbance, as its series takes so many terms
POSITIVE = math.ulp(0.0)  # the least number above 0
MATCH = 1e-4  # of a stated bound with the one that follows: a number that matters and is another is seen
CHANNELS = ("x", "y", "heading")
JUMPS = "unwrapped, the law meets the jumps of the path's heading by 2 pi: only the dumbbell's has none"
SLOPES = ("slope_right", "slope_left", "threshold_right", "threshold_left")
LEAVES = (
    *(f"deadzone.position.{name}" for name in SLOPES),
    *(f"deadzone.heading.{name}" for name in SLOPES),
    "disturbance.amplitude",
    *(f"start.{name}[{i}]" for name in ("position", "velocity") for i in (0, 1)),
    "start.heading",
)
S = len(LEAVES)  # unknowns
GAINS = {
    "neuro_backstepping": ("k1", "k2", "k3", "Lam", "Lam_psi", "omega_n", "zeta", "Pi_hat", "Pi_psi_hat", "literal"),
    "dfc": ("kp", "kd", "kpsi"),
    "osfc": ("kp", "kd", "wo", "b0", "kpsi", "wow", "b0w"),
}
PROBLEM = ("law", "gains", "step", "cells", "late", "path", "disturbance", "wrapped")
ZERO = ("Lam", "Lam_psi", "literal", "late", "start")  # and the numbers of the disturbance; all others are above 0
PATHS = {"dumbbell": ("type", "amplitude", "omega"), "circle": ("type", "radius", "omega")}
NONSENSE = (OSError, ValueError, TypeError, KeyError, IndexError, AttributeError, ArithmeticError, RecursionError)


class Refused(Exception):
    """Why a certificate is refused, or a box is not proved."""


def _keys(given, wanted, where):
    """That there is all of what there must be, and nothing that nobody reads."""
    if not isinstance(given, dict) or set(given) != set(wanted):
        raise Refused(f"{where} must have exactly {', '.join(sorted(wanted))}")


def _real(values, where, low=-math.inf, count=None):
    """That these are finite numbers, none below `low`; a boolean or a string is no number."""
    if count not in (None, len(values)) or not all(type(x) in (int, float) and math.isfinite(x) for x in values):
        raise Refused(f"{where}: {values} must be numbers")
    if not all(x >= low for x in values):
        raise Refused(f"{where}: {values} must be {'above' if low > 0 else 'at least'} 0")


# forms: arrays (S + 3, N) for N cells, affine in unknowns in [-1, 1]: a centre, S of the box, one of the cell, a rest


def form(centre, rest: np.ndarray | float = 0.0):
    """A form without unknowns."""
    out = np.zeros((S + 3, np.size(centre)))
    out[0], out[-1] = centre, rest
    return out


def spread(a):
    """How far a form goes from its centre."""
    return np.abs(a[1:]).sum(axis=0) * (1 + REL)


def size(a):
    """The largest magnitude of a form."""
    return np.abs(a[0]) + spread(a)


def rounded(a, magnitude):
    """A form with the roundings of operations on numbers of a magnitude in its rest."""
    a[-1] = a[-1] * (1 + REL) + REL * magnitude + 1e-250
    return a


def plus(a, b, sign=1.0):
    """A + sign b."""
    out = a + sign * b
    out[-1] = a[-1] + b[-1]
    return rounded(out, size(a) + size(b))


def scaled(a, factor):
    """A form times numbers."""
    out = a * factor
    out[-1] = np.abs(out[-1])
    return rounded(out, size(a) * np.abs(factor))


def times(a, b):
    """The product: what is of second order goes to the rest."""
    out = a[0] * b + b[0] * a
    out[0] = a[0] * b[0]
    out[-1] = np.abs(a[0]) * b[-1] + np.abs(b[0]) * a[-1] + spread(a) * spread(b)
    return rounded(out, size(a) * size(b))


def positive(a):
    """max(a, 0): exact where the sign is known, else between a chord and its parallel through 0."""
    low, high = a[0] - spread(a), a[0] + spread(a)
    mixed = (low < 0) & (high > 0)
    chord = np.where(mixed, high / np.where(mixed, high - low, 1.0), low >= 0)
    out = scaled(a, chord)
    half = np.where(mixed, -low * chord / 2, 0.0)
    out[0], out[-1] = out[0] + half, out[-1] + half
    return rounded(out, np.where(mixed, size(a), 0.0))


def delivered(u, box, channel):
    """What the deadzone of a channel delivers, by eq. (11)."""
    right, left, far_right, far_left = (box.leaf(f"deadzone.{channel}.{name}", u.shape[1]) for name in SLOPES)
    positives = times(right, positive(plus(u, far_right, -1.0)))
    return plus(positives, times(left, positive(scaled(plus(u, far_left), -1.0))), -1.0)


class Box:
    """Intervals of the unknowns, by leaf: [low, high]."""

    def __init__(self, intervals):
        """From a mapping that holds every leaf."""
        _keys(intervals, LEAVES, "the box")
        for leaf, ends in intervals.items():
            _real(ends, leaf, POSITIVE if "slope" in leaf else 0.0 if "deadzone" in leaf else -math.inf, count=2)
            if not ends[0] <= ends[1]:
                raise Refused(f"{leaf}: {ends} is no interval")
        self.intervals = {leaf: tuple(map(float, intervals[leaf])) for leaf in LEAVES}

    def leaf(self, name, cells=1):
        """A leaf as a form."""
        low, high = self.intervals[name]
        out = form(np.full(cells, (low + high) / 2))
        out[1 + LEAVES.index(name)] = (high - low) / 2
        return rounded(out, abs(low) + abs(high))

    def beyond(self, channel, low, high, slope):
        """dz(u) - slope u for u in [low, high], as a form: its extremes lie at ends and kinks, and at corners of dz."""
        ends = [self.intervals[f"deadzone.{channel}.{name}"] for name in SLOPES]
        least, most = np.full(low.shape, np.inf), np.full(low.shape, -np.inf)
        for right, left, far_right, far_left in itertools.product(*ends):
            for u in (low, high, np.clip(far_right, low, high), np.clip(-far_left, low, high)):
                value = right * np.maximum(u - far_right, 0) + left * np.minimum(u + far_left, 0) - slope * u
                least, most = np.minimum(least, value), np.maximum(most, value)
        reach = np.maximum(np.abs(low), np.abs(high)) + max(ends[2] + ends[3])
        return rounded(form((least + most) / 2, (most - least) / 2), (max(ends[0] + ends[1]) + abs(slope)) * reach)

    def halves(self, leaf, at):
        """The two boxes that a split leaves."""
        _real([at], "a split")
        low, high = self.intervals[leaf]
        if not low < at < high:
            raise Refused(f"{leaf}: split at {at}, outside ({low}, {high})")
        return Box(self.intervals | {leaf: (low, at)}), Box(self.intervals | {leaf: (at, high)})


# linear systems, their powers exact to rounding


def balance(A):
    """Powers of two that scale the states so that rows and columns of A are alike; any will do."""
    k = np.zeros(len(A), int)
    for i in [*range(len(A))] * 20:
        B = np.abs(A * 2.0 ** (k[None, :] - k[:, None]))
        row, column = B[i].sum() - B[i, i], B[:, i].sum() - B[i, i]
        if row > 0 and column > 0:
            k[i] += round(math.log2(row / column) / 2)
    return np.array([Fraction(2) ** int(x) for x in k])


def powers(A, h, cells):
    """exp(A h)^i for i = 0 .. cells and the integral of exp(A s) over a cell, within 2^-53 of themselves + 2^-90.

    With integers, in units of 2^-BITS. With E off by at most `error` a row, what power i is off by, d[i], obeys
    d[i+1] = E d[i] + (error of E) power[i] + (flooring), so that |d[i]| <= sum of |E^j| times the largest of the rest.
    """
    A, h, unit = np.array(A, object), Fraction(h), 1 << BITS
    n, whole, floats = len(A), np.vectorize(int, otypes=[object]), np.vectorize(lambda x: x / unit, otypes=[float])
    norm = np.abs(A).sum(axis=1).max() * h
    if norm > STIFF:
        raise Refused(f"the step is too long: |A| h = {float(norm):.3g}, more than {STIFF:g}")
    step = whole(A * h * unit)
    E = term = whole(np.eye(n) * unit)
    integral = term * h.numerator // h.denominator
    for k in range(1, 120):  # 6^120 / 120! < 2^-340; each term is off by 2 n 6^k / k! units at most, all by 2^16 n
        term = (term @ step >> BITS) // k
        E, rate = E + term, h / (k + 1)
        integral = integral + term * rate.numerator // rate.denominator
    error, slip, sums, most, out, power = n << 24, 0, 0, 0, [], whole(np.eye(n) * unit)
    for _ in range(cells + 1):
        out.append(floats(power))
        rows = np.abs(power).sum(axis=1).max()
        sums += (rows + slip >> BITS) + 1
        most = max(most, (error * (rows + slip) >> BITS) + n + 1)
        slip = sums * most
        power = E @ power >> BITS
    if slip >> (BITS - 90):
        raise Refused("exp(A t) grows: rounding is not bounded")
    return np.array(out), floats(integral)


class Loop:
    """A channel's linear part: x' = A x + W b + a e + start, for a slope m; rows of outputs; all balanced by 2^k."""

    def __init__(self, A, b, e, start, rows, h, cells):
        """From arrays of fractions; `rows` and `start` (columns) by name."""
        two, self.h, self.cells, self.names = balance(np.array(A, float)), h, cells, list(rows)
        A = np.array(A, object) * two[None, :] / two[:, None]
        self.powers, self.integral = powers(A, h, cells)
        self.A, self.C = np.array(A, float), np.array([row * two for row in rows.values()], float)
        self.b, self.e = (np.array(column / two, float) for column in (b, e))
        self.start = {name: np.array(column / two, float) for name, column in start.items()}
        M, row = np.abs(self.A) * h, np.abs(self.C) @ np.abs(self.A)
        bends, sizes = [], []
        signed = self.C @ self.A
        for p in range(ORDER):
            bends.append(signed)
            sizes.append(row)
            signed, row = signed @ self.A * h / (p + 1), row @ M / (p + 1)
        self.bends, self.rough = np.array(bends), np.sum(sizes, axis=0)
        norm = M.sum(axis=1).max()
        self.tail = row.sum(axis=1) / (1 - norm / (ORDER + 1))
        self.past = np.abs(np.einsum("on,inm->iom", self.C, self.powers)).sum(axis=0) * (1 + SUM)
        self.stays = np.abs(self.powers).sum(axis=0) * (1 + SUM)
        self.kernel_W, self.kernel_a = self._kernel(self.b), self._kernel(self.e)

    def bend(self, rate, off):
        """Largest |second derivative| of the outputs (o, ...) over a cell in which x' = exp(A s) rate, rate +- off."""
        exact = np.abs(self.bends[0] @ rate)
        for row in self.bends[1:]:
            exact += np.abs(row @ rate)
        magnitude = np.abs(rate)
        rest = (self.rough * (1 + SUM)) @ (SUM * magnitude + off * (1 + REL))
        largest = np.max(magnitude + off, axis=0)
        return exact * (1 + REL) + rest + np.multiply.outer(self.tail * (1 + SUM), largest)

    def _kernel(self, b):
        """Integral of |c exp(A t) b| over each cell, (o, cells), too large rather than too small."""
        x = self.powers @ b
        off = 1e-14 * (np.abs(self.powers) @ np.abs(b)) + 1e-25 * np.abs(b).sum()
        g = np.abs(self.C @ x.T) + np.abs(self.C) @ off.T * (1 + REL) + 1e-14 * (np.abs(self.C) @ np.abs(x.T))
        rate, slip = self.A @ x.T, np.abs(self.A) @ (off.T + 1e-14 * np.abs(x.T))
        bend = self.bend(rate[:, :-1], slip[:, :-1] * (1 + REL))
        return self.h * (1 + SUM) * ((g[:, 1:] + g[:, :-1]) / 2 + self.h**2 / 12 * bend)

    def run(self, x, W, a, rough=False):
        """Forms of the outputs, by name, for x (S+1, n) at the start, W (S+1, cells) and a (cells,), without rests.

        Each step of the recursion is off by `slip` at most, which goes on as any state does. Within a cell an output
        is between its ends, but for what its second derivative bends. `rough` leaves all of that out.
        """
        E, n, cells = self.powers[1], len(self.A), self.cells
        drive = W.T[:, None, :] * (self.integral @ self.b)[:, None]
        drive[:, :, 0] += np.outer(a, self.integral @ self.e)
        states = np.empty((cells + 1, n, S + 1))
        states[0] = x.T
        for k in range(cells):
            states[k + 1] = E @ states[k] + drive[k]
        y = np.moveaxis(self.C @ states, 0, 2)  # (o, s, k)
        rest = np.abs(y[..., 1:] - y[..., :-1]) / 2
        if not rough:
            rest += self._between(states, W, a)
        out = {}
        for o, name in enumerate(self.names):
            out[name] = np.zeros((S + 3, cells))
            out[name][: S + 1] = (y[o, :, 1:] + y[o, :, :-1]) / 2
            out[name][-1] = rest[o].sum(axis=0) * (1 + SUM)
        return out

    def _between(self, states, W, a):
        """What outputs (o, s, k) differ by, at most, from a line between the ends of each cell."""
        n, flat = len(self.A), np.moveaxis(states[:-1], 1, 0).reshape(len(self.A), -1)
        push, thrust = np.outer(self.b, W.T), np.outer(np.abs(self.b), np.abs(W.T))
        push[:, :: S + 1] += np.outer(self.e, a)
        thrust[:, :: S + 1] += np.abs(np.outer(self.e, a))
        slip = 1e-14 * (np.abs(self.powers[1]) @ np.abs(flat) + np.abs(self.integral) @ thrust)
        slip = slip.reshape(n, self.cells, S + 1).max(axis=1) + 1e-25
        off = 1e-13 * (np.abs(self.A) @ np.abs(flat) + thrust)
        off += np.tile(np.abs(self.A) @ self.stays @ slip, self.cells)
        bend = self.h**2 / 8 * (1 + REL) * self.bend(self.A @ flat + push, off)
        magnitude = np.abs(self.C) @ np.maximum(np.abs(states[:-1]), np.abs(states[1:]))  # (k, o, s)
        bend = bend.reshape(len(self.C), self.cells, S + 1)
        total = bend + (self.past @ slip)[:, None] * (1 + SUM) + 1e-13 * np.moveaxis(magnitude, 1, 0)
        return np.moveaxis(total, 2, 1)

    def passed(self, kernel, rest):
        """What rests (cells,) of an input may add to the outputs at any time of each cell, by name."""
        latest = np.maximum(rest, np.append(rest[:1], rest[:-1]))
        return {n: np.convolve(kernel[o], latest)[: self.cells] * (1 + SUM) + 1e-200 for o, n in enumerate(self.names)}


# laws, paths


def loops(problem, slopes):
    """The position's and the heading's loop for constant slopes; what of a_d, F and psi_d' goes into the command."""
    build = {"neuro_backstepping": _backstepping, "dfc": _dfc, "osfc": _osfc}
    gains = {name: Fraction(value) for name, value in problem["gains"].items()}
    position, heading = map(Fraction, slopes)
    return build[problem["law"]](gains, position, heading, problem["step"], problem["cells"])


def states(n):
    """Rows that pick each of n states, and one that picks none."""
    return *np.vectorize(Fraction, otypes=[object])(np.eye(n, dtype=int)), np.array([Fraction(0)] * n)


def _backstepping(g, m, mh, h, cells):
    """By eqs. (21)-(25), (41), (57), (63), x = (Z1, e2, beta1, phi1 - v_d, phi2), e2 = chi2 - v_d; and (Z3, beta2)."""
    Z, e, beta, p, q, _ = states(5)
    u = -g["k2"] * (e - p) + g["omega_n"] / g["Pi_hat"] * q
    off = p + g["k1"] * Z + g["Lam"] * beta  # phi1 - alpha1
    stiff = g["omega_n"] ** 2 if g["literal"] else g["omega_n"]
    A = [e, m * u, Z, g["omega_n"] * q, -2 * g["zeta"] * g["omega_n"] * q - stiff * off]
    start, rows = {"Z": Z - g["k1"] * p, "e": e}, {"Z": Z, "u": u, "e": e, "net": e - p}
    axis = Loop(A, e, -p, start, rows, h, cells)
    Z, beta, none = states(2)
    u = -g["k3"] * Z - g["Lam_psi"] / g["Pi_psi_hat"] * beta
    heading = Loop([mh * u, Z], Z, none, {"Z": Z}, {"Z": Z, "u": u, "net": Z}, h, cells)
    return axis, heading, {"a": 0.0, "F": 0.0, "rate": 1 / g["Pi_psi_hat"]}


def _dfc(g, m, mh, h, cells):
    """DFC class: x = (Z1, e2); and (Z3,)."""
    Z, e, none = states(2)
    u = -g["kp"] * Z - g["kd"] * e
    axis = Loop([e, m * u], e, none, {"Z": Z, "e": e}, {"Z": Z, "u": u, "e": e}, h, cells)
    Z, none = states(1)
    u = -g["kpsi"] * Z
    return axis, Loop([mh * u], Z, none, {"Z": Z}, {"Z": Z, "u": u}, h, cells), {"a": 1.0, "F": -1.0, "rate": 1.0}


def _osfc(g, m, mh, h, cells):
    """OSFC class: x = (Z1, e2, z1 - x_d, z2 - v_d, z3); and (Z3, q1 - psi_d, q2)."""
    Z, e, z1, z2, z3, none = states(5)
    want, wo = -g["kp"] * z1 - g["kd"] * z2, g["wo"]
    u = (want - z3) / g["b0"]
    A = [e, m * u, z2 + 3 * wo * (Z - z1), want + 3 * wo**2 * (Z - z1), wo**3 * (Z - z1)]
    axis = Loop(A, e, none, {"Z": Z + z1, "e": e + z2}, {"Z": Z, "u": u, "e": e}, h, cells)
    Z, q1, q2, none = states(3)  # it wraps q1 - psi_d and psi - q1
    u = (-g["kpsi"] * q1 - q2) / g["b0w"]
    A = [mh * u, -g["kpsi"] * q1 + 2 * g["wow"] * (Z - q1), g["wow"] ** 2 * (Z - q1)]
    heading = Loop(A, Z, none, {"Z": Z + q1}, {"Z": Z, "u": u, "wrap q1": q1, "wrap off": Z - q1}, h, cells)
    return axis, heading, {"a": 1 / g["b0"], "F": 0.0, "rate": 1 / g["b0w"]}


def sine_cosine(x):
    """Sin and cos of a fraction >= 0, to 2^-60, by integers."""
    unit = term = 1 << 160
    x, sums, k = int(x * unit), [0, 0], 0
    while term:
        sums[k % 2] += term if k % 4 < 2 else -term
        k += 1
        term = (term * x >> 160) // k
    return sums[1] / unit, sums[0] / unit


class Motion:
    """The path over the cells of a grid: centre and rest of each signal, and the exact start."""

    def __init__(self, path, h, cells):
        """From the numbers of a path."""
        kind, h = path["type"], Fraction(h)
        number = {name: Fraction(value) for name, value in path.items() if name != "type"}
        middles = [h * k + h / 2 for k in range(cells)]
        w, size = float(number["omega"]), float(number["amplitude" if kind == "dumbbell" else "radius"])
        s, c = np.array([sine_cosine(number["omega"] * t) for t in middles]).T
        late, r = float(h) / 2, 1e-13
        if kind == "circle":
            waves = [(1, -s, -c), (1, c, -s)]
            self.rate, self.bearing = (np.full(cells, w), 0.0), math.pi / 2
            self.place, self.speed = (size, 0.0), (0.0, size * w)
        else:
            waves = [(2, 2 * (c * c - s * s), -8 * s * c), (1, c, -s)]
            self.rate = 2 * w * s / (1 + 4 * c * c), late * 3 * w * w + r * w  # |d2 psi_d / d phase^2| < 3
            self.bearing, self.place, self.speed = math.atan2(1.0, 2.0), (0.0, 0.0), (2 * size * w, size * w)
        self.velocity = [(size * w * v, size * w * (late * w * n**2 + r)) for n, v, _ in waves]
        self.acceleration = [(size * w * w * a, size * w * w * (late * w * n**3 + 8 * r)) for n, _, a in waves]


def energy(network, dimension):
    """An upper bound of S'S of eq. (20): nodes lie on the diagonal; the mean coordinate says how near they can be."""
    centers, width = network["centers"], network["width"]
    grid = np.linspace(min(centers) - 1e-9, max(centers) + 1e-9, 2001)
    total = np.zeros(2000)
    for c in centers:
        near = np.maximum(np.maximum(grid[:-1] - c, c - grid[1:]), 0.0)
        total += np.exp(-2 * dimension * near**2 / width)
    return float(total.max()) * (1 + 1e-9)


# tubes


class Channel:
    """One error's loop and what drives it; a tube for its W: centre and unknowns (S + 1, cells) and rest (cells,)."""

    def __init__(self, loop, box, name, start, drive):
        """From a loop, its start {row of `loop.start`: form} and the path's acceleration with its rest."""
        self.loop, self.box, self.name = loop, box, name
        self.x = sum(np.outer(value[: S + 1, 0], loop.start[row]) for row, value in start.items())
        self.a, rest = drive
        self.drift = loop.passed(loop.kernel_a, np.full(loop.cells, rest))
        self.ran = None, {}, False

    def outputs(self, W, rest, rough=False):
        """Forms of the outputs for a tube; what u does within a cell is an unknown of its own."""
        if self.ran[0] is not W or self.ran[2] != rough:
            self.ran = W, self.loop.run(self.x, W, self.a, rough), rough
        out, more = {name: y.copy() for name, y in self.ran[1].items()}, self.loop.passed(self.loop.kernel_W, rest)
        for name, y in out.items():
            y[-1] = (y[-1] + more[name] + self.drift[name]) * (1 + REL)
        out["u"][-2], out["u"][-1] = out["u"][-1], 0.0
        return out


def force(channel, slope, y, feedforward, network_gain):
    """What the deadzone delivers, and that less slope times the linear command, for n in [0, network_gain]."""
    u = plus(y["u"], feedforward)
    if network_gain is not None:
        half = form(network_gain / 2, network_gain / 2)
        u = plus(u, times(half, y["net"]), -1.0)
    gives = delivered(u, channel.box, channel.name)
    whole = channel.box.beyond(channel.name, u[0] - spread(u), u[0] + spread(u), slope)
    affine, plain = plus(gives, scaled(y["u"], slope), -1.0), plus(whole, scaled(plus(u, y["u"], -1.0), slope))
    return gives, (affine, plain)


def network_gain(network, most, squares, h, belief):
    """The network's gain, at most, per cell, by (45): varphi' <= gamma |Z|^2 S'S / (2 b^2 Pi), and S'S <= `most`."""
    share = most / (2 * network["b"] ** 2) * (1 + REL)
    varphi = network["start"] + np.cumsum(squares) * (h * network["gamma"] * share / belief)
    return varphi * share / belief * (1 + SUM)


def _rest(W):
    return (W[-1] + np.abs(W[-2])) * (1 + REL)


def _cost(W, lean):
    """By which the better form of W is chosen: its rest, and so much of what the unknowns make of it."""
    return _rest(W) + lean * np.abs(W[1 : S + 1]).sum(axis=0)


def _beyond(W, tube):
    """How far a form reaches from a tube's centre and unknowns."""
    return (_rest(W) + np.abs(W[: S + 1] - tube[0]).sum(axis=0)) * (1 + REL)


def settle(step, count, cells, lean):
    """Outputs for tubes that hold: what follows from each lies strictly within it.

    `step` takes tubes and gives the forms of what W is in them, and outputs.
    """
    tubes, rough, frozen = [(np.zeros((S + 1, cells)), np.zeros(cells)) for _ in range(count)], True, FIRST + LAST
    for i in range(ROUNDS):
        forms, out = step(tubes, rough)  # of each W two, either of which holds: cell by cell the better
        needs = [np.minimum(*(_beyond(W, tube) for W in pair)) for pair, tube in zip(forms, tubes, strict=True)]
        if all(np.all(need < tube[1]) for need, tube in zip(needs, tubes, strict=True)):
            if not rough:
                return out
            rough, frozen = False, i + LAST
        elif not max(float(need.max()) for need in needs) < FAR:
            raise Refused("the loop gain around the deadzone is too large for this box: the tube does not close")
        rough &= i < FIRST
        if i < frozen:  # the centre and the unknowns' share are looked for
            best = [np.where(_cost(one, lean) <= _cost(other, lean), one, other) for one, other in forms]
            tubes = [(W[: S + 1].copy(), _rest(W) * (1 + GROW) + 1e-6) for W in best]
        else:
            tubes = [(t[0], np.maximum(t[1], n * (1 + GROW) + 1e-6)) for t, n in zip(tubes, needs, strict=True)]
    raise Refused(f"the tube does not close in {ROUNDS} rounds")


def _sound(numbers):
    """That the numbers of a problem are those of its law, and of a kind for which the argument holds."""
    law, path, wave, gains = (numbers[name] for name in ("law", "path", "disturbance", "gains"))
    if law not in GAINS or path["type"] not in PATHS:
        raise Refused(f"law {law!r} or path {path['type']!r} is not known here")
    paper, cells = law == "neuro_backstepping", numbers["cells"]
    _keys(numbers, (*PROBLEM, "networks") if paper else PROBLEM, "the problem")
    _keys(path, PATHS[path["type"]], "the path")
    _keys(wave, ("omega", "phase"), "the disturbance")
    _keys(gains, GAINS[law], "the gains")
    _keys(numbers.get("networks", {}), ("position", "heading") if paper else (), "the networks")
    groups = [path, wave, gains, {"step": numbers["step"], "late": numbers["late"]}]
    for net in numbers.get("networks", {}).values():
        _keys(net, ("gamma", "b", "start", "centers", "width"), "a network")
        _real(net["centers"], "centers")
        groups.append(net)
    for group in groups:
        for name in set(group) - {"type", "centers"}:
            _real([group[name]], name, 0.0 if name in ZERO or group is wave else POSITIVE)
    if gains.get("literal", 0) not in (0, 1):
        raise Refused("literal must be 0 or 1")
    if numbers["wrapped"] is not True and not (paper and numbers["wrapped"] is False):
        raise Refused("only the paper's law may leave its error unwrapped")
    if not numbers["wrapped"] and path["type"] != "dumbbell":
        raise Refused(JUMPS)
    if type(cells) is not int or not 1 <= cells <= CELLS:
        raise Refused(f"a grid of {cells} cells: it must be 1 to {CELLS}, so a longer step is needed")
    if not max(path["omega"], wave["omega"]) * numbers["step"] * cells + wave["phase"] <= TURNS:
        raise Refused(f"the angle of the path or the disturbance passes {TURNS:g} rad")


class Problem:
    """The numbers of a certificate, and the loops for slopes that were used before."""

    def __init__(self, numbers):
        """From the certificate's `problem`."""
        _sound(numbers)
        self.numbers, self.h, self.cells = numbers, float(numbers["step"]), numbers["cells"]
        self.late = math.floor(Fraction(numbers["late"]) / Fraction(self.h))
        if not 0 <= self.late < self.cells:
            raise Refused("late must lie within the horizon")
        self.motion = Motion(numbers["path"], self.h, self.cells)
        h, omega, phase = (Fraction(x) for x in (self.h, *(numbers["disturbance"][n] for n in ("omega", "phase"))))
        waves = [sine_cosine(omega * (h * k + h / 2) + phase)[1] for k in range(self.cells)]
        self.wave = np.array(waves), float(omega) * self.h / 2 + 1e-13
        self.loops = functools.lru_cache(8)(lambda slopes: loops(numbers, slopes))
        self.networks, self.turns = numbers.get("networks", {}), {}
        self.energy = {name: energy(net, 2 if name == "position" else 1) for name, net in self.networks.items()}

    def bounds(self, box, slopes):
        """Bounds of the three errors from `late` on, in x, y, heading, over a box; Refused where none is proved."""
        _real(slopes, "slopes and lean", count=3)
        *slopes, lean = map(float, slopes)
        axis, turn, feed = self.loops(tuple(slopes))
        wave = times(box.leaf("disturbance.amplitude", self.cells), form(self.wave[0], self.wave[1]))
        own = [pair for leaf, pair in box.intervals.items() if "position" not in leaf and "velocity" not in leaf]
        key = (*own, slopes[1], lean)  # all that the heading depends on
        turns = self.turns  # which another thread may replace meanwhile
        if key not in turns:
            turns = self.turns = {key: self._heading(box, turn, feed, slopes[1], wave, lean)}  # the last one
        Z3, yaw = turns[key]
        Zx, Zy = self._position(box, axis, feed, slopes[0], wave, yaw, lean)
        return [float(size(Z)[self.late :].max()) for Z in (Zx, Zy, Z3)]

    def _heading(self, box, loop, feed, slope, wave, lean):
        """The heading's error and the delivered yaw rate."""
        start = plus(box.leaf("start.heading"), form(self.motion.bearing, 1e-14), -1.0)
        start[1 + LEAVES.index("start.heading")] += start[-1]
        channel = Channel(loop, box, "heading", {"Z": start}, (np.zeros(self.cells), 0.0))
        rate = form(self.motion.rate[0], self.motion.rate[1])
        base = plus(wave, rate, -1.0)

        def step(tubes, rough):
            W, rest = tubes[0]
            y = channel.outputs(W, rest, rough)
            gain = self._gain("heading", size(y["Z"]) ** 2)
            gives, pair = force(channel, slope, y, scaled(rate, float(feed["rate"])), gain)
            angles = [angle for name, angle in y.items() if name == "Z" or name.startswith("wrap")]
            return [[plus(one, base) for one in pair]], (y["Z"], gives, angles)

        Z3, yaw, angles = settle(step, 1, self.cells, lean)
        if self.numbers["wrapped"] and not all(size(angle).max() < 3.14 for angle in angles):
            raise Refused("the heading error, or an observer's, may pass pi, where it wraps")
        yaw[-1], yaw[-2] = yaw[-1] + np.abs(yaw[-2]), 0.0
        return Z3, yaw

    def _gain(self, name, squares):
        if name not in self.networks:
            return None
        belief = self.numbers["gains"]["Pi_hat" if name == "position" else "Pi_psi_hat"]
        return network_gain(self.networks[name], self.energy[name], squares, self.h, belief)

    def _position(self, box, loop, feed, slope, wave, yaw, lean):
        """The position's errors, both axes together: the yaw rate couples them."""
        speeds = [form(v, rest) for v, rest in self.motion.velocity]
        pushes = [form(a, rest) for a, rest in self.motion.acceleration]
        channels = []
        for i in (0, 1):
            start = {}
            for row, leaf, at in (("Z", "position", self.motion.place), ("e", "velocity", self.motion.speed)):
                start[row] = plus(box.leaf(f"start.{leaf}[{i}]"), form(at[i], 1e-14), -1.0)
                start[row][1 + LEAVES.index(f"start.{leaf}[{i}]")] += start[row][-1]
            channels.append(Channel(loop, box, "position", start, self.motion.acceleration[i]))

        def step(tubes, rough):
            ys = [channel.outputs(*tube, rough) for channel, tube in zip(channels, tubes, strict=True)]
            gain = None if "net" not in ys[0] else self._gain("position", sum(size(y["net"]) ** 2 for y in ys))
            moves = [plus(y["e"], speed) for y, speed in zip(ys, speeds, strict=True)]
            couplings = [scaled(times(yaw, moves[1]), -1.0), times(yaw, moves[0])]  # F = yaw rate (-y', x')
            forms = []
            for channel, y, F, push in zip(channels, ys, couplings, pushes, strict=True):
                forward = plus(scaled(push, float(feed["a"])), scaled(F, float(feed["F"])))
                _, W = force(channel, slope, y, forward, gain)
                base = plus(plus(F, wave), push, -1.0)
                forms.append([plus(one, base) for one in W])
            return forms, [y["Z"] for y in ys]

        return settle(step, 2, self.cells, lean)


# certificates


def digest(certificate):
    """SHA-256 of all but the digest, so that no number of a certificate moves unseen."""
    text = json.dumps({k: v for k, v in certificate.items() if k != "digest"}, sort_keys=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _once(pairs):
    """An object of a JSON file, in which no key is written twice."""
    if len(dict(pairs)) < len(pairs):
        raise Refused("a key is written twice: " + ", ".join(key for key, _ in pairs))
    return dict(pairs)


def _leaves(problem, box, node, claim):
    """Proves the claim over a box: on a leaf by a tube, else on both halves."""
    if "leaf" in node:
        _keys(node, ("leaf", "bounds"), "a leaf")
        _real(node["bounds"], "the bounds of a leaf", count=3)
        bounds = problem.bounds(box, node["leaf"])
        for name, bound, stated, most in zip(CHANNELS, bounds, node["bounds"], claim, strict=True):
            if not bound <= stated <= min(most, bound * (1 + MATCH)):
                raise Refused(f"{name}: {bound:.8g} follows, {stated:.8g} is stated, {most:.8g} is claimed")
        return 1
    _keys(node, ("split", "at", "below", "above"), "a split")
    below, above = box.halves(node["split"], node["at"])
    return _leaves(problem, below, node["below"], claim) + _leaves(problem, above, node["above"], claim)


def check(certificate):
    """Number of boxes that the claim was proved on; Refused where it does not follow."""
    _keys(certificate, ("version", "claim", "problem", "box", "tree", "digest"), "a certificate")
    version = certificate["version"]
    if type(version) is not int or version != VERSION or certificate["digest"] != digest(certificate):
        raise Refused("another version, or numbers that do not belong to the digest")
    _keys(certificate["claim"], CHANNELS, "the claim")
    claim = [certificate["claim"][name] for name in CHANNELS]
    _real(claim, "the claim", POSITIVE)
    return _leaves(Problem(certificate["problem"]), Box(certificate["box"]), certificate["tree"], claim)


def main(arguments):
    """0: the claim follows; 1: refused."""
    try:
        with open(arguments[0], encoding="utf-8") as file:
            certificate = json.load(file, object_pairs_hook=_once)
        boxes = check(certificate)
    except Refused as why:
        print(f"refused: {why}")
        return 1
    except NONSENSE as error:
        print(f"refused: this is no certificate ({type(error).__name__}: {error})")
        return 1
    claim, problem = certificate["claim"], certificate["problem"]
    print(
        f"proved, in {boxes} box{'es' * (boxes > 1)}: |x| <= {claim['x']} m, |y| <= {claim['y']} m,"
        f" |heading| <= {claim['heading']} rad from {problem['late']} s to"
        f" {problem['step'] * problem['cells']:.6g} s, in every scenario of this box:"
    )
    for leaf, (low, high) in certificate["box"].items():
        print(f"  {leaf} = {low}" if low == high else f"  {leaf} from {low} to {high}")
    print(f"of the law {problem['law']}, its error {'' if problem['wrapped'] else 'not '}wrapped, with")
    for part in ("gains", "networks", "path", "disturbance"):
        print(f"  {part}: " + json.dumps(problem.get(part, {}))[1:-1].replace('"', ""))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
