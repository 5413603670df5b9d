"""`agvjax tune --params`: gains from a Nav2 parameter file, and back into it with nothing else changed."""

import difflib

import pytest

import agvjax
from commands import ROOT
from tuning.cli.main import main, parser
from tuning.cli.nav2_file import TUNED, ParameterFile
from tuning.config.load import load

COURIER = ROOT / "tests" / "data" / "nav2" / "courier.yaml"
FLEET = ROOT / "tests" / "data" / "nav2" / "fleet.yaml"


def given(*options):
    found = ParameterFile.given(parser().parse_args(["tune", *map(str, options)]))
    assert found is not None
    return found


def test_the_file_sets_law_and_clock_and_names_what_means_nothing():
    found = given("--params", COURIER)
    config = load(["base"], [], more=found.settings())
    text = COURIER.read_text()
    assert f"controller_frequency: {1 / float(config.controller.period):.1f}" in text
    assert f"lookahead_time: {float(config.controller.inner.lookahead_time):g}" in text
    said = "\n".join(found.lines())
    assert "use_collision_detection: There are no obstacles" in said and "lookahead_distance: Nav2 has no" in said


def test_the_tuned_file_differs_in_the_tuned_values_alone(tmp_path):
    found = given("--params", COURIER)
    config = load(["base"], ['tune.gains=["inner.lookahead_time"]'], more=found.settings())
    tuned = agvjax.replace(config.controller, {"inner.lookahead_time": 1.0625})
    report = found.write(tuned, config, tmp_path)
    before, after = COURIER.read_text().splitlines(), (tmp_path / TUNED).read_text().splitlines()
    changed = [line for line in difflib.ndiff(before, after) if line[0] in "+-"]
    assert len(changed) == 2 and "lookahead_time: 1.0625" in changed[1] and "lookahead_time" in changed[0]
    assert "+" + changed[1][2:] in report


def test_a_largest_look_ahead_tuned_below_the_least_takes_it_along(tmp_path):
    """Nav2 does not say what it does where they lie the wrong way round."""
    found = given("--params", COURIER)
    config = load(["base"], ['tune.gains=["inner.max_lookahead_dist"]'], more=found.settings())
    assert config.controller.inner.use_velocity_scaled_lookahead_dist
    tuned = agvjax.replace(config.controller, {"inner.max_lookahead_dist": 0.125}).canonical()
    found.write(tuned, config, tmp_path)
    text = (tmp_path / TUNED).read_text()
    assert text.count("min_lookahead_dist:  0.125") == text.count("max_lookahead_dist:  0.125") == 1


@pytest.mark.parametrize(
    "options, words",
    [
        (["--params", "none.yaml"], ("none.yaml",)),
        (["--params", FLEET], ("--controller", "FollowPath")),
        (["--params", COURIER, "--controller", "Other"], ("Other",)),
        (["--controller", "FollowPath"], ("--controller", "--params")),
    ],
)
def test_a_file_that_cannot_be_used_is_said_with_exit_code_2(options, words, capsys, tmp_path):
    assert main(["tune", "--out", str(tmp_path / "out"), *map(str, options)]) == 2
    said = capsys.readouterr().err
    assert all(word in said for word in words) and "Traceback" not in said, said
    assert not (tmp_path / "out").exists()
