"""Event-triggered control, the paper's future work: a command is sent only when it has changed enough."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._pytree import NONNEGATIVE, POSITIVE, number, pytree
from ..messages import Command, Measurement, Reference
from .neuro_backstepping import NeuroBackstepping


@pytree
class EventTriggered:
    """Any law, its command of each channel held until it differs by `delta` |held| + `m` from what the law asks for.

    Looked at once every control instant. The interval between two updates is at least m / sup |u'|, so there are never
    infinitely many in finite time. It is not to be tuned by gradient: when a channel updates jumps with the gains.
    Tune `inner` and judge this one.
    """

    inner: Any = NeuroBackstepping()
    delta: float = number(0.1, "1", NONNEGATIVE, "relative threshold")
    m: float = number(0.1, "m/s^2, m/s^2, rad/s", POSITIVE, "absolute threshold", shape=(3,))

    tunable: ClassVar[tuple[str, ...]] = ()

    def init(self, measurement: Measurement, reference: Reference) -> Any:
        """The state of the law inside."""
        return self.inner.init(measurement, reference)

    def hold(self, measurement: Measurement, reference: Reference) -> Command:
        """The first command, sent as it is."""
        return self.inner.law(self.init(measurement, reference), (), measurement, reference)[0]

    def jump(
        self, flow: Any, held: Command, measurement: Measurement, reference: Reference, h: Float[Array, ""]
    ) -> Command:
        """The command in force after this control instant."""
        asked, _ = self.inner.law(flow, (), measurement, reference)
        m = jnp.broadcast_to(self.m, (3,))

        def renewed(new: Array, old: Array, m: Array) -> Array:
            return jnp.where(jnp.abs(new - old) >= self.delta * jnp.abs(old) + m, new, old)

        return Command(
            position=renewed(asked.position, held.position, m[:2]),
            heading=renewed(asked.heading, held.heading, m[2]),
        )

    def law(self, flow: Any, held: Command, measurement: Measurement, reference: Reference) -> tuple[Command, Any]:
        """What is held, and the derivative of the law inside."""
        return held, self.inner.law(flow, (), measurement, reference)[1]

    @property
    def weight_norms(self) -> Callable[[Any], Float[Array, "2"]]:
        """Those of the law inside."""
        return self.inner.weight_norms

    @property
    def fastest(self) -> tuple[str, str]:
        """That of the law inside."""
        return self.inner.fastest

    @property
    def poles(self) -> Callable[[], np.ndarray]:
        """Those of the law inside."""
        return self.inner.poles
