"""How fast are batched rollouts? `evaluate` against the same loop written plainly: `python benchmarks/rollout.py`.

Both run the default tuning ensemble, 12 s of RK4, one thread. Each lives in a process of its own, since compiler
options belong to a process, and they take turns: what is reported is the median of the ratios of neighbouring runs.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

STEPS, DT = 2400, 5e-3


def contestant(form: str, batch_size: int) -> Callable[[], Any]:
    """A compiled rollout of the ensemble, ready to be called."""
    import jax

    import agvjax
    from tuning import default_draws, sample

    if form == "agvjax":
        print(agvjax.tune_xla(), file=sys.stderr)
    controller = agvjax.NeuroBackstepping()
    batch = sample(agvjax.Scenario(), default_draws(), batch_size, seed=0)

    def fast() -> Any:
        return jax.block_until_ready(agvjax.evaluate(controller, batch, dt=DT, n_steps=STEPS).total_rmse)

    whole = jax.jit(jax.vmap(plain, in_axes=(None, batch.axes)))
    return fast if form == "agvjax" else lambda: jax.block_until_ready(whole(controller, batch.scenario))


def plain(controller: Any, scenario: Any) -> Any:
    """What one writes first: a scan over the steps of one vehicle, everything computed where it is used."""
    import jax
    import jax.numpy as jnp

    from agvjax import loop
    from agvjax.leaves import cast
    from agvjax.metrics import tracking_error
    from agvjax.path import reference

    dtype = jnp.result_type(float)
    controller, scenario, h = cast(controller, dtype), cast(scenario, dtype), jnp.asarray(DT, dtype)

    def rate(flow: Any, t: Any) -> tuple[Any, Any]:
        ref = reference(scenario.path, scenario.heading, t)
        return loop.derivative(
            controller, scenario, flow, held, loop.Signals(time=t, reference=ref, disturbance=scenario.disturbance(t))
        )

    def step(carry: Any, k: Any) -> tuple[Any, None]:
        flow, total = carry
        t = k * h
        k1, sample = rate(flow, t)
        k2, _ = rate(jax.tree.map(lambda x, d: x + h / 2 * d, flow, k1), t + h / 2)
        k3, _ = rate(jax.tree.map(lambda x, d: x + h / 2 * d, flow, k2), t + h / 2)
        k4, _ = rate(jax.tree.map(lambda x, d: x + h * d, flow, k3), t + h)
        flow = jax.tree.map(lambda x, a, b, c, d: x + h / 6 * (a + 2 * b + 2 * c + d), flow, k1, k2, k3, k4)
        return (flow, total + jnp.sum(tracking_error(sample) ** 2)), None

    zero = jnp.zeros((), dtype)
    first = loop.Signals(
        time=zero, reference=reference(scenario.path, scenario.heading, zero), disturbance=scenario.disturbance(zero)
    )
    flow, held, _ = loop.start(controller, scenario, first)
    ends = jnp.sum(tracking_error(rate(flow, zero)[1]) ** 2)
    (flow, total), _ = jax.lax.scan(step, (flow, zero), jnp.arange(STEPS, dtype=dtype))
    ends += -jnp.sum(tracking_error(rate(flow, STEPS * h)[1]) ** 2)  # the trapezoid: half of either end
    return jnp.sqrt((total - ends / 2) / STEPS)


def serve(form: str, batch_size: int) -> None:
    """A worker: compile, then one timed run a line of input."""
    if hasattr(os, "sched_setaffinity"):  # one thread; elsewhere the compiler may use several
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    run = contestant(form, batch_size)
    mean = float(run().mean())
    print(mean, flush=True)
    for _ in sys.stdin:
        begin = time.perf_counter()
        run()
        print(time.perf_counter() - begin, flush=True)


def main() -> None:
    """Let both take turns and print the table."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--batch", type=int, nargs="+", default=[64, 1024])
    arguments.add_argument("--turns", type=int, default=9)
    arguments.add_argument("--worker", nargs=2, help=argparse.SUPPRESS)
    given = arguments.parse_args()
    if given.worker:
        serve(given.worker[0], int(given.worker[1]))
        return
    print(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}, float32, one thread")
    print("| scenarios | plain scan, Mstep/s | evaluate, Mstep/s | ratio (median, range) |\n|---|---|---|---|")
    for size in given.batch:
        workers = {form: _start(form, size) for form in ("plain", "agvjax")}
        means = [float(worker.stdout.readline()) for worker in workers.values()]
        assert abs(means[0] / means[1] - 1) < 1e-3, means  # the same loop
        seconds = [{form: _turn(worker) for form, worker in workers.items()} for _ in range(given.turns)]
        for worker in workers.values():
            worker.stdin.close()
            worker.wait()
        ratios = sorted(s["plain"] / s["agvjax"] for s in seconds)
        rates = [size * STEPS / statistics.median(s[form] for s in seconds) / 1e6 for form in ("plain", "agvjax")]
        middle = statistics.median(ratios)
        print(f"| {size} | {rates[0]:.2f} | {rates[1]:.2f} | {middle:.1f} ({ratios[0]:.1f} to {ratios[-1]:.1f}) |")


def _start(form: str, size: int) -> Any:
    environment = {**os.environ, "JAX_PLATFORMS": "cpu"}
    command = [sys.executable, __file__, "--worker", form, str(size)]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, text=True)


def _turn(worker: Any) -> float:
    worker.stdin.write("go\n")
    worker.stdin.flush()
    return float(worker.stdout.readline())


if __name__ == "__main__":
    main()
