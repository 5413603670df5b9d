"""What the node does in a period, free of ROS: odometry in, a speed and a yaw rate along the exported route out.

It moves only once it was told to, while odometry is fresh and the vehicle within reach of the route.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .driver import Driver


class RouteFollower(Driver):
    """One vehicle, one route. Where it is on that is a state of the law, which lasts while the vehicle stands."""

    what = "route"

    def __init__(self, controller, inputs, period, values, read_route):
        """See `Driver`, and `read_route` of controller.py. Raises ValueError where the file of the route is none."""
        super().__init__(controller, inputs, period, values)
        file = values["route_file"] or Path(__file__).with_name("route.json")
        try:
            self.route = read_route(file)
            reached = self.route["reached"], self.route["legs"]
        except (OSError, ValueError, KeyError) as problem:
            raise ValueError(f"route_file = {file}: must be a route.json of `agvjax export` ({problem})") from problem
        self.reached, self.last = float(reached[0]), int(reached[1]) - 1
        self.driving = False  # whether it was told to

    def order(self, drive):
        """Begin where the route is nearest and goes the vehicle's way, or stop; what is then to be said."""
        before, self.driving = self.driving, bool(drive)
        if drive and before:
            return "it drives already"
        self.controller.state, self.periods, self.clipped = None, 0, 0
        return "" if drive or before else "it stands already"

    def ordered(self):
        """Once it was told to, until the end."""
        return self.driving

    def _give_up(self):
        self.driving = False

    def _drive(self, measurement):
        values, info, begins = self.values, "", self.controller.state is None
        inputs = self.controller.step(measurement, self.route)
        state = self.controller.state
        off = float(np.linalg.norm(measurement["position"] - np.asarray(state["place.position"])))
        if not off <= values["max_error"]:
            raise ValueError(f"{off:.2f} m from where it is on the route, max_error is {values['max_error']:g}")
        if state["place.leg"] >= self.last and state["place.remaining"] <= self.reached:
            self.driving = False
            limited = f"{self.clipped} of {self.periods} limited"
            return self._stop(info=f"route finished, {state['place.remaining']:.3f} m before its end; {limited}")
        if begins:
            info = f"route begun at {state['place.arc']:.2f} m of {float(self.route['length']):.2f}"
        self.moving = True
        return self._sent(inputs, info)

    def _limited(self, speed, yaw_rate):
        """Within the limits, on the curve that the law asks for."""
        values = self.values
        most = values["max_speed"] if speed >= 0 else values["max_reverse_speed"]
        share = min(1.0, most / max(abs(speed), 1e-9), values["max_yaw_rate"] / max(abs(yaw_rate), 1e-9))
        return share * speed, share * yaw_rate
