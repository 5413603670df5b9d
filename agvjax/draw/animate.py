"""Moving pictures of trajectories, as GIF. With `plot` the only modules that import matplotlib; it shows nothing."""

from __future__ import annotations

import base64
import io
import itertools
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image  # matplotlib brings it

from .plot import ALONE, STYLES, shown

WIDTH, DPI = 4.8, 80  # in; 384 pixels
ROW = 0.19  # in, a line of the legend above the picture
COLOURS = (*(style["color"] for style in STYLES), "#009e73", "#cc79a7", "#56b4e9")  # told apart by the colour-blind too
ROOM = 0.25  # how far beyond the path's box the picture may reach, in its larger side: 1.5 times a square box
MARGIN = 0.06  # around all that is shown, of its larger side
FINE = 2000  # points of a trace, at least
PAUSE = 1.0  # s, before it begins again
SHADES = 64  # colours of a GIF


class Track:
    """A run at equally spaced instants t (K,) [s]: position and reference_position (K, 2) [m], heading (K,) [rad]."""

    def __init__(self, run: Any, t: np.ndarray):
        own, position, target = (shown(x) for x in (run.t, run.position, run.reference_position))
        heading = shown(run.heading)
        sound = np.isfinite(position).all(-1) & np.isfinite(heading) & np.isfinite(target).all(-1)
        if not sound.any():
            raise ValueError("a run has no sample that is finite")
        own, position, target = own[sound], position[sound], target[sound]
        self.position = np.stack([np.interp(t, own, x) for x in position.T], -1)
        self.reference_position = np.stack([np.interp(t, own, x) for x in target.T], -1)
        self.heading = np.interp(t, own, np.unwrap(heading[sound]))
        self.distance = np.hypot(*(self.position - self.reference_position).T)  # m


class Animation:
    """What is drawn, frame by frame: `draw(k)` for k < `frames`, at times `t` [s]; see `animation`."""

    def __init__(self, runs: Mapping[str, Any], t: np.ndarray, fine: int, per_second: float, length: float | None):
        self.t, self.fine, self.frames_per_second = t[::fine], fine, per_second
        self.tracks = {label: Track(run, t) for label, run in runs.items()}
        self.path = _finite(shown(next(iter(runs.values())).reference_position))
        self.low, self.high = _view(self.path, self.tracks.values())
        self.length = 0.07 * float(np.max(self.high - self.low)) if length is None else length
        self.outside = {label: _outside(track.position, self.low, self.high) for label, track in self.tracks.items()}
        self._set_up()

    @property
    def frames(self) -> int:
        """How many there are."""
        return len(self.t)

    @property
    def durations(self) -> list[int]:
        """How long each frame is shown [ms]: a GIF counts hundredths of a second, so that some are longer."""
        begin = np.round(np.arange(self.frames) / self.frames_per_second * 100).astype(int) * 10
        return [*np.diff(begin).tolist(), round(PAUSE * 1000)]

    def draw(self, k: int) -> Image.Image:
        """Frame k as an image; what does not move is drawn once."""
        self.set(k)
        if self._still is None:
            self.canvas.draw()
            self._still = self.canvas.copy_from_bbox(self.figure.bbox)
        self.canvas.restore_region(self._still)
        for artist in self._moving:
            self.axes.draw_artist(artist)
        return Image.fromarray(np.asarray(self.canvas.buffer_rgba())[..., :3].copy())

    def set(self, k: int) -> None:
        """Move everything to where it is at frame k."""
        i = k * self.fine
        self.time.set_text(f"t = {self.t[k]:.2f} s")
        self.target.set_data(*next(iter(self.tracks.values())).reference_position[i, :, None])
        for label, track in self.tracks.items():
            self.traces[label].set_data(*track.position[: i + 1].T)
            self.vehicles[label].set_xy(_outline(track.position[i], track.heading[i], self.length))
            gone = self.outside[label][i]
            self.distances[label].set_text("left the picture" if gone else _spoken(track.distance[i]))

    def _set_up(self) -> None:
        rows, (width, height) = len(self.tracks), self.high - self.low
        tall = WIDTH * float(np.clip(height / width, 0.4, 1.25))
        top = ROW * (rows + 1) + 0.12
        self.figure = Figure(figsize=(WIDTH, tall + top), dpi=DPI)
        self.canvas = FigureCanvasAgg(self.figure)
        all_ = tall + top
        self.axes = self.figure.add_axes((0.145, 0.42 / all_, 0.825, 1 - (0.42 + top) / all_))
        self._still_parts()
        colours = [ALONE[0]["color"]] if rows == 1 else itertools.cycle(COLOURS)
        self.traces, self.vehicles, self.distances = {}, {}, {}
        for row, (label, colour) in enumerate(zip(self.tracks, colours, strict=False)):
            self._moving_parts(label, colour, 1 + ROW * (rows - row - 0.35) / (all_ * self._share()))
        first_row = 1 + ROW * (rows + 0.65) / (all_ * self._share())
        self.time = self._text(0.01, first_row, weight="bold", animated=True)
        self._text(0.99, first_row, "distance to the reference", ha="right", color="0.4")
        self._moving = [*self.traces.values(), *self.vehicles.values(), self.target, *self.distances.values()]
        self._moving.append(self.time)
        self._still = None
        self.set(0)

    def _share(self) -> float:
        """Of the figure's height, what the axes take."""
        return self.axes.get_position().height

    def _still_parts(self) -> None:
        self.axes.plot(*self.path.T, color="0.88", lw=5, solid_capstyle="round", zorder=1)
        (self.target,) = self.axes.plot([], [], "o", color="k", ms=5, mfc="w", mew=1.3, zorder=5, animated=True)
        self.axes.set(xlim=(self.low[0], self.high[0]), ylim=(self.low[1], self.high[1]), aspect="equal")
        self.axes.locator_params(nbins=5)
        self.axes.tick_params(labelsize=8, color="0.6", labelcolor="0.3")
        self.axes.set_xlabel("x [m]", fontsize=8, color="0.3", labelpad=1)
        self.axes.set_ylabel("y [m]", fontsize=8, color="0.3", labelpad=1)
        self.axes.spines[:].set_color("0.8")

    def _moving_parts(self, label: str, colour: str, height: float) -> None:
        (self.traces[label],) = self.axes.plot([], [], color=colour, lw=1.6, zorder=2, animated=True)
        (self.vehicles[label],) = self.axes.fill([0], [0], fc=colour, ec="k", lw=0.8, zorder=4, animated=True)
        self.axes.plot([0.01, 0.06], [height] * 2, color=colour, lw=3, transform=self.axes.transAxes, clip_on=False)
        self._text(0.08, height, label)
        self.distances[label] = self._text(0.99, height, ha="right", animated=True)

    def _text(self, x: float, y: float, text: str = "", **options: Any) -> Any:
        return self.axes.text(x, y, text, transform=self.axes.transAxes, fontsize=9, va="center", **options)

    def _repr_html_(self) -> str:
        """In a notebook it plays."""
        buffer = io.BytesIO()
        write_gif(self, buffer)
        return f'<img src="data:image/gif;base64,{base64.b64encode(buffer.getvalue()).decode()}" alt="animation">'


def animation(
    runs: Mapping[str, Any],
    *,
    seconds: float | None = None,
    frames_per_second: float = 20,
    speed: float = 1.0,
    length: float | None = None,
) -> Animation:
    """Runs side by side, each a vehicle that leaves a trace; its distance to the reference point stands above.

    Args:
        runs: label -> trajectory, or anything with `t`, `position`, `heading` and `reference_position`. Each may have
            its own sampling; one that ends early stands still. The path and the point on it are those of the first.
        seconds: how much of the runs to show [s]; None: until the last has ended.
        frames_per_second: of the picture, at most 50, which is as fast as GIFs are played.
        speed: seconds of the run per second of the picture.
        length: of the vehicle as it is drawn [m]; None: as large as is well seen. Its middle is the reference point.

    Raises:
        ValueError: there are no runs, one has no finite sample, or a number is not positive.
    """
    if not runs:
        raise ValueError("there are no runs to animate")
    begin = min(float(run.t[0]) for run in runs.values())
    if seconds is None:
        seconds = max(float(run.t[-1]) for run in runs.values()) - begin
    for name, value in {"seconds": seconds, "frames_per_second": frames_per_second, "speed": speed}.items():
        if not 0 < value < np.inf:
            raise ValueError(f"{name} must be positive and finite; got {value}")
    if frames_per_second > 50:
        raise ValueError(f"frames_per_second must be at most 50; got {frames_per_second}")
    if length is not None and not 0 < length < np.inf:
        raise ValueError(f"length must be positive and finite; got {length}")
    step = speed / frames_per_second
    frames = int(np.floor(seconds / step + 1e-6))
    fine = max(1, int(np.ceil(FINE / max(frames, 1))))
    t = begin + np.arange(frames * fine + 1) * (step / fine)
    return Animation(runs, t, fine, frames_per_second, length)


def write_gif(animation: Animation, file: Any, tick: Callable[[], Any] | None = None) -> None:
    """Write to a path or an open binary file, which is touched only when all is drawn; `tick` is called every frame."""
    palette = _palette([animation.draw(k) for k in (0, animation.frames // 2, animation.frames - 1)])
    frames = []
    for k in range(animation.frames):
        frames.append(animation.draw(k).quantize(palette=palette, dither=Image.Dither.NONE))
        if tick is not None:
            tick()
    buffer = io.BytesIO()
    more = {"append_images": frames[1:], "duration": animation.durations[: len(frames)], "loop": 0}
    frames[0].save(buffer, format="GIF", save_all=True, **more)
    if hasattr(file, "write"):
        file.write(buffer.getvalue())
        return
    with open(file, "wb") as opened:
        opened.write(buffer.getvalue())


def _palette(images: list[Image.Image]) -> Image.Image:
    """Colours for all frames, so that what stands still is the same in each."""
    rows = np.concatenate([np.asarray(image) for image in images])
    return Image.fromarray(rows).quantize(SHADES, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)


def _finite(points: np.ndarray) -> np.ndarray:
    return points[np.isfinite(points).all(-1)]


def _view(path: np.ndarray, tracks: Any) -> tuple[np.ndarray, np.ndarray]:
    """Corners of what is shown [m]: the path and every trace as far as there is room, and a margin."""
    low, high = path.min(0), path.max(0)
    size = max(float(np.max(high - low)), 1e-3)
    least, most = low - ROOM * size, high + ROOM * size
    for track in tracks:
        low = np.clip(track.position.min(0), least, low)
        high = np.clip(track.position.max(0), high, most)
    short = np.maximum(0.4 * np.max(high - low) - (high - low), 0)  # of a line there is some room beside it
    margin = MARGIN * max(float(np.max(high - low)), 1e-3) + short / 2
    return low - margin, high + margin


def _outside(position: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    return np.any((position < low) | (position > high), axis=-1)


def _outline(position: np.ndarray, heading: float, length: float) -> np.ndarray:
    """Corners (5, 2) [m] of a vehicle with a pointed front whose middle is at `position`."""
    corners = length * np.array([(-0.5, -0.28), (0.18, -0.28), (0.5, 0.0), (0.18, 0.28), (-0.5, 0.28)])
    sine, cosine = np.sin(heading), np.cos(heading)
    return position + corners @ np.array([(cosine, sine), (-sine, cosine)])


def _spoken(distance: float) -> str:
    if distance < 0.01:
        return f"{distance * 1000:.1f} mm"
    return f"{distance * 100:.1f} cm" if distance < 1 else f"{distance:.2f} m"
