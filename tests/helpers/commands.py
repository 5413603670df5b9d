"""The command line as a user calls it: in a process of its own, from the source tree."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]  # of the repository
HUNG = 3600  # s; far above what any command needs on a loaded machine: no test judges a time
FAST = ["simulate.dt=0.01", "simulate.horizon=1", "simulate.integrator=euler"]
SHORT_TUNE = """
tune.dt=0.01 tune.integrator=euler tune.gains=["k1","k3"] tune.optimizer=adam tune.checkpoint_every=5
tune.screen=0 tune.search.checks=0 tune.search.scouts=8 tune.search.starts=2 tune.search.iterations=2
ensemble.validation_size=4
""".split()


def arguments(command, out, settings=(), *more):
    return [command, "--out", str(out), *(x for s in settings for x in ("--set", s)), *map(str, more)]


def start(argv, program=("-m", "tuning.cli"), apart=False, **more):
    """The process of a command; `apart` in a session of its own, with other environment variables as `more`."""
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    ours = ("XLA_FLAGS", "TF_CPP_MIN_LOG_LEVEL")  # set by the JAX of this process
    environment = {k: v for k, v in os.environ.items() if k not in ours} | {"PYTHONPATH": path} | more
    pipe = subprocess.PIPE
    streams = {"stdout": pipe, "stderr": pipe, "text": True, "start_new_session": apart}
    return subprocess.Popen([sys.executable, *program, *argv], env=environment, **streams)


def run(argv, code=0, **start_options):
    process = start(argv, **start_options)
    out, err = process.communicate(timeout=HUNG)
    assert process.returncode == code, err
    assert "Traceback" not in err
    return out, err


def python(program, *options, **environment):
    """What a program prints, in a process of its own."""
    return run([], program=(*options, "-c", program), **environment)[0]


def files_of(folder):
    return sorted(path.name for path in folder.iterdir())


def contents(folder):
    """All that is below a folder: the bytes of files, None for folders."""
    return {path.relative_to(folder): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}
