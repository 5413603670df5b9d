"""What is said before a run."""

import dataclasses

import pytest

from tuning import Config, Simulate
from tuning.cli.prepare import blurred_clock


@pytest.mark.parametrize(
    ("precision", "horizon", "said"),
    [  # numbers of 24 bits from 1024 to 2048 are 2^-13 apart, from 8 to 16 2^-20
        (32, 1260.0, "times are 0.00012 s apart at the end of a run of 1260 s (simulate.horizon), 12% of simulate.dt"),
        (32, 12.0, ""),
        (64, 1260.0, ""),
    ],
)
def test_a_clock_that_single_precision_blurs_is_said(precision, horizon, said):
    config = dataclasses.replace(Config(simulate=Simulate(dt=1e-3, horizon=horizon)), precision=precision)
    text = blurred_clock(config, "simulate")
    assert said in text and bool(text) == bool(said)
