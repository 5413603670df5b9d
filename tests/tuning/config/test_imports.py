"""Classes of one's own from `--import FILE.py`: named in TOML, written with their file, never executed by a folder."""

import hashlib
import tomllib
from pathlib import Path

import pytest

from agvjax import InputError
from commands import ROOT
from tuning.config import dump, load
from tuning.config.load import resolve
from tuning.config.write import gains_table
from tuning.sweep import rules as sweep_rules
from tuning.tune import rules as tune_rules

OWN = str(ROOT / "tests" / "data" / "own.py")
DIGEST = hashlib.sha256(Path(OWN).read_bytes()).hexdigest()
OMNI = ["scenario.plant=Omni", "controller=Spring", "simulate.horizon=2", "simulate.dt=0.005"]
LAW = "import agvjax\n\n\n@agvjax.pytree\nclass {}(agvjax.Law):\n    gain: float = agvjax.number(2.0, '1/s')\n"


def written(folder, text, name="mine.py"):
    path = folder / name
    path.write_text(text)
    return str(path)


def refused(imports, *overrides):
    with pytest.raises(InputError) as raised:
        load([], overrides, imports=imports)
    return str(raised.value)


def test_a_class_of_each_kind_is_known_by_its_name_and_written_with_its_file():
    scene = "plant.R=0.3 path=Spiral heading.type=Upright heading.angle=0.5 disturbance=Gust sensor=Offset"
    wheel = "wheel_2.Wear.share=0.7 wheel_2.lag.time_constant=0.02 wheel_2.old.type=Wear"
    settings = [f"scenario.{setting}" for setting in scene.split()]
    settings += [f"scenario.actuators.{setting}" for setting in wheel.split()]
    config = load([], OMNI + settings, imports=[OWN])
    scenario = config.scenario
    kinds = [scenario.plant, scenario.path, scenario.heading, scenario.disturbance, scenario.sensor, config.controller]
    assert [type(x).__name__ for x in kinds] == ["Omni", "Spiral", "Upright", "Gust", "Offset", "Spring"]
    assert (scenario.plant.R, scenario.heading.angle) == (0.3, 0.5)
    chain = scenario.actuators["wheel_2"]
    assert list(chain) == ["Wear", "lag", "old"] and (chain["Wear"].share, chain["old"].share) == (0.7, 0.8)
    assert config.imports == {"own.py": DIGEST}
    table = tomllib.loads(dump(config))
    assert table["imports"] == {"own.py": DIGEST} and table["scenario"]["plant"]["type"] == "Omni"
    again = resolve(table, imports=[OWN])
    assert dump(again) == dump(config) and type(again.scenario.plant) is type(scenario.plant)
    gains = tomllib.loads(gains_table(config.controller))
    assert gains["imports"] == table["imports"] and gains["controller"]["type"] == "Spring"
    assert load([], ["controller.type=sampled", "controller.inner=Spring"], imports=[OWN]).controller.inner.kp == 9.0
    inside = ["scenario.plant=Omni", "controller.type=sampled", "controller.vehicle.type=Omni"]
    assert load([], [*inside, "controller.vehicle.R=0.1"], imports=[OWN]).controller.vehicle.R == 0.1


@pytest.mark.parametrize("preset", ["unicycle", "car", "robot"])
def test_a_law_of_ones_own_takes_the_place_of_a_presets(preset, tmp_path):
    (mine := tmp_path / "mine.toml").write_text('[controller]\ninner = { type = "Spring", kp = 3.0 }\n')
    assert load([preset, str(mine)], imports=[OWN]).controller.inner.kp == 3.0
    assert load([preset], ["controller.inner.k1=4"]).controller.inner.k1 == 4.0


def test_a_plant_with_three_actuators_is_a_problem_to_tune_and_to_sweep():
    wheels = ("wheel_1", "wheel_2", "wheel_3")
    config = load([], OMNI, tune_rules.faults, imports=[OWN])
    assert config.tune.gains == ("kp", "kd", "kpsi")
    assert {f"deadzone.{wheel}.slope_left" for wheel in wheels} <= set(config.ensemble.draws)
    assert "peak_heading" in config.tune.limits
    swept = load([], OMNI, sweep_rules.faults, imports=[OWN])
    assert set(swept.sweep.over[0]) == {"deadzone.wheel_1.slope_right", "deadzone.wheel_1.slope_left"}
    with pytest.raises(InputError, match="wheel_1, wheel_2, wheel_3"):
        load([], [*OMNI, "scenario.actuators.position.lag.time_constant=0.1"], imports=[OWN])


def test_who_reads_a_configuration_gives_its_files_again(tmp_path):
    file = written(tmp_path, LAW.format("Forgotten"))
    digest = hashlib.sha256(Path(file).read_bytes()).hexdigest()
    config = f'[imports]\n"mine.py" = "{digest}"\n\n[controller]\ntype = "Forgotten"\n'
    toml = written(tmp_path, config, "config.toml")
    with pytest.raises(InputError) as raised:
        load([toml])
    said = str(raised.value)
    assert "imports.mine.py" in said and digest in said and "give --import mine.py" in said
    other = written(tmp_path, LAW.format("Forgotten") + "# changed\n")
    with pytest.raises(InputError, match=f"give --import mine.py with this content; .* {'.' * 64}"):
        load([toml], imports=[other])
    assert load([toml], imports=[written(tmp_path, LAW.format("Forgotten"))]).controller.gain == 2.0


def test_a_folder_executes_nothing(tmp_path):
    """Whatever a configuration names: a file that lies beside it, or where it says, is not run."""
    mark = tmp_path / "executed"
    evil = written(tmp_path, f"open({str(mark)!r}, 'w')\n" + LAW.format("Evil"), "evil.py")
    digest = hashlib.sha256(Path(evil).read_bytes()).hexdigest()
    for name in ("evil.py", evil):
        toml = written(tmp_path, f'[imports]\n{name!r} = "{digest}"\n[controller]\ntype = "Evil"\n', "config.toml")
        with pytest.raises(InputError, match="give --import"):
            load([toml])
    for bad in ("imports = 3\n", "imports = ['evil.py']\n"):
        with pytest.raises(InputError, match="imports"):
            load([written(tmp_path, bad, "config.toml")])
    assert not mark.exists()


BAD = {
    "missing": (None, "a readable file"),
    "syntax": ("import agvjax\n\nclass A(:\n", "SyntaxError"),
    "raises": ("import agvjax\n\nraise RuntimeError('no')\n", "line 3: RuntimeError: no"),
    "bare": ("import agvjax\n\n\nclass Mine(agvjax.Law):\n    gain = 2.0\n", "@agvjax.pytree: Mine does not"),
    "open": (LAW.format("Mine").replace(" = agvjax.number(2.0, '1/s')", ""), "Mine.gain has none"),
    "built in": (LAW.format("Backstepping"), "Backstepping is built in"),
    "name": (LAW.format("backstepping"), "backstepping is built in"),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_file_that_brings_nothing_usable_is_named(kind, tmp_path):
    content, said = BAD[kind]
    path = str(tmp_path / "mine.py") if content is None else written(tmp_path, content)
    shown = refused([path])
    assert f"--import = {path}: must be" in shown and said in shown


def test_names_of_two_files_must_not_clash(tmp_path):
    (tmp_path / "other").mkdir()
    one, other = written(tmp_path, LAW.format("Twin")), written(tmp_path, LAW.format("Twin") + "#\n", "yours.py")
    assert "Twin" in refused([one, other])
    same = written(tmp_path / "other", LAW.format("Sibling"))
    assert "given twice" in refused([one, same])
    assert load([], imports=[one, one]).imports.keys() == {"mine.py"}
    helper = "class Base(agvjax.Law):\n    pass\n\n\n@agvjax.pytree\nclass Derived(Base):\n    k: float = 1.0\n"
    derived = written(tmp_path, "import agvjax\n\n\n" + helper, "derived.py")
    assert load([], ["controller=Derived"], imports=[derived]).controller.k == 1.0
    assert "controller.type = 'Base'" in refused([derived], "controller=Base")
