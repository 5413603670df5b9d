"""The checker of certificates: its arithmetic against closed forms, its refusals, and that it stands alone."""

import ast
import copy
import io
import json
import math
import subprocess
import sys
import tokenize
from pathlib import Path

import numpy as np
import pytest

import agvjax
from tuning.config import load
from tuning.studies.certify import certify, checker
from tuning.studies.certify.problem import box, problem
from tuning.studies.certify.prove import certificate
from tuning.studies.certify.rules import unproved
from tuning.studies.certify.tree import Prover
from tuning.studies.paper.bounds import peak_gain

SOURCE = Path(checker.__file__).read_text()
DOCUMENTED = ast.Module, ast.ClassDef, ast.FunctionDef
BETWEEN = tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER
SHORT = [
    "simulate.horizon=1.2",
    "criteria.late=0.9",
    "certify.within=0.2",
    "certify.within_heading=0.4",
    "certify.step=0.02",
]


@pytest.fixture(scope="module")
def made():
    """A certificate of the paper's loop over a small box, in two parts."""
    config = load([], [*SHORT, "certify.boxes=2"])
    prover = Prover.of(config, {"deadzone.heading.threshold_right": 1.0})
    ends = box(config, 0.05)
    halves = checker.Box(ends).halves("start.heading", 0.1)
    below, above = (prover.tree(half.intervals)[0] for half in halves)
    tree = {"split": "start.heading", "at": 0.1, "below": below, "above": above}
    return certificate(prover.claim, prover.problem.numbers, ends, tree)


def refused(wrong):
    """Whether the checker refuses it, as a stranger would call it."""
    try:
        checker.check(wrong)
    except (checker.Refused, *checker.NONSENSE):
        return True
    return False


def signed(wrong):
    """With the digest that belongs to its numbers."""
    try:
        return wrong | {"digest": checker.digest(wrong)}
    except ValueError:  # no number
        return wrong


def test_a_certificate_is_accepted_and_says_in_how_many_parts(made):
    assert checker.check(json.loads(json.dumps(made))) == 2


def places(node, path=()):
    """The paths of all numbers of a certificate."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, value in items:
        if isinstance(value, int | float) and not isinstance(value, bool):
            yield (*path, key)
        yield from places(value, (*path, key))


def moved(certificate, path, change):
    """A copy with one number changed."""
    wrong = copy.deepcopy(certificate)
    *parents, last = path
    holder = wrong
    for key in parents:
        holder = holder[key]
    holder[last] = change(holder[last])
    return wrong


def test_a_hundred_and_fifty_certificates_with_one_number_changed_are_refused(made):
    rng, paths = np.random.default_rng(0), list(places(made))
    assert len(paths) > 60
    changes = [lambda x: x * 1.001 + 1e-9, lambda x: -x - 1, lambda x: math.nextafter(x, 1e9), lambda x: math.nan]
    for _ in range(150):
        path, change = paths[rng.integers(len(paths))], changes[rng.integers(len(changes))]
        assert refused(moved(made, path, change)), path


def stronger(made):
    """Certificates whose digest belongs to them and that claim more, or prove less, than the one they are made of."""
    for i, name in enumerate(checker.CHANNELS):
        yield f"claim {name}", moved(made, ("claim", name), lambda x, i=i: 0.9 * made["tree"]["below"]["bounds"][i])
        for half in ("below", "above"):
            yield f"{half} {name}", moved(made, ("tree", half, "bounds", i), lambda x: 0.999 * x)
            yield f"{half} {name} up", moved(made, ("tree", half, "bounds", i), lambda x: 1.001 * x)
    for leaf, (low, high) in made["box"].items():
        if high > low:
            yield f"{leaf} up", moved(made, ("box", leaf, 1), lambda x, w=high - low: x + w)
            yield f"{leaf} down", moved(made, ("box", leaf, 0), lambda x, w=high - low: x - w)
    for gain, factor in (("k1", 0.5), ("k2", 0.7), ("k3", 0.7), ("Lam", 8.0), ("Lam_psi", 4.0), ("omega_n", 0.5)):
        yield gain, moved(made, ("problem", "gains", gain), lambda x, f=factor: f * x)
    for what, path in (("late", ("late",)), ("path", ("path", "omega")), ("wave", ("disturbance", "phase"))):
        yield what, moved(made, ("problem", *path), lambda x: 0.8 * x + 0.1)
    yield "split", moved(made, ("tree", "at"), lambda x: x + 1.0)
    one = copy.deepcopy(made)
    one["tree"] = one["tree"]["below"]
    yield "half of the box", one


@pytest.mark.parametrize("every", [4, pytest.param(1, marks=pytest.mark.slow)])
def test_fifty_stronger_claims_with_a_digest_of_their_own_are_refused(made, every):
    wrong = list(stronger(made))
    assert len(wrong) >= 50
    wrong = wrong[::every]
    accepted = [what for what, certificate in wrong if not refused(signed(certificate))]
    assert not accepted


def test_the_integral_of_the_impulse_response_is_the_closed_form_and_never_below_it():
    """Of (Z3, beta2) at slope 1 it is that of s / (s^2 + k3 s + Lam_psi), known in closed form."""
    gains = {"k1": 20.0, "k2": 20.0, "k3": 12.0, "Lam": 16.0, "Lam_psi": 9.0, "omega_n": 90.0, "zeta": 0.75}
    numbers = {"law": "neuro_backstepping", "step": 0.01, "cells": 2500}
    numbers["gains"] = gains | {"Pi_hat": 1.0, "Pi_psi_hat": 1.0, "literal": 0.0}
    _, heading, _ = checker.loops(numbers, (1.0, 1.0))
    total, exact = heading.kernel_W[heading.names.index("Z")].sum(), peak_gain(12.0, 9.0)
    assert exact <= total <= 1.01 * exact


def test_powers_of_an_exponential_are_those_of_a_rotation():
    E, integral = checker.powers([[0, 3], [-3, 0]], 0.01, 700)
    angle = 0.03 * np.arange(701)
    np.testing.assert_allclose(E[:, 0, 0], np.cos(angle), atol=1e-13)
    np.testing.assert_allclose(E[:, 0, 1], np.sin(angle), atol=1e-13)
    np.testing.assert_allclose(integral[0], [math.sin(0.03) / 3, (1 - math.cos(0.03)) / 3], atol=1e-16)


@pytest.mark.parametrize("x", [0.0, 0.1, 1.57, 3.2, 12.6])
def test_sine_and_cosine_by_integers_are_those_of_the_library(x):
    np.testing.assert_allclose(checker.sine_cosine(checker.Fraction(x)), (math.sin(x), math.cos(x)), atol=1e-15)


def test_forms_enclose_what_a_deadzone_delivers():
    """By the deadzone of the simulator, at random values of the unknowns and commands near its kinks."""
    rng, ends = np.random.default_rng(1), {leaf: (0.1, 0.1) for leaf in checker.LEAVES}
    sides = {"slope_right": (0.4, 0.8), "slope_left": (0.5, 1.1), "threshold_right": (0.3, 0.6)}
    ends |= {f"deadzone.position.{name}": pair for name, pair in (sides | {"threshold_left": (0.2, 0.5)}).items()}
    part, cells = checker.Box(ends), 200
    u = checker.form(rng.uniform(-1.5, 1.5, cells), rng.uniform(0, 0.3, cells))
    u[1 : checker.S + 1] = rng.uniform(-0.1, 0.1, (checker.S, cells))
    gives = checker.delivered(u, part, "position")
    whole = part.beyond("position", u[0] - checker.spread(u), u[0] + checker.spread(u), 0.7)
    for _ in range(200):
        e, own = rng.uniform(-1, 1, checker.S), rng.uniform(-1, 1, cells)
        command = u[0] + e @ u[1 : checker.S + 1] + own * u[-1]
        numbers = {
            n: (lo + hi) / 2 + x * (hi - lo) / 2 for (n, (lo, hi)), x in zip(part.intervals.items(), e, strict=True)
        }
        names = {name: numbers[f"deadzone.position.{name}"] for name in checker.SLOPES}
        exact = np.asarray(agvjax.Deadzone(**names)(command))
        centre = gives[0] + e @ gives[1 : checker.S + 1]
        assert np.all(np.abs(exact - centre) <= gives[-1] + np.abs(gives[-2]))
        assert np.all(np.abs(exact - 0.7 * command - whole[0]) <= whole[-1])


def test_the_network_is_never_more_active_than_its_bound():
    net = agvjax.NeuroBackstepping().position_network
    bound = checker.energy({"centers": np.asarray(net.centers, float).tolist(), "width": float(net.width)}, 2)
    seen = [float(net.energy(np.asarray(v))) for v in np.random.default_rng(2).uniform(-4, 4, (300, 2))]
    assert max(max(seen), float(net.energy(np.zeros(2)))) <= bound <= 1.01


def code_lines(source):
    """Lines of a program, comments and docstrings aside."""
    words = [t for t in tokenize.generate_tokens(io.StringIO(source).readline) if t.type not in BETWEEN]
    told = [n.body[0] for n in ast.walk(ast.parse(source)) if isinstance(n, DOCUMENTED) and ast.get_docstring(n)]
    prose = {line for text in told for line in range(text.lineno, text.end_lineno + 1)}
    return len({line for t in words for line in range(t.start[0], t.end[0] + 1)} - prose)


def test_the_checker_stands_alone(made, tmp_path):
    """Python without this package, and what NumPy needs: it imports nothing else."""
    tree = ast.parse(SOURCE)
    names = {a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names}
    names |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert names - set(sys.stdlib_module_names) == {"numpy"}
    assert code_lines(SOURCE) < 500
    (tmp_path / "certificate.json").write_text(json.dumps(made))
    (tmp_path / "checker.py").write_text(SOURCE)
    run = [sys.executable, "checker.py", "certificate.json"]
    said = subprocess.run(run, cwd=tmp_path, env={}, capture_output=True, text=True)
    assert said.returncode == 0 and said.stdout.startswith("proved, in 2 boxes: |x| <= 0.2 m"), said
    (tmp_path / "certificate.json").write_text("[1, 2]")
    said = subprocess.run(run, cwd=tmp_path, env={}, capture_output=True, text=True)
    assert said.returncode == 1 and said.stdout.startswith("refused:") and not said.stderr


def test_problems_of_configurations_hold_their_numbers():
    config = load([], ['controller="osfc"', "controller.kp=4.0"])
    numbers = problem(config)
    assert numbers["law"] == "osfc" and numbers["gains"]["kp"] == 4.0 and "networks" not in numbers


def test_a_law_without_wrap_on_a_path_whose_heading_jumps_is_refused():
    """A circle's heading leaps from pi to -pi a quarter of a lap after the start; an unwrapped law then turns round."""
    settings = ["scenario.path=circle", "controller.wrapped=false", "scenario.start.heading=1.2"]
    config = load([], [*settings, "simulate.horizon=6.0", "criteria.late=3.0"])
    seen = agvjax.simulate(config.controller, config.scenario, dt=0.01, n_steps=600)
    error = np.asarray(seen.heading) - (math.pi / 2 + 0.5 * np.asarray(seen.t))
    assert np.abs(np.angle(np.exp(1j * error)))[300:].max() > 2
    assert unproved(config) == checker.JUMPS
    with pytest.raises(checker.Refused, match="unwrapped"):
        checker.Problem(problem(config))
    assert not unproved(load([], ["scenario.path=circle"])) and not unproved(load([], ["controller.wrapped=false"]))


FULL = "={slope_right=1.0, slope_left=1.0, threshold_right=0.0, threshold_left=0.0}"


def test_an_observer_whose_error_may_pass_pi_is_refused_though_the_heading_error_stays_below():
    """Without its wraps this observer would bring 3.05 rad below 0.5 rad; with them the vehicle turns round."""
    gains = ["controller.kpsi=1.8968", "controller.wow=1.6836", "controller.b0w=0.09815"]
    quiet = ["scenario.disturbance.amplitude=0.0", "scenario.path.omega=0.02", "scenario.start.heading=3.5136476"]
    zones = ["scenario.deadzone.heading" + FULL, "scenario.deadzone.position" + FULL.replace("1.0", "0.7")]
    timing = ["simulate.horizon=0.8", "criteria.late=0.75", "certify.step=0.005"]
    config = load([], ['controller="osfc"', *gains, *quiet, *zones, *timing])
    run = agvjax.simulate(config.controller, config.scenario, dt=1e-3, n_steps=800)
    error = np.asarray(run.heading - run.reference_heading)
    assert np.abs(np.angle(np.exp(1j * error)))[750:].max() > 1.5
    assert np.abs(np.asarray(run.heading - run.controller.q1)).max() > math.pi
    with pytest.raises(checker.Refused, match="where it wraps"):
        checker.Problem(problem(config)).bounds(checker.Box(box(config, 0.0)), (0.7, 1.0, 0.3))


NOT_NUMBERS = True, "0.5", None, [0.5], math.inf


def test_what_is_no_number_where_a_number_must_be_is_refused(made):
    numbers = [p for p in places(made) if p[0] != "digest"]
    kinds = {tuple(k for k in p if isinstance(k, str)): p for p in numbers}
    assert len(kinds) > 40
    accepted = []
    for kind, path in kinds.items():
        for wrong in NOT_NUMBERS:
            if not refused(signed(moved(made, path, lambda x, w=wrong: w))):
                accepted.append((kind, wrong))
    assert not accepted
    assert refused(signed(moved(made, ("version",), float)))
    assert refused(signed(moved(made, ("problem", "cells"), float)))


def test_a_key_that_nobody_reads_and_a_missing_one_are_refused(made):
    holders = [(), ("claim",), ("box",), ("tree",), ("tree", "below"), ("problem",)]
    inner = ["gains", "path", "disturbance", "networks"]
    holders += [("problem", name) for name in inner] + [("problem", "networks", "heading")]
    for holder in holders:
        node = made
        for key in holder:
            node = node[key]
        for changed in (node | {"limit": 1.0}, dict(list(node.items())[1:])):
            assert refused(signed(moved(made, holder, lambda x, c=changed: c) if holder else changed)), holder


def test_a_key_that_is_written_twice_is_refused(made, tmp_path, capsys):
    text = json.dumps(made).replace('"claim": {', '"claim": {"x": 9.0, ')
    (tmp_path / "certificate.json").write_text(text)
    assert json.loads(text) == made  # the last one counts
    assert checker.main([str(tmp_path / "certificate.json")]) == 1
    assert "written twice" in capsys.readouterr().out


def test_the_checker_prints_what_is_proved(made, tmp_path, capsys):
    (tmp_path / "certificate.json").write_text(json.dumps(made))
    assert checker.main([str(tmp_path / "certificate.json")]) == 0
    said = capsys.readouterr().out
    for part in (
        "|y| <= 0.2 m",
        "from 0.9 s to 1.2 s",
        "law neuro_backstepping, its error wrapped",
        "k1: 20.0",
        "path: type: dumbbell, amplitude: 1.0",
        "start.velocity[0] = 0.1\n",
        f"start.heading from {made['box']['start.heading'][0]} to {made['box']['start.heading'][1]}",
    ):
        assert part in said


def test_a_grid_or_an_angle_too_large_for_the_allowance_of_rounding_is_refused():
    for settings, why in (
        (["certify.step=1e-4"], "a longer step is needed"),
        (["scenario.disturbance.omega=1e4"], "passes 10000 rad"),
    ):
        assert why in certify(load([], [*SHORT, *settings])).why


def test_the_time_from_which_a_bound_counts_is_compared_exactly():
    """Of the floats 0.03 and 0.01 the quotient is rounded up to 3, but 0.03 is less than three times 0.01."""
    numbers = problem(load([], [*SHORT, "certify.step=0.01"]))
    assert checker.Problem(numbers | {"late": 0.03}).late == 2


def test_the_allowance_for_rounding_does_not_vanish_for_a_slope_below_zero():
    part = checker.Box({leaf: (0.5, 0.5) for leaf in checker.LEAVES})
    rest = part.beyond("position", np.array([0.7]), np.array([0.7]), -0.5)[-1]
    assert rest[0] >= 2**-53 * 0.5 * 0.7
