"""DFC class: differential flatness, the model inverted and the error fed back."""

from __future__ import annotations

from .._pytree import POSITIVE, Real, number, pytree
from ..geometry import turned, wrap
from ..messages import Command, Measurement, Reference
from ..protocols import Law


@pytree
class DFC(Law):
    """Flatness-based control, as a class law: it knows the model and nothing of deadzone or disturbance.

    Attributes:
        kp: gain on the position error.
        kd: gain on the velocity error.
        kpsi: gain on the heading error.
    """

    kp: Real = number(5.0, "1/s^2", POSITIVE, "DFC class")
    kd: Real = number(4.5, "1/s", POSITIVE, "DFC class")
    kpsi: Real = number(5.0, "1/s", POSITIVE, "DFC class")

    tunable = ("kp", "kd", "kpsi")

    def init(self, measurement: Measurement, reference: Reference) -> tuple[()]:
        """No state."""
        return ()

    def law(
        self, flow: tuple[()], memory: tuple[()], measurement: Measurement, reference: Reference
    ) -> tuple[Command, tuple[()]]:
        """Commands before the deadzone."""
        error, error_rate = measurement.position - reference.position, measurement.velocity - reference.velocity
        F = turned(measurement.velocity, measurement.yaw_rate)
        u = reference.acceleration - self.kd * error_rate - self.kp * error - F
        omega = reference.heading_rate - self.kpsi * wrap(measurement.heading - reference.heading)
        return Command(position=u, heading=omega), ()
