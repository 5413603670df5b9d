"""`agvjax watch`: a rank among simulated logs, what a log can show, and what is said of it."""

import csv
import json

import numpy as np
import pytest

import agvjax
from tuning import config as configuration
from tuning.cli.main import main
from tuning.identify.parameters import Parameter
from tuning.watch import page
from tuning.watch.residuals import Slopes, steps
from tuning.watch.rules import faults, watched
from tuning.watch.run import (
    Number,
    Watched,
    allowed,
    critical,
    distance_of,
    least_seen,
    of_ensemble,
    reached,
    sizes,
)

NONE = np.zeros(0)


def slopes(columns, weight, prior=0.0):
    """Of stretches whose residual is a number of times each column (S, K, P), all of one channel."""
    weighed = columns * weight[..., None]
    information = np.einsum("skp,skq->pq", weighed, weighed) + prior * np.eye(columns.shape[-1])
    empty = np.zeros((*weight.shape, 1))
    return Slopes(weighed, weight[..., None], information, np.full(len(information), prior), empty, empty)


def test_numbers_seem_to_have_moved_by_what_least_squares_says():
    random = np.random.default_rng(0)
    columns, weight = random.normal(size=(5, 40, 3)), random.uniform(0.5, 2.0, (5, 40))
    residual = random.normal(size=(5, 40))
    best, *_ = np.linalg.lstsq(
        (columns * weight[..., None]).reshape(-1, 3), (residual * weight).reshape(-1), rcond=None
    )
    moved = slopes(columns, weight).moved(residual[None, ..., None])
    np.testing.assert_allclose(moved, -best[None], rtol=1e-10)  # residuals fall by what a number explains


@pytest.mark.parametrize("lasting", [0.0, 0.95])
def test_a_false_alarm_is_as_rare_as_asked_for_whatever_the_noise(lasting):
    """600 logs of 12 stretches whose noise lasts within each; an alarm for 1 in 10: 60, deviation 7.3."""
    random, size, n = np.random.default_rng(1), 4, 99
    columns = random.normal(size=(12, 30, size)).cumsum(axis=1)
    seen = slopes(columns, np.ones((12, 30)))
    mix = lasting ** np.abs(np.subtract.outer(np.arange(30), np.arange(30))) if lasting else np.eye(30)
    factor = np.linalg.cholesky(mix)
    alarms = 0
    for _ in range(600):
        noise = random.normal(size=(12, 30)) @ factor.T
        vehicles = 0.05 * random.normal(size=(n + 1, size))
        own = -columns @ vehicles[0] + noise
        signs = random.choice([-1.0, 1.0], (n, 12, 1))
        others = -np.einsum("skp,np->nsk", columns, vehicles[1:]) + signs * noise[None]
        W = np.linalg.inv(np.linalg.inv(seen.information) + 0.05**2 * np.eye(size))
        far = distance_of(seen.moved(np.concatenate([own[None], others])[..., None]), W)
        alarms += (1 + np.sum(far[1:] >= far[0])) / (n + 1) <= 0.1
    assert 38 < alarms < 82


def test_the_alarm_begins_where_the_rank_says():
    """Of 199 others and an alarm for 1 in 100 the second largest must be passed: a rank of 2 in 200."""
    far = np.arange(199.0)
    assert critical(far, 0.01) == 197
    assert critical(far, 0.005) == 198
    assert (1 + np.sum(far >= 197.5)) / 200 <= 0.01 < (1 + np.sum(far >= 196.5)) / 200


def test_the_least_change_that_is_seen_is_that_of_a_normal_distribution():
    """One number with noise 1, an alarm beyond 2.576: 9 of 10 alarms from 2.576 + 1.282 on."""
    others = np.random.default_rng(2).normal(size=(200_000, 1))
    found = least_seen(others, np.eye(1), np.ones(1), 0.5, 2.576**2)
    assert found == pytest.approx(2.576 + 1.282, rel=0.01)
    assert least_seen(others[:100], 1e-12 * np.eye(1), np.ones(1), 0.5, 2.576**2) == np.inf
    assert least_seen(others, np.eye(1), np.zeros(1), 0.5, 2.576**2) == np.inf  # what a log does not pass on


def test_a_residual_one_step_ahead_is_what_the_next_measurement_adds():
    """Of 0, 1, 3, -, 6 with one that is missing: 1, 2 and 3."""
    residual = np.array([0.0, 1.0, 3.0, 99.0, 6.0]).reshape(1, 1, 5, 1)
    weight = np.array([1.0, 1.0, 1.0, 0.0, 1.0]).reshape(1, 5, 1)
    np.testing.assert_allclose(steps(residual, weight), [[np.sqrt((1 + 4 + 9) / 3)]])


def base(*settings):
    return configuration.load(["base"], ["identify.memory=0.3", *settings], faults)


def test_what_is_watched_is_of_the_vehicle_and_there():
    """No phase, no push, and no delay of an actuator that has none; what is drawn besides is."""
    names = set(watched(base()))
    assert {"deadzone.left.threshold_right", "actuators.left.delay.time", "plant.track", "plant.drift"} <= names
    assert not [name for name in names if name.startswith(("disturbance", "start", "sensor"))]
    assert "plant.left" not in names
    drawn_too = watched(base('ensemble.draws."plant.left"={times=[0.9,1.1]}'))
    assert "plant.left" in drawn_too
    assert "actuators.left.delay.time" in watched(base('identify.fit=["delay"]'))


def test_vehicles_for_which_gains_count_as_tuned_are_a_little_about_those_of_the_ensemble():
    config = base("watch.logs=500")
    track = Parameter("plant.track", "m", 0.5, 0.01, 10.0, 0.5, 0.0)
    fixed = Parameter("plant.acceleration_of_none", "1", 2.0, 0.0, 10.0, 1.0, 0.0)
    small = Parameter("nought", "1", 0.0, -1.0, 1.0, 1.0, 0.006)
    drawn = np.column_stack([np.linspace(0.4, 0.6, 600), np.full(600, 2.0), np.zeros(600)])
    about = allowed(config, (track, fixed, small), drawn) - drawn
    assert 0.9 * 0.01 < np.abs(about[:, 0]).max() <= 0.01  # 2 % of .5 m
    assert -0.04 <= about[:, 1].min() < -0.038 and 0.038 < about[:, 1].max() <= 0.04  # 2 % of 2
    assert 0.9 * 0.02 * 0.006 < np.abs(about[:, 2]).max() <= 0.02 * 0.006
    np.testing.assert_allclose(sizes((track, fixed, small)), [0.5, 2.0, 0.006])


def test_the_vehicles_are_those_of_the_ensemble_and_a_number_without_draws_is_the_scenarios():
    config = base("watch.logs=500", 'ensemble.draws."plant.track"={between=[0.4,0.6]}', "scenario.plant.left=0.3")
    track = Parameter("plant.track", "m", 0.5, 0.01, 10.0, 0.5, 0.0)
    sensor = Parameter("plant.left", "m", 0.0, -5.0, 5.0, 0.1, 0.005)
    whole = of_ensemble(config, (track, sensor))
    assert whole.shape == (600, 2)  # and a hundred by which distances are measured
    assert 0.4 <= whole[:, 0].min() < 0.405 and 0.595 < whole[:, 0].max() <= 0.6
    assert (whole[:, 1] == 0.3).all()


def test_a_number_that_the_log_cannot_reach_is_not_watched():
    """A threshold of .06 in a log whose commands end at .05: there it is looked for up to .05 only."""
    config = base()
    wide = Parameter("deadzone.left.threshold_right", "m/s", 0.06, 0.0, 0.5, 0.1, 0.005)
    cut = wide._replace(nominal=0.05, high=0.05)
    tuned = np.full(600, 0.06)
    assert reached(config, wide, tuned) and not reached(config, cut, tuned)
    assert not reached(config, wide._replace(high=0.065), np.linspace(0.05, 0.07, 600))
    late = Parameter("actuators.left.delay.time", "s", 3e-5, 0.0, 0.3, 0.1, 0.01)  # none is assumed, looked for near 0
    assert reached(base("scenario.actuators.left.delay.time=0.0"), late, np.zeros(600))


def number(name, seen, wanted, explains=0.1, tuned=0.06):
    return Number(name, "m/s", tuned, 0.08, explains, seen, wanted, 0.001)


def found(alarm, *numbers, rank=0.3):
    return Watched(None, rank, 1.0, np.ones(199), alarm, numbers, NONE, np.zeros((199, 0)))


def test_an_alarm_names_what_explains_it_best_and_what_nearly_as_well():
    told = found(True, number("a", 0.01, 0.02, 0.5), number("b", 0.01, 0.02, 0.9), number("c", 0.01, 0.02, 0.8))
    assert [one.name for one in told.moved] == ["b", "c"]
    text = page.verdict(base(), told)
    assert text.startswith("**No longer tuned") and "b (tuned for 0.06, now about 0.08 m/s); c" in text


def test_a_log_that_would_show_nothing_says_nothing():
    quiet = found(False, number("deadzone.left.threshold_right", 0.1, 0.02), number("plant.track", np.inf, 0.15))
    assert not quiet.told
    text = page.verdict(base(), quiet)
    assert "Cannot be told" in text and "positive commands of left" in text


def test_still_tuned_says_what_it_did_not_see():
    text = page.verdict(base(), found(False, number("plant.drift", 0.001, 0.005), number("plant.track", 0.3, 0.15)))
    assert "Still tuned" in text and "1 of 2 numbers" in text and "plant.track" in text


def test_the_table_says_in_words_what_a_log_cannot_show():
    assert page._least(number("a", np.inf, 0.02)) == "none: the log says nothing of it"
    assert page._least(number("a", 0.03, 0.02)) == "0.03, more than it should"
    assert page._least(number("a", 0.01, 0.02)) == "0.01"


def test_too_few_logs_to_be_that_sure_are_no_setting():
    with pytest.raises(agvjax.InputError, match=r"watch\.logs = 98.*at least 99"):
        base("watch.logs=98")


def test_a_log_that_is_not_there_is_bad_input_and_leaves_nothing(tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["watch", str(tmp_path / "none.csv"), "--config", "base", "--out", str(out), "--quiet"]) == 2
    assert "none.csv" in capsys.readouterr().err and not out.exists()


def test_a_number_is_told_as_far_as_the_log_outweighs_what_is_believed():
    """One column of 100 ones and a belief of 300: a quarter is the log's, and of a move of 1 it passes on a quarter."""
    seen = slopes(np.ones((1, 100, 1)), np.ones((1, 100)), prior=300.0)
    np.testing.assert_allclose(seen.told(), [0.25])
    np.testing.assert_allclose(seen.passed(), [[0.25]])
    np.testing.assert_allclose(seen.moved(-np.ones((1, 1, 100, 1))), [[0.25]])


@pytest.mark.slow
def test_of_a_log_within_the_deadzone_alone_nothing_is_said(tmp_path, capsys):
    """Thresholds cannot be searched for there, and slopes do nothing: no number is left."""
    random, rows = np.random.default_rng(0), []
    for i in range(1000):
        rows.append([i * 0.02, *random.normal(0, 2e-3, 3), 0.03, 0.0])
    with (tmp_path / "still.csv").open("w", newline="") as stream:
        csv.writer(stream).writerows([["t", "x", "y", "heading", "cmd_v", "cmd_w"], *rows])
    (tmp_path / "base.toml").write_text('[scenario.plant]\ntype = "base"\n[ensemble]\nsize = 8\n')
    argv = [
        "watch",
        str(tmp_path / "still.csv"),
        "--config",
        str(tmp_path / "base.toml"),
        "--fit",
        "deadzone",
        "--quiet",
    ]
    more = ["--set", "watch.logs=99", "--set", "identify.memory=0.3", "--out", str(tmp_path / "out")]
    assert main([*argv, *more]) == 2
    assert "a log that says something of the numbers that are watched" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# ---- robots


def robot(folder, seed, rows=2000, **changed):
    """A base by hand at 50 Hz, held levels, every third small; noise of the pose lasts from row to row."""
    number = {"track": 0.5, "lag": 0.15, "late": 4, "right": 0.06, "left": 0.06, "drift": 0.0} | changed
    number = {"slope_left": 0.95, "slope_right": 0.95} | number
    random, h = np.random.default_rng(seed), 0.002
    levels = random.uniform([-0.7, -1.0], [0.8, 1.0], (rows // 40 + 1, 2))
    levels[::3] *= 0.25
    sent = np.repeat(levels, 40, axis=0)[:rows]
    x = y = psi = left = right = 0.0
    table, wander = np.empty((rows, 6)), np.zeros(3)
    for i in range(rows):
        wander = 0.6 * wander + random.normal(0, [1.6e-3, 1.6e-3, 1.2e-3])
        table[i] = (i * 0.02, x + wander[0], y + wander[1], psi + wander[2], *sent[i])
        v, w = sent[i - number["late"]] if i >= number["late"] else (0.0, 0.0)
        goals = [number[f"slope_{side}"] * np.sign(u) * max(abs(u) - number[side], 0.0) for side, u in
                 (("left", v - 0.25 * w), ("right", v + 0.25 * w))]  # fmt: skip
        for _ in range(10):
            speed, spin = (left + right) / 2, (right - left) / number["track"] + number["drift"]
            x, y, psi = x + h * speed * np.cos(psi), y + h * speed * np.sin(psi), psi + h * spin
            left, right = left + h * (goals[0] - left) / number["lag"], right + h * (goals[1] - right) / number["lag"]
    file = folder / f"{seed}.csv"
    with file.open("w", newline="") as stream:
        csv.writer(stream).writerows([["t", "x", "y", "heading", "cmd_v", "cmd_w"], *table.tolist()])
    return str(file)


TUNED_FOR = {  # as an identified log leaves it
    **{f"deadzone.{side}.threshold_{way}": 0.001 for side in ("left", "right") for way in ("left", "right")},
    **{f"deadzone.{side}.slope_{way}": 0.004 for side in ("left", "right") for way in ("left", "right")},
    **{f"actuators.{side}.delay.time": 0.002 for side in ("left", "right")},
    "plant.track": 0.003,
    "plant.time_constant": 0.004,
    "plant.drift": 0.001,
    "plant.acceleration": 1.0,
}


@pytest.fixture
def tuned(tmp_path):
    """A configuration of gains that were tuned for such a robot; the motors have no limit that is met."""
    lines = ["[scenario.plant]", 'type = "base"', "acceleration = 1000.0", "[identify]", "memory = 0.3"]
    lines += ['fit = ["deadzone", "delay", "plant.track", "plant.time_constant", "plant.drift"]', "[ensemble.draws]"]
    lines += [f'"{name}" = {{ plus = [{-by}, {by}] }}' for name, by in TUNED_FOR.items()]
    (tmp_path / "tuned.toml").write_text("\n".join(lines) + "\n")
    return ["--config", "base", "--config", str(tmp_path / "tuned.toml"), "--quiet"]


def said(tmp_path, tuned, log, *more):
    out = tmp_path / f"out-{len(list(tmp_path.iterdir()))}"
    code = main(["watch", log, *tuned, "--out", str(out), *more])
    return code, json.loads((out / "watch.json").read_text())


def unchanged(seed):
    """One of the robots that the gains were tuned for, drawn."""
    about = np.random.default_rng(seed).uniform(-1, 1, 7)
    names = {"track": 0.003, "lag": 0.004, "right": 0.001, "left": 0.001, "drift": 0.001}
    names |= {"slope_left": 0.004, "slope_right": 0.004}
    middle = {"track": 0.5, "lag": 0.15, "right": 0.06, "left": 0.06, "drift": 0.0}
    middle |= {"slope_left": 0.95, "slope_right": 0.95}
    return {name: middle[name] + by * share for (name, by), share in zip(names.items(), about, strict=True)}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changed", "name"),
    [
        ({"right": 0.078}, "deadzone.right.threshold"),
        ({"lag": 0.3}, "plant.time_constant"),
        ({"track": 0.575}, "plant.track"),
        ({"late": 7}, "delay"),
    ],
)
def test_a_robot_that_has_changed_raises_the_alarm_by_the_number_that_moved(changed, name, tmp_path, tuned):
    code, told = said(tmp_path, tuned, robot(tmp_path, 5, **changed))
    assert code == 1 and told["verdict"] == "no longer tuned" and name in told["moved"][0]


@pytest.mark.slow
def test_robots_that_have_not_changed_raise_no_more_alarms_than_said(tmp_path, tuned):
    """20 logs, an alarm for 1 in 10: more than 5 come to pass once in 100 times; with nothing allowed beside."""
    more = ["--set", "watch.false_alarms=0.1", "--set", "watch.logs=99", "--set", "watch.allowed=0"]
    alarms = [said(tmp_path, tuned, robot(tmp_path, 100 + i, **unchanged(i)), *more) for i in range(20)]
    print("ranks:", sorted(round(told["rank"], 2) for _, told in alarms))
    assert sum(code for code, _ in alarms) <= 5


@pytest.mark.slow
def test_a_robot_that_stands_still_tells_nothing(tmp_path, tuned):
    file = tmp_path / "still.csv"
    random, rows = np.random.default_rng(0), []
    for i in range(1000):
        rows.append([i * 0.02, *random.normal(0, 2e-3, 3), 0.03, 0.0])  # below every threshold
    with file.open("w", newline="") as stream:
        csv.writer(stream).writerows([["t", "x", "y", "heading", "cmd_v", "cmd_w"], *rows])
    code, told = said(tmp_path, tuned, str(file))
    assert code == 1 and told["verdict"] == "cannot be told"
