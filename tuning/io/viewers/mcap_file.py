"""Runs, and drives beside what a model makes of them, as MCAP files of ROS 2's messages.

Foxglove, PlotJuggler and Rerun read them.

Topics of a run: `odom`, `plan`, `reference`, `cmd_vel` where the law asks for a twist, numbers by name below `asked`,
`delivered` and `error`; and `tf` of all runs. Of several runs each has its name in front of its topics and frames.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from jaxtyping import ArrayLike

import agvjax

from ..curves import Track
from ..logs.recording import Part
from .told import Run

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

NEEDS = ("mcap", "rosbags")
MAP = "map"  # the frame that runs and their path lie in
PLANNED = 2000  # poses of a plan, at most


def write_runs(file: BinaryIO, runs: Mapping[str, Run]) -> None:
    """Write runs of one timing, by name; that of a single run may be empty. Times count from 0 s."""
    types = _store().types
    told = [_Run(types, f"{name}/" if name else "", run) for name, run in runs.items()]
    _put(file, ((t, *one) for k, t in enumerate(told[0].stamps) for run in told for one in run.messages(k)))


def write_tracks(file: BinaryIO, tracks: Mapping[str, Track]) -> None:
    """Write tracks by name, in the order of their times."""
    types = _store().types
    told = [_Tracked(types, f"{name}/", track) for name, track in tracks.items()]
    rows = sorted((t, i, k) for i, one in enumerate(told) for k, t in enumerate(one.stamps))
    _put(file, ((t, *one) for t, i, k in rows for one in told[i].messages(k)))


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

    def __init__(self, types: Mapping[str, Part], prefix: str, run: Run):
        super().__init__(types, prefix, run.track.t)
        self.run = run

    def messages(self, k: int) -> Iterator[tuple[str, Part]]:
        """Topics and messages of sample `k`."""
        t, (x, y, heading), unknown = self.types, self.run.track.pose[k].tolist(), np.zeros(36)
        yield self.placed(k, x, y, heading)
        place = t["PoseWithCovariance"](self._pose(x, y, heading), unknown)
        moving = t["TwistWithCovariance"](self._twist(*self.run.moving[k].tolist()), unknown)
        yield f"/{self.prefix}odom", t["Odometry"](self._header(k), f"{self.prefix}base_link", place, moving)
        yield f"/{self.prefix}reference", t["PoseStamped"](self._header(k), self._pose(*self.run.wanted[k].tolist()))
        if k == 0:
            yield f"/{self.prefix}plan", self._plan()
        if self.run.command is not None:
            speed, yaw_rate = self.run.command[k].tolist()
            header = self._header(k, f"{self.prefix}base_link")
            yield f"/{self.prefix}cmd_vel", t["TwistStamped"](header, self._twist(speed, 0.0, yaw_rate))
        yield from self.counted(k, self.run.track.numbers)

    def _plan(self) -> Part:
        """What the path asked for, thinned."""
        wanted = self.run.wanted
        rows = wanted[:: -(-len(wanted) // PLANNED)].tolist()
        header = self._header(0)
        return self.types["Path"](header, [self.types["PoseStamped"](header, self._pose(*row)) for row in rows])

    def _twist(self, along: float, across: float, yaw_rate: float) -> Part:
        t = self.types
        return t["Twist"](t["Vector3"](along, across, 0.0), t["Vector3"](0.0, 0.0, yaw_rate))
