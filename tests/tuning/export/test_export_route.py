"""Laws that follow a route, as C and NumPy: one compiled law on every kind of route, period by period beside JAX."""

import ast
import ctypes
import functools
import json
import shutil
import subprocess

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import Route, SpeedLimits
from tuning.cli.main import main
from tuning.config.write import gains_table
from tuning.export import artefact, c, c_route, program, stablehlo, tables
from tuning.export import numpy as numpy_file
from tuning.export.vectors import _spots, row

FLAGS = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic"]
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
PERIOD, TRACK = 0.05, 0.5
REST = 2.0  # s at rest, after which nothing follows
LAWS = {
    "path_pid": agvjax.PathPID(),
    "regulated_pure_pursuit": agvjax.RegulatedPurePursuit(use_velocity_scaled_lookahead_dist=True),
    "stanley": agvjax.Stanley(k=1.0, k_yaw=0.0, wheelbase=0.25),  # with its defaults it does not hold the dumbbell
    "path_lqr": agvjax.PathLQR(),
}
BAY = np.array(  # past a bay and backwards into it
    [[0, 0, 0.6], [1, 0, 0.6], [2, 0, 0.6], [3, 0.15, 0.6], [4, 0.8, 0.6], [5, 2, -0.4],
     [4.3, 1, -0.4], [3.9, 0.3, -0.4], [3.7, -0.5, -0.4], [3.6, -1.5, -0.4], [3.6, -2.5, -0.4]]
)  # fmt: skip


@functools.cache
def laid(name):
    """A route of each kind, and how long [s] it is driven."""
    gentle = SpeedLimits(acceleration=0.4, deceleration=0.3)
    if name == "two legs":
        return Route.through(BAY, limits=gentle), 60.0
    if name == "stops":  # on the way, where it turns back, and in the bay
        return Route.through(BAY, dwell=[0, 0, 1.5, 0, 0, 0.7, 0, 0, 0.26, 0, 0], limits=gentle), 80.0
    if name == "one stop":  # an outsider's
        limits = SpeedLimits(acceleration=0.4, deceleration=0.4, lateral_acceleration=0.4)
        points = [[0.0, 0.0], [2.0, 0.0], [4.0, 0.0], [6.0, 1.0], [8.0, 1.0]]
        return Route.through(points, [0.6, 0.6, 0.0, 0.6, 0.6], dwell=2.0, limits=limits), 30.0
    if name == "seam":  # over its end, where it begins, and on
        corners = [[1, 0], [5, 0], [5, 3], [0, 3], [0, 0]]
        return Route.corners(corners, 0.8, radius=0.8, closed=True), 40.0
    return Route.along(agvjax.Dumbbell(), limits=gentle), 40.0  # crosses itself at the origin, and is closed


STARTS = {
    "two legs": (0.1, 0.15, 0.3),
    "stops": (0.1, 0.15, 0.3),
    "seam": (2.0, -0.2, -0.2),
    "dumbbell": (0.05, 0.05, 0.9),
}


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The artefact of a law, through files of gains and configuration."""

    @functools.cache
    def of(name):
        folder = tmp_path_factory.mktemp(name)
        write_config(folder, LAWS[name])
        return artefact.read(str(folder / "gains.toml"))

    return of


@pytest.fixture(scope="module")
def files_in_c(exported):
    return functools.cache(lambda name: c.files(exported(name), "law"))


CONFIG = f"""
[scenario]
plant = "base"
disturbance = "none"
[scenario.path]
type = "route"
points = {BAY.tolist()}
limits = {{ acceleration = 0.4, deceleration = 0.3 }}
half_width = 0.2
"""


def write_config(folder, inner):
    law = agvjax.Sampled(inner=inner, vehicle=agvjax.Base(track=TRACK), period=PERIOD)
    (folder / "config.toml").write_text(CONFIG)
    (folder / "gains.toml").write_text(gains_table(law))


# ---- a vehicle that does what it is told


def drive(start, step, seconds):
    """Poses (n, 3) of a unicycle under what `step(measurement)` sends to the rims of its wheels, until it stands."""
    x, y, heading, v, w = *start, 0.0, 0.0
    poses, rest = [], 0
    for _ in range(round(seconds / PERIOD)):
        velocity = np.array([v * np.cos(heading), v * np.sin(heading)])
        seen = {"position": np.array([x, y]), "velocity": velocity, "heading": heading, "yaw_rate": w}
        left, right = step(seen)
        v, w = (left + right) / 2, (right - left) / TRACK
        x, y = x + PERIOD * v * np.cos(heading + PERIOD * w / 2), y + PERIOD * v * np.sin(heading + PERIOD * w / 2)
        heading += PERIOD * w
        poses.append((x, y, heading))
        rest = rest + 1 if v == w == 0.0 else 0
        if rest * PERIOD > REST:
            break
    return np.array(poses)


def by_jax(law, route):
    """`step` of the simulator's own law."""
    given, state = tables.to_follow(route), []
    init, advance = jax.jit(lambda m, r: law.inner.init(m, r)), jax.jit(lambda s, m, r: law.step(s, m, r))

    def step(seen):
        now = agvjax.Measurement(**{name: jnp.asarray(x) for name, x in seen.items()})
        state[:] = [state[0] if state else init(now, given)]
        later = advance(state[0], now, given)
        state[:] = [later.law]
        return float(later.command.inputs["left"]), float(later.command.inputs["right"])

    return step


def by_numpy(found, route):
    space = {"__name__": "law"}
    exec(numpy_file.files(found)["agv_controller.py"], space)
    controller, data = space["Controller"](), {name: np.asarray(x) for name, x in tables.data(route).items()}

    def step(seen):
        inputs = controller.step(seen, data)
        assert controller.status == "OK"
        return float(inputs["left"]), float(inputs["right"])

    return step


class Output(ctypes.Structure):
    _fields_ = [
        ("left", ctypes.c_double),
        ("right", ctypes.c_double),
        ("limited", ctypes.c_int),
        ("status", ctypes.c_int),
    ]


def library(folder, *sources):
    made = str(folder / f"{sources[0]}.so")
    command = ["gcc", *FLAGS, "-shared", "-fPIC", "-o", made, *sources, "-lm"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return ctypes.CDLL(made)


class Compiled:
    """The law compiled once, and routes beside it, each compiled alone."""

    def __init__(self, found, files, folder):
        self.found, self.folder = found, folder
        for name, text in files.items():
            (folder / name).write_text(text)
        self.law = library(folder, "law.c", "law_route.c")
        self.tuned = ctypes.addressof(ctypes.c_char.in_dll(self.law, "law_tuned"))
        self.size = sum(len(f.variables) for f in program.step(found.controller).arguments["state"])

    def route(self, route, name):
        (self.folder / name).mkdir()
        (self.folder / name / "law_route.c").write_text(
            c_route.files(self.found._replace(route=route), "law")["law_route.c"]
        )
        shutil.copy(self.folder / "law.h", self.folder / name)
        return ctypes.addressof(
            ctypes.c_char.in_dll(library(self.folder / name, "law_route.c"), "law_configured_route")
        )

    def start(self, seen, route):
        """The state of the law that starts here."""
        state = np.zeros(self.size)
        now = np.concatenate([np.ravel(seen[name]) for name in ("position", "velocity", "heading", "yaw_rate")])
        pointers = [ctypes.c_void_p(x) for x in (self.tuned, state.ctypes.data, now.ctypes.data, route)]
        self.law.law_start(*pointers)
        return state

    def driving(self, route):
        state, output = [], Output()

        def step(seen):
            state[:] = state or [self.start(seen, route)]
            now = np.concatenate([np.ravel(seen[name]) for name in ("position", "velocity", "heading", "yaw_rate")])
            pointers = [ctypes.c_void_p(x) for x in (self.tuned, state[0].ctypes.data, now.ctypes.data, route)]
            self.law.law_step(*pointers, ctypes.byref(output))
            assert output.status == 0
            return output.left, output.right

        return step


@pytest.fixture(scope="module")
def compiled(exported, files_in_c, tmp_path_factory):
    return functools.cache(
        lambda name: Compiled(exported(name), files_in_c(name), tmp_path_factory.mktemp(f"c_{name}"))
    )


@needs_gcc
@pytest.mark.slow  # each law and each route takes seconds to compile
@pytest.mark.parametrize("kind", STARTS)
@pytest.mark.parametrize("name", LAWS)
def test_one_compiled_law_drives_every_kind_of_route_as_the_law_itself_does(name, kind, exported, compiled):
    """From beside it to its end, back on the second leg, over the seam, straight on where it crosses itself."""
    law, made, (route, seconds), start = exported(name).controller, compiled(name), laid(kind), STARTS[kind]
    wanted = drive(start, by_jax(law, route), seconds)
    for step in (made.driving(made.route(route, kind.replace(" ", "_"))), by_numpy(exported(name), route)):
        got = drive(start, step, seconds)
        assert got.shape == wanted.shape and np.abs(got - wanted).max() < 1e-9
    begins = np.asarray(route.table)[[0, 6]].T  # of its pieces
    assert np.linalg.norm(wanted[60:, None, :2] - begins, axis=-1).min(axis=1).max() < 0.35  # it does follow
    way = np.linalg.norm(np.diff(wanted[:, :2], axis=0), axis=1).sum()
    if kind == "stops":
        rests = np.diff(np.flatnonzero(np.r_[True, np.any(np.diff(wanted, axis=0) != 0, axis=1)])) - 1
        assert rests[rests > 0].tolist() == [30, 14, 5]  # periods, of 1.5, 0.7 and 0.26 s
    if kind in ("two legs", "stops"):
        assert len(wanted) < seconds / PERIOD and np.linalg.norm(wanted[-1, :2] - BAY[-1, :2]) < 0.05
    else:
        assert way > 1.02 * float(np.asarray(route.length))


@needs_gcc
@pytest.mark.parametrize("kind", STARTS)
def test_the_start_in_c_is_where_a_search_by_hand_has_it(kind, compiled):
    """The piece of the first leg whose beginning has the least distance^2 + (2 w sin(a / 2))^2, then what is nearest.

    A radian counts as w = 1 m, at most a tenth of the length; at most six pieces on, of points 1 mm apart.
    """
    made, (route, _) = compiled("path_pid"), laid(kind)
    where = made.route(route, f"searched_{kind}".replace(" ", "_"))
    length, legs = float(np.asarray(route.length)), np.asarray(route.legs)
    end, count = (legs[0, 1], int(legs[2, 1])) if legs.shape[1] > 1 else (length, route.table.shape[1])
    arcs = np.linspace(0.0, end, round(end / 1e-3), endpoint=False)
    points = np.asarray(jax.jit(jax.vmap(lambda arc: route.at(arc, jnp.zeros(())).position))(jnp.asarray(arcs)))
    begins, slopes = (np.asarray(route.table)[[k, 6 + k], :count].T for k in range(2))
    courses, rng, near = np.arctan2(slopes[:, 1], slopes[:, 0]), np.random.default_rng(1), 0
    for _ in range(300):
        spot = rng.integers(count)
        position, heading = begins[spot] + 0.2 * rng.normal(size=2), courses[spot] + 0.3 * rng.normal()
        state = made.start({"position": position, "velocity": np.zeros(2), "heading": heading, "yaw_rate": 0.0}, where)
        turned = (2 * min(1.0, length / 10) * np.sin((heading - courses) / 2)) ** 2
        best = np.argmin(np.sum((begins - position) ** 2, axis=1) + turned)
        away = (
            (arcs / end * count - best + count / 2) % count - count / 2 if route.closed else arcs / end * count - best
        )
        off = np.where(np.abs(away) <= 6.0, np.linalg.norm(points - position, axis=1), np.inf)
        nearest, found = away[np.argmin(off)], (state[0] / end * count - best + count / 2) % count - count / 2
        inside = abs(nearest) < 5.9
        near += inside
        assert abs(found - nearest) < (2e-3 * count / end if inside else 1.0) and state[1] == 0.0
    assert near > 100


ALONG = r"""
#include <math.h>
#include <stdio.h>
#include "law.h"
/* a unicycle in C: how far from the end given it stands still, on which leg, and how it moved last */
int main(void) {
    law_state state;
    law_measurement seen = {{(law_real)0.1, (law_real)0.15}, {0, 0}, (law_real)0.3, 0};
    law_output output;
    double x = 0.1, y = 0.15, heading = 0.3, v = 0.0, w = 0.0, last = 0.0;
    int k;
    law_start(&law_tuned, &state, &seen, &law_configured_route);
    for (k = 0; k < 1500; k++) {
        seen.velocity[0] = (law_real)(v * cos(heading));
        seen.velocity[1] = (law_real)(v * sin(heading));
        seen.yaw_rate = (law_real)w;
        seen.position[0] = (law_real)x;
        seen.position[1] = (law_real)y;
        seen.heading = (law_real)heading;
        law_step(&law_tuned, &state, &seen, &law_configured_route, &output);
        v = (double)(output.left + output.right) / 2;
        w = (double)(output.right - output.left) / 0.5;
        if (v == 0.0 && w == 0.0) break;
        last = v;
        x += 0.05 * v * cos(heading);
        y += 0.05 * v * sin(heading);
        heading += 0.05 * w;
    }
    printf("%d %.6f %.6f %.6f %d\n", k, x, y, last, (int)state.place_leg);
    return 0;
}
"""


@needs_gcc
@pytest.mark.parametrize("precision", [[], ["-DLAW_FLOAT"]], ids=["double", "float"])
def test_a_follower_in_c_drives_a_unicycle_in_c_backwards_into_the_bay(precision, files_in_c, tmp_path):
    for name, text in files_in_c("path_pid").items():
        (tmp_path / name).write_text(text)
    (tmp_path / "along.c").write_text(ALONG)
    command = ["gcc", *FLAGS, *precision, "along.c", "law.c", "law_route.c", "-o", "along", "-lm"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    said = subprocess.run([tmp_path / "along"], capture_output=True, text=True, check=True).stdout.split()
    periods, x, y, last, leg = int(said[0]), *map(float, said[1:])
    assert periods < 1499 and leg == 1 and last < 0
    assert np.hypot(x - 3.6, y + 2.5) < 0.03  # `reached` is 2 cm


@needs_gcc
@pytest.mark.parametrize("kind", ["two legs", *(pytest.param(k, marks=pytest.mark.slow) for k in ("seam", "dumbbell"))])
def test_the_self_test_passes_under_the_sanitizers_and_notices_a_wrong_route(kind, exported, files_in_c, tmp_path):
    """No row of a table is left, wherever NaN points to."""
    files = files_in_c("path_pid")
    if kind != "two legs":
        files = c.files(exported("path_pid")._replace(route=laid(kind)[0]), "law")
    for name, text in files.items():
        (tmp_path / name).write_text(text.replace("REPEATED 1000000L", "REPEATED 1000L"))
    strict = ["-O1", "-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"]
    for options in (strict, [*strict, "-DLAW_FLOAT", "-Wdouble-promotion", "-Wfloat-conversion"]):
        command = ["gcc", *FLAGS, *options, "law.c", "law_route.c", "main.c", "-o", "tested", "-lm"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        done = subprocess.run([tmp_path / "tested"], capture_output=True, text=True, check=False)
        assert done.returncode == 0 and "64 steps" in done.stdout, done.stdout + done.stderr
    text, right = (tmp_path / "law_route.c").read_text(), "((law_real)(x))"
    assert right in text
    (tmp_path / "law_route.c").write_text(text.replace(right, "((law_real)(1.001 * (x)))"))
    subprocess.run(["gcc", *FLAGS, "law.c", "law_route.c", "main.c", "-o", "wrong", "-lm"], cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "wrong"], capture_output=True, check=False).returncode == 1


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_no_number_that_is_not_finite_enters_the_place_on_a_route(wrong, exported):
    route = laid("seam")[0]
    space, found = {"__name__": "law"}, exported("path_pid")
    exec(numpy_file.files(found)["agv_controller.py"], space)
    data = {name: np.asarray(x) for name, x in tables.data(route).items()}
    good = {"position": np.array([2.0, -0.1]), "velocity": np.array([0.5, 0.0]), "heading": 0.1, "yaw_rate": 0.0}
    for name in good:
        controller, bad = space["Controller"](), good | {name: np.full(np.shape(good[name]), wrong)}
        controller.step(good, data)
        before = controller.state
        assert set(controller.step(bad, data).values()) == {0.0} and controller.status == "NOT_FINITE"
        assert controller.state == before and np.isinf(before["place.remaining"])  # of a closed route, and no fault
        controller.step(good, data)
        assert controller.status == "OK"
        late = space["Controller"]()
        late.step(bad, data)  # the first of all
        again = space["Controller"]()
        assert late.step(good, data) == again.step(good, data) and late.status == "STARTED"


def test_numpy_reads_its_route_and_tests_itself(exported, tmp_path):
    files = numpy_file.files(exported("path_pid"), "law")
    assert set(files) == {"law.py", "law_route.json"}
    imports = [n for n in ast.walk(ast.parse(files["law.py"])) if isinstance(n, (ast.Import, ast.ImportFrom))]
    assert {getattr(n, "module", None) or n.names[0].name for n in imports} == {
        "numpy",
        "json",
        "pathlib",
        "__future__",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    space = {"__name__": "law", "__file__": str(tmp_path / "law.py")}
    exec(files["law.py"], space)
    assert space["self_test"]() < 1e-12
    data = json.loads(files["law_route.json"])
    moved = data | {"coefficients": [[x + 0.01 for x in data["coefficients"][0]], *data["coefficients"][1:]]}
    (tmp_path / "law_route.json").write_text(json.dumps(moved))
    assert space["self_test"]() > 1e-3


@pytest.mark.slow
def test_stablehlo_takes_the_route_as_arguments(exported):
    found = exported("path_pid")
    law, files, route = found.controller, stablehlo.files(found), found.route
    module, signature = (
        jax.export.deserialize(bytearray(files["agv_controller.bin"])),
        json.loads(files["signature.json"]),
    )
    seen = agvjax.Measurement(
        position=jnp.array([2.0, 0.1]), velocity=jnp.array([0.5, 0.0]), heading=jnp.asarray(0.1), yaw_rate=jnp.zeros(())
    )
    state = jax.jit(law.inner.init)(seen, tables.to_follow(route))
    for shift in (0.0, 0.3):  # data and not part of the module: the route as it is, and moved aside
        table = np.array(route.table)
        table[6] += shift
        moved = agvjax.Route(**{**vars(route), "table": table})
        leaves = jax.tree.leaves((law, state, seen, tables.numbers(moved)))
        assert [list(np.shape(x)) for x in leaves] == [entry["shape"] for entry in signature["arguments"]]
        got = np.concatenate([np.ravel(np.asarray(x, float)) for x in module.call(*leaves)])[:-2]
        wanted = row(law, state, seen, tables.to_follow(moved))[-got.size :]
        np.testing.assert_allclose(got, wanted, rtol=1e-12, atol=1e-12)
    assert [entry["name"] for entry in signature["arguments"] if entry["group"] == "route"] == sorted(
        signature["route"]
    )


@pytest.mark.parametrize("form", ["c", "fmu", "nav2", "numpy", "ros2", "stablehlo"])
def test_gains_without_their_route_are_refused_and_say_what_lacks(form, tmp_path, capsys):
    write_config(tmp_path, LAWS["path_pid"])
    (tmp_path / "config.toml").unlink()
    command = ["export", str(tmp_path / "gains.toml"), "--format", form, "--out", str(tmp_path / "out")]
    assert main(command) == 2
    said = capsys.readouterr().err
    assert "scenario.path" in said and "type = 'route'" in said and "Traceback" not in said
    assert not (tmp_path / "out").exists()


@agvjax.pytree
class Narrow(agvjax.PathPID):
    """Slower where the corridor is narrow."""

    def steer(self, own, place, route, measurement, period):
        twist, own = super().steer(own, place, route, measurement, period)
        return (twist if place.room is None else twist * jnp.minimum(place.room[0], 1.0)), own


def test_a_law_that_looks_at_the_corridor_is_refused_as_that_is_not_exported():
    with pytest.raises(ValueError, match="corridor"):
        program.step(agvjax.Sampled(inner=Narrow(), vehicle=agvjax.Base()))


@pytest.mark.slow
def test_the_command_writes_the_route_of_another_path(files_in_c, tmp_path, capsys):
    """Which is how a robot that is driving already gets another one: the law is the same, character by character."""
    write_config(tmp_path, LAWS["path_pid"])
    out = tmp_path / "out"
    command = ["export", str(tmp_path / "gains.toml"), "--format", "c", "--name", "law", "--out", str(out)]
    assert main([*command, "--set", "scenario.path.points=[[0.0,0.0],[2.0,0.0],[4.0,1.0]]"]) == 0
    assert "law_route.c" in capsys.readouterr().out
    before, now = files_in_c("path_pid"), {file.name: file.read_text() for file in out.iterdir()}
    code = [
        text["law.c"].partition("char law_configuration")[2].partition(";")[2].partition("/*")[0]
        for text in (before, now)
    ]
    assert code[0] == code[1] and "law_step" in code[0]
    assert before["law_route.c"] != now["law_route.c"]
    told = json.loads(now["provenance.json"])["route"]
    assert (
        told["closed"] is False and told["legs"] == 1 and 4.2 < told["length"]["value"] < 4.4
    )  # 2 + sqrt(5), and a bend


@pytest.mark.parametrize("kind", ["two legs", "stops", "one stop"])
def test_no_row_of_the_self_test_lies_where_a_leg_ends(kind):
    """The speed there is sqrt(2 a s): what a float does not tell of s, 2e-7 m of 4, is 4e-4 m/s."""
    route, _ = laid(kind)
    begins = np.asarray(route.legs)[0]
    ends = np.append(begins[1:], float(np.asarray(route.length)))
    for leg, arc, ahead in _spots(route):
        assert begins[int(leg)] <= arc and ahead >= 0 and arc + ahead < ends[int(leg)] - 1e-3
