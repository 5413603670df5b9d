"""The exported controller of Nav2, compiled against headers that stand for ROS 2 and Nav2, and driven by a server."""

import pathlib
import shutil
from xml.etree import ElementTree

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import yaml

import agvjax
from agvjax import Route, SpeedLimits
from nav2_stub import Server, build, by_cmake, lay_out
from tuning.config.write import gains_table
from tuning.export import artefact, c, nav2, tables

needs_gcc = pytest.mark.skipif(shutil.which("g++") is None, reason="g++ is not installed")
needs_clang = pytest.mark.skipif(shutil.which("clang++") is None, reason="clang++ is not installed")
AMENT = pathlib.Path("/usr/share/ament_cmake/cmake")
needs_ament = pytest.mark.skipif(not (AMENT.exists() and shutil.which("cmake")), reason="ament_cmake is not installed")
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
    plant = {"TwistBase": "twist_base", "Ackermann": "ackermann"}.get(type(law.vehicle).__name__, "base")
    (folder / "config.toml").write_text(CONFIG.replace('plant = "base"', f'plant = "{plant}"'))
    (folder / "gains.toml").write_text(gains_table(law))
    with pytest.MonkeyPatch.context() as patch:  # the vectors of the self-test of C take seconds and are not used
        patch.setattr(c, "table", lambda found, step: (["none"], np.zeros((1, 1))))
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


@pytest.mark.slow
@needs_gcc
def test_it_drives_as_the_simulator_does_forwards_and_backwards_into_the_bay(server):
    """Over the whole drive of two legs, within 1e-6 m and rad; the plan is the points of the route."""
    assert server.plan(headed(BAY)) == ""
    got, sent = driven(server, Vehicle(*START), 30.0)
    wanted = simulated(BAY, START, 30.0)
    print(f"largest difference {np.abs(got - wanted).max():.1e}")
    assert np.abs(got - wanted).max() < 1e-6
    assert np.linalg.norm(got[-1, :2] - BAY[-1, :2]) < 0.05 and np.all(sent[-5:] == 0.0)
    assert sent[:, 0].min() < -0.3 and "at the end of the plan" in server.said()


def agree(found, route):
    """Whether what C++ laid is a route, number by number, lengths and speeds relative to their size."""
    for name, wanted in {**tables.arrays(route), "length": np.asarray(route.length)}.items():
        assert np.shape(found[name]) == wanted.shape
        np.testing.assert_allclose(found[name], wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


@needs_gcc
@pytest.mark.parametrize("seed", range(12))
def test_a_plan_is_laid_as_the_route_through_its_poses(seed, server):
    """Of 2, 3, 4 and many poses, gentle and rough, forwards, and backwards from the middle on."""
    rng = np.random.default_rng(seed)
    count = [2, 3, 4, 5, 9, 40][seed % 6]
    turns = np.cumsum(rng.normal(0, 0.4, count))
    signs = np.where(np.arange(count) >= (count // 2 if seed >= 6 and count > 3 else count), -1.0, 1.0)
    steps = rng.uniform(0.3, 0.8, (count, 1)) * np.column_stack([np.cos(turns), np.sin(turns)])
    points = np.cumsum(signs[:, None] * steps, axis=0)
    rows = np.column_stack([points, 0.7 * np.append(signs[1:], signs[-1])])
    found, told = server.laid(headed(rows), 0.01, True, [0.7, 0.7, 0.4, 0.3, 0.25])
    assert told == ""
    agree(found, Route.through(rows, limits=LIMITS))


@needs_gcc
def test_poses_nearer_than_the_spacing_are_left_out_and_both_ends_stay(server):
    """Of poses every 3 cm along x, the first and every fourth; the last in place of one that is too near to it."""
    line = np.column_stack([np.arange(0, 1.0, 0.03), np.zeros(34), np.zeros(34)])
    wavy = line + 0.01 * np.array([0.0, 1.0, 0.0]) * np.sin(5 * line[:, :1])
    kept = [*range(0, 32, 4), 33]
    found, told = server.laid(np.repeat(wavy, 2, axis=0), 0.1, False, [0.7, 0.7, 0.4, 0.3, 0.25])
    assert told == ""
    agree(found, Route.through(wavy[kept, :2], 0.7, limits=LIMITS))


@needs_gcc
def test_an_ugly_plan_is_refused_in_words_or_laid_in_numbers(server):
    """Walks with repeated poses, leaps, steps of a grid and headings at random, as no planner should make them."""
    rng, laid = np.random.default_rng(5), 0
    for _ in range(60):
        count = rng.integers(1, 30)
        steps = rng.normal(size=(count, 2)) * 10.0 ** rng.uniform(-5, rng.choice([0, 2]), (count, 1))
        points = np.cumsum(rng.choice([steps, np.round(steps, 1), np.abs(steps)]), axis=0)
        points = points * rng.choice([1.0, 1.0, 1.0, 1e200]) + rng.choice([0.0, 4e6])
        poses = np.column_stack([points, rng.uniform(-4, 4, count)])[np.sort(rng.integers(0, count, count))]
        found, told = server.laid(poses, 0.01, bool(rng.integers(2)), [0.7, 0.5, 0.4, 0.3, 0.25])
        assert not told or "turns back by more than" in told or "turns too suddenly" in told
        squares = found["squared_speeds"]
        if not told and squares.size:
            laid += 1
            assert all(np.all(np.isfinite(x)) for x in found.values())
            assert np.all(squares[0] >= 0.0) and np.all(squares.sum(axis=0) < 0.49 + 1e-9)
            assert squares.sum(axis=0)[-1] == pytest.approx(0.0, abs=1e-9)  # it stands at the end
    assert 10 < laid < 55


# ---- plans come again


@needs_gcc
def test_the_same_plan_sent_again_changes_nothing(server):
    runs = []
    for every in (10**9, 20):
        server.library.reset()
        vehicle, poses = Vehicle(*START), []
        for k in range(400):
            if k % every == 0:
                assert server.plan(headed(BAY)) == ""
            poses.extend(driven(server, vehicle, PERIOD)[0])
        runs.append(np.array(poses))
    np.testing.assert_array_equal(*runs)


@needs_gcc
def test_another_plan_over_the_same_ground_is_joined_where_the_vehicle_is_with_what_the_law_has_learnt(server):
    """A line, and every second the rest of it, from behind the vehicle: the drive is that along the one line."""
    line = np.column_stack([np.arange(0, 12.0, 0.5), np.zeros((24, 2))])
    runs = []
    for again in (False, True):
        server.library.reset()
        assert server.plan(line) == ""
        vehicle, poses = Vehicle(0.2, 0.3, -0.1), []
        for _ in range(16):
            poses.extend(driven(server, vehicle, 1.0)[0])
            if again:
                assert server.plan(line[line[:, 0] > min(vehicle.state[0], 10.0) - 0.7]) == ""
        runs.append(np.array(poses))
    assert np.abs(runs[0] - runs[1]).max() < 1e-9
    forgetful = Vehicle(0.2, 0.3, -0.1)  # the integral matters
    server.library.reset()
    server.plan(line)
    driven(server, forgetful, 1.0)
    server.library.reset()
    server.plan(line)
    assert np.abs(driven(server, forgetful, 2.0)[0] - runs[0][20:60]).max() > 1e-3


@needs_gcc
def test_a_refused_plan_is_not_driven_and_nor_is_the_one_before(server):
    nowhere = headed(BAY)
    nowhere[3, 1] = np.nan
    for bad, word in ((nowhere, "number 4 of the plan is not finite"), ([], "empty")):
        assert server.plan(headed(BAY)) == ""
        vehicle = Vehicle(*START)
        driven(server, vehicle, 1.0)
        assert word in (told := server.plan(bad)) and told.startswith("InvalidPath")
        assert server.command(*vehicle.seen()) == (0.0, 0.0, "InvalidPath: there is no plan to follow")


@needs_gcc
def test_a_plan_that_turns_back_needs_headings_that_say_so(server):
    server.set("allow_reversing", 0.0)
    assert "allow_reversing" in server.plan(headed(np.array([[0, 0, 1], [1, 0, 1], [2, 0, 1], [1, 0.1, 1], [0, 0, 1]])))
    assert server.plan(BAY[:6]) == ""


@needs_gcc
@pytest.mark.parametrize("poses", [[[1.0, 2.0, 0.0]], [[1.0, 2.0, 0.0]] * 3])
def test_a_plan_that_leads_nowhere_is_stood_on(server, poses):
    """The vehicle is at the goal already: the goal checker will say so."""
    assert server.plan(poses) == "" and server.command(1.0, 2.0, 0.0, 0.0, 0.0) == (0.0, 0.0, "")


# ---- frames, limits, orders


@needs_gcc
def test_a_plan_on_the_map_is_driven_as_one_in_the_frame_of_the_odometry(server):
    """Turned by 2 rad, shifted by (5, -3) m."""
    plan, turn = headed(BAY), 2.0
    assert server.plan(plan) == ""
    wanted = driven(server, Vehicle(*START), 5.0)[0]
    server.library.reset()
    server.frames(5.0, -3.0, turn)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    moved = np.column_stack([plan[:, :2] @ rotation.T + [5.0, -3.0], plan[:, 2] + turn])
    assert server.plan(moved, "map") == ""
    assert np.abs(driven(server, Vehicle(*START), 5.0)[0] - wanted).max() < 1e-9
    assert server.plan(moved, "moon") == ""
    assert server.command(*Vehicle(*START).seen())[2].startswith("ControllerTFError: no pose in the frame of the plan")


@needs_gcc
def test_speed_limits_are_kept_at_once_and_lifted_again(server):
    server.plan(headed(BAY))
    vehicle = Vehicle(*START)
    assert driven(server, vehicle, 2.0)[1][-1, 0] == pytest.approx(0.5, abs=0.01)
    for limit, percentage, most in ((0.2, False, 0.2), (40.0, True, 0.2), (0.05, False, 0.05)):
        server.speed_limit(limit, percentage)
        sent = driven(server, vehicle, 0.5)[1][:, 0]
        assert sent.max() <= most + 1e-12 and sent[-1] > 0.9 * most
    for wrong in (np.nan, -1.0):
        server.speed_limit(wrong)
        assert "speed limit" in server.said() and driven(server, vehicle, 0.5)[1].max() <= 0.06
    server.speed_limit(0.0)
    assert driven(server, vehicle, 0.5)[1][0, 0] > 0.4


@needs_gcc
def test_cancelled_it_slows_down_on_the_plan_and_says_when_it_stands(server):
    server.plan(headed(BAY))
    vehicle = Vehicle(*START)
    _, sent = driven(server, vehicle, 3.0)
    speeds, off = [sent[-1, 0]], []
    while not server.library.cancel():
        speeds.append(driven(server, vehicle, PERIOD)[1][0, 0])
        off.append(abs(vehicle.state[1]))
        assert len(speeds) < 60
    slower = -np.diff(speeds)
    assert np.all(slower > 0) and slower.max() < 0.3 * PERIOD + 1e-12  # the deceleration of the plan
    assert len(slower) == pytest.approx(0.5 / 0.3 / PERIOD, abs=2) and max(off) < 0.2


@needs_gcc
def test_a_gain_is_set_while_it_drives_within_its_bounds(server):
    server.plan(headed(BAY))
    vehicle = Vehicle(0.1, 0.2, 0.0)
    before = driven(server, vehicle, PERIOD)[1][0, 1]
    server.library.reset()
    server.plan(headed(BAY))
    assert server.set("controller.inner.k_y", 1.0) == ""
    weaker = driven(server, Vehicle(0.1, 0.2, 0.0), PERIOD)[1][0, 1]
    assert before < weaker < 0.0
    for name, value, word in (
        ("controller.inner.k_y", 0.0, "out of bounds"),
        ("controller.vehicle.track", 0.6, "read only"),
        ("controller.period", 0.05, "read only"),
        ("spacing", 0.0, "out of bounds"),
        ("max_speed", np.nan, "out of bounds"),
    ):
        assert word in server.set(name, value)
    assert "out of bounds" in server.configure(**{"controller.inner.k_psi": -1.0})


@needs_gcc
def test_the_base_turns_by_its_own_track(server):
    """One that takes its track for 0.4 m, not 0.5, must be told 1.25 times the yaw rate."""
    server.plan(headed(BAY))
    (v, w), *_ = driven(server, Vehicle(0.1, 0.2, 0.0), PERIOD)[1]
    server.library.reset()
    server.plan(headed(BAY))
    assert server.set("base_track", 0.4) == ""
    assert server.command(0.1, 0.2, 0.0, 0.0, 0.0)[:2] == pytest.approx((v, 1.25 * w), rel=1e-12)


@needs_gcc
@pytest.mark.parametrize("frequency", [10.0, 20.5, 0.0])
def test_another_frequency_of_the_server_is_refused(server, frequency):
    assert "must be 20.00 Hz" in server.configure(frequency)


@needs_gcc
def test_periods_that_are_off_are_said(server):
    server.plan(headed(BAY))
    server.command(*START, 0.0, 0.0)
    server.command(*START, 0.0, 0.0)
    assert "ms since" not in server.said()
    server.command(*START, 0.0, 0.0, period=0.1)
    assert "100 ms since the last period, the law is tuned for 50 ms" in server.said()


@needs_gcc
def test_it_stands_on_a_pose_that_is_old_or_none_and_goes_on_as_it_was(server):
    """A pose or velocity that is not finite, or older than the timeout, never reaches the law."""
    server.plan(headed(BAY))
    vehicle = Vehicle(*START)
    driven(server, vehicle, 2.0)
    whole, (v, w) = vehicle.state.copy(), driven(server, vehicle, PERIOD)[1][0]
    server.library.reset()
    server.plan(headed(BAY))
    vehicle = Vehicle(*START)
    driven(server, vehicle, 2.0)
    seen = vehicle.seen()
    for place in range(5):
        wrong = [np.nan if k == place else x for k, x in enumerate(seen)]
        assert server.command(*wrong) == (0.0, 0.0, "NoValidControl: the pose or the velocity is not finite")
    v_late, w_late, told = server.command(*seen, age=0.5)
    assert (v_late, w_late) == (0.0, 0.0) and "the pose is 0.50 s old, timeout is 0.20" in told
    assert np.all(vehicle.state == whole) and driven(server, vehicle, PERIOD)[1][0] == pytest.approx((v, w), rel=1e-12)


@needs_gcc
def test_it_gives_up_far_from_the_plan(server):
    server.plan(headed(BAY))
    v, w, told = server.command(0.5, 1.6, 0.0, 0.0, 0.0)
    assert (
        (v, w) == (0.0, 0.0) and told.startswith("NoValidControl: 1.") and "m from the plan, max_error is 1.00" in told
    )


@needs_gcc
def test_it_stops_at_half_the_tolerance_of_the_goal_checker_where_that_is_less(server):
    """5 mm before the end and not 20, or less by a period at .2 m/s at most; then it coasts, as its motors lag."""
    for tolerance, reached in ((0.25, 0.02), (0.01, 0.005)):
        server.library.reset()
        server.tolerate(tolerance)
        server.plan([[0, 0, 0], [1, 0, 0], [2, 0, 0]])
        driven(server, Vehicle(0.0, 0.0, 0.0), 12.0)
        before = float(server.said().rpartition("at the end of the plan, ")[2].split()[0])
        assert reached - 0.2 * PERIOD <= before <= reached
    server.tolerate(0.25)


# ---- other compilers, other laws, Lyrical


@pytest.mark.slow
@pytest.mark.parametrize("lyrical", [False, True], ids=["jazzy", "lyrical"])
@pytest.mark.parametrize("compiler", [pytest.param("gcc", marks=needs_gcc), pytest.param("clang", marks=needs_clang)])
def test_each_compiler_and_each_interface_of_nav2_drives_as_the_simulator_does(compiler, lyrical, package, tmp_path):
    lay_out(tmp_path, package, "drives", lyrical)
    server = Server(build(tmp_path, "drives", compiler, lyrical))
    assert server.configure() == "" and server.plan(headed(BAY)) == ""
    got, _ = driven(server, Vehicle(*START), 30.0)
    assert np.abs(got - simulated(BAY, START, 30.0)).max() < 1e-6


def compensated(inner, vehicle):
    """A law that remembers what it sent, for 60 ms of delay, and learns nothing."""
    zones = agvjax.Inverse(believed=vehicle.deadzones())
    return agvjax.Sampled(
        inner=inner, vehicle=vehicle, period=PERIOD, compensation=zones, prediction=agvjax.Predictor(delay=0.06)
    )


OTHERS = {
    "pursuit": compensated(agvjax.RegulatedPurePursuit(desired_linear_vel=0.5), agvjax.Base(track=TRACK)),
    "stanley": agvjax.Sampled(inner=agvjax.Stanley(k=1.0, k_yaw=0.0), vehicle=agvjax.TwistBase(), period=PERIOD),
    "lqr": agvjax.Sampled(inner=agvjax.PathLQR(), vehicle=agvjax.Ackermann(behind=True), period=PERIOD),
}


@pytest.mark.slow
@needs_gcc
@pytest.mark.parametrize("kind", OTHERS)
def test_other_laws_and_vehicles_command_what_the_law_itself_does(kind, tmp_path):
    """Period by period, for the same measurements; of a law that remembers what it sent too, also past a new plan."""
    law = OTHERS[kind]
    lay_out(tmp_path, files_of(law, tmp_path), "drives")
    server = Server(build(tmp_path, "drives"))
    assert server.configure(max_yaw_rate=9.0, max_speed=9.0, max_reverse_speed=9.0) == ""
    line = np.column_stack([np.arange(0, 12.0, 0.5), np.zeros(24), np.full(24, 0.5)])
    assert server.plan(headed(line)) == ""
    route = tables.to_follow(Route.through(line, limits=LIMITS))
    vehicle, state, memory = Vehicle(0.2, 0.3, -0.1), None, None
    init, advance = jax.jit(law.inner.init), jax.jit(law.step)
    for k in range(100):
        x, y, heading, speed, yaw_rate = vehicle.seen()
        position, velocity = jnp.array([x, y]), speed * jnp.array([np.cos(heading), np.sin(heading)])
        now = agvjax.Measurement(
            position=position, velocity=velocity, heading=jnp.asarray(heading), yaw_rate=jnp.asarray(yaw_rate)
        )
        state = init(now, route) if state is None else state
        computed = advance(state, now, route, memory)
        state, memory = computed.law, computed.memory
        inputs = {name: float(x) for name, x in computed.command.inputs.items()}
        if kind == "pursuit":
            wanted = (inputs["left"] + inputs["right"]) / 2, (inputs["right"] - inputs["left"]) / TRACK
        elif kind == "stanley":
            wanted = inputs["speed"], inputs["yaw_rate"]
        else:  # the wheel is behind
            wanted = inputs["speed"], -inputs["speed"] * np.tan(inputs["steering_angle"]) / 1.2
        v, w, told = server.command(*vehicle.seen())
        assert told == "" and (v, w) == pytest.approx(wanted, rel=1e-9, abs=1e-9)
        vehicle.drive(v, w)
        if k == 50:
            assert server.plan(headed(line[line[:, 0] > vehicle.state[0] - 0.7])) == ""


# ---- the package


@pytest.fixture(scope="module")
def told(package):
    """Parameters of the bring-up and their tables, by dotted names."""

    def flat(tree, prefix=""):
        found = {}
        for name, part in tree.items():
            nests = isinstance(part, dict) and not isinstance(part.get("type"), str)
            found |= flat(part, f"{prefix}{name}.") if nests else {prefix + name: part}
        return found

    server = yaml.safe_load(package["config/nav2.yaml"])["controller_server"]["ros__parameters"]
    (stated,) = yaml.safe_load(package["src/parameters.yaml"]).values()
    return server, flat(server["FollowPath"]), flat(stated)


def test_the_bring_up_names_the_plugin_and_every_parameter_with_its_type(package, told):
    server, values, stated = told
    assert server["controller_frequency"] == 20.0 and server["controller_plugins"] == ["FollowPath"]
    (declared,) = ElementTree.fromstring(package["plugin.xml"]).iter("class")
    assert values.pop("plugin") == declared.get("type") == "drives_nav2::Controller"
    assert declared.get("base_class_type") == "nav2_core::Controller"
    assert values.keys() == stated.keys()
    kinds = {"double": float, "bool": bool}
    assert all(type(values[name]) is kinds[table["type"]] for name, table in stated.items())
    assert values["speed"] == 0.5 and values["reverse_speed"] == 0.5 and values["allow_reversing"] is True
    assert (values["acceleration"], values["deceleration"], values["lateral_acceleration"]) == (0.4, 0.3, 0.25)
    assert values["controller.inner.ahead"] == 0.1 and stated["controller.inner.k_y"]["validation"] == {"gt<>": [0.0]}
    assert stated["controller.vehicle.track"]["read_only"] and "read_only" not in stated["controller.inner.k_y"]


def test_the_package_builds_what_it_has_and_depends_on_what_it_includes(package):
    cmake, needs = package["CMakeLists.txt"], ElementTree.fromstring(package["package.xml"])
    depends = {part.text for part in needs.iter("depend")}
    built = [word.strip(")") for word in cmake.split("add_library(drives SHARED ")[1].split("\n")[0].split()]
    assert built == ["src/controller.cpp", "src/plan.cpp", "src/spline.cpp", "law/drives.c"]
    assert set(built) | {"src/parameters.yaml", "plugin.xml", "config/nav2.yaml", "law/Makefile"} <= package.keys()
    included = {
        line.split('"')[1].split("/")[0]
        for name, text in package.items()
        for line in text.splitlines()
        if name.endswith("pp") and line.startswith('#include "') and "/" in line
    }
    assert included - {"drives", "nav2_ros_common"} <= depends  # that one is asked for where it is
    assert [part.get("plugin") for part in needs.iter("nav2_core")] == ["${prefix}/plugin.xml"]
    assert not [name for name, text in package.items() if "@NAME" in text or "@UPPER" in text]


@pytest.mark.parametrize(
    ("inner", "vehicle", "word"),
    [
        (agvjax.PathPID(), agvjax.Unicycle(), "speed, yaw_rate; left, right; speed, steering_angle"),
        (agvjax.NeuroBackstepping(), agvjax.Base(), "a law that follows a route"),
    ],
)
def test_what_has_no_controller_in_nav2_is_refused(inner, vehicle, word):
    law = agvjax.Sampled(inner=inner, vehicle=vehicle)
    told = {"inputs": {name: "" for name in law.vehicle.actuators}, "gains": {"vehicle.track": {}}}
    line = Route.through([[0, 0], [1, 0], [2, 0]], 0.5) if inner.follows() else None
    with pytest.raises(agvjax.InputError, match=word):
        nav2.files(artefact.Artefact(law, told, line), "goes")


@needs_gcc
@needs_ament
@pytest.mark.slow
def test_its_own_cmake_builds_and_installs_it_as_plugins_are_found(package, tmp_path):
    """With ament_cmake as Debian has it: pluginlib goes from the index to plugin.xml and from there to the library."""
    folder = tmp_path / "package"
    folder.mkdir()
    lay_out(folder, package, "drives")
    install = by_cmake(tmp_path, folder)
    index = install / "share" / "ament_index" / "resource_index"
    told = (index / "nav2_core__pluginlib__plugin" / "drives").read_text().split()
    library = ElementTree.parse(install / told[0]).getroot()
    symbols = (install / "lib" / f"lib{library.get('path')}.so").read_bytes()
    assert library.find("class").get("type").encode().split(b"::")[-1] in symbols
    assert (index / "packages" / "drives").exists() and (install / "share" / "drives" / "config" / "nav2.yaml").exists()
