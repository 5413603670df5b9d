"""The commands that read recorded drives: their arguments."""

from __future__ import annotations

from .options import QUIET, Command, Option, many, option

TOPICS = (
    many("--topics", "ROLE=TOPIC", "which topic of a recording is its pose, command, speed, yaw_rate, steering"),
    option(
        "--stamps",
        choices=("auto", "header", "arrival"),
        help="whose times: the sender's or those of arrival (default: the sender's where there are any)",
    ),
)
FIT = option("--fit", metavar="NAMES", help="fit groups (deadzone,delay,lag,disturbance,vehicle) or leaves")


def viewers_of(what: str) -> tuple[Option, ...]:
    """The options that also write files for viewers, of what."""
    return (
        option("--mcap", metavar="FILE.mcap", help=f"also write {what}, for Foxglove or PlotJuggler"),
        option("--rerun", metavar="FILE.rrd", help=f"also write {what}, for Rerun"),
    )


IDENTIFY = Command(
    "what the actuators really do, from recorded drives; a scenario to tune for",
    (
        option(
            "logs",
            nargs="*",
            metavar="LOG",
            help="recorded drives: CSV, or as `agvjax log` reads them; without any, a drive to record is suggested",
        ),
        many("--unseen", "LOG", "a drive to predict with what was identified"),
        *viewers_of("log and model"),
        *(*TOPICS, FIT),
    ),
)
LOG = Command(
    "what a recorded drive holds and what it can be used for: bags of ROS, MCAP, ULog, dataflash, MDF",
    (
        option("file", metavar="FILE", help="the recording; the folder of a bag of ROS 2"),
        *TOPICS,
        option("--out", metavar="DIR", help="where to write; a new folder (default: runs/log-TIME)"),
        QUIET,
    ),
    "drive.mcap",
    (),
)
APPLY = Command(
    "may new gains replace those on the robot? By what its last log leaves possible; exit code 1 if not",
    (
        option("new", metavar="NEW.toml", help="the new gains, or the folder of the run that tuned them"),
        option("--over", metavar="CURRENT.toml", help="the gains on the robot, or the folder that has them"),
        many("--log", "LOG", "the robot's last drive, as `agvjax identify` reads it"),
        option("--identified", metavar="DIR", help="in place of a log the folder of `agvjax identify`"),
        *(*TOPICS, FIT),
    ),
    "new.toml --over current.toml --log today.mcap",
)
WATCH = Command(
    "are gains still tuned for the robot that a log is of? Exit code 1 if not, or if it cannot be told",
    (
        option("logs", nargs="+", metavar="LOG", help="recorded drives, as `agvjax identify` reads them"),
        *(*TOPICS, FIT),
    ),
    "today.mcap --config tuned/config.toml",
)
