"""The exported step beside the JAX one: C by the compiler's own judgement, NumPy, StableHLO, what they carry."""

import ast
import ctypes
import dataclasses
import datetime
import functools
import hashlib
import json
import shutil
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax.paths.heading import reference
from agvjax.schedule import scheduled
from tuning import config as configuration
from tuning.cli.main import main
from tuning.config.write import gains_table
from tuning.export import artefact, c, program, ros2, stablehlo
from tuning.export import names as export_names
from tuning.export import numpy as numpy_file
from tuning.export.guard import Kept
from tuning.export.vectors import row

FLAGS = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic"]
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
LIMITED = agvjax.Sampled(
    inner=agvjax.NeuroBackstepping(k1=3.0, k2=10.0, Lam=2.0, omega_n=30.0),
    vehicle=agvjax.Unicycle(),
    anti_windup=agvjax.BackCalculation(speed=0.8, limits=np.array([3.0, 6.0])),
)
LAWS = {
    "limited": LIMITED,
    "paper": agvjax.Sampled(),
    "torques": dataclasses.replace(LIMITED, vehicle=agvjax.DifferentialDrive()),
    "car": dataclasses.replace(LIMITED, vehicle=agvjax.SingleTrack()),
    "full_weight": agvjax.Sampled(inner=agvjax.FullWeightBackstepping(), vehicle=agvjax.Unicycle()),
    "computer": dataclasses.replace(  # steep ones would amplify the rounding of floats
        LIMITED,
        inner=agvjax.NeuroBackstepping(
            k1=agvjax.Schedule(over="velocity", nodes=np.array([-0.5, 0.2, 0.9]), values=np.array([2.0, 3.0, 4.5])),
            k2=10.0,
            Lam=2.0,
            omega_n=agvjax.Schedule(over="yaw_rate", nodes=np.array([0.1, 0.8]), values=np.array([30.0, 45.0])),
        ),
        prediction=agvjax.Predictor(delay=0.05, believed=agvjax.Unicycle().deadzones()),
        compensation=agvjax.Inverse(believed=agvjax.Unicycle().deadzones(), lead=0.01, width=1.0),
    ),
    "learning": dataclasses.replace(
        LIMITED,
        compensation=agvjax.AdaptiveInverse(
            believed=agvjax.Unicycle().deadzones(), width=1.0, delay=0.03, usual=np.array([2.0, 3.0])
        ),
    ),
    "osfc": agvjax.Sampled(inner=agvjax.OSFC(), vehicle=agvjax.Unicycle()),
    "stateless": agvjax.Sampled(inner=agvjax.FTSMC(), vehicle=agvjax.Unicycle()),
}
DRIVER = r"""
#include <stdio.h>
#include "law.h"
#include "vectors.h"
/* rows of doubles in, rows of results out: the test's own reading of the structures */
static law_state state;
static law_measurement measurement;
static law_reference reference;
static law_output output;
static void take(law_real *into, int count) {
    double x; int i;
    for (i = 0; i < count; i++) { if (fread(&x, sizeof x, 1, stdin) != 1) return; into[i] = (law_real)x; }
}
static void put(const law_real *from, int count) {
    double x; int i;
    for (i = 0; i < count; i++) { x = (double)from[i]; fwrite(&x, sizeof x, 1, stdout); }
}
int main(void) {
    int rows, k; double limited;
    if (scanf("%d\n", &rows) != 1) return 2;
    for (k = 0; k < rows; k++) {
        take((law_real *)(void *)&state, STATE);
        take((law_real *)(void *)&measurement, MEASUREMENT);
        take((law_real *)(void *)&reference, REFERENCE);
        law_step(&law_tuned, &state, &measurement, &reference, &output);
        put((const law_real *)(const void *)&state, STATE);
        put((const law_real *)(const void *)&output, RESULTS - STATE);
        limited = (double)output.limited; fwrite(&limited, sizeof limited, 1, stdout);
    }
    return 0;
}
"""


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The artefact of a law, through a file."""

    @functools.cache
    def of(name):
        file = tmp_path_factory.mktemp("export") / "gains.toml"
        file.write_text(gains_table(LAWS[name]))
        return artefact.read(str(file))

    return of


@pytest.fixture(scope="module")
def limited(exported):
    return exported("limited")


def random_inputs(law, count):
    """Random states, measurements, references, from near rest to a deviation of 1 m, 1 m/s, 1 rad."""
    rng = np.random.default_rng(0)
    size = 10 ** rng.uniform(-3, 0, count)

    def drawn(x):
        return jnp.asarray(np.moveaxis(rng.normal(size=(*np.shape(x), count)) * size, -1, 0))

    return jax.tree.map(drawn, program.examples(law))


def flat(trees, count):
    return np.concatenate([np.asarray(x, float).reshape(count, -1) for x in jax.tree.leaves(trees)], axis=1)


def by_jax(plain, inputs, count):
    """Rows of what the JAX step makes of them: state, inputs, whether limited."""

    def step(state, *seen):
        kept, law = isinstance(state, Kept), scheduled(plain, seen[0])
        done = law.step(state.law, *seen, state.memory) if kept else law.step(state, *seen)
        return (done.law, done.memory), done.command.inputs, done.limited

    return flat(jax.jit(jax.vmap(step))(*inputs), count)


def write_c(exported_law, folder):
    for name, text in c.files(exported_law, "law").items():
        (folder / name).write_text(text)
    (folder / "driver.c").write_text(DRIVER)


def gcc(folder, *arguments):
    """A program, or a library, made of the C in a folder."""
    program = str(folder / f"made{len(list(folder.iterdir()))}")
    command = ["gcc", *FLAGS, *arguments, "-o", program, "law.c", "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return program


def by_c(program, rows, results):
    done = subprocess.run([program], input=f"{len(rows)}\n".encode() + rows.tobytes(), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    return np.frombuffer(done.stdout).reshape(len(rows), results)


def deviation(got, wanted, whole=False):
    """Errors relative to max(1, |x|); as a `whole` to the largest number of the row, since single precision cancels."""
    size = np.abs(wanted).max(axis=1, keepdims=True) if whole else np.abs(wanted)
    return np.abs(got - wanted) / np.maximum(size, 1.0)


# ---- C


@needs_gcc
@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[] if n in ("limited", "stateless") else pytest.mark.slow) for n in LAWS],
)
def test_c_agrees_on_ten_thousand_random_inputs(name, exported, tmp_path):
    law = exported(name).controller
    write_c(exported(name), tmp_path)
    inputs = random_inputs(law, 10_000)
    wanted, rows = by_jax(law, inputs, 10_000), flat(inputs, 10_000)
    got = by_c(gcc(tmp_path, "driver.c"), rows, wanted.shape[1])
    assert np.array_equal(got[:, -1], wanted[:, -1])
    assert deviation(got, wanted).max() < 1e-12
    single = rows.astype(np.float32).astype(float)  # what a float controller is given, given to both
    leaves, tree = jax.tree.flatten(inputs)
    cuts = np.cumsum([int(np.prod(x.shape[1:])) for x in leaves])[:-1]
    parts = [jnp.asarray(p.reshape(x.shape)) for p, x in zip(np.split(single, cuts, axis=1), leaves, strict=True)]
    wanted = by_jax(law, jax.tree.unflatten(tree, parts), 10_000)
    in_float = gcc(tmp_path, "-DLAW_FLOAT", "-Wdouble-promotion", "-Wfloat-conversion", "driver.c")
    got = by_c(in_float, rows, wanted.shape[1])
    clear = got[:, -1] == wanted[:, -1]  # at the very edge of a limit the two may differ
    assert clear.mean() > 0.999 and deviation(got[clear], wanted[clear], whole=True).max() < 1e-5


@needs_gcc
def test_both_sides_of_every_limit_are_among_the_random_inputs(limited):
    at_limit = by_jax(limited.controller, random_inputs(limited.controller, 10_000), 10_000)[:, -1]
    assert 0.05 < at_limit.mean() < 0.999


@needs_gcc
def test_c_is_clean_under_the_sanitizers_and_its_self_test_passes(limited, tmp_path):
    write_c(limited, tmp_path)
    sanitized = ["-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "main.c"]
    for options in (sanitized, [*sanitized, "-DLAW_FLOAT"]):
        done = subprocess.run([gcc(tmp_path, *options)], capture_output=True, text=True, check=False)
        assert done.returncode == 0 and "64 steps" in done.stdout, done.stdout + done.stderr


@needs_gcc
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("LAW_R(3.0), /* inner.k1 */", "LAW_R(3.0001), /* inner.k1 */"),
        ("LAW_R(3.0), /* inner.k1 */", "LAW_R(0.0 / 0.0), /* inner.k1 */"),
        ("v0 = m_position_0 - r_position_0;", "v0 = m_position_0 + r_position_0;"),
    ],
    ids=["gain", "no number", "start"],
)
def test_the_self_test_notices_a_wrong_number(limited, tmp_path, old, new):
    write_c(limited, tmp_path)
    text = (tmp_path / "law.c").read_text()
    assert old in text[: text.index("void law_step")]  # the tuned gains, then the start
    (tmp_path / "law.c").write_text(text.replace(old, new, 1))
    assert subprocess.run([gcc(tmp_path, "main.c")], capture_output=True, check=False).returncode == 1


def test_c_needs_math_alone(limited):
    text = c.files(limited, "law")["law.c"]
    included = {line for line in text.splitlines() if line.startswith("#include")}
    assert included == {'#include "law.h"', "#include <math.h>"}
    assert "malloc" not in text and "static" not in text


BROKEN = r"""
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "law.h"
/* each number of measurement and reference in turn is NaN, then either infinity, then too large; 0 if all is well */
int main(void) {
    const law_real wrong[4] = {NAN, INFINITY, -INFINITY, sizeof(law_real) == 4 ? (law_real)3e38 : (law_real)1.7e308};
    law_state state, before;
    law_measurement seen, bad;
    law_reference asked, other;
    law_output output;
    int k, i, of_measurement = sizeof seen / sizeof(law_real), all = of_measurement + sizeof asked / sizeof(law_real);
    memset(&seen, 0, sizeof seen);
    memset(&asked, 0, sizeof asked);
    asked.velocity[0] = (law_real)0.5;
    asked.position[1] = (law_real)0.2;
    law_start(&law_tuned, &state, &seen, &asked);
    for (k = 0; k < 4 * all; k++) {
        i = k % all;
        bad = seen;
        other = asked;
        if (i < of_measurement) ((law_real *)(void *)&bad)[i] = wrong[k / all];
        else ((law_real *)(void *)&other)[i - of_measurement] = wrong[k / all];
        before = state;
        law_step(&law_tuned, &state, &bad, &other, &output);
        if (k < 3 * all && output.status != LAW_NOT_FINITE) return 1;
        if (output.status == LAW_NOT_FINITE) {
            if (memcmp(&before, &state, sizeof state) != 0) return 2;
            if (output.acceleration != 0 || output.yaw_acceleration != 0 || output.limited) return 3;
        } else if (!isfinite(output.acceleration) || !isfinite(output.yaw_acceleration)) return 4;
        else state = before; /* too large, and still a number: not what is asked here */
        law_step(&law_tuned, &state, &seen, &asked, &output);
        if (output.status != LAW_OK || !isfinite(output.acceleration)) return 5;
        if (k < 3 * all) {
            law_start(&law_tuned, &before, &bad, &other);
            law_step(&law_tuned, &before, &seen, &asked, &output);
            if (output.status == LAW_NOT_FINITE || !isfinite(output.acceleration)) return 6;
        }
    }
    return 0;
}
"""


@needs_gcc
@pytest.mark.parametrize("name", ["limited", "stateless", "osfc"])
@pytest.mark.parametrize("precision", [[], ["-DLAW_FLOAT"]], ids=["double", "float"])
def test_no_number_that_is_not_finite_enters_the_state_in_c(name, precision, exported, tmp_path):
    write_c(exported(name), tmp_path)
    (tmp_path / "broken.c").write_text(BROKEN)
    program = gcc(tmp_path, *precision, "broken.c")
    assert subprocess.run([program], check=False).returncode == 0


FAR = r"""
#include <stdio.h>
#include <string.h>
#include "law.h"
int main(void) {
    const double places[4] = {0.0, 8000.0, -8500.0, 4e6};
    law_state state;
    law_measurement seen;
    law_reference asked;
    law_output output;
    int k;
    for (k = 0; k < 4; k++) {
        memset(&seen, 0, sizeof seen);
        memset(&asked, 0, sizeof asked);
        seen.position[k % 2] = asked.position[k % 2] = (law_real)places[k];
        asked.velocity[0] = (law_real)0.5;
        law_start(&law_tuned, &state, &seen, &asked);
        law_step(&law_tuned, &state, &seen, &asked, &output);
        printf("%d%d ", output.status, output.acceleration != 0);
    }
    return 0;
}
"""


@needs_gcc
@pytest.mark.parametrize(("precision", "said"), [([], "01 01 01 01 "), (["-DLAW_FLOAT"], "01 01 31 31 ")])
def test_places_that_a_float_does_not_tell_to_a_millimetre_are_said(precision, said, limited, tmp_path):
    """At 2^13 m the numbers of 24 bits are 2^-10 m apart: the step is taken and says so."""
    write_c(limited, tmp_path)
    (tmp_path / "far.c").write_text(FAR)
    done = subprocess.run([gcc(tmp_path, *precision, "far.c")], capture_output=True, text=True, check=True)
    assert done.stdout == said and "#define LAW_COARSE 3 " in (tmp_path / "law.h").read_text()


@needs_gcc
@pytest.mark.parametrize("option", ["-ffast-math", "-Ofast", "-ffinite-math-only"])
def test_a_compiler_that_takes_every_number_to_be_finite_is_refused(option, limited, tmp_path):
    write_c(limited, tmp_path)
    command = ["gcc", "-std=c99", option, "-c", "law.c"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "#error" in done.stderr and option in done.stderr


@pytest.mark.skipif(shutil.which("g++") is None, reason="g++ is not installed")
def test_a_program_in_cpp_links_with_the_controller_in_c(limited, tmp_path):
    write_c(limited, tmp_path)
    (tmp_path / "use.cpp").write_text(
        '#include "law.h"\nint main() { law_state s; law_measurement m{}; law_reference r{}; law_output o;\n'
        "law_start(&law_tuned, &s, &m, &r); law_step(&law_tuned, &s, &m, &r, &o);\n"
        "return o.status == LAW_OK && !law_configuration[64] ? 0 : 1; }\n"
    )
    for command in (
        ["gcc", *FLAGS, "-c", "law.c"],
        ["g++", "-Wall", "-Wextra", "-Werror", "use.cpp", "law.o", "-o", "use"],
    ):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    assert subprocess.run([tmp_path / "use"], check=False).returncode == 0


# ---- a whole drive in closed loop


def drive(step, law, scenario, periods):
    """The plant of the scenario in steps of 5 ms under what `step(measurement, reference)` asks for, held."""
    plant, state = scenario.plant, scenario.plant.start(scenario.start)
    places = []

    @jax.jit
    def moved(state, inputs, t):
        delivered = {name: scenario.deadzone[name](u) for name, u in inputs.items()}

        def rate(x, time):
            return plant.derivative(x, (), delivered, scenario.disturbance(time)), None

        h = 5e-3
        for k in range(4):
            times = (t + k * h, t + (k + 0.5) * h, t + (k + 1) * h)
            state, _ = agvjax.RK4.advance(rate, state, h, times)
        return state

    zeros = {name: jnp.zeros(()) for name in plant.actuators}
    for k in range(periods):
        t = jnp.asarray(0.02 * k)
        seen = plant.output(state, zeros)
        places.append(np.asarray(seen.position))
        inputs = step(seen, reference(scenario.path, scenario.heading, t))
        state = moved(state, {name: jnp.asarray(inputs[name]) for name in plant.actuators}, t)
    return np.array(places)


def plain(tree):
    return {name: np.asarray(x) for name, x in vars(tree).items() if x is not None}


def numpy_class(exported_law):
    """The class of the exported NumPy file."""
    space = {}
    exec(numpy_file.files(exported_law)["agv_controller.py"], space)
    return space["Controller"]


def numpy_controller(exported_law, *arguments):
    return numpy_class(exported_law)(*arguments)


SCENE = agvjax.Scenario.of(agvjax.Unicycle(), heading=agvjax.Tangent())


@functools.cache
def simulated():
    run = agvjax.simulate(LIMITED, SCENE, dt=5e-3, n_steps=1200, save_every=4)
    assert bool(np.any(run.limited)) and run.ok
    return np.asarray(run.position)[:-1]


@pytest.mark.slow
def test_numpy_drives_as_the_simulator_does(limited):
    controller = numpy_controller(limited)
    places = drive(lambda m, r: controller.step(plain(m), plain(r)), LIMITED, SCENE, 300)
    assert np.abs(places - simulated()).max() < 1e-12


@pytest.mark.slow
@needs_gcc
def test_c_drives_as_the_simulator_does(limited, tmp_path):
    write_c(limited, tmp_path)
    library = ctypes.CDLL(gcc(tmp_path, "-shared", "-fPIC"))
    tuned = ctypes.addressof(ctypes.c_char.in_dll(library, "law_tuned"))
    state, begun = np.zeros(64), []

    class Output(ctypes.Structure):
        _fields_ = [("inputs", ctypes.c_double * 2), ("limited", ctypes.c_int), ("status", ctypes.c_int)]

    output = Output()

    def step(m, r):
        seen, asked = (np.concatenate([np.ravel(x) for x in jax.tree.leaves(tree)]) for tree in (m, r))
        pointers = [ctypes.c_void_p(x.ctypes.data) for x in (state, seen, asked)]
        if not begun:
            library.law_start(ctypes.c_void_p(tuned), *pointers)
            begun.append(True)
        library.law_step(ctypes.c_void_p(tuned), *pointers, ctypes.byref(output))
        return dict(zip(("acceleration", "yaw_acceleration"), output.inputs, strict=True))

    assert np.abs(drive(step, LIMITED, SCENE, 300) - simulated()).max() < 1e-12


# ---- NumPy


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n in ("limited", "paper", "stateless") else [pytest.mark.slow]) for n in LAWS]
)
def test_numpy_agrees_and_imports_nothing_else(name, exported):
    law = exported(name).controller
    text = numpy_file.files(exported(name))["agv_controller.py"]
    imports = [n for n in ast.walk(ast.parse(text)) if isinstance(n, (ast.Import, ast.ImportFrom))]
    assert {getattr(n, "module", None) or n.names[0].name for n in imports} == {"numpy", "__future__"}
    inputs = random_inputs(law, 200)
    wanted = by_jax(law, inputs, 200)
    controller, got = numpy_controller(exported(name)), []
    names = [f.name for f in program.step(law).arguments["state"]]
    for k in range(200):
        state, seen, asked = (jax.tree.map(lambda x, k=k: x[k], tree) for tree in inputs)
        controller.state = dict(zip(names, map(np.asarray, jax.tree.leaves(state)), strict=True))
        answer = controller.step(plain(seen), plain(asked))
        later = [np.ravel(controller.state[name]) for name in names]
        inputs_in_order = [np.ravel(answer[name]) for name in sorted(answer)]
        got.append(np.concatenate([*later, *inputs_in_order, [float(controller.limited)]]))
    assert deviation(np.array(got), wanted).max() < 1e-12


STILL = {"position": [0.0, 0.0], "velocity": [0.0, 0.0], "heading": 0.0}
SEEN, ASKED = STILL | {"yaw_rate": 0.0}, STILL | {"acceleration": [0.0, 0.0], "heading_rate": 0.0}


@pytest.mark.slow
def test_numpy_takes_other_gains_and_names_an_unknown_one(limited):
    ahead = ASKED | {"position": [0.1, 0]}
    weak, strong = (numpy_controller(limited, {"inner.k2": k}).step(SEEN, ahead)["acceleration"] for k in (1.0, 20.0))
    assert 0 < weak < strong
    with pytest.raises(ValueError, match=r"inner\.k9"):
        numpy_controller(limited, {"inner.k9": 1.0})


def test_on_the_path_the_law_asks_for_the_acceleration_of_the_path_turned_into_the_body(limited):
    """By hand: no error, filter at rest on the path's velocity, so that U_bar is phi1', (41), which is 0 there."""
    moving = {"position": [1, 2], "velocity": [0.5, 0], "heading": 0.3}
    inputs = numpy_controller(limited).step(SEEN | moving, ASKED | moving)
    assert np.allclose(list(inputs.values()), 0, atol=1e-12)


SLOW = [pytest.param(x, marks=pytest.mark.slow) for x in (np.inf, -np.inf)]


@pytest.mark.parametrize("wrong", [np.nan, *SLOW])
def test_no_number_that_is_not_finite_enters_the_state_in_numpy(wrong, limited):
    fresh = numpy_class(limited)
    for group, name in [(g, n) for g, table in enumerate((SEEN, ASKED)) for n in table]:
        now, controller = [SEEN, ASKED | {"position": [0.1, 0.2]}], fresh()
        wanted = [controller.step(*now), controller.step(*now)][1]
        assert controller.status == "OK"
        again = fresh()
        again.step(*now)
        bad = [dict(table) for table in now]
        bad[group][name] = np.full(np.shape(bad[group][name]), wrong)
        before = again.state
        assert set(again.step(*bad).values()) == {0.0} and again.status == "NOT_FINITE" and not again.limited
        assert before == again.state
        assert again.step(*now) == wanted and again.status == "OK"
        late = fresh()
        late.step(*bad)  # the first of all
        assert late.step(*now) == fresh().step(*now) and late.status == "STARTED"


@pytest.mark.parametrize("name", ["limited", *(pytest.param(n, marks=pytest.mark.slow) for n in ("stateless", "osfc"))])
def test_a_place_on_the_map_and_whole_turns_change_nothing(name, exported):
    """A circle driven beside, as it is and in UTM coordinates, and with its headings folded to a turn."""
    inputs = []
    for place, turn in ((0, lambda h: h), ([4e5, 4e6], lambda h: h), (0, lambda h: np.angle(np.exp(1j * h)))):
        controller, now = numpy_controller(exported(name)), []
        for heading in 2.9 + 0.01 * np.arange(60):
            ahead, left = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
            asked = {"position": place - left, "velocity": 0.5 * ahead, "acceleration": 0.25 * left}
            seen = {"position": place - 1.05 * left, "velocity": 0.5 * ahead, "heading": turn(heading + 0.1)}
            asked, seen = asked | {"heading": turn(heading), "heading_rate": 0.5}, seen | {"yaw_rate": 0.5}
            now.append(list(controller.step(SEEN | seen, ASKED | asked).values()))
        inputs.append(now)
    assert np.ptp(inputs[0], axis=0).max() > 0.01
    assert np.allclose(inputs[1], inputs[0], atol=1e-6) and np.allclose(inputs[2], inputs[0], atol=1e-9)


def test_the_numpy_file_tests_itself_when_it_is_run(limited, tmp_path):
    text = numpy_file.files(limited)["agv_controller.py"]
    for old, new, status in (("", "", 0), ("'inner.k1': 3.0", "'inner.k1': 3.0001", 1)):
        assert old in text
        (tmp_path / "law.py").write_text(text.replace(old, new))
        done = subprocess.run([sys.executable, tmp_path / "law.py"], capture_output=True, text=True, check=False)
        assert done.returncode == status and "16 steps" in done.stdout, done.stderr


# ---- StableHLO


def test_stablehlo_comes_back_and_agrees(limited):
    law, files = limited.controller, stablehlo.files(limited)
    again = jax.export.deserialize(bytearray(files["agv_controller.bin"]))
    assert set(again.platforms) == {"cpu", "cuda"} and "stablehlo" in files["agv_controller.mlir"]
    assert ".py" not in files["agv_controller.mlir"] and b".py" not in files["agv_controller.bin"]  # no folder of ours
    signature = json.loads(files["signature.json"])
    inputs = [jax.tree.map(lambda x: x[0], tree) for tree in random_inputs(law, 1)]
    leaves = jax.tree.leaves((law, *inputs))
    assert [list(np.shape(x)) for x in leaves] == [entry["shape"] for entry in signature["arguments"]]
    got = np.concatenate([np.ravel(np.asarray(x, float)) for x in again.call(*leaves)])
    assert [entry["group"] for entry in signature["results"]][-5:] == ["inputs"] * 2 + ["limited"] + ["status"] * 2
    wanted = row(law, *inputs)[-got.size + 2 :]
    assert np.allclose(got[:-2], wanted, rtol=1e-12, atol=1e-12)
    assert not np.any(got[-2:])  # neither not finite nor started anew
    bad = [leaf if i != len(leaves) - 1 else leaf * jnp.nan for i, leaf in enumerate(leaves)]
    kept = [np.ravel(np.asarray(x, float)) for x in again.call(*bad)]
    sizes = [entry["group"] for entry in signature["results"]]
    before = [leaf for leaf, entry in zip(leaves, signature["arguments"], strict=True) if entry["group"] == "state"]
    assert all(np.array_equal(np.ravel(a), b) for a, b in zip(before, kept, strict=False))
    assert not np.any(np.concatenate([x for x, group in zip(kept, sizes, strict=True) if group == "inputs"]))
    assert kept[-2] == 1 and kept[-1] == 0


# ---- what every artefact carries, and what cannot be exported


def test_a_module_says_until_when_jax_promises_to_read_it(tmp_path):
    """Six months by the calendar, and no day that there is not."""
    for day, ends in (("2026-11-30", "2027-05-30"), ("2026-08-31", "2027-02-28"), ("2027-01-15", "2027-07-15")):
        told = stablehlo.expiry(datetime.date.fromisoformat(day))
        assert told["date"] == ends and told["written"] == day and told["jax"] == jax.__version__
    before, out = datetime.date.today(), tmp_path / "out"
    assert main(["export", str(written(tmp_path, LIMITED)), "--format", "stablehlo", "--out", str(out), "--quiet"]) == 0
    told = json.loads((out / "provenance.json").read_text())["expires"]
    assert told == json.loads((out / "signature.json").read_text())["provenance"]["expires"]
    assert "six months" in told["promise"] and before <= datetime.date.fromisoformat(told["written"])
    months = [int(told[key][:4]) * 12 + int(told[key][5:7]) for key in ("written", "date")]
    assert months[1] - months[0] == 6


@pytest.mark.parametrize(
    ("form", "carrying"),
    [("c", "agv_controller.h"), ("numpy", "agv_controller.py"), ("ros2", "README.md"), ("stablehlo", "signature.json")],
)
def test_every_form_carries_gains_units_period_hash_and_uncertainty(form, carrying, tmp_path, capsys):
    config = configuration.load(["robot"], [])
    (tmp_path / "config.toml").write_text(configuration.dump(config))
    (tmp_path / "gains.toml").write_text(gains_table(config.controller))
    out = tmp_path / "out"
    assert main(["export", str(tmp_path / "gains.toml"), "--format", form, "--out", str(out), "--quiet"]) == 0
    told = json.loads((out / "provenance.json").read_text())
    assert told["configuration_sha256"] == hashlib.sha256(configuration.dump(config).encode()).hexdigest()
    assert told["period"] == {"value": 0.02, "unit": "s"}
    assert told["gains"]["inner.k1"] == {"value": 3.0, "unit": "1/s", "rule": "> 0", "low": 0.0, "high": None}
    draws = told["uncertainty"]["ensemble"]["draws"]
    assert draws["deadzone.torque_left.slope_right"] == {"times": [0.7, 1.3]}
    text = (out / carrying).read_text()
    assert told["configuration_sha256"] in text and "deadzone.torque_left.slope_right" in text


def test_gains_alone_can_be_exported_and_say_so(tmp_path, capsys):
    (tmp_path / "gains.toml").write_text(gains_table(LAWS["torques"]))
    assert main(["export", str(tmp_path / "gains.toml"), "--format", "numpy", "--out", str(tmp_path / "out")]) == 0
    assert "not stated" in capsys.readouterr().out
    assert "not stated" in json.loads((tmp_path / "out" / "provenance.json").read_text())["uncertainty"]


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        ("[controller]\nk1 = 3.0\n", [], "only a controller with a period"),
        ("[controller]\ntype = 'sampled'\nk1 = 3.0\n", [], "controller.k1"),
        ("version = 1\n", [], "a file with a [controller]"),
        ("not toml", [], "a readable TOML file"),
        (None, [], "a readable TOML file"),
        ("[controller]\ntype = 'sampled'\n", ["--name", "int"], "--name"),
        ("[controller]\ntype = 'sampled'\n", ["--name", "Up"], "--name"),
        ("[controller]\ntype = 'sampled'\n", ["--name", "vectors"], "--name"),
        ("[controller]\ntype = 'sampled'\n", ["--precision", "32"], "--precision"),
        ("[controller]\ntype = 'sampled'\nperiod = -1.0\n", [], "controller.period"),
    ],
)
def test_what_cannot_be_exported_is_refused(tmp_path, capsys, text, options, words):
    file, out = tmp_path / "gains.toml", tmp_path / "out"
    if text is not None:
        file.write_text(text)
    assert main(["export", str(file), "--format", "c", "--out", str(out), *options]) == 2
    assert words in capsys.readouterr().err and not out.exists()


def test_the_exported_gains_are_those_of_the_file(limited):
    for name, stated in {"k1": 3.0, "k2": 10.0, "Lam": 2.0, "omega_n": 30.0, "zeta": 0.75}.items():
        assert limited.provenance["gains"][f"inner.{name}"]["value"] == stated


def test_a_whole_configuration_is_exported_as_it_stands_whatever_lies_beside_it(tmp_path):
    """As the scenario.toml of `agvjax identify`, beside the config.toml with which that was begun."""
    pushed = "[scenario]\nplant = 'unicycle'\n[scenario.disturbance]\ntype = '{}'\n[controller]\ntype = 'sampled'\n"
    (tmp_path / "config.toml").write_text(pushed.format("cosine"))
    (tmp_path / "scenario.toml").write_text(pushed.format("step") + "period = 0.04\n")
    told = artefact.read(str(tmp_path / "scenario.toml")).provenance
    assert told["period"]["value"] == 0.04
    assert told["uncertainty"]["nominal"]["disturbance"]["type"] == "step"


@pytest.mark.parametrize("form", ["numpy", "stablehlo"])
def test_a_name_leads_nowhere_outside_the_folder(form, tmp_path, capsys):
    (tmp_path / "gains.toml").write_text(gains_table(LIMITED))
    command = ["export", str(tmp_path / "gains.toml"), "--format", form, "--out", str(tmp_path / "a/out")]
    assert main([*command, "--name", "../outside"]) == 2
    assert "--name" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["gains.toml"]


@pytest.mark.parametrize(
    "name",
    ["@STEP@", "*/", "a\\", *(pytest.param(n, marks=pytest.mark.slow) for n in ("@START@", "@NAME@", "/*", "??/"))],
)
@needs_gcc
def test_names_of_elements_and_files_that_look_like_code_come_through(name, tmp_path):
    """Of a file of gains and an element of an actuator: they stand in the provenance, and nothing is made of them."""
    told = artefact.read(str(written(tmp_path, LIMITED))).provenance
    told = told | {"source": f"{name}.toml", "uncertainty": {"nominal": {"actuators": {name: {"delay": {}}}}}}
    exported_law = artefact.Artefact(LIMITED, told)
    space = {"__name__": "law"}
    exec(numpy_file.files(exported_law)["agv_controller.py"], space)
    assert space["PROVENANCE"]["source"] == f"{name}.toml"
    write_c(exported_law, tmp_path)
    gcc(tmp_path, "main.c")


def written(folder, controller):
    """A file of the gains of a controller."""
    (folder / "gains.toml").write_text(gains_table(controller))
    return folder / "gains.toml"


@pytest.mark.parametrize("form", ["c", "fmu", "numpy", "ros2", "stablehlo"])
def test_every_form_says_all_it_writes(form, tmp_path, capsys):
    command = ["export", str(written(tmp_path, LIMITED)), "--format", form, "--out", str(tmp_path / "out")]
    assert main(command) == 0
    files = sorted(str(f.relative_to(tmp_path / "out")) for f in (tmp_path / "out").rglob("*") if f.is_file())
    said = capsys.readouterr().out.strip().splitlines()[-1]
    assert said.startswith(f"{len(files)} files") and said.split(": ", 1)[1].split(", ") == files


NAMES = "nav_msgs geometry_msgs std_srvs rcl_interfaces builtin_interfaces launch launch_ros ament_index_python yaml"
NAMES += " rclpy numpy setuptools json types print list match class int new template constexpr namespace math stdio"
NAMES += " nav2_core pluginlib main vectors config resource self__x up/down @STEP@ /* Über x"


@pytest.mark.parametrize("form", ["c", "fmu", "nav2", "numpy", "ros2", "stablehlo"])
@pytest.mark.parametrize("name", [*NAMES.split(), "a" * 64, "a" * 300, "", "9lives", "_x", "two words", "a\nb"])
def test_a_name_that_shadows_or_is_none_is_refused_before_anything_is_written(form, name, tmp_path, capsys):
    out = tmp_path / "out"
    command = ["export", str(tmp_path / "none.toml"), "--format", form, "--out", str(out), f"--name={name}"]
    assert main(command) == 2
    message = capsys.readouterr().err
    assert "--name" in message and len(message) < 300 and not out.exists()


def test_what_the_files_of_an_export_import_is_refused_as_their_name(limited):
    """Taken from the text that is written, not from the list of what is refused."""
    files = ros2.files(limited) | numpy_file.files(limited)
    names = set()
    for name, text in files.items():
        for node in ast.walk(ast.parse(text)) if name.endswith(".py") else ():
            if isinstance(node, ast.ImportFrom) and not node.level:
                names.add((node.module or "").split(".")[0])
            elif isinstance(node, ast.Import):
                names |= {alias.name.split(".")[0] for alias in node.names}
    assert {"rclpy", "geometry_msgs", "launch_ros", "yaml", "numpy"} < names
    assert all(name.startswith("_") or export_names.faults(name) for name in names)
    assert not export_names.faults("a" * 63) and not export_names.faults("agv_controller")


@pytest.mark.parametrize("member", ["int", "new", "class", "status", "limited", "a b", "1a", "a" * 64])
def test_an_actuator_whose_name_c_cannot_have_is_refused(member):
    """Beside `limited` and `status`, which the structure of the outputs has already."""
    with pytest.raises(ValueError, match=f"{member[:20]}"):
        export_names.check_members("output", [member, "limited", "status"])
    export_names.check_members("output", ["torque_left", "limited", "status"])


@needs_gcc
@pytest.mark.parametrize("zeta", [3.0, pytest.param(50.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "precision", [[], pytest.param(["-DLAW_FLOAT"], marks=pytest.mark.slow)], ids=["double", "float"]
)
def test_a_filter_that_is_damped_well_passes_its_own_test(zeta, precision, tmp_path):
    inner = agvjax.NeuroBackstepping(zeta=zeta, omega_n=90.0)
    law = artefact.read(str(written(tmp_path, agvjax.Sampled(inner=inner, vehicle=agvjax.Unicycle()))))
    write_c(law, tmp_path)
    done = subprocess.run([gcc(tmp_path, *precision, "main.c")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    space = {"__name__": "law"}
    exec(numpy_file.files(law)["agv_controller.py"], space)
    assert space["self_test"]() < 1e-12


@pytest.mark.parametrize(
    ("verdict", "k1", "word"),
    [
        ("", 3.0, "met all its limits"),
        ("limits not met: effort 2.1 of 2.0.", 3.0, "effort 2.1"),
        ("", 3.1, "others than those"),
        (None, 3.0, "no worst.json"),
    ],
)
def test_the_provenance_says_whether_tuning_met_its_limits(verdict, k1, word, tmp_path, capsys):
    file = written(tmp_path, LIMITED)
    if verdict is not None:
        gains = {name: np.asarray(x, float).tolist() for name, x in agvjax.leaves(LIMITED).items()}
        (tmp_path / "worst.json").write_text(json.dumps({"verdict": verdict, "gains": gains | {"inner.k1": k1}}))
    assert main(["export", str(file), "--format", "c", "--out", str(tmp_path / "out")]) == 0
    assert word in json.loads((tmp_path / "out/provenance.json").read_text())["verdict"]
    assert ("verdict" in capsys.readouterr().out) == (word in ("effort 2.1", "others than those"))


@pytest.mark.parametrize(
    ("path", "speed", "most"),
    [
        ({"type": "circle", "radius": 4.0, "omega": 0.25}, 1.0, 1.5),  # 4 m * 0.25 rad/s; half as much again
        ({"type": "circle", "radius": 1.0, "omega": 0.3}, 0.3, 1.2),
        ({"type": "lemniscate"}, 0.4, 1.2),  # faster here and slower there: no one speed
    ],
)
def test_the_node_drives_by_default_at_the_speed_tuned_at(path, speed, most, tmp_path):
    config = configuration.load(["robot"], [f"scenario.path={json.dumps(path).replace(': ', ' = ')}"])
    (tmp_path / "config.toml").write_text(configuration.dump(config))
    values = ros2.tables(artefact.read(str(written(tmp_path, config.controller))))
    assert values["speed"]["default_value"] == pytest.approx(speed, rel=1e-9)
    assert repr(values["max_speed"]["default_value"]) == repr(most)


def own_law(command):
    """A law that asks for `command` of the position, as a program."""

    @agvjax.pytree
    class Own(agvjax.Law):
        def init(self, measurement, reference):
            return ()

        def law(self, flow, memory, measurement, reference):
            return agvjax.Command(position=command(measurement.position), heading=measurement.heading), ()

    law, inputs = agvjax.Sampled(inner=Own()), {"position": "", "heading": ""}
    gains = {name: {"value": np.asarray(x).tolist()} for name, x in agvjax.leaves(law).items()}
    provenance = {"generator": "", "law": ["", "Own"], "vehicle": "", "inputs": inputs, "gains": gains}
    return artefact.Artefact(law, provenance)


def answer(law, position):
    return numpy_controller(law).step(SEEN | {"position": position}, ASKED)["position"]


def test_numpy_divides_by_zero_where_the_quotient_is_not_taken():
    assert answer(own_law(lambda x: jnp.where(x == 0, 7.0, 1 / x)), [0.0, 2.0]) == [7.0, 0.5]


def test_numpy_rounds_halves_as_the_law_does():
    assert answer(own_law(jax.lax.round), [2.5, -0.5]) == [3.0, -1.0]  # away from zero
    assert answer(own_law(jnp.round), [2.5, -0.5]) == [2.0, 0.0]  # to even


@pytest.mark.parametrize(
    ("command", "word"),
    [(lambda x: x.astype(int).astype(x.dtype), "int64"), (jnp.sort, "sort"), (jax.scipy.special.erf, "erf")],
)
def test_what_no_code_can_be_written_for_is_named(command, word):
    with pytest.raises(ValueError, match=word):
        program.step(own_law(command).controller)
