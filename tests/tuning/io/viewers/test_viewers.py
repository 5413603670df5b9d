"""Runs as files for viewers: read back by the libraries of MCAP, of bags and of Rerun, beside hand-made motions."""

import io

import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import InputError
from runs import trajectory
from tuning.cli.main import main
from tuning.io.curves import Track
from tuning.io.logs import read
from tuning.io.logs.roles import chosen
from tuning.io.logs.rows import table
from tuning.io.viewers import Asked, mcap_file, options, rerun_file
from tuning.io.viewers.told import of_run

SPEED, YAW_RATE, LEVER = 0.8, 0.4, 0.5


def circling(lever=0.0):
    """2 s of a circle driven by the middle of the axle, as the reference point `lever` ahead of it moves."""
    t = np.linspace(0.0, 2.0, 81)
    heading = 3.0 + YAW_RATE * t  # beyond pi on the way
    radius = SPEED / YAW_RATE
    axle = radius * np.column_stack([np.sin(heading) - np.sin(3.0), np.cos(3.0) - np.cos(heading)])
    along = np.column_stack([np.cos(heading), np.sin(heading)])
    across = np.column_stack([-np.sin(heading), np.cos(heading)])
    run = trajectory(
        jnp.asarray(t),
        position=jnp.asarray(axle + lever * along),
        velocity=jnp.asarray(SPEED * along + lever * YAW_RATE * across),
        heading=jnp.asarray(heading),
        command=jnp.full((t.size, 2), jnp.array([1.0, 0.5])),
        inputs=jnp.full((t.size, 2), jnp.array([0.7, 0.9])),
        delivered=jnp.full((t.size, 2), jnp.array([0.6, 0.8])),
        reference_position=jnp.asarray(axle),
    )
    return run, axle


def as_mcap(runs, plant):
    file = io.BytesIO()
    mcap_file.write_runs(file, {name: of_run(run, plant) for name, run in runs.items()})
    return file.getvalue()


def decoded(data):
    """Messages by topic, read by the libraries of MCAP and of bags."""
    from mcap.reader import make_reader
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    found, stores = {}, {}
    for schema, channel, message in make_reader(io.BytesIO(data)).iter_messages():
        if schema.name not in stores:
            stores[schema.name] = get_typestore(Stores.EMPTY)
            stores[schema.name].register(get_types_from_msg(schema.data.decode(), schema.name))
        one = stores[schema.name].deserialize_cdr(message.data, schema.name)
        found.setdefault(channel.topic, []).append((message.log_time, one))
    return found


@pytest.mark.parametrize(("plant", "lever"), [(agvjax.Base(), 0.0), (agvjax.Unicycle(L=LEVER), LEVER)])
def test_poses_and_speeds_are_those_of_the_axle(plant, lever):
    run, axle = circling(lever)
    topics = decoded(as_mcap({"": run}, plant))
    assert len(topics["/odom"]) == len(topics["/tf"]) == len(topics["/reference"]) == 81
    for k in (0, 40, 80):
        at, odometry = topics["/odom"][k]
        assert at == 25_000_000 * k == odometry.header.stamp.sec * 10**9 + odometry.header.stamp.nanosec
        assert odometry.header.frame_id == "map" and odometry.child_frame_id == "base_link"
        place, turn = odometry.pose.pose.position, odometry.pose.pose.orientation
        np.testing.assert_allclose([place.x, place.y], axle[k], atol=1e-12)
        heading = 2 * np.arctan2(turn.z, turn.w)
        np.testing.assert_allclose(np.exp(1j * heading), np.exp(1j * (3.0 + YAW_RATE * at * 1e-9)), atol=1e-12)
        moving = odometry.twist.twist
        np.testing.assert_allclose([moving.linear.x, moving.linear.y], [SPEED, 0.0], atol=1e-9)
        np.testing.assert_allclose(moving.angular.z, YAW_RATE, atol=1e-9)
        moved = topics["/tf"][k][1].transforms[0].transform.translation
        np.testing.assert_allclose([moved.x, moved.y], axle[k], atol=1e-12)
    told = topics["/cmd_vel"][5][1]
    assert (told.twist.linear.x, told.twist.angular.z, told.header.frame_id) == (1.0, 0.5, "base_link")
    first, second = plant.actuators
    numbers = [topics[f"/{kind}/{name}"][7][1].data for kind in ("asked", "delivered") for name in (first, second)]
    assert numbers == [0.7, 0.9, 0.6, 0.8]
    plan = topics["/plan"]
    assert len(plan) == 1 and len(plan[0][1].poses) == 81


def test_runs_beside_each_other_have_names_of_their_own():
    run, _ = circling()
    topics = decoded(as_mcap({"before": run, "after": run}, agvjax.Base()))
    assert {"/before/odom", "/after/odom", "/before/plan", "/after/cmd_vel", "/tf"} <= set(topics)
    frames = {one.transforms[0].child_frame_id for _, one in topics["/tf"]}
    assert frames == {"before/base_link", "after/base_link"}


def test_numbers_that_are_not_finite_stay_what_they_are():
    run, _ = circling()
    broken = np.asarray(run.delivered).copy()
    broken[3, 0] = np.nan
    run = run.__class__(**{**vars(run), "delivered": jnp.asarray(broken)})
    values = [
        one.data for _, one in decoded(as_mcap({"": run}, agvjax.Base()))[f"/delivered/{agvjax.Base().actuators[0]}"]
    ]
    assert np.flatnonzero(np.isnan(values)).tolist() == [3]


@pytest.mark.slow
def test_a_simulated_run_is_a_recording_that_can_be_identified_from(tmp_path):
    file = tmp_path / "run.mcap"
    arguments = ["simulate", "--config", "base", "--set", "simulate.horizon=3", "--out", str(tmp_path / "run")]
    assert main([*arguments, "--mcap", str(file), "--quiet"]) in (0, 1)
    recording = read(str(file))
    columns = table(recording, chosen(recording, {"pose": "/odom"})).columns
    kept = np.load(tmp_path / "run" / "trajectory.npz")
    rows = np.searchsorted(columns["t"], kept["t"][5:-5] - 1e-9)
    np.testing.assert_allclose(columns["x"][rows], kept["position"][5:-5, 0], atol=1e-6)
    assert main(["log", str(file), "--out", str(tmp_path / "log"), "--quiet"]) == 1  # which of three is the pose?
    assert "Good for identification once this is said" in (tmp_path / "log" / "report.md").read_text()


@pytest.fixture
def recorded(tmp_path):
    """Columns by entity of a recording of Rerun, read by its own library; static ones have no time."""

    def read_back(write, told):
        from rerun.chunk import RrdReader

        with (tmp_path / "run.rrd").open("wb") as file:
            write(file, told)
        found = {}
        for chunk in RrdReader(tmp_path / "run.rrd").stream():
            batch = chunk.to_record_batch()
            columns = {name: batch.column(name).to_pylist() for name in batch.schema.names}
            found.setdefault(chunk.entity_path, {}).update(columns)
        return found

    return read_back


def of(columns, ending):
    """The values of a component, a row each."""
    (name,) = [name for name in columns if name.endswith(ending)]
    return np.array([x[0] for x in columns[name]], float)


def test_rerun_has_poses_of_the_axle_the_reference_and_every_number(recorded):
    run, axle = circling(LEVER)
    plant = agvjax.Unicycle(L=LEVER)
    found = recorded(rerun_file.write_runs, {"": of_run(run, plant)})
    robot = found["/map/robot"]
    np.testing.assert_allclose([x.total_seconds() for x in robot["t"]], np.asarray(run.t), atol=1e-6)
    np.testing.assert_allclose(of(robot, ":translation")[:, :2], axle, atol=1e-6)  # float32
    turn = of(robot, ":quaternion")
    heading = 2 * np.arctan2(turn[:, 2], turn[:, 3])
    np.testing.assert_allclose(np.exp(1j * heading), np.exp(1j * (3.0 + YAW_RATE * np.asarray(run.t))), atol=1e-6)
    np.testing.assert_allclose(of(found["/map/reference"], ":positions")[:, :2], axle, atol=1e-6)
    first, second = plant.actuators
    for place, value in ((f"asked/{first}", 0.7), (f"delivered/{second}", 0.8)):
        assert of(found[f"/{place}"], ":scalars").tolist() == [value] * 81
    assert found[f"/asked/{first}"]["SeriesLines:names"] == [[f"asked/{first}"]]


def test_rerun_keeps_runs_apart_and_numbers_that_are_not_finite(recorded):
    t = np.array([0.0, 0.1, 0.3])
    pose = np.array([[0.0, 0, 0], [1, 0, 0], [np.nan, 0, 0]])
    far = Track(t + 5, pose + 1, {"error/position": np.array([0.1, np.nan, 0.3])}, {"error/position": "m"})
    found = recorded(rerun_file.write_tracks, {"log1/measured": Track(t, pose, {}, {}), "log1/model": far})
    assert {"/map/log1/measured/robot", "/map/log1/model/robot", "/error/log1/model/position"} <= set(found)
    np.testing.assert_array_equal(of(found["/error/log1/model/position"], ":scalars"), [0.1, np.nan, 0.3])
    assert [x.total_seconds() for x in found["/map/log1/model/robot"]["t"]] == [5.0, 5.1, 5.3]


@pytest.mark.parametrize(
    ("option", "name"),
    [("--mcap", "there.mcap"), ("--mcap", "run.bag"), ("--rerun", "nowhere/run.rrd"), ("--rerun", "run.mcap")],
)
def test_a_file_that_cannot_be_written_is_refused_before_anything_runs(tmp_path, monkeypatch, capsys, option, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.mcap").write_bytes(b"kept")
    assert main(["simulate", "--out", "run", option, name]) == 2
    end = ".mcap" if option == "--mcap" else ".rrd"
    assert f"{option} = {name}: must be a new file that ends in {end}" in capsys.readouterr().err
    assert main(["simulate", "--out", "run", "--mcap", "a.txt", "--rerun", f"{'b' * 240}.rrd"]) == 2
    assert "2 bad values" in capsys.readouterr().err and [path.name for path in tmp_path.iterdir()] == ["there.mcap"]
    assert not (tmp_path / "run").exists() and (tmp_path / "there.mcap").read_bytes() == b"kept"


def test_what_is_not_installed_is_named(monkeypatch):
    monkeypatch.setattr(options.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"mcap and rosbags.*pip install 'agvjax\[viewer\]'"):
        options.check(Asked(mcap="run.mcap"))
    with pytest.raises(InputError, match="rerun is not installed"):
        options.check(Asked(rerun="run.rrd"))
