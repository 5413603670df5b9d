"""Rare failures of closed loops: as the metrics have them, kept in a folder, simulated again."""

import contextlib
import dataclasses
import json
import pickle
import re
import shutil

import numpy as np
import pytest
from scipy import stats

import agvjax
from agvjax import InputError
from claimed import meant, unqualified
from commands import contents, python
from laws import Proportional
from tuning import Between, Config, Distribution, OneOf, Simulate, Tune
from tuning.cli import phases, rare
from tuning.cli.main import main
from tuning.compute.packages import versions
from tuning.config.complete import complete
from tuning.config.settings import Bound, Ensemble, Search, Sweep
from tuning.ensemble.draws import Correlation, Span, correlated
from tuning.io.alone import alone
from tuning.sweep.design import design
from tuning.sweep.rare import chunks, loop, rules, search, study

pytestmark = pytest.mark.usefixtures("promotion_as_optax_has_it")
X, SPEED = "start.position[0]", "start.velocity"
RIGHT = "deadzone.position.threshold_right"


def config_of(*over, fails=None, horizon=0.1, ensemble=None, **sweep):
    """A sweep of some steps of a law of one's own."""
    fails = fails or {"peak_command_x": Bound(value=30.0, absolute=True)}
    swept = Sweep(over=over, integrator="euler", metrics=("total_rmse",), fails=fails, radius=False, **sweep)
    return complete(
        Config(
            controller=Proportional(),
            simulate=Simulate(horizon=horizon),
            tune=Tune(search=Search(scouts=32, starts=3, iterations=6)),
            ensemble=ensemble or Ensemble(),
            sweep=swept,
        )
    )


def posed(config, bounds):
    plan = design(config)
    return plan, loop.problem(config, plan, config.controller, bounds)


@pytest.mark.slow
def test_a_level_is_above_0_where_a_run_fails_and_its_slope_is_that_of_differences():
    config = config_of(
        {X: Span(Distribution("norm", {"loc": -0.5, "scale": 0.2}))}, {RIGHT: Span(Between(0.2, 0.8))}, horizon=0.3
    )
    bounds = {"total_rmse": 0.6, "peak_command_x": 18.0}
    plan, problem = posed(config, bounds)
    u = np.random.default_rng(0).normal(size=(40, 2))
    leaves = loop.vehicles(plan, u)
    np.testing.assert_allclose(leaves["start.position"][:, 0], -0.5 + 0.2 * u[:, 0], atol=1e-12)
    np.testing.assert_allclose(leaves[RIGHT], 0.2 + 0.6 * stats.norm.cdf(u[:, 1]), rtol=1e-12)
    metrics = agvjax.evaluate(
        config.controller, agvjax.batch(agvjax.Scenario(), leaves), dt=1e-2, n_steps=30, integrator=agvjax.EULER
    )
    wanted = np.maximum(np.asarray(metrics["total_rmse"]) / 0.6, np.asarray(metrics["peak_command_x"]) / 18.0) - 1
    levels = problem.levels(u)
    np.testing.assert_allclose(levels, wanted, rtol=1e-9)
    assert 5 < (levels > 0).sum() < 35
    again, slopes = problem.slopes(u)
    np.testing.assert_allclose(again, levels, rtol=1e-9)
    for side, direction in enumerate(np.eye(2)):
        ahead, behind = (problem.levels(u + step * direction) for step in (1e-5, -1e-5))
        np.testing.assert_allclose(slopes[:, side], (ahead - behind) / 2e-5, rtol=1e-3, atol=1e-4)


def test_normal_numbers_make_correlated_draws():
    normal = {name: Distribution("norm", {"scale": 2.0}) for name in ("start.heading", "disturbance.amplitude")}
    tied = correlated(normal, Correlation(("start.heading", "disturbance.amplitude"), ((1.0, 0.6), (0.6, 1.0))))
    config = config_of(ensemble=Ensemble(draws=dict(tied)))
    plan = design(dataclasses.replace(config, sweep=dataclasses.replace(config.sweep, ensemble=True, over=())))
    u = np.random.default_rng(0).normal(size=(20_000, 2))
    leaves = loop.vehicles(plan, u)
    drawn = np.stack([leaves["start.heading"], leaves["disturbance.amplitude"]])
    assert np.corrcoef(drawn)[0, 1] == pytest.approx(0.6, abs=0.02)
    np.testing.assert_allclose(drawn.std(axis=1), 2.0, rtol=0.03)


def test_a_run_that_diverges_fails_without_a_bound():
    config = config_of({X: Span(Distribution("norm", {"scale": 400.0}))})
    _, problem = posed(config, {})
    levels = problem.levels(np.array([[0.0], [5.0]]))  # 2 km away: the state passes scenario.limit
    assert levels[0] == -1.0
    assert np.isinf(levels[1]) and levels[1] > 0


def test_what_has_no_density_is_refused_by_name():
    negative = Distribution("norm", {"loc": 0.8, "scale": 0.14})  # a slope that is negative in one of 10^8
    cases = [
        ({RIGHT: Span(Between(0.0, 1.0), 3)}, "sweep.over", "not a grid"),
        ({RIGHT: Span(OneOf((0.2, 0.4)))}, f"sweep.over.{RIGHT}", "no density"),
        ({"deadzone.position.slope_right": Span(negative)}, "sweep.over.deadzone.position.slope_right", "truncnorm"),
    ]
    for over, key, words in cases:
        faults = rules.faults(config_of(over))
        assert any(fault.key == key and words in fault.rule for fault in faults), (key, faults)
    sampled = {RIGHT: Span(Between(0.0, 1.0))}
    assert not rules.faults(config_of(sampled))
    for settings in ({"design": "sobol"}, {"controllers": ("osfc",)}):
        (fault,) = rules.faults(config_of(sampled, **settings))
        assert fault.key == f"sweep.{next(iter(settings))}"


HEADING = '"start.heading" = {distribution = "norm", scale = 0.05, loc = 0.1}'
SETTINGS = [
    "sweep.rollouts=10000",
    "sweep.shard=2000",
    "sweep.integrator=euler",
    "simulate.horizon=0.1",
    "controller=osfc",
    "sweep.fails={total_rmse = 1.12}",
    f'ensemble.draws={{{HEADING}, "start.velocity" = {{between = [-0.5, 0.5]}}}}',
]


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    """A search of the command line, and its arguments."""
    out = tmp_path_factory.mktemp("rare") / "out"
    argv = ["sweep", "--rare", "--ensemble", "--out", str(out), *(x for s in SETTINGS for x in ("--set", s))]
    code = main([*argv, "--quiet"])
    return out, argv, code


@pytest.mark.slow
def test_a_search_says_one_probability_and_shows_its_most_likely_failure(searched, tmp_path, capsys):
    out, _, code = searched
    found = json.loads((out / "rare.json").read_text())
    assert code == 0 and not found["refused"] and found["rollouts"] <= 10_000
    assert 0 < found["low"] < found["probability"] < found["high"] < 0.2
    assert sum(found["points"][0]["importance"].values()) == pytest.approx(1)
    text = (out / "report.md").read_text()
    assert meant(text) == ["with probability"] and not unqualified(text)
    assert text.count("With probability at most") == 1 and (stated := re.search(r"at most ([\d.e-]+) \(95 %\)", text))
    assert found["high"] <= float(stated[1]) < 1.01 * found["high"]  # rounded up
    assert main(["simulate", "--from", str(out), "--index", "0", "--set", "simulate.dt=0.01",
                 "--set", "simulate.integrator=euler", "--out", str(tmp_path / "again"), "--quiet"]) == 0  # fmt: skip
    metrics = json.loads((tmp_path / "again" / "metrics.json").read_text())
    assert metrics["total_rmse"] == pytest.approx(found["points"][0]["metrics"]["total_rmse"], rel=1e-9)
    assert metrics["total_rmse"] > found["bounds"]["total_rmse"]
    assert main(["simulate", "--from", str(out), "--index", "99"]) == 2
    assert "the failures found" in capsys.readouterr().err


def test_what_is_kept_is_not_done_again_and_what_is_damaged_comes_out_the_same(searched):
    out, argv, _ = searched
    before = contents(out)
    (out / "rare-draws-00001.npz").write_bytes(b"damaged")
    (out / "rare-draws-00002.npz").unlink()
    kept = (out / "rare-draws-00000.npz").stat().st_mtime_ns
    (out / "rare.json").unlink()
    assert main([*argv, "--quiet"]) == 0
    after = contents(out)
    assert (out / "rare-draws-00000.npz").stat().st_mtime_ns == kept
    changed = {str(name) for name in before if before[name] != after.get(name)}
    assert changed <= {"report.md", "report.html"}  # the date, perhaps
    (out / "rare-search.npz").unlink()
    assert main([*argv, "--quiet", "--resume"]) == 0
    again = contents(out)
    assert {str(name) for name in before if before[name] != again.get(name)} <= {"report.md", "report.html"}


class Elsewhere:
    """Makes jobs as another process would: of what it is sent alone, the last one first."""

    def each(self, jobs, numbers):
        make = jobs.prepare(pickle.loads(pickle.dumps(jobs.about)))
        return ((number, make(number)) for number in reversed(numbers))


def test_what_others_draw_is_what_this_process_draws(searched, monkeypatch):
    out, argv, _ = searched
    before, counted = contents(out), []
    for file in out.glob("rare-draws-0000[12].npz"):
        file.unlink()
    monkeypatch.setattr(rare.schedule, "opened", lambda *_: contextlib.nullcontext(Elsewhere()))
    monkeypatch.setattr(chunks, "prepare", lambda parcel, prepare=chunks.prepare: counted.append(1) or prepare(parcel))
    assert main([*argv, "--quiet", "--scheduler", "local:2"]) == 0
    after = contents(out)
    assert counted and {str(name) for name in before if before[name] != after.get(name)} <= {"report.md", "report.html"}


def forbidden(*_):
    raise AssertionError("it was begun")


def test_the_folder_of_another_command_is_not_taken_over_and_said_at_once(searched, tmp_path, monkeypatch, capsys):
    """One of `tune` has the same settings in it."""
    out, argv, _ = searched
    other = tmp_path / "other"
    other.mkdir()
    (other / "config.toml").write_bytes((out / "config.toml").read_bytes())
    (other / "gains.toml").write_text("k1 = 20.0\n")
    before = contents(other)
    monkeypatch.setattr(rare.study, "posed", forbidden)
    monkeypatch.setattr(rare.schedule, "opened", forbidden)
    here = ["--out", str(other)]
    assert main([*argv, *here]) == 2 and "not empty" in capsys.readouterr().err
    (empty := tmp_path / "empty").mkdir()
    for folder in (other, empty):
        assert main([*argv, "--out", str(folder), "--resume"]) == 2
        assert "a search that has begun" in capsys.readouterr().err
    assert main([*argv, "--set", "seed=5"]) == 2 and "is `seed = 5`" in capsys.readouterr().err
    assert main([*argv, "--out", str(other / "gains.toml" / "below")]) == 2
    assert "--out" in capsys.readouterr().err and contents(other) == before
    (other / "gains.toml").unlink()  # a search that was killed after its first file
    with pytest.raises(AssertionError, match="it was begun"):
        main([*argv, *here])


@pytest.mark.slow
def test_workers_are_asked_for_when_draws_begin_and_every_rollout_is_counted_once(searched, tmp_path, monkeypatch):
    out, argv, _ = searched
    found = json.loads((out / "rare.json").read_text())
    new, asked, counted = tmp_path / "new", [], []
    monkeypatch.setattr(phases.Phase, "advance", lambda phase, n=1, before=False: counted.append(n))

    @contextlib.contextmanager
    def opened(*_):
        asked.append((new / "rare-search.npz").exists())
        yield Elsewhere()

    for engine in (opened, rare.schedule.opened):
        shutil.rmtree(new, ignore_errors=True)
        counted.clear()
        with monkeypatch.context() as patched:
            patched.setattr(rare.schedule, "opened", engine)
            assert main([*argv, "--quiet", "--out", str(new)]) == 0
        assert sum(counted) == 10_000 >= found["rollouts"] and len(counted) > 10  # some lie too far out to be simulated
    assert asked == [True]
    monkeypatch.setattr(rare.schedule, "opened", forbidden)
    assert main([*argv, "--quiet", "--out", str(new)]) == 0  # all is there


def test_what_other_releases_made_is_made_again_and_said(searched, tmp_path, monkeypatch, capsys):
    out, argv, _ = searched
    old = tmp_path / "old"
    shutil.copytree(out, old)
    (old / "rare-draws-00003.npz").write_bytes(b"damaged")
    assert main([*argv, "--out", str(old)]) == 0
    said = capsys.readouterr().out
    assert "note: 1 files of draws are damaged, or of another search (rare-draws-00003.npz first)" in said
    assert "rare-search.npz" not in said
    monkeypatch.setattr(study, "versions", lambda: versions() | {"jax": "0.1"})
    assert main([*argv, "--out", str(old)]) == 0
    said = capsys.readouterr().out
    assert "note: rare-search.npz is damaged, or of other settings or releases of jax, " in said
    ours, theirs = (np.load(folder / "rare-search.npz") for folder in (out, old))
    assert str(ours["digest"]) != str(theirs["digest"]) and float(ours["cut"]) == float(theirs["cut"])


SIX = """
import jax, numpy as np
jax.config.update("jax_enable_x64", True)
import agvjax
from tuning import Between, Config, Simulate, Span, Sweep
from tuning.config.complete import complete
from tuning.sweep.design import design
from tuning.sweep.rare import loop

assert jax.local_device_count() == 6
over = ({"start.heading": Span(Between(-0.5, 0.5))}, {"disturbance.amplitude": Span(Between(0.0, 1.0))})
config = complete(Config(simulate=Simulate(horizon=0.1), sweep=Sweep(over=over, integrator="euler")))
plan, u = design(config), np.random.default_rng(0).normal(size=(900, 2))
levels = []
assert [loop.together(devices) for devices in (None, 1, 3, 4, 16)] == [768, 512, 768, 512, 2048]
for devices in (None, 1):
    levels.append(loop.problem(config, plan, config.controller, {"total_rmse": 0.2}, devices).levels(u))
assert len(np.unique(levels[0])) > 100
print(np.array_equal(*levels))
"""


@pytest.mark.slow
def test_every_core_has_a_block_and_results_hang_on_no_number_of_them():
    assert python(SIX, JAX_NUM_CPU_DEVICES="6") == "True\n"


def test_a_second_process_in_the_folder_is_refused(searched, capsys):
    out, argv, _ = searched
    with alone(out):
        assert main(argv) == 2
    assert "no other process" in capsys.readouterr().err


def test_other_settings_and_options_do_not_pass(searched, capsys):
    out, argv, _ = searched
    for more, words in (
        (["--set", "sweep.rollouts=20000"], "sweep.rollouts"),
        (["--samples", "7"], "sweep.rollouts=N"),
        (["--process-id", "0", "--num-processes", "2"], "--scheduler"),
    ):
        assert main([*argv, *more]) == 2
        assert words in capsys.readouterr().err
    assert main(["sweep", "--out", str(out), "--ensemble"]) == 2  # no folder of a sweep


@pytest.mark.slow
def test_in_python_a_search_is_one_call(tmp_path):
    """A linear limit state: the command at the start is 30 (x_r - x) - ... of a normal x, so Phi of its distance."""
    config = config_of({X: Span(Distribution("norm", {"loc": -0.5, "scale": 0.05}))}, rollouts=10_000)
    with pytest.raises(InputError, match="rollouts"):
        search(config_of({X: Span(Between(-0.5, 0.5))}, rollouts=10), tmp_path / "few")
    found = search(config, tmp_path / "out")
    distance = found.points[0].distance
    assert found.estimate.low < stats.norm.sf(distance) * 1.02 and stats.norm.sf(distance) * 0.98 < found.estimate.high
