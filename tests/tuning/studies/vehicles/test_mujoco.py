"""The project's vehicles against MuJoCo, which knows nothing of their equations."""

import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

mujoco = pytest.importorskip("mujoco")

import agvjax  # noqa: E402
from agvjax.plants import RollingState  # noqa: E402
from laws import PERIOD, Sent, recorded  # noqa: E402
from tuning.studies.vehicles.robot import Robot  # noqa: E402

L = 0.15  # m
LASTING = 10.0  # s
SPEED, YAW_RATE = 2.0, 0.3  # m/s, rad/s, at the start of the drive

PLANAR = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <body>
      <joint type="slide" axis="1 0 0"/>
      <joint type="slide" axis="0 1 0"/>
      <joint type="hinge" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="1.3" diaginertia="0.5 0.5 0.7"/>
      <site name="point" pos="{L} 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""


def along_and_across(heading):
    """Rotation R(psi) from the body's axes to those of the plane."""
    return np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])


def test_acceleration_of_the_reference_point_is_that_of_the_paper():
    """Eqs. (1)-(4): a body that a sideways force m v w keeps from slipping, pushed by m v' and turned by I w'."""
    model = mujoco.MjModel.from_xml_string(PLANAR.format(L=0.5))
    data = mujoco.MjData(model)
    rng, worst = np.random.default_rng(3), 0.0
    for x, y, heading, v, w, a, alpha in rng.uniform(-4, 4, (200, 7)):
        data.qpos[:] = x, y, heading
        data.qvel[:] = v * np.cos(heading), v * np.sin(heading), w
        data.qfrc_applied[:2] = 1.3 * along_and_across(heading) @ [a, v * w]
        data.qfrc_applied[2] = 0.7 * alpha
        found = np.zeros(6)
        mujoco.mj_forward(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_SITE, 0, found, 0)
        F = [
            -v * w * np.sin(heading) - 0.5 * w**2 * np.cos(heading),
            v * w * np.cos(heading) - 0.5 * w**2 * np.sin(heading),
        ]
        U = along_and_across(heading) @ [a, 0.5 * alpha]
        worst = max(worst, np.max(np.abs(found[3:5] - U - F)))
    assert worst < 1e-10  # m/s^2, beside accelerations up to 20


def test_the_sideways_force_is_what_keeps_the_body_from_slipping():
    """The other half of eq. (1): with that force the velocity stays along the heading while the body moves."""
    model = mujoco.MjModel.from_xml_string(PLANAR.format(L=0.5))
    model.opt.timestep, model.opt.integrator = 1e-3, mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)

    def push(model, data):
        (dx, dy, w), heading = data.qvel, data.qpos[2]
        v = dx * np.cos(heading) + dy * np.sin(heading)
        data.qfrc_applied[:2] = 1.3 * along_and_across(heading) @ [np.cos(3 * data.time), v * w]
        data.qfrc_applied[2] = 0.7 * np.sin(2 * data.time)

    mujoco.set_mjcb_control(push)
    try:
        data.qvel[0] = 1.0
        mujoco.mj_step(model, data, 5000)
    finally:
        mujoco.set_mjcb_control(None)
    sideways = data.qvel[1] * np.cos(data.qpos[2]) - data.qvel[0] * np.sin(data.qpos[2])
    assert abs(data.qpos[2]) > 1 and abs(sideways) < 1e-9


def torques(t):
    """Left and right [Nm]: 1 to 3.5 m/s, turning both ways, sideways up to 3.6 m/s^2."""
    common = 0.5 * np.cos(1.1 * t) + 0.35 * np.cos(2.9 * t) + 0.15 * np.sin(0.5 * t) - 0.03
    turning = 0.08 * np.cos(0.8 * t + 0.5) + 0.06 * np.sin(2.3 * t)
    return common - turning, common + turning


def drive(robot):
    """Reference point (n, 2) [m] after every step of the physics, first the start."""
    robot.reset((0.3, -0.2), along_and_across(0.4) @ [SPEED, L * YAW_RATE], 0.4, L)
    h = robot.timestep
    points = [robot.pose()[0]]
    for k in range(round(LASTING / h)):
        robot.step(*torques((k + 0.5) * h))
        points.append(robot.pose()[0])
    return np.array(points)


def analytic(robot, **friction):
    """The same drive of `DifferentialDrive` with the robot's mass and inertia, by SciPy."""
    plant = agvjax.DifferentialDrive(
        mass=robot.effective_mass,
        inertia=robot.effective_inertia,
        wheel_radius=robot.wheel_radius,
        track=robot.track,
        L=L,
        **({"friction": 0.0, "viscous": 0.0} | friction),
    )

    @jax.jit
    def rate(y, left, right):
        state = RollingState(position=y[:2], heading=y[2], speed=y[3], yaw_rate=y[4])
        rates = plant.derivative(state, (), {"torque_left": left, "torque_right": right}, jnp.zeros(3))
        return jnp.stack([*rates.position, rates.heading, rates.speed, rates.yaw_rate])

    times = np.linspace(0, LASTING, round(LASTING / robot.timestep) + 1)
    found = solve_ivp(
        lambda t, y: np.asarray(rate(y, *torques(t))),
        (0, LASTING),
        [0.3, -0.2, 0.4, SPEED, YAW_RATE],
        t_eval=times,
        rtol=1e-8,
        atol=1e-9,
    )
    return found.y.T


def apart(one, other):
    """Largest distance between two points at one time [m]."""
    return float(np.max(np.linalg.norm(one - other, axis=1)))


def test_wheels_on_a_floor_move_as_the_analytic_plant(record_property):
    robot = Robot(friction=False)
    expected = analytic(robot)
    points, plane = drive(robot), expected[:, :2]
    length = float(np.sum(np.linalg.norm(np.diff(plane, axis=0), axis=1)))
    rough = Robot()
    slowed, (coulomb, viscous) = drive(rough), rough.wheel_friction()
    error, with_friction = apart(points, plane), apart(slowed, plane)
    matched = apart(slowed, analytic(rough, friction=coulomb, viscous=viscous)[:, :2])
    found = {"length": length, "frictionless": error, "with_friction": with_friction, "friction_matched": matched}
    for name, value in found.items():
        record_property(name, value)
    print("\n[m]", {name: round(value, 4) for name, value in found.items()})
    assert length > 18 and np.ptp(expected[:, 4]) > 1 and np.min(expected[:, 3]) > 0.2  # a drive worth the name
    assert error < 0.005 * length
    assert with_friction > 0.05 * length
    assert matched < 0.2 * with_friction


@pytest.mark.parametrize("straight", [True, False])
def test_it_coasts_as_the_friction_it_states_says(straight):
    """M v' = -2 (coulomb + viscous v / R) / R, and for the yaw rate alike, for two seconds."""
    robot = Robot()
    coulomb, viscous = robot.wheel_friction()
    robot.reset((0.0, 0.0), (2.0, 0.0) if straight else (0.0, 6.0 * L), 0.0, L)
    lever, inertia = (0.1, robot.effective_mass) if straight else (0.1 / 0.17, robot.effective_inertia)
    speed = np.array([robot.pose()[1][0] if straight else robot.pose()[3]])
    for _ in range(20):
        robot.step(0.0, 0.0, 100)
        speed = np.append(speed, robot.pose()[1][0] if straight else robot.pose()[3])
    fall = 2 * viscous / (lever**2 * inertia)  # 1/s
    least = coulomb * lever / viscous  # what the exponential would fall below zero by
    expected = (speed[0] + least) * np.exp(-fall * 0.1 * np.arange(speed.size)) - least
    assert expected[-1] < 0.6 * speed[0]
    np.testing.assert_allclose(speed, expected, atol=0.01 * speed[0])


def test_its_centre_of_mass_is_above_the_axle_and_its_masses_are_what_they_are_said_to_be():
    robot = Robot()
    model, data = robot.model, robot.data
    robot.reset((L, 0.0), (0.0, 0.0), 0.0, L)
    np.testing.assert_allclose(data.subtree_com[1][:2], 0, atol=1e-9)
    np.testing.assert_allclose(robot.generalised_mass(), np.diag([12.7, 0.3294]), atol=1e-4)
    np.testing.assert_allclose(np.sum(model.body_mass), 9.9)
    spin = 2 * (0.004 + 0.010)  # kg m^2, both wheels with their rotors
    np.testing.assert_allclose(robot.effective_mass, 9.9 + spin / 0.1**2)
    yaw = 0.204 + 2 * (0.002 + 0.6 * 0.17**2) + 2 * (0.00003 + 0.1 * 0.17**2)
    np.testing.assert_allclose(robot.effective_inertia, yaw + spin * (0.17 / 0.1) ** 2)


@pytest.mark.parametrize("friction", [True, False])
def test_it_stands_where_it_is_put(friction):
    robot = Robot(friction=friction)
    robot.reset((1.5, -2.0), (0.0, 0.0), 9.0, L)
    position, velocity, heading, yaw_rate = robot.pose()
    np.testing.assert_allclose([*position, *velocity, heading, yaw_rate], [1.5, -2.0, 0, 0, 9.0, 0], atol=1e-12)
    robot.step(0.0, 0.0, round(1 / robot.timestep))
    assert np.linalg.norm(robot.pose()[0] - position) < 1e-3
    assert abs(robot.pose()[2] - 9.0) < 1e-3


def test_it_starts_rolling_and_does_not_bounce():
    robot = Robot(friction=False)
    velocity = along_and_across(2.0) @ [1.2, L * 0.5]
    robot.reset((1.5, -2.0), velocity, 2.0, L)
    np.testing.assert_allclose(np.concatenate(robot.pose()[:2]), [1.5, -2.0, *velocity], atol=1e-12)
    height = []
    for _ in range(200):
        robot.step(0.0, 0.0)
        height.append(robot.data.joint("z").qpos[0])
    assert np.ptp(height) < 1e-5
    after, turned = robot.pose()[1:3]
    np.testing.assert_allclose(along_and_across(turned).T @ after, [1.2, L * 0.5], atol=2e-3)  # it slips a little


def test_its_motors_have_limits():
    ends = []
    for torque in (4.0, 100.0):
        robot = Robot()
        robot.reset((0.0, 0.0), (0.0, 0.0), 0.0, L)
        robot.step(-torque, torque, 200)
        ends.append([*np.concatenate(robot.pose()[:2]), *robot.pose()[2:]])
        np.testing.assert_array_equal(robot.data.actuator_force, [-4, 4])
    np.testing.assert_array_equal(*ends)
    assert ends[0][2] != 0  # it did move


def test_without_mujoco_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ImportError, match=r"pip install 'agvjax\[vehicles\]'"):
        Robot()


# ----------------------------------------------------------------------------------------------- sent wheel speeds


class Motors:
    """Controllers of the robot's two wheels: a deadzone, a delay, a set point that lags and ramps, a loop of 20 ms."""

    def __init__(self, robot, zones, delay, lag, ramp):
        self.robot, self.zones, self.lag, self.ramp = robot, zones, lag, ramp
        self.sent = [(0.0, 0.0)] * round(delay / robot.timestep)
        self.set_point, self.integral = np.zeros(2), np.zeros(2)

    def step(self, wheels):
        """Wheel speeds [m/s] sent for one step of the physics."""
        robot, h = self.robot, self.robot.timestep
        self.sent.append(wheels)
        asked = np.array([zone(float(c)) for zone, c in zip(self.zones, self.sent.pop(0), strict=True)])
        self.set_point = self.set_point + h * np.clip((asked - self.set_point) / self.lag, -self.ramp, self.ramp)
        _, velocity, heading, w = robot.pose()
        turn = w * robot.track / 2
        error = self.set_point - (velocity @ [np.cos(heading), np.sin(heading)] + np.array([-turn, turn]))
        push = robot.effective_mass / 2 * robot.wheel_radius / 0.02 * error  # a time constant of 20 ms
        self.integral = self.integral + push * h / 0.1
        robot.step(*(push + self.integral))


def dead(slope_right, slope_left, right, left):
    """Eq. (11) of one wheel."""
    return lambda c: slope_right * max(c - right, 0.0) + slope_left * min(c + left, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(("lag", "ramp", "turn"), [(0.15, 1.0, 0.5), (0.08, 0.6, 1.5)])
def test_a_base_is_what_a_robot_with_speed_loops_is(lag, ramp, turn):
    """Within 5 mm and 10 mrad after 3.7 m and up to 3 rad of turning: what speed loops and rolling lose."""
    numbers = {"left": (0.95, 0.9, 0.06, 0.04), "right": (1.0, 0.85, 0.03, 0.09)}
    robot = Robot(L=1e-9)  # seen at its axle
    robot.reset((0.0, 0.0), (0.0, 0.0), 0.0)
    motors = Motors(robot, [dead(*n) for n in numbers.values()], 0.08, lag, ramp)
    twists = np.repeat(recorded(turn=turn), 4, axis=0)
    poses = []
    for k in range(10_000):
        if k % 50 == 0:
            position, _, heading, _ = robot.pose()
            poses.append((*position, heading))
        v, w = twists[k // round(PERIOD / robot.timestep)]
        motors.step((v - w * robot.track / 2, v + w * robot.track / 2))
    scenario = agvjax.Scenario(
        plant=agvjax.Base(track=robot.track, time_constant=lag, acceleration=ramp),
        deadzone={
            name: agvjax.Deadzone(slope_right=a, slope_left=b, threshold_right=c, threshold_left=d)
            for name, (a, b, c, d) in numbers.items()
        },
        actuators={name: agvjax.Chain(delay=agvjax.Delay(time=0.08, slots=4)) for name in numbers},
        disturbance=agvjax.NoDisturbance(),
        start=agvjax.Start(position=np.zeros(2), heading=0.0),
    )
    run = agvjax.simulate(Sent(twists=twists), scenario, dt=1e-3, n_steps=9950, save_every=50)
    poses, position = np.array(poses), np.asarray(run.position)
    assert np.abs(np.diff(position, axis=0)).sum() > 3 and np.ptp(poses[:, 2]) > 0.3
    assert np.linalg.norm(position - poses[:, :2], axis=1).max() < 5e-3
    assert np.abs(np.asarray(run.heading) - poses[:, 2]).max() < 0.01
