"""The command line: arguments, exit codes and messages. What a command does is in the file of its name."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn, TextIO

from ..export import FORMATS
from ..io.numbers import integer, real
from .early import end_at_once
from .options import Command, Option, flag, many, option
from .questions import COMPLETION, EXPLAIN, NEW
from .recordings import APPLY, IDENTIFY, LOG, WATCH, viewers_of

SCHEDULER = option(
    "--scheduler",
    metavar="WHERE",
    help="share the work among workers of Dask: local:N, tcp://HOST:PORT, slurm:N or kubernetes:N",
)
SHARED = (
    option("--num-processes", type=integer, metavar="N", help="number of processes that share the work (default: 1)"),
    option("--process-id", type=integer, metavar="K", help="index of this process, from 0 (default: 0)"),
)
VIEWERS = viewers_of("what is drawn")
SIMULATE = Command(
    "simulate one vehicle; write trajectory, metrics, figures",
    (
        flag("--animate", "animate the run: animation.gif"),
        *VIEWERS,
        option("--from", dest="sweep", metavar="DIR", help="take a vehicle from this sweep, with its controller"),
        option("--index", type=integer, metavar="N", help="which vehicle of the sweep"),
        option("--controller", metavar="NAME", help="which controller of the sweep (default: its first)"),
    ),
)
RESUME = flag("--resume", "continue the run in --out, to the same result")
TUNE = Command(
    "tune the gains over an ensemble and write a report",
    (
        RESUME,
        option(
            "--params",
            metavar="FILE.yaml",
            help="start from Nav2's parameters of regulated pure pursuit; write tuned ones",
        ),
        option("--controller", metavar="ID", help="which of its controllers, if it has several"),
        *VIEWERS,
        option(
            "--coordinator",
            metavar="HOST:PORT",
            default=os.environ.get("JAX_COORDINATOR_ADDRESS"),
            help="tune with several processes that connect there; 'auto' in SLURM, Open MPI, Kubernetes",
        ),
        *SHARED,
    ),
)
SWEEP = Command(
    "simulate many vehicles, on a grid or at random: where do the gains fail?",
    (
        many(
            "--over", "LEAF=LOW:HIGH:POINTS", "an axis; sampled without POINTS; *= for multiples of the nominal value"
        ),
        flag("--ensemble", "also draw the other leaves of the tuning ensemble"),
        flag("--rare", "how likely is a failure, down to 1e-6: with --ensemble, or axes that are sampled"),
        option(
            "--samples",
            type=integer,
            metavar="N",
            help="scenarios per node of the grid, or in all without a grid (default: 1024)",
        ),
        option(
            "--design",
            metavar="NAME",
            help="random, sobol, latin; saltelli or morris for sensitivities (default: random)",
        ),
        many("--controller", "FILE|LAW", "another controller, besides the configured one"),
        SCHEDULER,
        *(one._replace(keywords={**one.keywords, "help": "of earlier releases; see --scheduler"}) for one in SHARED),
        flag("--resume", "only continue, never begin; the same command continues without it"),
    ),
)
CERTIFY = Command(
    "prove a bound on the error for every scenario of a box; beside it, how far a search finds no violation",
    (
        option("--within", type=real, metavar="M", help="bound on the errors in x and y in m (default: 0.02)"),
        option("--within-heading", type=real, metavar="RAD", help="bound on that of the heading (default: 0.2)"),
        many("--over", "LEAF=LOW:HIGH", "a side of the box; *= for multiples of nominal (default: the tuning box)"),
        SCHEDULER,
    ),
    "--within 0.02 --within-heading 0.2",
)
SPEED = Command(
    "how fast a vehicle can follow its route, tuned at every speed, and what place limits it",
    (
        option("--within", type=real, metavar="M", help="largest distance to the route in m (default: its corridor)"),
        RESUME,
    ),
    "--config base --within 0.05",
)
EXPORT = Command(
    "the step of a tuned sampled controller as C, NumPy, ROS 2, StableHLO or FMU",
    (
        option("gains", metavar="GAINS.toml", help="as `agvjax tune` writes it, config.toml beside it"),
        option("--format", choices=FORMATS, required=True),
        option("--what", choices=("controller", "plant"), default="controller", help="with fmu also the vehicle"),
        option("--name", help="of files, functions and package (default: one for each format)"),
        flag("--evidence", "with c: run checks of the exported code and keep them, see docs/evidence.md"),
    ),
    "tuned/gains.toml --format c --out mine",
)
COMPARE = Command(
    "tune every law to the same command budget and compare them on unseen scenarios",
    (RESUME, flag("--deadzone", "compare remedies against the deadzone instead: network, slopes, observer, inverses")),
)
COMMANDS = {
    "new": NEW,
    "simulate": SIMULATE,
    "tune": TUNE,
    "sweep": SWEEP,
    "pareto": Command("tune for a series of limits: the Pareto front of error against command", (RESUME,)),
    "certify": CERTIFY,
    "speed": SPEED,
    "margins": Command(
        "gain, phase and delay margins of the loop along its run; Bode plot, limit cycles", example="--config base"
    ),
    "explore": Command(
        "a local page with sliders for gains and vehicle; can tune from their values", example="--config base"
    ),
    "doctor": Command("check gradients and runs of a problem before it is tuned"),
    "reproduce": Command("rebuild the paper's tables and figures next to the printed numbers"),
    "compare": COMPARE,
    "vehicles": Command("unicycle, car and robot with limits, delay and sampling, tuned and evaluated"),
    "log": LOG,
    "identify": IDENTIFY,
    "apply": APPLY,
    "watch": WATCH,
    "export": EXPORT,
    "explain": EXPLAIN,
    "completion": COMPLETION,
}
EXIT_CODES = {
    0: "success",
    1: "the run failed, or its result should not be used",
    2: "bad input: one message names every bad key",
    130: "interrupted",
}


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in at most so many characters, whatever was given."""

    def error(self, message: str) -> NoReturn:
        """End with exit code 2."""
        super().error(re.sub(r"\S{200,}", lambda match: f"{match[0][:200]} ... ({len(match[0])} characters)", message))


def parser() -> argparse.ArgumentParser:
    """The commands of `agvjax` with their options."""
    description = "Simulate and tune path-following controllers of vehicles whose actuators have a deadzone."
    top = _Parser(prog="agvjax", description=description, epilog="agvjax COMMAND --help: the options of a command")
    top.set_defaults(coordinator=None)  # of the commands that have no such option
    top.add_argument("--version", action="store_true", help="print the version and exit")
    commands = top.add_subparsers(dest="command")
    for name, command in COMMANDS.items():
        summary = f"{command.help[0].upper()}{command.help[1:]}."
        more = f"For example: agvjax {name} {command.example}. What a setting means: agvjax explain KEY."
        sub = commands.add_parser(name, help=command.help, description=summary, epilog=more)
        _with(sub, (*command.common, *command.options))
    return top


def _with(parser: _Parser, options: Sequence[Option]) -> _Parser:
    for one in options:
        parser.add_argument(*one.names, **one.keywords)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code: 0 success, 1 a run that failed, 2 bad input, 130 interrupted."""
    arguments = parser().parse_args(argv)
    if arguments.version or not arguments.command:
        print(f"agvjax {_version()}" if arguments.version else parser().format_help(), end="\n" * arguments.version)
        return 0
    # before JAX: compilers say more than a user can use, and of every program they kept that it is of another machine
    # (jaxlib 0.10 on processors with AVX-512, openxla/xla issue 44565); what fails comes as an exception all the same
    if os.environ.get("TF_CPP_MIN_LOG_LEVEL", "1") == "1":  # what JAX sets in whatever process starts this one
        os.environ["TF_CPP_MIN_LOG_LEVEL"] = "3"
    try:
        command = importlib.import_module(f".{arguments.command}", __package__)  # late: --help needs no JAX
        from agvjax import InputError

        from .console import RunFailed, interrupts, unreadable

        try:
            if wrong := unreadable(arguments):
                raise InputError(wrong)
            with interrupts() as signals:
                code = command.run(arguments)
            if signals:  # and swallowed on the way
                raise KeyboardInterrupt
            return code
        except (InputError, RunFailed, OSError) as error:  # OSError: a full disk, a folder that went away
            print(f"agvjax {arguments.command}: {error}", file=sys.stderr)
            return 2 if isinstance(error, InputError) else 1
    except KeyboardInterrupt:
        print(f"agvjax {arguments.command}: interrupted", file=sys.stderr)
        return 130


def _version() -> str:
    """The version of the package, read without importing JAX."""
    text = (Path(__file__).parents[2] / "agvjax" / "__init__.py").read_text(encoding="utf-8")
    match = re.search(r'^__version__ = "(.+)"$', text, re.MULTILINE)
    return match[1] if match else "of no known version"


class _Reader(io.FileIO):
    """A stream to whoever reads it: once nobody does, the command goes on in silence, its results are in files."""

    def write(self, data: Any) -> int | None:
        try:
            return super().write(data)
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
            return len(data)


def _stream(stream: TextIO) -> TextIO:
    """The stream that cannot fail for want of a reader, nor of letters in its encoding."""
    binary = io.BufferedWriter(_Reader(stream.fileno(), "wb", closefd=False))
    return io.TextIOWrapper(binary, stream.encoding, "backslashreplace", line_buffering=True)


def _among_others() -> bool:
    processes = sys.modules.get("tuning.compute.processes")
    return processes is not None and processes.entangled()


def run() -> None:
    """The `agvjax` command."""
    end_at_once()
    with contextlib.suppress(AttributeError, OSError):  # closed streams
        sys.stdout, sys.stderr = _stream(sys.stdout), _stream(sys.stderr)
    code = main()
    if code == 130 or (code and _among_others()):
        # Ctrl-C inside the compiler leaves it in a state that crashes the interpreter's shutdown; and JAX would wait
        # there for a process that was lost
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


if __name__ == "__main__":
    run()
