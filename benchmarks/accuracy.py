"""What a step costs and gives: error of metrics and gradients over the tuning ensemble, by method and step."""

from __future__ import annotations

from typing import Any

import numpy as np

STEPS = (2e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2)


def measure(batch: int = 16) -> list[dict[str, Any]]:
    """Against RK4 with a step of 1e-4 s: largest relative error of total RMSE, and of the gradient in the gains."""
    import agvjax

    print(agvjax.tune_xla(devices=1))
    import jax
    import jax.numpy as jnp

    from .gradient import GAINS
    from .rollout import LAP, ensemble

    jax.config.update("jax_enable_x64", True)
    law, scenario, values = ensemble(batch)
    many = agvjax.batch(scenario, values)
    start = jnp.array([float(agvjax.leaves(law)[name]) for name in GAINS])

    def look(method: agvjax.Integrator, dt: float) -> tuple[np.ndarray, np.ndarray]:
        def errors(x: Any) -> Any:
            controller = agvjax.replace(law, {name: x[i] for i, name in enumerate(GAINS)})
            return agvjax.evaluate(controller, many, dt=dt, n_steps=round(LAP / dt), integrator=method).total_rmse

        along = jax.vmap(lambda v: jax.jvp(errors, (start,), (v,)), out_axes=(None, 0))
        value, slopes = jax.jit(along)(jnp.eye(start.size))
        return np.asarray(value), np.asarray(jnp.mean(slopes, axis=1) * start)

    value, slope = look(agvjax.RK4, 1e-4)
    rows = []
    for method in (agvjax.RK4, agvjax.HEUN, agvjax.EULER):
        for dt in STEPS:
            if dt > method.stable_step(law.poles()):
                continue
            v, s = look(method, dt)
            evaluations = len(method.nodes) + (method.name == "rk4")
            row = {"integrator": method.name, "dt": dt, "evaluations": round(LAP / dt) * evaluations}
            row["metric_error"] = float(np.max(np.abs(v / value - 1)))
            row["gradient_error"] = float(np.linalg.norm(s - slope) / np.linalg.norm(slope))
            rows.append(row)
    return rows
