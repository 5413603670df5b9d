"""A folder has one process at a time, and none once that is gone, however it went."""

import subprocess
import sys

import pytest

from agvjax import InputError
from tuning.io import files
from tuning.io.alone import alone

HOLDER = """
import pathlib, sys, time
from tuning.io.alone import alone
with alone(pathlib.Path(sys.argv[1])):
    print("mine", flush=True)
    time.sleep(600)
"""


def test_a_second_process_is_refused_until_the_first_is_killed(tmp_path):
    first = subprocess.Popen([sys.executable, "-c", HOLDER, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    try:
        assert first.stdout is not None and first.stdout.readline() == "mine\n"
        with pytest.raises(InputError, match="no other process is at work") as refused, alone(tmp_path):
            pass
        assert str(tmp_path) in str(refused.value) and "--scheduler" in str(refused.value)
    finally:
        first.kill()
        first.communicate()
    for _ in range(2):  # and again, when it was given back
        with alone(tmp_path):
            assert files.empty(tmp_path)  # for a run to begin in


def test_one_process_does_not_have_a_folder_twice(tmp_path):
    with alone(tmp_path), pytest.raises(InputError), alone(tmp_path):
        pass


def test_what_is_no_folder_is_said(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OSError), alone(tmp_path / "file"):
        pass
