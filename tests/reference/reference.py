"""Independent NumPy/SciPy reference of the paper's closed loop on the decoupled plant.

Written from the paper and from a written list of its readings alone, to check the package against; it must never
import it.
Bare numbers are the paper's equations, R-numbers the readings. Every function of (t, s) takes one
state of shape (18,) or a trajectory of shape (n, 18) with t of shape (n,).
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
POSITION, VELOCITY, HEADING = slice(0, 2), slice(2, 4), 4
PHI1, PHI2, XI1, XI2, BETA1 = slice(5, 7), slice(7, 9), slice(9, 11), slice(11, 13), slice(13, 15)
VARPHI, BETA2, VARPHI_PSI = 15, 16, 17
SIZE = 18
THETA_RATE = 11.0 / 21.0  # R15: the paper's 22/7 for pi, (1/6)(22/7)
PATH_RATES = np.array([2.0 * THETA_RATE, THETA_RATE])


@dataclass(frozen=True)
class Parameters:
    """The paper's constants (section 4) and the selectable readings."""

    k1: float = 20.0
    k2: float = 20.0
    k3: float = 12.0
    Lam: float = 16.0
    Lam_psi: float = 9.0
    omega_n: float = 90.0
    zeta: float = 0.75
    gamma1: float = 0.1
    gamma2: float = 0.1
    eta1: float = 0.001
    eta2: float = 0.001
    b1: float = 1.0
    b2: float = 1.0
    Pi_hat: float | tuple[float, float] = 1.0
    Pi_psi_hat: float = 1.0
    centers: tuple[float, ...] = (-3.0, -1.5, 0.0, 1.5, 3.0)
    width: float = 0.5
    L: float = 0.5
    start_position: tuple[float, float] = (-0.5, 0.5)
    start_velocity: tuple[float, float] = (0.1, 0.1)
    start_heading: float = 0.1
    start_varphi: float = 0.1
    start_varphi_psi: float = 0.1
    slope_right: float = 0.6
    slope_left: float = 0.8
    threshold_right: float = 0.5
    threshold_left: float = 0.4
    heading_slope_right: float = 0.91
    heading_slope_left: float = 0.72
    heading_threshold_right: float = 0.66
    heading_threshold_left: float = 0.53
    disturbance_amplitude: tuple[float, float, float] = (0.2, 0.2, 0.2)
    disturbance_omega: float | tuple[float, float, float] = 0.5
    disturbance_phase: float | tuple[float, float, float] = 0.0
    filter: Literal["standard", "literal"] = "standard"  # R5
    heading: Literal["bearing", "bearing_raw", "bearing_swapped", "tangent"] = "bearing"  # R8
    coupling: Literal["turned", "literal"] = "turned"  # R9
    yaw_rate: Literal["delivered", "velocity"] = "delivered"  # R9
    wrapped: bool = True  # R17


def deadzone(u, slope_right: float, slope_left: float, threshold_right: float, threshold_left: float) -> Array:
    """Deadzone (11), all four numbers positive (R1)."""
    # The two branches are never active together, so (11) is their sum.
    return slope_right * np.maximum(u - threshold_right, 0.0) + slope_left * np.minimum(u + threshold_left, 0.0)


def delivered(commands: Array, p: Parameters) -> Array:
    """What the actuators deliver of commands (..., 3)."""
    position = deadzone(commands[..., :2], p.slope_right, p.slope_left, p.threshold_right, p.threshold_left)
    slopes, thresholds = (
        (p.heading_slope_right, p.heading_slope_left),
        (p.heading_threshold_right, p.heading_threshold_left),
    )
    return np.concatenate([position, deadzone(commands[..., 2:], *slopes, *thresholds)], axis=-1)


def wrap(angle: ArrayLike) -> Array:
    """Angle brought into [-pi, pi]."""
    return np.arctan2(np.sin(angle), np.cos(angle))


def path(t: ArrayLike) -> tuple[Array, Array, Array]:
    """Dumbbell position, velocity and acceleration, each of shape (..., 2)."""
    angle = np.asarray(t)[..., None] * PATH_RATES
    sine = np.sin(angle)
    return sine, PATH_RATES * np.cos(angle), -(PATH_RATES**2) * sine


def heading(t: ArrayLike, reading: str = "bearing") -> tuple[Array, Array]:
    """Desired heading psi_d and its rate (56), reading R8.

    With th = 11/21 t the path is (2 sin th cos th, sin th), so its bearing is atan2(sg, 2 sg cos th) with
    sg = sign(sin th); that form has the limit atan2(1, 2) at t = 0 where (56) itself is atan2(0, 0).
    """
    th = THETA_RATE * np.asarray(t)
    sine, cosine = np.sin(th), np.cos(th)
    if reading == "tangent":
        a, b = 2.0 * np.cos(2.0 * th), cosine  # velocity over THETA_RATE
        return np.arctan2(b, a), THETA_RATE * (4.0 * b * np.sin(2.0 * th) - a * sine) / (a * a + b * b)
    rate = 2.0 * THETA_RATE * sine / (1.0 + 4.0 * cosine**2)
    sign = 1.0 if reading == "bearing" else np.where(sine >= 0.0, 1.0, -1.0)
    if reading == "bearing_swapped":
        return np.arctan2(2.0 * sign * cosine, sign), -rate
    return np.arctan2(sign, 2.0 * sign * cosine), rate


def initial_state(p: Parameters) -> Array:
    """State at t = 0: filter at alpha1(0), compensator and integrals at zero."""
    s = np.zeros(SIZE)
    s[POSITION], s[VELOCITY], s[HEADING] = p.start_position, p.start_velocity, p.start_heading
    s[VARPHI], s[VARPHI_PSI] = p.start_varphi, p.start_varphi_psi
    s[PHI1] = -p.k1 * (s[POSITION] - path(0.0)[0]) + path(0.0)[1]
    return s


def activation(p: Parameters, *coordinates: ArrayLike) -> Array:
    """S'S of the network (20), each centre c_i standing for (c_i, ..., c_i) (R11)."""
    squared = sum((np.asarray(q)[..., None] - p.centers) ** 2 for q in coordinates)
    return np.exp(-2.0 * squared / p.width).sum(axis=-1)


def _closed_loop(t: ArrayLike, s: Array, p: Parameters) -> tuple[Array, Array]:
    """Commands (u_x, u_y, omega_bar) and the derivative of the packed state."""
    # Plain floats for one state: several times faster than slices of small arrays.
    rows = s.tolist() if s.ndim == 1 else s.T
    x, y, vx, vy, psi, fx, fy, gx, gy, xi1x, xi1y, xi2x, xi2y, bx, by, varphi, beta2, varphi_psi = rows
    (xd, yd), (vxd, vyd) = (q.T for q in path(t)[:2])
    psi_d, psi_d_rate = heading(t, p.heading)
    pi_x, pi_y = p.Pi_hat if np.ndim(p.Pi_hat) else (p.Pi_hat, p.Pi_hat)
    z1x, z1y = x - xd, y - yd  # (21)
    alpha_x = -p.k1 * z1x + vxd - p.Lam * bx  # after (32)
    alpha_y = -p.k1 * z1y + vyd - p.Lam * by
    zb2x, zb2y = vx - fx - xi2x, vy - fy - xi2y  # (21), (24)
    nodes = activation(p, vx, vy) / (2.0 * p.b1**2)
    u_x = -p.k2 * zb2x - zb2x * varphi * nodes / pi_x + p.omega_n * gx / pi_x  # (41)
    u_y = -p.k2 * zb2y - zb2y * varphi * nodes / pi_y + p.omega_n * gy / pi_y
    z3 = wrap(psi - psi_d) if p.wrapped else psi - psi_d  # R17
    nodes_psi = activation(p, psi) / (2.0 * p.b2**2)
    omega_bar = -p.k3 * z3 + (-z3 * varphi_psi * nodes_psi + psi_d_rate - p.Lam_psi * beta2) / p.Pi_psi_hat  # (63)
    command = np.array([u_x, u_y, omega_bar]).T
    d_x, d_y, omega = delivered(command, p).T
    cosines = np.cos(np.asarray(t)[..., None] * p.disturbance_omega + p.disturbance_phase)
    delta_x, delta_y, delta_psi = (cosines * p.disturbance_amplitude).T
    sine, cosine = np.sin(psi), np.cos(psi)
    # R9: only the yaw rate inside F is a reading; psi itself always turns with the delivered omega.
    w = omega if p.yaw_rate == "delivered" else (-vx * sine + vy * cosine) / p.L
    if p.coupling == "turned":
        f1, f2 = -w * vy, w * vx
    else:
        v = vx * cosine + vy * sine
        f1, f2 = -v * w * sine - p.L * w**2 * cosine, v * w * cosine - p.L * w**2 * sine
    damping, stiffness = 2.0 * p.zeta * p.omega_n, p.omega_n ** (1 if p.filter == "standard" else 2)  # R5
    derivative = [
        *(vx, vy),  # (6)
        *(f1 + d_x + delta_x, f2 + d_y + delta_y, omega + delta_psi),
        *(p.omega_n * gx, p.omega_n * gy),  # (22)
        *(-damping * gx - stiffness * (fx - alpha_x), -damping * gy - stiffness * (fy - alpha_y)),
        *(xi2x + fx - alpha_x - p.k1 * xi1x, xi2y + fy - alpha_y - p.k1 * xi1y),  # (23)
        *(-p.k2 * xi2x, -p.k2 * xi2y, z1x, z1y),  # (23), (25)
        p.gamma1 * (zb2x**2 / pi_x + zb2y**2 / pi_y) * nodes - p.eta1 * varphi,  # (45), R12
        z3,  # (57)
        p.gamma2 * z3**2 * nodes_psi / p.Pi_psi_hat - p.eta2 * varphi_psi,  # (67)
    ]
    return command, np.array(derivative).T


def commands(t: ArrayLike, s: Array, p: Parameters) -> Array:
    """Commands (u_x, u_y, omega_bar) before the deadzone, shape (..., 3)."""
    return _closed_loop(t, s, p)[0]


def right_hand_side(t: ArrayLike, s: Array, p: Parameters) -> Array:
    """Derivative of the packed state."""
    return _closed_loop(t, s, p)[1]


def solve(p: Parameters, horizon=12.0, times=None, rtol=1e-11, atol=1e-12, max_step=2e-3) -> tuple[Array, Array]:
    """Times (default: every 1e-3 s up to the horizon) and the states there, by DOP853.

    Deadzone kinks are continuous: small steps and error control deal with them. A heading reading can only jump at
    multiples of pi / (2 THETA_RATE): integration restarts there, 1e-13 s left out on each side of the jump.
    """
    times = np.linspace(0.0, horizon, round(horizon / 1e-3) + 1) if times is None else np.asarray(times, dtype=float)
    states = np.empty((times.size, SIZE))
    edges = [*np.arange(0.0, horizon, np.pi / (2.0 * THETA_RATE)), horizon]
    options = {"method": "DOP853", "rtol": rtol, "atol": atol, "max_step": max_step, "dense_output": True}
    s = initial_state(p)
    for start, stop in itertools.pairwise(edges):
        span = (start + 1e-13 * (start > 0.0), stop - 1e-13)
        result = solve_ivp(right_hand_side, span, s, args=(p,), **options)
        assert result.success, result.message
        inside = (times >= start) & (times <= stop)
        states[inside] = result.sol(np.clip(times[inside], *span)).T
        s = result.y[:, -1]
    return times, states


def rk4_step(rate: Callable[[float, Array], Array], t: float, s: Array, h: float) -> Array:
    """One classical Runge-Kutta step."""
    a = rate(t, s)
    b = rate(t + h / 2, s + h / 2 * a)
    c = rate(t + h / 2, s + h / 2 * b)
    return s + h / 6 * (a + 2 * b + 2 * c + rate(t + h, s + h * c))


def rk4(p: Parameters, dt: float, n_steps: int) -> tuple[Array, Array]:
    """Times and states of n_steps classical Runge-Kutta steps."""
    times = dt * np.arange(n_steps + 1)
    states = np.empty((n_steps + 1, SIZE))
    states[0] = s = initial_state(p)
    for i, t in enumerate(times[:-1]):
        states[i + 1] = s = rk4_step(lambda t, s: right_hand_side(t, s, p), t, s, dt)
    return times, states


def errors(t: ArrayLike, s: Array, p: Parameters) -> Array:
    """Errors (e_x, e_y, e_psi) of shape (..., 3), e_psi wrapped whatever the reading R17."""
    e_psi = wrap(s[..., HEADING] - heading(t, p.heading)[0])
    return np.concatenate([s[..., POSITION] - path(t)[0], e_psi[..., None]], axis=-1)


def trapezoid_rmse(t: Array, e: Array) -> Array:
    """Root of the time mean of e^2 by the trapezoid rule, along the first axis."""
    return np.sqrt(np.trapezoid(e**2, t, axis=0) / (t[-1] - t[0]))
