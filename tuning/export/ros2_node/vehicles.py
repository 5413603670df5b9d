"""From the inputs of a vehicle's actuators to the speed and the yaw rate that `cmd_vel` carries.

A robot that takes a velocity has a speed loop of its own. Where the law asks for accelerations, the velocity that is
commanded is their integral. What the limits of the node leave of a command is what is integrated on from.
"""

from __future__ import annotations

import math

CRAWL = 0.1  # m/s, below which yaw rate and speed say nothing of a steering angle


class Accelerations:
    """Inputs v' [m/s^2] and w' [rad/s^2], of a unicycle."""

    inputs = ("acceleration", "yaw_acceleration")
    parts = ("L",)
    base = {}  # parameters of the node: what the robot's base takes the same numbers of the vehicle for

    def __init__(self, parts):
        """The numbers of the vehicle by their names, those of `parts` among them."""
        self.of, self.L = parts, parts["L"]
        self.speed = self.yaw_rate = 0.0

    def start(self, speed, yaw_rate):
        """Begin at the velocity that is measured [m/s, rad/s]."""
        self.speed, self.yaw_rate = speed, yaw_rate

    def seen(self):
        """What the law measures besides odometry."""
        return {}

    def rates(self, inputs):
        """Accelerations v' and w'."""
        return inputs["acceleration"], inputs["yaw_acceleration"]

    def wanted(self, inputs, period):
        """Speed [m/s] and yaw rate [rad/s] a period [s] later."""
        a, alpha = self.rates(inputs)
        return self.speed + period * a, self.yaw_rate + period * alpha

    def sent(self, speed, yaw_rate):
        """What of it was commanded."""
        self.speed, self.yaw_rate = speed, yaw_rate

    def command(self, speed, yaw_rate, base):
        """What `cmd_vel` must say for the vehicle to have this velocity; `base` has the parameters of that name."""
        return speed, yaw_rate


class Torques(Accelerations):
    """Torques of two driven wheels [Nm]; the accelerations they amount to, friction left to the robot's own loop."""

    inputs = ("torque_left", "torque_right")
    parts = ("L", "mass", "inertia", "wheel_radius", "track")
    base = {"base_track": "track", "base_wheel_radius": "wheel_radius"}

    def rates(self, inputs):
        """Accelerations v' and w'."""
        left, right = inputs["torque_left"], inputs["torque_right"]
        lever = 2 * self.of["wheel_radius"] * self.of["inertia"] / self.of["track"]
        return (right + left) / (self.of["wheel_radius"] * self.of["mass"]), (right - left) / lever

    def command(self, speed, yaw_rate, base):
        """The velocity that the base makes the speeds of these wheels of."""
        radius = base["base_wheel_radius"] / self.of["wheel_radius"]
        return radius * speed, radius * self.of["track"] / base["base_track"] * yaw_rate


class WheelSpeeds(Torques):
    """Speeds of two driven wheels [rad/s], which are a velocity already: nothing is integrated."""

    inputs = ("wheel_speed_left", "wheel_speed_right")
    parts = ("L", "wheel_radius", "track")

    def wanted(self, inputs, period):
        """Speed [m/s] and yaw rate [rad/s]."""
        left = self.of["wheel_radius"] * inputs["wheel_speed_left"]
        right = self.of["wheel_radius"] * inputs["wheel_speed_right"]
        return (left + right) / 2, (right - left) / self.of["track"]


class Steering(Accelerations):
    """Acceleration [m/s^2] and steering rate [rad/s] of a car, both integrated; w = v tan(delta) / L.

    Odometry does not tell the steering angle: the commanded one stands for it, and at the start the one that rolls
    without slip, 0 below a crawl.
    """

    inputs = ("acceleration", "steering_rate")
    parts = ("lf", "lr", "limits.steering_angle")
    base = {"base_wheelbase": "L"}

    def __init__(self, parts):
        """See `Accelerations`; L is the wheelbase."""
        super().__init__({**parts, "L": parts["lf"] + parts["lr"]})
        self.steering_angle = 0.0

    def start(self, speed, yaw_rate):
        """Begin at the velocity that is measured [m/s, rad/s]."""
        self.steering_angle = 0.0
        self.sent(speed, yaw_rate)

    def seen(self):
        """The steering angle [rad]."""
        return {"steering_angle": self.steering_angle}

    def wanted(self, inputs, period):
        """Speed [m/s] and yaw rate [rad/s] a period [s] later."""
        most = self.of["limits.steering_angle"]
        turned = self.steering_angle + period * inputs["steering_rate"]
        self.steering_angle = min(max(turned, -most), most)
        speed = self.speed + period * inputs["acceleration"]
        return speed, speed * math.tan(self.steering_angle) / self.L

    def sent(self, speed, yaw_rate):
        """What of it was commanded; the steering angle is the one that this needs."""
        if abs(speed) > CRAWL:
            most = self.of["limits.steering_angle"]
            self.steering_angle = min(max(math.atan(self.L * yaw_rate / speed), -most), most)
        super().sent(speed, yaw_rate)

    def command(self, speed, yaw_rate, base):
        """The velocity that the base makes this steering angle of."""
        return speed, self.L / base["base_wheelbase"] * yaw_rate


class Twists(Accelerations):
    """Speed [m/s] and yaw rate [rad/s], as a law that follows a route asks for: a velocity already."""

    inputs = ("speed", "yaw_rate")
    parts = ()

    def __init__(self, parts):
        """See `Accelerations`; what is measured is the middle of the fixed axle."""
        super().__init__({**parts, "L": 0.0})

    def wanted(self, inputs, period):
        """Speed [m/s] and yaw rate [rad/s]."""
        return inputs["speed"], inputs["yaw_rate"]


class RimSpeeds(Twists):
    """Speeds of the rims of two driven wheels [m/s]."""

    inputs = ("left", "right")
    parts = ("track",)
    base = {"base_track": "track"}

    def wanted(self, inputs, period):
        """Speed [m/s] and yaw rate [rad/s]."""
        left, right = inputs["left"], inputs["right"]
        return (left + right) / 2, (right - left) / self.of["track"]

    def command(self, speed, yaw_rate, base):
        """The velocity that the base makes the speeds of these rims of."""
        return speed, self.of["track"] / base["base_track"] * yaw_rate


class SteeringAngles(Twists):
    """Speed [m/s] of the fixed axle and angle [rad] of a steered wheel; w = +-v tan(angle) / wheelbase."""

    inputs = ("speed", "steering_angle")
    parts = ("wheelbase",)
    base = {"base_wheelbase": "wheelbase"}

    def wanted(self, inputs, period):
        """Speed [m/s] and yaw rate [rad/s]; the wheel is `behind` where it turns the vehicle the other way."""
        side = -1.0 if self.of["behind"] else 1.0
        return inputs["speed"], side * inputs["speed"] * math.tan(inputs["steering_angle"]) / self.of["wheelbase"]

    def command(self, speed, yaw_rate, base):
        """The velocity that the base makes this steering angle of."""
        return speed, self.of["wheelbase"] / base["base_wheelbase"] * yaw_rate


ON_PATHS = (Accelerations, Torques, WheelSpeeds, Steering)
ON_ROUTES = (Twists, RimSpeeds, SteeringAngles)
VEHICLES = {kind.inputs: kind for kind in (*ON_PATHS, *ON_ROUTES)}
