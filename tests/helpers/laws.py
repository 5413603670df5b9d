"""Laws of one's own, which compile quickly."""

import agvjax


@agvjax.pytree
class Proportional(agvjax.Law):
    """A law as a user would write it: plain fields, no rule, no bounds, a gain that may be negative."""

    stiffness: float = 30.0
    damping: float = 8.0
    turn: float = 4.0
    lean: float = -0.1

    def init(self, measurement, reference):
        return ()

    def law(self, flow, memory, measurement, reference):
        e, de = measurement.position - reference.position, measurement.velocity - reference.velocity
        u = reference.acceleration - self.stiffness * e - self.damping * de + self.lean
        turn = reference.heading_rate - self.turn * (measurement.heading - reference.heading)
        return agvjax.Command(position=u, heading=turn), ()
