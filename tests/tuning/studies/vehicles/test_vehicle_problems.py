"""Vehicles on the command line and in the tuner: what a configuration means for them, and what it may not say."""

import dataclasses
import json
import tomllib

import numpy as np
import pytest
from PIL import Image

import agvjax
import tuning
from commands import arguments, python, run
from tuning import config as configuration
from tuning.cli import main as cli
from tuning.config.load import VEHICLES, resolve
from tuning.sweep import rules as sweep_rules
from tuning.sweep.laws import named
from tuning.tune import rules as tune_rules

SHORT = ["simulate.horizon=0.2", "simulate.save_every=10"]
BRIEF = ["ensemble.size=4", "ensemble.validation_size=4", "tune.iterations=3", "simulate.horizon=1"]
BRIEF += ["tune.search.scouts=1", "tune.search.starts=1", "tune.search.iterations=1", "tune.search.checks=0"]


@pytest.mark.parametrize("name", VEHICLES)
def test_built_in_vehicles_are_sound_and_read_back_as_they_are(name):
    for rules in (tune_rules.faults, sweep_rules.faults):
        config = configuration.load([name], [], rules)
        text = configuration.dump(config)
        assert configuration.dump(resolve(tomllib.loads(text), rules)) == text
    assert isinstance(config.controller, agvjax.Sampled)
    assert type(config.controller.vehicle) is type(config.scenario.plant)
    assert not set(config.tune.gains) & {"inner.k3", "inner.Lam_psi"}  # the heading is internal
    assert not any("heading" in metric for metric in (*config.tune.limits, *config.sweep.metrics))


def test_defaults_follow_the_plant():
    config = configuration.load([], ["scenario.plant=differential_drive"])
    wheels = {"torque_left", "torque_right"}
    assert set(config.scenario.deadzone) == wheels
    assert {name.split(".")[1] for name in config.ensemble.draws if name.startswith("deadzone")} == wheels
    assert config.tune.gains == ("k1", "k2", "Lam", "omega_n", "zeta")
    assert set(config.tune.limits) == {"effort", "peak_position"}


def test_the_computer_takes_the_vehicle_for_the_configured_one_unless_told():
    longer = {"plant": {"type": "unicycle", "L": 0.7}}
    config = resolve({"controller": {"type": "sampled"}, "scenario": longer})
    assert config.controller.vehicle.L == 0.7
    believed = {"type": "sampled", "vehicle": {"type": "unicycle", "L": 0.6}}
    config = resolve({"controller": believed, "scenario": {"plant": "unicycle"}})
    assert (config.controller.vehicle.L, config.scenario.plant.L) == (0.6, 0.5)


@pytest.mark.parametrize("name", VEHICLES)
def test_gains_of_a_vehicle_are_read_back_with_the_vehicle(name, tmp_path):
    first = configuration.load([name], ["simulate.horizon=3", "scenario.limit=500"])
    law = agvjax.replace(first.controller, {"inner.k1": 3.25})
    (tmp_path / "gains.toml").write_text(configuration.gains_table(law))
    notes = []
    with pytest.raises(agvjax.InputError, match=r"a vehicle with the actuators of scenario.plant"):
        configuration.load([str(tmp_path / "gains.toml")], note=notes.append)  # nothing says which vehicle
    assert "it is run in the paper's" in notes.pop()
    (tmp_path / "config.toml").write_text(configuration.dump(first))
    again = configuration.load([str(tmp_path / "gains.toml")], ["seed=3"], note=notes.append)
    assert notes.pop().endswith(f"read from {tmp_path / 'config.toml'}; another --config says another scenario")
    whole = configuration.dump(dataclasses.replace(first, controller=law, seed=3))
    assert configuration.dump(again) == whole
    elsewhere = configuration.load([str(tmp_path / "gains.toml"), name], note=notes.append)
    assert not notes and elsewhere.scenario.limit == 1000
    sweep = configuration.load([name], [f"sweep.controllers=['{tmp_path}/gains.toml']"], sweep_rules.faults)
    assert [float(one.inner.k1) for one in named(sweep).values()] == [float(first.controller.inner.k1), 3.25]


def test_a_type_given_by_name_can_be_refined():
    config = configuration.load(["unicycle"], ["scenario.plant.L=0.4"])
    assert (config.scenario.plant.L, config.controller.vehicle.L) == (0.4, 0.4)


def test_a_later_table_of_another_type_or_distribution_begins_anew(tmp_path):
    """What stood before means nothing there; a table that names neither changes what is there."""
    (tmp_path / "push.toml").write_text('[scenario.disturbance]\ntype = "cosine"\namplitude = 0.7\n')
    (tmp_path / "draw.toml").write_text('[ensemble.draws]\n"start.heading" = { between = [-0.5, 1.0] }\n')
    push, draw = [str(tmp_path / "push.toml")], [str(tmp_path / "draw.toml")]
    other = "scenario.disturbance={type='step',time=0.3}"
    disturbance = configuration.load(push, [other]).scenario.disturbance
    assert type(disturbance) is agvjax.Step and (disturbance.amplitude, disturbance.time) == (0.2, 0.3)
    assert configuration.load(push, ["scenario.disturbance.omega=0.3"]).scenario.disturbance.amplitude == 0.7
    drawn = "ensemble.draws.start.heading={distribution='norm',loc=0.1,scale=0.2}"
    found = configuration.load(draw, [drawn, "ensemble.draws.start.heading.scale=0.3"]).ensemble.draws["start.heading"]
    assert (found.name, found.parameters) == ("norm", {"loc": 0.1, "scale": 0.3})


def test_chains_keep_the_order_of_their_table():
    table = {"lag": {"time_constant": 0.03}, "stop": {"type": "saturation", "upper": 2.0}, "delay": {"time": 0.01}}
    scene = {"scenario": {"plant": "unicycle", "actuators": {"acceleration": table}}, "controller": "sampled"}
    config = resolve(scene)
    for read in (config, resolve(tomllib.loads(configuration.dump(config)))):
        chain = read.scenario.actuators["acceleration"]
        assert list(chain) == ["lag", "stop", "delay"] and chain["stop"].upper == 2.0


def unicycle(**scene):
    return {"scenario": {"plant": "unicycle", **scene}}


def sampled(**law):
    return {"controller": {"type": "sampled", **law}}


WRONG = [
    ({"scenario": {"plant": "tricycle"}}, "scenario.plant.type"),
    (unicycle(actuators={"position": {"delay": {}}}), "scenario.actuators.position"),
    (unicycle(actuators={"acceleration": {"lagg": {}}}), "acceleration.lagg"),
    (unicycle(actuators={"acceleration": 3}), "scenario.actuators"),
    (unicycle(actuators={"acceleration": {"delay": {"time": -1}}}), "delay.time"),
    (unicycle() | {"tune": {"limits": {"peak_heading": 1.0}}}, "tune.limits.peak_heading"),
    (unicycle() | {"tune": {"goals": {"rmse_heading": 1.0}}}, "tune.goals.rmse_heading"),
    (unicycle(deadzone={"heading": {"slope_left": 1}}), "scenario.deadzone.heading"),
    (unicycle() | sampled(vehicle="decoupled"), "controller.vehicle"),
    (unicycle() | sampled(period=0.0175), "dt"),
    (sampled(period=-1), "controller.period"),
    (sampled() | {"simulate": {"control_every": 2}}, "simulate.control_every"),
    (
        unicycle(actuators={"acceleration": {"delay": {"time": 0.1}}}) | sampled(),
        "scenario.actuators.acceleration.delay.slots",
    ),
    (unicycle(actuators={"acceleration": {"lag": {"time_constant": 1e-4}}}) | sampled(), "dt"),
    (
        unicycle() | sampled(anti_windup={"type": "back_calculation", "limits": [1.0, 2.0, 3.0]}),
        "controller.anti_windup.limits",
    ),
]


@pytest.mark.parametrize("table, key", WRONG, ids=[key for _, key in WRONG])
def test_wrong_tables_are_named(table, key):
    with pytest.raises(agvjax.InputError) as caught:
        resolve(table, tune_rules.faults)
    assert any(key in problem.key for problem in caught.value.faults), str(caught.value)


@pytest.mark.slow
@pytest.mark.usefixtures("promotion_as_optax_has_it")
def test_a_limited_loop_is_tuned_by_the_same_command(tmp_path):
    out = tmp_path / "run"
    few = ['tune.gains=["inner.k1"]', "tune.dt=0.02", "simulate.dt=0.005"]
    assert cli.main(arguments("tune", out, BRIEF + few, "--config", "unicycle", "--quiet")) == 1
    text = (out / "report.md").read_text()
    assert "4 of 4 validation runs have not settled" in text  # in the one second that they are given
    assert "delivered_variation" in text
    assert "peak_heading" not in text
    gains = tomllib.loads((out / "gains.toml").read_text())["controller"]
    assert gains["type"] == "sampled"
    assert gains["inner"]["k1"] != 3.0
    assert gains["vehicle"]["type"] == "unicycle"
    files = [str(out / "config.toml"), str(out / "gains.toml")]
    assert configuration.load(files, []).controller.inner.k1 == gains["inner"]["k1"]


@pytest.mark.slow
def test_simulate_writes_what_the_actuators_did(tmp_path, capsys):
    out = tmp_path / "run"
    assert cli.main(arguments("simulate", out, SHORT, "--config", "unicycle", "--animate")) == 0
    metrics = json.loads((out / "metrics.json").read_text())
    assert set(metrics["rms_delivered"]) == {"acceleration", "yaw_acceleration"}
    assert set(metrics["rmse"]) == {"x", "y"}
    with np.load(out / "trajectory.npz") as saved:
        assert saved["inputs"].shape == (21, 2)
        assert saved["limited"].dtype == bool
    assert (out / "inputs.png").exists()
    with Image.open(out / "animation.gif") as moving:
        assert moving.n_frames == 5  # .2 s at 20 frames a second, and the first
    assert "at a limit" in capsys.readouterr().out


@pytest.mark.slow
def test_an_animation_that_fails_leaves_nothing_half_written(tmp_path, monkeypatch):
    from agvjax.draw import animate

    def fails(*_):
        raise OSError("disk full")

    monkeypatch.setattr(animate, "write_gif", fails)
    out = tmp_path / "run"
    assert cli.main(arguments("simulate", out, SHORT, "--animate", "--quiet")) == 1
    assert not [file for file in out.iterdir() if "animation" in file.name]


@pytest.mark.slow
def test_one_metric_alone_can_be_tuned():
    # with the compiler options of `tune_xla` a gather of one row once brought the compiler of jaxlib 0.10.1 down
    program = """
import agvjax
agvjax.tune_xla()
import jax, jax.numpy as jnp
from tuning import Objective
objective = Objective(limits=())
values, ok = jnp.linspace(1.0, 2.0, 64)[None], jnp.ones(64, bool)
reference = objective.baseline(values, ok)
slope = jax.jit(jax.grad(lambda v: objective.score(v, ok, reference).cost))(values)
assert abs(float(slope.sum()) - (1 / 1.5 + .3 / 2)) < 1e-5, slope.sum()
"""
    python(program)


@pytest.mark.slow
def test_metrics_of_what_is_delivered_are_those_of_the_samples():
    scenario = configuration.load(["unicycle"], []).scenario
    law = agvjax.Sampled(vehicle=agvjax.Unicycle())
    run = agvjax.simulate(law, scenario, n_steps=1000)
    found = agvjax.evaluate(law, scenario, n_steps=1000, criteria=agvjax.Criteria(delivered=True))
    u, t = np.asarray(run.delivered), np.asarray(run.t)
    np.testing.assert_allclose(found.rms_delivered, np.sqrt(np.trapezoid(u**2, t, axis=0)), rtol=1e-9)
    np.testing.assert_allclose(found.variation_delivered, np.abs(np.diff(u, axis=0)).sum(0), rtol=1e-9)
    np.testing.assert_allclose(found.peak_delivered, np.abs(u).max(0), rtol=1e-12)
    np.testing.assert_allclose(found.limited, np.trapezoid(np.asarray(run.limited, float), t), rtol=1e-9)


@pytest.mark.slow
def test_sweeps_take_vehicles_too(tmp_path):
    out = tmp_path / "sweep"
    settings = ["sweep.radius=false", *SHORT[:1]]
    axes = ["--over", "actuators.acceleration.delay.time=0.0:0.02:3", "--over", "controller.inner.k1=2:4:2"]
    assert cli.main(arguments("sweep", out, settings, *axes, "--config", "unicycle", "--quiet")) == 0
    assert tuning.load(out).metrics


@pytest.mark.slow
def test_the_report_on_vehicles_holds_what_is_promised(tmp_path):
    pytest.importorskip("mujoco")
    pytest.importorskip("vehiclemodels")
    out = tmp_path / "vehicles"
    run(["vehicles", "--quiet", "--out", str(out)])
    found = json.loads((out / "findings.json").read_text())
    assert found["paper"]["continuous"]["late"] < 0.01
    assert found["paper"]["50 Hz, exact"]["late"] < 0.01
    assert not found["paper"]["50 Hz, Euler"]["ok"]
    assert found["lost"] > 0
    near, far = found["limited"]["tuned, paper's start"], found["limited"]["tuned, 3 m off"]
    assert near["rmse"] <= 0.17 and near["settling"] <= 2 and near["late"] <= 0.03
    assert far["settling"] <= 4 and found["unseen"]["settling"] <= 4
    assert found["limited"]["tuned, no anti-windup, paper's start"]["late"] > 1
    for name, row in found["car"].items():
        if name.startswith("tuned"):
            assert row["late"] <= 0.10 and row["steering_rate"] <= 0.4 + 1e-9 and row["acceleration"] <= 11.5 + 1e-9
    for path in ("circle", "lemniscate", "spline"):
        rows = {row["law"]: row for row in found["robot"] if row["path"] == path}
        before, after = rows["paper's gains"], rows["tuned gains"]
        for metric in ("rmse", "rms_torque", "variation"):
            assert after[metric] < before[metric], (path, metric)
        assert after["late_without_noise"] <= 0.01
    with Image.open(out / "robot.gif") as moving:
        assert moving.n_frames > 100


@pytest.mark.slow
def test_a_lap_of_the_car_replayed_in_commonroads_own_model():
    pytest.importorskip("vehiclemodels")
    from tuning.studies.vehicles.worlds import CommonRoadWorld

    config = configuration.load(["car"], ["scenario.disturbance=none"])
    start = config.scenario.start
    run = agvjax.simulate(config.controller, config.scenario, dt=0.01, n_steps=6280)
    assert run.ok
    world, places = CommonRoadWorld(step=0.01), []
    world.reset(start.position, start.velocity, float(start.heading))
    for acceleration, steering_rate in np.asarray(run.delivered):
        places.append(np.asarray(world.measure().position))
        world.apply({"acceleration": acceleration, "steering_rate": steering_rate}, 0.01)
    assert np.ptp(np.asarray(run.position), axis=0).min() > 70  # a whole lap
    np.testing.assert_allclose(places, run.position, atol=1e-6)
