"""Answers calls of the command line, one a line, in one process: libraries are imported once."""

import contextlib
import faulthandler
import io
import json
import os
import resource
import signal
import sys
import traceback

from tuning.cli.main import main


def answer(argv: list[str]) -> tuple[int, str]:
    """Exit code of a call and all that it said."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            code = main(argv)
        except SystemExit as stop:  # argparse
            code = stop.code if isinstance(stop.code, int) else 1
        except BaseException:  # what a user would see
            traceback.print_exc()
            code = 1
    return code, said.getvalue()


if __name__ == "__main__":
    faulthandler.register(signal.SIGXCPU, chain=True)  # to stderr: where a call is that does not come back
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # compilers may print
    print("ready", file=answers, flush=True)  # importing takes longer than most calls
    for line in sys.stdin:
        folder, argv, seconds, work = json.loads(line)
        os.chdir(folder)
        used, hard = sum(os.times()[:2]), resource.getrlimit(resource.RLIMIT_CPU)[1]
        resource.setrlimit(resource.RLIMIT_CPU, (int(used + work) + 1, hard))
        faulthandler.dump_traceback_later(seconds)
        print(json.dumps(answer(argv)), file=answers, flush=True)
        faulthandler.cancel_dump_traceback_later()
