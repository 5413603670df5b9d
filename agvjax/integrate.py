"""Explicit Runge-Kutta steps on any tree of arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import PyTree

from ._pytree import Real

State = PyTree
Derivative = Callable[[State, PyTree], tuple[State, PyTree]]  # of state and signals: rate, and what is seen


class Integrator(NamedTuple):
    """One explicit method: its nodes, as fractions of the step, and the step itself.

    `advance(f, x, h, signals)` returns x at the end of the step and what `f` saw at its start; `f(x, signal)` returns
    the derivative and what it sees, `signals` has one entry per node.
    """

    name: str
    order: int
    nodes: tuple[float, ...]
    advance: Callable[[Derivative, State, Real, Sequence[PyTree]], tuple[State, PyTree]]

    def __str__(self) -> str:
        """Its name, as in TOML."""
        return self.name

    def amplification(self, z: complex) -> float:
        """|R(z)|, the factor by which one step scales a mode with eigenvalue z / h; stable up to 1."""
        return float(np.abs(self._factor(z)))

    def error(self, z: complex) -> float:
        """Relative error of a mode over its own time constant, for an eigenvalue z / h: |R(z) - e^z| / |z|."""
        return float(np.abs(self._factor(z) - np.exp(z)) / max(np.abs(z), 1e-300))

    def _factor(self, z: complex) -> complex:
        """R(z): true for these methods, which have as many stages as their order."""
        term, total = 1.0 + 0j, 1.0 + 0j
        for k in range(1, self.order + 1):
            term *= z / k
            total += term
        return total

    def stable_step(self, poles: np.ndarray) -> float:
        """The largest step [s], within 0.1 %, up to which every mode with one of these poles [1/s] decays."""
        if not np.size(poles):
            return np.inf
        decays = lambda h: all(self.amplification(pole * h) <= 1 for pole in poles)  # noqa: E731
        return largest(decays, 10.0 / float(np.max(np.abs(poles))))


def largest(holds: Callable[[float], bool], high: float) -> float:
    """The largest number up to `high`, within 0.1 %, for which `holds`, where it holds for all smaller ones."""
    low = 0.0
    while high - low > 1e-3 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def _add(x: State, h: Real, rate: State) -> State:
    return jax.tree.map(lambda a, b: a + h * b, x, rate)


def _euler(f: Derivative, x: State, h: Real, signals: Sequence[PyTree]) -> tuple[State, PyTree]:
    k1, seen = f(x, signals[0])
    return _add(x, h, k1), seen


def _heun(f: Derivative, x: State, h: Real, signals: Sequence[PyTree]) -> tuple[State, PyTree]:
    k1, seen = f(x, signals[0])
    k2, _ = f(_add(x, h, k1), signals[1])
    return _add(x, h / 2, jax.tree.map(lambda a, b: a + b, k1, k2)), seen


def _rk4(f: Derivative, x: State, h: Real, signals: Sequence[PyTree]) -> tuple[State, PyTree]:
    start, middle, end = signals
    k1, seen = f(x, start)
    k2, _ = f(_add(x, h / 2, k1), middle)
    k3, _ = f(_add(x, h / 2, k2), middle)
    k4, _ = f(_add(x, h, k3), end)
    return _add(x, h / 6, jax.tree.map(lambda a, b, c, d: a + 2 * (b + c) + d, k1, k2, k3, k4)), seen


EULER = Integrator("euler", 1, (0.0,), _euler)
HEUN = Integrator("heun", 2, (0.0, 1.0), _heun)
RK4 = Integrator("rk4", 4, (0.0, 0.5, 1.0), _rk4)
INTEGRATORS = {method.name: method for method in (EULER, HEUN, RK4)}
