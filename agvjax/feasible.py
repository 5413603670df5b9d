"""Can the vehicle follow the path at all? Asked on the host, before a run, of the scenario's nominal numbers.

A body that rolls without slip and holds its reference point, L = `plant.lever()` ahead of the axle, on the path has one
free number, its heading. At the path's velocity (x_d', y_d') that turns by eqs. (1), (2):

    psi' = (-x_d' sin psi + y_d' cos psi) / L,    v = x_d' cos psi + y_d' sin psi,    w = psi'.

With the path's acceleration along and across the body, (u_l, u_t), it takes a = v' = u_l + L w^2 and
alpha = w' = (u_t - v w) / L. Disturbances, slopes of the road and, of a car, the slip of its tyres are left out.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .engine.loop import actuator
from .leaves import cast
from .messages import Reference
from .paths.heading import reference
from .protocols import Heading, Motion, Path, Plant, Reach
from .scenario import Scenario

POINTS = 4001
PAST = 30.0  # lengths L of travel after which where a heading began is forgotten: exp(-30)
SLACK, TINY = 1e-3, 1e-6  # share of a limit, and what, it may be exceeded by without a word
STANDS = 1e-3  # share of the largest speed: a path that ends slower than that comes to rest
RATE = "rate of "


class Demands(NamedTuple):
    """What it takes to follow a path exactly, at n instants."""

    t: np.ndarray  # s
    path_speed: np.ndarray  # m/s
    curvature: np.ndarray  # 1/m, the path's, positive in a left turn; 0 where it stands still
    heading: np.ndarray  # rad, psi, of a body that rolls; empty of another plant, as the next two
    speed: np.ndarray  # m/s, v, of the axle along the body
    yaw_rate: np.ndarray  # rad/s, w
    needs: dict[str, np.ndarray]  # what must be delivered, the rate of that, and what else the plant names


@np.errstate(all="ignore")  # of a path that is not finite
def demands(scenario: Scenario, horizon: float, points: int = POINTS) -> Demands:
    """What following the scenario's path exactly requires over `horizon` [s], or to the end of an open `Waypoints`.

    The heading at t = 0 is the one that the path's own past leads to: at t < 0, 30 lengths L back. Where that is not
    smooth, an open `Waypoints` has none at all, it begins later with a body that turns about the centre of curvature.
    """
    path, plant = cast(scenario.path, jnp.result_type(float)), scenario.plant
    end = path.end() * (1 - 1e-6) if _ends(path, horizon) else float(horizon)
    t = np.linspace(0, end, 2 * points - 1)  # every other one is the middle of a step
    velocity, second = _motion(path, t)
    pace = np.abs(velocity)
    cross = np.imag(np.conj(velocity) * second)
    curvature = np.divide(cross, pace**3, out=np.zeros_like(pace), where=pace > 0)
    heading, motion = np.empty(0), Motion(np.empty(0), np.empty(0), np.empty(0), np.empty(0))
    if (lever := plant.lever()) is None:
        asked = cast(scenario.heading, jnp.result_type(float))
        motion = motion._replace(asked=_asked(path, asked, jnp.asarray(t[::2], jnp.result_type(float))))
    else:
        L = float(lever)
        z = _carried(_begin(path, velocity, curvature, L), velocity, end / (points - 1), L)
        heading, motion = np.unwrap(np.angle(z)), _body(velocity[::2], second[::2], z, L)
    needs = {name: np.asarray(x, float) for name, x in plant.needs(motion).items() if np.size(x)}
    delivered = {part for name in plant.actuators for part in plant.parts(name)}
    needs |= {RATE + name: np.gradient(values, t[::2]) for name, values in needs.items() if name in delivered}
    return Demands(t[::2], pace[::2], curvature[::2], heading, motion.speed, motion.yaw_rate, needs)


def limits(scenario: Scenario) -> dict[str, tuple[float, float]]:
    """The least and the most of what `demands` names: what actuators can deliver, what the plant itself can.

    Only what has a limit is named. A `Steered` plant above its `limits.switch` accelerates less than is said here.
    """
    plant = scenario.plant
    reach = dict(plant.reach())
    for name in plant.actuators:
        low, high, rate = actuator(scenario, name).reach(Reach())
        least, most = reach.get(name, (-np.inf, np.inf))
        for part in plant.parts(name):
            reach[part] = (max(low, least), min(high, most))
            reach[RATE + part] = (-rate, rate)
    return {name: pair for name, pair in reach.items() if np.isfinite(pair).any()}


def path_warnings(scenario: Scenario, horizon: float) -> list[str]:
    """Why the path cannot be followed exactly, one sentence for each reason: quantity, what is needed, when, the limit.

    Empty if it can, as far as `path_unchecked` lets it be known.
    """
    try:
        found, bounds = demands(scenario, horizon), limits(scenario)
        ends = _ends(scenario.path, horizon)
    except Exception as error:  # what users write may raise anything; it must not stop a run
        return [f"it could not be looked at ({type(error).__name__}: {error})"]
    finite = np.isfinite(found.path_speed) & np.isfinite(found.curvature)
    if not finite.all():
        return [f"the path is not finite at t = {found.t[np.argmin(finite)]:.3g} s"]
    said, plant = [], scenario.plant
    last, pace = scenario.path.end(), found.path_speed[-1]
    if ends and pace > STANDS * found.path_speed.max():
        said.append(f"the path ends after {last:.3g} s of {horizon:.3g} s: it stops at once from {pace:.3g} m/s")
    said += _reverses(found, plant)
    exceeded = [_exceeded(name, _unit(plant, name), found, *bounds[name]) for name in found.needs if name in bounds]
    return said + [sentence for sentence in exceeded if sentence]


def path_unchecked(scenario: Scenario, horizon: float) -> str:
    """Why it is not known what the path takes of the vehicle's limits; empty where it is known."""
    try:
        known = bool(demands(scenario, horizon).needs)
    except Exception:  # `path_warnings` says so
        return ""
    return "" if known else f"{type(scenario.plant).__name__} does not say what following a path takes (Plant.needs)"


def path_needs(scenario: Scenario, horizon: float) -> list[str]:
    """What the path takes of every limit at most, as `left: 0.62 of 0.8 m/s`; empty where nothing has a limit.

    Of a path that can be followed, see `path_warnings`; what nothing limits is left out.
    """
    found, bounds = demands(scenario, horizon), limits(scenario)
    said = []
    for name, needed in found.needs.items():
        low, high = bounds.get(name, (-np.inf, np.inf))
        shares = [(needed.max() / high, needed.max(), high)] if 0 < high < np.inf else []
        shares += [(needed.min() / low, needed.min(), low)] if -np.inf < low < 0 else []
        if shares:
            plain, unit = name.removeprefix(RATE), _unit(scenario.plant, name)
            _, most, limit = max(shares)
            said.append(f"{plain}: {most:.3g} of {limit:.3g} {unit}{' per s' if name != plain else ''}")
    return said


def _ends(path: Path, horizon: float) -> bool:
    return path.end() < horizon * (1 - 1e-6)


@jax.jit
def _rates(path: Path, t: Array) -> tuple[Array, Array]:
    def one(time: Array) -> tuple[Array, Array]:
        found = reference(path, lambda _, time: jnp.zeros_like(time), time)  # of the tangent nothing is needed
        return found.velocity, found.acceleration

    return jax.vmap(one)(t)


@jax.jit
def _asked(path: Path, heading: Heading | None, t: Array) -> Reference:
    return jax.vmap(lambda time: reference(path, heading, time))(t)


def _unit(plant: Plant, name: str) -> str:
    return plant.units.get(name.removeprefix(RATE), "")


def _motion(path: Path, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Velocity and acceleration of the path as complex numbers x + i y."""
    rates = _rates(path, jnp.asarray(t, jnp.result_type(float)))
    velocity, second = (np.asarray(x, float) for x in rates)
    return velocity[:, 0] + 1j * velocity[:, 1], second[:, 0] + 1j * second[:, 1]


def _begin(path: Path, velocity: np.ndarray, curvature: np.ndarray, L: float) -> complex:
    """The heading exp(i psi) at t = 0."""
    speed = np.abs(velocity)
    if not speed.any() or not np.isfinite(speed).all():
        return 1.0 + 0.0j
    lead = PAST * L / float(np.mean(speed))
    before, second = _motion(path, np.linspace(-lead, 0, velocity.size))  # as many as ahead: compiled once
    smooth = np.isfinite(before) & np.isfinite(second)
    smooth[:-1] &= np.real(np.conj(before[:-1]) * before[1:]) > 0  # turns by less than 90 degrees between two
    rough = np.flatnonzero(~smooth[:-1:2] | ~smooth[1::2])
    first = 2 * (rough[-1] + 1) if rough.size else 0
    if first >= before.size - 1:
        at = int(np.argmax(speed > 0))
        return _turning(velocity[at], curvature[at], L)
    bend = np.imag(np.conj(before[first]) * second[first]) / np.abs(before[first]) ** 3
    return _carried(_turning(before[first], bend, L), before[first:], 2 * lead / (before.size - 1), L)[-1]


def _turning(velocity: complex, curvature: float, L: float) -> complex:
    """The heading of a body that turns about the centre of curvature, sin(theta - psi) = L curvature, if it can."""
    inward = np.arcsin(np.clip(L * curvature, -1.0, 1.0))
    return complex(velocity / np.abs(velocity) * np.exp(-1j * inward))


def _carried(z: complex, velocity: np.ndarray, h: float, L: float) -> np.ndarray:
    """The headings z = exp(i psi) at every other one of the velocities, `h` [s] apart.

    z' = (v - conj(v) z^2) / (2 L), v the velocity, is solved by a quotient p / q with p' = v q / (2 L), q' = conj(v)
    p / (2 L). Each step multiplies (p, q) by the exponential of a matrix, Magnus' of fourth order by Simpson's rule: no
    step is too long to be stable, and a constant velocity is followed exactly.
    """
    first, middle, last = velocity[:-2:2], velocity[1::2], velocity[2::2]
    b = h * (first + 4 * middle + last) / (12 * L)
    c = -(h**2) * np.imag(first * np.conj(last)) / (24 * L**2)
    size = np.sqrt(np.maximum(np.abs(b) ** 2 - c**2, 0))
    share = np.divide(np.tanh(np.minimum(size, 15.0)), size, out=np.ones_like(size), where=size > 1e-12)
    headings = [z]
    for p, q in zip((1 + 1j * c * share).tolist(), (b * share).tolist(), strict=True):
        z = (p * z + q) / (q.conjugate() * z + p.conjugate())
        z /= abs(z)
        headings.append(z)
    return np.array(headings)


def _body(velocity: np.ndarray, second: np.ndarray, z: np.ndarray, L: float) -> Motion:
    """Speed v, yaw rate w, a and alpha, see above."""
    along, push = velocity * np.conj(z), second * np.conj(z)
    v, w = np.real(along), np.imag(along) / L
    return Motion(v, w, np.real(push) + L * w**2, (np.imag(push) - v * w) / L)


def _reverses(found: Demands, plant: Plant) -> list[str]:
    """A vehicle that steers a wheel and would have to stand still or to drive backwards."""
    if "steering_angle" not in found.needs or (found.speed > 0).all():
        return []
    L, worst, tightest = (
        float(plant.lever() or 0.0),
        int(np.argmin(found.speed)),
        float(np.max(np.abs(found.curvature))),
    )
    tight = f"; its smallest radius is {1 / tightest:.3g} m, the wheelbase {L:.3g} m" if tightest * L > 1 else ""
    when = f"{found.speed[worst]:.3g} m/s at t = {found.t[worst]:.3g} s"
    return [f"speed: the path makes the vehicle stand still or reverse, {when}{tight}"]


def _exceeded(name: str, unit: str, found: Demands, low: float, high: float) -> str:
    """The sentence on a quantity that leaves its limits most at some instant; empty if it keeps them."""
    needed = found.needs[name]
    if not np.isfinite(needed).all():
        return f"{name}: what the path needs is not finite at t = {found.t[np.argmin(np.isfinite(needed))]:.3g} s"
    over = np.maximum(needed - high, low - needed)
    worst = int(np.argmax(over))
    above = needed[worst] > high
    limit, end = (high, "most") if above else (low, "least")
    if over[worst] <= SLACK * abs(limit) + TINY:
        return ""
    plain = name.removeprefix(RATE)
    need, when = f"{needed[worst]:.3g} {unit}".rstrip(), f"at t = {found.t[worst]:.3g} s"
    if name != plain:
        return f"{plain}: the path needs a change by {need} per s {when}, it changes by {high:.3g} at most"
    return f"{name}: the path needs {need} {when}, the vehicle has {limit:.3g} at {end}"
