"""Margins of the linearised loop as limits of the tuning: against formulas, python-control and differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import Timing
from agvjax.linear import linearised
from agvjax.margins import at_instants, margins, tightest
from agvjax.metric_table import LONGEST, MOST, metrics_of
from commands import run
from mass import Spring, by_formula, mass
from tuning import Objective, Requirement, Tune
from tuning.config import load
from tuning.studies.margins import study
from tuning.tune.gains import Gains
from tuning.tune.tuner import Tuner

TIMING = Timing(dt=5e-3, n_steps=400)
JUDGED = agvjax.Criteria(late=1.0, loop=True, instants=2)


def found(law, scenario, timing=TIMING, count=2):
    return margins(linearised(law, scenario, timing=timing, first=1.0, count=count))


@pytest.mark.parametrize("delay, slope", [(0.0, 0.6), (0.1, 0.8)])
def test_margins_of_a_double_integrator_are_those_of_the_formula(delay, slope):
    m = found(Spring(), mass(delay, slope, 22))
    late = delay + TIMING.dt / 2  # half a step's hold
    _, phase, left = by_formula(4.0, 2.0, late, slope)
    np.testing.assert_allclose([m.phase_margin, m.delay_margin], [phase, left], rtol=5e-3)
    w = np.geomspace(0.3, 600, 2_000_000)
    L = slope * (4 + 2j * w) / (1j * w) ** 2 * np.exp(-1j * w * late)
    assert m.sensitivity == pytest.approx(1 / np.min(np.abs(1 + L)), rel=2e-2)
    if delay:  # without a delay half a turn is reached at half the sampling frequency alone
        turn = np.flatnonzero((np.imag(L[:-1]) < 0) & (np.imag(L[1:]) >= 0) & (np.real(L[1:]) < 0))[0]
        assert m.gain_margin == pytest.approx(1 / np.abs(L[turn]), rel=5e-3)


@pytest.mark.slow
def test_an_unstable_loop_and_a_run_of_which_nothing_is_known_bear_nothing():
    m = found(Spring(k=4.0, c=-1.0), mass())
    assert (m.gain_margin, m.phase_margin, m.delay_margin, m.sensitivity) == (0, 0, 0, MOST)
    nothing = at_instants(
        linearised(Spring(), agvjax.batch(mass(), {"limit": np.full(2, 1e9)}), timing=TIMING, first=1.0, count=2),
        np.array([[True, False], [False, False]]),
    )
    m = tightest(nothing)
    assert m.delay_margin[0] > 0.3 and m.delay_margin[1] == 0 and m.sensitivity[1] == MOST


def test_a_loop_whose_gain_stays_below_1_bears_the_longest_delay():
    m = found(Spring(k=1e-4, c=1e-2), mass())
    assert (m.delay_margin, m.phase_margin) == (LONGEST, pytest.approx(np.pi))


SLOPES = np.array([0.6, 0.9])  # of the deadzone, either side


def bears(law, slope):
    """The delay margin by the formula."""
    return by_formula(float(law.k), float(law.c), TIMING.dt / 2, slope)[2]


def tuner():
    batch = agvjax.batch(mass(), {f"deadzone.push.slope_{side}": SLOPES for side in ("right", "left")})
    objective = Objective(
        goals=(Requirement("rmse_x", "mean", 1.0),),
        limits=(Requirement("delay_margin", "worst", 0.5, absolute=True, least=True),),
        penalty=10.0,
        judged=JUDGED,
    )
    gains = Gains(("k", "c"), np.array([0.1, 0.1]), np.array([50.0, 50.0]))
    return Tuner(agvjax.check(Spring()), batch, gains, objective, Tune(gains=("k", "c"), iterations=40), TIMING)


@pytest.mark.slow
def test_slopes_beside_those_of_runs_are_those_of_the_formula():
    tuned = tuner()
    z = tuned.gains.coordinates(tuned.controller)
    values, ok, slopes = tuned.push(z, tuned.scenarios())
    assert values.shape == (2, 2) and slopes.shape == (2, 2, 2) and ok.all()
    np.testing.assert_allclose(values, tuned.roll(z, tuned.scenarios())[0], rtol=1e-6)

    def by_hand(z):
        law = tuned.gains.controller(jnp.asarray(z), tuned.controller)
        return np.array([-bears(law, slope) for slope in SLOPES])

    z, h = np.asarray(z), 1e-5
    np.testing.assert_allclose(values[1], by_hand(z), rtol=5e-3)
    wanted = [(by_hand(z + h * row) - by_hand(z - h * row)) / (2 * h) for row in np.eye(2)]
    np.testing.assert_allclose(slopes[:, 1], wanted, rtol=5e-2)


@pytest.mark.slow
@pytest.mark.usefixtures("promotion_as_optax_has_it")
def test_a_search_ends_on_the_limit_where_the_formula_has_it():
    """A stiffer spring is nearer to where it is to be, and bears less delay."""
    tuned = tuner()
    progress = tuned.begin()
    while not tuned.finished(progress):
        progress = tuned.advance(progress)
    assert progress.best[0] == 0
    assert min(bears(tuned.best(progress), slope) for slope in SLOPES) == pytest.approx(0.5, rel=1e-2)


@pytest.mark.parametrize(
    ("setting", "key"),
    [
        ("tune.limits.delay_margin=0.1", "tune.limits.delay_margin.least"),
        ("tune.goals={sensitivity=1.0}", "tune.goals.sensitivity"),
        ('tune.optimizer="cma"', "tune.optimizer"),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (
                ("tune.limits.delay_margin={worst=0.1,absolute=true}", "tune.limits.delay_margin.least"),
                ("margins.instants=100000", "margins.instants"),
                ('tune.optimizer="adam"', "tune.optimizer"),
            )
        ),
    ],
)
def test_what_a_margin_cannot_be_is_refused(setting, key, tmp_path):
    options = ["--set", "tune.limits.phase_margin={worst=0.3,absolute=true,least=true}", "--set", setting]
    _, said = run(["tune", "--config", "base", "--out", str(tmp_path / "out"), *options], 2)
    assert key in said and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "command", [("speed", "--within", "0.05"), pytest.param(("compare", "--deadzone"), marks=pytest.mark.slow)]
)
def test_commands_that_look_at_runs_alone_refuse_limits_on_the_loop(command, tmp_path):
    options = ["--set", "tune.limits.delay_margin={worst=0.1,absolute=true,least=true}"]
    _, said = run([*command, "--config", "base", "--out", str(tmp_path / "out"), *options], 2)
    assert "tune.limits.delay_margin" in said and not (tmp_path / "out").exists()


def test_values_of_other_metrics_are_refused_and_no_row_is_taken_for_another():
    objective = Objective(limits=(Requirement("delay_margin", "worst", 0.5, absolute=True, least=True),))
    with pytest.raises(ValueError, match="values of 2 metrics are needed"):
        objective.levels(jnp.ones((1, 3)), jnp.ones(3, bool), np.ones((3, 2)))


def test_a_run_alone_has_no_margins():
    config = load(["base"], [])
    assert "delay_margin" not in metrics_of(config.scenario)
    assert "delay_margin" in metrics_of(config.scenario, loop=True)
    run = agvjax.simulate(Spring(), mass(), **TIMING)
    with pytest.raises(ValueError, match="with_margins"):
        agvjax.measure(run)["delay_margin"]


@pytest.mark.slow
def test_margins_of_a_robot_are_those_of_python_control():
    config = load(["base"], ['controller.inner="path_pid"', "margins.vehicles=7", "margins.instants=4"])
    seen = study.study(config)
    m = margins(seen.loops)
    of_library = {name: seen.values(name) for name in ("gain", "phase", "delay", "sensitivity")}
    least = {n: np.nanmin(np.where(np.isnan(x), np.inf, x), axis=(1, 2)) for n, x in of_library.items()}
    peak = np.nanmax(np.where(np.isnan(of_library["sensitivity"]), 0, of_library["sensitivity"]), axis=(1, 2))
    np.testing.assert_allclose(m.delay_margin, least["delay"], rtol=5e-3)
    np.testing.assert_allclose(m.phase_margin, least["phase"], rtol=5e-3)
    np.testing.assert_allclose(m.gain_margin, least["gain"], rtol=2e-2)
    np.testing.assert_allclose(m.sensitivity, peak, rtol=2e-2)


@pytest.mark.slow
def test_at_single_precision_margins_are_nearly_the_same():
    config = load(["base"], ['controller.inner="path_pid"'])
    timing = config.timing("tune")
    with jax.enable_x64(False):
        narrow = margins(linearised(config.controller, config.scenario, timing=timing, first=4.0, count=2))
    wide = margins(linearised(config.controller, config.scenario, timing=timing, first=4.0, count=2))
    for name, value in vars(wide).items():
        assert getattr(narrow, name) == pytest.approx(value, rel=2e-2)
