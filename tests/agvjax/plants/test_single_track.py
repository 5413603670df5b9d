"""Cars: against the package of CommonRoad, against differences, and against what tyres and roads must do."""

import dataclasses
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from scipy.integrate import solve_ivp

import agvjax
from agvjax import RK4, Command, FrictionPatch, KinematicSingleTrack, LinearTyre, SaturatingTyre, SingleTrack, Start
from agvjax.leaves import cast
from agvjax.plants import KinematicState, SingleTrackState

pytest.importorskip("vehiclemodels")
from vehiclemodels.vehicle_dynamics_ks import vehicle_dynamics_ks  # noqa: E402
from vehiclemodels.vehicle_dynamics_st import vehicle_dynamics_st  # noqa: E402
from vehiclemodels.vehicle_parameters import setup_vehicle_parameters  # noqa: E402

NAMES = {"ford_escort": 1, "bmw_320i": 2, "vw_vanagon": 3}
CALM = jnp.zeros(3)
STIFF = 4.718  # 1/rad


def published(name, stiffness=STIFF):
    """CommonRoad's own parameters; for the scale car, which is not among them, built of what f1tenth_gym prints."""
    if name in NAMES:
        return setup_vehicle_parameters(vehicle_id=NAMES[name])
    space = types.SimpleNamespace
    tire = space(p_dy1=1.0489, p_ky1=-1.0489 * stiffness)
    steering = space(min=-0.4189, max=0.4189, v_min=-3.2, v_max=3.2)
    drive = space(a_max=9.51, v_min=-5.0, v_max=20.0, v_switch=7.319)
    body = {"a": 0.15875, "b": 0.17145, "h_s": 0.074, "m": 3.74, "I_z": 0.04712}
    return space(**body, tire=tire, steering=steering, longitudinal=drive)


def made(name, stiffness=STIFF):
    plant = getattr(SingleTrack, name)()
    if name in NAMES:
        return plant
    return dataclasses.replace(plant, tyre=LinearTyre(stiffness_front=stiffness, stiffness_rear=stiffness))


def kinematic(x, kind=KinematicState, **more):
    """A state of ours from CommonRoad's vector; inputs are theirs too: steering rate, acceleration."""
    return kind(position=x[:2], steering_angle=x[2], speed=x[3], heading=x[4], **more)


def dynamic(x):
    return kinematic(x, SingleTrackState, yaw_rate=x[5], slip_angle=x[6])


def state_of(car, x):
    return kinematic(x) if isinstance(car, KinematicSingleTrack) else dynamic(x)


def vector(state):
    return jnp.concatenate([jnp.atleast_1d(getattr(state, f.name)) for f in dataclasses.fields(state)])


def rate(plant, state, u, disturbance=CALM):
    return plant.derivative(state, (), {"steering_rate": u[0], "acceleration": u[1]}, disturbance)


rates = jax.jit(lambda plant, xs, us: jax.vmap(lambda x, u: vector(rate(plant, dynamic(x), u)))(xs, us))
rolls = jax.jit(lambda plant, xs, us: jax.vmap(lambda x, u: vector(rate(plant, kinematic(x), u)))(xs, us))


def draw(p, n, seed=0):
    """States and inputs up to beyond every limit; a third of them crawl, some stand exactly at a limit."""
    rng = np.random.default_rng(seed)
    steer, drive = p.steering, p.longitudinal
    x = rng.uniform(-1, 1, (n, 7)) * [50, 50, 1.1 * steer.max, 0, 7, 2, 0.5]
    x[:, 3] = rng.uniform(1.1 * drive.v_min, 1.1 * drive.v_max, n)
    x[: n // 3, 3] = rng.uniform(-0.15, 0.15, n // 3)
    x[n // 3 : n // 2, 3] = rng.uniform(-drive.v_switch, 2 * drive.v_switch, n // 2 - n // 3)
    u = rng.uniform(-1.6, 1.6, (n, 2)) * [steer.v_max, drive.a_max]
    x[-10:, 2], x[-20:-10, 3], x[-30:-20, 3] = steer.max, drive.v_max, drive.v_min
    x[-40:-30, 3], x[-50:-40, 3], x[-60:-50, 3], u[-70:-60] = 0.1, -0.1, 0.0, 0.0
    x[-80:-70, 2] = steer.min
    return x, u


@pytest.mark.parametrize("name", [*NAMES, "f1tenth"])
def test_derivatives_are_commonroads(name):
    p = published(name)
    x, u = draw(p, 3000)
    theirs = np.array([vehicle_dynamics_st(a, b, p) for a, b in zip(x, u, strict=True)])
    np.testing.assert_allclose(rates(made(name), x, u), theirs, rtol=1e-10, atol=1e-11)
    theirs = np.array([vehicle_dynamics_ks(a, b, p) for a, b in zip(x[:, :5], u, strict=True)])
    np.testing.assert_allclose(rolls(getattr(KinematicSingleTrack, name)(), x[:, :5], u), theirs, rtol=1e-10)


def test_sets_hold_the_published_numbers():
    for name in NAMES:
        p, plant = published(name), made(name)
        mine = [plant.lf, plant.lr, plant.height, plant.mass, plant.inertia, plant.tyre.mu]
        assert mine == [p.a, p.b, p.h_s, p.m, p.I_z, p.tire.p_dy1]
        for stiffness in (plant.tyre.stiffness_front, plant.tyre.stiffness_rear):
            assert stiffness == pytest.approx(-p.tire.p_ky1 / p.tire.p_dy1, rel=1e-15)
        for limits in (plant.limits, getattr(KinematicSingleTrack, name)().limits):
            turning = [-limits.steering_angle, limits.steering_angle, -limits.steering_rate, limits.steering_rate]
            assert turning == [p.steering.min, p.steering.max, p.steering.v_min, p.steering.v_max]
            drive = p.longitudinal
            driving = [limits.acceleration, limits.backward, limits.forward, limits.switch]
            assert driving == [drive.a_max, drive.v_min, drive.v_max, drive.v_switch]
        assert not agvjax.faults(plant)
    with pytest.raises(TypeError):
        SingleTrack.ford_escort(weight=1.0)
    assert isinstance(SingleTrack.ford_escort(tyre=SaturatingTyre()).tyre, SaturatingTyre)


def test_each_axle_has_its_own_stiffness():
    # of CommonRoad with one stiffness for both, the force of the front axle, and with another, of the rear one
    p, (x, u) = published("f1tenth"), draw(published("f1tenth"), 600, seed=3)
    moving = np.abs(x[:, 3]) >= 0.1
    x, u = x[moving], u[moving]

    def forces(stiffness):
        p = published("f1tenth", stiffness)
        found = np.array([vehicle_dynamics_st(a, b, p) for a, b in zip(x, u, strict=True)])
        moment, total = p.I_z * found[:, 5], p.m * x[:, 3] * (found[:, 6] + x[:, 5])
        front = (moment + p.b * total) / (p.a + p.b)
        return front, total - front

    front, rear = forces(4.718)[0], forces(5.4562)[1]
    found = rates(SingleTrack.f1tenth(), x, u)
    np.testing.assert_allclose(found[:, 5], (p.a * front - p.b * rear) / p.I_z, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found[:, 6], (front + rear) / (p.m * x[:, 3]) - x[:, 5], rtol=1e-9, atol=1e-9)


def test_a_drive_agrees_with_scipy_on_commonroads_function():
    plant, p, period, fine = SingleTrack.bmw_320i(), published("bmw_320i"), 0.02, 10
    t = period * np.arange(1000)  # 20 s: accelerate, brake, swerve; no input or angle meets its limit on the way
    u = np.column_stack([0.3 * np.sin(1.1 * t) * np.cos(0.17 * t), 1.8 * np.cos(0.5 * t)])
    x0 = np.array([1.0, 2.0, 0.05, 6.0, 0.3, 0.1, 0.01])

    @jax.jit
    def drive(x, u):
        def step(state, given):
            state, _ = RK4.advance(lambda s, _: (rate(plant, s, given), ()), state, period / fine, (0, 0, 0))
            return state, vector(state)

        return jax.lax.scan(step, dynamic(x), u)[1]

    mine, x, theirs = drive(jnp.asarray(x0), jnp.repeat(jnp.asarray(u), fine, 0))[fine - 1 :: fine], x0, []
    for given in u:
        rhs = lambda t, x, given=given: vehicle_dynamics_st(x, given, p)  # noqa: E731
        x = solve_ivp(rhs, (0, period), x, method="DOP853", rtol=1e-10, atol=1e-11, first_step=period / 4).y[:, -1]
        theirs.append(x)
    theirs = np.array(theirs)
    assert np.hypot(*np.diff(theirs[:, :2], axis=0).T).sum() > 100  # m
    assert np.abs(theirs[:, 3] * theirs[:, 5]).max() > 5  # m/s^2
    np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-6)


@pytest.mark.slow
def test_slopes_agree_with_differences():
    rng = np.random.default_rng(1)
    patch = FrictionPatch(center=np.array([0.3, -0.2]), radius=2.0, factor=0.4, edge=0.5)
    cars = [
        SingleTrack(tyre=SaturatingTyre(friction=0.8), surface=patch, road_slope=np.array([0.03, -0.02])),
        KinematicSingleTrack(road_slope=np.array([0.03, -0.02])),
    ]
    for car in cars:
        state = state_of(car, jnp.array([0.5, 0.4, 0.2, 3.0, 0.6, 0.4, 0.03]))
        point = cast((car, state, jnp.array([0.1, 1.0]), jnp.array([0.2, -0.3, 0.1])), jnp.float64)
        flat, back = ravel_pytree(point)
        f = jax.jit(lambda x, back=back: vector(rate(*back(x))))
        both = jax.jit(lambda x, f=f: (jax.jacfwd(f)(x), jax.jacrev(f)(x)))
        around = jax.jit(jax.vmap(f))
        # speeds at which it crawls, drives backwards, is short of power, is at its end
        for speed in (0.03, -0.05, 0.4, 3.0, -4.0, 9.0, 40.0, 51.0):
            x = ravel_pytree((point[0], dataclasses.replace(point[1], speed=jnp.asarray(speed)), *point[2:]))[0]
            x = x.at[-5].set(rng.uniform(-0.3, 0.3)).at[-4].set(12.0 if speed == 9.0 else 1.0)
            steps = 1e-5 * np.maximum(1.0, np.abs(x)) * min(1.0, 10 * abs(speed))
            away = np.diag(steps)
            differences = (around(x[None] + away) - around(x[None] - away)) / (2 * steps[:, None])
            forward, reverse = both(x)
            scale = np.abs(differences).max()
            np.testing.assert_allclose(forward.T, differences, rtol=1e-5, atol=1e-8 * scale)
            np.testing.assert_allclose(reverse, forward, rtol=1e-10, atol=1e-13 * scale)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.0, 0.05, 0.1, -0.1])
def test_slopes_are_finite_at_a_standstill_and_where_the_model_switches(speed):
    patch = FrictionPatch(center=np.zeros(2))
    for car in (SingleTrack(tyre=SaturatingTyre(), surface=patch), KinematicSingleTrack()):
        state = state_of(car, jnp.zeros(7).at[3].set(speed))

        def all_of(car, state, u, d, law):
            seen = car.output(state, {})
            inputs = car.allocate(Command(position=law, heading=law[0]), seen)
            return vector(rate(car, state, u, d)).sum() + sum(inputs.values()) + car.achieved(inputs, seen).sum()

        point = cast((car, state, jnp.array([0.1, 1.0]), jnp.ones(3), jnp.ones(2)), jnp.float64)
        found = ravel_pytree(jax.jit(jax.grad(all_of, argnums=(0, 1, 2, 3, 4)))(*point))[0]
        assert np.isfinite(found).all()

        def begins(velocity, car=car):
            return vector(car.start(Start(position=jnp.zeros(2), velocity=velocity, heading=jnp.array(0.3)))).sum()

        assert np.isfinite(jax.grad(begins)(jnp.zeros(2))).all()


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_either_precision_stays_what_it_is(dtype):
    surfaces = {"tyre": SaturatingTyre(), "surface": FrictionPatch()}
    for car in (SingleTrack.f1tenth(**surfaces), KinematicSingleTrack()):
        car, start = cast((car, Start(velocity=np.array([2.0, 0.3]))), dtype)
        state = car.start(start)
        seen = car.output(state, {})
        inputs = car.allocate(Command(position=jnp.ones(2, dtype), heading=jnp.ones((), dtype)), seen)
        found = car.derivative(state, (), inputs, jnp.ones(3, dtype))
        both = (state, seen, inputs, found, car.achieved(inputs, seen))
        assert {leaf.dtype for leaf in jax.tree.leaves(both)} == {jnp.dtype(dtype)}
        assert [x.shape for x in jax.tree.leaves(state)] == [x.shape for x in jax.tree.leaves(found)]


CARS = [KinematicSingleTrack(), SingleTrack(), SingleTrack.f1tenth(), KinematicSingleTrack.f1tenth()]


@pytest.mark.parametrize("car", CARS, ids=["kinematic", "dynamic", "f1tenth", "kinematic f1tenth"])
def test_it_starts_as_asked_and_its_rear_axle_does_not_slip(car):
    for velocity in ([3.0, 0.8], [0.05, 0.01], [-2.0, 0.4]):
        c, s = np.cos(0.7), np.sin(0.7)
        world = np.array([[c, -s], [s, c]]) @ velocity
        start = Start(position=np.array([4.0, -3.0]), velocity=world, heading=0.7)
        state = car.start(start)
        seen = car.output(state, {})
        np.testing.assert_allclose(seen.position, [4.0, -3.0], atol=1e-14)
        np.testing.assert_allclose(seen.velocity, world, atol=1e-14)
        np.testing.assert_allclose(seen.yaw_rate, velocity[1] / car.L, rtol=1e-12)
        np.testing.assert_allclose(seen.steering_angle, np.arctan(velocity[1] / velocity[0]), rtol=1e-12)
        rear = np.asarray(seen.velocity) - seen.yaw_rate * car.L * np.array([-s, c])
        np.testing.assert_allclose(rear, velocity[0] * np.array([c, s]), atol=1e-14)
        moves = jax.jvp(lambda x: car.output(x, {}).position, (state,), (rate(car, state, jnp.zeros(2)),))[1]
        np.testing.assert_allclose(moves, world, atol=1e-13)


def test_a_start_that_no_wheel_allows_has_its_wheel_at_the_limit():
    for car in CARS:
        for velocity in ([0.0, 1.0], [0.1, 5.0], [0.0, 0.0], [0.0, -1.0]):
            state = car.start(Start(position=np.zeros(2), velocity=np.array(velocity), heading=0.0))
            assert np.isfinite(vector(state)).all()
            limit = np.sign(velocity[1]) * car.limits.steering_angle
            np.testing.assert_allclose(state.steering_angle, limit, rtol=1e-12, atol=1e-15)


def driving(car, rng):
    """Some state faster than `slowest`, forwards."""
    speed, angle = rng.uniform(1.3, 8.0), rng.uniform(-0.4, 0.4)
    x = [*rng.normal(size=2), angle, speed, rng.uniform(-3, 3), rng.normal(), rng.uniform(-0.2, 0.2)]
    return state_of(car, jnp.array(x))


@pytest.mark.parametrize("car", CARS[:2], ids=["kinematic", "dynamic"])
def test_allocation_reads_backwards(car):
    rng = np.random.default_rng(4)
    for scale in (1.0, 0.01):  # and below `slowest`
        for _ in range(20):
            state, U = driving(car, rng), jnp.array(rng.normal(size=2))
            seen = car.output(dataclasses.replace(state, speed=scale * state.speed), {})
            inputs = car.allocate(Command(position=U, heading=jnp.zeros(())), seen)
            np.testing.assert_allclose(car.achieved(inputs, seen), U, atol=1e-11)


def test_what_is_allocated_is_the_front_points_whole_acceleration():
    car, rng = KinematicSingleTrack(), np.random.default_rng(6)
    for _ in range(50):
        state, U = driving(car, rng), jnp.array(0.3 * rng.normal(size=2))
        inputs = car.allocate(Command(position=U, heading=jnp.zeros(())), car.output(state, {}))
        free = dataclasses.replace(car, limits=agvjax.SteeringLimits(steering_rate=50.0, acceleration=1e3))
        change = free.derivative(state, (), inputs, CALM)
        found = jax.jvp(lambda s: car.output(s, {}).velocity, (state,), (change,))[1]
        np.testing.assert_allclose(found, U, atol=1e-12)  # no F of eq. (4) beside it
        moves = jax.jvp(lambda s: car.output(s, {}).position, (state,), (change,))[1]
        np.testing.assert_allclose(moves, car.output(state, {}).velocity, atol=1e-12)


def test_following_exactly_takes_what_needs_says():
    car, rng = KinematicSingleTrack(), np.random.default_rng(7)
    v, w, a, alpha = rng.uniform(1, 9, 9), rng.uniform(-0.5, 0.5, 9), rng.normal(size=9), rng.uniform(-0.1, 0.1, 9)
    v[0] *= -1
    needed = car.needs(agvjax.Motion(v, w, a, alpha))
    free = dataclasses.replace(car, limits=agvjax.SteeringLimits(steering_rate=50.0))
    for i in range(9):
        state = kinematic(jnp.array([0, 0, needed["steering_angle"][i], needed["speed"][i], 0.2]))
        inputs = {name: jnp.array(needed[name][i]) for name in car.actuators}
        change = free.derivative(state, (), inputs, CALM)
        np.testing.assert_allclose([change.heading, change.speed], [w[i], a[i]], atol=1e-12)
        turning = jax.jvp(lambda s: car.output(s, {}).yaw_rate, (state,), (change,))[1]
        np.testing.assert_allclose(turning, alpha[i], atol=1e-12)
    np.testing.assert_allclose(needed["lateral_acceleration"], v * w)
    for plant in CARS:
        assert set(plant.reach()) <= set(needed)
        assert all(low < high for low, high in plant.reach().values())
    assert np.isfinite(car.needs(agvjax.Motion(*np.zeros((4, 1))))["steering_rate"]).all()


def test_a_push_accelerates_the_centre_of_gravity_and_a_drift_turns_the_car():
    car, rng = SingleTrack(), np.random.default_rng(8)

    def centre(state, disturbance):
        def velocity(s):
            motion = s.heading + s.slip_angle
            return s.speed * jnp.stack([jnp.cos(motion), jnp.sin(motion)])

        change = rate(car, state, jnp.array([0.1, 0.5]), disturbance)
        return jax.jvp(velocity, (state,), (change,))[1], change

    for _ in range(10):
        state = driving(car, rng)
        before, calm = centre(state, CALM)
        after, pushed = centre(state, jnp.array([0.3, -0.4, 0.0]))
        np.testing.assert_allclose(after - before, [0.3, -0.4], atol=1e-12)
        assert pushed.yaw_rate == calm.yaw_rate
        turned = centre(state, jnp.array([0.0, 0.0, 0.1]))[1]
        np.testing.assert_allclose(turned.heading - calm.heading, 0.1, atol=1e-14)


def test_pushed_while_it_crawls_its_yaw_rate_stays_that_of_rolling():
    car, slow = SingleTrack(road_slope=np.array([-0.02, 0.05])), np.array([0.06, 0.012])
    state = car.start(Start(position=np.zeros(2), velocity=slow, heading=0.0))
    change = rate(car, state, jnp.array([0.0, 0.4]), jnp.array([0.3, -0.2, 0.0]))

    def rolling(s):
        return s.speed * jnp.cos(s.slip_angle) * jnp.tan(s.steering_angle) / car.L

    np.testing.assert_allclose(state.yaw_rate, rolling(state), rtol=1e-12)
    np.testing.assert_allclose(change.yaw_rate, jax.jvp(rolling, (state,), (change,))[1], rtol=1e-12)
    assert abs(float(change.speed) - 0.4) > 0.05


@pytest.mark.parametrize("kind", [SingleTrack, KinematicSingleTrack], ids=["dynamic", "kinematic"])
@pytest.mark.parametrize("speed", [0.02, 10.0])
def test_a_slope_of_five_percent_takes_half_a_metre_a_second_each_second(kind, speed):
    for slope, fall in (([0.0, 0.05], -0.4905), ([0.05, 0.0], 0.0)):  # up, and beside it
        car = kind(road_slope=np.array(slope))
        state = state_of(car, jnp.zeros(7).at[3].set(speed).at[4].set(np.pi / 2))
        np.testing.assert_allclose(rate(car, state, jnp.zeros(2)).speed, fall, rtol=1e-12, atol=1e-15)


def test_small_slip_does_not_tell_the_tyres_apart():
    tyre = SaturatingTyre(mu=1.0489, stiffness_front=4.718, stiffness_rear=5.4562, friction=0.6)
    off = []
    for size in (0.4, 0.2, 0.1):
        state = dynamic(jnp.array([0.0, 0.0, 0.02 * size, 4.0, 0.0, 0.05 * size, -0.03 * size]))
        linear, soft = (
            vector(rate(car, state, CALM[:2])) for car in (SingleTrack.f1tenth(), SingleTrack.f1tenth(tyre=tyre))
        )
        off.append(np.abs(linear - soft).max())
    assert off[0] > 1e-4
    np.testing.assert_allclose(np.divide(off[:-1], off[1:]), 8.0, rtol=0.05)  # third order


def test_friction_limits_what_the_road_can_turn():
    for friction in (1.0, 0.3):
        car = SingleTrack(tyre=SaturatingTyre(friction=friction))
        peak = friction * 1.0489 * 9.81
        low, high = car.reach()["lateral_acceleration"]
        assert high == -low == pytest.approx(peak)
        # front and rear wheels far out of their direction of travel: each axle gives its peak and no more
        state = dynamic(jnp.array([0.0, 0.0, 1.0, 20.0, 0.0, 0.0, -1.0]))
        change = rate(car, state, jnp.zeros(2))
        np.testing.assert_allclose(change.slip_angle * 20.0, peak, rtol=1e-12)
        np.testing.assert_allclose(change.yaw_rate, 0.0, atol=1e-9)  # l_f F_zf = l_r F_zr
    strong = rate(SingleTrack(), state, jnp.zeros(2)).slip_angle * 20.0
    assert strong > 10 * peak


def test_a_patch_of_ice_is_felt_by_the_axle_that_is_on_it():
    ice = FrictionPatch(center=np.array([3.0, 1.0]), radius=2.0, factor=0.2, edge=0.05)
    for place, factor in (((3.0, 1.0), 0.2), ((5.0, 1.0), 0.6), ((3.0, 4.0), 1.0)):
        assert float(ice(jnp.array(place))) == pytest.approx(factor, abs=6e-7)
    car = SingleTrack(tyre=SaturatingTyre(), surface=ice)
    front, rear, mass = car.lf, car.lr, car.mass
    for along, on_front, on_rear in ((-10.0, 1, 1), (3.0 - front, 0.2, 1), (3.0, 0.2, 0.2), (4.9, 1, 0.2)):
        change = rate(car, dynamic(jnp.array([along, 1.0, 1.0, 20.0, 0.0, 0.0, -1.0])), jnp.zeros(2))
        F_f, F_r = (x * 1.0489 * mass * 9.81 / (front + rear) for x in (on_front * rear, on_rear * front))
        yaw = (front * F_f - rear * F_r) / car.inertia
        np.testing.assert_allclose(change.yaw_rate, yaw, rtol=1e-3, atol=1e-3)
        np.testing.assert_allclose(change.slip_angle, (F_f + F_r) / (mass * 20.0), rtol=1e-3)


def test_poles_are_those_of_differences_of_commonroads_function():
    for name in NAMES:
        p, plant = published(name), made(name)
        for speed in (0.5, 30.0):

            def lateral(y, p=p, speed=speed):
                return np.array(vehicle_dynamics_st([0, 0, 0, speed, 0, *y], [0, 0], p)[5:])

            columns = [(lateral(1e-3 * e) - lateral(-1e-3 * e)) / 2e-3 for e in np.eye(2)]  # linear: exact
            expected = np.sort_complex(np.linalg.eigvals(np.column_stack(columns)))
            np.testing.assert_allclose(np.sort_complex(plant.poles(speed)), expected, rtol=1e-8, atol=1e-8)
