"""What a command says, and the folders that it makes."""

import contextlib

import pytest

from agvjax import Fault, InputError
from tuning.cli.console import Console, RunFailed, failing
from tuning.cli.folders import new_folder
from tuning.config import Config, load


def test_a_quiet_console_prints_nothing(capsys):
    for quiet in (False, True):
        console = Console(quiet)
        console.say("two", "lines")
        console.note("this")
        console.warn("an old name")
        with console.parts(2) as tick:
            tick("first")
        out, err = capsys.readouterr()
        assert out == ("" if quiet else "two\nlines\nnote: this\n")
        assert err == "" if quiet else "note: an old name" in err and "first" in err


@pytest.mark.parametrize(
    ("raised", "arrives"),
    [(RuntimeError("no"), RunFailed), (InputError([Fault("x", 1, "2")]), InputError), (KeyError("x"), KeyError)],
)
def test_a_failure_of_the_run_is_told_from_bad_input_and_from_a_bug(raised, arrives):
    with pytest.raises(arrives), failing():
        raise raised


def test_a_new_folder_holds_the_configuration_or_nothing(tmp_path):
    assert not list(new_folder(str(tmp_path / "empty"), "export").iterdir())
    out = new_folder(str(tmp_path / "empty"), "tune", Config(seed=3))  # an empty one may be used
    assert [path.name for path in out.iterdir()] == ["config.toml"]
    assert load([str(out / "config.toml")]).seed == 3
    with pytest.raises(InputError, match="--resume"):
        new_folder(str(out), "tune")


def test_a_folder_is_named_by_command_and_time(tmp_path):
    with contextlib.chdir(tmp_path):
        out = new_folder(None, "simulate")
        assert out.is_dir() and str(out).startswith("runs/simulate-2")
