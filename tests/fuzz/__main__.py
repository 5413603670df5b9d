"""`python tests/fuzz --seed 0 --count 1000`: calls drawn by seeds and judged by the rules.

One that breaks a rule is printed as a line for REPRODUCED of `test_reproduced.py`, which keeps it as a test.
"""

import argparse
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from cases import Case, draw
from rules import Answer, broken

LIMIT, WORK = 1800, 120  # s of one call: of a clock, where a call waits for ever, and of the processor, where it works


class Worker:
    """A process that answers calls; begun anew where it was lost or took too long."""

    def __init__(self, cache: str):
        self.cache, self.where = cache, Path(cache) / "where"  # it stands when the time is over
        self.process: subprocess.Popen[str] | None = None

    def call(self, folder: Path, argv: list[str]) -> tuple[int | None, str]:
        """Exit code and what was said; None where the process was lost or the time was over."""
        if self.process is None or self.process.poll() is not None:
            program = [sys.executable, str(Path(__file__).with_name("worker.py"))]
            environment = os.environ | {"XDG_CACHE_HOME": self.cache}
            pipe = subprocess.PIPE
            with self.where.open("w") as where:
                self.process = subprocess.Popen(
                    program, stdin=pipe, stdout=pipe, stderr=where, text=True, env=environment
                )
            assert self.process.stdout is not None and self.process.stdout.readline() == "ready\n"
        assert self.process.stdin is not None and self.process.stdout is not None
        print(json.dumps([str(folder), argv, LIMIT - 1, WORK]), file=self.process.stdin, flush=True)
        ready, _, _ = select.select([self.process.stdout], [], [], LIMIT)
        line = self.process.stdout.readline() if ready else ""
        if not line:
            self.process.kill()
            status, stood = (
                self.process.wait(),
                self.where.read_text(errors="replace").rpartition("most recent call")[2],
            )
            why = f"no answer within {LIMIT} s" if not ready else f"the process ended with {status}"
            why = f"no answer within {WORK} s of the processor" if status == -signal.SIGXCPU else why
            return None, "\n".join([*stood.splitlines()[1:13], why])
        code, said = json.loads(line)
        return code, said


def judged(worker: Worker, case: Case) -> tuple[list[str], int | None, str]:
    """What a case breaks, its exit code and what was said."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name:
        folder = Path(name)
        for file, data in case.files.items():
            (folder / file).parent.mkdir(exist_ok=True)
            (folder / file).write_bytes(bytes.fromhex(data))
        before = [str(path.relative_to(folder)) for path in folder.rglob("*")]
        code, said = worker.call(folder, case.argv)
        return broken(Answer(code, said, before, folder)), code, said


def main() -> int:
    """1 if a rule was broken."""
    options = argparse.ArgumentParser()
    options.add_argument("--seed", type=int, default=time.time_ns() % 10**9, help="of the first input")
    options.add_argument("--count", type=int, default=1000)
    options.add_argument("--seconds", type=float, default=float("inf"), help="stop after so many")
    chosen = options.parse_args()
    print(f"seed {chosen.seed}, {chosen.count} inputs", flush=True)
    codes, failures, end = Counter[str](), 0, time.monotonic() + chosen.seconds
    with tempfile.TemporaryDirectory(prefix="fuzz-cache-") as cache:
        worker = Worker(cache)
        for seed in range(chosen.seed, chosen.seed + chosen.count):
            if time.monotonic() > end:
                break
            case = draw(seed)
            wrong, code, said = judged(worker, case)
            codes[f"{case.argv[0]} {code}"] += 1
            if wrong:
                failures += 1
                print(f"# seed {seed}: {'; '.join(wrong)}", *said.strip().splitlines()[-14:], sep="\n#   ")
                print(f"    {tuple(case)!r},", flush=True)
        if worker.process is not None:
            worker.process.kill()
    each = ", ".join(f"{what}: {count}" for what, count in sorted(codes.items()))
    run = sum(count for what, count in codes.items() if what.endswith((" 0", " 1")))
    print(f"{sum(codes.values())} inputs, {run} of them run, {failures} break a rule; exit codes {each}")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
