"""A track from a recording: a path that was planned, as Nav2 publishes it, or the way that a robot drove."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from . import ros
from .read import of_bag, read
from .recording import Stream
from .roles import Role, roles_of

PLAN = "nav_msgs/msg/Path"
Track = tuple[dict[str, np.ndarray], str]  # columns by our names, in SI units; and what a person should know of them


def track(file: str, topic: str = "") -> Track:
    """Points x and y [m] of a plan, or of a drive its poses with their times t [s].

    A planner publishes what is left of its way again and again: of a topic's plans the longest is taken.

    Args:
        file: a recording.
        topic: of the plan or the pose; empty: the only one that there is, a plan before a pose.

    Raises:
        ValueError: the file cannot be read, or has no such topic, or several; it says which.
    """
    plans = _plans(file) if of_bag(file) else {}
    if not topic and len(plans) > 1:
        raise ValueError(f"several topics have a path: {', '.join(plans)}; name one with scenario.path.topic")
    if (name := topic or next(iter(plans), "")) in plans:
        points, count = plans[name]
        return {"x": points[:, 0], "y": points[:, 1]}, f"the longest of {count} paths of {name}"
    poses = {stream.topic: (stream, role) for stream in read(file).streams for role in _poses(stream)}
    if topic and topic not in poses:
        there = ", ".join([*plans, *poses]) or "none"
        raise ValueError(f"scenario.path.topic = {topic} has no path and no pose; those that have: {there}")
    if not topic and len(poses) != 1:
        several = f"several topics have a pose: {', '.join(poses)}; name one with scenario.path.topic"
        raise ValueError(several if poses else "no topic of it has a path or a pose")
    stream, role = poses[topic or next(iter(poses))]
    values, times = role.values(stream.fields), stream.times("header")
    _, first = np.unique(times, return_index=True)
    columns = {"x": values["x"][first], "y": values["y"][first], "t": (times[first] - times.min()) * 1e-9}
    return columns, f"the way of {stream.topic}"


def _poses(stream: Stream) -> list[Role]:
    return [role for role in roles_of(stream) if role.name == "pose"] if stream.size > 1 else []


def _plans(file: str) -> dict[str, tuple[np.ndarray, int]]:
    """By topic the longest of its plans (N, 2) [m], and how many there are."""
    found: dict[str, tuple[np.ndarray, int]] = {}
    for topic, kind, _, message in ros.messages(Path(file), []):
        if kind == PLAN:
            places = [pose.pose.position for pose in message().poses]
            points = np.array([(place.x, place.y) for place in places], float).reshape(-1, 2)
            before, count = found.get(topic, (points[:0], 0))
            found[topic] = (points if _length(points) > _length(before) else before), count + 1
    return {topic: plan for topic, plan in found.items() if len(plan[0]) > 1}


def _length(points: np.ndarray) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())
