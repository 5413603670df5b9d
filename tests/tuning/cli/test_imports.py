"""`--import FILE.py`: classes of one's own on the command line."""

import hashlib
import json
import tomllib

import numpy as np
import pytest

from commands import ROOT, arguments
from tuning.cli.main import main
from tuning.sweep import results

OWN = ROOT / "tests" / "data" / "own.py"
SCENE = ["scenario.plant=Omni", "scenario.path.type=Spiral", "scenario.path.growth=0.25", "scenario.heading=tangent"]
SETTINGS = [
    *SCENE,
    "controller=Spring",
    "simulate.horizon=2",
    "simulate.dt=0.01",
    "sweep.dt=0.01",
    "sweep.radius=false",
]


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    out = tmp_path_factory.mktemp("own") / "out"
    assert main([*arguments("simulate", out, SETTINGS), "--import", str(OWN), "--quiet"]) == 0
    return out


def test_a_vehicle_a_law_and_a_path_of_ones_own_are_simulated(simulated):
    with np.load(simulated / "trajectory.npz") as file:
        t, position, wanted = file["t"], file["position"], file["reference_position"]
    spiral = (1 + 0.25 * t)[:, None] * np.stack([np.cos(0.5 * t), np.sin(0.5 * t)], 1)
    np.testing.assert_allclose(wanted, spiral, atol=1e-12)
    assert np.linalg.norm(position - spiral, axis=1)[-1] < 0.5 * np.linalg.norm(position - spiral, axis=1)[0]


def test_the_run_names_the_file_and_is_repeated_with_it_only(simulated, tmp_path, capsys):
    table = tomllib.loads((simulated / "config.toml").read_text())
    assert table["imports"] == {"own.py": hashlib.sha256(OWN.read_bytes()).hexdigest()}
    again = ["simulate", "--config", str(simulated / "config.toml"), "--quiet", "--out"]
    assert main([*again, str(tmp_path / "same"), "--import", str(OWN)]) == 0
    for name in ("trajectory.npz", "config.toml", "metrics.json"):
        assert (tmp_path / "same" / name).read_bytes() == (simulated / name).read_bytes(), name
    (tmp_path / "own.py").write_text(OWN.read_text().replace("9.0", "5.0"))
    capsys.readouterr()
    for more in ([], ["--import", str(tmp_path / "own.py")]):
        assert main([*again, str(tmp_path / "none"), *more]) == 2
        said = capsys.readouterr().err
        assert table["imports"]["own.py"] in said and "--import own.py" in said
    assert not (tmp_path / "none").exists()


@pytest.mark.slow
def test_a_vehicle_of_a_sweep_of_ones_own_is_rolled_out_again(tmp_path):
    more = ["--over", "start.position[0]=-1:1:3", "--controller", "osfc", "--import", str(OWN), "--quiet"]
    assert main([*arguments("sweep", tmp_path / "swept", SETTINGS), *more]) == 0
    found = results.load(tmp_path / "swept", [str(OWN)])
    vehicle = ["--from", str(tmp_path / "swept"), "--index", "2", "--import", str(OWN), "--quiet"]
    assert main([*arguments("simulate", tmp_path / "out", ["simulate.dt=0.01"]), *vehicle]) == 0
    numbers = json.loads((tmp_path / "out" / "metrics.json").read_text())
    name = next(name for name in found.metrics if name.endswith("effort"))
    np.testing.assert_allclose(numbers["effort"], found.metrics[name][0, 2], rtol=1e-3)


@pytest.mark.parametrize(
    ("content", "words"), [(None, "readable"), ("raise OSError('no')", "line 1: OSError: no"), ("def", "SyntaxError")]
)
def test_a_file_that_cannot_be_executed_is_named(content, words, tmp_path, capsys):
    file = tmp_path / "wrong.py"
    if content is not None:
        file.write_text(content)
    assert main([*arguments("simulate", tmp_path / "out"), "--import", str(file)]) == 2
    said = capsys.readouterr().err
    assert str(file) in said and words in said and "Traceback" not in said
    assert not (tmp_path / "out").exists()
