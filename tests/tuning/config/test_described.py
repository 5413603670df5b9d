"""Every key of a configuration is described, and what is said of it is what loading does."""

import dataclasses
import re
import tomllib

import numpy as np
import pytest

import agvjax
from agvjax.metric_table import METRICS
from commands import ROOT
from tuning import config as configuration
from tuning.config.described import described, every_key, meanings
from tuning.config.load import BUILT_IN
from tuning.config.names import CLASSES
from tuning.config.settings import Config

KEYS = every_key()


def written(table, prefix=""):
    """The keys of a resolved config.toml; what a route or a limit is made of too."""
    for name, value in table.items():
        key = f"{prefix}{name}"
        yield key
        if isinstance(value, dict) and not key.startswith(("scenario.path.limits", "tune.options")):
            yield from written(value, f"{key}.")


@pytest.mark.parametrize("preset", [None, *BUILT_IN])
def test_every_key_that_a_run_writes_is_described(preset):
    table = tomllib.loads(configuration.dump(configuration.load([preset] if preset else [])))
    keys = [key for key in written(table) if "distribution" not in key]
    assert len(keys) > 100
    for key in keys:
        assert described(key).text, key


def test_every_key_has_a_kind_a_meaning_and_a_page():
    for key in KEYS:
        row = described(key)
        assert row.key == key and row.kind and len(row.text) > 4, row
        for page in row.page.split(", "):
            assert (ROOT / page).is_file(), row
    assert len(KEYS) == len(set(KEYS)) > 400


def test_no_setting_is_without_words_of_its_own():
    """Those of a law may be said by the equation that it is of; a setting's are under Attributes of its class."""

    def sections(holder):
        yield holder
        for field in dataclasses.fields(holder):
            part = getattr(holder, field.name)
            if dataclasses.is_dataclass(part) and type(part).__module__.startswith("tuning."):
                yield from sections(part)

    found = list(sections(Config()))
    assert len(found) == 14
    for section in found:
        assert set(meanings(type(section))) == {field.name for field in dataclasses.fields(section)}


RULED = [
    key
    for key in KEYS
    if key.startswith(("tune.", "speed.", "sweep.", "identify.")) and "<" not in key
    if described(key).rule not in ("", agvjax.ANY.text) and described(key).kind in ("a number", "a whole number")
]


def test_the_rule_that_is_told_is_the_rule_that_is_kept():
    """-1 is refused with the very words wherever a number has a rule."""
    assert len(RULED) > 30
    with pytest.raises(agvjax.InputError) as caught:
        configuration.load([], more=dict.fromkeys(RULED, -1))
    refused = {fault.key: fault.rule for fault in caught.value.faults}
    for key in RULED:
        assert described(key).rule in refused[key], key


def test_a_default_that_is_told_is_what_loading_gives():
    config = configuration.load([])
    for key in ("tune.penalty", "tune.screen", "simulate.dt", "criteria.band", "sweep.samples", "identify.memory"):
        section, name = key.split(".")
        assert float(described(key).default) == pytest.approx(
            float(np.asarray(getattr(getattr(config, section), name)))
        )
    assert described("tune.optimizer").default == '"sqp"'
    assert described("scenario.deadzone.<actuator>.threshold_right").unit == "unit of the command"


def test_any_name_stands_for_a_placeholder_with_or_without_quotes():
    for key in ('ensemble.draws."deadzone.left.threshold_right"', "ensemble.draws.start.heading"):
        assert described(key).key == "ensemble.draws.<leaf>"
    assert described("tune.limits.effort.worst").key == "tune.limits.<metric>.worst"
    assert described("scenario.actuators.left.delay.slots").key == "scenario.actuators.<actuator>.<element>.slots"


def test_types_that_differ_are_told_apart():
    default = described("scenario.plant.track").default
    assert re.search(r"0\.34 \(differential_drive\)", default) and re.search(r"0\.5 \(base\)", default)
    for name in CLASSES["scenario.plant"]:
        assert name in described("scenario.plant.type").rule


@pytest.mark.parametrize(("key", "meant"), [("tune.penalti", "tune.penalty"), ("scenario.pathh", "scenario.path")])
def test_an_unknown_key_names_the_nearest(key, meant):
    with pytest.raises(agvjax.InputError, match=f"did you mean {re.escape(meant)}"):
        described(key)


def test_every_metric_has_words():
    assert all(row.text and row.unit for row in METRICS.values())
    assert len({row.text for row in METRICS.values()}) == len(METRICS)  # and none has another's
