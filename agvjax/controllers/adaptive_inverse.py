"""An adaptive inverse for deadzones that are not known well, from the measured response of the vehicle."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._pytree import NONNEGATIVE, POSITIVE, Real, number, pytree, structure
from ..actuators.deadzone import Deadzone
from ..errors import Fault
from ..messages import Measurement
from ..protocols import Inputs, Plant
from .compensation import Inverse, believed_of
from .replay import MOST_SLOTS, joined, memoryless, stepped, under_way

FASTEST = 2.0  # rate up to which estimates approach the truth


@pytree
class Learnt:
    """What the computer has learnt, and what it needs to go on."""

    wanted: Inputs  # last
    beliefs: dict[str, Array]  # by actuator (4, *n): m of the right side and of the left, q of both
    way: dict[str, Array]  # by actuator the last inputs, the newest first
    before: Measurement  # at the last instant
    begun: Float[Array, ""]  # 0 before the first instant, then 1


@pytree
class AdaptiveInverse(Inverse):
    """`Inverse` whose assumed slopes and thresholds are adapted online, starting from `believed`.

    Each side of an actuator is modelled as delivering m (|u| - c) + q, with the slope m, and q at its `usual` input c,
    so that its threshold is c - q / m. Once per period the computer's `vehicle` is stepped from the last measurement
    with what should have been delivered; e is the prediction error of a velocity [m/s] or of the yaw rate [rad/s]. The
    output is linear in theta = (m c / 2, q) of all sides; with phi = d(velocity)/d theta, for one velocity after the
    other:

        theta' = P(theta + `rate` phi e_d / (`floor` + |phi|^2)),        e_d = sign(e) max(|e| - `dead_band`, 0)

    P projects onto m and q within 1 / `farthest` and `farthest` times their initial values.

    Stability: where e = phi . (theta* - theta) + r with |r| <= `dead_band`, and theta* is within the bounds,
    V = |theta - theta*|^2 never grows for 0 < `rate` <= 2: a step changes it by at most -(2 rate - rate^2) e_d^2 /
    (floor + |phi|^2), and a projection onto a convex set only shortens the distance to its points. r is noise,
    disturbance and the model error of `vehicle`. Nothing is learnt without excitation: a side without input keeps its
    estimates, and at one constant input only the output there is learnt, not slope and threshold separately.

    Source: Tao and Kokotovic, Adaptive control of plants with unknown dead-zones, IEEE TAC 39(1), 1994, for the
    inverse and what is adapted; Ioannou and Sun, Robust Adaptive Control, 1996, ch. 4 and 8, for the normalised
    gradient with dead-band and projection.

    Attributes:
        rate: share of an error that is corrected in one period; stable up to 2.
        dead_band: prediction errors up to this are ignored.
        floor: excitation |phi|^2 below which it adapts more slowly.
        usual: typical size of each input, in the vehicle's order, around which it adapts best.
        farthest: the factor by which the estimates may differ from `believed`.
        delay: from the instant of a command until it takes effect.
        slots: inputs stored, more than the delay in periods.
    """

    rate: Real = number(0.1, "1", POSITIVE)
    dead_band: Real = number(0.0005, "m/s and rad/s", NONNEGATIVE)
    floor: Real = number(1e-3, "1", POSITIVE)
    usual: Array | np.ndarray = number((0.4, 0.4), "of each input, in the vehicle's order", POSITIVE, shape=(None,))
    farthest: Real = number(3.0, "1", POSITIVE)
    delay: Real = number(0.0, "s", NONNEGATIVE)
    slots: int = structure(4)

    tunable = ("width", "quiet", "rate")

    def hold(self, wanted: Inputs, measurement: Measurement) -> Learnt:
        """Initial estimates; no inputs under way."""
        believed_of(self.believed, wanted)
        return Learnt(
            wanted={name: jnp.zeros_like(d) for name, d in wanted.items()},
            beliefs=self._first(wanted),
            way=under_way(wanted, self.slots),
            before=measurement,
            begun=jnp.zeros_like(measurement.heading),
        )

    def learnt(self, memory: Learnt, vehicle: Plant, measurement: Measurement, period: Real) -> Learnt:
        """One step of the gradient law for each velocity."""
        old = beliefs = memory.beliefs
        first, usual = self._first(memory.wanted), self._usual(memory.wanted)
        scale = {name: jnp.stack([usual[name] / 2] * 2 + [jnp.ones_like(usual[name])] * 2) for name in old}

        def expected(theta: dict[str, Array]) -> Array:
            return _moves(self._ahead(theta, memory, vehicle, period))

        before, along = jax.linearize(expected, old)
        errors, slopes = _moves(measurement) - before, {name: _slopes(along, old, name) for name in old}
        for i in range(len(errors)):
            phi = {name: x[i] / scale[name] for name, x in slopes.items()}
            moved = sum(jnp.sum(slopes[name][i] * (beliefs[name] - old[name])) for name in old)
            e = errors[i] - moved
            left = jnp.sign(e) * jnp.maximum(jnp.abs(e) - self.dead_band, 0)
            step = memory.begun * self.rate * left / (self.floor + sum(jnp.sum(x**2) for x in phi.values()))
            later = {name: x + step * phi[name] / scale[name] for name, x in beliefs.items()}
            beliefs = {n: jnp.clip(x, first[n] / self.farthest, self.farthest * first[n]) for n, x in later.items()}
        return dataclasses.replace(memory, beliefs=beliefs, before=measurement, begun=jnp.ones_like(memory.begun))

    def sent(self, memory: Learnt, wanted: Inputs, period: Real) -> tuple[Inputs, Learnt]:
        """Lead, then the inverse of the present estimates."""
        sent = self._now(memory).inverted(self.led(memory.wanted, wanted, period))
        return sent, dataclasses.replace(memory, wanted=wanted)

    def remembering(self, memory: Learnt, sent: Inputs) -> Learnt:
        """What was sent joins the line."""
        return dataclasses.replace(memory, way=joined(memory.way, sent))

    def delivered(self, memory: Learnt, sent: Inputs) -> Inputs:
        """The output of the deadzones as estimated now."""
        return self._now(memory).delivered((), sent)

    def zones(self, memory: Learnt) -> dict[str, Deadzone]:
        """The deadzone of each actuator as estimated now."""
        found, usual = {}, self._usual(memory.wanted)
        for name, x in memory.beliefs.items():
            s = jnp.maximum(usual[name][None] - x[2:] / x[:2], 0)
            found[name] = Deadzone(slope_right=x[0], slope_left=x[1], threshold_right=s[0], threshold_left=s[1])
        return found

    def upper_bounds(self, period: float) -> dict[str, float]:
        """The rate of its proof, and a delay no longer than the inputs stored."""
        return {"rate": FASTEST, "delay": (self.slots - 1) * period}

    def faults(self, vehicle: Plant, period: float | None) -> list[Fault]:
        """Those of an inverse; no computer, numbers outside its proof, wrong slots, a vehicle with memory."""
        found = super().faults(vehicle, period)
        if period is None:
            return [
                *found,
                Fault("type", type(self).__name__, "one for continuous time: use inverse, or a sampled law"),
            ]
        if np.size(self.usual) != len(vehicle.actuators):
            rule = f"one for each of {', '.join(vehicle.actuators)}"
            return [*found, Fault("usual", np.asarray(self.usual).tolist(), rule)]
        for name, usual in zip(vehicle.actuators, np.asarray(self.usual), strict=True):
            zone = self.believed.get(name, Deadzone())
            largest = float(np.max(np.stack([zone.threshold_right, zone.threshold_left])))
            if not usual > largest:
                rule = f"above the assumed thresholds, of {name} {largest:g}"
                found.append(Fault("usual", np.asarray(self.usual).tolist(), rule))
        if np.max(np.asarray(self.rate)) > FASTEST:
            found.append(
                Fault("rate", float(np.max(np.asarray(self.rate))), f"at most {FASTEST:g}, from its stability proof")
            )
        if not np.min(np.asarray(self.farthest)) > 1:
            found.append(Fault("farthest", float(np.min(np.asarray(self.farthest))), "greater than 1"))
        needed = 1 + int(np.ceil(float(np.max(np.asarray(self.delay))) / period - 1e-9))
        if not needed <= self.slots <= MOST_SLOTS:
            rule = f"at least {needed}, one more than the delay in periods of {period:g} s, at most {MOST_SLOTS}"
            found.append(Fault("slots", self.slots, rule))
        return [*found, *memoryless(vehicle, self)]

    def _now(self, memory: Learnt) -> Inverse:
        """The inverse of the present estimates."""
        numbers = {f.name: self.__dict__[f.name] for f in dataclasses.fields(Inverse)}
        return Inverse(**{**numbers, "believed": self.zones(memory)})

    def _ahead(self, beliefs: dict[str, Array], memory: Learnt, vehicle: Plant, period: Real) -> Measurement:
        """What should be measured a period after the last instant: RK4 under the mean of what was delivered."""
        delivered, usual = {}, self._usual(memory.wanted)
        for name, line in memory.way.items():
            each = [_of(beliefs[name], usual[name], u) if name in beliefs else u for u in line]
            ages = jnp.arange(self.slots).astype(line.dtype)
            shares = jnp.maximum(1 - jnp.abs(self.delay / period - ages), 0)  # of the period in which each one acts
            delivered[name] = sum(shares[i] * x for i, x in enumerate(each))
        return vehicle.output(stepped(vehicle, vehicle.seen(memory.before), delivered, period), delivered)

    def _usual(self, inputs: Inputs) -> dict[str, Array]:
        usual = jnp.asarray(self.usual)
        return {name: usual[i] + jnp.zeros_like(d) for i, (name, d) in enumerate(inputs.items())}

    def _first(self, wanted: Inputs) -> dict[str, Array]:
        """Beliefs at first."""
        usual, found = self._usual(wanted), {}
        for name, zone in self.believed.items():
            m, s = ((zone.slope_right, zone.slope_left), (zone.threshold_right, zone.threshold_left))
            like = jnp.zeros_like(wanted[name])
            q = [m[i] * (usual[name] - s[i]) for i in range(2)]
            found[name] = jnp.stack([x + like for x in (*m, *q)])
        return found


def _slopes(along: Callable[[dict[str, Array]], Array], at: dict[str, Array], name: str) -> Array:
    """Derivatives (3, 4, *n) by the estimates of one actuator, one by one, so that they can be exported as numbers."""
    x, still = at[name], {n: jnp.zeros_like(value) for n, value in at.items()}
    units = np.eye(x.size).reshape(x.size, *x.shape)
    return jnp.stack([along({**still, name: jnp.asarray(unit, x.dtype)}) for unit in units], -1).reshape(3, *x.shape)


def _of(x: Array, usual: Array, u: Array) -> Array:
    """The output for an input by these estimates."""
    right, left = jnp.maximum(x[:2] * (jnp.stack([u, -u]) - usual[None]) + x[2:], 0)
    return jnp.where(u > 0, right, -left)


def _moves(measurement: Measurement) -> Float[Array, "3"]:
    """Velocities and yaw rate."""
    return jnp.concatenate([measurement.velocity, measurement.yaw_rate[None]])
