"""What is left of a fit, made by hand: noise that lasts is noise, what goes with the commands or comes in lumps not."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tuning.identify.left import GOES, TURNS, against, changed, follows, left, uneven, white
from tuning.identify.log import Log
from tuning.identify.model import Sums
from tuning.identify.parameters import Parameter
from tuning.identify.segments import cut

STEP, EVERY, PLACES = 0.02, 5, ("x", "y", "heading")
NOISE = np.array([0.01, 0.01, 0.005])


def drive(seed, rows=6000):
    """Two minutes of commands held for a second, and a pose at 10 Hz."""
    rng = np.random.default_rng(seed)
    inputs = np.repeat(rng.uniform(-0.8, 0.8, (rows // 50, 2)), 50, axis=0)
    heading = np.cumsum(inputs[:, 1] - inputs[:, 0]) * STEP
    pose = np.stack([np.cumsum(np.cos(heading)), np.cumsum(np.sin(heading)), heading], axis=1) * [STEP, STEP, 1.0]
    pose[np.arange(rows) % EVERY != 0] = np.nan
    return Log(
        f"drive{seed}", 0.0, STEP * np.arange(rows), inputs, ("left", "right"), dict(zip(PLACES, pose.T, strict=True))
    )


def fitted(log, residual, slope=None) -> Any:
    """A fit of three numbers that leaves a residual at each row (N, 3) of a log."""
    segments, counts = cut([log], 2.0, 0.5, 5.0)
    own = np.where(segments.weight > 0, residual[np.maximum(segments.rows, 0)], 0.0)
    count, names = len(own), ("plant.track", "plant.drift", "plant.time_constant")
    slope = np.random.default_rng(9).standard_normal((count, 3)) if slope is None else slope
    sums = Sums(np.tile(np.eye(3), (count, 1, 1)), slope, np.ones(count), np.zeros((count, 5)), own)
    parameters = tuple(Parameter(name, "1", 0.0, -9.0, 9.0, 1e3, 0.0) for name in names)
    model, free, p = SimpleNamespace(channels=PLACES), np.full(3, True), np.zeros(3)
    return SimpleNamespace(segments=segments, sums=sums, model=model, parameters=parameters, free=free, p=p)


def lasting(seed, rows=6000, share=0.9):
    e = np.random.default_rng([seed, 5]).standard_normal((rows, 3))
    for i in range(1, rows):
        e[i] = share * e[i - 1] + np.sqrt(1 - share**2) * e[i]
    return e * NOISE


def test_noise_that_lasts_is_noise():
    """Of 6 drives at most 1 is doubted, by any of the three."""
    doubted = 0
    for seed in range(6):
        log = drive(seed)
        said = left(fitted(log, lasting(seed)), [log], seed)
        assert all(0.4 < x < 0.7 for x in said.white.values())  # 0.9 to the 5th is 0.59
        doubted += bool(said.lacks or said.change)
        words = against(said)
        assert said.lacks or said.change or (len(words) == 1 and "the intervals count it" in words[0])
    assert doubted <= 1


def test_what_goes_with_the_commands_is_what_the_model_lacks():
    """A yaw rate that follows a moment later than the model's, by a tenth of the difference of the wheels."""
    log = drive(1)
    turn = log.inputs[:, 1] - log.inputs[:, 0]
    late = 0.1 * STEP * np.cumsum(np.roll(turn, 15) - np.roll(turn, 25))
    off = lasting(1) + late[:, None] * [0, 0, 1]
    assert np.std(late) < 3 * NOISE[2]
    found = follows(fitted(log, off), [log])
    assert set(found) == {TURNS} and 0.02 < found[TURNS] < 1


def test_what_comes_in_lumps_is_what_the_model_lacks_or_a_sensor_failed():
    """Twice a second a wheel sticks: the position is off by 6 cm; the stretch that begins at 40.5 s is named."""
    off = lasting(2)
    for begin, many in ((2030, 3), (4070, 2)):
        off[begin : begin + 50, 0] += 0.02 * many
    found = uneven(fitted(drive(2), off))
    assert set(found) == {GOES} and found[GOES][0] == pytest.approx(40.5) and found[GOES][1] > 4


@pytest.mark.parametrize("at", [20, 40])
def test_numbers_that_shift_along_the_log_are_named_with_the_time(at):
    """From the stretch `at` on the second number is larger, by 1.5: each stretch has a deviation of 1."""
    slope = np.random.default_rng(3).standard_normal((59, 3))
    slope[at:, 1] -= 1.5
    found = changed(fitted(drive(3), lasting(3), slope), 0)
    assert found is not None and found.name == "plant.drift" and found.by == pytest.approx(1.5, abs=0.5)
    assert abs(found.t - (0.5 + 2.0 * at)) <= 8.0


def test_of_few_stretches_nothing_is_said():
    log = drive(4, 900)
    said = left(fitted(log, lasting(4, 900)), [log], 0)
    assert not said.follows and not said.uneven and said.change is None
    assert set(said.white) == set(PLACES) == set(white(fitted(log, lasting(4, 900))))
