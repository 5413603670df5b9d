"""Simulated runs as an MCAP file of ROS 2's messages, for viewers: Foxglove, PlotJuggler, Rerun.

Topics of a run: `odom`, `plan`, `reference`, `cmd_vel` where the law asks for a twist, numbers by name below `asked`,
`delivered` and `error`; and `tf` of all runs. Of several runs each has its name in front of its topics and frames.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

import jax.numpy as jnp
import numpy as np

import agvjax
from agvjax import Fault, InputError
from agvjax.draw.plot import CHANNELS
from agvjax.geometry import into_body, into_plane
from agvjax.metrics import tracking_error
from agvjax.protocols import Plant

from ..files import write_by
from .recording import Part

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
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    store, channels = get_typestore(Stores.ROS2_HUMBLE), dict[str, int]()
    writer = Writer(file)
    writer.start(profile="ros2", library=f"agvjax {agvjax.__version__}")
    told = [_Run(store.types, f"{name}/" if name else "", run, plant) for name, run in runs.items()]
    for k, t in enumerate(_stamps(next(iter(runs.values())))):
        for topic, message in (one for run in told for one in run.messages(k)):
            kind = message.__msgtype__
            if topic not in channels:
                text, _ = store.generate_msgdef(kind, ros_version=2)
                schema = writer.register_schema(kind, "ros2msg", text.encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            data = bytes(store.serialize_cdr(message, kind))
            writer.add_message(channels[topic], log_time=t, publish_time=t, data=data)
    writer.finish()


def _stamps(run: agvjax.Trajectory) -> list[int]:
    """Times [ns] of the samples."""
    return [round(1e9 * t) for t in np.asarray(run.t, float).tolist()]


class _Run:
    """The messages of one run, sample by sample."""

    def __init__(self, types: Mapping[str, Part], prefix: str, run: agvjax.Trajectory, plant: Plant):
        self.types = {kind.rpartition("/")[2]: made for kind, made in types.items()}
        self.prefix, self.stamps = prefix, _stamps(run)
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
        t, frame, header = self.types, f"{self.prefix}base_link", self._header(k)
        (x, y), (v, w) = self.position[k].tolist(), self.moving[k].tolist()
        place, turned = self._pose(x, y, float(self.heading[k])), self._twist(v, w, float(self.turning[k]))
        moved = t["Transform"](t["Vector3"](x, y, 0.0), place.orientation)
        yield "/tf", t["TFMessage"]([t["TransformStamped"](header, frame, moved)])
        unknown = np.zeros(36)
        parts = t["PoseWithCovariance"](place, unknown), t["TwistWithCovariance"](turned, unknown)
        yield f"/{self.prefix}odom", t["Odometry"](header, frame, *parts)
        yield f"/{self.prefix}reference", t["PoseStamped"](header, self._pose(*self.wanted[k].tolist()))
        if k == 0:
            yield f"/{self.prefix}plan", self._plan()
        if self.command.shape[1] == TWIST:
            speed, yaw_rate = self.command[k].tolist()
            yield f"/{self.prefix}cmd_vel", t["TwistStamped"](self._header(k, frame), self._twist(speed, 0.0, yaw_rate))
        for name, values in self.numbers.items():
            yield f"/{self.prefix}{name}", t["Float64"](float(values[k]))

    def _plan(self) -> Part:
        """What the path asked for, thinned."""
        rows = self.wanted[:: -(-len(self.wanted) // PLANNED)].tolist()
        header = self._header(0)
        return self.types["Path"](header, [self.types["PoseStamped"](header, self._pose(*row)) for row in rows])

    def _header(self, k: int, frame: str = MAP) -> Part:
        return self.types["Header"](self.types["Time"](*divmod(self.stamps[k], 10**9)), frame)

    def _pose(self, x: float, y: float, heading: float) -> Part:
        turn = self.types["Quaternion"](0.0, 0.0, float(np.sin(heading / 2)), float(np.cos(heading / 2)))
        return self.types["Pose"](self.types["Point"](x, y, 0.0), turn)

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
