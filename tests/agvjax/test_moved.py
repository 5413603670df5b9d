"""What users of earlier releases have typed goes on working, says where it is today, and costs nothing until then."""

import importlib

import pytest

import agvjax
import tuning
from agvjax import _moved
from commands import python

TYPED = {  # an old name, and where what it means lies today
    "agvjax.Problem": "agvjax.errors.Fault",
    "agvjax.problems": "agvjax.check.faults",
    "agvjax.path_problems": "agvjax.feasible.path_warnings",
    "agvjax.KnownSlopes": "agvjax.readings.KnownSlopes",
    "agvjax.ForwardSpeed": "agvjax.plants.decoupled.ForwardSpeed",
    "agvjax.path.Dumbbell": "agvjax.paths.shapes.Dumbbell",
    "agvjax.path.RawBearing": "agvjax.paths.heading.RawBearing",
    "agvjax.waypoints.Waypoints": "agvjax.paths.waypoints.Waypoints",
    "agvjax.angle.wrap": "agvjax.geometry.wrap",
    "agvjax.deadzone.Deadzone": "agvjax.actuators.deadzone.Deadzone",
    "agvjax.actuators.Saturation": "agvjax.actuators.elements.Saturation",
    "agvjax.actuators.Chain": "agvjax.actuators.chain.Chain",
    "agvjax.rbf.RadialBasis": "agvjax.controllers.network.RadialBasis",
    "agvjax.plot.errors": "agvjax.draw.plot.errors",
    "agvjax.animate.animation": "agvjax.draw.animate.animation",
    "agvjax.loop.Sample": "agvjax.engine.loop.Sample",
    "agvjax.lyapunov.signals": "tuning.studies.paper.proof.signals",
    "agvjax.plants.Command": "agvjax.messages.Command",
    "agvjax.plants.protocol.Measurement": "agvjax.messages.Measurement",
    "agvjax.plants.protocol.turned": "agvjax.geometry.turned",
    "tuning.settings.Tune": "tuning.config.settings.Tune",
    "tuning.config.resolve": "tuning.config.load.resolve",
    "tuning.classes.CLASSES": "tuning.config.names.CLASSES",
    "tuning.problem.pose": "tuning.tune.problem.pose",
    "tuning.objective.Objective": "tuning.tune.methods.objective.Objective",
    "tuning.objective.METRICS": "agvjax.metric_table.METRICS",
    "tuning.optimise.Tuner": "tuning.tune.tuner.Tuner",
    "tuning.ensemble.sample": "tuning.ensemble.draws.sample",
    "tuning.rounds.solve": "tuning.tune.rounds.solve",
    "tuning.worst.Adversary": "tuning.ensemble.worst.Adversary",
    "tuning.runs.write_json": "tuning.io.files.write_json",
    "tuning.paper.cases.matched": "tuning.studies.paper.cases.matched",
    "tuning.vehicles.study.study": "tuning.studies.vehicles.study.study",
}


def looked_up(name):
    """What a dotted name means, its module imported."""
    module, _, last = name.rpartition(".")
    return getattr(importlib.import_module(module), last)


@pytest.mark.parametrize("old", TYPED)
def test_an_old_name_is_what_it_means_today_and_says_where_that_is(old):
    with pytest.warns(DeprecationWarning, match=f"{old} is now ".replace(".", r"\.")):
        found = looked_up(old)
    assert found is looked_up(TYPED[old])


@pytest.mark.parametrize("module", sorted(_moved.HOMES))
def test_every_home_of_an_old_module_exists(module):
    for home in _moved.homes(module):
        assert importlib.util.find_spec(home), home


def test_what_never_was_is_not_there():
    for name in ("agvjax.nothing", "agvjax.path.nothing", "tuning.nothing", "tuning.settings.nothing"):
        with pytest.raises(AttributeError, match="nothing"):
            looked_up(name)
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("tuning.paper.nothing")


def test_the_public_list_is_whole():
    assert len(set(agvjax.__all__)) == len(agvjax.__all__)
    assert all(name in vars(agvjax) for name in agvjax.__all__)


def test_the_faults_of_an_error_have_their_old_name_too():
    fault = agvjax.Fault("k1", -1, "> 0")
    with pytest.warns(DeprecationWarning, match="faults"):
        assert agvjax.InputError([fault]).problems == [fault]


def test_old_modules_are_found_with_neither_package_imported_before():
    code = "import warnings; warnings.simplefilter('ignore'); from tuning.settings import Tune; print(Tune.__module__)"
    assert python(code).strip() == "tuning.config.settings"
    assert tuning.Tune.__module__ == "tuning.config.settings"


def test_a_tuner_takes_its_settings_one_by_one_as_it_did():
    scenes = agvjax.batch(agvjax.Scenario(), {"start.heading": [0.1, 0.2]})
    gains = tuning.Gains(("k1",), [0.0], [50.0])
    with pytest.warns(DeprecationWarning) as warned:
        tuner = tuning.Tuner(
            agvjax.NeuroBackstepping(), scenes, gains, tuning.Objective(), dt=1e-2, n_steps=1200, iterations=40
        )
    said = ["dt, n_steps: now in timing=Timing(...)", "iterations: now in settings=Tune(...)"]
    assert [str(one.message) for one in warned] == said
    today = tuning.Tuner(
        agvjax.NeuroBackstepping(),
        scenes,
        gains,
        tuning.Objective(),
        tuning.Tune(iterations=40),
        agvjax.Timing(dt=1e-2, n_steps=1200),
    )
    assert (tuner.settings, tuner.timing) == (today.settings, today.timing)
