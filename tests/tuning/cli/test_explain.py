"""`agvjax explain` and `agvjax completion`."""

import shutil
import subprocess

import pytest

from tuning.cli.main import COMMANDS, EXIT_CODES, main


def said(capsys, *keys, code=0):
    assert main(["explain", *keys]) == code
    streams = capsys.readouterr()
    return streams.err if code else streams.out


def test_a_setting_is_told_with_kind_unit_default_rule_and_page(capsys):
    text = said(capsys, "simulate.dt")
    for words in ("length of a step", "a number [s]", "default: 0.001", "must be > 0", "docs/configuration.md"):
        assert words in text


def test_a_table_lists_its_keys(capsys):
    text = said(capsys, "tune.search")
    for name in ("rounds", "starts", "iterations", "scouts", "checks", "tolerance"):
        assert f"tune.search.{name}" in text
    assert "tune.penalty" not in text


def test_a_large_table_lists_its_next_level(capsys):
    text = said(capsys, "scenario")
    assert "\nscenario.path" in text and "scenario.path.type" not in text


def test_a_draw_tells_what_is_drawn(capsys):
    text = said(capsys, 'ensemble.draws."deadzone.left.threshold_right"')
    assert "how a leaf of the scenario is drawn" in text and "nothing is delivered" in text


def test_metrics_commands_and_exit_codes_are_told(capsys):
    text = said(capsys, "cross_track", "delay_margin", "export", *map(str, EXIT_CODES))
    assert "a metric [m]" in text and "only if the path is a route" in text
    assert "for tune.limits;" in text  # a margin is no goal
    assert COMMANDS["export"].help in text
    for words in EXIT_CODES.values():
        assert words in text


def test_a_name_of_both_a_command_and_a_table_is_told_as_both(capsys):
    text = said(capsys, "sweep")
    assert "agvjax sweep --help" in text and "sweep.samples" in text


def test_a_gain_is_told_by_the_name_that_a_report_has_for_it(capsys):
    """`inner.ahead` stands in tables; the key is controller.inner.ahead."""
    text = said(capsys, "inner.ahead")
    assert "controller.inner.ahead" in text and "how early the route's curvature is used" in text
    text = said(capsys, "ahead")
    assert "controller.inner.ahead" in text and "identify.ahead" in text


def test_unknown_keys_are_all_refused_and_nothing_is_told(capsys):
    assert main(["explain", "tune.dt", "tune.penalti", "nothing-of-the-kind"]) == 2
    streams = capsys.readouterr()
    assert streams.out == ""
    assert "did you mean tune.penalty?" in streams.err and "nothing-of-the-kind" in streams.err


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    file = tmp_path_factory.mktemp("completion") / "agvjax.bash"
    with pytest.MonkeyPatch.context() as patch, open(file, "w") as out:
        patch.setattr("sys.stdout", out)
        assert main(["completion", "bash"]) == 0
    return file


def completed(script, *words):
    """What bash would offer for the last word, once it has read the script."""
    line = " ".join(f"'{word}'" for word in ("agvjax", *words))
    program = f"""source '{script}'
COMP_WORDS=({line}); COMP_CWORD={len(words)}
entry=$(complete -p agvjax); function=${{entry#*-F }}; function=${{function%% *}}
"$function" agvjax '{words[-1]}' ''
printf '%s\\n' "${{COMPREPLY[@]}}"
"""
    run = subprocess.run(["bash", "--norc", "-c", program], capture_output=True, text=True, timeout=20)
    assert run.returncode == 0, run.stderr
    return {word.strip() for word in run.stdout.split()}


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
def test_bash_completes_commands_options_and_choices(script):
    assert completed(script, "tu") == {"tune"}
    assert set(COMMANDS) <= completed(script, "")
    assert "--resume" in completed(script, "tune", "--re")
    assert "--over" not in completed(script, "tune", "--")  # that is of sweep
    assert completed(script, "new", "--vehicle", "fork") == {"forklift"}


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_each_shell_has_a_script_that_knows_every_command(shell, capsys):
    assert main(["completion", shell]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in COMMANDS)
    if shutil.which(shell):
        assert subprocess.run([shell, "-n"], input=text, text=True, timeout=20).returncode == 0
