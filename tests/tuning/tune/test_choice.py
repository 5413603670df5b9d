"""Which numbers of a law are tuned: by name, all of them, or those that promise something; the others stay."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import InputError, NeuroBackstepping, Sampled, Scenario, Timing
from laws import Proportional
from tuning import Between, Config, Ensemble, Limit, Objective, Requirement, Search, Simulate, Tune, Tuner, pose, sample
from tuning import config as configuration
from tuning.tune import tables
from tuning.tune.checkpoint import load, save
from tuning.tune.choice import promises
from tuning.tune.gains import Gains, names_of
from tuning.tune.judge import judge
from tuning.tune.methods.objective import within
from tuning.tune.page import markdown
from tuning.tune.rounds import begin, solve
from tuning.tune.rules import faults

pytestmark = pytest.mark.usefixtures("promotion_as_optax_has_it")

TIMING = {"dt": 1e-2, "integrator": "euler"}
LIMITS = {"effort": Limit(mean=1.1, worst=1.1)}
NO_SEARCH = Search(scouts=4, checks=0, starts=1, iterations=1)


@agvjax.pytree
class Shy(Proportional):
    """A law that names one gain of five, of which one does nothing at all."""

    idle: float = 1.0

    tunable = ("stiffness",)


def shy(**tune):
    """Four scenarios of two seconds."""
    settings = {"gains": "sensitive", "search": NO_SEARCH, "screen": 0, "iterations": 12, "limits": LIMITS, **TIMING}
    return Config(
        controller=Shy(),
        simulate=Simulate(horizon=2.0, **TIMING),
        ensemble=Ensemble(size=4, validation_size=4, draws={"start.heading": Between(-0.5, 1.0)}),
        tune=Tune(**(settings | tune)),
    )


# ------------------------------------------------------------------------------------------------------------ by name


def test_a_number_in_an_array_is_tuned_by_its_place_and_its_neighbours_stay():
    names = ("k1", "heading_network.centers[1]", "heading_network.centers[3]")
    gains = Gains(names, np.array([0.0, -np.inf, -np.inf]), np.full(3, np.inf))
    law = NeuroBackstepping()
    moved = gains.controller(jnp.array([np.log(7.0), -0.25, 2.5]), law)
    np.testing.assert_allclose(moved.k1, 7.0, rtol=1e-12)
    np.testing.assert_allclose(moved.heading_network.centers, [-3.0, -0.25, 0.0, 2.5, 3.0])
    np.testing.assert_array_equal(moved.position_network.centers, law.position_network.centers)
    many = gains.controllers(jnp.array([[0.0, 1.0, 2.0], [0.0, 3.0, 4.0]]), law)
    np.testing.assert_allclose(
        many.values["heading_network.centers"], [[-3.0, 1.0, 0.0, 2.0, 3.0], [-3.0, 3.0, 0.0, 4.0, 3.0]]
    )


def test_a_number_in_an_array_stands_in_the_table_of_gains():
    law = NeuroBackstepping()
    moved = agvjax.replace(law, {"heading_network.centers": np.array([-3.0, -0.25, 0.0, 2.5, 3.0])})
    row = tables.gains(("heading_network.centers[1]",), law, moved, {}).splitlines()[-1]
    assert [cell.strip() for cell in row.split("|")[1:4]] == ["heading_network.centers[1]", "-1.5", "-0.25"]


@pytest.mark.parametrize("name", ["heading_network.centers", "heading_network.centers[5]", "k1[0]"])
def test_a_name_of_several_numbers_or_of_none_is_refused(name):
    with pytest.raises(InputError, match="a single number"):
        configuration.load([], [f'tune.gains=["{name}"]'], faults)


def test_all_are_the_laws_own_and_every_other_number_but_the_period_and_what_lies_on_its_bound():
    names = names_of(Config(tune=Tune(gains="all")))
    assert names[:7] == NeuroBackstepping.tunable
    assert len(names) == 7 + 2 + 4 + 2 + 2 + 2 * (5 + 1)  # beliefs; gamma, eta; b; starts; centres and width, twice
    assert {"heading_network.centers[4]", "position_network.width", "Pi_hat"} <= set(names)
    on_bound = Config(controller=NeuroBackstepping(varphi_start=0.0), tune=Tune(gains="all"))
    assert set(names) - set(names_of(on_bound)) == {"varphi_start"}
    clocked = names_of(Config(controller=Sampled(inner=NeuroBackstepping()), tune=Tune(gains="all")))
    assert "inner.heading_network.centers[0]" in clocked
    assert "period" not in clocked
    tied = names_of(Config(tune=Tune(gains="all", tied={"k2": "k1"})))
    assert set(names) - set(tied) == {"k2"}


def test_the_preset_leaves_room_below_every_limit():
    tune = configuration.load(["all-gains"], rules=faults).tune
    assert tune.gains == "sensitive"
    assert {name: (x.mean < 1, x.worst < 1) for name, x in tune.limits.items()} == dict.fromkeys(
        ("effort", "peak_position", "peak_heading"), (True, True)
    )


@pytest.mark.parametrize("setting", ["tune.gains=some", "tune.gains=3", 'tune.gains=["k1", 2]'])
def test_a_word_that_means_no_gains_is_refused(setting):
    with pytest.raises(InputError, match="one of all, sensitive"):
        configuration.load([], [setting], faults)


@pytest.mark.parametrize("method", ["adam", "cma"])
def test_what_pays_is_asked_of_a_method_that_sees_slopes(method):
    configuration.load([], ["tune.gains=all", f"tune.optimizer={method}"], faults)
    with pytest.raises(InputError, match="only tune.optimizer = sqp"):
        configuration.load([], ["tune.gains=sensitive", f"tune.optimizer={method}"], faults)


# ------------------------------------------------------------------------------------------------------ what promises


def test_a_promise_is_what_the_linear_problem_gains_by_one_more_number():
    # goal 1 - .1 z0 - .2 z1 - .05 z2, limit .9 + .05 z2 <= 1 with penalty 3, all within |z| <= 1. With z0 alone it
    # falls to .9; with z1 too to .7; with z2 too to .85, its limit just met; z3 does nothing.
    slopes = np.zeros((4, 2, 1))
    slopes[:, 0, 0], slopes[2, 1, 0] = [-0.1, -0.2, -0.05, 0.0], 0.1
    model = np.array([[1.0], [0.9]]), np.array([True]), slopes
    objective = Objective((Requirement("total_rmse", "mean", 1.0),), within({"effort": 1.0})[:1])
    batch = sample(Scenario(), {"disturbance.amplitude": Between(0.0, 1.0)}, 1, 0)
    tuner = Tuner(
        controller=NeuroBackstepping(),
        batch=batch,
        gains=Gains(("k1", "k2", "k3", "Lam"), np.zeros(4), np.full(4, np.inf)),
        objective=objective,
        settings=Tune(),
        timing=Timing(),
        budget=np.ones((3, 2)),
        compiled=lambda z, scenarios: model,
    )
    first = np.array([True, False, False, False])
    found = promises(tuner, tuner.begin(moving=first), first)
    np.testing.assert_allclose(found, [0.0, 0.2 / 0.9, 0.05 / 0.9, 0.0], atol=1e-6)
    dearer = model[0], model[1], slopes * np.array([[[1.0], [1.0]], [[1.0], [1.0]], [[1.0], [4.0]], [[1.0], [1.0]]])
    tuner = dataclasses.replace(tuner, compiled=lambda z, scenarios: dearer)  # a quarter of the way, then the limit
    np.testing.assert_allclose(promises(tuner, tuner.begin(moving=first), first)[2], 0.0125 / 0.9, atol=1e-6)


@pytest.mark.slow
def test_what_does_nothing_is_left_and_what_pays_is_tuned_after_the_laws_own():
    problem = pose(shy())
    outcome = solve(problem)
    names = problem.tuner.gains.names
    assert names == ("stiffness", "damping", "turn", "lean", "idle")
    first, *later = outcome.run.searches
    assert later, "further numbers were let go"
    np.testing.assert_array_equal(first.moving, [True, False, False, False, False])
    held = np.array([row[-4:] for row in first.history])
    np.testing.assert_array_equal(held, np.tile(held[0], (len(held), 1)))  # to the last bit
    np.testing.assert_allclose(held[0], [8.0, 4.0, -0.1, 1.0], rtol=1e-15)
    moved = dict(zip(names, outcome.run.moving, strict=True))
    assert moved["damping"] and moved["turn"]
    assert not moved["idle"]
    assert float(outcome.controller.idle) == 1.0
    assert np.all(outcome.run.promises[:, names.index("idle")] < 1e-9)
    assert outcome.run.lead.best[1] < first.best[1]
    text = markdown(outcome, judge(outcome))
    table = {line.split("|")[1].strip(): line for line in text.splitlines() if line.startswith("| ")}
    assert "yes" in text[text.index("tuned too") :]
    assert "idle" in table and "yes" not in table["idle"]


@pytest.mark.slow
def test_all_are_let_go_at_once_after_the_laws_own():
    outcome = solve(pose(shy(gains="all", iterations=4)))
    assert [p.moving.sum() for p in outcome.run.searches] == [1, 5]
    assert outcome.run.promises is None


@pytest.mark.slow
@pytest.mark.parametrize("stop", [3, 5, 8])
def test_a_choice_is_resumed_to_the_same_bits(tmp_path, stop):
    problem, runs = pose(shy()), []
    whole = solve(problem, each=runs.append)
    assert len(runs) > stop
    save(tmp_path, runs[stop])
    resumed = solve(problem, load(tmp_path, begin(problem)))
    np.testing.assert_array_equal(resumed.run.promises, whole.run.promises)
    assert resumed.run.history == whole.run.history
    np.testing.assert_array_equal(resumed.run.lead.best_z, whole.run.lead.best_z)
    assert begin(problem).promises is None


@pytest.mark.slow
def test_a_limit_is_kept_by_more_gains_too():
    outcome = solve(pose(shy(limits={"effort": Limit(mean=1.0, worst=1.0)}, iterations=30)))
    assert outcome.run.lead.best[0] == 0.0
