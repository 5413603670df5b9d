"""A closed loop in plain JAX that XLA's CPU compiler runs many times faster with options that it does not document.

For whoever works on XLA, and for `tune_xla`, which asks with it whether a release still obeys: nothing else is needed.

    python reproducer.py           # the loop with and without the options, each in a process of its own
    python reproducer.py --once    # as XLA_FLAGS says; prints microseconds a step and a sum of the result

64 vehicles follow a path by a law with a small network, by RK4: one `lax.scan` whose body has 10 outputs and about 1500
operations. Without the options each output is a kernel of its own that computes again whatever it shares with the
others, and each step launches dozens of them.
"""

import os
import subprocess
import sys
import time

FLAGS = (
    "--xla_backend_extra_options="
    "xla_cpu_use_multi_output_fusion=true,"  # a kernel may have several outputs: nothing is computed twice
    "xla_cpu_small_while_loop_byte_threshold=100000000,"  # the whole loop is one function: no launch for each kernel
    "-vectorize-memory-check-threshold=100000"  # kernels with dozens of arrays are vectorised too
    " --xla_cpu_prefer_vector_width=512"
)
VEHICLES, STEPS, H = 64, 1000, 5e-3


def loop(slopes):  # long: one loop, to be read as a whole
    """The distance of every vehicle from its path in the end, of actuators with these slopes (VEHICLES,)."""
    import jax
    import jax.numpy as jnp

    centers = jnp.linspace(-1.0, 1.0, 5)

    def derivative(state, t, slope):
        position, velocity, weights, filtered, heading = state
        wanted = jnp.array([jnp.sin(0.5 * t), jnp.sin(t)])
        error = position - wanted
        rate = velocity - jnp.array([0.5 * jnp.cos(0.5 * t), jnp.cos(t)]) + 3.0 * error
        near = jnp.exp(-((error[:, None] - centers) ** 2))  # (2, 5)
        command = -8.0 * rate - weights * rate * jnp.sum(near**2, axis=1) + filtered
        turned = jnp.array([jnp.cos(heading), jnp.sin(heading)])
        force = jnp.where(jnp.abs(command) > 0.2, slope * (command - 0.2 * jnp.sign(command)), 0.0)
        along = jnp.dot(force, turned)
        bend = jnp.tanh(jnp.arctan2(velocity[1], velocity[0] + 2.0) - heading)
        return (
            velocity,
            force + 0.3 * jnp.cos(t) * turned - 0.1 * velocity * jnp.sqrt(1.0 + velocity @ velocity),
            jnp.sum(near**2, axis=1) * rate**2 - 0.5 * weights,
            10.0 * (0.1 * along * turned - filtered),
            bend,
        )

    def one(slope):
        def step(state, k):
            def moved(by, h):
                return jax.tree.map(lambda x, d: x + h * d, state, by)

            t = H * k
            a = derivative(state, t, slope)
            b = derivative(moved(a, H / 2), t + H / 2, slope)
            c = derivative(moved(b, H / 2), t + H / 2, slope)
            d = derivative(moved(c, H), t + H, slope)
            mean = jax.tree.map(lambda a, b, c, d: (a + 2 * b + 2 * c + d) / 6, a, b, c, d)
            return moved(mean, H), None

        start = (jnp.zeros(2), jnp.zeros(2), jnp.zeros(2), jnp.zeros(2), jnp.zeros(()))
        state, _ = jax.lax.scan(step, start, jnp.arange(STEPS, dtype=jnp.float32))
        return state[0]

    return jax.vmap(one)(slopes)


def once():
    """Microseconds a step, the best of five runs, and the sum of the positions in the end."""
    import jax
    import jax.numpy as jnp

    slopes = jnp.linspace(0.5, 1.5, VEHICLES)
    compiled = jax.jit(loop).lower(slopes).compile()
    total, best = float(compiled(slopes).sum()), float("inf")
    for _ in range(5):
        begin = time.perf_counter()
        jax.block_until_ready(compiled(slopes))
        best = min(best, time.perf_counter() - begin)
    return 1e6 * best / STEPS, total


def asked(flags):
    """The same in a process of its own with these flags; None where it does not start with them."""
    environment = {**os.environ, "XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"}
    done = subprocess.run([sys.executable, __file__, "--once"], env=environment, capture_output=True, text=True)
    return tuple(map(float, done.stdout.split())) if done.returncode == 0 else None


if __name__ == "__main__":
    if "--once" in sys.argv:
        print(*once())
    else:
        for name, flags in (("default options", ""), ("with FLAGS", FLAGS)):
            found = asked(flags)
            print(f"{name}: refused" if found is None else f"{name}: {found[0]:.2f} us a step, sum {found[1]:.6f}")
