"""The MuJoCo robot behind wheel-speed controllers with a deadzone: recorded, identified, and its deadzone inverted."""

import json

import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
import commands
import recorded
from tuning import config as configuration

pytestmark = pytest.mark.slow
pytest.importorskip("mujoco")

from tuning.studies.vehicles.robot import Robot  # noqa: E402

RIGHT, LEFT = {"left": 0.05, "right": 0.06}, {"left": -0.055, "right": -0.045}  # m/s of wheel speed, by wheel
GAIN, RATE = 1.2, 12.0  # Nm per rad/s and per rad of a wheel: PI control in its motor driver, at the physics' 1 kHz


class Base:
    """A robot that is sent its wheels' speeds [m/s], of which the motor drivers lose the small ones."""

    def __init__(self):
        self.robot, self.behind = Robot(), np.zeros(2)
        self.robot.L = 0.0  # seen at the middle of its axle

    def drive(self, asked, count):
        """A count of milliseconds at these speeds (2,)."""
        wanted = np.array([self.delivered(wheel, u) for wheel, u in zip(("left", "right"), asked, strict=True)])
        for _ in range(count):
            turning = [float(self.robot.data.joint(wheel).qvel[0]) for wheel in ("left", "right")]
            lacks = wanted / self.robot.wheel_radius - np.array(turning)
            self.behind = np.clip(self.behind + RATE * lacks * self.robot.timestep, -3.0, 3.0)
            self.robot.step(*np.clip(GAIN * lacks + self.behind, -4.0, 4.0))

    def seen(self):
        """Pose, speed and yaw rate (5,)."""
        place, velocity, heading, w = self.robot.pose()
        return np.array([*place, heading, velocity[0] * np.cos(heading) + velocity[1] * np.sin(heading), w])

    @staticmethod
    def delivered(wheel, u):
        return max(u - RIGHT[wheel], 0.0) + min(u - LEFT[wheel], 0.0)


def excited(seconds=100.0):
    """Twists at 20 Hz, held for a second, a third of them small; what the robot does, at 50 Hz."""
    random, base = np.random.default_rng(4), Base()
    told, seen = np.zeros((round(1000 * seconds), 2)), []
    for begin in range(0, len(told), 1000):
        size = (0.13, 0.35) if random.random() < 0.4 else (0.5, 1.2)
        told[begin : begin + 1000] = random.uniform(-1, 1, 2) * size
    track = base.robot.track
    for i in range(0, len(told), 10):  # the twist is read every 10 ms
        if i % 20 == 0:
            seen.append(base.seen())
        v, w = told[i]
        base.drive((v - w * track / 2, v + w * track / 2), 10)
    noise = random.normal(0, [0.001, 0.001, 0.001, 0.003, 0.003], (len(seen), 5))
    return told, np.array(seen) + noise, track


def smallest(send):
    """The smallest demand [m/s] at both wheels that moves the robot, by bisection; `send` makes a command of it."""
    low, high = 0.0, 0.2
    while high - low > 5e-4:
        middle, base = (low + high) / 2, Base()
        before = base.seen()[0]
        base.drive(send(middle), 1500)
        low, high = (low, middle) if base.seen()[0] - before > 1e-3 else (middle, high)
    return high


def test_a_recorded_deadzone_is_found_and_its_inverse_moves_the_robot(tmp_path):
    told, measured, track = excited()
    recorded.write(tmp_path / "drive", "MCAP", told, measured)
    small = ["identify.drives=0", "identify.bootstrap=200", f"scenario.plant.track={track}"]
    fit = "deadzone,delay,vehicle,plant.track"
    line = commands.arguments("identify", tmp_path / "out", small, "--config", "base", "--fit", fit, tmp_path / "drive")
    commands.run(line)
    found = json.loads((tmp_path / "out" / "estimates.json").read_text())["parameters"]
    for wheel in ("left", "right"):
        for side, true in (("right", RIGHT), ("left", LEFT)):
            name = f"deadzone.{wheel}.threshold_{side}"
            assert found[name]["value"] == pytest.approx(abs(true[wheel]), rel=0.05), name
    zones = configuration.load([str(tmp_path / "out" / "scenario.toml")], []).scenario.deadzone
    inverse = agvjax.Inverse(believed=zones)

    def sent(demand):
        commands_ = inverse.inverted({wheel: jnp.asarray(demand) for wheel in ("left", "right")})
        return tuple(float(commands_[wheel]) for wheel in ("left", "right"))

    # as it is the robot stands until its wheels are asked for more than their thresholds
    assert smallest(lambda demand: (demand, demand)) == pytest.approx(RIGHT["left"], abs=0.004)
    # with the inverse a demand beyond its quiet part moves it, by what is asked
    quiet = float(inverse.quiet) * RIGHT["right"]
    assert smallest(sent) < 3 * quiet
    base = Base()
    base.drive(sent(0.03), 1500)
    assert base.seen()[3] == pytest.approx(0.03, rel=0.1)
