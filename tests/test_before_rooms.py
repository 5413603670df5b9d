"""Folders that the commit before the rooms left on users' disks, `tests/data/before-rooms`: read, resumed, replayed."""

import csv
import json
import re
import shutil
import tomllib

import numpy as np
import pytest

import tuning
from agvjax import leaves
from commands import ROOT, arguments, run
from tuning import config as configuration
from tuning.config.old import difference

OLD = ROOT / "tests" / "data" / "before-rooms"
NEW = {"rmse": "total_rmse", "chatter": "total_chatter", "settling_time": "longest_settling_time"}
NEW |= {"iae": "total_iae", "itae": "total_itae", "effort_x": "rms_command_x", "peak_x": "peak_command_x"}
CLOSE = {"rtol": 1e-6, "atol": 1e-9}
FILES = sorted(path.relative_to(OLD).as_posix() for path in OLD.rglob("*.toml"))
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # old names are read, and said to be old


def numbers(tree, name=""):
    """The numbers of nested tables, by dotted key; lists of numbers count as one."""
    if isinstance(tree, dict):
        return {k: v for key, part in tree.items() for k, v in numbers(part, f"{name}.{key}".lstrip(".")).items()}
    flat = np.asarray(tree).dtype
    return {name: tree} if flat.kind in "if" else {}


def renamed(name):
    """A dotted name with the metrics' names of today."""
    return ".".join(NEW.get(part, part) for part in name.split("."))


def same(ours, theirs, least=1):
    """Numbers of both, by key, agree where the key has the same name; there must be at least so many of them."""
    common = ours.keys() & theirs.keys()
    assert len(common) >= least, sorted(theirs.keys() - ours.keys())
    for key in common:
        np.testing.assert_allclose(np.asarray(ours[key], float), np.asarray(theirs[key], float), **CLOSE, err_msg=key)


@pytest.mark.filterwarnings("ignore:.*has a controller and no scenario:UserWarning")  # as it should be said
@pytest.mark.parametrize("name", FILES)
def test_a_file_is_read_to_its_own_numbers(name):
    vehicle = ["unicycle"] if "gains-sampled" in name else []  # a sampled law needs what it drives
    config = configuration.load([*vehicle, str(OLD / name)])
    table = tomllib.loads((OLD / name).read_text())
    stated = numbers({key: table[key] for key in ("controller", "scenario") if key in table})
    read = numbers({"controller": leaves(config.controller), "scenario": leaves(config.scenario)})
    same({k: np.squeeze(v) for k, v in read.items()}, stated, 0 if "problem" in name else 6)
    again = configuration.dump(config)
    if name.endswith("config.toml"):
        assert config.simulate.horizon == table["simulate"]["horizon"]
        stated, read = numbers(table["tune"]), numbers(tomllib.loads(again)["tune"])
        assert read | {renamed(name): value for name, value in stated.items()} == read


def test_every_metric_name_of_before_means_what_it_meant():
    said, resolved = (
        configuration.dump(configuration.load([str(OLD / "configs" / "metric-names" / name)]))
        for name in ("problem.toml", "config.toml")
    )
    assert said == resolved


@pytest.mark.slow
@pytest.mark.parametrize("end", ["", "-adam"])
def test_a_tuning_that_was_interrupted_ends_where_the_old_code_ended(end, tmp_path):
    begun, done, out = OLD / f"tune-begun{end}", OLD / f"tune-done{end}", tmp_path / "run"
    shutil.copytree(begun, out)
    run(arguments("tune", out, (), "--config", begun / "config.toml", "--resume"))
    ours, theirs = (numbers(tomllib.loads((folder / "gains.toml").read_text())) for folder in (out, done))
    assert ours.keys() == theirs.keys()
    same(ours, theirs, 10)
    ours, theirs = (list(csv.DictReader((folder / "history.csv").read_text().splitlines())) for folder in (out, done))
    assert len(ours) == len(theirs)
    for old, new in zip(theirs, ours, strict=True):
        same(*({k: float(v) for k, v in row.items() if v and "second" not in k} for row in (new, old)), 5)
    ours, theirs = (json.loads((folder / "worst.json").read_text())["found"] for folder in (out, done))
    assert len(ours) == len(theirs)
    for old, new in zip(theirs, ours, strict=True):
        same(numbers(new), numbers(old), 5)


@pytest.mark.slow
@pytest.mark.parametrize(("sweep", "index"), [("sweep", 7), ("sweep-vehicle", 11)])
def test_a_scenario_of_an_old_sweep_rolls_out_to_the_same_run(sweep, index, tmp_path):
    old, out = OLD / "simulate-from" / f"{sweep}-{index}", tmp_path / "run"
    timing = ["simulate.dt=0.01", "simulate.save_every=20"]
    run(arguments("simulate", out, timing, "--from", OLD / sweep, "--index", index))
    with np.load(out / "trajectory.npz") as ours, np.load(old / "trajectory.npz") as theirs:
        assert set(ours) >= set(theirs)
        same(dict(ours), dict(theirs), 8)
    same(*(numbers(json.loads((folder / "metrics.json").read_text())) for folder in (out, old)), 10)


@pytest.mark.parametrize("sweep", ["sweep", "sweep-vehicle"])
def test_an_old_sweep_is_loaded(sweep):
    results = tuning.load(OLD / sweep)
    with np.load(OLD / sweep / "shard-00000.npz") as shard:
        stored = {renamed(name.removeprefix("result/")): shard[name] for name in shard if name.startswith("result/")}
    same({renamed(name): x for name, x in results.metrics.items()} | {"ok": results.ok}, stored, 4)


@pytest.mark.slow
@pytest.mark.parametrize("sweep", ["sweep", "sweep-vehicle"])
def test_an_old_sweep_is_completed_to_the_same_findings(sweep, tmp_path):
    out = tmp_path / "run"
    shutil.copytree(OLD / sweep, out)
    (out / "findings.json").unlink()
    said = "".join(run(arguments("sweep", out, (), "--config", OLD / sweep / "config.toml", "--resume")))
    assert ("finished shards the variation" in said) == (sweep == "sweep-vehicle")
    ours, theirs = (json.loads((folder / "findings.json").read_text()) for folder in (out, OLD / sweep))
    findings = [{renamed(name): x for name, x in numbers(each).items()} for each in (ours, theirs)]
    if "finished shards the variation" in said:  # what is computed anew leaves a computer's first command out
        findings = [{n: x for n, x in each.items() if not re.search("chatter|variation", n)} for each in findings]
    same(*findings, 10)


@pytest.mark.slow
def test_a_sweep_half_done_by_claims_goes_on_without_them(tmp_path):
    old, out = ROOT / "tests" / "data" / "shared-sweep", tmp_path / "run"
    shutil.copytree(old / "half", out)
    kept = {name: (out / name).read_bytes() for name in ("shard-00000.npz", "shard-00001.npz")}
    run(arguments("sweep", out, (), "--config", old / "half" / "config.toml", "--resume"))
    assert {name: (out / name).read_bytes() for name in kept} == kept
    assert len(list(out.glob("shard-*.npz"))) == 5 and not list(out.glob("*.claim"))
    same(*(numbers(json.loads((folder / "findings.json").read_text())) for folder in (out, old)), 10)


def test_a_run_of_before_is_told_when_it_would_be_judged_otherwise():
    old = "[simulate]\nhorizon = 12.0\n"
    usual = "criteria.late = 4.0\ncriteria.band = 0.05\ncriteria.margin = 1.0\n"
    assert difference(old, usual + old) == ""
    assert difference(old, usual.replace("4.0", "2.0") + old) == "was `criteria.late = 4.0`; is `criteria.late = 2.0`"
