"""Moving pictures of runs: what is drawn where and when, read back from the artists and from the file."""

import io
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from PIL import Image

import agvjax
from agvjax.draw import animate
from commands import FAST, arguments
from tuning.cli import main as cli
from tuning.compute import compiled as startup
from tuning.io import files

TURNS = 2 * np.pi / 4  # rad/s: a lap of four seconds


def circling(seconds=4.0, samples=81, radius=1.0, late=0.1):
    """A run whose every number is known: on a circle, `late` rad behind its reference, heading along the circle."""
    t = np.linspace(0, seconds, samples)
    angle = TURNS * t
    place = radius * np.stack([np.cos(angle - late), np.sin(angle - late)], -1)
    target = np.stack([np.cos(angle), np.sin(angle)], -1)
    heading = np.angle(np.exp(1j * (angle - late + np.pi / 2)))  # wrapped: it jumps by 2 pi on the way
    return SimpleNamespace(t=t, position=place, heading=heading, reference_position=target)


def read(data):
    """Frames of a GIF as arrays, and how long each is shown [ms]."""
    frames, durations = [], []
    with Image.open(io.BytesIO(data)) as image:
        for k in range(image.n_frames):
            image.seek(k)
            frames.append(np.asarray(image.convert("RGB")))
            durations.append(image.info["duration"])
    return frames, durations


def written(animation):
    buffer = io.BytesIO()
    animate.write_gif(animation, buffer)
    return buffer.getvalue()


def middle_and_heading(animation, label):
    """Of the drawn vehicle, from its outline: the point halfway between tail and nose, and where the nose points."""
    corners = animation.vehicles[label].get_xy()[:5]
    tail, nose = (corners[0] + corners[4]) / 2, corners[2]
    return (tail + nose) / 2, np.arctan2(*(nose - tail)[::-1])


@pytest.mark.parametrize(("per_second", "speed", "seconds"), [(10, 1.0, None), (10, 2.0, 3.0), (30, 1.0, 1.0)])
def test_the_file_has_the_frames_and_the_duration_asked_for(per_second, speed, seconds):
    made = animate.animation({"run": circling()}, frames_per_second=per_second, speed=speed, seconds=seconds)
    frames, durations = read(written(made))
    playing = (seconds or 4.0) / speed
    assert len(frames) == made.frames == round(playing * per_second) + 1
    assert sum(durations) == pytest.approx(1000 * (playing + animate.PAUSE), abs=10)
    assert max(durations[:-1]) - min(durations[:-1]) <= 10  # ms, in which a GIF counts
    assert made.t[-1] == pytest.approx(seconds or 4.0)


def test_frames_differ_and_what_stands_still_does_not():
    frames, _ = read(written(animate.animation({"run": circling()}, frames_per_second=5)))
    assert all(np.any(a != b) for a, b in zip(frames, frames[1:], strict=False))
    still = np.all([frame == frames[0] for frame in frames], axis=(0, -1))
    assert still.mean() > 0.8
    assert np.array_equal(frames[0][-2:], frames[-1][-2:])  # the bottom edge, white


def test_a_vehicle_is_where_the_run_was_at_that_time():
    made = animate.animation({"run": circling(samples=801)}, frames_per_second=7)
    for k in (0, 5, 13, made.frames - 1):
        made.set(k)
        angle = TURNS * k / 7
        middle, heading = middle_and_heading(made, "run")
        np.testing.assert_allclose(middle, [np.cos(angle - 0.1), np.sin(angle - 0.1)], atol=1e-4)
        np.testing.assert_allclose(np.exp(1j * heading), np.exp(1j * (angle - 0.1 + np.pi / 2)), atol=1e-4)
        np.testing.assert_allclose(np.ravel(made.target.get_data()), [np.cos(angle), np.sin(angle)], atol=1e-4)
        np.testing.assert_allclose(np.transpose(made.traces["run"].get_data())[-1], middle, atol=1e-12)
        assert made.time.get_text() == f"t = {k / 7:.2f} s"
        assert made.distances["run"].get_text() == f"{100 * 2 * np.sin(0.05):.1f} cm"  # the chord of 0.1 rad


def test_a_heading_that_was_wrapped_is_not_turned_back():
    coarse = circling(samples=33)  # 11 degrees apart; a jump of 2 pi, interpolated, would point anywhere
    assert np.any(np.abs(np.diff(coarse.heading)) > np.pi)
    made = animate.animation({"run": coarse}, frames_per_second=20)
    for k in range(made.frames):
        made.set(k)
        expected = TURNS * k / 20 - 0.1 + np.pi / 2
        np.testing.assert_allclose(np.exp(1j * middle_and_heading(made, "run")[1]), np.exp(1j * expected), atol=1e-3)


def test_runs_of_different_sampling_and_end_are_drawn_together():
    made = animate.animation({"fine": circling(4.0, 401), "short": circling(2.0, 51, late=0.3)}, frames_per_second=10)
    assert made.frames == 41
    for frame, label, angle in ((10, "short", np.pi / 2 - 0.3), (40, "fine", -0.1), (40, "short", np.pi - 0.3)):
        made.set(frame)
        np.testing.assert_allclose(middle_and_heading(made, label)[0], [np.cos(angle), np.sin(angle)], atol=1e-3)


def test_every_run_is_in_the_picture_and_has_a_colour_of_its_own():
    made = animate.animation({str(i): circling(radius=1 + i / 12) for i in range(6)}, frames_per_second=2)
    assert not any(outside.any() for outside in made.outside.values())
    assert len({line.get_color() for line in made.traces.values()}) == 6
    assert made.axes.get_aspect() == 1


@pytest.mark.parametrize("last", [1e6, np.inf, np.nan])
def test_a_run_that_diverges_keeps_the_view_finite(last):
    lost = circling()
    lost.position = lost.position * np.geomspace(1, 1e6, 81)[:, None]
    lost.position[60:] = last
    made = animate.animation({"sound": circling(), "lost": lost}, frames_per_second=5)
    limits = np.array([made.axes.get_xlim(), made.axes.get_ylim()])
    assert np.all(np.isfinite(limits))
    assert np.all(np.diff(limits) <= 1.5 * 2 * (1 + 2 * animate.MARGIN) + 1e-9)  # the circle's box is 2 m wide
    made.set(0)
    assert "cm" in made.distances["lost"].get_text()
    made.set(made.frames - 1)
    assert made.distances["lost"].get_text() == "left the picture"
    assert "cm" in made.distances["sound"].get_text()
    assert len(read(written(made))[0]) == made.frames


def test_a_path_without_width_is_drawn():
    t = np.linspace(0, 1, 11)
    line = np.stack([t, 0 * t], -1)
    run = SimpleNamespace(t=t, position=line, heading=0 * t, reference_position=line)
    made = animate.animation({"run": run}, frames_per_second=5)
    assert np.ptp(made.axes.get_ylim()) > 0.3
    assert len(read(written(made))[0]) == 6


LOST = SimpleNamespace(**vars(circling()) | {"heading": np.full(81, np.nan)})


@pytest.mark.parametrize(
    ("runs", "options", "said"),
    [
        ({"run": circling()}, {"seconds": 0.0}, "seconds"),
        ({"run": circling()}, {"speed": -1.0}, "speed"),
        ({"run": circling()}, {"frames_per_second": 60}, "at most 50"),
        ({"run": circling()}, {"length": np.nan}, "length"),
        ({}, {}, "no runs"),
        ({"run": LOST}, {}, "no sample"),
    ],
)
def test_what_makes_no_picture_is_refused(runs, options, said):
    with pytest.raises(ValueError, match=said):
        animate.animation(runs, **options)


def test_a_notebook_plays_it():
    made = animate.animation({"run": circling()}, frames_per_second=2)
    assert made._repr_html_().startswith('<img src="data:image/gif')


@pytest.fixture
def command(monkeypatch, tmp_path):
    """`agvjax simulate --animate` in this process, the state of JAX left alone; returns its exit code and folder."""
    monkeypatch.setattr(startup, "keep_compiled", lambda: None)
    monkeypatch.setattr(agvjax, "tune_xla", lambda **_: "fast compiler options set")

    def call(*more):
        out = tmp_path / "out"
        try:
            return cli.main(arguments("simulate", out, FAST, "--animate", *more)), out
        finally:
            jax.config.update("jax_enable_x64", True)

    return call


def test_the_command_writes_a_picture_of_its_run(command, capsys):
    code, out = command("--quiet")
    said = capsys.readouterr()
    assert (code, said.out, said.err) == (0, "", "")
    frames, durations = read((out / "animation.gif").read_bytes())
    assert len(frames) == 21 and sum(durations) == 1000 + 1000 * animate.PAUSE
    assert not [path.name for path in out.iterdir() if path.name.endswith(".part")]


@pytest.mark.slow
def test_the_command_shows_how_far_it_is(command, capsys):
    code, out = command()
    said = capsys.readouterr()
    assert code == 0 and "21 frames" in said.err and (out / "animation.gif").exists()


@pytest.mark.parametrize("stop", [KeyboardInterrupt, OSError("disk full")])
@pytest.mark.parametrize("place", ["drawing", "writing"])
def test_an_interruption_leaves_no_half_picture(stop, place, command, monkeypatch, capsys):
    def fails(*_, **__):
        raise stop

    whole = files.write
    if place == "drawing":
        monkeypatch.setattr(animate.Animation, "draw", fails)
    else:

        def write(path, data):
            if path.suffix == ".gif":
                monkeypatch.setattr(files.os, "fsync", fails)
            whole(path, data)

        monkeypatch.setattr(files, "write", write)
    code, out = command("--quiet")
    assert code == (130 if stop is KeyboardInterrupt else 1)
    assert "Traceback" not in capsys.readouterr().err
    names = [path.name for path in out.iterdir()]
    assert "path.png" in names and not [name for name in names if "gif" in name]
