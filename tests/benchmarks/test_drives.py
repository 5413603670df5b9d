"""The public drives that the benchmark reads: what is fetched is what was measured, and cut where it says."""

import hashlib
import tomllib

import numpy as np
import pytest

from benchmarks import drives
from tuning.io.logs import read

ROWS = "t,x\n" + "".join(f"{k},{k * k}\n" for k in range(20))


def listed(tmp_path, digest):
    (tmp_path / "from").mkdir()
    (tmp_path / "from" / "a.csv").write_text(ROWS)
    part = {"poses": {"file": "a.csv", "lines": [5, 9]}}
    return {"at": (tmp_path / "from").as_uri() + "/", "head": 1, "learned": part, "sha256": {"a.csv": digest}}


def test_a_file_is_fetched_once_checked_and_cut(tmp_path, monkeypatch):
    monkeypatch.setattr(drives, "KEPT", tmp_path / "kept")
    drive = listed(tmp_path, hashlib.sha256(ROWS.encode()).hexdigest())
    (stream,) = read(str(drives.folder("one", "learned", drive))).streams
    assert stream.topic == "poses"
    np.testing.assert_array_equal(stream.fields["x"], [16, 25, 36, 49])  # lines are counted from 0, the header's
    (tmp_path / "from" / "a.csv").unlink()
    assert drives.folder("one", "learned", drive).is_dir()


def test_another_file_is_refused_and_not_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(drives, "KEPT", tmp_path / "kept")
    with pytest.raises(ValueError, match=r"a\.csv is not the file that was measured"):
        drives.folder("one", "learned", listed(tmp_path, "0" * 64))
    assert not (tmp_path / "kept" / ("0" * 64)).exists()


def test_every_listed_drive_says_what_its_columns_are():
    for name, drive in tomllib.loads(drives.LISTED.read_text()).items():
        for part in ("learned", "unseen"):
            assert {source["file"] for source in drive[part].values()} <= set(drive["sha256"]), name
        assert {"x", "y", "heading"} < set(drive["columns"]), name


def test_what_share_of_its_speed_a_base_drives_is_told_apart_by_how_it_turns():
    """30 s straight on at all of .1 m/s, 30 s in a turn at .6 of it; a pose every third row."""
    t = np.arange(0.0, 60.0, 0.05)
    turning = t >= 30.0
    sent = np.column_stack([np.full(t.size, 0.1), np.where(turning, 0.5, 0.0)])
    heading = np.where(turning, 0.5 * (t - 30.0), 0.0) + 3.0
    speed = np.where(turning, 0.06, 0.1)
    x, y = (np.concatenate([[0.0], np.cumsum(0.05 * speed * turned(heading))[:-1]]) for turned in (np.cos, np.sin))
    pose = {"x": x, "y": y, "heading": (heading + np.pi) % (2 * np.pi) - np.pi}
    pose = {name: np.where(np.arange(t.size) % 3 == 0, value, np.nan) for name, value in pose.items()}
    np.testing.assert_allclose(drives.shares(t, pose, sent), [1.0, 0.6], rtol=0.01)
    assert np.isnan(drives.shares(t, pose, np.where(turning[:, None], sent, 0.0))[0])
