"""A law of one's own: acceleration and turning rate of the path, with feedback on the errors.

agvjax simulate --import my_law.py --set controller=Feedforward
agvjax tune --import my_law.py --set controller=Feedforward
"""

import agvjax


@agvjax.pytree
class Feedforward(agvjax.Law):
    """Feedforward with proportional and derivative feedback; it knows of no deadzone and no disturbance."""

    kp: float = agvjax.number(9.0, "1/s^2", agvjax.POSITIVE)
    kd: float = agvjax.number(6.0, "1/s", agvjax.POSITIVE)
    kpsi: float = agvjax.number(5.0, "1/s", agvjax.POSITIVE)

    heading_gains = ("kpsi",)  # not tuned where the heading cannot be commanded

    def init(self, measurement, reference):
        """No state."""
        return ()

    def law(self, flow, memory, measurement, reference):
        """Accelerations (2,) [m/s^2] and yaw rate [rad/s] to ask for, and the derivative of no state."""
        error = measurement.position - reference.position
        rate = measurement.velocity - reference.velocity
        turned = agvjax.wrap(measurement.heading - reference.heading)
        position = reference.acceleration - self.kp * error - self.kd * rate
        return agvjax.Command(position=position, heading=reference.heading_rate - self.kpsi * turned), ()
