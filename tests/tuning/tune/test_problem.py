"""Problems as a user poses them: any law, any subset of gains, requirements that can be kept and that cannot."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import EULER, RK4, Command, InputError, NeuroBackstepping
from laws import Proportional
from tuning import Between, Config, Distribution, Ensemble, Limit, Search, Simulate, Times, Tune, Weights, pose
from tuning import config as configuration
from tuning.io.kept import Kept
from tuning.tune.analysis import analyse, conflict
from tuning.tune.doctor import diagnose, first_bad, page
from tuning.tune.finer import judged
from tuning.tune.judge import unmet
from tuning.tune.pareto import Reached, front
from tuning.tune.problem import starts
from tuning.tune.rounds import Outcome, begin
from tuning.tune.rules import faults

TIMING = {"dt": 5e-3, "integrator": "euler"}
DRAWS = {"start.heading": Between(-0.5, 1.0), "deadzone.heading.slope_right": Times(0.5, 1.5)}
NO_SEARCH = Search(scouts=4, checks=0, starts=1, iterations=1)


pytestmark = pytest.mark.usefixtures("promotion_as_optax_has_it")


def problem(controller=None, draws=None, **tune):
    """Four scenarios of two seconds."""
    law = NeuroBackstepping() if controller is None else controller
    settings = {"gains": ("k3", "Lam_psi"), "search": NO_SEARCH, **TIMING}
    return Config(
        controller=law,
        simulate=Simulate(horizon=2.0, **TIMING),
        ensemble=Ensemble(size=4, validation_size=4, draws=DRAWS if draws is None else draws),
        tune=Tune(**(settings | tune)),
    )


def searched(config):
    """Tuned without the search for the worst scenario, whose compilation would take longest."""
    posed = pose(config)
    run = begin(posed)
    while not all(posed.tuner.finished(p) for p in run.searches):
        run = run._replace(searches=tuple(posed.tuner.advance_all(list(run.searches))))
    return Outcome(posed, run, posed.tuner.best(run.lead), [], ())


def tuned(config):
    outcome = searched(config)
    metrics = [judged(config, law, outcome.problem.tuner.batch) for law in (config.controller, outcome.controller)]
    return outcome, unmet(outcome.problem, *metrics)


# ---------------------------------------------------------------------------------------------------------- any law


def test_a_law_of_the_users_own_is_tuned():
    law = Proportional()
    config = problem(law, gains=("stiffness", "damping", "turn"), limits={"effort": Limit(mean=1.2)}, iterations=15)
    outcome, over = tuned(config)
    assert over == [] and outcome.progress.best[1] < 0.997 * 1.3
    assert outcome.controller.lean == law.lean and outcome.controller.turn != law.turn
    assert configuration.gains_table(outcome.controller).count("\n") >= 5


def test_a_gain_without_bounds_may_change_its_sign():
    free = pose(problem(Proportional(), gains=("turn", "lean"), bounds={"lean": (-np.inf, np.inf)})).tuner.gains
    z = free.coordinates(Proportional())
    moved = free.controller(z.at[1].add(0.5), Proportional())
    np.testing.assert_allclose([moved.lean, moved.turn], [0.4, 4.0], rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", "Backstepping FullWeightBackstepping OSFC ASMC DFC FTSMC SuperTwistingFTSMC".split())
def test_every_law_of_the_package_is_tuned_out_of_the_box(name):
    config, law = configuration.load([], [], faults), getattr(agvjax, name)()
    names = law.gains_to_tune()
    ensemble = dataclasses.replace(config.ensemble, size=16, validation_size=4)
    limits = {name: Limit(mean=1.05, worst=1.05) for name in config.tune.limits}
    tune = dataclasses.replace(config.tune, gains=names, limits=limits, iterations=40, search=NO_SEARCH)
    outcome, over = tuned(dataclasses.replace(config, controller=law, ensemble=ensemble, tune=tune))
    assert over == [] and outcome.progress.best[1] < 1.3 * 0.995


# --------------------------------------------------------------------------------------------------------- the gains


@pytest.mark.slow
def test_tied_gains_keep_their_ratio():
    law = NeuroBackstepping(k1=18.0, k2=27.0)
    outcome, _ = tuned(problem(law, gains=("k1", "k3"), tied={"k2": "k1"}, limits={}, iterations=3))
    assert abs(outcome.controller.k1 - 18.0) > 0.1
    np.testing.assert_allclose(outcome.controller.k2 / outcome.controller.k1, 1.5, rtol=1e-12)


def test_what_a_tied_gain_must_exceed_binds_the_one_it_follows():
    config = problem(NeuroBackstepping(k1=18.0, k2=9.0), gains=("k1",), tied={"k2": "k1"}, bounds={"k2": (6.0, 12.0)})
    free = pose(config).tuner.gains
    assert (free.lower[0], free.upper[0]) == (12.0, 24.0)


def test_a_margin_multiplies_the_stability_conditions():
    draws = {"deadzone.heading.slope_right": Times(0.5, 1.5), "deadzone.position.slope_left": Times(0.5, 1.5)}
    names = ("k1", "k2", "k3")
    plain, double = (pose(problem(draws=draws, gains=names, stability_margin=m)) for m in (1.0, 2.0))
    np.testing.assert_allclose(double.tuner.gains.lower, 2 * plain.tuner.gains.lower, rtol=1e-14)
    np.testing.assert_allclose(plain.tuner.gains.lower, [1.0, 1.25, 0.5 / 0.455], rtol=1e-12)


def test_a_sample_rate_bounds_the_filter():
    fast = pose(problem(NeuroBackstepping(omega_n=60.0), gains=("omega_n",), sample_rate=40.0, integrator="rk4"))
    limit = fast.tuner.gains.upper[0]
    least = min(RK4.stable_step(np.roots([1.0, 2 * z * limit, limit**2])) for z in np.linspace(0.05, 1, 20))
    np.testing.assert_allclose(least, 1 / 40, rtol=1e-3)
    with pytest.raises(InputError, match="controller.omega_n"):
        pose(problem(gains=("omega_n",), sample_rate=40.0, integrator="euler"))


@pytest.mark.slow
def test_several_starts_go_as_one_batch_and_the_best_is_taken():
    config = problem(starts=3, spread=1.5, iterations=8)
    posed = pose(config)
    points = starts(posed)
    assert len(points) == 3
    assert np.all(np.abs(np.asarray(points[1:]) - np.asarray(points[0])) <= np.log(1.5) + 1e-12)
    outcome = searched(config)
    assert outcome.run.lead.best == min(p.best for p in outcome.run.searches)
    alone = searched(problem(iterations=8))
    # a start knows nothing of the others
    np.testing.assert_allclose(outcome.run.searches[0].best[1], alone.progress.best[1], rtol=1e-6)
    assert outcome.run.total("rollouts") == sum(3 * p.iteration for p in outcome.run.searches)


# -------------------------------------------------------------------------------------------------------- requirements


@pytest.mark.slow
def test_hard_limits_are_met_or_said_with_their_conflict():
    limits = {"rms_command_heading": Limit(mean=0.8, worst=0.8), "rmse_heading": Limit(mean=0.9)}
    outcome, over = tuned(problem(limits=limits, goals={"total_rmse": Weights(mean=1.0)}, iterations=60))
    assert over and any("above its limit" in line for line in over)
    names = {r.name for r, _, price in conflict(outcome.problem.tuner, outcome.progress.best_z) if price > 1e-6}
    assert "mean rmse_heading" in names and {"mean rms_command_heading", "worst rms_command_heading"} & names


@pytest.mark.slow
@pytest.mark.parametrize("goal", [{"worst": 1.0}, {"cvar": 1.0}, {"mean": 1.0, "cvar": 0.5}])
def test_goals_of_every_kind_go_down_within_absolute_limits(goal):
    metric = {"total_rmse": Weights(**goal)}
    start = problem(goals=metric, limits={})
    peak = float(judged(start, start.controller, pose(start).tuner.batch).peak_heading.max())
    limits = {"peak_heading": Limit(worst=1.05 * peak, absolute=True)}
    outcome, over = tuned(problem(goals=metric, limits=limits, iterations=15))
    assert over == [] and outcome.progress.best[1] < 0.997 * sum(goal.values())
    reached = judged(start, outcome.controller, outcome.problem.tuner.batch).peak_heading.max()
    assert reached <= 1.001 * 1.05 * peak


@pytest.mark.slow
def test_a_settling_time_can_be_asked_for():
    law = NeuroBackstepping(Lam_psi=40.0)
    config = problem(law, goals={"rms_command_heading": Weights(mean=1.0)}, limits={}, iterations=40)
    config = dataclasses.replace(config, simulate=dataclasses.replace(config.simulate, horizon=4.0))
    first = judged(config, config.controller, pose(config).tuner.batch).settling_time[:, 2]
    assert np.all(np.isfinite(first))
    wanted = 0.7 * float(first.max())
    tune = dataclasses.replace(config.tune, limits={"settling_time_heading": Limit(worst=wanted, absolute=True)})
    outcome, over = tuned(dataclasses.replace(config, tune=tune))
    assert over == []
    reached = judged(config, outcome.controller, outcome.problem.tuner.batch).settling_time[:, 2]
    assert reached.max() <= 1.001 * wanted


def test_draws_that_break_a_rule_are_named():
    draws = {"deadzone.heading.slope_right": Distribution("norm", {"loc": 0.1, "scale": 0.2})}
    with pytest.raises(InputError, match=r"ensemble.draws.deadzone.heading.slope_right = -.*must be finite and > 0"):
        pose(problem(draws=draws))


# ---------------------------------------------------------------------------------------------------------- learning


@pytest.mark.slow
def test_what_is_learned_agrees_with_differences():
    posed = pose(problem(iterations=1))
    tuner, z = posed.tuner, posed.tuner.begin().z + 0.1
    standings = analyse(tuner, z).standings
    gains = np.array(tuner.gains.values(z, tuner.controller))

    def levels(factors):
        law = agvjax.replace(tuner.controller, dict(zip(tuner.gains.names, gains * factors, strict=True)))
        return np.asarray(tuner.weigh(*tuner.push(tuner.gains.coordinates(law), tuner.scenarios()))[0].levels)

    for k, share in enumerate(1e-5 * np.eye(2)):
        slope = (levels(1 + share) - levels(1 - share)) / 2e-5 / np.array([s.level for s in standings])
        np.testing.assert_allclose([s.slopes[k] for s in standings], slope, rtol=2e-3, atol=2e-4)


@pytest.mark.slow
def test_gains_that_do_the_same_are_named_alike():
    """A law in which two gains only enter as their product."""

    @agvjax.pytree
    class Twice(Proportional):
        again: float = 1.0

        def law(self, flow, memory, measurement, reference):
            both = dataclasses.replace(self, turn=self.turn * self.again)
            return Proportional.law(both, flow, memory, measurement, reference)

    posed = pose(problem(Twice(), gains=("turn", "again", "damping"), iterations=1))
    found = analyse(posed.tuner, posed.tuner.begin().z).identifiability
    assert [(i, j) for i, j, _ in found.alike] == [(1, 0)] and found.strength[-1] < 1e-6 * found.strength[0]
    np.testing.assert_allclose(np.abs(found.weakest), [0.5**0.5, 0.5**0.5, 0.0], atol=1e-4)


@pytest.mark.slow
def test_more_command_buys_less_error(tmp_path):
    posed, factors = pose(problem(iterations=12)), [0.95, 1.0, 1.1]

    def stopped(point):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        front(posed, "effort", factors, stopped, Kept(tmp_path / "points", Reached))
    points = front(posed, "effort", factors, kept=Kept(tmp_path / "points", Reached))
    assert points[1].gains == front(posed, "effort", factors[1:2])[0].gains  # that which was kept, and was begun from
    met = [p for p in points if p.met]
    assert len(met) >= 2 and [p.factor for p in points] == [0.95, 1.0, 1.1]
    goals = np.array([p.goal for p in met])
    assert np.all(goals[1:] <= goals[:-1] * (1 + 1e-3)) and goals[-1] < goals[0]


# ------------------------------------------------------------------------------------------------------------ doctor


def test_a_sound_problem_is_found_sound():
    found = diagnose(pose(problem()).tuner)
    assert found.healthy and found.diverged == 0 and "can be trusted" in page(found)
    verdicts = [s.verdict for s in found.slopes]
    assert set(verdicts) <= {"agree", "kink"} and verdicts.count("agree") >= 12


@jax.custom_jvp
def wrong_slope(x):
    return x


wrong_slope.defjvp(lambda x, dx: (x[0], 1.5 * dx[0]))


@agvjax.pytree
class Misled(Proportional):
    """Its derivative is not its own."""

    def law(self, flow, memory, measurement, reference):
        misled = dataclasses.replace(self, turn=wrong_slope(self.turn))
        return Proportional.law(misled, flow, memory, measurement, reference)


def test_a_wrong_gradient_is_found():
    found = diagnose(pose(problem(Misled(), gains=("turn", "damping"))).tuner)
    assert not found.healthy
    assert {s.gain for s in found.slopes if s.verdict == "DISAGREE"} == {"turn"}
    assert "Do not trust" in page(found)


@pytest.mark.slow
def test_the_first_step_without_a_finite_slope_is_named():
    @agvjax.pytree
    class Root(Proportional):
        def law(self, flow, memory, measurement, reference):
            command, rate = Proportional.law(self, flow, memory, measurement, reference)
            far = jnp.sqrt(jnp.maximum(jnp.sum((measurement.position - reference.position) ** 2) - 0.01, 0.0))
            return Command(position=command.position - 0.1 * self.damping * far, heading=command.heading), rate

    tuner = pose(problem(Root(), gains=("damping",))).tuner
    found = first_bad(tuner, 0)
    assert found is not None and "slope in damping" in found.what and 0 < found.step < 400
    # by an independent look at the run: at that step the distance is inside .1 m for the first time
    run = agvjax.simulate(Root(), tuner.batch[0], dt=5e-3, n_steps=400, integrator=EULER)
    far = np.linalg.norm(np.asarray(run.position - run.reference_position), axis=1)
    assert abs(found.step - int(np.argmax(far < 0.1))) <= 1
    assert not diagnose(tuner).healthy


@pytest.mark.slow
def test_a_run_that_diverges_is_named_with_its_step():
    starts_beyond = {"start.position": Between(0.0, 2000.0)}
    found = diagnose(pose(problem(draws=starts_beyond)).tuner)
    assert found.diverged >= 1 and found.sick[0].step == 0 and "scenario.limit" in found.sick[0].what


OPTIONS = {
    "noisy_sgd": ({}, "tune.optimizer"),  # its state is a key of random numbers
    "adam": ({"b1": float("nan")}, "tune.options.b1"),
    "adamw": ({"b2": 2.0}, "tune.options.b2"),
    "nadam": ({"b2": 1.0}, "tune.options.b2"),
    "adabelief": ({"eps": -1.0}, "tune.options.eps"),
    "rmsprop": ({"decay": -0.1}, "tune.options.decay"),
    "sgd": ({"momentum": float("inf")}, "tune.options.momentum"),
    "prodigy": ({"betas": [0.9, 1.5]}, "tune.options.betas"),
    "lion": ({"mu_dtype": "bfloat16"}, "tune.optimizer"),  # which no .npz file can hold
    "lbfgs": ({"memory_size": 0}, "tune.options.memory_size"),
    "sign_sgd": ({"nonsense": 1.0}, "tune.optimizer"),
}


@pytest.mark.filterwarnings("ignore:Specifying a key:UserWarning")  # of noisy_sgd
@pytest.mark.parametrize("name", OPTIONS)
def test_an_optimiser_or_an_option_that_cannot_work_is_refused(name):
    options, key = OPTIONS[name]
    with pytest.raises(InputError) as refusal:
        configuration.check(problem(optimizer=name, options=options), faults)
    assert [fault.key for fault in refusal.value.faults] == [key]


@pytest.mark.parametrize("name", ["adam", "adamw", "sgd", "lion", "rmsprop", "lbfgs", "adabelief", "prodigy"])
def test_optimisers_whose_state_can_be_kept_are_accepted(name):
    configuration.check(problem(optimizer=name), faults)
