"""What a command has imported by when: libraries that it does not need yet are what a user would wait for."""

import pytest

from commands import FAST, SHORT_TUNE, arguments, python, run
from tuning.cli.main import COMMANDS

SLOW = ("scipy", "matplotlib", "optax", "pandas", "bokeh", "cma", "control", "mujoco", "PIL", "SALib", "xarray")
LOADED = f"[name for name in {SLOW} if name in sys.modules]"
NO_JAX = f"""
import sys, tuning.cli.main
tuning.cli.main.parser()
print([name for name in ("jax", "numpy", *{SLOW}) if name in sys.modules])
"""
EACH_COMMAND = f"""
import importlib, sys
from tuning.cli.main import COMMANDS
for command in COMMANDS:
    importlib.import_module("tuning.cli." + command)
    print(command, {LOADED})
"""
FIRST_ITERATION = f"""
import os, sys
from tuning.cli.main import main
from tuning.tune.checkpoint import Recorder
def record(recorder, run):
    print({LOADED}, len(run.history), file=sys.stderr, flush=True)
    os._exit(0)  # with threads that compile
Recorder.record = record
main(sys.argv[1:])
"""
FIRST_FIGURE = f"""
import sys
from tuning.cli import simulate
from tuning.cli.main import main
def draw(out, drawings):
    print({LOADED}, len(drawings))
    return []
simulate.write_figures = draw
main(sys.argv[1:])
"""


@pytest.mark.slow
def test_a_process_that_jax_has_started_is_as_quiet_as_any_other():
    """JAX sets the level to 1 for itself, and children inherit it: of each program kept they then print kilobytes."""
    level = "import os, tuning.cli.main as m; m.main(['explain', 'seed']); print(os.environ['TF_CPP_MIN_LOG_LEVEL'])"
    for given, wanted in (("1", "3"), ("0", "0"), ("2", "2")):
        assert python(level, TF_CPP_MIN_LOG_LEVEL=given).splitlines()[-1] == wanted


def test_help_needs_neither_jax_nor_numpy():
    assert python(NO_JAX) == "[]\n"


def test_commands_begin_without_slow_libraries():
    assert python(EACH_COMMAND).splitlines() == [f"{command} []" for command in COMMANDS]


@pytest.mark.slow
def test_a_vehicle_is_simulated_before_anything_is_imported_that_draws(tmp_path):
    said = python(FIRST_FIGURE.replace("sys.argv[1:]", repr(arguments("simulate", tmp_path / "out", FAST))))
    assert "[] 3" in said.splitlines()


@pytest.mark.slow
def test_a_search_has_taken_its_first_step_before_slow_libraries_are_imported(tmp_path):
    small = [s for s in SHORT_TUNE if not s.startswith(("tune.optimizer", "tune.screen"))]
    small += ["tune.screen=32", "ensemble.size=4", *FAST]
    program = FIRST_ITERATION.replace("sys.argv[1:]", repr(arguments("tune", tmp_path / "out", small)))
    _, err = run([], program=("-c", program))
    assert err.endswith("[] 1\n")
