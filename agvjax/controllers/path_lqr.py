"""A linear-quadratic regulator in the route's own frame, its gains scheduled on speed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._pytree import NONNEGATIVE, POSITIVE, Real, number, pytree
from ..messages import Measurement
from ..paths.place import Place
from ..paths.route import Route
from .following import REGULATION, Regulated, path_errors


@pytree
class PathLQR(Regulated):
    """kappa = kappa_d(s + |v| ahead) - k_y(|v|) e - k_psi(|v|) e_psi, gains between nodes of speed interpolated.

    `PathLQR.designed` solves for the gains at the nodes: e' = v e_psi, e_psi' = v u, with u the curvature added to
    the route's, held for a period, at the least integral over the way of q_y e^2 + q_psi e_psi^2 + r u^2.

    Attributes:
        speeds: speeds that the gains are for, rising.
        k_y: gain on the deviation at each of the speeds.
        k_psi: gain on the heading error at each of the speeds.
        scale_y: factor on all k_y, which is tuned instead of them.
        scale_psi: factor on all k_psi, which is tuned instead of them.
        ahead: how early the route's curvature is used, to make up for delay and lag.
    """

    speeds: Any = number((0.2, 0.4, 0.8, 1.6), "m/s, of the nodes, rising", POSITIVE, shape=(None,))
    k_y: Any = number((3.0, 3.0, 2.8, 2.4), "1/m^2", POSITIVE, shape=(None,))
    k_psi: Any = number((3.3, 3.2, 3.0, 2.8), "1/m", POSITIVE, shape=(None,))
    scale_y: Real = number(1.0, "1", POSITIVE)
    scale_psi: Real = number(1.0, "1", POSITIVE)
    ahead: Real = number(0.2, "s", NONNEGATIVE)

    tunable = ("scale_y", "scale_psi", "ahead", *REGULATION)

    @classmethod
    def designed(
        cls,
        period: float,
        *,
        q_y: float = 10.0,
        q_psi: float = 1.0,
        r: float = 1.0,
        speeds: Sequence[float] | np.ndarray = (0.2, 0.4, 0.8, 1.6),
        **fields: Any,
    ) -> PathLQR:
        """The law with gains of the discrete Riccati equation at each speed.

        Args:
            period: of the control [s].
            q_y: weight of the deviation [1/m^2].
            q_psi: weight of the heading error [1/rad^2].
            r: weight of the curvature [m^2].
            speeds: nodes [m/s], > 0 and rising.
            fields: other fields of the law.

        Raises:
            ValueError: a number that is not finite and > 0, or speeds that do not rise.
        """
        nodes = np.atleast_1d(np.asarray(speeds, float))
        weights = {"period": period, "q_y": q_y, "q_psi": q_psi, "r": r}
        for name, value in weights.items():
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be finite and > 0; got {value}")
        if nodes.ndim != 1 or not np.all(np.isfinite(nodes)) or np.any(np.diff(nodes, prepend=0.0) <= 0):
            raise ValueError(f"speeds must be > 0 and rise; got {nodes.tolist()}")
        gains = np.array([_riccati(v * period, q_y, q_psi, r) for v in nodes])
        return cls(speeds=nodes, k_y=gains[:, 0], k_psi=gains[:, 1], **fields)

    def steer(
        self, own: tuple[()], place: Place, route: Route, measurement: Measurement, period: Real
    ) -> tuple[Float[Array, "2"], tuple[()]]:
        """Twist."""
        e, e_psi, speed = path_errors(place, measurement)
        pace = jnp.abs(speed)
        later = route.at(place.arc + pace * self.ahead, place.leg)
        k_y, k_psi = (_between(pace, jnp.asarray(self.speeds), jnp.asarray(k)) for k in (self.k_y, self.k_psi))
        curvature = later.curvature - self.scale_y * k_y * e - self.scale_psi * k_psi * e_psi
        return self.twist(self.regulated(place.speed, curvature), place.sign, curvature), ()


def _between(x: Array, nodes: Array, values: Array) -> Array:
    """The values between the nodes on straight lines, beyond them the last; as a sum, which needs no search."""
    lengths = nodes[1:] - nodes[:-1]
    return values[0] + jnp.sum(jnp.clip(x - nodes[:-1], 0.0, lengths) / lengths * (values[1:] - values[:-1]))


def _riccati(step: float, q_y: float, q_psi: float, r: float) -> np.ndarray:
    """Gains on e and e_psi of a vehicle that goes `step` [m] in a period, its curvature held."""
    from scipy.linalg import solve_discrete_are  # late: a second that few runs need

    A, B = np.array([[1.0, step], [0.0, 1.0]]), np.array([[step**2 / 2], [step]])
    P = solve_discrete_are(A, B, np.diag([q_y, q_psi]) * step, np.array([[r]]) * step)
    return np.linalg.solve(r * step + B.T @ P @ B, B.T @ P @ A)[0]
