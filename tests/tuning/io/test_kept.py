"""Parts of a run are read as they were written, to the last bit, and made once."""

import math
from typing import NamedTuple

import pytest

import agvjax
from tuning.io.kept import Kept


class Part(NamedTuple):
    """Fields of every kind that a part may have."""

    cost: float
    count: int
    z: tuple[float, ...]
    why: str = ""


MADE = {"first": Part(1 / 3, 2, (0.1 + 0.2, -1e-17)), "second": Part(math.inf, 0, (), "nothing could be tuned")}


def test_parts_are_read_as_they_were_written(tmp_path):
    folder = tmp_path / "parts"
    for name, part in MADE.items():
        Kept(folder, Part).keep(name, part)
    assert Kept(folder, Part).done == MADE
    assert sorted(path.name for path in folder.iterdir()) == ["first.json", "second.json"]


@pytest.mark.parametrize("spoilt", ["{", "[]", '{"cost": 1}'])
def test_a_file_that_is_not_whole_is_named(spoilt, tmp_path):
    Kept(tmp_path / "parts", Part).keep("first", MADE["first"])
    (tmp_path / "parts" / "first.json").write_text(spoilt)
    with pytest.raises(agvjax.InputError, match=r"--resume.*first\.json"):
        Kept(tmp_path / "parts", Part)


@pytest.mark.parametrize("folder", ["parts", None])
def test_a_part_is_made_once(folder, tmp_path):
    kept, calls = Kept(folder and tmp_path / folder, Part), []
    for _ in range(2):
        assert kept.once("first", lambda: calls.append(1) or MADE["first"]) == MADE["first"]
    assert calls == [1] and (folder is not None) == (tmp_path / "parts" / "first.json").exists()
