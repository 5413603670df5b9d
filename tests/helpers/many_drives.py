"""`python many_drives.py KIND COUNT FOLDER`: what `identify` says of so many drives, a line of JSON each.

In a process of its own, for the compiler's options, and in one for all, so that the model is compiled once.
"""

import json
import sys
from pathlib import Path

import drives


def identified(kind, count, folder):
    """Of every drive its numbers, with the truth and their intervals, and what is said of the model."""
    import agvjax

    agvjax.tune_xla(devices=1)
    import jax

    jax.config.update("jax_enable_x64", True)

    from tuning.config.load import resolve
    from tuning.identify.conclusion import conclude
    from tuning.identify.rules import faults
    from tuning.identify.task import task
    from tuning.identify.verdict import settled

    wishes = {"starts": 1, "bootstrap": 300, "fit": ["deadzone", "delay", "vehicle"]}
    config, model = resolve({"scenario": {"plant": "base"}, "identify": wishes}, faults), None
    for seed in range(count):
        base, more = drives.KINDS[kind](seed)
        posed = task([drives.recorded(folder / f"{kind}{seed}.csv", base, seed, **more)], config)
        model = model or posed.model
        fit, verdict = settled(posed._replace(model=model), config.identify, config.seed)
        true, left = drives.truth(base), verdict.left
        numbers = {e.name: [true[e.name], e.value, e.low, e.high] for e in verdict.estimates if e.identified}
        said = conclude(posed.logs, fit, verdict, [], True).text
        change = left.change and left.change._asdict()
        yield {"numbers": numbers, "asked": len(verdict.estimates), "said": said, "change": change}


if __name__ == "__main__":
    for row in identified(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3])):
        print(json.dumps(row), flush=True)
