"""Ultimate bounds on the tracking errors that can be proved, in the place of the paper's (reading R14).

Plant, law and notation as in `proof.py`: n = varphi S'S / (2 b^2) >= 0 is the network's gain, dz the deadzone,
Pi its true slope, delta the disturbance; Z3 neither wraps nor jumps (R8, R17). `report` gives the printed bounds (50),
(72) and the corrected ones. These are ultimate: they bound the limit superior, not the transient. Their proof has three
parts.

1. **Peak gain.** A stable linear time-invariant system with impulse response h, driven by any w in [c - d, c + d], has
   its output after the transient in H(0) c +- d * integral |h|, and no smaller interval holds for every such w.
2. **Cascade** (position, each axis). xi2 = 0, so Z2' = -Pi(t) (k2 + n/Pi_hat) Z2 + D2, with D2 = F + d(U) + delta +
   (Pi/Pi_hat - 1) phi1'. As n >= 0, limsup |Z2| <= sup|D2| / (Pi_min k2), whatever the switching of Pi. Then Z1' =
   -k1 Z1 - Lam beta1 + (Z2 + phi1 - alpha1), beta1' = Z1, so limsup |Z1| <= `peak_gain`(k1, Lam) * (limsup |Z2| + eta).
   Conditional: sup|D2| and eta = sup|phi1 - alpha1| are measured along the run, as the paper's own eta and eps_bar.
3. **One slope** (both channels). With n = n_mid +- n_half the command is u = v - (n - n_mid)/Pi_hat Z, v being linear
   and Z = Z2 or Z3. For any constant m > 0 the channel is chi2' or psi' = m v + w, w = dz(u) - m v + delta + F (F = 0
   for the heading): linear, time-invariant, and driven by the reference, its response to which is computed from exact
   tracking at t = 0 on, and by w in some interval: part 1. Nothing depends on how Pi switches.
   *Linear*: the interval of w is measured along the run, m within the true slopes; conditional on it.
   *A priori*: w -> v, Z, chi2 -> w is closed; dz is piecewise linear and does not fall, so that the interval of w is
   found at its ends and kinks. Intervals of w map monotonically to intervals, I -> f(I), with growth below 1 for large
   I where the small gain holds; else the bound is infinite. So signals are bounded, their limit set I* satisfies
   I* <= f(I*), and f(f(...f(I0))) contains it for every large I0: each iterate is a bound. Of the run nothing is used
   but the range of n, which the law itself knows. Reference and disturbance are in their ranges over the run's time, F
   in the product of the ultimate intervals of the delivered yaw rate, from the heading's proof, and of chi2.
   In each case the best of several m counts.

A common quadratic Lyapunov function of (Z3, beta2) with cross term, the other way to an a-priori bound, gives more
(`tests/tuning/studies/paper/test_lyapunov.py`) and is left out.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import agvjax
from agvjax import Real
from agvjax.controllers.backstepping import KnownSlopes
from agvjax.controllers.filters import Filtered
from agvjax.leaves import cast
from agvjax.plants import DeliveredYawRate, TurnedVelocity

from .proof import Constants, Functions, Signals, constants, papers_deadzones, signals, slope_range

Numbers = np.ndarray | Array
Pair = tuple[Numbers, Numbers]  # both ends of an interval

LATE = 4.0  # s, past the transient of every law, as in `Criteria`
MEMORY = 1.0  # s, how much earlier what drives the errors is measured: the errors at `LATE` remember it
VACUOUS = 10.0  # a bound that many times what is observed says nothing
SLOPES = 9  # constant slopes m tried between the smallest and the largest true one


def vacuity(bound: np.ndarray, observed: np.ndarray) -> np.ndarray:
    """How many times what is observed a bound is; more than `VACUOUS` is called vacuous."""
    return bound / observed


def peak_gain(k: float, Lam: float) -> float:
    """Integral of |h| [s] for s / (s^2 + k s + Lam), k > 0, Lam >= 0: the largest |output| per unit of |input|.

    The step response F = exp(-s t) sin(w t) / w, s = k/2, w^2 = Lam - s^2, has its first extreme F* = exp(-s t*) /
    sqrt(Lam) at t* = atan2(w, s) / w, for real poles (w imaginary) log((s + |w|) / sqrt(Lam)) / |w|. Each further one
    is -q times the one before, q = exp(-pi s / w), for real poles 0. The integral is F's total variation, 2 F*/(1 - q).
    """
    s, square = k / 2, Lam - k**2 / 4
    w = float(np.sqrt(abs(square)))
    if Lam == 0:
        return 1 / k
    if w < 1e-6 * s:
        time, q = 1 / s, 0.0  # a double pole, to the last digits
    elif square > 0:
        time, q = np.arctan2(w, s) / w, np.exp(-np.pi * s / w)
    else:
        time, q = np.log((s + w) / np.sqrt(Lam)) / w, 0.0
    return float(2 * np.exp(-s * time) / np.sqrt(Lam) / (1 - q))


class _Linear(NamedTuple):
    """x' = A x + b w + R v, y = C x + D v for M slopes and a axes: each array with leading (M, a)."""

    A: np.ndarray
    b: np.ndarray
    R: np.ndarray
    C: np.ndarray
    D: np.ndarray


def _linear(rates: list[np.ndarray], outputs: list[Numbers]) -> _Linear:
    """A system from its rows over (x, w, v), each of shape (..., n + 1 + p)."""
    n, shape = len(rates), np.broadcast_shapes(*(row.shape for row in rates))
    x, y = (np.stack([np.broadcast_to(row, shape) for row in rows], axis=-2) for rows in (rates, outputs))
    return _Linear(x[..., :n], x[..., n : n + 1], x[..., n + 1 :], y[..., :n], y[..., n + 1 :])


def _position(c: Any, m: np.ndarray, n: np.ndarray) -> _Linear:
    """The position: x = (Z1, beta1, phi1, phi2, chi2), v = (v_d, v_d'), y = (Z1, u, Z2, chi2)."""
    Z1, beta1, phi1, phi2, chi2, w, velocity, acceleration = np.eye(8)  # each signal as a row: the law makes the matrix
    alpha1 = c.virtual_control(Z1, beta1, velocity)
    alpha1_rate = c.virtual_control(chi2 - velocity, Z1, acceleration)
    driven: Any = (phi1, phi2, alpha1, alpha1_rate, c.omega_n, c.zeta)
    phi1_rate, phi2_rate = map(np.asarray, c.filter(Filtered(*driven)))
    inverse = 1 / np.broadcast_to(c.Pi_hat, 2)[:, None]
    u = -(c.k2 + n * inverse) * (chi2 - phi1) + phi1_rate * inverse  # (41)
    rates = [chi2 - velocity, Z1, phi1_rate, phi2_rate, m[:, None, None] * u + w]
    return _linear(rates, [Z1, u, chi2 - phi1, chi2])


def _heading(c: Any, m: np.ndarray, n: np.ndarray) -> _Linear:
    """The heading: x = (Z3, beta2), v = psi_d', y = (Z3, u, Z3)."""
    Z3, beta2, w, rate = np.eye(4)
    u = -(c.k3 + n / c.Pi_psi_hat) * Z3 + (rate - c.Lam_psi * beta2) / c.Pi_psi_hat  # (63)
    return _linear([m[:, None, None] * u + w - rate, Z3], [Z3, u, Z3])


def _exponential(A: np.ndarray) -> np.ndarray:
    """exp(A) for A of shape (..., n, n), by scaling, a Taylor polynomial and squaring."""
    halvings = max(0, int(np.log2(np.abs(A).sum(axis=-1).max() + 1.0)) + 4)
    A, term, total = A / 2.0**halvings, np.eye(A.shape[-1]), np.eye(A.shape[-1])
    for i in range(1, 13):  # the norm is below 1/8: nothing is left to add
        term = term @ A / i
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total


def peak_gains(A: np.ndarray, b: np.ndarray, C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Integral of |h| and of h = C exp(A t) b, for A (..., n, n), b (..., n, 1), C (..., q, n): both (..., q).

    The step response F is known to rounding on a grid that is finer the earlier and the less damped the poles. Between
    two points the integral of |h| is the |change| of F where h keeps its sign; where not, a step times the larger |h|
    is added, so that the result is too large, by some 1e-4 of itself, rather than too small. Infinite where A is
    unstable. Modes that stand still, as an integral that nothing reads does, must not show in C.
    """
    poles = np.linalg.eigvals(A)
    largest = np.abs(poles).max()
    moving = np.abs(poles) > 1e-10 * largest
    stable = np.all((poles.real < 0) | ~moving, axis=-1)
    if not stable.all():
        calm = np.where(stable[..., None, None], A, -np.eye(A.shape[-1]))
        total, end = peak_gains(calm, b, C)
        return np.where(stable[..., None], total, np.inf), end
    doublings = 6 + int(np.ceil(np.log2(1 + np.abs(poles.imag / np.where(moving, poles.real, np.inf)).max())))
    n, step, reached, end = A.shape[-1], 1e-2 / largest, 0.0, 40 / np.abs(poles.real[moving]).min()
    K = np.zeros((*A.shape[:-2], n + 1, n + 1))
    K[..., :n, :n], K[..., :n, n:] = A, b
    x, E = np.broadcast_to(np.eye(n + 1)[:, n:], (*A.shape[:-2], n + 1, 1)), _exponential(K * step)
    total: Any = 0.0
    F: Any = 0.0
    while reached < end:  # an octave: so many steps, each next one twice as long
        points, power = x, E
        for _ in range(doublings):
            points, power = np.concatenate([points, power @ points], axis=-1), power @ power
        x, E, reached = power @ x, E @ E, reached + step * 2**doublings
        points = np.concatenate([points, x], axis=-1)
        F, h = C @ points[..., :n, :], np.abs(rate := C @ (K @ points)[..., :n, :])
        crossed = step * (rate[..., 1:] * rate[..., :-1] < 0) * np.maximum(h[..., 1:], h[..., :-1])
        total, step = total + np.sum(np.abs(np.diff(F)) + crossed, axis=-1), 2 * step
    return total, F[..., -1]


def _response(system: _Linear, v: Numbers, x: np.ndarray, dt: Real) -> np.ndarray:
    """Outputs (M, a, q, N+1) for w = 0 and v (a, p, N+1), linear between samples `dt` apart, from state x (a, n)."""
    n, p = system.R.shape[-2:]
    K = np.zeros((*system.A.shape[:-2], n + 2 * p, n + 2 * p))
    K[..., :n, :n], K[..., :n, n : n + p] = system.A * dt, system.R * dt
    K[..., n : n + p, n + p :] = np.eye(p)
    E = _exponential(K)[..., :n, :]
    pushed = E[..., n:] @ np.concatenate([v[..., :-1], np.diff(v)], axis=-2)
    states = np.concatenate([np.broadcast_to(x[..., None], (*pushed.shape[:-1], 1)), pushed], axis=-1)
    power, shift = E[..., :n], 1
    while shift < states.shape[-1]:  # sums of E^k times what was pushed k steps before, of twice as many each time
        states[..., shift:] += power @ states[..., :-shift]
        power, shift = power @ power, 2 * shift
    return system.C @ states + system.D @ v


class _Known(NamedTuple):
    """What part 3 needs of a channel besides the interval of w, for M slopes, a axes and q outputs."""

    m: np.ndarray  # (M, 1), the slope
    nu: np.ndarray  # (M, a), half the range of n, over Pi_hat
    low: Numbers  # (M, a, q), of the response to the reference
    high: Numbers
    gain: np.ndarray  # (M, a, q), peak gain from w
    dc: np.ndarray  # (M, a, q), gain at frequency 0


def _outputs(known: _Known, w: Pair) -> Pair:
    """Part 1: the ultimate intervals of the outputs (M, a, q) for w (M, a) in an interval."""
    centre, half = known.dc * ((w[0] + w[1]) / 2)[..., None], known.gain * ((w[1] - w[0]) / 2)[..., None]
    return known.low + centre - half, known.high + centre + half


def _force(
    deadzone: agvjax.Deadzone, yaw_rate: tuple[float, ...] | None, delta: Numbers, known: _Known, y: Pair
) -> Pair:
    """Part 3: the interval of w (M, a) for outputs in the intervals y; the deadzone never falls, so corners will do."""
    low, high = y[0][..., 1], y[1][..., 1]
    network = known.nu * jnp.maximum(jnp.abs(y[0][..., 2]), jnp.abs(y[1][..., 2]))

    def beyond(shift: Numbers) -> Array:  # dz(v + shift) - m v at the ends of v and at the kinks between
        kinks = deadzone.threshold_right - shift, -deadzone.threshold_left - shift
        v = jnp.stack([low, high, *(jnp.clip(kink, low, high) for kink in kinks)])
        return deadzone(v + shift[None]) - known.m[None] * v

    low, high = jnp.min(beyond(-network), axis=0) + delta[0], jnp.max(beyond(network), axis=0) + delta[1]
    if yaw_rate is None:
        return low, high
    F = jnp.stack([rate * speed[:, ::-1, 3] for rate in yaw_rate for speed in y])  # yaw rate (-y_n', x_n')
    F = F * jnp.asarray([-1.0, 1.0], F.dtype)[None, None, :]
    return low + jnp.min(F, axis=0), high + jnp.max(F, axis=0)


@jax.jit
def _closed(deadzone: agvjax.Deadzone, yaw_rate: tuple[float, ...] | None, delta: Numbers, known: _Known) -> Pair:
    """Part 3, a priori: intervals of the outputs (M, a, q), infinite where the small gain does not hold."""
    deadzone, far = cast(deadzone, known.low.dtype), jnp.full(known.nu.shape, 1e6, known.low.dtype)

    def f(_: int | Array, w: Pair) -> Pair:
        return _force(deadzone, yaw_rate, delta, known, _outputs(known, w))

    first = f(0, (-far, far))
    holds = jnp.all((first[0] > -0.999 * far) & (first[1] < 0.999 * far), axis=1)[:, None, None]
    low, high = _outputs(known, jax.lax.fori_loop(0, 1000, f, (-far, far)))
    return jnp.where(holds, low, -jnp.inf), jnp.where(holds, high, jnp.inf)


class Report(NamedTuple):
    """Bounds and what they bound: arrays (2,) hold the norm |Z1| [m] and |Z3| [rad]."""

    observed: np.ndarray  # largest after `late`
    printed: np.ndarray  # eqs. (50), (72), with suprema after `late`
    repaired: np.ndarray  # the same with what (48) and (70) drop
    corrected: np.ndarray  # the smallest of those below, for the position of each axis
    position: dict[str, float]  # "a priori", "linear", "cascade": parts 3, 3 and 2 of the proof
    heading: dict[str, float]  # "a priori", "linear"
    constants: Constants  # with suprema after `late`

    @property
    def won(self) -> tuple[str, str]:
        """By which proof the corrected bounds are the smallest."""
        return min(self.position, key=self.position.__getitem__), min(self.heading, key=self.heading.__getitem__)


class Proof(NamedTuple):
    """What the paper's proof says of one run."""

    constants: Constants
    functions: Functions
    report: Report
    margins: dict[str, float]
    sensitivity: float  # largest, of the commands to the compensation
    xi2: float  # largest


def report(
    controller: agvjax.NeuroBackstepping, scenario: agvjax.Scenario, trajectory: agvjax.Trajectory, late: float = LATE
) -> Report:
    """Printed and corrected bounds of one run beside what it shows; on the host, one run at a time.

    What is observed is observed after `late` [s], and what the conditional bounds rest on is measured from `MEMORY`
    before. The position has no a-priori bound where F is not the delivered yaw rate times the velocity turned (R9).

    Raises:
        ValueError: an assumed slope is not constant.
    """
    if any(isinstance(belief, KnownSlopes) for belief in (controller.Pi_hat, controller.Pi_psi_hat)):
        raise ValueError("the corrected bounds need numbers for Pi_hat and Pi_psi_hat, not KnownSlopes")
    controller, scenario = cast((controller, scenario), trajectory.t.dtype)
    s: Signals = jax.tree.map(lambda x: np.asarray(x, float), signals(controller, scenario, trajectory))
    c = jax.tree.map(lambda x: np.asarray(x, float), controller)
    found, after, before = constants(controller, scenario, trajectory, late), s.t >= late, s.t >= late - MEMORY

    turn, yaw_rate = _one_slope(c, papers_deadzones(scenario)["heading"], s, before, True)
    plant, deadzones = scenario.plant, papers_deadzones(scenario)
    turned = isinstance(plant, agvjax.Decoupled) and isinstance(plant.coupling, TurnedVelocity)
    close = isinstance(plant, agvjax.Decoupled) and turned and isinstance(plant.yaw_rate, DeliveredYawRate)
    axes, _ = _one_slope(c, deadzones["position"], s, before, close, yaw_rate)
    axes["cascade"] = _cascade(c, float(slope_range(deadzones["position"])[0]), s, before)
    heading = {name: float(bound[0]) for name, bound in turn.items()}
    return Report(
        observed=np.array([np.linalg.norm(s.Z1[after], axis=1).max(), np.abs(s.Z3[after]).max()]),
        printed=np.array([found.position, found.heading]),
        repaired=np.asarray(found.repaired),
        corrected=np.array([np.hypot(*np.min(list(axes.values()), axis=0)), min(heading.values())]),
        position={name: float(np.hypot(*bound)) for name, bound in axes.items()},
        heading=heading,
        constants=found,
    )


def _interval(x: Numbers, axis: int) -> Pair:
    return x.min(axis=axis), x.max(axis=axis)


def _cascade(c: Any, Pi_min: float, s: Signals, after: Numbers) -> np.ndarray:
    """Part 2: a bound on |Z1| for each axis."""
    D2 = s.rate[:, :2] - s.phi1_rate + s.slope[:, :2] * (c.k2 + s.gain[:, :1] / c.Pi_hat) * s.Zb2
    D2, eta = (np.abs(x[after]).max(axis=0) for x in (D2, s.filter_error))
    return peak_gain(c.k1, c.Lam) * (D2 / (Pi_min * c.k2) + eta)


def _one_slope(
    c: Any,
    deadzone: agvjax.Deadzone,
    s: Signals,
    after: Numbers,
    close: bool,
    yaw_rate: tuple[float, ...] | None = None,
) -> tuple[dict[str, np.ndarray], tuple[float, ...]]:
    """Part 3: bounds (a,) on |Z1| of each axis or, without a yaw rate, on |Z3|; and the interval of what is delivered.

    `yaw_rate` is the ultimate interval of the delivered yaw rate. Only `close` asks for an a-priori bound.
    """
    smallest, largest = map(float, slope_range(deadzone))
    m = np.linspace(smallest, largest, SLOPES)
    if yaw_rate is None:
        axes, make, belief, Z, gain = slice(2, 3), _heading, c.Pi_psi_hat, s.Z3[:, None], s.gain[:, 1:]
        v, start = s.heading_rate[None, None], np.zeros((1, 2))
    else:
        axes, make, belief, Z, gain = slice(0, 2), _position, c.Pi_hat, s.Zb2, s.gain[:, :1]
        v, start = np.stack([s.velocity.T, s.reference_acceleration.T], 1), np.outer(s.velocity[0], [0, 0, 1, 0, 1])
    (n_low,), (n_high,) = _interval(gain[after], 0)
    middle, nu = (n_low + n_high) / 2, (n_high - n_low) / 2 / belief
    system = make(c, m, middle)
    gains, dc = peak_gains(system.A, system.b, system.C)
    system = system._replace(A=np.where(np.isfinite(gains[..., :1, None]), system.A, 0.0))
    y = _response(system, v, start, s.t[1] - s.t[0])
    known = _Known(m[:, None], np.broadcast_to(nu, gains.shape[:2]), *_interval(y[..., after], -1), gains, dc)

    linear = s.command[:, axes] + (gain - middle) / belief * Z
    low, high = _outputs(known, _interval((s.rate[:, axes] - m[:, None, None] * linear)[:, after], 1))
    bounds = {"linear": np.maximum(-low, high)[..., 0].min(axis=0)}
    if close:
        always = known._replace(**dict(zip(("low", "high"), _interval(y, -1), strict=True)))
        low, high = map(np.asarray, _closed(deadzone, yaw_rate, _interval(s.disturbance[:, None, axes], 0), always))
        bounds["a priori"] = np.maximum(-low, high)[..., 0].min(axis=0)
    network = known.nu * np.maximum(-low, high)[..., 2]
    u = (low[..., 1] - network).max(), (high[..., 1] + network).min()
    return bounds, tuple(float(deadzone(jnp.asarray(float(x)))) for x in u)
