"""The exported controller of Nav2, compiled against headers that stand for ROS 2 and Nav2, and driven by a server."""

import shutil
from xml.etree import ElementTree

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import yaml

import agvjax
from agvjax import Route, SpeedLimits
from nav2_stub import Server, build, lay_out
from tuning.config.write import gains_table
from tuning.export import artefact, nav2, tables

needs_gcc = pytest.mark.skipif(shutil.which("g++") is None, reason="g++ is not installed")
needs_clang = pytest.mark.skipif(shutil.which("clang++") is None, reason="clang++ is not installed")
PERIOD, TRACK = 0.05, 0.5
BAY = np.array(  # past a bay and backwards into it; speeds say which way
    [[0, 0, 0.5], [1, 0, 0.5], [2, 0, 0.5], [3, 0.15, 0.5], [4, 0.8, 0.5], [5, 2, -0.5],
     [4.3, 1, -0.5], [3.9, 0.3, -0.5], [3.7, -0.5, -0.5], [3.6, -1.5, -0.5], [3.6, -2.5, -0.5]]
)  # fmt: skip
LIMITS = SpeedLimits(acceleration=0.4, deceleration=0.3, lateral_acceleration=0.25)
CONFIG = f"""
[scenario]
plant = "base"
disturbance = "none"
[scenario.path]
type = "route"
points = {BAY.tolist()}
limits = {{ acceleration = 0.4, deceleration = 0.3, lateral_acceleration = 0.25 }}
"""
LAW = agvjax.Sampled(inner=agvjax.PathPID(ahead=0.1), vehicle=agvjax.Base(track=TRACK), period=PERIOD)
START = (0.1, 0.15, 0.3)


def files_of(law, folder, name="drives"):
    (folder / "config.toml").write_text(CONFIG)
    (folder / "gains.toml").write_text(gains_table(law))
    return nav2.files(artefact.read(str(folder / "gains.toml")), name)


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    return files_of(LAW, tmp_path_factory.mktemp("gains"))


@pytest.fixture(scope="module")
def library(package, tmp_path_factory):
    folder = tmp_path_factory.mktemp("package")
    lay_out(folder, package, "drives")
    return build(folder, "drives")


@pytest.fixture
def server(library):
    found = Server(library)
    assert found.configure() == ""
    yield found
    found.library.cleanup()


def headed(rows):
    """Poses (n, 3) with headings along the way from each, turned round where it is driven backwards."""
    way = np.diff(rows[:, :2], axis=0)
    heading = np.arctan2(way[:, 1], way[:, 0]) + np.where(rows[:-1, 2] < 0, np.pi, 0.0)
    return np.column_stack([rows[:, :2], np.append(heading, heading[-1])])


class Vehicle:
    """A base whose wheels lag, by RK4 in steps of 5 ms."""

    def __init__(self, x, y, heading):
        self.state = np.array([x, y, heading, 0.0, 0.0])

    def seen(self):
        x, y, heading, left, right = self.state
        return x, y, heading, (left + right) / 2, (right - left) / TRACK

    def drive(self, speed, yaw_rate, seconds=PERIOD):
        wanted = np.array([speed - yaw_rate * TRACK / 2, speed + yaw_rate * TRACK / 2])

        def rate(state):
            heading, reached = state[2], state[3:]
            v, w = reached.mean(), (reached[1] - reached[0]) / TRACK
            return np.array([v * np.cos(heading), v * np.sin(heading), w, *np.clip((wanted - reached) / 0.15, -1, 1)])

        h = 0.005
        for _ in range(round(seconds / h)):
            a = rate(self.state)
            b = rate(self.state + h / 2 * a)
            c = rate(self.state + h / 2 * b)
            d = rate(self.state + h * c)
            self.state = self.state + h / 6 * (a + 2 * b + 2 * c + d)


def driven(server, vehicle, seconds, age=0.0):
    """Poses (n, 3) before each period and what was sent (n, 2); it must have been sent without complaint."""
    poses, sent = [], []
    for _ in range(round(seconds / PERIOD)):
        v, w, told = server.command(*vehicle.seen(), age)
        assert told == ""
        poses.append(vehicle.state[:3])
        sent.append((v, w))
        vehicle.drive(v, w)
    return np.array(poses), np.array(sent)


# ---- the closed loop


def simulated(points, start, seconds):
    """Poses before each period of the same vehicle in the simulator, along the same points."""
    ideal = agvjax.Deadzone(slope_right=1.0, slope_left=1.0, threshold_right=0.0, threshold_left=0.0)
    scenario = agvjax.Scenario(
        plant=agvjax.Base(track=TRACK),
        deadzone={"left": ideal, "right": ideal},
        disturbance=agvjax.NoDisturbance(),
        path=Route.through(points, limits=LIMITS),
        start=agvjax.Start(position=np.array(start[:2]), velocity=np.zeros(2), heading=start[2]),
    )
    run = agvjax.simulate(LAW, scenario, dt=0.005, n_steps=round(seconds / 0.005), save_every=10)
    return np.column_stack([run.position, run.heading])[:-1]


@needs_gcc
def test_it_drives_as_the_simulator_does_forwards_and_backwards_into_the_bay(server):
    """Over the whole drive of two legs, within 1e-6 m and rad; the plan is the points of the route."""
    assert server.plan(headed(BAY)) == ""
    got, sent = driven(server, Vehicle(*START), 30.0)
    wanted = simulated(BAY, START, 30.0)
    assert np.abs(got - wanted).max() < 1e-6
    print(f"largest difference {np.abs(got - wanted).max():.1e}")
    assert np.linalg.norm(got[-1, :2] - BAY[-1, :2]) < 0.05 and np.all(sent[-5:] == 0.0)
    assert sent[:, 0].min() < -0.3 and "at the end of the plan" in server.said()
