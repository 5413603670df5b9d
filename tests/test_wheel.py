"""What users install: the wheel, built and unpacked beside everything else, away from the source tree."""

import json
import os
import re
import subprocess
import sys
import zipfile

import pytest

from commands import FAST, ROOT, arguments


def ran(command, cwd, **environment):
    done = subprocess.run(
        [str(word) for word in command],
        cwd=cwd,
        env={k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "XLA_FLAGS")} | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    ran([sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT], folder)  # of the source archive
    (file,) = folder.glob("agvjax-*.whl")
    return file


def test_a_package_index_would_take_the_archives(wheel):
    told = ran([sys.executable, "-m", "twine", "check", "--strict", *wheel.parent.iterdir()], wheel.parent)
    assert told.count("PASSED") == 2
    (version,) = re.findall(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(), re.M)
    assert wheel.name.startswith(f"agvjax-{version}-")


def test_the_wheel_holds_every_file_of_the_packages_and_no_other(wheel):
    packed = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    files = (path for package in ("agvjax", "tuning") for path in (ROOT / package).rglob("*") if path.is_file())
    ours = {path.relative_to(ROOT).as_posix() for path in files if "__pycache__" not in path.parts}
    assert packed == ours
    kinds = {name.rpartition(".")[2] for name in packed}
    assert {"py", "typed", "toml", "txt", "xml"} <= kinds  # presets, files of the exports, the robot


@pytest.mark.slow
def test_the_installed_wheel_runs_away_from_the_source_tree(wheel, tmp_path):
    home = tmp_path / "installed"
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--no-index", "--no-deps"]
    ran([*pip, "--no-compile", "--target", home, wheel], tmp_path)
    program = "import agvjax, tuning; print(agvjax.__file__); print(tuning.__file__)"
    where = ran([sys.executable, "-W", "error", "-c", program], tmp_path, PYTHONPATH=str(home)).split()
    assert where == [str(home / "agvjax/__init__.py"), str(home / "tuning/__init__.py")]
    agvjax = home / "bin" / "agvjax"
    assert "identify" in ran([agvjax, "--help"], tmp_path, PYTHONPATH=str(home))
    line = arguments("simulate", tmp_path / "run", [*FAST, "simulate.horizon=0.1"], "--config", "unicycle")
    ran([agvjax, *line], tmp_path, PYTHONPATH=str(home))
    assert json.loads((tmp_path / "run" / "metrics.json").read_text())
