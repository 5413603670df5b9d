"""The command line: arguments, exit codes and messages. What the commands do is in `commands`."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from typing import Any


def parser() -> argparse.ArgumentParser:
    """`agvjax simulate | tune | sweep | pareto | doctor | reproduce | compare | vehicles | identify | export`."""
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument(
        "--config", action="append", default=[], metavar="FILE.toml", help="read settings; may be repeated"
    )
    common.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="one setting, e.g. controller.k1=25"
    )
    common.add_argument("--out", metavar="DIR", help="where to write; a new folder (default: runs/COMMAND-TIME)")
    common.add_argument("--seed", type=int, help="seed of every random number")
    common.add_argument("--precision", type=int, choices=(32, 64), help="bits of a floating-point number")
    common.add_argument("--quiet", action="store_true", help="print nothing but errors")
    top = argparse.ArgumentParser(prog="agvjax", description=__doc__.splitlines()[0] if __doc__ else None)
    top.description = "Simulate and tune path-following controllers of vehicles whose actuators have a deadzone."
    commands = top.add_subparsers(dest="command", required=True)
    simulate = commands.add_parser(
        "simulate", parents=[common], help="roll one vehicle out and write trajectory, metrics, figures"
    )
    simulate.add_argument("--animate", action="store_true", help="draw the run as a moving picture, animation.gif")
    simulate.add_argument("--from", dest="sweep", metavar="DIR", help="a vehicle of this sweep, with its controller")
    simulate.add_argument("--index", type=int, metavar="N", help="which vehicle of the sweep")
    simulate.add_argument("--controller", metavar="NAME", help="which controller of the sweep (default: its first)")
    tune = commands.add_parser("tune", parents=[common], help="tune the gains over an ensemble and write a report")
    tune.add_argument("--resume", action="store_true", help="go on with the run in --out, to the same result")
    tune.add_argument(
        "--coordinator",
        metavar="HOST:PORT",
        default=os.environ.get("JAX_COORDINATOR_ADDRESS"),
        help="tune with several processes that meet there; 'auto' in SLURM, Open MPI, Kubernetes",
    )
    _among(tune)
    _sweep(commands, common)
    commands.add_parser(
        "pareto", parents=[common], help="tune along a moving limit: the front of error against command"
    )
    commands.add_parser("doctor", parents=[common], help="check gradients and runs of a problem before it is tuned")
    reproduce = commands.add_parser(
        "reproduce", parents=[common], help="rebuild the paper's tables and figures beside the printed numbers"
    )
    reproduce.add_argument("--pdf", action="store_true", help="write every figure as PDF too")
    commands.add_parser(
        "compare", parents=[common], help="tune every law to the same command budget and judge it on unseen scenarios"
    )
    commands.add_parser(
        "vehicles", parents=[common], help="unicycle, car and robot with limits, delay and sampling; tuned and judged"
    )
    _identify(commands, common)
    export = commands.add_parser(
        "export", parents=[common], help="the step of a tuned sampled controller as C, NumPy, ROS 2 or StableHLO"
    )
    export.add_argument("gains", metavar="GAINS.toml", help="as `agvjax tune` writes it, config.toml beside it")
    export.add_argument("--format", choices=("c", "numpy", "ros2", "stablehlo"), required=True)
    export.add_argument("--name", help="of files, functions and package")
    return top


def _identify(commands: Any, common: argparse.ArgumentParser) -> None:
    identify = commands.add_parser(
        "identify", parents=[common], help="what the actuators really do, from recorded drives; a scenario to tune for"
    )
    add = identify.add_argument
    add("logs", nargs="*", metavar="LOG.csv", help="recorded drives; without any a drive to record is suggested")
    add("--unseen", action="append", default=[], metavar="LOG.csv", help="a drive to predict with what was identified")
    add("--fit", metavar="NAMES", help="what to fit: groups (deadzone,delay,lag,disturbance,vehicle) or leaves")


def _sweep(commands: Any, common: argparse.ArgumentParser) -> None:
    sweep = commands.add_parser(
        "sweep", parents=[common], help="roll out many vehicles, on a grid or at random, and see where the gains fail"
    )
    add = sweep.add_argument
    add("--over", action="append", metavar="LEAF=LOW:HIGH:POINTS", help="an axis; without POINTS sampled, *= times")
    add("--ensemble", action="store_true", help="draw the other leaves of the tuning ensemble too")
    add("--samples", type=int, metavar="N", help="scenarios at every node of the grid, or in all")
    add("--design", metavar="NAME", help="random, sobol, latin; saltelli or morris for sensitivities")
    add("--controller", action="append", metavar="FILE|LAW", help="another controller beside the configured one")
    add("--export", action="append", metavar="netcdf|parquet", help="write the results in this form too")
    _among(sweep)
    add("--resume", action="store_true", help="refuse to begin anew; the same command goes on by itself")


def _among(command: argparse.ArgumentParser) -> None:
    command.add_argument("--num-processes", type=int, metavar="N", help="how many processes share the work")
    command.add_argument("--process-id", type=int, metavar="K", help="which of them this is, from 0")


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code: 0 success, 1 a run that failed, 2 bad input, 130 interrupted."""
    arguments = parser().parse_args(argv)
    # before JAX: compilers say more than a user can use, and of every program they kept that it is of another machine
    # (jaxlib 0.10 on processors with AVX-512, openxla/xla issue 44565); what fails comes as an exception all the same
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    try:
        command = importlib.import_module(f".{arguments.command}", __package__)  # late: --help needs no JAX
        from agvjax import InputError

        from .console import RunFailed, interrupts

        try:
            with interrupts() as lost:
                code = command.run(arguments)
            if lost:  # and swallowed on the way
                raise KeyboardInterrupt
            return code
        except (InputError, RunFailed) as error:
            print(f"agvjax {arguments.command}: {error}", file=sys.stderr)
            return 2 if isinstance(error, InputError) else 1
        except OSError as error:  # a full disk, a folder that went away
            print(f"agvjax {arguments.command}: {error}", file=sys.stderr)
            return 1
    except KeyboardInterrupt:
        print(f"agvjax {arguments.command}: interrupted", file=sys.stderr)
        return 130


def _among_others() -> bool:
    distributed = sys.modules.get("tuning.compute.processes")
    return distributed is not None and distributed.joined()


def run() -> None:
    """The `agvjax` command."""
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
