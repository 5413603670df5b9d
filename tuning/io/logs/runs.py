"""Simulated runs, and drives beside what a model makes of them, as MCAP files of ROS 2's messages, for viewers.

Foxglove, PlotJuggler and Rerun read them.

Topics of a run: `odom`, `plan`, `reference`, `cmd_vel` where the law asks for a twist, numbers by name below `asked`,
`delivered` and `error`; and `tf` of all runs. Of several runs each has its name in front of its topics and frames.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

import agvjax
from agvjax import Fault, InputError
from agvjax.draw.plot import CHANNELS
from agvjax.geometry import into_body, into_plane
from agvjax.metrics import tracking_error
from agvjax.protocols import Plant

from ..files import write_by
from .recording import Part

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

INSTALL = "pip install 'agvjax[viewer]'"
MAP = "map"  # the frame that runs and their path lie in
PLANNED = 2000  # poses of a plan, at most
TWIST = 2  # numbers of a command that is a speed and a yaw rate


def check(file: str | None) -> None:
    """Refuse a file that cannot be written, before anything is computed for it; None is fine.

    Raises:
        agvjax.InputError: it is there already, or what writes it is not installed.
    """
    if file is None:
        return
    if not all(map(importlib.util.find_spec, ("mcap", "rosbags"))):
        raise InputError([Fault("--mcap", file, f"left out where mcap and rosbags are not installed: {INSTALL}")])
    path = Path(file)
    if path.suffix != ".mcap" or path.exists() or not path.parent.is_dir():
        raise InputError([Fault("--mcap", file, "a new file that ends in .mcap, in a folder that there is")])


def write_new(file: str | None, runs: Mapping[str, agvjax.Trajectory], plant: Plant) -> None:
    """`write` to a file that `check` accepted; None: nowhere."""
    if file is not None:
        write_by(Path(file), lambda stream: write(stream, runs, plant))


def write(file: BinaryIO, runs: Mapping[str, agvjax.Trajectory], plant: Plant) -> None:
    """Write runs of one plant and one timing, by name; that of a single run may be empty.

    Times count from 0 s. Poses and velocities are those of the middle of the axle, of a plant without one those of its
    reference point; yaw rates are slopes of the heading. A number that is not finite is written as it is.
    """
    types = _store().types
    told = [_Run(types, f"{name}/" if name else "", run, plant) for name, run in runs.items()]
    stamps = _stamps(next(iter(runs.values())).t)
    _put(file, ((t, *one) for k, t in enumerate(stamps) for run in told for one in run.messages(k)))


class Track(NamedTuple):
    """Poses over time, and numbers beside them.

    Attributes:
        t: times (N,) [s].
        pose: x, y [m] and heading [rad] (N, 3).
        numbers: by topic, each (N,).
    """

    t: np.ndarray
    pose: np.ndarray
    numbers: Mapping[str, np.ndarray]


def write_tracks(file: str | None, tracks: Mapping[str, Track]) -> None:
    """Write tracks by name to a file that `check` accepted, in the order of their times; None: nowhere."""
    if file is None:
        return
    types = _store().types
    told = [_Tracked(types, f"{name}/", track) for name, track in tracks.items()]
    rows = sorted((t, i, k) for i, one in enumerate(told) for k, t in enumerate(one.stamps))
    write_by(Path(file), lambda stream: _put(stream, ((t, *one) for t, i, k in rows for one in told[i].messages(k))))


def _store() -> Typestore:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def _put(file: BinaryIO, messages: Iterable[tuple[int, str, Part]]) -> None:
    """Write messages with their times [ns] and topics."""
    from mcap.writer import Writer

    store, channels = _store(), dict[str, int]()
    writer = Writer(file)
    writer.start(profile="ros2", library=f"agvjax {agvjax.__version__}")
    for t, topic, message in messages:
        kind = message.__msgtype__
        if topic not in channels:
            text, _ = store.generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        data = bytes(store.serialize_cdr(message, kind))
        writer.add_message(channels[topic], log_time=t, publish_time=t, data=data)
    writer.finish()


def _stamps(t: ArrayLike) -> list[int]:
    """Times [ns] of samples."""
    return [round(1e9 * x) for x in np.asarray(t, float).tolist()]


class _Moving:
    """Messages of what moves in the plane."""

    def __init__(self, types: Mapping[str, Part], prefix: str, t: ArrayLike):
        self.types = {kind.rpartition("/")[2]: made for kind, made in types.items()}
        self.prefix, self.stamps = prefix, _stamps(t)

    def placed(self, k: int, x: float, y: float, heading: float) -> tuple[str, Part]:
        """Its frame in sample `k`."""
        t, frame = self.types, f"{self.prefix}base_link"
        moved = t["Transform"](t["Vector3"](x, y, 0.0), self._pose(x, y, heading).orientation)
        return "/tf", t["TFMessage"]([t["TransformStamped"](self._header(k), frame, moved)])

    def counted(self, k: int, numbers: Mapping[str, np.ndarray]) -> Iterator[tuple[str, Part]]:
        """Numbers by topic in sample `k`."""
        for name, values in numbers.items():
            yield f"/{self.prefix}{name}", self.types["Float64"](float(values[k]))

    def _header(self, k: int, frame: str = MAP) -> Part:
        return self.types["Header"](self.types["Time"](*divmod(self.stamps[k], 10**9)), frame)

    def _pose(self, x: float, y: float, heading: float) -> Part:
        turn = self.types["Quaternion"](0.0, 0.0, float(np.sin(heading / 2)), float(np.cos(heading / 2)))
        return self.types["Pose"](self.types["Point"](x, y, 0.0), turn)


class _Tracked(_Moving):
    """The messages of a track, which tells no speeds."""

    def __init__(self, types: Mapping[str, Part], prefix: str, track: Track):
        super().__init__(types, prefix, track.t)
        self.track = track

    def messages(self, k: int) -> Iterator[tuple[str, Part]]:
        """Topics and messages of sample `k`."""
        x, y, heading = self.track.pose[k].tolist()
        yield self.placed(k, x, y, heading)
        yield f"/{self.prefix}pose", self.types["PoseStamped"](self._header(k), self._pose(x, y, heading))
        yield from self.counted(k, self.track.numbers)


class _Run(_Moving):
    """The messages of one run, sample by sample."""

    def __init__(self, types: Mapping[str, Part], prefix: str, run: agvjax.Trajectory, plant: Plant):
        super().__init__(types, prefix, run.t)
        self.heading, self.turning = np.asarray(run.heading, float), _yaw_rates(run)
        lever = float(plant.lever() or 0.0)
        turned = jnp.asarray(self.heading)
        ahead = into_plane(jnp.asarray(lever), jnp.zeros(()), turned).T
        self.position = np.asarray(run.position, float) - np.asarray(ahead)
        along, across = into_body(jnp.asarray(run.velocity).T, turned)
        self.moving = np.column_stack([along, np.asarray(across) - lever * self.turning])
        self.wanted = np.column_stack([run.reference_position, run.reference_heading]).astype(float)
        self.command = np.asarray(run.command, float)
        self.numbers = _numbers(run, plant)

    def messages(self, k: int) -> Iterator[tuple[str, Part]]:
        """Topics and messages of sample `k`."""
        t, (x, y), (v, w) = self.types, self.position[k].tolist(), self.moving[k].tolist()
        heading, unknown = float(self.heading[k]), np.zeros(36)
        yield self.placed(k, x, y, heading)
        place = t["PoseWithCovariance"](self._pose(x, y, heading), unknown)
        moving = t["TwistWithCovariance"](self._twist(v, w, float(self.turning[k])), unknown)
        yield f"/{self.prefix}odom", t["Odometry"](self._header(k), f"{self.prefix}base_link", place, moving)
        yield f"/{self.prefix}reference", t["PoseStamped"](self._header(k), self._pose(*self.wanted[k].tolist()))
        if k == 0:
            yield f"/{self.prefix}plan", self._plan()
        if self.command.shape[1] == TWIST:
            speed, yaw_rate = self.command[k].tolist()
            header = self._header(k, f"{self.prefix}base_link")
            yield f"/{self.prefix}cmd_vel", t["TwistStamped"](header, self._twist(speed, 0.0, yaw_rate))
        yield from self.counted(k, self.numbers)

    def _plan(self) -> Part:
        """What the path asked for, thinned."""
        rows = self.wanted[:: -(-len(self.wanted) // PLANNED)].tolist()
        header = self._header(0)
        return self.types["Path"](header, [self.types["PoseStamped"](header, self._pose(*row)) for row in rows])

    def _twist(self, along: float, across: float, yaw_rate: float) -> Part:
        t = self.types
        return t["Twist"](t["Vector3"](along, across, 0.0), t["Vector3"](0.0, 0.0, yaw_rate))


def _yaw_rates(run: agvjax.Trajectory) -> np.ndarray:
    """Slopes [rad/s] of the heading, (N,)."""
    t, heading = np.asarray(run.t, float), np.asarray(run.heading, float)
    return np.gradient(heading, t) if len(t) > 1 else np.zeros_like(heading)


def _numbers(run: agvjax.Trajectory, plant: Plant) -> dict[str, np.ndarray]:
    """By topic what is a number at every sample: errors, what actuators were asked for and what they delivered."""
    errors = {f"error/{name}": x for name, x in zip(CHANNELS, np.asarray(tracking_error(run)).T, strict=False)}
    if run.route is not None:
        errors = {f"error/{name}": np.asarray(x) for name, x in vars(run.route).items() if name in ROUTE}
    names = [part for actuator in plant.actuators for part in plant.parts(actuator)]
    asked, delivered = np.asarray(run.inputs), np.asarray(run.delivered)
    parts = {f"asked/{name}": asked[:, i] for i, name in enumerate(names)}
    parts |= {f"delivered/{name}": delivered[:, i] for i, name in enumerate(names)}
    return errors | parts


ROUTE = ("cross_track", "heading_error", "ahead")  # m, rad, m: of a run along a route
