"""The evidence about exported C: what its checks find in right code and in wrong code, and what was not run."""

import dataclasses
import json
import os
import random
import re
import shutil
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from tuning.cli.main import main
from tuning.config.write import gains_table
from tuning.export import artefact, c, program
from tuning.export.evidence import beside_jax, check, collect, coverage, misra, page, rows, sanitizers, search, trace
from tuning.export.evidence.values import MATHS
from tuning.export.expressions import FUNCTIONS, INFIX, SPECIAL

needs_gcc = pytest.mark.skipif(not (shutil.which("gcc") and shutil.which("gcov")), reason="gcc or gcov is missing")
SMALL = agvjax.Sampled(inner=agvjax.OSFC(), vehicle=agvjax.Unicycle())
LIMITED = agvjax.Sampled(
    inner=agvjax.NeuroBackstepping(k1=3.0, k2=10.0, Lam=2.0, omega_n=30.0),
    vehicle=agvjax.Unicycle(),
    anti_windup=agvjax.BackCalculation(speed=0.8, limits=np.array([3.0, 6.0])),
)


def about(law, folder):
    """What the evidence of a law is about, its rows and what JAX makes of them."""
    (folder / "gains.toml").write_text(gains_table(law))
    found = artefact.read(str(folder / "gains.toml"))
    step = program.step(found.controller)
    subject = collect.subject_of(found, "law", c.library(found, step, "law"))
    by_bits = collect.vectors(subject)
    return SimpleNamespace(subject=subject, rows=by_bits, wanted=rows.by_jax(found, subject.layout, by_bits[64]))


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    return about(SMALL, tmp_path_factory.mktemp("small"))


def bench(folder, subject):
    made = check.Bench(folder, [])
    collect.write(made, subject)
    return made


# ---- the search


def found_by(function, **arguments):
    """What is searched of a function of named numbers, as a step would be."""
    tree = {name: jnp.asarray(x) for name, x in arguments.items()}
    one = program.program_of(lambda reference: {"state": function(**reference)}, {"reference": tree})
    columns = {group: [] for group in rows.GROUPS} | {"reference": [f"r_{name}" for name in arguments]}
    layout = rows.Layout(columns, [])
    seeds = np.array([[0.0, 0.0, 0.0, *arguments.values()]])
    return search.search(one, layout, seeds, [], np.float64, False)


def test_a_narrow_way_is_found_by_getting_nearer():
    """The window about x y = 37.25 is 1e-6 wide and a million widths from the seed: no 256 random rows meet it."""
    jax.config.update("jax_enable_x64", True)
    found = found_by(lambda x, y: jnp.where(jnp.abs(x * y - 37.25) < 1e-6, x, y), x=1.0, y=1.0)
    assert not found.missing and found.goals == 2
    product = found.rows[:, 3] * found.rows[:, 4]
    assert (np.abs(product - 37.25) < 1e-6).any() and not (np.abs(product - 37.25) < 1e-6).all()


def test_a_way_that_no_number_takes_is_named():
    jax.config.update("jax_enable_x64", True)
    found = found_by(lambda x, y: jnp.where(x * x < -1.0, x, y), x=1.0, y=1.0)
    assert len(found.missing) == 1 and found.missing[0].endswith("never true")


# ---- checks that find what is there


@needs_gcc
def test_right_code_passes_and_every_branch_is_taken(small, tmp_path):
    made = bench(tmp_path, small.subject)
    beside = beside_jax.check(small.subject, made, small.rows[64], small.wanted)
    assert beside.verdict == "passed", beside.findings
    assert beside.figures["driven"] == 32 and beside.figures["worst"] < 1e-12
    covered = coverage.check(small.subject, made, small.rows)
    assert covered.verdict == "passed", covered.findings
    assert covered.figures["taken_64"] == covered.figures["branches_64"] > 40
    assert covered.figures["taken_32"] == covered.figures["branches_32"] > covered.figures["branches_64"]


@needs_gcc
def test_a_law_that_amplifies_rounding_agrees_step_by_step(tmp_path):
    """OSFC every 50 ms: in C and in JAX the same drive is 1e-8 apart after 23 steps."""
    law = dataclasses.replace(SMALL, period=0.05)
    (tmp_path / "gains.toml").write_text(gains_table(law))
    found = artefact.read(str(tmp_path / "gains.toml"))
    step = program.step(found.controller)
    subject = collect.subject_of(found, "law", c.library(found, step, "law"))
    drive = rows.drive(rows.usual(found, step, subject.layout))
    done = beside_jax.check(subject, bench(tmp_path, subject), drive, rows.by_jax(found, subject.layout, drive))
    assert done.verdict == check.PASSED, done.findings
    assert done.figures["driven"] == 32 and done.figures["worst"] < 1e-12


@needs_gcc
def test_a_branch_that_no_row_takes_is_named_by_file_and_line(small, tmp_path):
    text = small.subject.texts["law.c"]
    dead = "    if (output->limited > 1) {\n        output->limited = 1;\n    }\n#ifdef LAW_FLOAT"
    head, tail = text.rsplit("#ifdef LAW_FLOAT", 1)
    texts = small.subject.texts | {"law.c": head + dead + tail}
    line = texts["law.c"].splitlines().index("        output->limited = 1;", len(head.splitlines())) + 1
    subject = small.subject._replace(texts=texts)
    covered = coverage.check(subject, bench(tmp_path, subject), {64: small.rows[64]})
    assert covered.verdict == "failed" and len(covered.findings) == 2
    assert covered.findings[1] == f"law.c:{line} (64 bits): never run: output->limited = 1;"
    assert covered.findings[0].startswith(f"law.c:{line - 1} (64 bits): way ")


@needs_gcc
def test_a_wrong_tuned_gain_and_a_wrong_period_are_found(small, tmp_path):
    text = small.subject.texts["law.c"]
    gain = re.search(r"LAW_R\(([\d.]+)\), /\* inner", text)
    changed = text[: gain.start(1)] + repr(float(gain[1]) * 1.001) + text[gain.end(1) :]
    header = re.sub(r"_PERIOD [\d.]+", "_PERIOD 0.03", small.subject.texts["law.h"])
    for number, (file, content) in enumerate((("law.c", changed), ("law.h", header))):
        subject = small.subject._replace(texts=small.subject.texts | {file: content})
        folder = tmp_path / str(number)
        folder.mkdir()
        assert beside_jax.check(subject, bench(folder, subject), small.rows[64], small.wanted).verdict == "failed"


# ---- what a check says of itself


def test_a_tool_that_is_missing_is_said_and_never_counted_as_passed(tmp_path):
    made = check.judged("x", "y", ["no-such-tool-anywhere"], check.Bench(tmp_path, []), {"a.c": ""}, lambda b: 1 / 0)
    assert made.verdict == "not run" and made.says == "not run: no-such-tool-anywhere not found"
    passed = made._replace(name="z", verdict="passed")
    assert page.verdict([made, passed]) == "1 of 2 checks passed; 1 not run: x."


def test_a_check_of_no_file_does_not_pass(tmp_path):
    assert check.judged("x", "y", [], check.Bench(tmp_path, []), {}, lambda b: ("", {}, [])).verdict == "failed"


def test_rules_of_misra_are_sorted_by_category_and_only_those_with_a_reason_stay():
    said = "law.c:3:style:misra-c2012-10.3:x\nlaw.c:4:style:misra-c2012-20.10:x\nlaw.c:9:style:misra-c2012-17.3:x\n"
    _, figures, found = misra.judgement(said + said + "law.c:7:error:uninitvar:x\n")
    assert (figures["unjustified_required"], figures["unjustified_mandatory"], figures["justified"]) == (1, 1, 1)
    assert [line.partition(":style")[0] for line in found] == ["law.c:3", "law.c:9", "law.c:7:error:uninitvar:x"]
    assert (
        len(figures["each"]) >= 143
        and {"rule": "20.10", "category": "advisory"}.items()
        <= figures["each"][[one["rule"] for one in figures["each"]].index("20.10")].items()
    )


def test_the_search_knows_every_operation_that_c_can_say():
    of_its_own = {"integer_pow", "round", "convert_element_type", "agvjax_uniform"}  # the last of vehicles alone
    assert {*INFIX, *FUNCTIONS, *SPECIAL, "select_n", "max", "min", "and", "or"} - of_its_own <= set(MATHS)


def test_texts_of_anybody_stay_texts_on_the_page(small, tmp_path):
    worse = "<script>x</script> | `a` | b\n## c"
    facts = small.subject.artefact.provenance
    gains = {name: fact | {"unit": worse} for name, fact in facts["gains"].items()}
    told = facts | {"gains": gains, "verdict": worse, "source": worse, "vehicle": worse, "law": ["Sampled", worse]}
    subject = small.subject._replace(artefact=small.subject.artefact._replace(provenance=told))
    odd = check.Check("x", worse, "failed", worse, {"gcc": worse}, (worse,), {}, (worse,), {})
    page.write(tmp_path, subject, [odd], trace.traces(subject, [odd]))
    html, text = ((tmp_path / f"report.{end}").read_text() for end in ("html", "md"))
    assert "<script" not in html and "\n## c" not in text
    rows_of_trace = [line for line in text.splitlines() if "law.c" in line and line.startswith("|")]
    assert len(rows_of_trace) > 5 and {len(re.findall(r"(?<!\\)\|", line)) for line in rows_of_trace} == {6}


def test_evidence_is_of_c_alone(tmp_path, capsys):
    (tmp_path / "gains.toml").write_text(gains_table(SMALL))
    command = ["export", str(tmp_path / "gains.toml"), "--format", "numpy", "--evidence", "--out", str(tmp_path / "x")]
    assert main(command) == 2 and "--evidence" in capsys.readouterr().err and not (tmp_path / "x").exists()


# ---- planted defects


SEED = int(os.environ.get("DEFECTS", "0"))  # others draw other defects
NUMBER = r"-?\d+\.\d+(?:e-?\d+)?"


def gain(text, rng):
    """A tuned number is off by one percent, or a line takes the gain of another."""
    if rng.random() < 0.5:
        begin = text.index("law_tuned = {")
        of_law = [m for m in re.finditer(rf"LAW_R\(({NUMBER})\)", text[begin : text.index("};", begin)])]
        one = rng.choice([m for m in of_law if float(m[1]) != 0.0])
        return text[: begin + one.start(1)] + repr(float(one[1]) * 1.01) + text[begin + one.end(1) :]
    lines = [m for m in re.finditer(r"= (gains->inner_\w+);", step(text))]
    one, other = rng.sample(lines, 2)
    return changed(text, one.span(1), other[1])


def sign(text, rng):
    """A sum is a difference, or the other way round, or a sign is lost."""
    zeros = {m[1] for m in re.finditer(r" (v\d+) = LAW_R\(0.0\) \* ", step(text))}  # of NaN any sign is NaN: no defect
    found = re.finditer(r"= v\d+ ([+-]) (v\d+);|= (-)[gv]\w+;", step(text))
    one = rng.choice([m for m in found if m[2] not in zeros])
    place = 1 if one[1] else 3
    return changed(text, one.span(place), {"+": "-", "-": "+" if one[1] else ""}[one[place]])


def unit(text, rng):
    """A measured or asked number is in another unit: degrees, millimetres, milliseconds."""
    one = rng.choice([m for m in re.finditer(r"= ((?:measurement|reference)->\S+|gains->period);", step(text))])
    factor = {"heading": 57.29577951308232, "yaw_rate": 57.29577951308232}.get(one[1].partition("->")[2], 1000.0)
    return changed(text, one.span(1), f"LAW_R({factor}) * {one[1]}")


def branch(text, rng):
    """The two values of a choice are swapped, or what it asks is asked the other way round."""
    if rng.random() < 0.5:
        one = rng.choice([m for m in re.finditer(r"\? ([^?:;]+) : ([^?:;]+);", step(text)) if m[1] != m[2]])
        return changed(text, (one.start(1), one.end(2)), f"{one[2]} : {one[1]}")
    one = rng.choice([m for m in re.finditer(r" (>=|<=|>|<) ", step(text)[: step(text).index("#ifdef")])])
    return changed(text, one.span(1), {">": "<", "<": ">", ">=": "<", "<=": ">"}[one[1]])


def order(text, rng):
    """Two numbers of an array or a structure are taken or handed over in the wrong order."""
    kind = rng.choice([r"= \w+->\w+\[(0|1)\];", r"(?:state|output)->\w+(?:\[\d\])? = (v\d+);"])
    lines = [m for m in re.finditer(kind, step(text))]
    while True:
        one, other = sorted(rng.sample(lines, 2), key=lambda m: m.start())
        if one[1] != other[1] and ("= v" in one[0] or one[0][:-3] == other[0][:-3]):
            swapped = changed(text, other.span(1), one[1])
            return changed(swapped, one.span(1), other[1])


def step(text):
    return text[text.index("void law_step") :]


def changed(text, span, new):
    begin = text.index("void law_step")
    return text[: begin + span[0]] + new + text[begin + span[1] :]


@needs_gcc
@pytest.mark.slow
def test_a_law_that_predicts_agrees_with_jax_on_huge_numbers_too(tmp_path):
    """Compiled, JAX overflows elsewhere on three rows: those are compared operation by operation."""
    zones = agvjax.Unicycle().deadzones()
    more = {"compensation": agvjax.Inverse(believed=zones, lead=0.01, width=1.0)}
    law = dataclasses.replace(LIMITED, prediction=agvjax.Predictor(delay=0.05, believed=zones), **more)
    made = about(law, tmp_path)
    done = beside_jax.check(made.subject, bench(tmp_path, made.subject), made.rows[64], made.wanted)
    assert done.verdict == check.PASSED and done.findings == ()


@needs_gcc
@pytest.mark.slow
def test_of_twenty_planted_defects_at_least_nineteen_are_caught(tmp_path):
    """Four of each kind, drawn at random; by the checks that read the C, without those of style."""
    made, rng, caught, seen = about(LIMITED, tmp_path), random.Random(SEED), [], set()
    for kind in (gain, sign, unit, branch, order):
        for number in range(4):
            right = made.subject.texts["law.c"]
            text = kind(right, rng)
            while text in seen:
                text = kind(right, rng)
            assert text != right
            seen.add(text)
            lines = zip(right.splitlines(), text.splitlines(), strict=True)
            planted = "; ".join(f"{a.strip()} -> {b.strip()}" for a, b in lines if a != b)
            subject = made.subject._replace(texts=made.subject.texts | {"law.c": text})
            folder = tmp_path / f"{kind.__name__}{number}"
            folder.mkdir()
            where = bench(folder, subject)
            checks = [
                lambda s=subject, w=where: beside_jax.check(s, w, made.rows[64], made.wanted),
                lambda s=subject, w=where: coverage.check(s, w, made.rows),
                lambda s=subject, w=where: sanitizers.check(s, w, made.rows),
            ]
            by = next((found.name for found in (look() for look in checks) if found.verdict == "failed"), None)
            caught.append(by)
            print(kind.__name__, number, "caught by", by, ":", planted)
    print(sum(by is not None for by in caught), "of", len(caught))
    assert len(caught) == 20 and sum(by is not None for by in caught) >= 19


# ---- the whole of it


ROUTE = """
[scenario]
plant = "base"
disturbance = "none"
[scenario.path]
type = "route"
points = [[0.0, 0.0], [2.0, 0.0], [4.0, 1.0], [5.0, 3.0]]
speed = 0.5
"""
WHOLE = {
    "limited": (LIMITED, ""),
    "path_pid": (agvjax.Sampled(inner=agvjax.PathPID(), vehicle=agvjax.Base(), period=0.05), ROUTE),
    "stanley": (agvjax.Sampled(inner=agvjax.Stanley(k=1.0, wheelbase=0.25), vehicle=agvjax.Base(), period=0.05), ROUTE),
    "small": (SMALL, ""),
}


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="cppcheck is not installed")
@pytest.mark.parametrize("name", WHOLE)
def test_one_command_makes_all_the_evidence(name, tmp_path):
    law, config = WHOLE[name]
    (tmp_path / "gains.toml").write_text(gains_table(law))
    if config:
        (tmp_path / "config.toml").write_text(config)
    out = tmp_path / "out"
    assert main(["export", str(tmp_path / "gains.toml"), "--format", "c", "--evidence", "--out", str(out)]) == 0
    told = json.loads((out / "evidence" / "evidence.json").read_text())
    by_name = {one["name"]: one for one in told["checks"]}
    assert not told["failed"] and {"beside_jax", "coverage", "misra", "sanitizers"} <= set(told["passed"])
    assert by_name["misra"]["figures"]["unjustified_mandatory"] == 0
    assert by_name["misra"]["figures"]["unjustified_required"] == 0
    assert by_name["coverage"]["figures"]["taken_64"] == by_name["coverage"]["figures"]["branches_64"]
    text = (out / "evidence" / "report.html").read_text()
    assert "certif" not in text.lower() and str(tmp_path) not in (out / "evidence" / "evidence.json").read_text()
