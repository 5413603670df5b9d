"""The command line: what it writes, what it says of bad input, and how it survives being stopped."""

import csv
import json
import os
import re
import shutil
import signal
import socket
import time
import tomllib

import jax
import numpy as np
import pytest

import agvjax
from claimed import MEANT, meant, unqualified
from commands import FAST, HUNG, SHORT_TUNE, arguments, contents, files_of, python, run, start
from tuning.cli import main as cli
from tuning.compute import compiled as startup
from tuning.compute import memory
from tuning.config.load import _override

TUNE = [*FAST, *SHORT_TUNE, "tune.clip=1", "tune.iterations=1500", "tune.patience=2000", "ensemble.size=8"]
FIGURES = {"simulate": ("path", "errors", "commands"), "tune": ("nominal", "worst", "history", "sensitivity")}
TUNED = ["checkpoint.npz", "config.toml", "gains.toml", "history.csv", "metrics.jsonl"]


@pytest.fixture
def refused(monkeypatch, capsys, tmp_path, tmp_path_factory):
    """Runs the command in this process, the state of JAX left alone, to exit code 2; returns what it says.

    It says all the words, and changes nothing in the folder of the test.
    """
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
    monkeypatch.setattr(startup, "keep_compiled", lambda: None)
    monkeypatch.setattr(agvjax, "tune_xla", lambda **_: "fast compiler options set")

    def call(argv, *words):
        before = contents(tmp_path)
        try:
            assert cli.main(argv) == 2
        finally:
            jax.config.update("jax_enable_x64", True)
        out, err = capsys.readouterr()
        assert out == "" and "Traceback" not in err
        said = re.sub(r"^reading \.\.\. .*, stopped\n", "", err)  # the phase that ends where a file cannot be read
        assert said.startswith(f"agvjax {argv[0]}: ") and err.count("bad value") == 1
        assert [word for word in words if word not in err] == [], err
        assert contents(tmp_path) == before
        return err

    return call


@pytest.fixture(scope="session")
def simulated(tmp_path_factory):
    out = tmp_path_factory.mktemp("cli") / "new" / "simulated"
    return out, run(arguments("simulate", out, [*FAST, "simulate.save_every=4"]))[0]


@pytest.fixture(scope="session")
def tuned(tmp_path_factory):
    out = tmp_path_factory.mktemp("cli") / "tuned"
    return out, run(arguments("tune", out, TUNE))[0]


# -------------------------------------------------------------------------------------------------------- simulate


def test_simulate_writes_the_samples_it_promises(simulated):
    samples = 100 // 4 + 1
    shapes = {"t": (), "heading": (), "reference_heading": (), "command": (3,), "delivered": (3,), "weight_norm": (2,)}
    shapes |= {"position": (2,), "velocity": (2,), "reference_position": (2,), "inputs": (3,), "limited": ()}
    with np.load(simulated[0] / "trajectory.npz", allow_pickle=False) as file:
        arrays = dict(file)
    assert {name: a.shape for name, a in arrays.items()} == {name: (samples, *s) for name, s in shapes.items()}
    assert not arrays.pop("limited").any()
    assert all(a.dtype == np.float64 and np.all(np.isfinite(a)) for a in arrays.values())
    np.testing.assert_allclose(arrays["t"], np.arange(samples) * 0.04, atol=1e-12)
    np.testing.assert_array_equal(arrays["position"][0], [-0.5, 0.5])  # section 4
    np.testing.assert_array_equal(arrays["velocity"][0], [0.1, 0.1])
    assert arrays["heading"][0] == 0.1
    np.testing.assert_array_equal(arrays["weight_norm"][0], [0.1, 0.1])
    phase = 11 / 21 * arrays["t"]
    np.testing.assert_allclose(
        arrays["reference_position"], np.stack([np.sin(2 * phase), np.sin(phase)], 1), atol=1e-12
    )


@pytest.mark.slow
def test_what_a_compiler_says_of_programs_it_kept_is_no_concern_of_the_user(simulated, tmp_path):
    """openxla/xla issue 44565: on processors with AVX-512 two lines of 2000 characters for each at a second start."""
    for name in ("once", "again"):  # the fixture has run it before, but perhaps in a cache of another session
        _, err = run([*arguments("simulate", tmp_path / name, [*FAST, "simulate.save_every=4"]), "--quiet"])
    assert err == ""


def test_simulate_writes_metrics_configuration_and_figures(simulated):
    out, said = simulated
    figures = [f"{name}.png" for name in FIGURES["simulate"]]
    assert files_of(out) == sorted(["config.toml", "metrics.json", "trajectory.npz", *figures])
    for name in figures:
        data = (out / name).read_bytes()
        assert data.startswith(b"\x89PNG") and data.endswith(b"IEND\xaeB`\x82")
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["ok"] is True
    for name in ("rmse", "iae", "ise", "itae", "overshoot", "settling_time", "rms_command", "peak_command", "chatter"):
        assert list(metrics[name]) == ["x", "y", "heading"], name
    # nothing can be said to have settled that was outside the band within 1 s of the end, and the start is
    assert metrics["settling_time"] == dict.fromkeys(("x", "y", "heading"), "not settled")
    with np.load(out / "trajectory.npz") as file:
        largest = np.abs(file["command"]).max(axis=0)
    assert np.all(np.array(list(metrics["peak_command"].values())) >= largest)
    assert str(out) in said and "rmse" in said and "not settled" in said


@pytest.mark.slow
def test_the_configuration_read_back_gives_itself_byte_by_byte(simulated, tmp_path):
    before = simulated[0] / "config.toml"
    out = tmp_path / "again"
    said = run(["simulate", "--config", str(before), "--out", str(out), "--quiet"])
    assert said[0] == ""
    assert (out / "config.toml").read_bytes() == before.read_bytes()
    with np.load(simulated[0] / "trajectory.npz") as old, np.load(out / "trajectory.npz") as new:
        for name in old:
            np.testing.assert_array_equal(new[name], old[name])


@pytest.mark.slow
def test_later_settings_win_and_options_beat_them_all(tmp_path):
    first, second = tmp_path / "first.toml", tmp_path / "second.toml"
    first.write_text("seed = 3\nprecision = 64\n[controller]\nk1 = 21\nk3 = 13\n[scenario]\npath = 'circle'\n")
    second.write_text("[controller]\nk1 = 22\n[scenario.path]\ntype = 'circle'\nradius = 2\n")
    out = tmp_path / "out"
    settings = [*FAST, "controller.k3=14", "controller.k3 = 15", "precision=64"]
    more = ["--config", first, "--config", second, "--precision", 32, "--seed", 7]
    run(arguments("simulate", out, settings, *more))
    config = read_toml(out / "config.toml")
    assert (config["seed"], config["precision"]) == (7, 32)
    assert (config["controller"]["k1"], config["controller"]["k2"], config["controller"]["k3"]) == (22, 20, 15)
    assert config["scenario"]["path"] == {"type": "circle", "radius": 2, "omega": 0.5}
    with np.load(out / "trajectory.npz") as file:
        assert {a.dtype for name, a in file.items() if name != "limited"} == {np.dtype(np.float32)}
        np.testing.assert_allclose(np.hypot(*file["reference_position"].T), 2, rtol=1e-6)


@pytest.mark.slow
def test_a_simulation_that_diverges_exits_with_1_and_is_written(tmp_path):
    out = tmp_path / "out"
    _, err = run(arguments("simulate", out, [*FAST, "scenario.limit=0.1"]), code=1)
    assert "diverged" in err and str(out) in err and "scenario.limit = 0.1" in err
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["ok"] is False and metrics["rmse"] == {"x": None, "y": None, "heading": None}
    assert (out / "trajectory.npz").exists()


# ------------------------------------------------------------------------------------------------------------ tune


def read_toml(file):
    return tomllib.loads(file.read_text())


def history(out):
    with (out / "history.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_tune_writes_what_it_promises(tuned):
    out, said = tuned
    figures = [f"{name}.png" for name in FIGURES["tune"]]
    assert files_of(out) == sorted([*TUNED, "report.html", "report.md", "runs.html", "worst.json", *figures])
    assert all((out / name).read_bytes().startswith(b"\x89PNG") for name in figures)
    report = (out / "report.md").read_text()
    assert meant(report) == ["worst of 4", "worst before a metric, in goals and limits", "worst found", "proved"]
    assert not unqualified(report) and not unqualified(said)
    verdict = report.split("**")[1]
    assert verdict.startswith("Tuned: all limits are met") and verdict in " ".join(said.split())
    assert "Gains: k1 " in said and str(out) in said
    assert "agvjax simulate --config config.toml --config gains.toml" in report
    assert "validation" in report and "| k1 |" in report and all(name in report for name in figures)
    judged = json.loads((out / "worst.json").read_text())
    assert judged["verdict"] == "" and judged["gains"]["k1"] == read_toml(out / "gains.toml")["controller"]["k1"]
    with np.load(out / "checkpoint.npz", allow_pickle=False) as file:
        assert file["0/iteration"] == 1500


def test_the_history_has_a_row_an_iteration(tuned):
    rows = history(tuned[0])
    columns = ["round", "start", "iteration", "cost", "goal", "excess", "latched", "gradient_norm", "clipped"]
    assert list(rows[0]) == [*columns, "backed_out", "rollouts", "k1", "k3"]
    assert [row["iteration"] for row in rows] == [str(i) for i in range(1500)]
    assert (rows[0]["latched"], rows[0]["backed_out"], rows[0]["rollouts"]) == ("0", "0", "3")
    np.testing.assert_allclose([float(rows[0][name]) for name in ("cost", "k1", "k3")], [1.3, 20, 12], rtol=1e-9)


def test_the_log_has_the_rows_of_the_history(tuned):
    lines = [json.loads(line) for line in (tuned[0] / "metrics.jsonl").read_text().splitlines()]
    rows = history(tuned[0])
    assert len(lines) == len(rows) and list(lines[0]) == list(rows[0])
    for line, row in zip(lines[::100], rows[::100], strict=True):
        assert [float(x) for x in line.values()] == [float(x) for x in row.values()]


def test_the_gains_are_the_best_of_the_history_and_the_rest_is_untouched(tuned):
    gains = read_toml(tuned[0] / "gains.toml")["controller"]
    assert set("k1 k2 k3 Lam Lam_psi omega_n zeta gamma1 gamma2 eta1 eta2 b1 b2".split()) <= set(gains)
    best = min(history(tuned[0]), key=lambda row: (max(0.0, float(row["excess"]) - 5e-4), float(row["goal"])))
    assert (gains["k1"], gains["k3"]) == (float(best["k1"]), float(best["k3"]))
    kept = {"k2": 20, "Lam": 16, "Lam_psi": 9, "omega_n": 90, "zeta": 0.75, "gamma1": 0.1, "eta1": 0.001, "b1": 1}
    assert {name: gains[name] for name in kept} == kept


@pytest.mark.slow
def test_the_gains_are_settings_for_simulate(tuned, tmp_path):
    out = tmp_path / "out"
    run(arguments("simulate", out, FAST, "--config", tuned[0] / "gains.toml"))
    wanted, used = read_toml(tuned[0] / "gains.toml")["controller"], read_toml(out / "config.toml")["controller"]
    assert {name: used[name] for name in wanted} == wanted


@pytest.mark.slow
def test_an_ensemble_in_which_every_run_diverges_exits_with_1(tmp_path):
    out = tmp_path / "out"
    _, err = run(arguments("tune", out, [*TUNE, "scenario.limit=0.1", "ensemble.size=2"], "--quiet"), code=1)
    assert "every one of the 2 runs diverges" in err
    assert files_of(out) == ["config.toml", "metrics.jsonl"]


def stop_midway(out, settings, how, folder_has="checkpoint.npz"):
    process = start(arguments("tune", out, settings, "--quiet"))
    deadline = time.monotonic() + HUNG
    while not (out / folder_has).exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.002)
    process.send_signal(how)
    said, err = process.communicate(timeout=HUNG)
    assert said == ""
    return process.returncode, err


def resume_and_compare(out, wanted, settings):
    with np.load(out / "checkpoint.npz") as file:
        assert 0 < file["0/iteration"] < len(history(wanted)), "stopped too late to say anything"
    run(arguments("tune", out, settings, "--resume", "--quiet"))
    for name in ("history.csv", "metrics.jsonl", "gains.toml", "config.toml", "report.md", "worst.json"):
        assert (out / name).read_bytes() == (wanted / name).read_bytes(), name
    assert files_of(out) == files_of(wanted)  # in particular no *.part


@pytest.mark.slow
def test_ctrl_c_keeps_the_best_gains_and_the_rest_can_be_made_up(tuned, tmp_path):
    out = tmp_path / "out"
    code, err = stop_midway(out, TUNE, signal.SIGINT)
    assert code == 130, err
    assert "interrupted" in err and "Traceback" not in err
    assert files_of(out) == TUNED
    rows, whole = (folder / "history.csv" for folder in (out, tuned[0]))
    assert whole.read_bytes().startswith(rows.read_bytes())
    assert set(read_toml(out / "gains.toml")["controller"]) >= {"k1", "k3"}
    resume_and_compare(out, tuned[0], TUNE)


@pytest.mark.slow
@pytest.mark.parametrize("attempt", range(3))
def test_a_killed_run_can_be_made_up(attempt, tuned, tmp_path):
    out = tmp_path / "out"
    code, _ = stop_midway(out, TUNE, signal.SIGKILL)
    assert code == -signal.SIGKILL
    resume_and_compare(out, tuned[0], TUNE)


@pytest.mark.slow
def test_a_run_stopped_before_its_first_checkpoint_can_be_begun_again(tuned, tmp_path):
    out = tmp_path / "out"
    code, _ = stop_midway(out, TUNE, signal.SIGKILL, folder_has="config.toml")
    assert code == -signal.SIGKILL and not (out / "checkpoint.npz").exists()
    run(arguments("tune", out, TUNE, "--resume", "--quiet"))
    assert (out / "history.csv").read_bytes() == (tuned[0] / "history.csv").read_bytes()


@pytest.mark.slow
def test_a_finished_run_resumed_only_reports_again(tuned, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    for name in ("checkpoint.npz", "config.toml"):
        shutil.copy(tuned[0] / name, out)
    run(arguments("tune", out, TUNE, "--resume"))
    for name in ("history.csv", "gains.toml", "report.md"):
        assert (out / name).read_bytes() == (tuned[0] / name).read_bytes(), name


# ------------------------------------------------------------------------------------------------------- bad input

BAD = {
    "unknown key": ("controller.omega=1", ("controller.omega", "did you mean omega_n?")),
    "unknown section": ("simulat.dt=1", ("simulat", "did you mean simulate?")),
    "a word where a number belongs": ("controller.k1=fast", ("controller.k1", "'fast'", "a number")),
    "a flag where a number belongs": ("controller.k1=true", ("controller.k1", "True", "a number")),
    "a number where a flag belongs": ("controller.wrapped=1", ("controller.wrapped", "true or false")),
    "a number where a word belongs": ("simulate.integrator=4", ("simulate.integrator", "a string")),
    "a date": ("controller.k1=1979-05-27", ("controller.k1", "1979", "a number")),
    "an array where a number belongs": ("controller.k1=[1, 2]", ("controller.k1", "a number")),
    "a table where a number belongs": ("controller.k1.x=1", ("controller.k1", "a number")),
    "a number where a table belongs": ("scenario.deadzone.position=3", ("scenario.deadzone.position", "a table")),
    "nothing where a number belongs": ("controller.k1=", ("controller.k1", "a number")),
    "an array of another length": ("controller.Pi_hat=[1, 1, 1]", ("controller.Pi_hat", "(2,)")),
    "negative slope": ("scenario.deadzone.heading.slope_left=-0.7", ("deadzone.heading.slope_left", "-0.7", "> 0")),
    "slope 0": ("scenario.deadzone.heading.slope_left=0", ("deadzone.heading.slope_left", "> 0")),
    "negative threshold": ("scenario.deadzone.position.threshold_left=-0.4", ("threshold_left", "-0.4", ">= 0")),
    "unknown channel": ("scenario.deadzone.yaw.slope_left=1", ("scenario.deadzone.yaw", "position, heading")),
    "NaN": ("controller.k2=nan", ("controller.k2", "nan", "finite")),
    "infinity": ("scenario.start.heading=inf", ("scenario.start.heading", "inf", "finite")),
    "a number too large for a float": ("controller.k1=1e400", ("controller.k1", "finite")),
    "dt 0": ("simulate.dt=0", ("simulate.dt", "> 0")),
    "negative dt": ("tune.dt=-0.001", ("tune.dt", "-0.001", "> 0")),
    "dt NaN": ("simulate.dt=nan", ("simulate.dt", "nan")),
    "dt too large for the filter": ("simulate.dt=0.05", ("simulate.dt", "0.05", "command filter")),
    "horizon shorter than dt": ("simulate.horizon=0.0001", ("simulate.horizon", "0.0001", "one step")),
    "negative horizon": ("simulate.horizon=-1", ("simulate.horizon", "-1", "> 0")),
    "horizon no multiple of dt": ("simulate.dt=0.007", ("simulate.dt", "0.007", "horizon")),
    "save_every no divisor": ("simulate.save_every=7", ("simulate.save_every", "7")),
    "save_every a fraction": ("simulate.save_every=1.5", ("simulate.save_every", "1.5", "whole")),
    "control_every 0": ("simulate.control_every=0", ("simulate.control_every", ">= 1")),
    "negative seed": ("seed=-1", ("seed", "-1", "from 0")),
    "huge seed": (f"seed={2**70}", ("seed", str(2**70))),
    "precision": ("precision=16", ("precision", "16", "32 or 64")),
    "version": ("version=99", ("version", "99")),
    "unknown path": ("scenario.path=square", ("scenario.path", "'square'", "dumbbell", "circle")),
    "unknown controller": ("controller=''", ("controller", "neuro_backstepping")),
    "unknown optimiser": ("tune.optimizer=adaam", ("tune.optimizer", "adaam", "optax")),
    "unknown option of the optimiser": ("tune.options.momentun=1", ("tune.options", "momentun", "empty")),
    "unknown metric to minimise": ("tune.goals.total_rsme=1", ("tune.goals.total_rsme", "total_rmse?")),
    "unknown metric to limit": ("tune.limits.total_rsme=1", ("tune.limits.total_rsme", "total_rmse?")),
    "limit 0": ("tune.limits.effort=0", ("tune.limits.effort", ">= 1e-09")),
    "unknown gain": ('tune.gains=["k9"]', ("tune.gains", "k9", "k1")),
    "no gain": ("tune.gains=[]", ("tune.gains", "[]")),
    "iterations 0": ("tune.iterations=0", ("tune.iterations", ">= 1")),
    "ensemble of none": ("ensemble.size=0", ("ensemble.size", "from 1")),
    "bad draw": ("ensemble.draws.start.heading.between=[0]", ("start.heading", "between", "low <= high")),
    "reversed draw": ("ensemble.draws.start.heading.between=[1, 0]", ("start.heading", "[1, 0]", "low <= high")),
    "unknown kind of draw": ("ensemble.draws.start.heading.around=[0, 1]", ("start.heading", "between")),
    "draw of an unknown leaf": ("ensemble.draws.start.headin.between=[0, 1]", ("start.headin", "mean start.heading?")),
    "reversed bounds": ("tune.bounds.k1=[30, 10]", ("tune.bounds.k1", "[30, 10]", "low <= high")),
    "no value": ("controller.k1", ("--set", "controller.k1", "key=value")),
    "no key": ("=1", ("--set", "=1", "key=value")),
}


TUNING_ONLY = {"unknown optimiser", "unknown option of the optimiser", "limit 0", "unknown gain"}
TUNING_ONLY |= {"draw of an unknown leaf", "no gain"}  # laws whose gains nothing can tune are simulated too


@pytest.mark.parametrize(
    ("command", "setting"), [(c, s) for c in ("simulate", "tune") for s in BAD if c == "tune" or s not in TUNING_ONLY]
)
def test_a_bad_setting_is_named_with_its_value_and_rule(command, setting, refused, tmp_path):
    bad, words = BAD[setting]
    said = refused(arguments(command, tmp_path / "out", [bad]), *words)
    assert all(words[0] in line for line in said.strip().splitlines()[1:])


RIGHT = "deadzone.position.threshold_right"
BAD_SWEEP = {
    "unknown leaf": (["--over", "start.headin=0:1:3"], ("sweep.over", "start.headin", "mean start.heading?")),
    "unknown gain": (["--over", "controller.k9=0:1:3"], ("sweep.over", "controller.k9", "controller.k3?")),
    "no axis": (["--over", RIGHT], ("--over", RIGHT, "LEAF=LOW:HIGH")),
    "no numbers": (["--over", f"{RIGHT}=a:b:c"], ("--over", "a:b:c", "LEAF=LOW:HIGH")),
    "reversed": (["--over", f"{RIGHT}=1:0:3"], (f"sweep.over.{RIGHT}", "low")),
    "no points": (["--over", f"{RIGHT}=0:1:0"], (f"sweep.over.{RIGHT}", "points")),
    "what the leaf may not hold": (["--over", f"{RIGHT}=-1:1:3"], (f"sweep.over.{RIGHT}", "-1.0", ">= 0")),
    "an element that is not there": (["--over", "start.position[2]=0:1:3"], ("start.position[2]", "(2,)")),
    "twice": (["--over", f"{RIGHT}=0:1:3", "--over", f"{RIGHT}=0:1"], ("sweep.over", RIGHT, "once")),
    "unequal points": (
        ["--set", f"sweep.over=[{{{RIGHT}={{between=[0,1],points=2}}, 'start.heading'={{between=[0,1]}}}}]"],
        ("sweep.over", "the same number of points"),
    ),
    "unknown design": (["--design", "hammersley"], ("sweep.design", "hammersley", "sobol")),
    "sensitivity of a grid": (["--over", f"{RIGHT}=0:1:3", "--design", "morris"], ("sweep.design", "morris", "grid")),
    "no sample": (["--samples", "0"], ("sweep.samples", "0")),
    "unknown metric": (["--set", 'sweep.metrics=["total_rsme"]'], ("sweep.metrics", "total_rsme", "total_rmse?")),
    "unknown failure": (["--set", "sweep.fails.total_rsme=2"], ("sweep.fails", "total_rsme", "total_rmse?")),
    "failure at nothing": (["--set", "sweep.fails.total_rmse=0"], ("sweep.fails.total_rmse", "> 0")),
    "unknown law": (["--controller", "pid"], ("sweep.controllers", "pid", "osfc")),
    "no file": (["--controller", "absent.toml"], ("sweep.controllers", "absent.toml", "readable")),
    "a law twice": (["--controller", "osfc", "--controller", "osfc"], ("sweep.controllers", "osfc", "once")),
    "coarse step": (["--set", "sweep.dt=0.05"], ("sweep.dt", "0.05", "command filter")),
    "gains too fast": (["--over", "controller.omega_n=50:500:3"], ("sweep.dt", "omega_n", "command filter")),
    "no such scheduler": (["--scheduler", "local:0"], ("--scheduler", "local:0", "local:N, tcp://HOST:PORT")),
    "processes of earlier releases": (
        ["--num-processes", "2", "--process-id", "1"],
        ("--num-processes = 2", "--process-id = 1", "workers share a sweep, --scheduler"),
    ),
    "nothing to go on with": (["--resume"], ("--resume", "has begun")),
    "nothing to go on with, --rare": (["--rare", "--ensemble", "--resume"], ("--resume", "has begun")),
}


@pytest.mark.parametrize("which", BAD_SWEEP)
def test_a_bad_sweep_is_named_with_its_value_and_rule(which, refused, tmp_path):
    options, words = BAD_SWEEP[which]
    refused(["sweep", "--out", str(tmp_path / "out"), *options], *words)


LITTLE = ["--set", "simulate.horizon=1", "--over", "start.heading=0:1:2", "--quiet"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("setting", "word"), [("sweep.fails.rmse_late_x=1.5", "rmse_late_x"), ("scenario.limit=0.1",) * 2]
)
def test_what_only_the_nominal_run_shows_leaves_nothing_either(setting, word, refused, tmp_path):
    refused(["sweep", "--set", setting, *LITTLE, "--out", str(tmp_path / "out")], word.partition("=")[0])


@pytest.mark.parametrize(
    ("argv", "word"),
    [
        ("simulate --set simulate.horizon=10000 --set simulate.dt=0.0001", "simulate.save_every"),
        ("sweep --design latin --samples 1000000000 --over start.heading=0:1", "sweep.samples"),
    ],
)
def test_what_no_memory_holds_leaves_nothing_either(argv, word, refused, tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "memory", lambda: 4e9)
    refused([*argv.split(), "--quiet", "--out", str(tmp_path / "out")], word, "GB")


def test_memory_is_asked_before_the_run(refused, tmp_path, monkeypatch):
    """One sample of a run has more than 20 and fewer than 60 numbers of 8 bytes."""
    kept, argv = 8 * 100_000, ["simulate", "--set", "simulate.horizon=100", "--set", "simulate.dt=0.001"]
    monkeypatch.setattr(agvjax, "simulate", lambda *_, **__: pytest.fail("it was run"))
    monkeypatch.setattr(memory, "memory", lambda: 20 * kept)
    refused([*argv, "--out", str(tmp_path / "out")], "simulate.save_every = 1: must be larger", "GB")
    monkeypatch.setattr(memory, "memory", lambda: 60 * kept)
    with pytest.raises(pytest.fail.Exception, match="it was run"):
        cli.main([*argv, "--out", str(tmp_path / "other"), "--quiet"])


def test_a_vehicle_of_no_sweep_is_refused(refused, tmp_path):
    simulate, place = ["simulate", "--out", str(tmp_path / "out")], ["--from", str(tmp_path), "--index", "0"]
    more = ["--set", "controller.k1=30", "--seed", "2"]
    refused([*simulate, *place, *more], "--from = controller.k1=30: must be left out", "--seed")
    refused([*simulate, "--index", "3"], "--from")
    refused([*simulate, *place], "holds no sweep")


def test_processes_that_do_not_know_each_other_are_refused(refused, tmp_path):
    argv = ["tune", "--out", str(tmp_path / "out"), "--coordinator", "localhost:1"]
    refused(argv, "--num-processes")
    refused([*argv, "--num-processes", "2", "--process-id", "2"], "from 0 to 1")


SWEEP = ["simulate.horizon=1", "sweep.integrator=euler", "sweep.radius=false"]
OVER = ["--over", f"{RIGHT}=0:1:3", "--over", "start.heading=0,0.2"]


@pytest.mark.slow
def test_a_sweep_is_written(tmp_path):
    out = tmp_path / "sweep"
    said, _ = run([*arguments("sweep", out, SWEEP), *OVER])
    assert "Where do the gains fail" not in said and "failed" in said and "agvjax simulate --from" in said
    written = {"config.toml", "findings.json", "manifest.json", "report.html", "report.md", "shard-00000.npz"}
    assert written | {"cuts.png", "map_total_rmse.png"} <= set(files_of(out))
    report = (out / "report.md").read_text()
    assert not unqualified(report + said) and "largest of this design" in report and MEANT not in report  # no claim
    span = {"between": [0.0, 1.0], "points": 3}
    assert read_toml(out / "config.toml")["sweep"]["over"] == [
        {RIGHT: span},
        {"start.heading": {"one_of": [0.0, 0.2]}},
    ]


@pytest.mark.slow
def test_a_sweep_is_done_again_to_the_byte_and_refused_to_another(refused, tmp_path):
    out = tmp_path / "sweep"
    command = [*arguments("sweep", out, SWEEP), *OVER]
    run(command)
    before = files_of(out)
    run(arguments("sweep", tmp_path / "again", (), "--config", out / "config.toml", "--quiet"))
    shards = [(folder / "shard-00000.npz").read_bytes() for folder in (out, tmp_path / "again")]
    assert np.load(out / "shard-00000.npz")["result/total_rmse"].shape == (1, 6) and len(shards[0]) == len(shards[1])
    (out / "manifest.json").rename(tmp_path / "manifest.json")
    refused([*command, "--seed", "1"], "not empty")
    run(command)
    assert (out / "manifest.json").read_bytes() == (tmp_path / "manifest.json").read_bytes()
    refused([*command, "--seed", "1"], "was `seed = 0`", "is `seed = 1`")
    assert files_of(out) == before


def test_all_bad_settings_are_named_at_once(refused, tmp_path):
    settings = ["controller.k1=-1", "scenario.deadzone.position.slope_right=nan", "simulate.dt=0", "foo=1"]
    settings += ["tune.optimizer=adaam", "tune.goals.x=1", "tune.limits.effort=-2"]
    settings += ["ensemble.draws.start.x.between=[0, 1]"]
    said = refused(arguments("tune", tmp_path / "out", settings), "8 bad values:")
    assert len(said.strip().splitlines()) == 9
    for key in ("controller.k1", "slope_right", "simulate.dt", "tune.optimizer", "foo", "goals.x", "start.x", "effort"):
        assert sum(key in line.partition(": must be")[0] for line in said.splitlines()) == 1, key


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["controller.k1=1"], ("controller.k1", "> 1", "(48)")),
        (["controller.k2=1.66"], ("controller.k2", "> 1.66667", "(52)")),
        (["controller.k3=1.38"], ("controller.k3", "> 1.38889", "(70)")),
        (["controller.zeta=1"], ("controller.zeta", "(0, 1)")),
        (["tune.bounds.k1=[30, 40]"], ("controller.k1", "20", "(30, 40)")),
        (["controller.k1=1", "controller.k3=1"], ("2 bad values", "controller.k1", "controller.k3")),
    ],
)
def test_gains_must_begin_within_their_bounds(settings, words, refused, tmp_path):
    refused(arguments("tune", tmp_path / "out", settings), *words)


@pytest.mark.parametrize("content", [None, b"\xff\xfe\x00", b"a = = 1", b"seed = 1\nseed = 2"])
def test_a_file_that_is_no_toml_is_named(content, refused, tmp_path):
    path = tmp_path / "mine.toml"
    if content is not None:
        path.write_bytes(content)
    refused(["simulate", "--config", str(path), "--out", str(tmp_path / "out")], "--config", str(path))


@pytest.mark.parametrize("command", ["simulate", "tune"])
@pytest.mark.parametrize("place", ["{}/file", "{}/file/below", "/proc/agvjax", "/dev/null"])
def test_a_place_that_cannot_be_written_is_named(command, place, refused, tmp_path):
    (tmp_path / "file").write_text("here")
    out = place.format(tmp_path)
    refused(arguments(command, out, FAST + ["tune.dt=0.01"]), "--out", out)


@pytest.mark.parametrize("command", ["simulate", "tune"])
def test_a_folder_that_holds_something_is_left_alone(command, refused, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "config.toml").write_text("mine")
    said = refused(arguments(command, tmp_path / "out", FAST + ["tune.dt=0.01"]), "--out", str(tmp_path / "out"))
    assert ("--resume" in said) == (command == "tune")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # numpy.load leaves a bad archive open
@pytest.mark.parametrize("damage", ["cut short", "empty", "something else"])
def test_a_damaged_checkpoint_is_named_and_left(damage, refused, tuned, tmp_path):
    out = shutil.copytree(tuned[0], tmp_path / "out")
    whole = (out / "checkpoint.npz").read_bytes()
    bad = {"cut short": whole[: len(whole) // 2], "empty": b"", "something else": b"gains"}[damage]
    (out / "checkpoint.npz").write_bytes(bad)
    refused(arguments("tune", out, TUNE, "--resume"), "--resume", str(out / "checkpoint.npz"))


def test_resuming_with_other_settings_says_which(refused, tuned, tmp_path):
    out = shutil.copytree(tuned[0], tmp_path / "out")
    rate = "was `tune.learning_rate = 0.1`", "is `tune.learning_rate = 0.05`"
    gain = "was `controller.k2 = 20.0`", "is `controller.k2 = 21"
    changed = [*TUNE, "tune.learning_rate=0.05", "controller.k2=21"]
    refused(arguments("tune", out, changed, "--resume"), "--resume", *rate, *gain)


def test_resuming_needs_the_folder_of_a_run(refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused(["tune", "--resume", "--set", "simulate.horizon=1"], "--out")
    none = tmp_path / "none"
    refused(arguments("tune", none, ["simulate.horizon=1"], "--resume"), str(none))


def test_without_a_command_help_is_printed_and_the_version_on_request(capsys):
    assert cli.main([]) == 0
    assert "usage: agvjax" in capsys.readouterr().out
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"agvjax {agvjax.__version__}\n"


def test_the_package_is_the_command():
    assert run(["--version"])[0] == f"agvjax {agvjax.__version__}\n"


@pytest.mark.parametrize(
    ("text", "value"),
    [(".3", 0.3), ("-.3", -0.3), ("5.", 5.0), ("+.5e1", 5.0), ("[.1, -.2, 3.]", [0.1, -0.2, 3.0]), ("1.5", 1.5)],
)
def test_numbers_may_be_set_as_a_person_writes_them(text, value):
    assert _override(f"a.b={text}") == {"a": {"b": value}}


@pytest.mark.parametrize("text", ["rk4", "./a.csv", "a.3", "v1.", "'.3'", "..", "1.2.3", ".3.", "a.b"])
def test_words_with_dots_stay_words(text):
    assert _override(f"a={text}") == {"a": text.strip("'")}


NOT_FILES = {"/dev/zero": "no regular file", "/dev/null": "no regular file", ".": "folder", "pipe": "no regular file"}


@pytest.mark.parametrize("place", NOT_FILES)
def test_what_is_no_regular_file_is_refused_wherever_a_file_is_asked_for(place, refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    words = place, NOT_FILES[place]
    refused(["simulate", "--config", place], *words)
    refused(["simulate", "--import", place], *words)
    refused(["export", place, "--format", "c"], *words)
    refused(["identify", place, "--config", "unicycle"], place)
    refused(["simulate", "--set", f'scenario.path={{type="waypoints", file="{place}"}}'], place)


DEEP = {
    "dotted": b"a." * 100_000 + b"b = 1",
    "dotted table": b"[" + b"a." * 100_000 + b"b]",
    "lists": b"a = " + b"[" * 50_000,
    "closed lists": b"a = " + b"[" * 200 + b"]" * 200,
    "tables": b"a = " + b"{a=" * 300 + b"1" + b"}" * 300,
    "digits": b"seed = " + b"1" * 5000,
}


@pytest.mark.parametrize("kind", DEEP)
def test_what_would_take_all_of_the_stack_or_for_ever_is_refused(kind, refused, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(DEEP[kind])
    refused(["simulate", "--config", str(path)], "--config", str(path))
    refused(["export", str(path), "--format", "c"], "GAINS.toml", str(path))
    said = refused(["simulate", "--set", DEEP[kind].decode().replace(" ", "")])
    assert len(said) < 2000


def test_a_value_is_said_again_in_few_letters(refused, capsys):
    said = refused(
        ["simulate", "--set", "controller.k1=" + 50_000 * "x", "--set", 3000 * "y" + "=1"], "50002 characters"
    )
    assert len(said) < 2000
    with pytest.raises(SystemExit):
        cli.main(["simulate", "--seed", 50_000 * "x"])
    assert len(capsys.readouterr().err) < 5000


@pytest.mark.parametrize("option", ["--out", "--config", "--set", "--import"])
def test_bytes_that_are_no_text_are_refused_at_once(option, refused):
    refused(["simulate", option, "a=\udcff"], option, "UTF-8")


@pytest.mark.parametrize(
    "place", ["localhost", "localhost:", ":1234", "localhost:port", "h:0", "h:65536", "[]:1", "h:١"]
)
def test_a_coordinator_without_host_or_port_is_refused(place, refused):
    argv = ["tune", "--coordinator", place, "--num-processes", "2", "--process-id", "0"]
    refused(argv, "--coordinator", "HOST:PORT")


def test_several_processes_must_be_told_where_they_meet(refused, monkeypatch):
    refused(["tune", "--num-processes", "2", "--process-id", "0"], "--num-processes", "--coordinator HOST:PORT")


MEET = """
import sys
from tuning.compute import processes
from tuning.cli import main
processes.MEETING = 2
sys.argv = ["agvjax", "tune", "--out", sys.argv[1], "--coordinator", "127.0.0.1:" + sys.argv[2], *sys.argv[3:]]
main.run()
"""


@pytest.mark.parametrize("rank", ["0", pytest.param("1", marks=pytest.mark.slow)])
def test_processes_that_do_not_come_are_waited_for_no_longer_than_said(rank, tmp_path):
    with socket.socket() as place:
        place.bind(("", 0))
        port = str(place.getsockname()[1])
    argv = [str(tmp_path / "out"), port, "--num-processes", "2", "--process-id", rank]
    said, err = run(argv, 1, program=("-c", MEET))
    assert "waiting up to 2 s" in said
    assert (
        err.strip()
        == f"agvjax tune: the processes did not meet at 127.0.0.1:{port}: not all of them were there within 2 s"
    )
    assert not (tmp_path / "out").exists()


def test_a_port_that_another_program_has_is_said(tmp_path):
    with socket.socket(socket.AF_INET6) as place:
        place.bind(("", 0))
        place.listen()
        port = str(place.getsockname()[1])
        argv = [str(tmp_path / "out"), port, "--num-processes", "2", "--process-id", "0"]
        assert "in use" in run(argv, 1, program=("-c", MEET))[1]


INTERRUPTED = """
import os, signal, sys
at = sys.argv.pop()
class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == at:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupt())
from tuning.cli.start import run
run()
"""


@pytest.mark.parametrize("library", ["tuning.cli.main", "numpy", "jax.numpy"])
def test_ctrl_c_while_libraries_are_imported_ends_the_command_at_once(library, tmp_path):
    """Not timed: the signal comes from inside the import."""
    _, err = run(["simulate", "--out", str(tmp_path / "out"), library], 130, program=("-c", INTERRUPTED))
    assert err == "agvjax: interrupted\n"
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_reader_that_goes_away_does_not_stop_a_run(tmp_path):
    process = start(arguments("simulate", tmp_path / "out", FAST))
    process.stdout.close()
    process.stderr.close()
    assert process.wait(timeout=HUNG) == 0
    assert (tmp_path / "out" / "trajectory.npz").exists()


@pytest.mark.slow
def test_letters_that_an_encoding_lacks_are_spelled(tmp_path):
    said, _ = run(arguments("simulate", tmp_path / "é", FAST), PYTHONIOENCODING="ascii")
    assert "/\\xe9" in said


@pytest.mark.parametrize(
    "argv", [["fly"], ["simulate", "--seed", "x"], ["tune", "--precision", "16"], ["simulate", "--resume"]]
)
def test_options_that_do_not_exist_exit_with_2(argv, capsys):
    with pytest.raises(SystemExit) as stop:
        cli.main(argv)
    assert stop.value.code == 2
    assert "usage: agvjax" in capsys.readouterr().err


HELP = """
import contextlib, sys
from tuning.cli.main import COMMANDS, main
for argv in ([], *([name] for name in COMMANDS)):
    with contextlib.suppress(SystemExit):
        main([*argv, "--help"])
print("jax" in sys.modules, "matplotlib" in sys.modules)
"""


def test_help_of_every_command_starts_without_jax():
    said = python(HELP)
    *lines, loaded = said.splitlines()
    assert loaded == "False False"
    for name in cli.COMMANDS:
        assert f"usage: agvjax {name} " in said
        assert any(line.split()[:1] == [name] for line in lines), name


BEFORE = """
from jax._src import xla_bridge
from tuning import config
from tuning.tune.rules import faults
for files in ([], ["unicycle"], ["car"], ["robot"]):
    for optimizer in ("sqp", "adam", "lbfgs"):
        config.load(files, [f"tune.optimizer={optimizer}"], faults)
told = [
    'controller.inner={type="path_pid",k_y={over="speed",nodes=[0.2,0.8],values=[8.0,5.0]}}',
    'controller.compensation="inverse"',
    'controller.prediction={type="predictor",delay=0.1,slots=4}',
]
for name in ("base", "ackermann", "forklift"):
    config.load([name], [], faults)
    config.load([name], told, faults)
assert not xla_bridge.backends_are_initialized()
"""


@pytest.mark.slow
def test_a_configuration_is_read_before_jax_computes():
    """Processes that tune together meet by what it says, and JAX lets them meet before its first array only."""
    python(BEFORE)
