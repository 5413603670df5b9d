"""What numbers are good for, in one sentence; and the plain models that a fit must do better than."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import agvjax
from tuning.config import load
from tuning.identify import figures, page
from tuning.identify.conclusion import conclude
from tuning.identify.coverage import Covered, beyond, covered
from tuning.identify.left import GOES, NOTHING, TURNS, Change, Left
from tuning.identify.log import Log
from tuning.identify.plain import AT_ONCE, LAGGING, driven, led, plain_models
from tuning.identify.predict import Prediction
from tuning.identify.verdict import Estimate, FitVerdict

STEP = 0.05


def drive(seed, lag=(0.6, 0.3), gain=(0.9, 0.7), lever=0.0, noise=0.01, rows=800, plant=None):
    """A body by hand: speed and yaw rate lag behind what is sent, levels held for 2 s; SciPy integrates."""
    rng = np.random.default_rng(seed)
    twist = np.repeat(rng.uniform([-0.8, -0.9], [1.0, 0.9], (rows // 40 + 1, 2)), 40, axis=0)[:rows]

    def rate(t, s, u):
        return [s[3] * np.cos(s[2]), s[3] * np.sin(s[2]), s[4], *((np.array(gain) * u - s[3:]) / lag)]

    states = [np.zeros(5)]
    for u in twist[:-1]:
        states.append(solve_ivp(rate, (0, STEP), states[-1], args=(u,), rtol=1e-8, atol=1e-10).y[:, -1])
    x, y, psi = np.array(states)[:, :3].T
    seen = {"x": x + lever * np.cos(psi), "y": y + lever * np.sin(psi), "heading": psi}
    seen = {name: value + noise * rng.standard_normal(rows) for name, value in seen.items()}
    left, right = twist[:, 0] - 0.25 * twist[:, 1], twist[:, 0] + 0.25 * twist[:, 1]
    return Log(f"drive{seed}", 0.0, STEP * np.arange(rows), np.column_stack([left, right]), ("left", "right"), seen)


# ---- plain models


def test_a_plain_model_finds_a_lag_and_a_gain():
    """Of a base with wheels 0.5 m apart, for which its drives were sent."""
    at_once, lagging = plain_models(agvjax.Base(track=0.5), [drive(1), drive(2)])
    assert (at_once.name, lagging.name) == (AT_ONCE, LAGGING) and not at_once.lags.any()
    np.testing.assert_allclose(lagging.lags[[0, 2]], [0.6, 0.3], rtol=0.15)  # the next lags tried are 26 % apart
    np.testing.assert_allclose(lagging.gains[[0, 2], [0, 1]], [0.9, 0.7], rtol=0.03)
    np.testing.assert_allclose(lagging.gains[[0, 2], [1, 0]], 0.0, atol=0.02)


@pytest.mark.parametrize("lever", [0.0, 0.4])
def test_a_plain_model_leads_where_its_vehicle_goes(lever):
    """Another drive, 10 s ahead from 1 s of measurements: by what it was made of within noise; at once far off."""
    plant, other = agvjax.Base(track=0.5), drive(3, lever=lever)
    rows = np.arange(100, 320)
    for model, most in zip(plain_models(plant, [drive(1, lever=lever)]), (np.inf, 0.15), strict=True):
        place = led(driven(model, plant, other), other, rows, np.arange(rows.size) < 20)
        off = np.hypot(*(place - np.column_stack([other.measured["x"], other.measured["y"]])[rows]).T)
        assert off[20:].max() < most
        assert off[20:].max() > 0.3 if model.name == AT_ONCE else off[:20].max() < 0.05


def test_of_a_log_too_short_there_is_no_plain_model():
    short = drive(1, rows=100)
    assert plain_models(agvjax.Base(), [short._replace(t=short.t * 40)]) == []


def test_a_steered_vehicle_is_driven_by_the_twist_of_its_angle():
    """A circle of radius 2 m: tan(angle) = wheelbase / 2."""
    n, plant = 400, agvjax.Ackermann(wheelbase=0.5)
    t, angle = STEP * np.arange(n), np.arctan(0.25)
    psi = 0.5 * t
    seen = {"x": 2 * np.sin(psi), "y": 2 - 2 * np.cos(psi), "heading": psi}
    log = Log("circle", 0.0, t, np.tile([1.0, angle], (n, 1)), ("speed", "steering_angle"), seen)
    at_once = plain_models(plant, [log])[0]
    place = led(driven(at_once, plant, log), log, np.arange(100, 200), np.arange(100) < 20)
    np.testing.assert_allclose(place, np.column_stack([seen["x"], seen["y"]])[100:200], atol=1e-3)


# ---- the sentence


def known(name, identified=True):
    return Estimate(name, "1", 1.0, identified=identified, drive="" if identified else "a longer one")


def said(estimates, rms=0.02, plain=(0.5, 0.1), outliers=0, left=NOTHING, own=False, ahead=True, noise=0.01):
    """A conclusion about estimates, from a fit that predicts with an rms [m] beside two plain models."""
    logs = [drive(1, noise=noise)]
    counts = SimpleNamespace(outliers=outliers)
    segments = SimpleNamespace(weight=np.ones((10, 10, 3)))
    fit = SimpleNamespace(segments=segments, counts=counts, model=SimpleNamespace(channels=("x", "y", "heading")))
    empty = np.zeros((1, 1))
    predicted = Prediction("other", 5.0, 7, rms, rms, empty, empty, dict(zip((AT_ONCE, LAGGING), plain, strict=True)))
    verdict = FitVerdict(tuple(estimates), np.eye(len(estimates)), left)
    return conclude(logs, fit, verdict, [predicted] if ahead else [], own)


DEADZONE, DELAY = known("deadzone.left.slope_left"), "actuators.left.delay.time"


def test_numbers_that_are_all_known_are_good_for_tuning():
    good, text = said([DEADZONE, known(DELAY)])
    assert good and text.startswith("These numbers are good for tuning. A drive that it has not seen is predicted")
    assert "rms of 20 mm (500 mm with kinematics that obey at once, 100 mm with a first-order lag)" in text


def test_what_the_log_does_not_tell_is_said_by_kind():
    good, text = said([DEADZONE, known(DELAY, False)])
    assert good and text.startswith("These numbers are good for deadzones, not for delays. ")
    half = [DEADZONE, known("deadzone.left.slope_right", False), known("plant.track"), known("plant.drift", False)]
    assert (
        "good for 1 of 2 numbers of deadzones and 1 of 2 numbers of the vehicle, not for the others." in said(half)[1]
    )


def test_a_number_that_was_looked_for_and_is_not_there_is_known():
    absent = known("disturbance.x.constant")._replace(identified=False)
    assert absent.absent and said([DEADZONE, absent])[1].startswith("These numbers are good for tuning.")


def test_a_fit_that_explains_no_more_than_a_plain_model_is_called_so():
    good, text = said([DEADZONE], rms=0.11)
    assert not good and "not good: they explain another drive no better than a first-order lag." in text
    good, text = said([DEADZONE], rms=0.091)
    assert not good and "they explain another drive only 9% better than a first-order lag." in text
    assert said([DEADZONE], rms=0.089)[0]
    good, text = said([DEADZONE], rms=0.6, plain=(0.5, 0.7), own=True)
    assert not good and "no better than kinematics that obey at once. The same drive is predicted" in text


def test_of_a_model_that_lacks_something_more_is_asked():
    """29 mm against 35 mm, of a base that drives .6 of its speed in turns is not two thirds of a plain error."""
    lacking = Left({}, {GOES: 0.1}, {}, None)
    good, text = said([DEADZONE], rms=0.083, left=lacking)
    words = "only 17% better than a first-order lag, and the model lacks something in where it goes."
    assert not good and words in text
    assert said([DEADZONE], rms=0.083)[0] and said([DEADZONE], rms=0.066, left=lacking)[0]


def test_a_prediction_within_the_noise_is_no_worse_than_another_one():
    """0.014 m is what two coordinates of 1 cm of noise make; no model can be seen to be better."""
    assert said([DEADZONE], rms=0.02, plain=(0.5, 0.018))[0]
    assert not said([DEADZONE], rms=0.02, plain=(0.5, 0.018), noise=0.002)[0]


def test_numbers_are_no_good_where_nothing_is_known_or_much_was_left_out():
    good, text = said([known("plant.track", False)], ahead=False)
    assert not good and text == "These numbers are not good: this drive tells none of what was asked for."
    two = [known("plant.drift", False)._replace(reason="looks like plant.track in this drive", alike=("plant.track",))]
    good, text = said([known("plant.track", False), *two], ahead=False)
    assert not good and "asked for: plant.drift looks like plant.track in this drive; leave one of them out" in text
    assert said([DEADZONE], ahead=False)[1].endswith("No drive is long enough to be predicted.")
    good, text = said([DEADZONE], outliers=100)
    assert not good and "25% of the measurements fit nothing" in text  # of 300 that were kept, and 100


def test_what_the_model_lacks_is_said_beside_what_it_is_good_for():
    good, text = said([DEADZONE], left=Left({}, {GOES: 0.1}, {TURNS: (82.0, 9.0)}, None))
    words = "good for tuning; their intervals may be too narrow, since the model lacks something in where it goes and "
    assert good and words + "how it turns." in text
    _, text = said([DEADZONE], left=NOTHING._replace(change=Change(61.2, "plant.track", -0.05)))
    assert "good for tuning; from t = 61 s on the machine behaves differently (plant.track by -0.05)." in text


# ---- many logs


def predictions(count):
    t = np.tile(np.arange(6.0), (1, 1))
    return [Prediction(f"log{i}", 5.0, 1, 0.0, 0.01 * (i % 7), t, 0 * t, {AT_ONCE: 1.0}) for i in range(count)]


def test_of_many_logs_the_worst_are_drawn_and_the_figure_says_so():
    figure = figures.predictions(predictions(25))
    names = [axis.get_title().split(":")[0] for axis in figure.axes]
    assert names == ["log6", "log13", "log20", "log5", "log12", "log19", "log4", "log11", "log18"]
    assert figure.get_suptitle() == "the 9 of 25 logs with the largest errors"
    width, height = figure.get_size_inches()
    assert width < 16 and height < 12
    few = figures.predictions(predictions(9))
    assert [axis.get_title()[:4] for axis in few.axes] == [f"log{i}" for i in range(9)] and not few.get_suptitle()


def test_of_many_logs_a_terminal_is_told_the_worst():
    result = SimpleNamespace(predictions=predictions(25))
    lines = page.predicted(result, 3).splitlines()
    assert len(lines) == 6 and "log6" in lines[2] and lines[-1].startswith("and 22 more")
    assert len(page.predicted(result).splitlines()) == 27


# ---- what was driven


def going(v, w, sent):
    """A log of 40 s at 20 Hz that goes by these functions of time, with a millimetre and a milliradian of noise."""
    t = STEP * np.arange(800)
    psi = np.cumsum(w(t)) * STEP
    x, y = np.cumsum([v(t) * np.cos(psi), v(t) * np.sin(psi)], axis=1) * STEP
    seen = np.stack([x, y, psi]) + 1e-3 * np.random.default_rng(0).standard_normal((3, 800))
    inputs = np.stack([f(t) for f in sent], axis=1)
    return Log("a", 0.0, t, inputs, ("left", "right"), dict(zip(("x", "y", "heading"), seen, strict=True)))


def test_a_drive_to_all_sides_lacks_nothing():
    """Forwards and backwards, to the left and to the right, for half of the time each but for a part of a period."""
    sines = [lambda t: 0.6 * np.sin(0.7 * t), lambda t: 0.6 * np.sin(0.9 * t)]
    sent = [lambda t: 0.6 * t / 40 * np.sign(np.sin(3 * t)), lambda t: 0.6 * np.sin(3 * t)]
    told = covered(agvjax.Scenario.of(agvjax.Base()), [going(*sines, sent)])
    assert not told.lacks
    assert set(told.shares) == {"forwards", "backwards", "to the left", "to the right", "straight on"}
    for name in ("forwards", "backwards", "to the left", "to the right"):
        assert 0.4 < told.shares[name] < 0.6, name
    (name, least, most, small, turns), (_, _, _, _, waves) = told.commands
    assert name == "left" and most == pytest.approx(0.6, abs=0.03) and least == pytest.approx(-most, abs=0.03)
    assert small == pytest.approx(0.2, abs=0.01)  # below twice the threshold of 0.06, of what grows to 0.6
    assert waves == 38 and turns == pytest.approx(38 - 8, abs=2)  # a change of sign every pi / 3; those above a tenth


def test_what_a_drive_lacks_is_named():
    """Round to the left and never back, at one level of command."""
    log = going(lambda t: 0.5 + 0 * t, lambda t: 0.4 + 0 * t, [lambda t: 0.4 + 0 * t, lambda t: 0.6 + 0 * t])
    told = covered(agvjax.Scenario.of(agvjax.Base()), [log])
    assert told.shares["forwards"] == told.shares["to the left"] == 1.0 and told.shares["backwards"] == 0.0
    of_each = [
        x
        for side in ("left", "right")
        for x in (f"negative commands of {side} beyond its deadzone", f"small commands of {side}, up to 0.12")
    ]
    assert {*told.lacks} == {
        "drives backwards",
        "drives to the right",
        *of_each,
        "commands of left that rise and fall",
        "commands of right that rise and fall",
    }
    assert page.lacking(told).startswith("It lacks, or has hardly any: drives backwards, drives to the right, ")


def test_commands_that_the_assumed_vehicle_cannot_follow_are_said():
    """A car whose wheel is assumed to stop at 0.4189 rad; a deadzone of 0.0175 rad is no part of the angle."""
    car = load(["ackermann"]).scenario

    def told(low, high):
        return beyond(car, Covered({}, [("speed", -3.0, 3.0, 0.0, 9), ("steering_angle", low, high, 0.0, 9)], []))

    assert told(-0.42, 0.44) == []
    (text,) = told(-0.58, 0.3)
    assert text.startswith("steering_angle was sent up to -0.58 rad, and the assumed vehicle ends at -0.4189 rad")
    assert "largest_angle" in text and told(-0.1, 0.47)
