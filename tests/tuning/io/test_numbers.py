"""Numbers in text: those that every program reads alike, and no others."""

import pytest

from tuning.cli.main import main
from tuning.io.numbers import integer, real


@pytest.mark.parametrize(("text", "value"), [("1", 1), ("-1.5e3", -1500), (" .5 ", 0.5), ("+2.", 2), ("1E-2", 0.01)])
def test_what_a_number_is(text, value):
    assert real(text) == value


@pytest.mark.parametrize("text", ["1_0", "\u0661", "nan", "inf", "", ".", "1e", "0x1", "1,5", "1 0", "\uff11"])
def test_what_none_is(text):
    with pytest.raises(ValueError, match="is no number"):
        real(text)
    with pytest.raises(ValueError, match="is no whole number"):
        integer(text)


@pytest.mark.parametrize("option", [("--seed", "1_0"), ("--seed", "\u0661"), ("--index", "1_0")])
def test_options_take_no_others(option, capsys):
    with pytest.raises(SystemExit) as end:
        main(["simulate", *option])
    assert end.value.code == 2 and option[1] in capsys.readouterr().err


@pytest.mark.parametrize("axis", ["1_0:20:3", "1:\u0662:3", "1:2:1_1", "1_0,20"])
def test_axes_take_no_others(axis, tmp_path, capsys):
    over = f"controller.k1={axis}"
    assert main(["sweep", "--over", over, "--out", str(tmp_path / "out"), "--quiet"]) == 2
    assert f"--over = {over}" in capsys.readouterr().err
