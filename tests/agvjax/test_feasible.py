"""What following a path takes of a vehicle: figures that can be had otherwise."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import agvjax
from agvjax import Chain, Circle, Deadzone, RateLimit, Saturation, Scenario, SingleTrack, Unicycle
from commands import arguments
from laws import OpenLoop
from tuning import config as configuration
from tuning.cli import main as cli
from tuning.tune import tables


def test_on_a_circle_everything_is_constant_and_known():
    car = SingleTrack()
    R, omega, L = 20.0, 0.3, float(car.L)
    needed = agvjax.demands(Scenario.of(car, path=Circle(radius=R, omega=omega)), 20.0)
    axle = np.sqrt(R**2 - L**2)  # the rear axle runs on a smaller circle
    np.testing.assert_allclose(needed.speed, axle * omega, rtol=1e-5)
    np.testing.assert_allclose(needed.yaw_rate, omega, rtol=1e-5)
    np.testing.assert_allclose(needed.curvature, 1 / R, rtol=1e-9)
    np.testing.assert_allclose(needed.needs["steering_angle"], np.arctan(L / axle), rtol=1e-4)
    for name in ("acceleration", "steering_rate"):
        np.testing.assert_allclose(needed.needs[name], 0, atol=1e-4)


def test_the_paper_path_needs_of_a_unicycle_what_was_measured_elsewhere():
    needed = agvjax.demands(Scenario.of(Unicycle()), 12.0)
    assert np.abs(needed.needs["acceleration"]).max() == pytest.approx(1.60, rel=0.02)
    assert np.abs(needed.needs["yaw_acceleration"]).max() == pytest.approx(2.00, rel=0.02)
    assert np.abs(needed.yaw_rate).max() == pytest.approx(1.76, rel=0.02)
    assert needed.speed.max() == pytest.approx(1.12, rel=0.02)
    assert needed.speed.min() == pytest.approx(-0.03, abs=0.01)


def test_the_car_dumbbell_needs_what_was_measured_elsewhere():
    path = agvjax.Dumbbell(amplitude=40.0, omega=0.1)
    needs = agvjax.demands(Scenario.of(SingleTrack(), path=path), 63.0).needs
    peaks = {name: np.abs(values).max() for name, values in needs.items()}
    assert peaks["steering_angle"] == pytest.approx(0.46, rel=0.1)
    assert peaks["steering_rate"] == pytest.approx(0.20, rel=0.1)
    assert peaks["acceleration"] == pytest.approx(1.3, rel=0.1)
    assert not agvjax.path_warnings(Scenario.of(SingleTrack(), path=path), 63.0)


@agvjax.pytree
class Replay(OpenLoop):
    """Plays what is needed, whatever happens."""

    t: object
    needs: dict

    def inputs(self, t):
        return {name: jnp.interp(t, self.t, values) for name, values in self.needs.items()}


def test_who_is_given_what_is_needed_stays_on_the_path():
    scenario = Scenario.of(Unicycle(), disturbance=agvjax.NoDisturbance())
    idle = dict.fromkeys(Unicycle.actuators, Deadzone())
    needed = agvjax.demands(scenario, 5.0)
    begin = agvjax.paths.heading.reference(scenario.path, None, jnp.array(0.0))
    start = agvjax.Start(position=begin.position, velocity=begin.velocity, heading=needed.heading[0])
    law = Replay(t=jnp.asarray(needed.t), needs={name: jnp.asarray(needed.needs[name]) for name in idle})
    run = agvjax.simulate(law, dataclasses.replace(scenario, deadzone=idle, start=start), n_steps=4000)
    assert np.linalg.norm(run.position - run.reference_position, axis=1).max() < 1e-4


def limited(**elements):
    return Scenario.of(Unicycle(), actuators={"acceleration": Chain(**elements)})


def test_what_is_beyond_the_actuators_is_said_with_figures():
    (said,) = agvjax.path_warnings(limited(stop=Saturation(upper=1.5, lower=-3.0)), 12.0)
    assert said.startswith("acceleration: the path needs 1.6 m/s^2 at t = ")
    assert said.endswith("the vehicle has 1.5 at most")
    assert not agvjax.path_warnings(limited(stop=Saturation(upper=3.0, lower=-3.0)), 12.0)
    (slow,) = agvjax.path_warnings(limited(ramp=RateLimit(rate=1.0)), 12.0)
    assert "changes by 1 at most" in slow
    assert agvjax.path_warnings(agvjax.Scenario(), 12.0) == []  # the paper's plant has independent inputs


def test_what_a_path_takes_of_the_limits_is_said():
    """On a circle at 0.8 m/s and 0.4 rad/s the outer wheel of a base 0.5 m wide rolls at 0.9 m/s."""
    chain = Chain(stop=Saturation(upper=1.2, lower=-1.2))
    base = agvjax.Base(track=0.5)
    circle = Scenario.of(base, path=Circle(radius=2.0, omega=0.4), actuators={"left": chain, "right": chain})
    free = Scenario.of(agvjax.Unicycle(), path=Circle(radius=2.0, omega=0.4))
    said = agvjax.path_needs(circle, 5.0)
    assert "right: 0.9 of 1.2 m/s" in said and "left: 0.7 of 1.2 m/s" in said
    assert agvjax.path_warnings(circle, 5.0) == [] and agvjax.path_needs(free, 5.0) == []


def deliverable(part):
    """The least and the most that is delivered, whatever is asked for."""
    return part.reach(agvjax.Reach())[:2]


def test_a_saturation_before_the_deadzone_delivers_less():
    chain = Chain(stop=Saturation(upper=3.0, lower=-3.0), deadzone=Deadzone(slope_right=0.6, threshold_right=0.5))
    assert deliverable(chain) == (-3.0, pytest.approx(1.5))


def test_a_car_cannot_take_the_corners_of_a_robot():
    said = "\n".join(agvjax.path_warnings(Scenario.of(SingleTrack()), 12.0))
    assert "steering_rate: the path needs" in said
    assert "stand still or reverse" in said


def test_a_path_that_ends_early_is_said():
    path = agvjax.Waypoints.through(np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.5]]), speed=1.0)
    said = agvjax.path_warnings(Scenario.of(Unicycle(), path=path), 12.0)
    assert said[0].startswith("the path ends after 2.")


@pytest.mark.parametrize("stop", [True, False])
def test_a_route_that_comes_to_rest_does_not_stop_at_once(stop):
    limits = agvjax.SpeedLimits(acceleration=0.5, deceleration=0.5, stop=stop)
    route = agvjax.Route.through([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], 1.0, limits=limits)
    said = agvjax.path_warnings(Scenario.of(agvjax.TwistBase(), path=route), 12.0)
    assert said == ([] if stop else ["the path ends after 2 s of 12 s: it stops at once from 1 m/s"])


@pytest.mark.slow
def test_the_command_line_says_it_before_the_run(tmp_path, capsys):
    settings = ["scenario.plant=unicycle", "scenario.actuators.acceleration.saturation.upper=0.2", "simulate.horizon=3"]
    assert cli.main(arguments("simulate", tmp_path / "run", [*settings, "simulate.save_every=100"])) == 0
    said = capsys.readouterr().out
    assert "note: the path cannot be followed exactly: acceleration: the path needs" in said
    assert said.index("note:") < said.index("written to")


def test_the_front_point_of_a_unicycle_on_a_circle_by_hand():
    R, omega, L = 1.0, 0.8, 0.5
    needed = agvjax.demands(Scenario.of(Unicycle(L=L), path=Circle(radius=R, omega=omega)), 10.0)
    np.testing.assert_allclose(needed.speed, omega * np.sqrt(R**2 - L**2), atol=1e-10)
    np.testing.assert_allclose(needed.yaw_rate, omega, atol=1e-10)
    np.testing.assert_allclose(needed.path_speed, omega * R, atol=1e-12)
    np.testing.assert_allclose(needed.heading, omega * needed.t + np.pi / 2 - np.arcsin(L / R), atol=1e-9)
    for name in needed.needs:
        np.testing.assert_allclose(needed.needs[name], 0, atol=1e-8)


@pytest.mark.parametrize("points", [4001, 401])
def test_the_heading_is_that_of_an_integration_that_began_long_ago(points):
    path, L = agvjax.Dumbbell(), 0.5
    needed = agvjax.demands(Scenario.of(Unicycle(L=L)), 12.0, points)

    def turns(t, psi):
        phase = path.omega * t
        x, y = 2 * path.omega * np.cos(2 * phase), path.omega * np.cos(phase)
        return (-x * np.sin(psi) + y * np.cos(psi)) / L

    found = solve_ivp(turns, (-40.0, 12.0), [0.3], t_eval=needed.t, method="DOP853", rtol=1e-11, atol=1e-12)
    assert np.abs(np.sin((needed.heading - found.y[0]) / 2)).max() < (1e-9 if points > 1000 else 1e-5)


def test_a_car_that_is_given_what_it_needs_stays_on_the_path():
    car, path = agvjax.KinematicSingleTrack(), agvjax.Dumbbell(amplitude=40.0, omega=0.1)
    needed = agvjax.demands(Scenario.of(car, path=path), 8.0)
    inputs = [np.interp(needed.t, needed.t, needed.needs[name]) for name in car.actuators]
    psi, v, delta = needed.heading, needed.speed, needed.needs["steering_angle"]
    position = np.asarray(jax.vmap(path)(jnp.asarray(needed.t)))

    def moves(t, state):  # CommonRoad's KS: rear axle, heading, speed, steering angle
        _, _, heading, speed, angle = state
        a, turn = (np.interp(t, needed.t, u) for u in inputs)
        return [speed * np.cos(heading), speed * np.sin(heading), speed * np.tan(angle) / float(car.L), a, turn]

    rear = position[0] - float(car.L) * np.array([np.cos(psi[0]), np.sin(psi[0])])
    begin = [*rear, psi[0], v[0], delta[0]]
    x, y, heading, _, _ = solve_ivp(moves, (0, 8.0), begin, t_eval=needed.t, rtol=1e-8, atol=1e-8, max_step=0.02).y
    front = np.stack([x, y], 1) + float(car.L) * np.stack([np.cos(heading), np.sin(heading)], 1)
    assert np.linalg.norm(front - position, axis=1).max() < 1e-4


def test_what_is_said_is_said_of_the_instant_of_the_peak():
    scenario = limited(stop=Saturation(upper=1.5, lower=-3.0))
    needed = agvjax.demands(scenario, 12.0)
    peak = needed.t[np.argmax(needed.needs["acceleration"])]
    assert f"at t = {peak:.3g} s," in agvjax.path_warnings(scenario, 12.0)[0]
    (low,) = agvjax.path_warnings(limited(stop=Saturation(upper=3.0, lower=-0.5)), 12.0)
    assert low.endswith("the vehicle has -0.5 at least")


@agvjax.pytree
class Ninefold(agvjax.Element):
    def __call__(self, u):
        return 9 * u


def test_what_stands_behind_a_saturation_counts():
    stop = Saturation(upper=2.0, lower=-1.0)
    assert deliverable(Chain(stop=stop, play=agvjax.Backlash(gap=0.4))) == pytest.approx((-0.8, 1.8))
    assert deliverable(Chain(stop=stop, lag=agvjax.Lag(), delay=agvjax.Delay())) == (-1.0, 2.0)
    assert deliverable(Chain(stop=stop, steps=agvjax.Quantisation(step=0.75))) == pytest.approx((-0.75, 2.25))
    assert deliverable(Chain(first=Chain(stop=stop), then=Saturation(upper=5.0, lower=-5.0))) == (-1.0, 2.0)
    assert deliverable(Chain(stop=stop, unknown=Ninefold())) == (-np.inf, np.inf)
    assert deliverable(Deadzone(slope_right=0.6)) == (-np.inf, np.inf)


def test_the_paper_plant_needs_the_acceleration_less_f():
    path = Circle(radius=2.0, omega=0.5)
    scenario = Scenario(path=path, actuators={"position": Chain(stop=Saturation(upper=0.4, lower=-2.0))})
    needs = agvjax.demands(scenario, 20.0).needs
    for name in ("position_x", "position_y"):  # F, turned with the tangent, is the whole centripetal acceleration
        np.testing.assert_allclose(needs[name], 0, atol=1e-12)
    np.testing.assert_allclose(needs["heading"], 0.5, atol=1e-12)
    fixed = dataclasses.replace(scenario, heading=Ahead())  # no turning, no F
    t = agvjax.demands(fixed, 20.0).t
    np.testing.assert_allclose(agvjax.demands(fixed, 20.0).needs["position_x"], -0.5 * np.cos(t / 2), atol=1e-12)
    x, y = agvjax.path_warnings(fixed, 20.0)
    assert x.startswith("position_x: the path needs 0.5 m/s^2") and y.startswith("position_y")


def test_a_circle_smaller_than_the_wheelbase_makes_a_car_reverse():
    said = agvjax.path_warnings(Scenario.of(SingleTrack(), path=Circle(radius=1.0)), 20.0)
    assert "stand still or reverse" in said[0] and "smallest radius is 1 m, the wheelbase 2.58 m" in said[0]
    unicycle = Scenario.of(Unicycle(L=1.5), path=Circle(radius=1.0))
    assert agvjax.demands(unicycle, 20.0).speed.min() < 0  # it may, and follows all the same
    assert agvjax.path_warnings(unicycle, 20.0) == []


@agvjax.pytree
class Ahead(agvjax.Heading):
    def __call__(self, path, t):
        return jnp.zeros_like(t)


@agvjax.pytree
class Parabola(agvjax.Path):
    """From rest; backwards before."""

    def __call__(self, t):
        return jnp.stack([t**2, jnp.zeros_like(t)])


@agvjax.pytree
class Root(agvjax.Path):
    """NaN before 0, endlessly fast at 0."""

    late: float = agvjax.number(0.0, "s")

    def __call__(self, t):
        return jnp.stack([jnp.sqrt(t + self.late), jnp.zeros_like(t)])


def test_a_path_without_a_past_begins_where_it_can():
    needed = agvjax.demands(Scenario.of(Unicycle(), path=Parabola()), 4.0)
    np.testing.assert_allclose(needed.heading, 0, atol=1e-12)
    np.testing.assert_allclose(needed.needs["acceleration"], 2, atol=1e-12)
    needed = agvjax.demands(Scenario.of(Unicycle(), path=Root(late=0.5)), 4.0)
    np.testing.assert_allclose(needed.speed, 0.5 / np.sqrt(needed.t + 0.5), atol=1e-9)
    assert agvjax.path_warnings(Scenario.of(Unicycle(), path=Root()), 4.0) == ["the path is not finite at t = 0 s"]


def test_odd_scenarios_are_left_alone():
    @agvjax.pytree
    class Silent(Unicycle):
        def needs(self, motion):
            return {}

    assert agvjax.demands(Scenario.of(Silent()), 5.0).needs == {}
    scenario = Scenario.of(Silent(), actuators={"acceleration": Chain(stop=Saturation(upper=0.1, lower=-0.1))})
    assert agvjax.path_warnings(scenario, 5.0) == []
    (said,) = agvjax.path_warnings(Scenario(path=None), 5.0)
    assert said.startswith("it could not be looked at (AttributeError")
    assert agvjax.path_warnings(Scenario.of(Unicycle(), path=agvjax.Line(velocity=np.zeros(2))), 5.0) == []
    still = Scenario.of(SingleTrack(), path=agvjax.Line(velocity=np.zeros(2)))
    assert "stand still or reverse" in agvjax.path_warnings(still, 5.0)[0]


def test_the_report_of_a_tuning_says_it_too():
    poor = ["scenario.plant=unicycle", "scenario.actuators.acceleration.saturation.upper=1.0"]
    text = tables.path_of(configuration.load([], poor))
    assert "## The path" in text and "* acceleration: the path needs 1.6 m/s^2" in text
    assert tables.path_of(configuration.load([], [])) == ""
    strong = ["scenario.plant=unicycle", "scenario.actuators.acceleration.saturation.upper=3.2"]
    strong += ["scenario.actuators.acceleration.saturation.lower=-3.2"]
    assert "can follow it" not in text
    assert "acceleration: 1.6 of 3.2 m/s^2" in tables.path_of(configuration.load([], strong))


@pytest.mark.parametrize("behind", [False, True])
def test_a_corner_that_is_tighter_than_the_wheel_turns_is_said(behind):
    """On a circle of 0.5 m, with 1.2 m from axle to axle, the wheel must stand at atan(2.4) = 1.176 rad."""
    ring = agvjax.Route.along(agvjax.Circle(radius=0.5, omega=0.4))
    vehicle = agvjax.Ackermann(wheelbase=1.2, largest_angle=1.0, behind=behind)
    (said,) = agvjax.path_warnings(Scenario.of(vehicle, path=ring), 10.0)
    assert (
        "steering_angle: the path needs" in said
        and "1.18 rad" in said
        and ("has 1 at most" in said or "has -1 at least" in said)
    )
    wide = agvjax.Ackermann(wheelbase=1.2, largest_angle=1.2, behind=behind)
    assert not agvjax.path_warnings(Scenario.of(wide, path=ring), 10.0)


def test_what_a_vehicle_does_not_say_is_not_taken_for_a_path_that_cannot_be_followed():
    @agvjax.pytree
    class Silent(Unicycle):
        def needs(self, motion):
            return {}

    path = Circle(radius=1.0, omega=0.8)
    assert not agvjax.path_warnings(Scenario.of(Silent(), path=path), 10.0)
    assert agvjax.path_unchecked(Scenario.of(Silent(), path=path), 10.0).startswith("Silent does not say")
    assert not agvjax.path_unchecked(Scenario.of(Unicycle(), path=path), 10.0)
