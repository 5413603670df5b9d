"""What a user of the library waits for, with compiler options and without: a batch, and its gradient in either mode."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

WAYS = {  # options, how they are asked for, and what the environment says
    "as imported": ("", {"AGVJAX_XLA": "1"}),
    "tune_xla(reverse=True)": ("agvjax.tune_xla(reverse=True)", {"AGVJAX_XLA": "1"}),
    "AGVJAX_XLA=0": ("", {"AGVJAX_XLA": "0"}),
}
PROGRAM = """
import json, time
import agvjax
{options}
import jax, numpy as np
law = agvjax.NeuroBackstepping()
many = agvjax.batch(agvjax.Scenario(), {{"disturbance.amplitude": np.linspace(0.0, 0.4, 64, dtype=np.float32)}})
gains = {{name: np.float32(agvjax.leaves(law)[name]) for name in ("k1", "k2", "k3", "Lam", "Lam_psi")}}
def cost(gains):
    return agvjax.evaluate(agvjax.replace(law, gains), many, dt=5e-3, n_steps=2400).total_rmse.mean()
found = {{}}
ways = dict(evaluate=cost, jacfwd=jax.jacfwd(cost), grad=jax.grad(cost), value_and_grad=agvjax.value_and_grad(cost))
for name, function in ways.items():
    compiled = jax.jit(function)
    jax.block_until_ready(compiled(gains))
    times = []
    for _ in range({turns}):
        begin = time.perf_counter()
        jax.block_until_ready(compiled(gains))
        times.append(time.perf_counter() - begin)
    found[name + "_ms"] = 1e3 * min(times)
print(json.dumps(found))
"""


def measure(turns: int) -> list[dict[str, Any]]:
    """64 vehicles, 12 s at 5 ms, five gains, float32; the best of `turns` runs."""
    rows = []
    for name, (options, environment) in WAYS.items():
        program = PROGRAM.format(options=options, turns=turns)
        own = {key: value for key, value in os.environ.items() if key != "XLA_FLAGS"}
        done = subprocess.run(
            [sys.executable, "-c", program], env=own | environment, capture_output=True, text=True, check=True
        )
        rows.append({"options": name} | json.loads(done.stdout.splitlines()[-1]))
    return rows
