"""`agvjax new`: what it writes can be tuned, is of the numbers that were given, and is not half written."""

import tomllib
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import Sampled
from tuning import config as configuration
from tuning.cli import new
from tuning.cli.main import main
from tuning.cli.questions import BY_CLOCK, KINDS, LAWS, QUESTIONS
from tuning.config import begun
from tuning.config.names import LAWS as LAW_OF
from tuning.tune.rules import faults

RECTANGLE = "x,y\n0,0\n10,0\n10,5\n0,5\n0,0\n"


def problem(*options, out="agv.toml", code=0):
    assert main(["new", "--out", out, *map(str, options)]) == code


def lines(file):
    return [line for line in Path(file).read_text().splitlines() if line.strip() and not line.startswith("#")]


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rectangle.csv").write_text(RECTANGLE)
    return tmp_path


@pytest.fixture(scope="module")
def text(tmp_path_factory):
    home = tmp_path_factory.mktemp("agv")
    (home / "rectangle.csv").write_text(RECTANGLE)
    numbers = ("--rate", 20, "--delay", 0.04, "--deadzone", 0.05, "--acceleration", 0.5)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(home)
        problem("--vehicle", "differential", *numbers, "--path", "rectangle.csv")
    return home / "agv.toml"


@pytest.fixture(scope="module")
def agv(text):
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(text.parent)
        return configuration.load(["agv.toml"], [], faults)


def test_an_agv_is_what_was_said_of_it(agv, text):
    scenario, law = agv.scenario, agv.controller
    assert isinstance(law, Sampled) and law.period == 0.05
    assert isinstance(scenario.plant, agvjax.Base) and scenario.plant.acceleration == 0.5
    for wheel in ("left", "right"):
        assert scenario.deadzone[wheel].threshold_right == scenario.deadzone[wheel].threshold_left == 0.05
        assert scenario.actuators[wheel]["delay"].time == 0.04
    assert len(lines(text)) <= 15


def test_its_path_is_closed_rounded_within_the_tolerance_and_no_faster_than_its_wheels_allow(agv):
    """By points along it: the rectangle's corner is passed at most 0.25 m away, no point lies outside."""
    route = agv.scenario.path
    assert route.closed
    t = jnp.linspace(0, route.lap(), 2000)
    xy = np.asarray(jax.jit(jax.vmap(route))(t))
    corner = np.hypot(*(xy - [10.0, 5.0]).T).min()
    assert 0.2 < corner <= 0.25 + 1e-3
    assert xy.min() >= -1e-4 and np.all(xy.max(0) <= np.array([10, 5]) + 1e-4)
    speed = np.hypot(*np.diff(xy, axis=0).T) / (t[1] - t[0])
    assert speed.max() <= 0.5 + 1e-3
    assert np.abs(np.diff(speed)).max() / (t[1] - t[0]) <= 0.5 + 1e-2  # m/s^2, what it has


def test_a_run_is_the_whole_path_from_its_beginning(agv):
    route, start = agv.scenario.path, agv.scenario.start
    ahead = np.asarray(jax.jit(jax.vmap(route))(jnp.array([0.0, 0.01])))
    np.testing.assert_allclose(start.position, ahead[0], atol=1e-5)
    np.testing.assert_allclose(start.heading, np.arctan2(*(ahead[1] - ahead[0])[::-1]), atol=1e-4)
    assert agv.simulate.horizon > 1.2 * route.lap()
    assert agv.criteria.late < 0.25 * agv.simulate.horizon


def test_it_may_ask_for_a_yaw_rate_that_its_wheels_reach_in_half_a_second_and_its_corners_need(agv):
    """2 x 0.5 m/s^2 over a track of 0.5 m are 2 rad/s^2; corners of 0.6 m at 0.39 m/s need 0.64 rad/s."""
    assert agv.controller.inner.max_angular_velocity == pytest.approx(1.0, abs=0.01)
    numbers = {name: question.default.get("differential", 0.0) for name, question in QUESTIONS.items()}
    slow = begun.problem("differential", {**numbers, "acceleration": 0.1, "corner": 0.25}, "path_pid", None)
    most = tomllib.loads(slow)["controller"]["inner"]["max_angular_velocity"]
    sideways = np.sqrt(0.5 * 0.1 / 1.0)  # rad/s, at half of 0.1 m/s^2 round a radius of 1 m
    assert most == pytest.approx(1.5 * sideways, rel=0.02)


def test_draws_lie_about_the_numbers_that_were_given(agv):
    draws = agv.ensemble.draws
    low, high = draws["deadzone.left.threshold_right"].box(0.05)
    assert 0 < low < 0.05 < high < 0.1
    assert {"actuators.left.delay.time", "plant.time_constant", "start.position"} <= set(draws)
    low, high = draws["start.position"].box(np.asarray(agv.scenario.start.position))
    np.testing.assert_allclose(high - low, [0.0, 0.4], atol=1e-9)  # across the path, which begins along x


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_vehicle_can_be_tuned(kind, here):
    problem("--vehicle", kind, "--delay", 0.1)
    config = configuration.load(["agv.toml"], [], faults)
    assert config.controller.control_period() == 1 / QUESTIONS["rate"].default[kind]
    assert (config.controller.follows()) == (kind not in BY_CLOCK)
    delays = [chain["delay"].time for chain in config.scenario.actuators.values()]
    assert delays == [0.1, 0.1]


@pytest.mark.parametrize("law", LAWS)
def test_every_law_can_be_tuned(law):
    numbers = {name: question.default.get("differential", 0.0) for name, question in QUESTIONS.items()}
    text = begun.problem("differential", {**numbers, "rate": 30, "uncertainty": 0.2}, law, None, within=0.05)
    config = configuration.load([], [], faults, more=tomllib.loads(text))
    assert type(config.controller.inner) is LAW_OF[law]
    assert config.tune.limits["cross_track_peak_late"].worst == 0.05
    low, high = config.ensemble.draws["deadzone.left.threshold_right"].box(1.0)
    assert high - low == pytest.approx(0.24)


def test_an_open_curve_of_other_columns_with_speeds(here):
    x = np.linspace(0, 6, 25)
    rows = [f"{a:.4f},{b:.4f},0.4" for a, b in zip(x, np.sin(x / 2), strict=True)]
    (here / "curve.csv").write_text("# x_m,y_m,vx_mps\n" + "\n".join(rows) + "\n")
    found = begun.points("curve.csv")
    assert found.speeds and not found.closed and not found.cornered
    problem("--vehicle", "twist", "--path", "curve.csv")
    said = []
    route = configuration.load(["agv.toml"], [], faults, note=said.append).scenario.path
    assert said == ["curve.csv: x is x_m; y is y_m; speed is vx_mps"]
    assert not route.closed
    assert np.asarray(route.squares)[0].max() <= 0.4**2 + 1e-9


def test_what_is_there_is_not_overwritten(here, capsys):
    (here / "agv.toml").write_text("mine = 1\n")
    problem("--vehicle", "twist", code=2)
    assert (here / "agv.toml").read_text() == "mine = 1\n" and "a new file" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "--vehicle"),
        (("--vehicle", "differential", "--rate", -1, "--delay", 9), "--rate = -1.0: must be a number > 0"),
        (("--vehicle", "twist", "--wheelbase", 1), "--wheelbase = 1.0: must be left out for twist"),
        (("--vehicle", "car", "--path", "rectangle.csv"), "goes by the clock"),
        (("--vehicle", "twist", "--path", "none.csv"), "a CSV file with the columns x, y"),
    ],
)
def test_bad_input_is_named_and_nothing_is_written(options, words, here, capsys):
    problem(*options, code=2)
    assert words in capsys.readouterr().err
    assert [path.name for path in here.iterdir()] == ["rectangle.csv"]


def test_what_was_not_given_is_asked_for_on_a_terminal(here, monkeypatch, capsys):
    said = iter(["boat", "forklift", "ten", "10", "", "", "", "", "0.4", "rectangle.csv"])
    monkeypatch.setattr("builtins.input", lambda words: next(said))
    monkeypatch.setattr(new, "interactive", lambda: True)
    problem("--corner", 1.0)
    config = configuration.load(["agv.toml"], [], faults)
    assert config.controller.period == 0.1 and config.scenario.plant.behind and config.scenario.path.closed
    assert next(said, None) is None
    told = capsys.readouterr().out
    assert "one of differential" in told and "must be a number > 0" in told


def test_what_was_not_given_is_said_where_nobody_can_be_asked(here, capsys):
    problem("--vehicle", "ackermann", "--wheelbase", 2)
    told = capsys.readouterr().out
    slope = agvjax.Ackermann().deadzones()["speed"].slope_right
    assert f"delivers {slope:g} of what is left (slope_right" in told
    assert f"{slope:g} arrives, as assumed" in Path("agv.toml").read_text()
    assert "--steering-deadzone 0.0175 rad" in told and "--wheelbase" not in told.split("written")[0]


@pytest.mark.parametrize("answers", [[], ["differential"], ["differential", *[""] * 5]])
def test_the_end_of_the_answers_is_an_interrupt_and_leaves_nothing(answers, here, monkeypatch, capsys):
    said = iter(answers)

    def line(words):
        try:
            return next(said)
        except StopIteration:
            raise EOFError from None

    monkeypatch.setattr("builtins.input", line)
    monkeypatch.setattr(new, "interactive", lambda: True)
    problem(code=130)
    assert capsys.readouterr().err == "agvjax new: interrupted\n" and not Path("agv.toml").exists()
