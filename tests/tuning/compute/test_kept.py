"""What is kept of what was compiled: whole or not there, and never from where others can write."""

import os
import stat

import numpy as np
import pytest

from commands import python
from tuning.compute.kept import Kept, private

pytestmark = pytest.mark.slow  # whole commands and programs, minutes in all


@pytest.fixture
def notes():
    return []


def test_what_was_kept_comes_back(tmp_path, notes):
    kept = Kept(tmp_path, notes.append)
    assert kept.get("a") is None
    for data in (b"", b"x", os.urandom(1000)):
        kept.put("a", data)
        assert kept.get("a") == data
    kept.drop("a")
    assert kept.get("a") is None and not notes


def test_every_damaged_bit_and_every_cut_is_seen(tmp_path, notes):
    kept, data = Kept(tmp_path, notes.append), b"a program"
    kept.put("a", data)
    whole = (tmp_path / "a").read_bytes()
    for bit in range(8 * len(whole)):
        bad = np.frombuffer(whole, np.uint8).copy()
        bad[bit // 8] ^= 1 << bit % 8
        (tmp_path / "a").write_bytes(bad.tobytes())
        assert kept.get("a") is None
        assert not (tmp_path / "a").exists()
    for end in range(len(whole)):
        (tmp_path / "a").write_bytes(whole[:end])
        assert kept.get("a") is None
    assert set(notes) == {f"files in {tmp_path.parent} were damaged: they are removed and made anew"}
    kept.put("a", data)
    assert kept.get("a") == data


def test_where_nothing_can_be_kept_it_is_said_once(tmp_path, notes):
    kept = Kept(tmp_path / "absent", notes.append)
    kept.put("a", b"x")
    kept.put("b", b"x")
    assert len(notes) == 1 and "nothing more can be kept" in notes[0]
    assert kept.get("a") is None


def test_a_folder_that_this_user_alone_can_write_is_used(tmp_path):
    before = os.umask(0o002)  # as where every user has a group
    try:
        assert private(tmp_path / "new" / "agvjax", "traces") == ""
    finally:
        os.umask(before)
    for folder in (tmp_path / "new" / "agvjax", tmp_path / "new" / "agvjax" / "traces"):
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        assert private(tmp_path / "new" / "agvjax", "traces") == ""


@pytest.mark.parametrize("below", [".", "traces"])
@pytest.mark.parametrize("mode", [0o770, 0o777, 0o702, 0o1777])
def test_a_folder_that_others_can_write_is_refused(mode, below, tmp_path):
    root = tmp_path / "agvjax"
    (root / "traces").mkdir(parents=True, mode=0o700)
    root.chmod(0o700)
    (root / below).chmod(mode)
    assert "other users can write" in private(root, "traces")


def test_a_folder_that_others_can_replace_is_refused(tmp_path):
    tmp_path.chmod(0o777)
    assert "anybody can rename" in private(tmp_path / "agvjax", "traces")
    tmp_path.chmod(0o1777)  # as /tmp is
    assert private(tmp_path / "agvjax", "traces") == ""


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_a_folder_of_another_user_is_refused(tmp_path):
    root = tmp_path / "agvjax"
    root.mkdir(mode=0o700)
    os.chown(root, 12345, 12345)
    assert "belongs to another user" in private(root, "traces")


def test_a_place_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "agvjax").write_text("a file")
    assert "cannot be written" in private(tmp_path / "agvjax", "traces")


PROGRAM = """
import warnings
warnings.simplefilter("error")
from tuning.compute import compiled
notes = []
compiled.listen(notes.append)
compiled.keep_compiled()
import jax, jax.numpy as jnp
print(float(jax.jit(lambda x: jnp.sin(x) * 3)(0.5)), float(jax.jit(lambda x: jnp.cos(x) * 2)(0.5)))
print(float(compiled.traced(lambda x: x * 3 + 1, "a line", jnp.float32(0))(jnp.float32(2.0))))
print(notes)
"""


def test_damaged_programs_and_traces_are_replaced_and_said_once(tmp_path):
    environment = {"XDG_CACHE_HOME": str(tmp_path)}
    cold = python(PROGRAM, **environment)
    assert cold.endswith("7.0\n[]\n")
    kept = {path: path.read_bytes() for path in tmp_path.rglob("*.bin")}
    assert {path.parent.name.split("-")[0] for path in kept} == {"traces", "programs"} and len(kept) > 3
    assert python(PROGRAM, **environment) == cold
    for i, (path, data) in enumerate(kept.items()):
        path.write_bytes((data[:100], b"", data[:-1], data + b"x", data[:50] + b"\0\1" + data[52:])[i % 5])
    damaged = python(PROGRAM, **environment)
    assert damaged.splitlines()[:2] == cold.splitlines()[:2]
    assert damaged.splitlines()[2].count("were damaged") == 1
    assert set(tmp_path.rglob("*.bin")) == set(kept)
    assert python(PROGRAM, **environment) == cold


@pytest.mark.parametrize("place", ["shared", "file", "none"])
def test_without_a_place_that_is_safe_nothing_is_kept_and_that_is_said_once(place, tmp_path):
    home = tmp_path / "home"
    home.mkdir()
    environment = {"XDG_CACHE_HOME": str(home)}
    if place == "shared":
        (home / "agvjax").mkdir()
        (home / "agvjax").chmod(0o777)
    elif place == "file":
        (home / "agvjax").touch()
    else:
        program = "import os; del os.environ['HOME'], os.environ['XDG_CACHE_HOME']; os.getuid = lambda: 54321\n"
        said = python(f"{program}{PROGRAM}")
        assert said.count("there is no home folder") == 1
        return
    said = python(PROGRAM, **environment)
    assert said.count("are not kept") == 1 and said.splitlines()[1] == "7.0"
    assert not list(home.rglob("*.bin"))
