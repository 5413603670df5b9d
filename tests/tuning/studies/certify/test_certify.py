"""What is proved holds in simulated scenarios; what cannot be proved says why; the command and its files."""

import dataclasses
import json
import pickle
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from commands import files_of, run
from tuning.config import load
from tuning.studies.certify import certify, checker
from tuning.studies.certify.found import Seeker, late_errors, scenarios
from tuning.studies.certify.page import write
from tuning.studies.certify.problem import box, nominal
from tuning.studies.certify.rules import faults, unproved
from tuning.studies.certify.tree import LEANS, Prover, leaves

SHORT = ["simulate.horizon=0.6", "criteria.late=0.4", "certify.within=0.2", "certify.within_heading=0.4"]
SMALL = ["tune.search.scouts=16", "tune.search.starts=2", "tune.search.iterations=2"]


def inside(ends, count, seed):
    """Scenarios of a box by leaf, (count,): corners as often as places within."""
    rng, drawn = np.random.default_rng(seed), {}
    for name, (low, high) in ends.items():
        share = rng.uniform(size=count)
        share = np.where(rng.uniform(size=count) < 0.5, np.round(share), share)
        drawn[name] = jnp.asarray(low + share * (high - low))
    return drawn


def simulated(config, values, **timing):
    """Largest errors of each channel in these scenarios, (3, B)."""
    moved = scenarios(config.scenario, values)
    errors, ok = late_errors(config.controller, config.scenario, moved, config.criteria.late, **timing)
    assert bool(jnp.all(ok))
    return np.asarray(errors)


@pytest.mark.slow
@pytest.mark.parametrize("law", ["neuro_backstepping", "dfc", "osfc"])
def test_no_simulated_scenario_leaves_a_bound_that_is_proved(law):
    config = load([], [f'controller="{law}"', *SHORT])
    prover = Prover.of(config, {})._replace(claim=(9.0, 9.0, 9.0))
    ends = box(config, 0.2)
    (leaf,) = leaves(prover.tree(ends)[0])
    errors = simulated(config, inside(ends, 64, 0), dt=2e-3, n_steps=300)
    assert np.all(errors.max(axis=1) <= leaf["bounds"])
    assert np.all(errors.max(axis=1) >= 0.2 * np.asarray(leaf["bounds"]))  # and it is no bound of another kind


@pytest.mark.slow
def test_of_one_scenario_nearly_the_simulated_error_is_proved():
    config = load([], SHORT)
    (leaf,) = leaves(Prover.of(config, {}).tree(box(config, 0.0))[0])
    values = {name: jnp.asarray([value]) for name, value in nominal(config).items()}
    errors = simulated(config, values, dt=1e-3, n_steps=600)[:, 0]
    assert np.all(errors <= leaf["bounds"]) and np.all(leaf["bounds"] <= 1.6 * errors + 2e-3)


class Elsewhere:
    """Workers that were sent everything, the last asked first."""

    def each(self, jobs, numbers):
        prepare, about = pickle.loads(pickle.dumps((jobs.prepare, jobs.about)))
        return ((number, prepare(about)(number)) for number in reversed(numbers))


@pytest.fixture(scope="module")
def split():
    """A prover that has to split a box, and the box."""
    config = load([], [*SHORT, "certify.boxes=4"])
    prover, ends = Prover.of(config, {"start.heading": 1.0, "start.position[0]": 0.1}), box(config, 0.3)
    whole = [prover.problem.bounds(checker.Box(ends), (0.7, 0.815, lean))[2] for lean in LEANS]
    return prover._replace(claim=(9.0, 9.0, 0.99 * min(whole))), ends


def test_a_box_that_is_too_large_is_split_where_the_gradient_says(split):
    prover, ends = split
    tree, _ = prover.tree(ends)
    assert tree["split"] == "start.heading" and 2 <= len(leaves(tree)) <= 4
    assert all(part["bounds"][2] <= prover.claim[2] for part in leaves(tree))


def recursive(prover, part, most):
    """The same tree, the worse half of every part first."""
    leaf, _ = prover._leaf(part)
    name = prover._split(part)
    if leaf or most < 2 or not name:
        return leaf
    at = sum(part.intervals[name]) / 2
    below, above = part.halves(name, at)
    few, many = most // 2, most - most // 2
    worse_above = prover.steep.get(name, 0.0) > 0
    sides = [
        recursive(prover, below, many if worse_above else few),
        recursive(prover, above, few if worse_above else many),
    ]
    return {"split": name, "at": at, "below": sides[0], "above": sides[1]} if all(sides) else None


@pytest.mark.slow
def test_a_tree_is_the_same_whoever_looks_at_its_parts(split):
    prover, ends = split
    tree, why = prover.tree(ends, Elsewhere())
    assert (tree, why) == prover.tree(ends) == (recursive(prover, checker.Box(ends), prover.most), "")
    assert tree["split"]
    hard = prover._replace(claim=(9.0, 9.0, 0.8 * prover.claim[2]))
    tree, why = hard.tree(ends, Elsewhere())
    assert tree is None and "the error in heading is bounded by" in why and why == hard.tree(ends)[1]


def test_the_box_of_a_share_is_that_share_of_the_way_to_either_end():
    ends = box(load([], []), 0.5)
    assert ends["deadzone.position.slope_right"] == pytest.approx((0.45, 0.75))
    assert ends["start.position[0]"] == pytest.approx((-0.5, 0.0))
    assert ends["start.heading"] == pytest.approx((-0.2, 0.55))
    assert ends["start.velocity[1]"] == (0.1, 0.1)


REASONS = {
    "asmc": ('controller="asmc"', "its command jumps with the sign of an error"),
    "ftsmc": ('controller="ftsmc"', "unbounded slope at a small error"),
    "schedule": (
        'controller.k2={over="speed", nodes=[0.0, 1.0], values=[20.0, 18.0]}',
        "a curve over something measured",
    ),
    "kinematic": ('scenario.plant.yaw_rate="kinematic"', "reading R9"),
    "coloured": ('scenario.disturbance={type="step"}', "not one cosine"),
    "line": ('scenario.path={type="line"}', "not among those that the checker computes"),
}


@pytest.mark.parametrize("name", REASONS)
def test_where_nothing_can_be_proved_it_says_why(name):
    setting, why = REASONS[name]
    said = certify(load([], [setting, *SHORT]))
    assert why in said.why and not said.certificate and not said.proved


def test_of_a_base_that_follows_a_route_nothing_is_proved():
    config = load(["base"], ['controller.inner="path_pid"'])
    assert "in continuous time" in unproved(config)


def test_sides_that_are_no_ranges_of_the_scenario_are_refused():
    wrong = ['certify.over=[{"start.nose"={between=[0,1]}}, {"start.heading"={between=[0,1], points=3}}]']
    with pytest.raises(agvjax.InputError) as error:
        load([], wrong, faults)
    assert {fault.key for fault in error.value.faults} == {"certify.over", "certify.over.start.heading"}


def test_sides_along_which_a_deadzone_would_be_none_are_refused():
    wrong = ['slope_right"={times=[0, 1.1]}', 'threshold_left"={between=[-0.1, 0.5]}']
    for side in wrong:
        with pytest.raises(agvjax.InputError) as error:
            load([], [f'certify.over=[{{"deadzone.position.{side}}}]'], faults)
        (fault,) = error.value.faults
        assert fault.key.startswith("certify.over.deadzone.position.") and fault.value <= 0


@pytest.mark.slow
def test_the_command_says_of_which_loop_nothing_can_be_proved(tmp_path):
    _, said = run(["certify", "--out", str(tmp_path), "--set", 'controller="asmc"'], code=1)
    assert "Nothing can be proved of this loop: ASMC" in said
    assert files_of(tmp_path) == ["config.toml", "report.html", "report.md"]


@pytest.mark.slow
def test_the_command_writes_a_certificate_that_the_checker_accepts(tmp_path):
    settings = [x for s in (*SHORT, *SMALL, "certify.halvings=0") for x in ("--set", s)]
    sides = ["--over", "deadzone.heading.threshold_right*=0.95:1.05", "--over", "disturbance.amplitude=0.15:0.25"]
    out, _ = run(["certify", "--out", str(tmp_path / "done"), *settings, *sides])
    assert "Proved in the whole box: |x| and |y| <= 0.2 m" in " ".join(out.split())
    there = ["certificate.json", "checker.py", "config.toml", "map.png", "report.html", "report.md"]
    assert files_of(tmp_path / "done") == there
    alone = [
        sys.executable,
        "-I",
        "-c",
        "import sys; sys.modules['jax'] = None; import runpy; sys.argv = sys.argv[1:];",
    ]
    alone[-1] += "runpy.run_path(sys.argv[0], run_name='__main__')"
    names = [str(tmp_path / "done" / name) for name in ("checker.py", "certificate.json")]
    done = subprocess.run([*alone, *names], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stdout.startswith("proved, in 1 box: |x| <= 0.2 m"), done


@pytest.mark.slow
def test_workers_write_the_same_certificate(tmp_path):
    pytest.importorskip("distributed")
    bounds = ["certify.within=0.4", "certify.within_heading=0.137"]  # half of the box is proved, in parts
    settings = [x for s in (*SHORT, *SMALL, *bounds, "certify.halvings=1") for x in ("--set", s)]
    for name, more in (("here", []), ("there", ["--scheduler", "local:2"])):
        run(["certify", "--out", str(tmp_path / name), *settings, *more], code=1)
    here, there = (json.loads((tmp_path / name / "certificate.json").read_text()) for name in ("here", "there"))
    assert here == there and "split" in here["tree"]
    _, said = run(["certify", "--out", str(tmp_path / "nobody"), *settings, "--scheduler", "tcp://127.0.0.1:9"], code=1)
    assert "no scheduler answers" in said and files_of(tmp_path / "nobody") == ["config.toml"]  # nothing half proved


@pytest.mark.slow
@pytest.mark.parametrize("searched, within, where", [(0.5, 9.0, "a little beyond 0.5"), (4.0, 1e-3, "at the nominal")])
def test_a_proof_that_a_search_contradicts_is_a_failure_and_no_certificate(
    searched, within, where, tmp_path, monkeypatch
):
    """The checker is wrong: beyond half of the box, or at the nominal scenario, whose late error is not below 1 mm."""
    monkeypatch.setattr(checker.Problem, "bounds", lambda self, part, slopes: [0.0, 0.0, 0.0])
    monkeypatch.setattr(Seeker, "share", lambda self: searched)
    monkeypatch.setattr(Seeker, "steepest", lambda self, share: {})
    config = load([], [*SHORT, f"certify.within={within}", f"certify.within_heading={within}"])
    found = certify(config)
    assert found.contradicted and not found.proved and found.share == 1
    told = write(config, found, tmp_path)
    assert "contradict each other" in told.failure and where in told.failure and not told.text
    assert files_of(tmp_path) == ["report.html", "report.md"]


@pytest.mark.slow
def test_in_the_certified_box_neither_samples_nor_the_adversary_find_a_violation():
    """The paper's gains and box; 2e4 samples and 64 ascents here, more in `benchmarks/results/certify`."""
    config = load([], ["certify.halvings=1", "certify.boxes=2"])
    found = certify(config)
    assert found.share >= 0.5 and found.share / found.found >= 0.5
    assert checker.check(json.loads(json.dumps(found.certificate))) == found.boxes
    limits = np.array(found.bounds)[:, None]
    errors = jax.jit(
        lambda values: late_errors(config.controller, config.scenario, values, 4.0, **config.timing("sweep"))
    )
    for seed in range(20):
        worst, ok = errors(scenarios(config.scenario, inside(found.box, 1000, seed)))
        assert bool(jnp.all(ok)) and np.all(np.asarray(worst) <= limits)
    search = dataclasses.replace(config.tune.search, starts=16)
    seeker = Seeker.of(dataclasses.replace(config, tune=dataclasses.replace(config.tune, search=search)))
    for round_ in range(4):
        assert seeker.worst(found.share, round_)[0] <= 1
