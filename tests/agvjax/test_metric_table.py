"""One name a metric: the same in Python, in TOML and in the docs; and what each row is of a run with known numbers."""

import re

import numpy as np
import pytest

import agvjax
from agvjax.metric_table import METRICS, OLD_NAMES, Followed, LoopMargins, metrics_of
from agvjax.metric_units import units_in
from commands import ROOT
from tuning.config.load import load

BY_CHANNEL = {  # x, y, heading
    "rmse": (2.0, 3.0, 6.0),
    "rmse_late": (0.1, 0.2, 0.3),
    "overshoot": (0.01, 0.02, 0.03),
    "settling_time": (1.5, 2.5, 0.5),
    "rms_command": (4.0, 4.0, 7.0),
    "peak_command": (11.0, 12.0, 13.0),
    "chatter": (100.0, 200.0, 300.0),
}
IN_TOTAL_ONLY = {"iae": (1.0, 2.0, 4.0), "ise": (8.0, 16.0, 32.0), "itae": (0.5, 0.25, 0.125)}
IN_TOTAL_ONLY |= {"rms_delivered": (1.0, 4.0, 8.0), "peak_delivered": (5.0, 7.0, 6.0)}
IN_TOTAL_ONLY |= {
    "reversals_delivered": (3.0, 0.0, 2.0),
    "variation_delivered": (10.0, 20.0, 30.0),
    "limited": 0.25,
    "settled": (True,) * 3,
    "ok": True,
}
ROUTE = {name: 0.5 + i for i, name in enumerate(n for n, row in METRICS.items() if row.route)}
FOLLOWED = Followed(**{name: np.array(value) for name, value in ROUTE.items()})
LOOP = {"gain_margin": 3.0, "phase_margin": 0.75, "delay_margin": 0.125, "sensitivity": 1.5}
CHANNELS = {name: np.array(values) for name, values in (BY_CHANNEL | IN_TOTAL_ONLY).items()}
RUN = agvjax.Metrics(**CHANNELS, followed=FOLLOWED, loop=LoopMargins(**LOOP))
BY_HAND = {
    "total_rmse": 7.0,  # 4 + 9 + 36 = 49
    "effort": 9.0,  # 16 + 16 + 49 = 81
    "peak_position": 12.0,
    "peak_heading": 13.0,
    "total_chatter": 600.0,
    "longest_settling_time": 2.5,
    "total_iae": 7.0,
    "total_ise": 56.0,
    "total_itae": 0.875,
    **{f"{name}_{c}": x for name, row in BY_CHANNEL.items() for c, x in zip(("x", "y", "heading"), row, strict=True)},
    "delivered_effort": 9.0,  # 1 + 16 + 64 = 81
    "delivered_peak": 7.0,
    "delivered_variation": 60.0,
    "reversals": 5.0,
    "limited": 0.25,
    **ROUTE,
    **LOOP,
}
del BY_HAND["peak_command_heading"]  # it is called peak_heading


def test_every_row_of_the_table_has_its_value_by_hand():
    assert {name: float(RUN[name]) for name in METRICS} == BY_HAND


@pytest.mark.parametrize("name", [name for name, row in METRICS.items() if row.channel is None])
def test_what_is_over_all_channels_is_an_attribute_of_the_same_name(name):
    row = METRICS[name]
    assert float(getattr(RUN.followed if row.route else RUN.loop if row.loop else RUN, name)) == BY_HAND[name]


def test_every_row_can_be_named_in_toml_and_no_other():
    given = {"sweep.metrics": list(BY_HAND), "tune.limits": dict.fromkeys(BY_HAND, 2.0)}
    config = load([], more=given)
    assert config.sweep.metrics == tuple(BY_HAND) and set(config.tune.limits or ()) == set(BY_HAND)
    with pytest.raises(agvjax.InputError, match="rmse_heading_x"):
        load([], more={"tune.goals": {"rmse_heading_x": 1.0}})


def test_the_table_of_the_docs_has_every_row_and_no_other():
    text = (ROOT / "docs" / "tuning.md").read_text().split("| metric | |")[1].split("\n\n")[0]
    named = []
    for line in text.splitlines()[2:]:
        for word in re.findall("`([a-z_]+)`", line.split("|")[1]):
            if word.startswith("_"):  # `rmse_x`, `_y`: another channel of the one before
                word = re.sub("_(x|y)$", word, named[-1])
            named.append(word)
    assert sorted(named) == sorted(BY_HAND)


def test_an_old_name_is_none_of_today_and_means_one_of_today():
    assert not set(OLD_NAMES) & set(METRICS) and set(OLD_NAMES.values()) <= set(METRICS)
    notes = []
    config = load([], ["tune.goals.rmse=1", 'sweep.metrics=["peak_x", "effort"]'], note=notes.append)
    assert list(config.tune.goals) == ["total_rmse"] and config.sweep.metrics == ("peak_command_x", "effort")
    assert notes == [
        "tune.goals.rmse: the old name of total_rmse",
        "sweep.metrics = peak_x: the old name of peak_command_x",
    ]
    with pytest.warns(DeprecationWarning, match="pareto.metric = chatter: the old name of total_chatter"):
        load([], ["pareto.metric=chatter"])


@pytest.mark.slow
def test_the_heading_and_what_is_delivered_are_missing_where_there_is_none():
    clock, all_channels = (set(metrics_of(x)) for x in (agvjax.Scenario.of(agvjax.Unicycle()), agvjax.Scenario()))
    assert {name for name, row in METRICS.items() if "heading" in name and not row.route} == all_channels - clock
    assert {name for name, row in METRICS.items() if row.route or row.loop} == set(METRICS) - all_channels
    plain = agvjax.measure(agvjax.simulate(agvjax.NeuroBackstepping(), agvjax.Scenario(), n_steps=3))
    for name in ("delivered_effort", "delivered_peak", "delivered_variation", "reversals", "limited"):
        with pytest.raises(ValueError, match="delivered=True"):
            plain[name]
        assert agvjax.Criteria.of([name]).delivered and not agvjax.Criteria.of(["effort"]).delivered


def test_units_of_commands_are_those_of_what_the_vehicle_is_sent():
    paper = units_in(agvjax.Scenario())
    assert (paper["peak_position"], paper["rms_command_x"], paper["chatter_heading"]) == ("m/s^2", "m/s^2", "rad/s")
    assert (paper["effort"], paper["total_rmse"], paper["delivered_peak"]) == (
        "m/s^2, rad/s",
        "m, rad",
        "m/s^2 or rad/s",
    )
    twist = units_in(agvjax.Scenario.of(agvjax.TwistBase()))
    assert (twist["peak_position"], twist["peak_command_x"], twist["chatter_y"]) == ("m/s or rad/s", "m/s", "rad/s")
    assert (twist["delivered_variation"], twist["total_rmse"]) == ("m/s, rad/s", "m")
    wheels = units_in(agvjax.Scenario.of(agvjax.Base()))
    assert (wheels["delivered_peak"], wheels["total_chatter"]) == ("m/s", "m/s, rad/s")
