"""Who may import whom: floors without stairs down, and a package whose import changes nothing."""

import ast
import graphlib
import subprocess
import sys

import pytest

from commands import ROOT

FLOORS = [  # a file or folder imports what stands below it, and its own; `agvjax` never imports `tuning`
    ("agvjax", "_pytree", "errors", "hashed", "geometry", "leaves", "integrate"),
    ("agvjax", "messages", "timing"),
    ("agvjax", "protocols"),
    ("agvjax", "decorator", "actuators", "paths", "disturbance"),
    ("agvjax", "plants"),
    ("agvjax", "sensor", "controllers"),
    ("agvjax", "scenario"),
    ("agvjax", "engine"),
    ("agvjax", "simulate", "metrics"),
    ("agvjax", "evaluate", "metric_table"),
    ("agvjax", "check", "feasible"),
    ("agvjax", "draw"),
    ("agvjax", "__init__"),
    ("tuning", "io"),
    ("tuning", "compute"),
    ("tuning", "ensemble"),
    ("tuning", "config"),
    ("tuning", "tune"),
    ("tuning", "sweep", "identify", "export"),
    ("tuning", "studies"),
    ("tuning", "cli"),
    ("tuning", "__init__"),
]
FLOOR = {(package, name): floor for floor, (package, *names) in enumerate(FLOORS) for name in names}
FILES = sorted(p for package in ("agvjax", "tuning") for p in (ROOT / package).rglob("*.py"))


def unit(path):
    """What a file stands for in the table: a file or a folder of its package."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return parts[0], parts[1]


def target(base, name):
    """The file a dotted name under `base` means, or None if it is none of ours."""
    path = base.joinpath(*name.split(".")) if name else base
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if file in FILES:
            return file
    return None


def imports(path):
    """Our own files that a file imports, wherever in it the import stands."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {target(ROOT, alias.name) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = path.parents[node.level - 1] if node.level else ROOT
            home = target(base, node.module or "")
            modules = {target(base, f"{node.module}.{a.name}" if node.module else a.name) for a in node.names}
            found |= modules - {None} or {home}
    return found - {None, path}


def test_every_module_has_a_floor():
    assert {unit(path) for path in FILES} <= set(FLOOR)
    assert set(FLOOR) <= {unit(path) for path in FILES}  # none is listed that is gone


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_no_import_climbs(path):
    climbing = [
        f"{path.relative_to(ROOT)} imports {other.relative_to(ROOT)}"
        for other in sorted(imports(path))
        if FLOOR[unit(other)] > FLOOR[unit(path)]
    ]
    assert not climbing


def test_no_imports_run_in_a_circle():
    graph = {path.relative_to(ROOT): {other.relative_to(ROOT) for other in imports(path)} for path in FILES}
    assert sum(map(len, graph.values())) > 20  # the search finds what there is
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        pytest.fail(" -> ".join(map(str, error.args[1])))


def test_importing_agvjax_changes_nothing():
    program = """
import sys, jax
from jax._src import xla_bridge
before = dict(jax.config.values)
import agvjax
changed = {name for name, value in before.items() if jax.config.values[name] != value}  # jax may add options of its own
assert not changed, changed
assert not jax.config.jax_enable_x64
assert "matplotlib" not in sys.modules, "matplotlib imported"
assert "tuning" not in sys.modules, "tuning imported"
assert not xla_bridge.backends_are_initialized(), "a backend was started"
"""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
