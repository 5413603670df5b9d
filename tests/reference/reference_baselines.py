"""Independent plain-Python reference of the baselines, ablations and extensions of the law.

Written from the written laws alone, to check the package against; it must never import it. Numbers are plain floats:
for one vehicle they are several times faster than small arrays. A vehicle is (x, y, vx, vy, psi); a reference r is
(xd, yd, xd', yd', xd'', yd'', psi_d, psi_d'); a law has

    start(vehicle, r) -> the list of its state
    law(c, vehicle, r, turned, memory) -> (u_x, u_y, omega_bar), derivative of that list

where `turned(omega_bar)` is F_nom for the yaw rate that the actuator delivers of omega_bar at the same instant. A law
with memory also has `remember(vehicle, r)` and `jump(memory, c, vehicle, r, turned, h)`, at the start of each step.
States of two axes are listed axis by axis within each quantity: z1x z1y z2x z2y ...
"""

from dataclasses import dataclass, replace
from functools import cache, cached_property
from math import copysign, exp
from typing import Any, Literal

import numpy as np
import scipy.linalg

import reference


def wrap(angle):
    return float(reference.wrap(angle))


def clip(x):
    return max(-1.0, min(1.0, x))


def sign(x):
    return copysign(1.0, x) if x else 0.0


def sig(x, exponent):
    return sign(x) * abs(x) ** exponent


@dataclass(frozen=True)
class World:
    """Vehicle, actuators and disturbance. A deadzone is (m_r, m_l, s_r, s_l)."""

    position: tuple[float, float, float, float] = (0.6, 0.8, 0.5, 0.4)
    heading: tuple[float, float, float, float] = (0.91, 0.72, 0.66, 0.53)
    amplitude: float = 0.2
    start: tuple[float, float, float, float, float] = (-0.5, 0.5, 0.1, 0.1, 0.1)


IDEAL = (1.0, 1.0, 0.0, 0.0)  # no deadzone


def references(t):
    """Rows r for times of any shape."""
    position, velocity, acceleration = reference.path(t)
    psi_d, rate = reference.heading(t)
    return np.concatenate([position, velocity, acceleration, psi_d[..., None], rate[..., None]], axis=-1)


@dataclass(frozen=True)
class OSFC:
    kp: float = 5.0
    kd: float = 4.5
    wo: float = 20.0
    b0: float = 0.7
    kpsi: float = 2.0
    wow: float = 40.0
    b0w: float = 0.8

    def start(self, vehicle, r):
        x, y, vx, vy, psi = vehicle
        return [x, y, vx, vy, 0.0, 0.0, psi, 0.0]

    def axis(self, p, z1, z2, z3, xd, vd, ad):
        eo = p - z1
        ub = (ad - self.kp * (z1 - xd) - self.kd * (z2 - vd) - z3) / self.b0
        return ub, z2 + 3 * self.wo * eo, z3 + self.b0 * ub + 3 * self.wo**2 * eo, self.wo**3 * eo

    def __call__(self, c, vehicle, r, turned, memory=None):
        x, y, _, _, psi = vehicle
        z1x, z1y, z2x, z2y, z3x, z3y, q1, q2 = c
        ux, d1x, d2x, d3x = self.axis(x, z1x, z2x, z3x, r[0], r[2], r[4])
        uy, d1y, d2y, d3y = self.axis(y, z1y, z2y, z3y, r[1], r[3], r[5])
        wb = (r[7] - self.kpsi * wrap(q1 - r[6]) - q2) / self.b0w
        eo = wrap(psi - q1)
        dq1, dq2 = q2 + self.b0w * wb + 2 * self.wow * eo, self.wow**2 * eo
        return (ux, uy, wb), [d1x, d1y, d2x, d2y, d3x, d3y, dq1, dq2]


@dataclass(frozen=True)
class ASMC:
    c: float = 1.0
    k: float = 3.0
    gT: float = 0.5
    gD: float = 2.0
    sg: float = 0.02
    eps: float = 0.05
    kw: float = 2.0
    gTw: float = 0.5
    gDw: float = 3.0
    epsw: float = 0.05

    def start(self, vehicle, r):
        return [1.0, 1.0, 0.0, 0.0, 1.0, 0.0]

    def channel(self, s, w, th, D, k, gT, gD, eps):
        u = -k * s - (th * abs(w) + D) * clip(s / eps)
        return u, (gT * abs(s) * abs(w) if th < 5.0 else 0.0), gD * abs(s) - self.sg * D

    def __call__(self, c, vehicle, r, turned, memory=None):
        x, y, vx, vy, psi = vehicle
        thx, thy, Dx, Dy, thp, Dp = c
        wb, dthp, dDp = self.channel(wrap(psi - r[6]), -r[7], thp, Dp, self.kw, self.gTw, self.gDw, self.epsw)
        Fx, Fy = turned(wb)
        gains = self.k, self.gT, self.gD, self.eps
        ex, ey = vx - r[2], vy - r[3]
        ux, dthx, dDx = self.channel(ex + self.c * (x - r[0]), self.c * ex - r[4] + Fx, thx, Dx, *gains)
        uy, dthy, dDy = self.channel(ey + self.c * (y - r[1]), self.c * ey - r[5] + Fy, thy, Dy, *gains)
        return (ux, uy, wb), [dthx, dthy, dDx, dDy, dthp, dDp]


@dataclass(frozen=True)
class DFC:
    kp: float = 5.0
    kd: float = 4.5
    kpsi: float = 5.0

    def start(self, vehicle, r):
        return []

    def __call__(self, c, vehicle, r, turned, memory=None):
        x, y, vx, vy, psi = vehicle
        wb = r[7] - self.kpsi * wrap(psi - r[6])
        Fx, Fy = turned(wb)
        ux = r[4] - self.kd * (vx - r[2]) - self.kp * (x - r[0]) - Fx
        uy = r[5] - self.kd * (vy - r[3]) - self.kp * (y - r[1]) - Fy
        return (ux, uy, wb), []


@dataclass(frozen=True)
class FTSMC:
    a: float = 0.8
    b: float = 0.8
    g: float = 0.6
    k1: float = 1.0
    k2: float = 0.8
    rho: float = 0.6
    kw1: float = 2.0
    kw2: float = 1.0

    def start(self, vehicle, r):
        return []

    def surface(self, e, rate, acceleration, F):
        """The surface s and the command that would hold a nominal vehicle on it."""
        s = rate + self.a * e + self.b * sig(e, self.g)
        return s, acceleration - F - self.a * rate - self.b * self.g * max(abs(e), 0.01) ** (self.g - 1) * rate

    def axis(self, *of):
        s, u = self.surface(*of)
        return u - self.k1 * s - self.k2 * sig(s, self.rho)

    def __call__(self, c, vehicle, r, turned, memory=None):
        x, y, vx, vy, psi = vehicle
        e = wrap(psi - r[6])
        wb = r[7] - self.kw1 * e - self.kw2 * sig(e, self.rho)
        Fx, Fy = turned(wb)
        return (self.axis(x - r[0], vx - r[2], r[4], Fx), self.axis(y - r[1], vy - r[3], r[5], Fy), wb), []


@dataclass(frozen=True)
class SuperTwisting(FTSMC):
    """The same surface reached by u = equivalent - k1 |s|^.5 sat(s/eps) + v, v' = -k2 sat(s/eps).

    Levant's law with ASMC's boundary layer in the place of its sign.
    """

    eps: float = 0.05
    k1: float = 3.0
    k2: float = 2.0
    kw1: float = 2.0
    kw2: float = 2.0

    def start(self, vehicle, r):
        return [0.0, 0.0, 0.0]

    def __call__(self, c, vehicle, r, turned, memory=None):
        x, y, vx, vy, psi = vehicle
        e = wrap(psi - r[6])
        wb = r[7] - self.twist(self.kw1, e) + c[2]
        Fx, Fy = turned(wb)
        sx, ux = self.surface(x - r[0], vx - r[2], r[4], Fx)
        sy, uy = self.surface(y - r[1], vy - r[3], r[5], Fy)
        rates = [-self.k2 * clip(sx / self.eps), -self.k2 * clip(sy / self.eps), -self.kw2 * clip(e / self.eps)]
        return (ux - self.twist(self.k1, sx) + c[0], uy - self.twist(self.k1, sy) + c[1], wb), rates

    def twist(self, gain, s):
        return gain * abs(s) ** 0.5 * clip(s / self.eps)


def divided(slopes, feedback, rest):
    """U = feedback + rest / Pi(sign U) and Pi, for one slope or a pair (right, left) (13), R2.

    Of two consistent signs the right one is taken; where neither is consistent the command is 0.
    """
    right, left = (slopes, slopes) if isinstance(slopes, float) else slopes
    for Pi, positive in ((right, True), (left, False)):
        u = feedback + rest / Pi
        if (u > 0) == positive:
            return u, Pi
    return 0.0, left


@dataclass(frozen=True)
class Backstepping:
    """Section 2, with its network (one estimate a channel), with all weights, or without."""

    k1: float = 20.0
    k2: float = 20.0
    k3: float = 12.0
    Lam: float = 16.0
    Lam_psi: float = 9.0
    omega_n: float = 90.0
    zeta: float = 0.75
    Pi_hat: Any = 1.0
    Pi_psi_hat: Any = 1.0
    gamma1: float = 0.1
    gamma2: float = 0.1
    eta1: float = 0.001
    eta2: float = 0.001
    filtered: bool = True
    network: Literal["none", "one", "full"] = "none"
    nodes: int = 5

    def start(self, vehicle, r):
        x, y = vehicle[:2]
        phi = [r[2] - self.k1 * (x - r[0]), r[3] - self.k1 * (y - r[1])]
        adapted = {"none": [], "one": [0.1, 0.1], "full": [0.0] * (3 * self.nodes)}
        return phi + [0.0] * 9 + adapted[self.network]

    def activations(self, *inputs):
        centers = [-3.0 + 6.0 * i / (self.nodes - 1) for i in range(self.nodes)]
        return [exp(-sum((q - c) ** 2 for q in inputs) / 0.5) for c in centers]

    def __call__(self, c, vehicle, r, turned, memory=None):
        x, y, vx, vy, psi = vehicle
        fx, fy, gx, gy, xi1x, xi1y, xi2x, xi2y, bx, by, beta2, *adapted = c
        k1, k2, wn, Lam = self.k1, self.k2, self.omega_n, self.Lam
        z1x, z1y, ex, ey = x - r[0], y - r[1], vx - r[2], vy - r[3]
        ax, ay = -k1 * z1x + r[2] - Lam * bx, -k1 * z1y + r[3] - Lam * by
        if self.filtered:
            dfx, dfy = wn * gx, wn * gy
            dgx, dgy = -2 * self.zeta * wn * gx - wn * (fx - ax), -2 * self.zeta * wn * gy - wn * (fy - ay)
        else:
            dfx, dfy, dgx, dgy = -k1 * ex + r[4] - Lam * z1x, -k1 * ey + r[5] - Lam * z1y, 0.0, 0.0
        zb2x, zb2y, z3 = vx - fx - xi2x, vy - fy - xi2y, wrap(psi - r[6])
        S, Sp, n = self.activations(vx, vy), self.activations(psi), self.nodes
        if self.network == "one":
            share, share_psi = sum(s * s for s in S) / 2, sum(s * s for s in Sp) / 2  # b1 = b2 = 1
            tx, ty, tp = zb2x * adapted[0] * share, zb2y * adapted[0] * share, z3 * adapted[1] * share_psi
        elif self.network == "full":  # node by node: W_1x W_1y W_2x ...
            tx = sum(w * s for w, s in zip(adapted[0 : 2 * n : 2], S, strict=True))
            ty = sum(w * s for w, s in zip(adapted[1 : 2 * n : 2], S, strict=True))
            tp = sum(w * s for w, s in zip(adapted[2 * n :], Sp, strict=True))
        else:
            tx = ty = tp = 0.0
        Pi_x, Pi_y = self.Pi_hat if isinstance(self.Pi_hat, list) else (self.Pi_hat, self.Pi_hat)
        ux, Pi_x = divided(Pi_x, -k2 * zb2x, dfx - tx)
        uy, Pi_y = divided(Pi_y, -k2 * zb2y, dfy - ty)
        wb, Pi_p = divided(self.Pi_psi_hat, -self.k3 * z3, r[7] - self.Lam_psi * beta2 - tp)
        if self.network == "one":
            d_adapted = [
                self.gamma1 * (zb2x**2 / Pi_x + zb2y**2 / Pi_y) * share - self.eta1 * adapted[0],
                self.gamma2 * z3**2 * share_psi / Pi_p - self.eta2 * adapted[1],
            ]
        elif self.network == "full":
            zb2 = [zb2x, zb2y]
            d_adapted = [self.gamma1 * s * z for s in S for z in zb2] + [self.gamma2 * s * z3 for s in Sp]
            etas = [self.eta1] * (2 * n) + [self.eta2] * n
            d_adapted = [d - eta * w for d, eta, w in zip(d_adapted, etas, adapted, strict=True)]
        else:
            d_adapted = []
        compensation = [xi2x + fx - ax - k1 * xi1x, xi2y + fy - ay - k1 * xi1y, -k2 * xi2x, -k2 * xi2y]
        return (ux, uy, wb), [dfx, dfy, dgx, dgy, *compensation, z1x, z1y, z3, *d_adapted]


@dataclass(frozen=True)
class EventTriggered:
    """Section 6: hold u until |u_c - u| >= delta |u| + m."""

    inner: Any
    delta: float = 0.1
    m: float = 0.1

    def start(self, vehicle, r):
        return self.inner.start(vehicle, r)

    def remember(self, vehicle, r, turned):
        return self.inner(self.start(vehicle, r), vehicle, r, turned)[0]

    def jump(self, memory, c, vehicle, r, turned, h):
        asked = self.inner(c, vehicle, r, turned)[0]
        return tuple(
            new if abs(new - old) >= self.delta * abs(old) + self.m else old
            for new, old in zip(asked, memory, strict=True)
        )

    def __call__(self, c, vehicle, r, turned, memory):
        return memory, self.inner(c, vehicle, r, turned)[1]


def oustaloup(order, low, high, N):
    """Zeros, poles [1/s] and high-frequency gain of s^order as a product of 2 N + 1 factors (s - z) / (s - p)."""
    k = np.arange(-N, N + 1)
    zeros = -low * (high / low) ** ((k + N + (1 - order) / 2) / (2 * N + 1))
    poles = -low * (high / low) ** ((k + N + (1 + order) / 2) / (2 * N + 1))
    return zeros, poles, high**order


def partial_fractions(zeros, poles, gain):
    """Residues of gain prod (s - z) / (s - p), each from its own limit."""
    rest = [[p - q for q in poles if q != p] for p in poles]
    return np.array([gain * (p - zeros).prod() / np.prod(r) for p, r in zip(poles, rest, strict=True)])


@cache
def held_step(poles, h):
    """z(h) and the mean of z over h from z(0) and a held input, z' = p z + u: (modes, 2, 2)."""
    systems = [np.array([[p, 1.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]) for p in poles]
    grown = np.array([scipy.linalg.expm(h * system) for system in systems])
    return np.stack([grown[:, 0, :2], grown[:, 2, :2] / h], axis=1)


@dataclass(frozen=True)
class Fractional:
    """Section 6: beta' = s^(1 - lam) Z, the realisation's states exact for inputs held over a step."""

    inner: Backstepping
    lam: float = 0.8
    low: float = 1e-3
    high: float = 3e3
    N: int = 4

    def start(self, vehicle, r):
        return self.inner.start(vehicle, r)

    def remember(self, vehicle, r, turned):
        return np.zeros((2 * self.N + 1, 3)), np.zeros(3), np.zeros((2 * self.N + 1, 3))

    @cached_property
    def modes(self):
        zeros, poles, gain = oustaloup(1 - self.lam, self.low, self.high, self.N)
        return poles, partial_fractions(zeros, poles, gain), gain

    def jump(self, memory, c, vehicle, r, turned, h):
        z, last, _ = memory
        now = np.array([vehicle[0] - r[0], vehicle[1] - r[1], wrap(vehicle[4] - r[6])])
        step = held_step(tuple(self.modes[0]), h)
        z = step[:, 0, :1] * z + step[:, 0, 1:] * last
        return z, now, step[:, 1, :1] * z + step[:, 1, 1:] * now

    def __call__(self, c, vehicle, r, turned, memory):
        command, rates = self.inner(c, vehicle, r, turned)
        _, residues, gain = self.modes
        rates[8:11] = (gain * np.array(rates[8:11]) + residues @ memory[2]).tolist()
        return command, rates


def delivered(world, command):
    position = reference.deadzone(np.array(command[:2]), *world.position)
    return *position.tolist(), float(reference.deadzone(command[2], *world.heading))


def derivative(law, world, s, r, delta, memory=None):
    """Command, what is delivered, and the derivative of (vehicle, law), eq. (6) with F = w (-y', x') (R9)."""
    vehicle, c = s[:5], s[5:]
    _, _, vx, vy, _ = vehicle

    def turned(omega_bar):
        w = float(reference.deadzone(omega_bar, *world.heading))
        return -w * vy, w * vx

    command, rates = law(c, vehicle, r, turned, memory)
    ux, uy, w = delivered(world, command)
    return command, (ux, uy, w), [vx, vy, -w * vy + ux + delta, w * vx + uy + delta, w + delta, *rates]


def simulate(law, world=None, dt=1e-3, n_steps=12_000, method="rk4"):
    """Times (n + 1,), states (n + 1, 5 + size of the law) and commands (n + 1, 3)."""
    world = World() if world is None else world
    half = 0.5 * dt * np.arange(2 * n_steps + 1)
    rows = references(half).tolist()
    deltas = (world.amplitude * np.cos(0.5 * half)).tolist()
    s = [*world.start, *law.start(world.start, rows[0])]
    memory = None
    states, commands = [], []

    def turn(s):  # with what is held before the jump, the yaw rate an instant ago: none of the laws here asks
        raise AssertionError("a law with memory that needs the yaw rate")

    if hasattr(law, "remember"):
        memory = law.remember(world.start, rows[0], turn)
    for i in range(n_steps + 1):
        a, b, c = 2 * i, 2 * i + 1, 2 * i + 2
        if hasattr(law, "jump"):
            memory = law.jump(memory, s[5:], s[:5], rows[a], turn, dt)

        def f(s, node, memory=memory):
            return derivative(law, world, s, rows[node], deltas[node], memory)

        command, _, k1 = f(s, a)
        states.append(s)
        commands.append(command)
        if i == n_steps:
            break
        if method == "euler":
            s = [x + dt * p for x, p in zip(s, k1, strict=True)]
            continue
        k2 = f([x + dt / 2 * p for x, p in zip(s, k1, strict=True)], b)[2]
        k3 = f([x + dt / 2 * p for x, p in zip(s, k2, strict=True)], b)[2]
        k4 = f([x + dt * p for x, p in zip(s, k3, strict=True)], c)[2]
        s = [x + dt / 6 * (p + 2 * (q + u) + v) for x, p, q, u, v in zip(s, k1, k2, k3, k4, strict=True)]
    return half[::2], np.array(states), np.array(commands)


def errors(t, states):
    """e_x, e_y and the wrapped e_psi, shape (n, 3)."""
    r = references(t)
    return np.column_stack([states[:, :2] - r[:, :2], reference.wrap(states[:, 4] - r[:, 6])])


def last_outside(t, e, band=0.05):
    """The last time at which each error is outside the band."""
    return np.array([t[column].max(initial=0.0) for column in (np.abs(e) > band).T])


def with_gains(law, gains):
    """The law with gains replaced, by the dotted names of the package's `tunable`."""
    own = {name: value for name, value in gains.items() if "." not in name}
    inner = {name.partition(".")[2]: value for name, value in gains.items() if "." in name}
    return replace(law, **own, **({"inner": replace(law.inner, **inner)} if inner else {}))
