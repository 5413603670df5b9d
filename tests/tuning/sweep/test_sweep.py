"""Sweeps: which scenarios, what is known of them, and how they survive whatever happens to a process or a disk."""

import dataclasses
import json
import os
import subprocess
import sys

import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc

import agvjax
from agvjax import Scenario
from laws import Proportional
from tuning import Between, Config, Distribution, OneOf, Simulate, Times, Tune
from tuning import config as configuration
from tuning.compute.jobs import Here
from tuning.config.complete import complete
from tuning.config.settings import Bound, Search, Sweep
from tuning.ensemble.draws import Span, uniform
from tuning.io import marks
from tuning.io.pictures import write_figures
from tuning.sweep import figures, findings, radius, results, run, shards, verdict, work
from tuning.sweep.design import design
from tuning.sweep.laws import named

RIGHT, LEFT = (f"deadzone.position.threshold_{side}" for side in ("right", "left"))


pytestmark = pytest.mark.usefixtures("promotion_as_optax_has_it")


LAW = Proportional()


def config_of(*over, law=LAW, **sweep):
    """A sweep of half a second."""
    tune = Tune(search=Search(scouts=32, starts=3, iterations=6))
    swept = Sweep(over=over, metrics=("total_rmse",), integrator="euler", **sweep)
    return complete(Config(controller=law, simulate=Simulate(horizon=0.5), tune=tune, sweep=swept))


STEPS = {"dt": 1e-2, "n_steps": 50, "integrator": agvjax.EULER}


# ----------------------------------------------------------------------------------------------------------- designs


def test_a_grid_is_crossed_and_what_is_paired_moves_as_one():
    paired = {RIGHT: Span(Between(0.0, 1.0), 3), LEFT: Span(Times(0.0, 2.0), 3)}
    plan = design(config_of(paired, {"deadzone.position.slope_right": Span(OneOf((0.5, 0.7)), 2)}))
    assert plan.shape == (3, 2) and plan.samples == 1 and plan.size == 6
    values = plan.values(0, 6)
    np.testing.assert_allclose(values[RIGHT], [0.0, 0.0, 0.5, 0.5, 1.0, 1.0])
    np.testing.assert_allclose(values[LEFT], [0.0, 0.0, 0.4, 0.4, 0.8, 0.8])  # nominal .4
    np.testing.assert_allclose(values["deadzone.position.slope_right"], [0.5, 0.7] * 3)


def test_elements_and_gains_are_leaves_too():
    place, speed = {"start.position[1]": Span(Between(2.0, 4.0), 2)}, {"start.velocity": Span(Between(0.0, 1.0), 2)}
    plan = design(config_of(place, {"controller.damping": Span(Times(0.5, 1.0), 2)}, speed))
    values = plan.values(0, 8)
    np.testing.assert_allclose(values["start.position"], [[-0.5, 2.0]] * 4 + [[-0.5, 4.0]] * 4)
    np.testing.assert_allclose(values["controller.damping"], [4.0, 4.0, 8.0, 8.0] * 2)
    np.testing.assert_allclose(values["start.velocity"], [[0.0, 0.0], [1.0, 1.0]] * 4)
    law, scenario = plan.split(values)
    assert set(law) == {"damping"} and set(scenario) == {"start.position", "start.velocity"}


def test_samples_are_the_same_at_every_node():
    plan = design(config_of({RIGHT: Span(Between(0.0, 1.0), 4)}, {LEFT: Span(Between(0.0, 1.0))}, samples=5))
    values = plan.values(0, 20)
    np.testing.assert_array_equal(values[LEFT].reshape(4, 5), np.tile(values[LEFT][:5], (4, 1)))
    np.testing.assert_allclose(values[RIGHT].reshape(4, 5)[:, 0], [0, 1 / 3, 2 / 3, 1])
    assert len(set(values[LEFT])) == 5


@pytest.mark.parametrize(
    ("method", "grid"),
    [(m, g) for m in ("random", "sobol", "latin") for g in (False, True)] + [("saltelli", False), ("morris", False)],
)
def test_any_part_of_a_design_is_that_part_of_the_whole(method, grid):
    over = [{RIGHT: Span(Between(0.0, 1.0), 3)}] if grid else []
    plan = design(config_of(*over, ensemble=True, samples=11 if method != "saltelli" else 16, design=method))
    whole = plan.values(0, plan.size)
    for first, count in ((0, 1), (1, 3), (5, plan.size - 5), (plan.size - 1, 1)):
        part = plan.values(first, count)
        assert all(np.array_equal(part[name], whole[name][first : first + count]) for name in whole)


@pytest.mark.parametrize("width", [1, 2, 3, 5])
def test_random_numbers_hang_on_the_place_of_the_scenario_alone(width):
    whole = uniform(3, "leaf", 40, width)
    for first in (0, 1, 2, 3, 4, 7, 39):
        np.testing.assert_array_equal(uniform(3, "leaf", 40 - first, width, first), whole[first:])
    assert stats.kstest(uniform(3, "leaf", 4000).ravel(), "uniform").pvalue > 1e-3


def test_sobol_and_latin_points_are_spread_more_evenly_than_random_ones():
    over = [{name: Span(Between(0.0, 1.0))} for name in (RIGHT, LEFT)]

    def shares(method):
        return design(config_of(*over, samples=256, design=method)).shares(0, 256)

    for method in ("sobol", "latin"):
        layers = np.sort((shares(method) * 256).astype(int), axis=0)
        np.testing.assert_array_equal(layers, np.tile(np.arange(256)[:, None], 2))  # one in every layer
    assert qmc.discrepancy(shares("sobol")) < 0.05 * qmc.discrepancy(shares("random"))


def test_a_distribution_is_swept_without_its_tails():
    plan = design(config_of({"start.heading": Span(Distribution("norm", {"scale": 2.0}), 3)}))
    wanted = 2 * stats.norm.ppf([1e-3, 0.5, 1 - 1e-3])
    np.testing.assert_allclose(plan.values(0, 3)["start.heading"], wanted, atol=1e-12)


# -------------------------------------------------------------------------------------------- rolled out, on the disk


@pytest.fixture(scope="module")
def small():
    """Two gains by two thresholds by samples of the start, and the judge of it."""
    gains, start = {"controller.stiffness": Span(OneOf((15.0, 25.0)), 2)}, {"start.heading": Span(Between(-0.5, 0.5))}
    config = config_of(gains, {RIGHT: Span(Between(0.2, 0.9), 2)}, start, samples=5, shard=7)
    plan = design(config)
    return config, plan, work.judges(config, plan, [config.controller], 7)


def manifest_of(config, plan):
    units = {"metrics": {"total_rmse": "m, rad"}, "leaves": {name: plan.unit(name) for name in plan.names}}
    law = {"configured": "its gains"}
    return shards.manifest("the configuration", config.seed, law, plan.size, config.sweep.shard, **units)


def rolled(folder, small, said=lambda text: None, tick=lambda scenarios: None):
    """What is missing is rolled out; the manifest, and how many shards that were."""
    config, plan, judges = small
    manifest = manifest_of(config, plan)
    shards.write_manifest(folder, manifest)
    missing = shards.missing(folder, manifest, plan.leaf_shapes, said)
    run.fill(folder, manifest, missing, run.jobs(run.parcel(manifest), plan, judges), Here(), tick)
    return manifest, len(missing)


def test_shards_hold_what_single_runs_give(small, tmp_path):
    config, plan, _ = small
    manifest, count = rolled(tmp_path, small)
    assert count == 3 and [manifest.span(i) for i in range(manifest.shards)] == [(0, 7), (7, 7), (14, 6)]
    whole = [shards.read_shard(tmp_path, manifest, i) for i in range(3)]
    rmse = np.concatenate([part["result/total_rmse"][0] for part in whole])
    assert len(set(rmse)) == 20
    for number in (0, 6, 13, 19):
        law, scenario = plan.split({name: value[0] for name, value in plan.values(number, 1).items()})
        one = agvjax.evaluate(agvjax.replace(config.controller, law), agvjax.replace(Scenario(), scenario), **STEPS)
        np.testing.assert_allclose(rmse[number], one.total_rmse, rtol=1e-12)
    assert shards.read_manifest(tmp_path) == manifest


def test_what_is_there_is_kept_and_what_is_damaged_is_made_again(small, tmp_path):
    manifest, _ = rolled(tmp_path, small)
    before = {i: shards.path_of(tmp_path, i).read_bytes() for i in range(3)}
    time_of_first = shards.path_of(tmp_path, 0).stat().st_mtime_ns
    cut = shards.path_of(tmp_path, 1)
    cut.write_bytes(before[1][:-200])
    flipped = bytearray(before[2])
    flipped[200] ^= 1  # inside the first array
    shards.path_of(tmp_path, 2).write_bytes(bytes(flipped))
    assert shards.read_shard(tmp_path, manifest, 1) is None and shards.read_shard(tmp_path, manifest, 2) is None
    ticks, said = [], []
    assert rolled(tmp_path, small, said.append, ticks.append) == (manifest, 2)
    assert ticks == [7, 7, 6]
    assert said == ["2 of 3 shards are damaged or cut short (1, 2): they are computed again"]
    assert {i: shards.path_of(tmp_path, i).read_bytes() for i in range(3)} == before  # archives carry no date
    assert shards.path_of(tmp_path, 0).stat().st_mtime_ns == time_of_first


def test_a_shard_of_another_sweep_is_none(small, tmp_path):
    config, plan, _ = small
    manifest, _ = rolled(tmp_path, small)
    other = manifest._replace(digest="another")
    assert shards.read_shard(tmp_path, other, 0) is None
    (tmp_path / shards.MANIFEST).write_text("{}")
    with pytest.raises(ValueError, match="holds no sweep"):
        shards.read_manifest(tmp_path)


def test_a_manifest_that_no_sweep_wrote_is_refused(small, tmp_path):
    """Damaged by hand, with the checksum made right where it would be the first to say so."""
    rolled(tmp_path, small)
    whole = json.loads((tmp_path / shards.MANIFEST).read_text())
    del whole["sha256"]  # as of an earlier release
    wrong = {"size": ("64", 0, -1, 1.5, 10**12, None), "shard": ("x", 0, [], 8), "names": ([], ["a", "b"], "a", [1])}
    wrong |= {"controllers": (["other"], [], 3, [3]), "config": ("seed = 1", 3), "digest": ("", 5), "seed": ("1", 0.5)}
    wrong |= {"metrics": ([], {"a": 1}), "leaves": (3,), "versions": (["x"],), "shards": ([], 3, [[0, 1]], [[0, "1"]])}
    wrong |= {"format": (2, None), "other": (1,)}
    forged = [json.dumps({**whole, key: value}) for key, values in wrong.items() for value in values]
    forged += [json.dumps({k: v for k, v in whole.items() if k != key}) for key in whole]
    forged += ["[" * 100000, "[]", "3", "", "{", '{"format": 1}', "\0", json.dumps(whole)[:-20]]
    forged += [json.dumps({**whole, "versions": {}, "sha256": "0" * 64})]
    for text in forged:
        (tmp_path / shards.MANIFEST).write_text(text)
        with pytest.raises(ValueError, match="manifest.json holds no sweep"):
            shards.read_manifest(tmp_path)
    (tmp_path / shards.MANIFEST).write_text(json.dumps(whole))
    shards.read_manifest(tmp_path)


def test_an_edited_manifest_does_not_pass_its_checksum(small, tmp_path):
    rolled(tmp_path, small)
    text = (tmp_path / shards.MANIFEST).read_text()
    for old, new in (('"size": ', '"size": 1'), ('"jax": "', '"jax": "1'), ('"seed": ', '"seed": 1')):
        assert old in text
        (tmp_path / shards.MANIFEST).write_text(text.replace(old, new))
        with pytest.raises(ValueError, match=r"manifest\.json holds no sweep"):
            shards.read_manifest(tmp_path)


def test_a_shard_of_another_shape_or_dtype_is_none(small, tmp_path):
    _, plan, _ = small
    manifest, _ = rolled(tmp_path, small)
    with np.load(shards.path_of(tmp_path, 0), allow_pickle=False) as file:
        whole = dict(file)
    shapes = plan.leaf_shapes
    assert shards.read_shard(tmp_path, manifest, 0, shapes) is not None
    for name, value in whole.items():
        if "/" in name:
            for other in (value[:-1], value.astype(complex), value.astype(str), np.array(0.5), value[..., None]):
                np.savez(shards.path_of(tmp_path, 0), **{**whole, name: other})
                assert shards.read_shard(tmp_path, manifest, 0, shapes) is None, (name, other.dtype, other.shape)


def test_only_what_is_nobodys_is_swept_up(tmp_path):
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    place, number, chance = marks.mark().split("-")
    kept = {f".a.npz.{place}-{number}-{chance}.part", ".a.npz.elsewhere-12.part", "a.part", ".a.npz"}
    old = {".b.npz.elsewhere-12.part", f".a.npz.{place}-{gone.pid}-{chance}.part", "shard-00003.claim", "report.claim"}
    for name in kept | old:
        (tmp_path / name).touch()
    os.utime(tmp_path / ".b.npz.elsewhere-12.part", (0, 0))
    shards.sweep_up(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == kept


# ----------------------------------------------------------------------------------------------------------- findings


def made_up(plan, metrics, ok=None):
    """Results with these metrics (N,) of one controller."""
    values = {name: np.asarray(value, float)[None] for name, value in metrics.items()}
    manifest = shards.manifest("", 0, {"one": ""}, plan.size, plan.size, metrics=dict.fromkeys(metrics, "1"), leaves={})
    ok = np.ones(plan.size, bool) if ok is None else ok
    return results.Results(manifest, config_of(), plan, ok[None], values, plan.values(0, plan.size))


@pytest.mark.parametrize(("p", "n"), [(0.01, 50), (0.3, 20), pytest.param(0.002, 1000, marks=pytest.mark.slow)])
def test_the_interval_covers_the_probability(p, n):
    """Summed over every possible count: no sampling, no seed."""
    counts = np.arange(n + 1)
    ends = np.array([findings.interval(int(k), n) for k in counts])
    covered = (ends[:, 0] <= p) & (p <= ends[:, 1])
    assert stats.binom.pmf(counts, n, p)[covered].sum() >= 0.95


def test_the_failure_probability_of_a_loop_is_that_which_can_be_computed():
    """A vehicle that is left alone and begins beyond the limit is latched at once: |x| > limit, nearly."""
    idle = Proportional(stiffness=0.0, damping=0.0, turn=0.0)
    config = config_of({"start.position[0]": Span(Between(0.0, 2000.0))}, law=idle, samples=400, fails={})
    plan = design(config)
    rest = 0.5**2 + 2 * 0.1**2 + 0.1**2  # y, velocity and heading at the start
    truth = 1 - np.sqrt(Scenario().limit ** 2 - rest) / 2000.0
    answers = work.judges(config, plan, [config.controller], 400)[0](plan.values(0, 400))
    found = made_up(plan, {"total_rmse": answers["total_rmse"]}, np.asarray(answers["ok"]))
    (seen,) = findings.failures(found, findings.failed(found, {}))
    assert seen.low <= truth <= seen.high and seen.diverged == seen.failed
    assert seen.high - seen.low < 0.11  # as wide as 400 draws make it


def test_a_run_fails_beyond_its_bound_and_where_it_has_no_value():
    plan = design(config_of({RIGHT: Span(Between(0.0, 1.0), 5)}))
    found = made_up(plan, {"total_rmse": [1.0, 2.0, np.nan, 3.0, np.inf]}, np.array([True, True, True, False, True]))
    assert findings.failed(found, {"total_rmse": 1.5}).tolist() == [[False, True, True, True, True]]
    bounds = {"total_rmse": Bound(value=2.0), "effort": Bound(value=9.0, absolute=True)}
    assert findings.absolute(bounds, {"total_rmse": 0.7}) == {"total_rmse": 1.4, "effort": 9.0}
    assert findings.worst(np.array([1.0, np.inf, 3.0, 3.0]), 3).tolist() == [1, 2, 3]


def test_a_cut_shows_median_band_and_worst_over_all_else():
    plan = design(config_of({RIGHT: Span(Between(0.0, 1.0), 2)}, {LEFT: Span(Between(0.0, 1.0), 101)}))
    found = made_up(plan, {"total_rmse": np.r_[np.arange(101.0), 1000 + np.arange(101.0)]})
    at, rows = findings.cut(found, found.metrics["total_rmse"][0], 0, plan.shares(0, plan.size))
    np.testing.assert_array_equal(at, [0.0, 1.0])
    np.testing.assert_array_equal(rows, [[5, 50, 95, 100], [1005, 1050, 1095, 1100]])
    at, rows = findings.cut(found, found.metrics["total_rmse"][0], 1, plan.shares(0, plan.size))
    np.testing.assert_array_equal(rows[:, 3], 1000 + np.arange(101.0))


def of_angles(method, samples):
    """Three angles from -pi to pi, and their values."""
    pytest.importorskip("SALib")
    names = ("start.heading", "start.position[0]", "start.position[1]")
    over = [{name: Span(Between(-np.pi, np.pi))} for name in names]
    plan = design(config_of(*over, samples=samples, design=method))
    values = plan.values(0, plan.size)
    return plan, (values["start.heading"], *values["start.position"].T)


def test_sobol_indices_of_ishigamis_function():
    plan, (x, y, z) = of_angles("saltelli", 4096)
    a, b = 7.0, 0.1
    found = findings.indices("saltelli", plan.sampled, plan, np.sin(x) + a * np.sin(y) ** 2 + b * z**4 * np.sin(x))
    variance = a**2 / 8 + b * np.pi**4 / 5 + b**2 * np.pi**8 / 18 + 0.5
    first = np.array([0.5 * (1 + b * np.pi**4 / 5) ** 2, a**2 / 8, 0.0]) / variance
    joint = b**2 * np.pi**8 * (1 / 18 - 1 / 50) / variance
    np.testing.assert_allclose([index.first for index in found], first, atol=0.02)
    np.testing.assert_allclose([index.total for index in found], first + [joint, 0.0, joint], atol=0.02)
    assert [index.axis for index in found] == ["start.heading", "start.position[0]", "start.position[1]"]


def test_morris_effects_of_a_plane():
    plan, (x, y, z) = of_angles("morris", 20)
    found = findings.indices("morris", plan.sampled, plan, 2 * x - 0.5 * y + 0 * z)
    np.testing.assert_allclose([index.first for index in found], [4 * np.pi, np.pi, 0.0], atol=1e-9)
    np.testing.assert_allclose([index.total for index in found], 0.0, atol=1e-9)


def test_an_infinite_metric_has_no_sensitivities():
    plan, _ = of_angles("saltelli", 16)
    values = np.ones(plan.size)
    values[3] = np.inf
    assert findings.sensitivity(made_up(plan, {"total_rmse": values}), values) == []


# ------------------------------------------------------------------------------------------------------------- radius


@pytest.mark.slow
def test_the_radius_is_that_of_a_dense_grid():
    heading, slope = "start.heading", "deadzone.heading.slope_left"
    over = {heading: Span(Between(-1.0, 2.0)), slope: Span(Times(0.3, 1.5))}
    config = config_of(*({name: span} for name, span in over.items()), samples=4)
    plan = design(config)
    moves = np.stack(np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-1, 1, 41)), -1).reshape(-1, 2)
    ends = {heading: (-1.0, 0.1, 2.0), slope: (0.3 * 0.72, 0.72, 1.5 * 0.72)}  # low, nominal, high: by hand
    values = {
        name: np.where(m >= 0, middle + m * (high - middle), middle + m * (middle - low))
        for m, (name, (low, middle, high)) in zip(moves.T, ends.items(), strict=True)
    }
    metrics = agvjax.evaluate(config.controller, agvjax.batch(Scenario(), values), **STEPS)
    nominal = agvjax.evaluate(config.controller, Scenario(), **STEPS)
    bound = {"peak_heading": 2.2 * float(nominal.peak_heading)}
    far = np.abs(moves).max(axis=1)
    bad = np.asarray(metrics.peak_heading) > bound["peak_heading"]
    truth = far[bad].min()
    assert 0.2 < truth < 0.9
    found = made_up(plan, {"peak_heading": np.zeros(4)})
    seen = radius.radius(found, np.zeros(4, bool), config.controller, radius.adversary(config, plan, bound))
    assert truth - 0.05 - radius.CLOSE <= seen.radius <= seen.failure <= truth
    assert seen.failure - seen.radius <= radius.CLOSE
    np.testing.assert_allclose(seen.ends[heading], [0.1 - 1.1 * seen.radius, 0.1 + 1.9 * seen.radius], rtol=1e-9)
    again = agvjax.evaluate(config.controller, agvjax.replace(Scenario(), seen.scenario), **STEPS)
    assert float(again.peak_heading) > bound["peak_heading"]
    # a failure among the sweep's own samples is nearer than any that the search would look for
    near = made_up(plan, {"peak_heading": np.zeros(4)})
    which = np.array([False, True, False, False])
    reach = radius.Reach.of(plan).distance(near.leaves)[1]
    seen = radius.radius(near, which, config.controller, radius.adversary(config, plan, {"peak_heading": 1e9}))
    assert seen.failure == pytest.approx(reach) and seen.radius < reach


def test_where_nothing_fails_the_radius_is_the_whole_box():
    config = config_of({RIGHT: Span(Times(0.9, 1.1))}, samples=2)
    plan = design(config)
    seeker = radius.adversary(config, plan, {"total_rmse": 1e6})
    seen = radius.radius(made_up(plan, {"total_rmse": np.zeros(2)}), np.zeros(2, bool), config.controller, seeker)
    assert (seen.radius, seen.failure) == (1.0, None)
    np.testing.assert_allclose(seen.ends[RIGHT], [0.45, 0.55])


# ---------------------------------------------------------------------------------------------- controllers in batches


@pytest.mark.slow
def test_a_batch_of_controllers_pairs_with_one_of_scenarios():
    gains, headings = np.array([10.0, 20.0, 30.0]), np.array([-0.3, 0.1, 0.6])
    laws = agvjax.batch(Proportional(), {"stiffness": gains})
    scenes = agvjax.batch(Scenario(), {"start.heading": headings})
    both, alone = agvjax.evaluate(laws, scenes, **STEPS), agvjax.evaluate(laws, Scenario(), **STEPS)
    for i in range(3):
        law, scene = laws[i], scenes[i]
        np.testing.assert_allclose(both.rmse[i], agvjax.evaluate(law, scene, **STEPS).rmse, rtol=1e-12)
        np.testing.assert_allclose(alone.rmse[i], agvjax.evaluate(law, Scenario(), **STEPS).rmse, rtol=1e-12)
    with pytest.raises(ValueError, match="same size"):
        agvjax.evaluate(laws, agvjax.batch(Scenario(), {"start.heading": headings[:2]}), **STEPS)


# ------------------------------------------------------------------------------------------------------ corner cases


def test_sensitivity_designs_stay_off_the_ends_of_a_distribution():
    for method in ("saltelli", "morris"):
        plan = design(config_of({"start.heading": Span(Distribution("norm", {}))}, samples=8, design=method))
        values = plan.values(0, plan.size)["start.heading"]
        assert np.all(np.abs(values) <= stats.norm.ppf(1 - 1e-3) + 1e-12) and len(set(values)) > 2


@pytest.mark.slow
def test_a_failure_beyond_the_ends_of_a_distribution_does_not_widen_the_box():
    config = config_of({"start.heading": Span(Distribution("norm", {"loc": 0.1, "scale": 0.1}))}, samples=4)
    plan = design(config)
    found = made_up(plan, {"total_rmse": np.zeros(4)})
    found.leaves["start.heading"][:] = [0.1, 0.2, 0.9, 0.0]  # the box ends at 3.09 standard deviations, .41
    seeker = radius.adversary(config, plan, {"total_rmse": 1e6})
    seen = radius.radius(found, np.array([False, False, True, False]), config.controller, seeker)
    assert seen.radius == 1.0 and seen.failure is None


def test_where_every_neighbour_fails_the_radius_is_nothing():
    config = config_of({"start.heading": Span(Between(-1.0, 1.2))}, samples=4)
    plan = design(config)
    nominal = agvjax.evaluate(config.controller, Scenario(), **STEPS)
    seeker = radius.adversary(config, plan, {"total_rmse": float(nominal.total_rmse) * (1 + 1e-9)})
    seen = radius.radius(made_up(plan, {"total_rmse": np.zeros(4)}), np.zeros(4, bool), config.controller, seeker)
    assert seen.radius < radius.LEAST and 0 < seen.failure < 2 * radius.LEAST


def test_maps_need_two_axes_with_more_than_one_point():
    three = [{"start.heading": Span(Between(0.0, 1.0), 2)}, {LEFT: Span(OneOf((0.3,)), 1)}]
    three.append({RIGHT: Span(Between(0.0, 1.0), 3)})
    which = np.array([[True, False, False, False, True, True]])
    for over, maps in ((three, 2), (three[:2], 0)):
        plan = design(config_of(*over))
        found = made_up(plan, {"total_rmse": np.arange(1.0, plan.size + 1)})
        drawn = figures.every(found, {"total_rmse": 2.0}, which[:, : plan.size], {})
        assert sum(name.startswith("map") for name in drawn) == maps and "cuts" in drawn
    numbers = np.arange(6.0)
    picture = figures._on_map(made_up(design(config_of(*three)), {"total_rmse": numbers}), numbers, np.max)
    np.testing.assert_array_equal(picture, [[0, 1, 2], [3, 4, 5]])


SLOW_SIZES = [
    pytest.param(*case, marks=pytest.mark.slow) for case in ((7.0, 0), (5e-324, 3), (1e99, 3), (1e300, 3), (1.7e308, 0))
]


@pytest.mark.slow
@pytest.mark.parametrize(("odd", "sound"), [(np.nan, 3), *SLOW_SIZES])
def test_metrics_of_any_size_are_drawn(odd, sound, tmp_path):
    """Of two controllers: what is too large for a figure is left out of it, as runs that diverged are."""
    config = config_of({"start.heading": Span(Between(0.0, 1.0), 2)}, {RIGHT: Span(Between(0.0, 1.0), 3)})
    values = np.where(np.arange(6) < sound, np.arange(1.0, 7.0), odd)
    found = made_up(design(config), {"total_rmse": values, "effort": values})
    two = {name: np.tile(x, (2, 1)) for name, x in found.metrics.items()}
    found = found._replace(metrics=two, manifest=found.manifest._replace(names=("one", "two")))
    drawings = figures.every(found, {"total_rmse": odd}, np.array([values > 2] * 2), {})
    assert write_figures(tmp_path, {**drawings, "shares": lambda: figures.distributions(found, {})}) == []
    assert {"map_effort.png", "difference_1_total_rmse.png", "cuts.png"} < {path.name for path in tmp_path.iterdir()}


def test_a_bound_relative_to_nothing_is_refused():
    config = config_of({RIGHT: Span(Between(0.0, 1.0), 2)}, fails={"longest_settling_time": Bound(value=1.5)})
    judges = work.judges(config, design(config), [config.controller], 2)
    with pytest.raises(agvjax.InputError, match="sweep.fails.longest_settling_time = 1.5: must be absolute"):
        verdict.bounds_of(config, design(config), judges[0], 2)  # half a second is too short to settle


def test_a_sweep_in_python_goes_on_where_it_ended_and_refuses_another(tmp_path):
    config = config_of({RIGHT: Span(Between(0.0, 1.0), 5)}, shard=2)
    first = run.run_sweep(config, tmp_path / "sweep")
    path = shards.path_of(tmp_path / "sweep", 2)
    path.unlink()
    again = run.run_sweep(config, tmp_path / "sweep")
    np.testing.assert_array_equal(again.metrics["total_rmse"], first.metrics["total_rmse"])
    assert first.grid("total_rmse").shape == (1, 5, 1)
    with pytest.raises(ValueError, match="another sweep"):
        run.run_sweep(dataclasses.replace(config, seed=1), tmp_path / "sweep")


def test_the_table_of_xarray_holds_the_same_numbers():
    pytest.importorskip("xarray")
    paired = {RIGHT: Span(Between(0.0, 1.0), 2), LEFT: Span(Between(0.1, 0.3), 2)}
    config = config_of(paired, {"start.position[0]": Span(Between(-1.0, 1.0))}, samples=3)
    plan = design(config)
    manifest = manifest_of(config, plan)
    data = made_up(plan, {"total_rmse": np.arange(6.0)})._replace(manifest=manifest).to_xarray()
    assert dict(data.sizes) == {"controller": 1, RIGHT: 2, "sample": 3, "start.position_element": 2}
    assert data["total_rmse"].attrs["units"] == "m, rad" and data["start.position"].attrs["units"] == "m"
    np.testing.assert_array_equal(data["total_rmse"][0], [[0, 1, 2], [3, 4, 5]])
    np.testing.assert_allclose(data[LEFT], [0.1, 0.3])
    np.testing.assert_array_equal(data["start.position"], plan.values(0, 3)["start.position"])


def test_gains_of_a_sampled_law_are_read_for_the_vehicle_of_the_sweep(tmp_path):
    config = configuration.load(["unicycle"])
    file = tmp_path / "gains.toml"
    file.write_text(configuration.gains_table(config.controller))
    asked = dataclasses.replace(config, sweep=dataclasses.replace(config.sweep, controllers=(str(file),)))
    laws = named(complete(asked))
    assert len(laws) == 2 and all(type(law.vehicle) is type(config.scenario.plant) for law in laws.values())
