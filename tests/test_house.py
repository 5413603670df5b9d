"""The house rules that a machine can see: who may import whom, how long things are, and what no code may ask."""

import ast
import graphlib
import re

import pytest

from commands import ROOT, python
from tuning.cli.main import COMMANDS

FLOORS = [  # a file or folder imports what stands below it, and its own; `agvjax` never imports `tuning`
    ("agvjax", "_moved", "_pytree", "errors", "hashed", "host", "geometry", "integrate", "messages"),
    ("agvjax", "schedule", "leaves"),
    ("agvjax", "timing"),
    ("agvjax", "protocols"),
    ("agvjax", "decorator", "actuators", "paths", "disturbance"),
    ("agvjax", "plants"),
    ("agvjax", "sensor", "controllers"),
    ("agvjax", "scenario"),
    ("agvjax", "engine"),
    ("agvjax", "simulate", "gradient", "metrics", "metric_table", "metric_units", "followed"),
    ("agvjax", "evaluate"),
    ("agvjax", "check", "cut", "feasible", "linear", "margins", "readings"),
    ("agvjax", "draw"),
    ("agvjax", "__init__"),
    ("tuning", "io"),
    ("tuning", "compute"),
    ("tuning", "ensemble"),
    ("tuning", "config"),
    ("tuning", "tune"),
    ("tuning", "sweep", "identify", "export"),
    ("tuning", "apply", "watch"),
    ("tuning", "studies"),
    ("tuning", "cli"),
    ("tuning", "__init__"),
]
FLOOR = {(package, name): floor for floor, (package, *names) in enumerate(FLOORS) for name in names}
PACKAGES = [p for package in ("agvjax", "tuning") for p in sorted((ROOT / package).rglob("*.py"))]
FILES = PACKAGES + sorted((ROOT / "benchmarks").rglob("*.py"))
ASKED = {  # where what an object has is asked all the same, and why
    "agvjax/decorator.py": "marks a user's class: looks for methods that a class without a base may have",
    "agvjax/draw/animate.py": "a path or an open file, as `open` and Pillow take them",
    "agvjax/engine/xla.py": "the operating system's: `os.sched_getaffinity` is Linux's alone",
    "tuning/io/logs/ros.py": "messages of classes that a library makes by the definitions of a file",
    "tuning/export/ros2_node/parameters.py": "exported, and runs without this package: a list or an array",
}
each_file = pytest.mark.parametrize("path", PACKAGES, ids=lambda p: str(p.relative_to(ROOT)))


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
    """Our own files that a file imports when it runs, wherever in it the import stands."""
    found, tree = set(), ast.parse(path.read_text())
    typed = [n for n in tree.body if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING"]  # never run
    tree.body = [node for node in tree.body if node not in typed]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {target(ROOT, alias.name) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = path.parents[node.level - 1] if node.level else ROOT
            home = target(base, node.module or "")
            modules = {target(base, f"{node.module}.{a.name}" if node.module else a.name) for a in node.names}
            found |= modules - {None} or {home}
    return found - {None, path}


def circle(graph):
    """The names along a circle of a graph; None without one."""
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return " -> ".join(map(str, error.args[1]))
    return None


def test_every_module_has_a_floor():
    assert {unit(path) for path in PACKAGES} == set(FLOOR)  # none is listed that is gone


@each_file
def test_no_import_climbs(path):
    climbing = [
        f"{path.relative_to(ROOT)} imports {other.relative_to(ROOT)}"
        for other in sorted(imports(path))
        if FLOOR.get(unit(other), 99) > FLOOR[unit(path)]
    ]
    assert not climbing


def test_no_imports_run_in_a_circle_file_by_file():
    graph = {path.relative_to(ROOT): {other.relative_to(ROOT) for other in imports(path)} for path in FILES}
    assert sum(map(len, graph.values())) > 400  # the search finds what there is
    assert circle(graph) is None


def test_no_imports_run_in_a_circle_folder_by_folder():
    """A loose file of a package is a folder of its own; a door, `__init__`, belongs to its folder."""

    def folder(path):
        parts = path.relative_to(ROOT).parts
        return "/".join(parts if len(parts) == 2 else parts[:-1])

    graph = {}
    for path in FILES:
        graph.setdefault(folder(path), set()).update(folder(other) for other in imports(path))
    assert len(graph) > 40
    assert circle({name: others - {name} for name, others in graph.items()}) is None


def test_the_tools_are_few_rooms():
    shown = {path.name for path in (ROOT / "tuning").iterdir() if not path.name.startswith(("__pycache__", "."))}
    assert len(shown) <= 14, sorted(shown)


def test_every_room_has_a_door_of_at_most_five_names():
    doors = [path for path in PACKAGES if path.name == "__init__.py" and path.parent.parent != ROOT]
    rooms = [path for path in doors if "tuning" in path.parts]
    assert len(rooms) > 10
    for path in rooms:
        tree = ast.parse(path.read_text())
        assert ast.get_docstring(tree), path
        names = set()
        for node in tree.body:
            if isinstance(node, ast.ImportFrom) and node.module != "__future__":
                names |= {alias.asname or alias.name for alias in node.names}
            elif isinstance(node, ast.FunctionDef | ast.ClassDef):
                names.add(node.name)
        assert len({name for name in names if not name.startswith("_")}) <= 5, (path, names)


LONG = {  # files that may be longer, and why
    "agvjax/protocols.py": "the contracts stand on one page",
    "tuning/studies/paper/bounds.py": "one proof",
    "tuning/studies/certify/checker.py": "a program of its own, in one file, without the rest",
}


@each_file
def test_no_file_is_long(path):
    home = path.relative_to(ROOT)
    if home.as_posix() in LONG:
        return
    command = home.parent.as_posix() == "tuning/cli" and home.stem in COMMANDS
    assert len(path.read_text().splitlines()) <= (120 if command else 300)


@each_file
def test_a_long_function_says_why(path):
    """Over 40 lines, its docstring among them, it has `# long: reason` on the line of its name or the one above."""
    text = path.read_text()
    lines = text.splitlines()
    silent = [
        f"{node.name}: {node.end_lineno - node.lineno + 1} lines"
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef) and node.end_lineno - node.lineno >= 40
        if not any("# long: " in line for line in lines[node.lineno - 2 : node.body[0].lineno - 1])
    ]
    assert not silent


@each_file
def test_no_object_is_asked_what_it_can_do(path):
    """Contracts have defaults instead: `hasattr`, and `getattr` of a literal with a default, hide what is asked."""
    asked = [
        f"line {node.lineno}: {ast.unparse(node)}"
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        if node.func.id == "hasattr"
        or (node.func.id == "getattr" and len(node.args) == 3 and isinstance(node.args[1], ast.Constant))
    ]
    assert not asked or path.relative_to(ROOT).as_posix() in ASKED, asked


def test_no_exception_is_listed_that_is_gone():
    for name in ASKED:
        assert re.search(r"\b(hasattr|getattr)\(", (ROOT / name).read_text()), name


def test_types_say_what_things_are():
    texts = [path.read_text() for path in PACKAGES]
    assert sum(len(re.findall(r"\bAny\b", text)) for text in texts) < 400
    assert sum(len(re.findall(r"(?:pyright|type): ignore", text)) for text in texts) < 10


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
    python(program, "-W", "error")
