"""Examples in the documentation run as they stand; commands of `docs/extending.md` with small numbers added."""

import ast
import re
import shlex
import sys

import jax
import numpy as np
import pytest

import agvjax
from agvjax import Metrics, Sampled, Scenario, simulate
from agvjax.leaves import unit_of
from agvjax.metric_table import METRICS
from commands import FAST, ROOT, run
from runs import logged
from tuning import config as configuration
from tuning.cli.main import main
from tuning.compute import compiled
from tuning.config.load import resolve as load_table
from tuning.export import FORMATS
from tuning.tune.rules import faults

LITTLE_SEARCH = [f"tune.search.{part}" for part in ("scouts=4", "starts=1", "iterations=1", "checks=0")]
RK4 = "simulate.integrator=rk4"  # as it tunes: what Euler's method makes of those gains at 10 ms is another matter
SMALL = {
    "simulate": FAST,
    "tune": [*FAST, RK4, "ensemble.size=4", "ensemble.validation_size=2", "tune.iterations=2", *LITTLE_SEARCH],
    "sweep": [*FAST, "sweep.samples=2", "sweep.radius=false"],
    "identify": ['identify.fit=["deadzone"]', "identify.bootstrap=20", "identify.starts=1", "identify.drives=0"],
    "export": [],
}
FENCE = re.compile(r"```(\w+)\n(.*?)```", re.S)
NAME = re.compile(r"# ([\w/]+\.(?:py|toml))\n")


def blocks(page, kind):
    return [body for what, body in FENCE.findall((ROOT / page).read_text(encoding="utf-8")) if what == kind]


def executed(code):
    scope = {}
    exec(compile(code, "example", "exec"), scope)
    return scope


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the files of `docs/extending.md`: blocks that begin with the name of one."""
    home = tmp_path_factory.mktemp("own")
    for kind in ("python", "toml"):
        for body in blocks("docs/extending.md", kind):
            if name := NAME.match(body):
                (home / name[1]).write_text(body)
    return home


@pytest.fixture
def here(folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(str(folder))
    yield folder
    for path in folder.glob("*.py"):
        sys.modules.pop(path.stem, None)


@pytest.mark.parametrize(
    "page", ["docs/extending.md", *(pytest.param(p, marks=pytest.mark.slow) for p in ("README.md", "docs/python.md"))]
)
def test_an_example_in_python_runs(page, here, capsys):
    examples = [body for body in blocks(page, "python") if not NAME.match(body)]
    assert examples
    with jax.numpy_dtype_promotion("standard"):  # as JAX is set for a user
        for body in examples:
            executed(body)


def test_a_table_in_the_recipes_is_read(here):
    files = [path.name for path in sorted(here.glob("*.toml"))]
    assert {"sampled.toml", "world.toml"} <= set(files)
    read = {name: configuration.load([name], imports=["my_law.py", "omni.py", "world.py"]) for name in files}
    assert isinstance(read["sampled.toml"].controller, Sampled)
    assert type(read["sampled.toml"].controller.inner).__name__ == "Feedforward"
    scenario = read["world.toml"].scenario
    assert [type(x).__name__ for x in (scenario.path, scenario.disturbance)] == ["Ellipse", "Gust"]
    assert scenario.actuators["position"]["soft"].most == 6.0


def test_the_law_of_the_page_is_that_of_the_notebooks(folder):
    def bare(text):
        tree = ast.parse(text)
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node):
                del node.body[0]
        return ast.unparse(tree)

    assert bare((folder / "my_law.py").read_text()) == bare((ROOT / "notebooks" / "my_law.py").read_text())


@pytest.mark.slow
def test_a_metric_is_a_row_and_what_it_is_of_a_run(here, monkeypatch):
    name = "total_overshoot"
    monkeypatch.setattr(Metrics, name, None, raising=False)  # both are taken back afterwards
    monkeypatch.setitem(METRICS, name, None)
    settings = [f"tune.goals.{name}=1.0", f'sweep.metrics=["{name}"]']
    config = configuration.load([], settings, faults, imports=[f"{name}.py"])
    assert set(config.tune.goals) == {name} == set(config.sweep.metrics)
    run = agvjax.evaluate(config.controller, config.scenario, dt=0.01, n_steps=100)
    parts = [run[f"overshoot_{channel}"] for channel in ("x", "y", "heading")]
    np.testing.assert_allclose(run[name], sum(parts), rtol=1e-12)


def test_an_exporter_is_a_file_and_a_row(here, monkeypatch):
    monkeypatch.setattr(compiled, "keep_compiled", lambda: None)
    for name, module in {**FORMATS, "listing": "listing"}.items():
        monkeypatch.setitem(FORMATS, name, module)
    gains = ROOT / "tests" / "data" / "before-rooms" / "configs" / "gains-sampled" / "gains.toml"
    assert main(["export", str(gains), "--format", "listing", "--out", "listed", "--quiet"]) == 0
    assert "inner.k1 = 3.0 1/s" in (here / "listed" / "gains.txt").read_text()


def commands():
    lines = [line for body in blocks("docs/extending.md", "sh") for line in body.splitlines()]
    assert all(line.startswith("agvjax ") and "--import" in line for line in lines)
    return list(dict.fromkeys(lines))


def drive(file):
    """A drive of the page's robot, as it would be logged at 50 Hz."""
    import omni

    run = simulate(agvjax.NeuroBackstepping(), Scenario.of(omni.Omni()), dt=0.005, n_steps=3200, save_every=4)
    logged(file, run, omni.WHEELS)


@pytest.mark.slow
@pytest.mark.parametrize("quick", [True, False])
def test_the_commands_of_the_recipes_run(quick, here):
    """Nothing but the files of the page is there: a law or a plant of one's own needs no other file touched."""
    lines = [line for line in commands() if ("simulate" in line) == quick]
    assert len(lines) >= 4
    if not quick:
        drive("drive.csv")
    for line in lines:
        words = shlex.split(line)[1:]
        out = [] if "--out" in words else ["--out", f"{words[0]}-{len(list(here.iterdir()))}"]
        small = [x for text in SMALL[words[0]] for x in ("--set", text)]
        run([*words, *out, *small])


def test_the_fields_of_plants_are_listed_with_their_units_and_defaults():
    """And no number that a plant of the page has is left out."""
    page = (ROOT / "docs/vehicles.md").read_text(encoding="utf-8")
    body = page.split("| plant | field | unit | default |\n|---|---|---|---|\n")[1].split("\n\n")[0]
    told, plants = {}, []
    for row in body.splitlines():
        which, fields, unit, default = (cell.strip() for cell in row.strip("|").split("|"))
        plants = re.findall("`(.*?)`", which) or plants
        values = default.split(", ")
        for name, value in zip(re.findall("`([a-zA-Z_.]+)`", fields), values, strict=True):
            told |= {(plant, name): (unit, float(value)) for plant in plants}
    for plant in dict.fromkeys(plant for plant, _ in told):
        table = {"type": plant} | ({"drive": "speed"} if plant == "differential_drive" else {})
        scene = load_table({"scenario": {"plant": table}}).scenario
        numbers = {n.removeprefix("plant."): x for n, x in agvjax.leaves(scene).items() if n.startswith("plant.")}
        mine = {n for n, x in numbers.items() if not np.ndim(x) and not n.startswith(("tyre.", "limits.switch"))}
        assert mine == {name for other, name in told if other == plant}, plant
        for name in mine:
            unit, default = told[plant, name]
            assert unit_of(scene, f"plant.{name}") == unit, name
            assert float(numbers[name]) == pytest.approx(default, rel=6e-4), name


PAGES = [
    *sorted((ROOT / "docs").glob("*.md")),
    *(ROOT / f"{name}.md" for name in ("README", "CHANGELOG", "CONTRIBUTING")),
]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_lines_have_at_most_120_columns_but_in_tables(page):
    lines = enumerate(page.read_text(encoding="utf-8").splitlines(), 1)
    assert not [f"{page.name}:{i}" for i, line in lines if len(line) > 120 and not line.startswith("|")]
