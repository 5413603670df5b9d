"""A configuration of Python and one of TOML mean the same: completed, checked and written alike."""

import dataclasses
import tomllib

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import agvjax
from agvjax import InputError, Scenario, Unicycle
from tuning import Between, Config, Distribution, OneOf, Simulate, Span, Times, pose, run_sweep
from tuning.config import check, dump, load
from tuning.config.load import resolve
from tuning.config.rules import timing_faults
from tuning.config.settings import WHOLE_ERROR, Bound, Ensemble, Identify, Limit, Pareto, Search, Sweep, Tune, Weights
from tuning.ensemble.draws import Correlation
from tuning.io.csv_file import Column
from tuning.sweep import rules as sweep_rules
from tuning.tune import rules as tune_rules
from tuning.tune.methods.objective import Objective
from tuning.tune.problem import requirements


def again(config):
    """What is read of what is written of a configuration."""
    return resolve(tomllib.loads(dump(config)))


def wrong(config, rules=tune_rules.faults):
    """What is said of a configuration, by key."""
    with pytest.raises(InputError) as raised:
        check(config, rules)
    return {fault.key: fault for fault in raised.value.faults}


# ------------------------------------------------------------------------------------------- what is left open is said


def test_the_default_problem_tunes_the_gains_of_its_law():
    posed = pose(Config())
    assert posed.tuner.gains.names == agvjax.NeuroBackstepping.tunable
    assert set(posed.config.tune.limits) == {"effort", "peak_position", "peak_heading"}
    assert "deadzone.heading.slope_left" in posed.config.ensemble.draws


@agvjax.pytree
class Boat(agvjax.Plant):
    """A point that two engines push along the axes of the plane."""

    actuators = ("bow", "stern")
    commands_heading = False

    def deadzones(self):
        return {name: agvjax.Deadzone() for name in self.actuators}


@pytest.mark.parametrize(
    ("plant", "first"),
    [
        (Unicycle(), "acceleration"),
        (agvjax.DifferentialDrive(), "torque_right"),
        (agvjax.SingleTrack(), "steering_rate"),
        (Boat(), "bow"),
    ],
    ids=lambda x: type(x).__name__,
)
def test_a_vehicle_of_python_is_completed_with_its_own_actuators(plant, first):
    config = check(Config(scenario=Scenario.of(plant), tune=Tune(gains=("k1",))), lambda config: [])
    drawn = {name.split(".")[1] for name in config.ensemble.draws if name.startswith("deadzone")}
    assert drawn == set(plant.actuators) and first in drawn
    assert any(name.startswith(f"deadzone.{plant.actuators[0]}") for axis in config.sweep.over for name in axis)
    assert "peak_heading" not in config.tune.limits and "effort" in config.tune.limits


def test_a_vehicle_of_python_is_posed():
    config = Config(scenario=Scenario.of(Unicycle()), tune=Tune(gains=("k1",)))
    assert pose(config).tuner.gains.names == ("k1",)


def test_nothing_is_drawn_by_default_that_the_scenario_has_not():
    calm = check(Config(scenario=Scenario(disturbance=agvjax.NoDisturbance())), tune_rules.faults)
    assert "disturbance.amplitude" not in calm.ensemble.draws and "start.heading" in calm.ensemble.draws
    assert len(calm.sweep.over) == 1
    bare = check(Config(scenario=Scenario(deadzone={})), tune_rules.faults)
    assert not any(name.startswith("deadzone") for name in bare.ensemble.draws)
    assert load([], ["scenario.disturbance=none"], tune_rules.faults).ensemble.draws == calm.ensemble.draws


# --------------------------------------------------------------------------------------- what is wrong is said the same

BAD = [
    (Tune(goals={"total_rmsee": Weights(mean=1.0)}), "tune.goals.total_rmsee", "did you mean"),
    (Tune(gains=("nope",)), "tune.gains", "leaves of the controller"),
    (Tune(gains="k1"), "tune.gains", "a list of names"),
    (Tune(dt=5.0), "tune.dt", "at most"),
    (Tune(dt=None), "tune.dt", "a number"),
    (Tune(dt=np.array([1e-3, 2e-3])), "tune.dt", "a number"),
    (Tune(iterations=2.5), "tune.iterations", "a whole number >= 1"),
    (Tune(iterations=-1), "tune.iterations", "a whole number >= 1"),
    (Tune(optimizer=3), "tune.optimizer", "a string"),
    (Tune(gradient="backward"), "tune.gradient", "one of auto, forward, reverse"),
    (Tune(bounds={"k1": (30.0, 10.0)}), "tune.bounds.k1", "low <= high"),
    (Tune(bounds={"k1": 3.0}), "tune.bounds.k1", "low <= high"),
    (Tune(limits={"effort": "low"}), "tune.limits.effort", "a number"),
    (Tune(search=3), "tune.search", "Search"),
]
BAD = [(Config(tune=tune), key, rule) for tune, key, rule in BAD] + [
    (Config(seed=-1), "seed", "from 0"),
    (Config(precision=16), "precision", "32 or 64"),
    (Config(version=7), "version", "1"),
    (Config(tune={"dt": 1e-3}), "tune", "Tune"),
    (Config(controller="backstepping"), "controller", "an agvjax.Law"),
    (Config(scenario=Unicycle()), "scenario", "an agvjax.Scenario"),
    (Config(scenario=Scenario(path=lambda t: t)), "scenario.path", "an agvjax.Path"),
    (Config(scenario=Scenario(plant=None)), "scenario.plant", "an agvjax.Plant"),
    (Config(scenario=Scenario(disturbance=None)), "scenario.disturbance", "an agvjax.Disturbance"),
    (Config(simulate=Simulate(dt=True)), "simulate.dt", "a number"),
    (Config(simulate=Simulate(integrator="rk5")), "simulate.integrator", "one of"),
    (Config(pareto=Pareto(metric="effrot")), "pareto.metric", "one of"),
    (Config(ensemble=Ensemble(draws=3)), "ensemble.draws", "a table"),
    (Config(ensemble=Ensemble(draws={"start.heading": 3})), "ensemble.draws.start.heading", "between"),
    (Config(ensemble=Ensemble(draws={"start.heading": Between(1, 0)})), "ensemble.draws.start.heading", "low <= high"),
    (Config(ensemble=Ensemble(draws={"start.headin": Between(0, 1)})), "ensemble.draws", "did you mean start.heading"),
    (Config(ensemble=Ensemble(fresh=1)), "ensemble.fresh", "true or false"),
    (Config(ensemble=Ensemble(size=0)), "ensemble.size", "from 1"),
]


@pytest.mark.parametrize(("config", "key", "rule"), BAD, ids=[key for _, key, _ in BAD])
def test_a_bad_setting_of_python_is_named_with_its_value_and_rule(config, key, rule):
    ((named, fault),) = wrong(config).items()
    assert named == key and rule in fault.rule


def test_all_that_is_wrong_is_said_at_once_and_by_the_sweep_too():
    found = wrong(Config(seed=-1, tune=Tune(dt="fast", optimizer=3), simulate=Simulate(save_every=0)))
    assert set(found) == {"seed", "tune.dt", "tune.optimizer", "simulate.save_every"}
    swept = Config(sweep=Sweep(dt=5.0, metrics=("total_rmsee",), fails={"effort": Bound(value=-1.0)}, design="soble"))
    found = wrong(swept, sweep_rules.faults)
    assert {"sweep.fails.effort.value", "sweep.metrics", "sweep.design"} <= set(found)
    assert "sweep.dt" in wrong(Config(sweep=Sweep(dt=5.0)), sweep_rules.faults)


# ------------------------------------------------------------------------------------------------ control instants


def test_a_step_that_does_not_divide_the_control_interval_is_refused():
    for command, rules in (("tune", tune_rules.faults), ("sweep", sweep_rules.faults)):
        odd = {"simulate": Simulate(control_every=5), command: dataclasses.replace(getattr(Config(), command), dt=4e-3)}
        assert "simulate.control_every * simulate.dt = 0.005 s" in wrong(Config(**odd), rules)[f"{command}.dt"].rule
    config = check(Config(simulate=Simulate(control_every=20), tune=Tune(dt=5e-3), sweep=Sweep(dt=1e-2)))
    assert [config.timing(name).control_every for name in ("simulate", "tune", "sweep")] == [20, 4, 2]
    assert Config().timing("sweep").control_every == 1


def test_too_small_a_step_is_named_with_the_step_that_would_do():
    chain = {"position": agvjax.Chain(delay=agvjax.Delay(time=0.01))}
    scenario = agvjax.Scenario(actuators=chain)
    for dt, horizon, rule in ((5e-324, 12.0, "at least 1.2e-07 s"), (1e-3, 100_004.0, "at least 0.00100004 s")):
        (fault,) = timing_faults(Config(simulate=Simulate(dt=dt, horizon=horizon), scenario=scenario), "simulate")
        assert fault.key == "simulate.dt" and fault.rule.startswith(rule)


@pytest.mark.slow
def test_a_sweep_keeps_the_control_interval_of_the_runs(tmp_path):
    """A law that jumps at control instants is swept at the interval at which it is simulated: 20 ms, and not 10."""
    law, values = agvjax.FractionalBackstepping(), (0.5, 1.0)
    simulate = Simulate(control_every=20, horizon=2.0)
    over = ({"deadzone.position.threshold_right": Span(OneOf(values), 2)},)
    config = Config(controller=law, simulate=simulate, sweep=Sweep(over=over, metrics=("total_rmse",), shard=2))
    swept = run_sweep(config, tmp_path / "sweep").metrics["total_rmse"]
    batch = agvjax.batch(Scenario(), {"deadzone.position.threshold_right": np.array(values)})
    direct = {n: agvjax.evaluate(law, batch, dt=1e-2, n_steps=200, control_every=n).total_rmse for n in (1, 2)}
    np.testing.assert_allclose(swept[0], direct[2], rtol=1e-9)
    assert np.all(np.abs(direct[1] - direct[2]) > 1e-4)  # the interval matters


# ------------------------------------------------------------------------------------------------ written and read back

FLOATS = st.floats(1e-3, 1e3)
NUMBERS = FLOATS | FLOATS.map(np.float64) | FLOATS.map(lambda x: np.float32(x)) | st.integers(1, 100)
NUMBERS |= st.integers(1, 100).map(np.int64) | FLOATS.map(np.asarray)
PAIRS = st.tuples(FLOATS, FLOATS).map(sorted)
SOME = st.lists(FLOATS, min_size=1, max_size=4, unique=True).map(tuple)
DRAWN = st.one_of(
    PAIRS.map(lambda pair: Between(*pair)),
    PAIRS.map(lambda pair: Times(np.float64(pair[0]), pair[1])),
    SOME.map(OneOf),
    st.tuples(FLOATS, st.booleans()).map(lambda x: Distribution("norm", {"scale": x[0], "loc": 1}, x[1])),
)
SPANS = st.one_of(
    st.tuples(PAIRS, st.integers(0, 9)).map(lambda x: Span(Between(*x[0]), x[1])),
    SOME.map(lambda x: Span(OneOf(x), len(x))),
    SOME.map(lambda x: Span(OneOf(x))),
)
LEAVES = ("start.heading", "deadzone.position.slope_left", "disturbance.omega")
METRICS = ("effort", "peak_position", "peak_heading", "limited")
BELIEFS = NUMBERS | st.builds(agvjax.readings.KnownSlopes, right=FLOATS, left=FLOATS)
AXES = st.lists(NUMBERS, min_size=2, max_size=2).map(lambda x: np.array(x, float))
LAWS = st.one_of(
    st.builds(
        agvjax.NeuroBackstepping,
        k1=NUMBERS,
        Pi_hat=BELIEFS | AXES | AXES.map(jnp.asarray),
        Pi_psi_hat=BELIEFS,
        filter=st.sampled_from([agvjax.CommandFilter(), agvjax.NoFilter(), agvjax.readings.LiteralFilter()]),
        wrapped=st.booleans(),
    ),
    st.builds(agvjax.EventTriggered, inner=st.builds(agvjax.Backstepping, k1=NUMBERS, Pi_hat=BELIEFS)),
    st.builds(agvjax.FractionalBackstepping, lam=FLOATS.map(lambda x: x / 2e3)),
    st.sampled_from([agvjax.OSFC(), agvjax.ASMC(), agvjax.DFC(), agvjax.FTSMC(), agvjax.SuperTwistingFTSMC()]),
)
ELEMENTS = [("lag", agvjax.Lag(time_constant=1)), ("stop", agvjax.Saturation()), ("delay", agvjax.Delay())]
IN_ANY_ORDER = st.permutations(ELEMENTS).map(lambda parts: agvjax.Chain(**dict(parts)))
CHAINS = st.dictionaries(st.sampled_from(["position", "heading"]), IN_ANY_ORDER)
BENT = agvjax.Waypoints.through([[0.0, 0.0], [1.0, 0.5], [2.0, 0.0]], 0.5)
SCENES = st.builds(
    Scenario,
    actuators=CHAINS,
    deadzone=st.fixed_dictionaries({}, optional={"position": st.builds(agvjax.Deadzone, slope_left=NUMBERS)}),
    path=st.sampled_from([agvjax.Circle(radius=2), agvjax.Line(velocity=jnp.ones(2)), BENT]),
    heading=st.sampled_from([None, agvjax.Tangent()]),
    sensor=st.sampled_from([None, agvjax.Noise(position=0.01, seed=3)]),
    disturbance=st.sampled_from(
        [
            agvjax.NoDisturbance(),
            agvjax.Cosine(amplitude=np.array([0.1, 0.2, 0.3], np.float32)),
            agvjax.Recorded(times=np.array([0.0, 1.0]), values=np.zeros((2, 3))),
            agvjax.BandLimitedNoise(terms=7),
        ]
    ),
)
LIMITS = st.builds(Limit, mean=NUMBERS, absolute=st.booleans())
TUNES = st.builds(
    Tune,
    gains=st.sampled_from([None, ("k1",), ["k1", "k2"], ()]),
    tied=st.sampled_from([{}, {"k2": "k1"}, {"inner.k2": "inner.k1"}]),
    bounds=st.dictionaries(st.sampled_from(["k1", "inner.k2"]), PAIRS),
    goals=st.dictionaries(st.sampled_from(METRICS), st.builds(Weights, mean=NUMBERS)),
    limits=st.none() | st.dictionaries(st.sampled_from(METRICS), LIMITS),
    dt=NUMBERS,
    iterations=st.integers(1, 500),
    options=st.sampled_from([{}, {"b1": np.float64(0.5)}, {"nesterov": True, "momentum": 0.9}]),
    search=st.builds(Search, rounds=st.integers(0, 3)),
)
DRAWS = st.none() | st.dictionaries(st.sampled_from(LEAVES), DRAWN)
ENSEMBLES = st.builds(Ensemble, size=st.integers(1, 99), draws=DRAWS)
SWEEPS = st.builds(
    Sweep,
    over=st.none() | st.lists(st.dictionaries(st.sampled_from(LEAVES), SPANS, min_size=1)).map(tuple),
    metrics=st.sampled_from([None, ("effort",), ["effort", "limited"]]),
    fails=st.dictionaries(st.sampled_from(METRICS), st.builds(Bound, value=NUMBERS, absolute=st.booleans())),
    controllers=st.sampled_from([(), ["osfc"]]),
)
WORDS = st.sampled_from(["a", "b.c"]), st.sampled_from(["", "deg"])
COLUMNS = st.builds(Column, *WORDS, NUMBERS, st.just(""), st.just(()))
IDENTIFIES = st.builds(Identify, columns=st.dictionaries(st.sampled_from(["x", "heading"]), COLUMNS))
CONFIGS = st.builds(
    Config, controller=LAWS, scenario=SCENES, tune=TUNES, ensemble=ENSEMBLES, sweep=SWEEPS, identify=IDENTIFIES
)


def alike(one, other):
    """Whether two values are the same, an array as its list and a list as its tuple."""
    if dataclasses.is_dataclass(one):
        names = [field.name for field in dataclasses.fields(one)]
        return type(one) is type(other) and all(alike(getattr(one, n), getattr(other, n)) for n in names)
    if isinstance(one, dict):
        return set(one) == set(other) and all(alike(value, other[name]) for name, value in one.items())
    if isinstance(one, (tuple, list)):
        return len(one) == len(other) and all(alike(a, b) for a, b in zip(one, other, strict=True))
    return np.array_equal(one, other)


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(CONFIGS)
def test_what_is_written_is_read_back_to_the_same(config):
    text = dump(config)
    read = resolve(tomllib.loads(text), lambda config: [])
    for name, value in vars(config).items():
        for part in dataclasses.fields(value) if dataclasses.is_dataclass(value) else ():
            mine = getattr(value, part.name)
            if mine is not None:  # None is left open, and filled in by reading
                assert alike(mine, getattr(getattr(read, name), part.name)), part.name
    assert type(read.controller) is type(config.controller)
    orders = [[list(chain) for chain in each.scenario.actuators.values()] for each in (read, config)]
    assert orders[0] == orders[1]
    assert dump(resolve(tomllib.loads(text), lambda config: [])) == dump(read)


def test_correlated_draws_are_written_and_read_back():
    draws = {name: Distribution("norm", {"scale": 0.1}) for name in ("start.heading", "disturbance.amplitude")}
    tied = Correlation(tuple(draws), ((1.0, 0.5), (0.5, 1.0)))
    config = check(Config(ensemble=Ensemble(draws=draws, correlation=tied)))
    assert again(config).ensemble == config.ensemble and config.ensemble.correlation == tied


@agvjax.pytree
class Mine(agvjax.Law):
    """A law of one's own, of no file."""

    gain: float = agvjax.number(1.0, "1")


UNWRITABLE = [
    (Config(controller=Mine()), "controller", "of a class that TOML has a name for"),
    (Config(controller=agvjax.Sampled(inner=agvjax.EventTriggered())), "controller.inner", "has a name for"),
    (Config(scenario=Scenario.of(Boat())), "scenario.plant", "has a name for"),
    (Config(scenario=Scenario(actuators={"position": agvjax.Chain(mine=Mine())})), "scenario.actuators", "has a name"),
    (Config(tune=Tune(options={"decay": np.sin})), "tune.options.decay", "TOML has a word for"),
    (Config(simulate=Simulate(dt=-1.0)), "simulate.dt", "> 0"),
    (Config(sweep=Sweep(over=({"start.heading": Span(OneOf((1.0, 1.0)), 2)},))), "sweep.over", "list of values"),
]


@pytest.mark.parametrize(("config", "key", "rule"), UNWRITABLE, ids=[key for _, key, _ in UNWRITABLE])
def test_what_cannot_be_read_back_is_not_written(config, key, rule):
    with pytest.raises(InputError) as raised:
        dump(config)
    assert any(fault.key.startswith(key) and rule in fault.rule for fault in raised.value.faults), raised.value


def test_a_law_that_names_no_gains_is_written_and_read_back():
    config = load([], ["controller=event_triggered"])
    assert again(config).tune.gains == config.tune.gains


# ---------------------------------------------------------------------------------------------- keys that there were


def test_keys_of_earlier_files_are_read_where_they_hold_nothing():
    assert resolve({"tune": {"choices": {}}, "sweep": {"export": []}}).tune == load([]).tune
    for table, key, instead in (
        ({"tune": {"choices": {"controller.filter": ["command", "none"]}}}, "tune.choices", "loop of the shell"),
        ({"sweep": {"export": ["netcdf"]}}, "sweep.export", "to_xarray"),
    ):
        with pytest.raises(InputError) as raised:
            resolve(table)
        assert [fault.key for fault in raised.value.faults] == [key] and instead in str(raised.value)


def test_the_rules_may_still_be_named():
    with pytest.warns(DeprecationWarning, match="pass the rules"):
        assert load([], [], "simulate").tune == load([]).tune
    with pytest.warns(DeprecationWarning), pytest.raises(InputError, match="tune.gains"):
        load([], ['tune.gains=["nope"]'], "tune")


def test_the_goal_of_studies_the_preset_and_the_default_objective_are_one():
    config = load(["paper-goal"])
    assert config.tune.goals == WHOLE_ERROR
    assert requirements(config.tune, config.judged()).goals == Objective().goals


def test_late_errors_are_goals_of_runs_that_last_and_of_what_the_plant_has():
    late = {"rmse_late_x", "rmse_late_y", "rmse_late_heading"}
    assert set(load([]).tune.goals) == {"total_rmse", *late}
    assert set(load(["unicycle"]).tune.goals) == {"total_rmse", "rmse_late_x", "rmse_late_y"}
    assert set(load([], ["simulate.horizon=7"]).tune.goals) == {"total_rmse"}
    assert set(load([], ["tune.goals.effort=1"]).tune.goals) == {"effort"}


def test_from_when_on_an_error_is_late_and_what_has_settled_are_what_the_configuration_says():
    assert set(load([], ["criteria.late=6.5"]).tune.goals) == {"total_rmse"}  # 12 s are less than twice that
    config = load([], ["criteria.late=2", "criteria.band=0.1", "criteria.margin=0.5"])
    for criteria in (pose(config).tuner.objective.criteria, config.judged(delivered=True)):
        assert (float(criteria.late), criteria.band, criteria.margin) == (2.0, 0.1, 0.5)
    assert vars(load([]).judged()) == vars(agvjax.Criteria())
    with pytest.raises(InputError, match=r"criteria\.late = -1.0: must be finite and >= 0"):
        load([], ["criteria.late=-1"])
    with pytest.raises(InputError, match=r"criteria\.band = 0.0: must be finite and > 0"):
        load([], ["criteria.band=0"])


def test_what_is_asked_of_a_route_where_there_is_none_is_told_so():
    with pytest.raises(InputError, match=r"tune\.limits\.pace = .*: must be absent: it needs a route, and"):
        pose(load([], ["tune.limits.pace.mean=1"]))
