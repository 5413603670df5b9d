"""A log and its model as a recording: by hand."""

from types import SimpleNamespace

import numpy as np

from tuning.cli.main import main
from tuning.identify.log import Log
from tuning.identify.overlay import overlay
from tuning.io.logs import read
from tuning.io.viewers import Asked, write_tracks


def logged():
    """Four rows, the third without a pose; the heading is the second channel of the model, the pose the others."""
    nan = np.nan
    pose = {"x": np.array([0.0, 1.0, nan, 3.0]), "y": np.array([0.0, 0.5, nan, 1.5]), "heading": np.full(4, 0.1)}
    pose["heading"][2] = nan
    log = Log("drive", 0.0, 0.1 * np.arange(4), np.array([[1.0], [2.0], [3.0], [4.0]]), ("speed",), pose)
    seen = np.array([[[1.0, 0.1, 0.5], [0.0, 0.0, 0.0], [3.0, 0.1, 1.5], [0.0, 0.0, 0.0]]])
    residual = np.array([[[0.3, 0.02, 0.4], [-2.0, -0.1, -1.0], [0.0, -0.01, 0.0], [9.0, 9.0, 9.0]]])
    weight = np.where(seen > 0, 1.0, 0.0)
    weight[0, 2] = 0.0  # an outlier
    segments = SimpleNamespace(
        live=np.array([[1.0, 1.0, 1.0, 1.0]]),
        rows=np.array([[1, 2, 3, -1]]),
        log=np.array([0]),
        seen=seen,
        weight=weight,
    )
    model = SimpleNamespace(channels=("x", "heading", "y"))
    return log, SimpleNamespace(segments=segments, model=model, sums=SimpleNamespace(residual=residual))


def test_the_model_is_what_was_measured_less_what_is_left_and_drawn_where_nothing_was_measured():
    log, fit = logged()
    tracks = overlay([log], fit)
    assert list(tracks) == ["measured", "model"]
    measured, model = tracks.values()
    np.testing.assert_allclose(measured.t, [0.0, 0.1, 0.3])
    np.testing.assert_allclose(measured.numbers["sent/speed"], [1.0, 2.0, 4.0])
    np.testing.assert_allclose(model.t, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(model.pose, [[0.7, 0.1, 0.08], [2.0, 1.0, 0.1], [3.0, 1.5, 0.11]])
    np.testing.assert_allclose(model.numbers["error/position"], [0.5, np.nan, np.nan])
    np.testing.assert_allclose(model.numbers["error/heading"], [0.02, np.nan, np.nan])


def test_both_are_read_back_from_the_file(tmp_path):
    log, fit = logged()
    file = tmp_path / "overlay.mcap"
    write_tracks(Asked(mcap=str(file)), overlay([log], fit))
    streams = {stream.topic: stream for stream in read(str(file)).streams}
    assert {"/measured/pose", "/measured/sent/speed", "/model/pose", "/model/error/position"} <= set(streams)
    np.testing.assert_allclose(streams["/model/pose"].fields["pose.position.x"], [0.7, 2.0, 3.0])
    np.testing.assert_allclose(streams["/measured/sent/speed"].fields["data"], [1.0, 2.0, 4.0])


def test_of_several_logs_each_has_a_number():
    log, fit = logged()
    assert list(overlay([log, log], fit)) == ["log1/measured", "log1/model", "log2/measured", "log2/model"]


def test_a_file_of_that_kind_needs_a_log(tmp_path, capsys):
    assert main(["identify", "--config", "base", "--mcap", str(tmp_path / "a.mcap"), "--out", str(tmp_path / "o")]) == 2
    assert "--mcap" in capsys.readouterr().err and not (tmp_path / "o").exists()
