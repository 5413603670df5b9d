"""Every symbol in the tables of a tuning report is explained beside them."""

import pytest

import agvjax
from tuning import config as configuration
from tuning.config.names import CLASSES
from tuning.config.settings import Criteria
from tuning.tune.meanings import of_gains, of_metrics

LAWS = {name: cls for name, cls in CLASSES["controller"].items() if cls is not agvjax.EventTriggered}


@pytest.mark.parametrize("name", LAWS)
def test_every_gain_that_a_law_tunes_has_words_of_its_own(name):
    """An equation's number alone is no meaning."""
    law = LAWS[name]()
    said = of_gains(law, law.gains_to_tune())
    assert said
    for gain, text in said.items():
        assert len(text.split("(")[0].split()) >= 3, (gain, text)


def test_a_gain_of_a_law_in_a_computer_means_what_it_means_alone():
    law = agvjax.Sampled(inner=agvjax.PathPID(k_y=agvjax.Schedule(nodes=(0.2, 0.8), values=(8.0, 5.0))))
    said = of_gains(law, ("inner.k_y.values[1]", "inner.k_psi", "period"))
    assert said["inner.k_y.values[1]"] == "gain on the deviation from the route"
    assert said["inner.k_psi"] == "gain on the heading error" and "sampling period" in said["period"]


def test_the_paper_s_gains_are_told_with_their_equations():
    assert of_gains(agvjax.NeuroBackstepping(), ("Lam",))["Lam"].endswith(
        "integral of the position error (after eq. (32))"
    )


def test_a_metric_is_told_with_the_numbers_that_it_is_judged_by():
    said = of_metrics(("rmse_late_x", "settling_time_heading"), Criteria(late=2.5, band=0.1))
    assert "2.5 s" in said["rmse_late_x"] and "0.1 m and rad" in said["settling_time_heading"]
    assert not any("criteria" in text for text in said.values())


def test_the_gains_of_every_preset_are_explained():
    for preset in (None, "base", "forklift", "robot", "car", "unicycle"):
        config = configuration.load([preset] if preset else [])
        law = config.controller
        assert all(of_gains(law, law.gains_to_tune()).values()), preset
