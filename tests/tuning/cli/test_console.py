"""What a command says, and the folders that it makes."""

import contextlib
import io
import subprocess
import sys

import pytest

from agvjax import Fault, InputError
from tuning.cli.console import Console, RunFailed, failing
from tuning.cli.folders import new_folder, same_folder
from tuning.config import Config, load
from tuning.io import marks


def test_a_quiet_console_prints_nothing(capsys):
    for quiet in (False, True):
        console = Console(quiet)
        console.say("two", "lines")
        console.note("this")
        console.warn("an old name")
        with console.parts("fitting", 2) as tick:
            tick("first")
        out, err = capsys.readouterr()
        assert out == ("" if quiet else "two\nlines\nnote: this\n")
        assert err == "" if quiet else "note: an old name" in err and "fitting ... 1 parts, 0 s\n" in err


def test_in_a_pipe_each_phase_is_one_line(capsys):
    with Console().phases() as phases:
        phases.begin("compiling")
        for _ in range(3):
            phases.begin("tuning", unit="iterations").advance()
        phases.begin("judging", 4, "runs").advance(1234)
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["compiling ... 0 s", "tuning ... 3 iterations, 0 s", "judging ... 1 234 runs, 0 s"]


def test_a_phase_that_fails_ends_its_line_before_the_error(capsys):
    with pytest.raises(RuntimeError), Console().phases() as phases:
        phases.begin("tuning")
        raise RuntimeError
    assert capsys.readouterr().err == "tuning ... 0 s, stopped\n"


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_bar_promises_a_time_left_only_once_it_can_and_leaves_one_line(monkeypatch):
    monkeypatch.setattr("sys.stderr", Terminal())
    with Console().phases() as phases:
        phase = phases.begin("tuning", 5, "laws")
        for part in ("first", "second", "third"):
            phase.note(part)
            phase.advance()
        phase.note("the end")
    text = sys.stderr.getvalue()
    before, after = text.split("third", 1)
    assert "left" not in before and " left" in after
    assert text.rstrip("\n").split("\r")[-1] == "tuning: 3 laws, 0 s"


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


def test_two_commands_of_one_second_have_two_folders(tmp_path, monkeypatch):
    monkeypatch.setattr("time.strftime", lambda form: "20260101-000000")
    with contextlib.chdir(tmp_path):
        names = [str(new_folder(None, "simulate", Config())) for _ in range(3)]
    assert names == [f"runs/simulate-20260101-000000{more}" for more in ("", "-2", "-3")]


HALF = (".config.toml.elsewhere-1.part", ".config.toml.0123456789ab-1-01234567.part")


@pytest.mark.parametrize("name", HALF)
def test_a_folder_with_nothing_but_files_half_written_is_empty(name, tmp_path):
    (tmp_path / name).write_text("seed = ")
    assert new_folder(str(tmp_path), "tune", Config(seed=3)) == tmp_path
    assert load([str(tmp_path / "config.toml")]).seed == 3


@pytest.mark.parametrize("name", HALF)
def test_a_run_that_was_killed_before_it_wrote_anything_begins_by_resume(name, tmp_path):
    (tmp_path / name).write_text("seed = ")
    assert same_folder(str(tmp_path), "tune", Config(seed=3)) == tmp_path
    assert same_folder(str(tmp_path), "tune", Config(seed=3)) == tmp_path
    with pytest.raises(InputError, match="was `seed = 3`"):
        same_folder(str(tmp_path), "tune", Config(seed=4))


def test_a_folder_in_which_another_process_writes_now_is_not_empty(tmp_path):
    (tmp_path / f".config.toml.{marks.mark()}.part").touch()
    with pytest.raises(InputError, match="not empty"):
        new_folder(str(tmp_path), "tune")


def test_files_half_written_by_a_run_that_was_killed_are_swept_up_when_it_goes_on(tmp_path):
    out = new_folder(str(tmp_path), "tune", Config())
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    place, _, chance = marks.mark().split("-")
    (out / f".checkpoint.npz.{place}-{gone.pid}-{chance}.part").touch()
    same_folder(str(out), "tune", Config())
    assert [path.name for path in out.iterdir()] == ["config.toml"]


@pytest.mark.parametrize("damage", [b"", b"x =", b"\xff", b"seed = 1\nseed = 2", b"a." * 1000 + b"b = 1", b"tune = 3"])
def test_a_damaged_configuration_is_named_when_a_run_is_to_go_on(damage, tmp_path):
    (tmp_path / "config.toml").write_bytes(damage)
    with pytest.raises(InputError, match=r"--resume = .*must be"):
        same_folder(str(tmp_path), "tune", Config())
    assert (tmp_path / "config.toml").read_bytes() == damage
