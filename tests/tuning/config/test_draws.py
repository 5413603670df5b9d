"""Draws as they are written: about the nominal value, element by element, by default; and keys in quotes."""

import dataclasses
import itertools

import numpy as np
import pytest

import agvjax
from agvjax import InputError
from agvjax.errors import Fault
from tuning import Between, Config, OneOf, Plus, Times, sample
from tuning.config import check, dump, load
from tuning.config.load import VEHICLES
from tuning.config.settings import Ensemble
from tuning.ensemble.draws import Usual, default_draws, uniform
from tuning.sweep import rules as sweep_rules
from tuning.sweep.design import design
from tuning.tune import rules as tune_rules

START = "start.position"
LEAF = "deadzone.position.threshold_right"


def drawn(scenario, draws, size=50):
    return {name: np.asarray(x) for name, x in sample(scenario, draws, size, 0).values.items()}


def at(x, y, heading=0.1):
    return agvjax.Scenario(start=agvjax.Start(position=np.array([x, y]), heading=heading))


def test_plus_is_added_to_the_nominal_value():
    shares = uniform(0, START, 50, 2)  # the random numbers themselves
    np.testing.assert_allclose(drawn(at(300.0, 200.0), {START: Plus(-0.5, 0.5)})[START], [300, 200] + shares - 0.5)
    each = Plus((-1.0, 0.0), (3.0, 0.0))
    np.testing.assert_allclose(drawn(at(300.0, 200.0), {START: each})[START] - [300, 200], shares * [4, 0] + [-1, 0])


@pytest.mark.parametrize("kind", [Between, Plus, Times])
def test_a_range_for_each_element_is_that_of_each_alone(kind):
    nominal, draw = np.array([2.0, 4.0]), kind((0.5, 1.0), (1.5, 3.0))
    for end, both in enumerate(draw.box(nominal)):
        assert both.tolist() == [float(draw.of(i).box(nominal[i])[end]) for i in (0, 1)]


def test_a_sweep_of_the_ensemble_draws_each_element_in_its_own_range():
    settings = ["sweep.ensemble=true", "sweep.over=[]", "sweep.samples=200"]
    config = load([], [*settings, "ensemble.draws={start.position={plus=[[0,1],[-3,-2]]}}"], sweep_rules.faults)
    values = design(config).values(0, 200)[START] - [-0.5, 0.5]
    assert np.all((values >= [0, -3]) & (values <= [1, -2])) and np.ptp(values, axis=0).min() > 0.9


@pytest.mark.parametrize("ranges", ["[[0,1]]", "[[0,1],[0,1],[0,1]]"])
def test_ranges_are_as_many_as_elements(ranges):
    with pytest.raises(InputError, match=rf"ensemble.draws.{START} = \d ranges: must be one range, or one for each"):
        load([], [f"ensemble.draws={{start.position={{plus={ranges}}}}}"], tune_rules.faults)
    with pytest.raises(InputError, match=r"sweep.over.start.position\[0\] = 2 ranges"):
        load([], ['sweep.over=[{"start.position[0]"={between=[[0,1],[0,1]]}}]'], sweep_rules.faults)


def test_the_default_start_is_drawn_where_the_start_is():
    there = {START: Between(-0.5, 0.5), "start.heading": Between(-0.5, 1.0)}
    elsewhere = {START: Plus(-0.5, 0.5), "start.heading": Plus(-0.75, 0.75)}
    for scenario, draws in ((at(-0.5, 0.5), there), (at(0.3, -0.3), there), (at(0.0, 0.6), elsewhere)):
        assert default_draws(start=scenario.start).items() >= draws.items()
    assert default_draws(start=at(0.0, 0.0, 3.0).start).items() >= elsewhere.items()
    assert default_draws().items() >= there.items()
    own = load([], ["scenario.path={type='waypoints', points=[[0.3, 0.3], [2, 1], [3, 4], [0, 5]], speed=0.5}"])
    assert {name: own.ensemble.draws[name] for name in elsewhere} == elsewhere  # not about the origin of its map


@pytest.mark.parametrize("name", ["base", "ackermann", "forklift"])
def test_presets_of_bases_draw_the_start_about_the_beginning_of_any_path(name):
    own = ["scenario.path.points=[[40, 30], [60, 30], [60, 50]]", "scenario.path.speed=0.5"]
    draws = load([name], own, note=[].append).ensemble.draws
    assert isinstance(draws[START], Plus) and isinstance(draws["start.heading"], Plus)


@pytest.mark.parametrize("name", VEHICLES)
def test_presets_draw_the_start_as_the_default_problem_does(name):
    assert load([name]).ensemble.draws[START] == Between(-0.5, 0.5)
    moved = load([name], ["scenario.start.position=[300.0, 200.0]"], tune_rules.faults)
    values = drawn(moved.scenario, {START: moved.ensemble.draws[START]})[START]
    assert np.abs(values - [300, 200]).max() <= 0.5
    assert "plus" in dump(moved) and 'position" = "default"' not in dump(
        moved
    )  # what a run folder holds is said in numbers


def test_a_leaf_without_a_default_draw_is_named():
    for config in (
        load([], ['ensemble.draws={path.amplitude="default"}']),
        check(Config(ensemble=Ensemble(draws={"path.amplitude": Usual()}))),
    ):
        assert [str(f) for f in tune_rules.faults(config)] == [
            "ensemble.draws.path.amplitude = default: must be a draw: this leaf has no default one"
        ]
    mixed = Ensemble(draws={START: Usual(), "path.amplitude": OneOf((1.0, 2.0))})
    assert check(Config(ensemble=mixed)).ensemble.draws[START] == Between(-0.5, 0.5)


@pytest.mark.parametrize(
    "draw",
    ['{distribution="lognorm",s=300.0}', f'{{distribution="lognorm",s=1{"0" * 310}}}', f"{{one_of=[1{'0' * 310}]}}"]
    + [f"{{between=[0,1{'0' * 310}]}}", '{distribution="norm",scale=1e308}', "{plus=[1,0]}", "{plus=[[[0,1]]]}"],
)
def test_a_draw_without_an_end_is_refused(draw):
    with pytest.raises(InputError, match=r"ensemble.draws.disturbance.omega = "):
        load([], [f"ensemble.draws={{disturbance.omega={draw}}}"])


# ------------------------------------------------------------------------------------------------------ keys, values


QUOTED = [f'"{LEAF}"', f"'{LEAF}'", LEAF, ' "deadzone" . position."threshold_right"']


@pytest.mark.parametrize(("first", "second"), list(itertools.permutations(QUOTED, 2)))
def test_a_later_setting_finds_an_earlier_one_in_quotes_or_not(first, second):
    settings = [f"ensemble.draws.{first}={{between=[0.1,0.2]}}", f'"ensemble"."draws".{second}.between=[0.3,0.4]']
    assert load([], settings).ensemble.draws == {LEAF: Between(0.3, 0.4)}
    bounds = load(["unicycle"], ["tune.bounds.'inner.k1'=[1,2]", "tune.bounds.inner.k1=[1,3]"]).tune.bounds
    assert bounds == {"inner.k1": (1.0, 3.0)}


@pytest.mark.parametrize("text", ['a"b=3', '="3', 'controller."k1=3', "controller..k1=3", "=3", "controller.=3", "k"])
def test_a_setting_that_is_no_key_and_value_is_refused(text):
    with pytest.raises(InputError, match=r"--set = .* must be key=value"):
        load([], [text])


def test_one_name_in_two_spellings_at_once_is_refused(tmp_path):
    file = tmp_path / "twice.toml"
    file.write_text(f'[ensemble.draws]\n"{LEAF}" = {{ between = [0, 1] }}\n{LEAF} = {{ between = [0, 2] }}\n')
    with pytest.raises(InputError, match=rf"ensemble.draws = {LEAF}: must be named once"):
        load([str(file)])


@pytest.mark.parametrize("settings", [["simulate=1", "simulate.dt=0.002"], ["simulate.dt=0.002", "simulate=1"]])
def test_a_section_that_is_no_table_is_refused_wherever_it_stands(settings):
    with pytest.raises(InputError, match=r"simulate = 1: must be a table"):
        load([], settings)


@pytest.mark.parametrize(
    "value", ["version=1.0", "version=true", "scenario.sensor.seed=0.5", "scenario.sensor.seed=1e300"]
)
def test_what_only_looks_like_a_whole_number_is_refused(value):
    with pytest.raises(InputError, match=value.split("=")[0]):
        load(["robot"], [value])


@pytest.mark.parametrize(
    "value", ["x" * 50_000, [1.0] * 20_000, 10**5000, {"a": "b" * 5000}], ids=["word", "list", "integer", "table"]
)
def test_a_bad_value_is_said_in_a_short_line(value):
    assert len(str(Fault("key", value, "a number"))) < 300
    deep = {}
    for _ in range(5000):
        deep = {"deeper": deep}
    assert len(str(Fault("key", deep, "a number"))) < 300


def test_values_of_another_shape_are_named_from_toml():
    for files, setting in (([], "scenario.start.position=0"), (["robot"], "scenario.plant.road_slope=0")):
        with pytest.raises(InputError, match=r"shape \(\): must be an array of shape \(2,\)"):
            load(files, [setting])
    for inner in ("osfc", "asmc", "dfc", "ftsmc", "super_twisting_ftsmc"):
        with pytest.raises(InputError, match=r"controller.inner = .*: must be a backstepping law"):
            load([], [f"controller={{type='fractional', inner='{inner}'}}"])


def test_drawn_seeds_may_be_any_number():
    config = load(["robot"], [], tune_rules.faults)
    assert config.ensemble.draws["sensor.seed"] == Between(0.0, 1e6)
    replayed = dataclasses.replace(config.scenario.sensor, seed=3.7)
    assert not agvjax.faults(replayed)
