"""What a method of tuning is asked: from what was seen at some gains to the gains to look at next."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float, PyTree

from agvjax import Fault
from agvjax.gradient import MOST_FORWARD

from ...config.settings import Config, Tune
from .objective import Objective, Score

if TYPE_CHECKING:
    from ..tuner import Tuner

Scenarios = Mapping[str, np.ndarray]  # the leaves that vary, (B, ...)
Model = tuple[Array, Array, Array]  # values (M, B), ok (B,) and slopes (K, M, B)


class Progress(NamedTuple):
    """Everything a search needs to go on from where it stands."""

    iteration: int
    z: Float[Array, " K"]  # the gains as unconstrained coordinates
    optimiser: PyTree  # state of the method
    sound_z: Float[Array, " K"]  # where the last sound gradient was computed
    best_z: Float[Array, " K"]
    best: tuple[float, float]  # (sum of excesses beyond tolerance, goal) of best_z, compared in this order
    best_iteration: int
    clipped: int  # gradients cut to the allowed norm so far
    backed_out: int  # iterations whose point was given up: no finite gradient, every run diverged, slopes of no use
    rollouts: int  # of the whole ensemble so far; a gradient counts 1 + its tangents
    history: list[tuple[float, ...]]  # a row an iteration: `tuner.HISTORY`, then the gains
    moving: np.ndarray  # (K,), whether it may change a gain; the others stay where it began


class Look(NamedTuple):
    """What the tuner computed at a point."""

    score: Score
    gradient: Float[Array, " K"]
    model: Model | None = None  # of a method that needs the Jacobian
    rank: Score | None = None  # by what to rank the point, where that is not the same ensemble


@dataclasses.dataclass(frozen=True)
class Method:
    """A method of tuning: needs `begin` and `step`; all else has a default.

    Attributes:
        settings: of [tune].
        objective: goals and limits.
        cost: scenarios -> the cost as a function of z, for methods that search along a line.
    """

    settings: Tune
    objective: Objective
    cost: Callable[[Scenarios], Callable[[Array], Array]]

    jacobian: ClassVar[bool] = False  # whether it needs the slopes of every metric of every scenario

    def begin(self, z: Array, scenarios: int) -> PyTree:
        """The state before the first look at an ensemble of so many scenarios."""
        raise NotImplementedError(f"{type(self).__name__} needs begin(z, scenarios)")

    def step(
        self, p: Progress, look: Look, sound: bool, baseline: np.ndarray, scenarios: Scenarios
    ) -> tuple[Array, PyTree]:
        """The next point and the state.

        Args:
            p: where the search stands.
            look: what was computed at p.z.
            sound: whether that is of use.
            baseline: (3, M), what goals and limits are multiples of.
            scenarios: those of the look.
        """
        raise NotImplementedError(f"{type(self).__name__} needs step(p, look, sound, baseline, scenarios)")

    def look(self, tuner: Tuner, z: Array, scenarios: Scenarios, model: Model | None) -> Look:
        """What it wants to see at z; `model` if it is known."""
        return Look(*(tuner.gradient_of(z, scenarios) if model is None else tuner.weigh(*model)))

    def usable(self, look: Look, baseline: np.ndarray) -> bool:
        """Whether a look with a finite gradient may be stepped from."""
        return True

    def clips(self, norm: float) -> bool:
        """Whether it cuts a gradient of this norm."""
        return False

    def look_rollouts(self, gains: int) -> int:
        """Rollouts of the ensemble that a look costs: of a gradient 1 + its tangents."""
        return 1 + gains

    def step_rollouts(self, state: PyTree, gains: int) -> int:
        """Rollouts that the last step took besides."""
        return 0

    def converged(self, state: PyTree) -> bool:
        """Whether no step worth taking is left."""
        return False

    def note(self, clipped: int) -> str:
        """What a report adds to the number of iterations."""
        return ""

    @classmethod
    def faults(cls, config: Config) -> list[Fault]:
        """Settings that do not suit it."""
        return []

    @classmethod
    def forward(cls, settings: Tune, gains: int) -> bool:
        """Whether gradients in so many gains are taken in forward mode."""
        if cls.jacobian or settings.gradient != "auto":
            return cls.jacobian or settings.gradient == "forward"
        return gains <= MOST_FORWARD


def halfway(p: Progress) -> Array:
    """Half the way back to the last sound point, from a point of no use."""
    return (p.z + p.sound_z) / 2 if bool(jax.numpy.all(jax.numpy.isfinite(p.z))) else p.sound_z
