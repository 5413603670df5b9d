"""`python tests/fuzz --seed 0 --count 1000`: calls drawn by seeds and judged by the rules.

One that breaks a rule is printed as a line for REPRODUCED of `test_reproduced.py`, which keeps it as a test.
"""

import argparse
import json
import os
import select
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from cases import Case, draw, keys
from rules import Answer, broken

LIMIT = 60.0  # s of one call


class Worker:
    """A process that answers calls; begun anew where it was lost or took too long."""

    def __init__(self, cache: str):
        self.cache = cache
        self.process: subprocess.Popen[str] | None = None

    def call(self, folder: Path, argv: list[str]) -> tuple[int | None, str]:
        """Exit code and what was said; None where the process was lost or the time was over."""
        if self.process is None or self.process.poll() is not None:
            program = [sys.executable, str(Path(__file__).with_name("worker.py"))]
            environment = os.environ | {"XDG_CACHE_HOME": self.cache}
            pipe = subprocess.PIPE
            self.process = subprocess.Popen(
                program, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True, env=environment
            )
        assert self.process.stdin is not None and self.process.stdout is not None
        print(json.dumps([str(folder), argv]), file=self.process.stdin, flush=True)
        ready, _, _ = select.select([self.process.stdout], [], [], LIMIT)
        line = self.process.stdout.readline() if ready else ""
        if not line:
            self.process.kill()
            status = self.process.wait()
            return None, f"no answer within {LIMIT:g} s" if not ready else f"the process ended with {status}"
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
    names, codes, failures, end = keys(), Counter[str](), 0, time.monotonic() + chosen.seconds
    with tempfile.TemporaryDirectory(prefix="fuzz-cache-") as cache:
        worker = Worker(cache)
        for seed in range(chosen.seed, chosen.seed + chosen.count):
            if time.monotonic() > end:
                break
            case = draw(seed, names)
            wrong, code, said = judged(worker, case)
            codes[str(code)] += 1
            if wrong:
                failures += 1
                print(f"# seed {seed}: {'; '.join(wrong)}", *said.strip().splitlines()[-6:], sep="\n#   ")
                print(f"    {tuple(case)!r},", flush=True)
        if worker.process is not None:
            worker.process.kill()
    print(f"{sum(codes.values())} inputs, exit codes {dict(codes)}, {failures} break a rule")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
