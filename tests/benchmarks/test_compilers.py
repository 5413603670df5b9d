"""What `make compilers` asks for, and when it finds that releases differ. Its environments are made by that target."""

import json
import re
import tomllib

import pytest

from benchmarks import compilers
from commands import ROOT, python


def found(name, release="1 1", **more):
    numbers = {"rollouts": [1.0, -2.0], "gradient": [3.0], "search": [0.5, 0.5]}
    about = {"python": "3", "jaxlib": "1", "said": "", "evaluate_ms": 1.0, "gradient_ms": 2.0}
    return {"name": name, "options": True, "release": release} | about | numbers | more


def test_the_oldest_release_is_the_one_that_the_project_declares():
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    (lowest,) = (re.search(r">=([\d.]+)", one)[1] for one in declared if one.startswith("jaxlib"))
    oldest, installed, newest, *_ = compilers.wanted()
    assert oldest[2] == [f"jax=={lowest}", f"jaxlib=={lowest}"]
    assert installed[2] != oldest[2] and newest[2][0] == "--upgrade"


def test_releases_that_agree_are_told_from_those_that_do_not():
    lines, wrong = compilers.table([found("a"), found("b", rollouts=[1.0, -2.0 - 1e-10])])
    assert not wrong and len(lines) == 4 and "5.0e-11" in lines[-1]
    for key, numbers in (("rollouts", [1.0, -2.001]), ("gradient", [float("nan")]), ("search", [0.5, 0.4])):
        lines, wrong = compilers.table([found("a"), found("b", **{key: numbers})])
        assert wrong == [f"b: {key}"] and lines[-1] == f"differs: b: {key}"


@pytest.mark.slow
def test_this_release_finds_the_same_with_the_options_and_without():
    with_them, without = (json.loads(python(compilers.PROGRAM.format(on=on)).splitlines()[-1]) for on in (True, False))
    assert with_them["said"] == "fast compiler options set" and without["said"] == "left alone"
    for key, most in compilers.AGREE.items():
        assert compilers.difference(with_them[key], without[key]) <= most
