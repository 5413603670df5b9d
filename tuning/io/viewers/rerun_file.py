"""Runs, and drives beside what a model makes of them, as recordings of Rerun.

Below `map` lie plan, reference and robot, below `error`, `asked` and `delivered` the numbers, over the seconds `t`; of
several runs each has its name behind that. The layout that the viewer opens with comes with the file.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

import numpy as np

from ..curves import Track
from .told import Run

if TYPE_CHECKING:
    from rerun import RecordingStream
    from rerun.blueprint import Blueprint

NEEDS = ("rerun",)
COLORS = ((31, 119, 180), (214, 39, 40), (44, 160, 44), (148, 103, 189))  # of runs, one after the other
GREY = (140, 140, 140)  # of what was asked for
ARROW = 0.05  # of the map's size, how long the robot is drawn
ABOVE = 0.002  # of the map's size, how far above the plan what was driven lies: it would flicker in it
HIGH = 1.2  # sizes of the map above it, from where one looks at it


class _Drawn(NamedTuple):
    """One run or track."""

    name: str
    track: Track
    wanted: np.ndarray | None  # pose of the reference (N, 3)

    def below(self, place: str) -> str:
        """Where something of it lies."""
        group, _, rest = place.partition("/")
        return "/".join(part for part in (group, self.name, rest) if part)


def write_runs(file: BinaryIO, runs: Mapping[str, Run]) -> None:
    """Write runs by name; that of a single run may be empty."""
    _write(file, [_Drawn(name, run.track, run.wanted) for name, run in runs.items()])


def write_tracks(file: BinaryIO, tracks: Mapping[str, Track]) -> None:
    """Write tracks by name."""
    _write(file, [_Drawn(name, track, None) for name, track in tracks.items()])


def _write(file: BinaryIO, drawn: list[_Drawn]) -> None:
    import rerun

    stream = rerun.RecordingStream("agvjax")
    made = stream.binary_stream()
    size = _size(drawn)
    stream.log("map", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for i, one in enumerate(drawn):
        _put(stream, one, i, size[1])
    stream.send_blueprint(_layout(drawn, *size))
    file.write(made.read(flush=True) or b"")


def _put(stream: RecordingStream, one: _Drawn, number: int, size: float) -> None:
    import rerun

    color, above = COLORS[number % len(COLORS)], (1 + number) * ABOVE * size
    track, robot = one.track, one.below("map/robot")
    times = [rerun.TimeColumn("t", duration=track.t)]
    place = np.column_stack([track.pose[:, :2], np.full(len(track.t), above)])
    turn = np.zeros((len(track.t), 4))
    turn[:, 2:] = np.column_stack([np.sin(track.pose[:, 2] / 2), np.cos(track.pose[:, 2] / 2)])
    stream.log(one.below("map/driven"), rerun.LineStrips3D([_there(place)], colors=[color]), static=True)
    arrow = rerun.Arrows3D(vectors=[[ARROW * size, 0, 0]], colors=[color], radii=[ARROW * size / 8])
    stream.log(robot, arrow, static=True)
    stream.send_columns(robot, times, rerun.Transform3D.columns(translation=place, quaternion=turn))
    if one.wanted is not None:
        wanted = np.column_stack([one.wanted[:, :2], np.zeros(len(track.t))])
        stream.log(one.below("map/plan"), rerun.LineStrips3D([_there(wanted)], colors=[GREY]), static=True)
        reference, look = one.below("map/reference"), rerun.Points3D.from_fields(colors=[GREY], radii=[size / 150])
        stream.log(reference, look, static=True)
        stream.send_columns(reference, times, rerun.Points3D.columns(positions=wanted))
    for topic, values in track.numbers.items():
        stream.log(one.below(topic), rerun.SeriesLines(names=[one.name or topic], colors=[color]), static=True)
        stream.send_columns(one.below(topic), times, rerun.Scalars.columns(scalars=np.asarray(values, float)))


def _layout(drawn: list[_Drawn], middle: np.ndarray, size: float) -> Blueprint:
    """The map from above beside a plot of every number, all runs in it."""
    import rerun.blueprint as layout

    above = layout.EyeControls3D(
        position=[*middle, HIGH * size], look_target=[*middle, 0.0], eye_up=[0.0, 1.0, 0.0], kind="Orbital"
    )
    places: dict[str, list[str]] = {}
    for one in drawn:
        for topic in one.track.numbers:
            unit = one.track.units.get(topic, "")
            places.setdefault(f"{topic} [{unit}]" if unit else topic, []).append(f"/{one.below(topic)}")
    plots = [layout.TimeSeriesView(contents=contents, name=topic) for topic, contents in places.items()]
    scene = layout.Spatial3DView(origin="map", name="map", eye_controls=above)
    parts = [scene, layout.Grid(*plots, grid_columns=2)] if plots else [scene]
    return layout.Blueprint(layout.Horizontal(*parts), collapse_panels=True)


def _there(places: np.ndarray) -> np.ndarray:
    """Places (N, 3) without those that are not finite: a line through these has no picture."""
    return places[np.isfinite(places).all(axis=1)]


def _size(drawn: list[_Drawn]) -> tuple[np.ndarray, float]:
    """Middle (2,) and size [m] of what is drawn."""
    places = np.concatenate([x[:, :2] for one in drawn for x in (one.track.pose, one.wanted) if x is not None])
    if not len(places := _there(places)):
        return np.zeros(2), 1.0
    low, high = places.min(axis=0), places.max(axis=0)
    return (low + high) / 2, max(float((high - low).max()), 1e-3)
