"""The timing of a run: step, number of steps, control instants and integrator, as one value."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from jaxtyping import ArrayLike

from .integrate import RK4, Integrator

DT, N_STEPS = 1e-3, 12_000  # s and steps: one lap of the paper's path (reading R10)


def whole(ratio: ArrayLike) -> np.ndarray:
    """Whether ratios of times are whole numbers, at least 1, but for rounding."""
    ratio = np.asarray(ratio, float)
    return np.abs(ratio - np.maximum(np.round(ratio), 1)) <= 1e-6 * ratio


@dataclasses.dataclass(frozen=True, kw_only=True)
class Timing(Mapping[str, Any]):
    """Time stepping of a run, as keywords of `simulate` and `evaluate`: `simulate(law, scenario, **timing)`.

    Raises:
        ValueError: fewer than one step, in total or between two control instants.
        TypeError: not an integrator, but for example its name.
    """

    dt: Any = DT  # s, may be traced
    n_steps: int = N_STEPS
    control_every: int = 1  # steps between control instants
    integrator: Integrator = RK4

    def __post_init__(self) -> None:
        """No tree of JAX's, so it may check itself."""
        counts = self.n_steps, self.control_every
        if min(counts) < 1 or any(count != int(count) for count in counts):
            raise ValueError("n_steps and control_every must be whole, at least 1; got {} and {}".format(*counts))
        if not isinstance(self.integrator, Integrator):
            raise TypeError(f"integrator must be agvjax.RK4, HEUN or EULER; got {self.integrator!r}")

    def __getitem__(self, name: str) -> Any:
        """The value of a keyword."""
        return vars(self)[name]

    def __iter__(self) -> Iterator[str]:
        """The keywords."""
        return iter(vars(self))

    def __len__(self) -> int:
        """Their number."""
        return len(vars(self))
