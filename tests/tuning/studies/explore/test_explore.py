"""The page without a browser: what is drawn against runs that are made here, and what its buttons do."""

import logging
import sys
import time
from collections import deque
from concurrent.futures import Future

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bokeh.document import Document

import agvjax
from commands import files_of
from tuning import default_draws, sample
from tuning.config import load
from tuning.studies.explore import table
from tuning.studies.explore.background import Desk
from tuning.studies.explore.page import Page
from tuning.studies.explore.rollout import VEHICLES, Rollouts
from tuning.studies.explore.sliders import movable

FAST = ["simulate.dt=0.01", "simulate.horizon=1", "simulate.integrator=euler", "tune.dt=0.01", "tune.integrator=euler"]
TIMES = {"dt": 0.01, "n_steps": 100, "integrator": agvjax.EULER}
RIGHT, LEFT = "deadzone.position.slope_right", "deadzone.position.slope_left"
FOUND = "import sys, pathlib; out = pathlib.Path(sys.argv[sys.argv.index('--out') + 1]); out.mkdir(); "


@pytest.fixture(scope="module")
def rollouts():
    config = load([], FAST)
    made = Rollouts(config, movable(config))
    made.ready()
    return made


@pytest.fixture
def desk(tmp_path):
    made = Desk(lambda: tmp_path, [sys.executable, "-c", "print('tuning\\r 3/9 best 0.5'); input()"], {})
    yield made
    made.close()


@pytest.fixture
def page(rollouts, desk):
    return Page(rollouts, desk)


def wait(page):
    page.tuning._process.wait(30)
    page.look()


def test_tuned_gains_come_first_each_within_what_it_may_be():
    sliders = movable(load([])).sliders
    assert [s.key for s in sliders[:7]] == [
        f"controller.{name}" for name in ("k1", "k2", "k3", "Lam", "Lam_psi", "omega_n", "zeta")
    ]
    k1, zeta = sliders[0], sliders[6]
    assert (k1.unit, k1.value, k1.log) == ("1/s", 20.0, True)
    np.testing.assert_allclose((k1.low, k1.high), (2.0, 200.0), rtol=2e-3)  # a decade either side
    assert 0.99 < zeta.high < 1 and sliders[2].low > 1 / 0.72  # eq. (70): of the paper's k3, whose decade begins lower
    assert {"deadzone.heading.threshold_left", "disturbance.amplitude", "start.heading"} <= {s.key for s in sliders}


def test_a_box_that_the_user_gave_is_the_sliders():
    s = movable(load([], ["tune.bounds.k1=[15.0, 22.0]"])).sliders[0]
    np.testing.assert_allclose((s.low, s.high), (15, 22), rtol=2e-3)


def test_what_is_the_same_moves_as_one_and_a_delay_no_further_than_its_slots():
    """Two wheels, four slots, a command each 0.05 s: 0.15 s."""
    sliders = {s.label: s for s in movable(load(["base"])).sliders}
    assert len(sliders["deadzone threshold of all"].names) == 4 and sliders["deadzone threshold of all"].unit == "m/s"
    delay = sliders["delay of all"]
    assert delay.names == ("actuators.left.delay.time", "actuators.right.delay.time")
    assert delay.low == 0 and delay.high == pytest.approx(0.15)
    apart = load(["base"], ["scenario.actuators.left.delay.time=0.06"])
    assert {"delay left", "delay right"} <= {s.label for s in movable(apart).sliders}


def test_a_delay_whose_slots_are_full_is_said_to_stay():
    config = load(["base"], [f"scenario.actuators.{side}={{delay={{time=0.0,slots=1}}}}" for side in ("left", "right")])
    moving = movable(config)
    assert not any("delay" in s.label for s in moving.sliders)
    assert any(text.startswith("actuators.left.delay.time") for text in moving.fixed)


def test_a_move_draws_what_a_run_with_these_numbers_is(page):
    page.handles["controller.k1"].value = np.log10(31.0)
    page.handles["deadzone.position.threshold_right"].value = 0.9
    page.handles["start.position[1]"].value = 0.25
    law, scenario = agvjax.NeuroBackstepping(k1=31.0), agvjax.Scenario()
    moved = {"deadzone.position.threshold_right": 0.9, "start.position": jnp.array([-0.5, 0.25])}
    run = agvjax.simulate(law, agvjax.replace(scenario, moved), **TIMES)
    drawn = page.source.data
    assert len(drawn["t"]) == 101 and not np.array_equal(drawn["position0"], page._before.data["position0"])
    np.testing.assert_allclose(np.stack([drawn["position0"], drawn["position1"]], 1), run.position, atol=1e-12)
    np.testing.assert_allclose(drawn["errors2"], agvjax.tracking_error(run)[:, 2], atol=1e-12)
    np.testing.assert_allclose(drawn["asked2"], run.command[:, 2], atol=1e-9)
    np.testing.assert_allclose(drawn["delivered1"], run.delivered[:, 1], atol=1e-9)
    assert page.shown.metrics["total_rmse"] == pytest.approx(float(agvjax.measure(run).total_rmse), rel=1e-9)


def test_the_ensemble_is_drawn_about_the_sliders(page):
    page.handles[RIGHT].value = np.log10(0.9)
    scenario = agvjax.replace(agvjax.Scenario(), {RIGHT: 0.9})
    batch = sample(scenario, default_draws(), VEHICLES, seed=0)
    assert 0.45 < np.min(batch.values[RIGHT]) and np.max(batch.values[RIGHT]) < 1.35
    every = agvjax.evaluate(agvjax.NeuroBackstepping(), batch, **TIMES)
    assert page.shown.mean["effort"] == pytest.approx(float(np.mean(every.effort)), rel=1e-9)
    assert page.shown.worst["effort"] == pytest.approx(float(np.max(every.effort)), rel=1e-9)


@pytest.mark.slow  # compiles for half a minute
def test_a_route_is_drawn_by_how_it_is_followed():
    config = load(
        ["base"], ["simulate.horizon=2", "criteria.late=1.0", "simulate.integrator=euler", "tune.integrator=euler"]
    )
    page = Page(Rollouts(config, movable(config)), None)
    page.handles["actuators.left.delay.time"].value = 0.12
    delays = {f"actuators.{side}.delay.time": 0.12 for side in ("left", "right")}
    scenario = agvjax.replace(config.scenario, delays)
    run = agvjax.simulate(config.controller, scenario, dt=0.005, n_steps=400, integrator=agvjax.EULER)
    np.testing.assert_allclose(page.source.data["errors0"], 1e3 * run.route.cross_track, atol=1e-6)
    np.testing.assert_allclose(page.source.data["errors1"], np.degrees(run.route.heading_error), atol=1e-6)
    assert "cross track late" in page.table.text and "of the time" in page.table.text


def test_nothing_is_compiled_by_a_move(page, caplog):
    page.reset()  # whatever NumPy and Bokeh do for the first time
    with jax.log_compiles(), caplog.at_level(logging.WARNING):
        for handle in page.handles.values():
            handle.value = handle.start + 0.3 * (handle.end - handle.start)
        assert "ompiling" not in caplog.text
        jax.jit(lambda x: x * 3.21)(jnp.ones(7))
        assert "ompiling" in caplog.text  # which is how it would be told


def test_gains_that_are_tied_follow():
    config = load([], [*FAST, 'tune.gains=["k1"]', 'tune.tied={k2="k1"}'])
    moving = movable(config)
    values = {s.key: s.value for s in moving.sliders} | {"controller.k1": 30.0}
    law = moving.placed(config, values).controller
    assert (float(law.k1), float(law.k2)) == (30.0, 30.0)
    assert "controller.k2" in moving.leaves and "controller.k2" not in values


def test_what_is_saved_is_what_was_drawn(page, tmp_path):
    page.handles["controller.Lam"].value = np.log10(25.0)
    page.handles["disturbance.amplitude"].value = 0.35
    page.save()
    assert files_of(tmp_path / "gains-1") == ["config.toml", "gains.toml"]
    with pytest.warns(UserWarning, match="what it leaves open is read from"):
        config = load([str(tmp_path / "gains-1" / "gains.toml")])
    assert float(config.controller.Lam) == pytest.approx(25.0) and config.scenario.disturbance.amplitude == 0.35
    run = agvjax.simulate(config.controller, config.scenario, **config.timing())
    np.testing.assert_allclose(page.source.data["position0"], run.position[:, 0], atol=1e-12)
    assert "gains-1/gains.toml" in page.banner.text
    page.save()
    assert (tmp_path / "gains-2" / "gains.toml").exists()


def test_what_cannot_be_saved_is_said_and_leaves_nothing(page, tmp_path):
    page.values["controller.zeta"] = -1.0
    page.save()
    assert "controller.zeta" in page.banner.text and drawn_bad(page) and not list(tmp_path.iterdir())
    page.reset()
    assert page.banner.text.endswith("></span>")


def drawn_bad(page):
    return "bold" in page.banner.text


def test_reset_is_the_configuration_to_the_last_digit(page):
    page.handles["controller.k2"].value += 0.2
    assert page.shown.metrics["effort"] != page.first.metrics["effort"]
    page.reset()
    np.testing.assert_equal(page.shown.metrics, page.first.metrics)
    assert page.values["controller.k2"] == 20.0


def test_a_table_that_comes_late_is_followed_by_that_of_the_last_move(rollouts, tmp_path, monkeypatch):
    """A browser's page: the second and third move are made while the first is judged."""
    document, todo, asked = Document(), deque(), []
    monkeypatch.setattr(document, "add_next_tick_callback", todo.append)
    monkeypatch.setattr(document, "add_timeout_callback", lambda function, wait: todo.append(function))
    monkeypatch.setattr(rollouts, "judging", lambda config: asked.append((config, Future())) or asked[-1][1])
    page = Page(rollouts, Desk(lambda: tmp_path, [], {}), document)
    drawn = []
    for k1 in (25.0, 31.0, 40.0):
        page.handles["controller.k1"].value = np.log10(k1)
        todo.popleft()()
        drawn.append(page.source.data["position0"])
        assert not todo and len(asked) == 1
    assert not np.array_equal(drawn[1], drawn[2])
    for k1 in (25.0, 40.0):
        config, answer = asked.pop(0)
        assert float(config.controller.k1) == pytest.approx(k1)
        answer.set_result(rollouts.judged(config))
        todo.popleft()()
        run = agvjax.evaluate(config.controller, config.scenario, **config.timing())
        assert page.shown.metrics["effort"] == pytest.approx(float(run.effort), rel=1e-9)
    assert not todo and not asked


def test_a_run_that_diverges_is_said_to_have(page):
    assert page.shown.ok and "This run diverged" not in page.table.text
    for key in (RIGHT, LEFT):
        page.handles[key].value = page.handles[key].end  # ten times the strength that the law believes in
    assert not page.shown.ok and "This run diverged" in page.table.text
    assert ">-<" in page.table.text  # no number of it
    page.reset()
    assert page.shown.ok and "This run diverged" not in page.table.text


def test_tuning_is_shown_can_be_stopped_and_leaves_the_sliders(rollouts, tmp_path):
    wait_for = "import time; print('looking\\r 3/9 best 0.5', end='', flush=True); time.sleep(60)"
    desk = Desk(lambda: tmp_path, [sys.executable, "-c", wait_for], {})
    page = Page(rollouts, desk)
    page.tune()
    assert page.buttons["tune"].label == "Stop tuning"
    for _ in range(200):
        page.look()
        if "3/9 best 0.5" in page.banner.text:
            break
        time.sleep(0.05)
    assert len(desk.running) == 1
    page.tune()  # the same button
    wait(page)
    assert "was stopped" in page.banner.text and not desk.running and page.buttons["tune"].label == "Tune from here"
    assert page.values["controller.k1"] == 20.0


def test_what_tuning_found_is_on_the_sliders(rollouts, tmp_path):
    write = FOUND + "(out / 'gains.toml').write_text('version = 1\\n[controller]\\nk1 = 2500.0\\nLam = 17.5\\n')"
    page = Page(rollouts, Desk(lambda: tmp_path, [sys.executable, "-c", write], {}))
    page.handles["controller.k1"].value = 1.5
    page.handles["disturbance.amplitude"].value = 0.3
    page.tune()
    wait(page)
    begun = load([str(tmp_path / "tune-1.toml")])
    assert float(begun.controller.k1) == pytest.approx(10**1.5) and begun.scenario.disturbance.amplitude == 0.3
    assert page.values["controller.k1"] == 2500.0 and page.values["controller.Lam"] == 17.5
    assert page.handles["controller.k1"].end >= np.log10(2500) and page.values["disturbance.amplitude"] == 0.3
    assert "tuned in" in page.banner.text and not drawn_bad(page)


def test_a_tuning_that_fails_says_why(rollouts, tmp_path):
    page = Page(rollouts, Desk(lambda: tmp_path, [sys.executable, "-c", "raise SystemExit('no such gain')"], {}))
    page.tune()
    wait(page)
    assert "the tuning failed" in page.banner.text or "no such gain" in page.banner.text
    assert drawn_bad(page) and page.values["controller.k1"] == 20.0


def test_the_table_begins_with_what_tuning_works_on():
    names = table.rows(load([], ["tune.goals={settling_time_x={mean=1.0}}"]))
    assert names[:4] == ["settling_time_x", "effort", "peak_position", "peak_heading"] and len(set(names)) == len(names)
    assert "cross_track" not in names
