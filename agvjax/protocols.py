"""What laws, plants, paths, headings, disturbances, elements and sensors must have, and what they may have.

A class of one's own derives from one of these and stands under `@agvjax.pytree`. What raises `NotImplementedError` must
be written; all else has a default that means "nothing of the kind". Everything is written for one vehicle at one
instant with `jax.numpy`; `jax.vmap` batches.

Besides a state that flows, with a derivative, a law, an element, a plant and a sensor may have a memory that jumps: a
sensor's and a law's at control instants, an element's and a plant's at the start of every step of the integrator.
`hold` gives its first value, `jump` the next one; `()` is no memory and costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from ._pytree import Real
from .errors import Fault
from .leaves import leaves
from .messages import Command, Measurement, Reference, Start

Inputs = dict[str, Array]  # by actuator, what is asked of it or what it delivers
Stable = Callable[[np.ndarray], bool]  # whether a step integrates modes with these poles [1/s]


class Law:
    """A control law: needs `init` and `law`."""

    tunable: ClassVar[tuple[str, ...] | None] = None  # gains to tune; None: every leaf that is a single number
    heading_gains: ClassVar[tuple[str, ...]] = ()  # those of them that serve the heading alone
    relieves: ClassVar[bool] = False  # whether `relieved` does anything

    def init(self, measurement: Measurement, reference: Reference) -> PyTree:
        """The state of a law that starts now."""
        raise NotImplementedError(f"{type(self).__name__} needs init(measurement, reference)")

    def law(
        self, flow: PyTree, memory: PyTree, measurement: Measurement, reference: Reference
    ) -> tuple[Command, PyTree]:
        """The command before the deadzone, and the derivative of the state.

        The heading's command must not need the yaw rate where the plant has `feedthrough`.
        """
        raise NotImplementedError(f"{type(self).__name__} needs law(flow, memory, measurement, reference)")

    def hold(self, measurement: Measurement, reference: Reference) -> PyTree:
        """The memory before the first control instant."""
        return ()

    def jump(
        self, flow: PyTree, memory: PyTree, measurement: Measurement, reference: Reference, h: Float[Array, ""]
    ) -> PyTree:
        """The memory after a control instant, `h` [s] after the last one."""
        return memory

    def follows(self) -> bool:
        """Whether it follows a route by the vehicle's position, and not by time."""
        return False

    def faster(self, factor: float) -> Law:
        """The law for a path that is driven so many times as fast; one that has a speed of its own changes it."""
        return self

    def canonical(self) -> Law:
        """The same law, without numbers that it and other programs read differently; tuned gains are written so."""
        return self

    def control_period(self) -> Real | None:
        """Time [s] between control instants of a law that runs on a clock of its own; None: as the run says."""
        return None

    def limited(self, memory: PyTree) -> Bool[Array, ""]:
        """Whether the law's command is limited."""
        return jnp.zeros((), bool)

    def state(self, flow: PyTree, memory: PyTree) -> PyTree:
        """What a trajectory shows of the law."""
        return flow

    def weight_norms(self, flow: PyTree) -> Float[Array, "2"] | None:
        """Squared norms of adapted weights, position and heading; None without a network."""
        return None

    def advance(
        self, state: PyTree, measurement: Measurement, reference: Reference, period: Real, limit: Real | None = None
    ) -> tuple[Command, PyTree, Bool[Array, ""]]:
        """One period [s] of a digital loop, measurement and reference held over it; by Euler's method.

        Args:
            state: that of `init`.
            measurement: at the instant.
            reference: at the instant.
            period: length [s].
            limit: bound of the virtual control's correction [m/s], of laws that have one.

        Returns:
            The command, the state a period later, and whether the limit was met.
        """
        command, rate = self.law(state, (), measurement, reference)
        return command, jax.tree.map(lambda x, dx: x + period * dx, state, rate), jnp.zeros((), bool)

    def relieved(self, before: PyTree, later: PyTree, missing: Array, limited: Array, period: Real) -> PyTree:
        """Anti-windup: the state after a period in which `missing` (2,) [m/s^2] of the command was not applied."""
        return later

    def gains_to_tune(self, heading: bool = True) -> tuple[str, ...]:
        """Names of the gains to tune by default; those of the heading only where it can be commanded."""
        if self.tunable is None:
            return tuple(name for name, value in leaves(self).items() if np.ndim(value) == 0)
        return tuple(name for name in self.tunable if heading or name not in self.heading_gains)

    def poles(self) -> np.ndarray:
        """Poles [1/s] of the law's fastest part, which a step of the integrator must suit."""
        return np.array([])

    @property
    def fastest(self) -> tuple[str, str]:
        """What has these poles, and its source."""
        return "law's fastest part", ""

    def rates(self) -> dict[str, np.ndarray]:
        """By gain the poles [1/s] of the modes whose speed it sets."""
        return {}

    def upper_bounds(self, stable: Stable) -> dict[str, float]:
        """By gain what it must stay below, so that a step integrates the law."""
        return {}

    def stability_bounds(self, Pi_min: float, Pi_psi_min: float) -> dict[str, float]:
        """By gain what it must exceed for stability, with the smallest deadzone slopes of position and heading."""
        return {}

    def input_limits(self) -> Float[Array, " m"] | None:
        """Largest size of each input of the law; None: no limit."""
        return None

    def believing(self, plant: Plant, deadzone: Mapping[str, Element]) -> Law:
        """The law with this plant and its deadzones as its model, if it has such a model."""
        return self

    def faults(self, plant: Plant) -> list[Fault]:
        """What in the law does not suit a plant; keys are relative to the law."""
        return []


class Motion(NamedTuple):
    """What following a path exactly requires of a vehicle, at n instants; see `agvjax.demands`.

    For a plant with a `lever`, a body that rolls, the first four are given; for any other plant `asked` is.
    """

    speed: np.ndarray  # m/s, v, of the axle along the body
    yaw_rate: np.ndarray  # rad/s, w
    acceleration: np.ndarray  # m/s^2, v'
    yaw_acceleration: np.ndarray  # rad/s^2, w'
    asked: Reference | None = None  # of the path, each part with a leading n


class Plant:
    """A vehicle: needs `actuators`, `start`, `allocate`, `derivative` and `output`."""

    actuators: tuple[str, ...] = ()  # the names of what drives it
    feedthrough: bool = False  # whether `output` needs what is delivered at the same instant
    commands_heading: bool = True  # False: the heading follows from the motion, and no law commands it
    units: ClassVar[Mapping[str, str]] = {}  # by actuator, and by what else `needs` and `reach` name
    command_units: ClassVar[tuple[str, ...]] = ("m/s^2", "m/s^2", "rad/s")  # of a law's command, by channel

    def start(self, start: Start) -> PyTree:
        """The state a run begins in; a dataclass with a `heading`."""
        raise NotImplementedError(f"{type(self).__name__} needs start(start)")

    def allocate(self, command: Command, measurement: Measurement) -> Inputs:
        """The actuator inputs for a law's command."""
        raise NotImplementedError(f"{type(self).__name__} needs allocate(command, measurement)")

    def derivative(self, state: PyTree, memory: PyTree, delivered: Inputs, disturbance: Float[Array, "3"]) -> PyTree:
        """The derivative of the state under what is delivered and a disturbance [m/s^2, m/s^2, rad/s]."""
        raise NotImplementedError(f"{type(self).__name__} needs derivative(state, memory, delivered, disturbance)")

    def output(self, state: PyTree, delivered: Inputs) -> Measurement:
        """The measurement of a sensor without noise."""
        raise NotImplementedError(f"{type(self).__name__} needs output(state, delivered)")

    def seen(self, measurement: Measurement) -> PyTree:
        """The state that a measurement tells, for laws that predict; what it does not tell is as in `start`."""
        position, velocity, heading = measurement.position, measurement.velocity, measurement.heading
        return self.start(Start(position=position, velocity=velocity, heading=heading))

    def hold(self, state: PyTree) -> PyTree:
        """The memory before the first step."""
        return ()

    def jump(self, state: PyTree, memory: PyTree, delivered: Inputs, h: Float[Array, ""]) -> PyTree:
        """The memory for the step that begins, `h` [s] long."""
        return memory

    def deadzones(self) -> Mapping[str, Element]:
        """Nominal deadzones of its actuators; an actuator that is not named delivers everything."""
        return {}

    def parts(self, actuator: str) -> tuple[str, ...]:
        """The names, in `needs` and `reach`, of what one actuator delivers."""
        return (actuator,)

    def achieved(self, inputs: Inputs, measurement: Measurement) -> Float[Array, "2"]:
        """The position command [m/s^2] that inputs amount to; anti-windup needs it."""
        raise NotImplementedError(f"{type(self).__name__} needs achieved(inputs, measurement) for anti-windup")

    def lever(self) -> Real | None:
        """How far [m] ahead of the axle the reference point of a body that rolls without slip is, L of eq. (2)."""
        return None

    def needs(self, motion: Motion) -> dict[str, np.ndarray]:
        """By actuator, and by what else has a limit, what must be delivered for a motion; empty: it does not say."""
        return {}

    def reach(self) -> dict[str, tuple[float, float]]:
        """Least and most of what `needs` names, where the vehicle itself limits it."""
        return {}


class Path:
    """A reference path: needs `__call__`. Its derivatives are taken by JAX."""

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "2"]:
        """Position [m] at time `t` [s], twice differentiable."""
        raise NotImplementedError(f"{type(self).__name__} needs __call__(t)")

    def bearing(self, t: Float[Array, ""]) -> Float[Array, ""] | None:
        """A smooth heading [rad] that is not the tangent's; None without one."""
        return None

    def nearest_crossing(self, t: Float[Array, ""]) -> Float[Array, ""] | None:
        """When, nearest to `t` [s], the path passes the origin, where a raw bearing jumps; None: never."""
        return None

    def by_arc(self) -> bool:
        """Whether it is a route, which a law can follow by where it is."""
        return False

    def lap(self) -> float | None:
        """Time [s] after which the path repeats itself; None: never."""
        return None

    def end(self) -> float:
        """When [s] it stops at its last point; infinite of a path without an end."""
        return float("inf")


class Heading:
    """The heading that a path asks for: needs `__call__`."""

    def __call__(self, path: Path, t: Float[Array, ""]) -> Float[Array, ""]:
        """Heading [rad] at time `t` [s]."""
        raise NotImplementedError(f"{type(self).__name__} needs __call__(path, t)")

    def nearest_jump(self, path: Path, t: Float[Array, ""]) -> Float[Array, ""] | None:
        """When, nearest to `t` [s], it jumps; a step of the integrator then begins there. None: never."""
        return None

    def faults(self, path: Path) -> list[Fault]:
        """What of a path does not suit this heading."""
        return []


class Disturbance:
    """A disturbance: needs `__call__`.

    Split into a time-only `shape` and a `scale`, a batch of amplitudes costs one multiplication: the rollout tabulates
    the shape outside its loop.
    """

    def __call__(self, t: Float[Array, ""]) -> Float[Array, "3"]:
        """Disturbance at time `t` [s] in the x, y and heading channels [m/s^2, m/s^2, rad/s]."""
        raise NotImplementedError(f"{type(self).__name__} needs __call__(t)")

    def shape(self, t: Float[Array, ""]) -> Array:
        """What depends on time."""
        return self(t)

    def scale(self, shape: Array) -> Float[Array, "3"]:
        """The disturbance of a shape."""
        return shape

    def nearest_jump(self, t: Float[Array, ""]) -> Float[Array, ""] | None:
        """When, nearest to `t` [s], it jumps; a step of the integrator then begins there. None: never."""
        return None


class Reach(NamedTuple):
    """Bounds of a signal."""

    low: float = -np.inf
    high: float = np.inf
    rate: float = np.inf  # per s

    def through(self, monotonous: Callable[[Array], Array], rate: float) -> Reach:
        """Bounds of a function of the signal that never falls where the signal rises."""
        low, high = (float(monotonous(jnp.asarray(u))) if np.isfinite(u) else u for u in (self.low, self.high))
        return Reach(low, high, rate)

    def from_rest(self, rate: float) -> Reach:
        """Bounds of what follows the signal from 0."""
        return Reach(min(self.low, 0.0), max(self.high, 0.0), rate)


class Element:
    """An actuator element: needs `__call__`, or `deliver` if it has a state or a memory."""

    def __call__(self, u: Float[Array, "*n"]) -> Float[Array, "*n"]:
        """What is delivered of the command `u`, same shape and unit."""
        raise NotImplementedError(f"{type(self).__name__} needs __call__(u), or deliver(flow, memory, u)")

    def init(self, u: Float[Array, "*n"]) -> PyTree:
        """The state at the start."""
        return ()

    def hold(self, u: Float[Array, "*n"]) -> PyTree:
        """The memory before the first step."""
        return ()

    def deliver(self, flow: PyTree, memory: PyTree, u: Float[Array, "*n"]) -> tuple[Float[Array, "*n"], PyTree]:
        """What is delivered, and the derivative of the state."""
        return self(u), ()

    def jump(self, flow: PyTree, memory: PyTree, u: Float[Array, "*n"], h: Float[Array, ""]) -> PyTree:
        """The memory for the step that begins, `h` [s] long."""
        return memory

    def limited(self, flow: PyTree, memory: PyTree, u: Float[Array, "*n"]) -> Bool[Array, ""]:
        """Whether it is at a limit."""
        return jnp.zeros((), bool)

    def elements(self, key: str) -> Iterator[tuple[str, Element]]:
        """The elements that it is made of, by dotted name from `key` on: itself, if it is not several."""
        yield key, self

    def poles(self) -> list[float]:
        """Its poles [1/s], which a step of the integrator must suit."""
        return []

    def reach(self, asked: Reach) -> Reach:
        """Bounds of what is delivered of an input within bounds, from 0 at the start; by default it may be anything."""
        return Reach()

    def faults(self, interval: float) -> list[Fault]:
        """What does not suit an input that changes every `interval` [s]; keys are relative to the element."""
        return []


class Sensor:
    """A sensor between vehicle and controller; by default exact."""

    def __call__(self, memory: PyTree, measurement: Measurement) -> Measurement:
        """What the controller is told."""
        return measurement

    def hold(self, measurement: Measurement) -> PyTree:
        """The memory before the first control instant."""
        return ()

    def jump(self, memory: PyTree, measurement: Measurement, h: Float[Array, ""]) -> PyTree:
        """The memory after a control instant, `h` [s] after the last one."""
        return memory
