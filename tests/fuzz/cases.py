"""Inputs that a user, a disk or an editor could give the command line: drawn by a seed."""

import functools
import json
import random
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from tuning import config

SMALL = """
simulate.horizon=0.2 simulate.dt=0.005 simulate.integrator=euler sweep.dt=0.005 sweep.integrator=euler tune.dt=0.005
tune.integrator=euler tune.iterations=1 tune.search.checks=0 tune.search.scouts=4 tune.search.starts=1
tune.search.iterations=1 ensemble.size=2 ensemble.validation_size=2 sweep.samples=3 sweep.radius=false
pareto.points=1 identify.starts=1 identify.bootstrap=2 identify.drives=0
""".split()
COMMANDS = ("simulate", "tune", "sweep", "pareto", "doctor", "identify", "export", "reproduce", "compare", "vehicles")
COMMANDS += ("speed",)
WEIGHTS = (30, 15, 15, 6, 6, 12, 10, 2, 2, 2, 2)
RUNS = ("simulate", "sweep", "tune", "export", "pareto", "doctor", "identify")  # of those that are meant to be taken
RUN_WEIGHTS = (60, 15, 5, 20, 1, 1, 2)
VALUES = """
nan inf -inf 0 -0.0 -1 1e308 -1e308 5e-324 1e-300 1e300 0.5 1e5 2 3 1000000007 -7 true false '' 'x' [] [1] [1,2] [nan,1]
[[1,2],[3,4]] [[]] [1,'a'] {} {type='x'} {type=[1]} {a={b={c=1}}} {between=[0,1]} {times=[1,0]} {one_of=[]}
{distribution='lognorm',s=300} {distribution='norm'} {points=3} 1979-05-27 07:32:00 .3 5. 0x10 1_000 self
neuro_backstepping sampled osfc unicycle waypoints rk4 dumbbell '<img>' 'a\\u0000b' 'é' "../x" {file='absent.csv'}
""".split()
VALUES += ["1" * 400, "1" * 5000, "[" * 600, "x" * 5000, "{a=" * 100 + "1" + "}" * 100, " ", "=", "\t1", '"', "'''"]
SOUND = 0.4  # of the inputs, that are meant to be taken and to run to the end
STRUCTURES = """
scenario.path=circle scenario.path=lemniscate scenario.path.amplitude=1.0 scenario.heading=bearing
scenario.path={type='waypoints',points=[[0,0],[1,0.2],[2,1],[2,2.5]],speed=0.5} scenario.path={type='line'}
scenario.disturbance=none scenario.disturbance={type='step',time=0.1} scenario.disturbance={type='band_limited_noise'}
scenario.disturbance={type='recorded',times=[0,0.1],values=[[0,0,0],[1,0,0.1]]} scenario.disturbance=cosine_sum
scenario.sensor={type='noise'} simulate.save_every=2 simulate.control_every=2 simulate.integrator=heun precision=32
simulate.horizon=0.3 seed=7 ensemble.fresh=true ensemble.size=3
""".split()
LAWS = """
backstepping full_weight osfc asmc dfc ftsmc super_twisting_ftsmc event_triggered fractional
{type='sampled',period=0.01}
""".split()
ELEMENTS = "deadzone saturation quantisation lag backlash rate_limit".split()  # a delay has slots to be set with it
DRIVE = (Path(__file__).parents[2] / "notebooks" / "logs" / "robot-excited.csv").read_bytes().splitlines(keepends=True)
LONG = ("tune", "pareto", "doctor")  # to compile, of any other vehicle
STUDIES = ("reproduce", "compare", "vehicles", "speed")  # minutes, whatever is set: they are only to be refused
PRESETS = ("", "unicycle", "car", "robot")
DEBRIS = (
    b"",
    b"\xff\xfe",
    b"\0" * 50,
    b"x =",
    b"[" * 5000,
    b"seed = 1\nseed = 2",
    b"a." * 3000 + b"b=1",
    b"{",
    b",,\n,,",
)
FLAGS = {
    "simulate": ["--animate", "--from", "--index", "--controller"],
    "tune": ["--resume", "--num-processes", "--process-id", "--coordinator"],
    "sweep": ["--resume", "--over", "--ensemble", "--samples", "--design", "--controller", "--process-id"],
    "identify": ["--unseen", "--fit"],
    "speed": ["--within", "--resume"],
    "export": ["--format", "--name"],
}
COMMON = ["--seed", "--precision", "--config", "--set", "--import", "--quiet"]
BARE = {"--animate", "--resume", "--ensemble", "--quiet"}
ODD = [
    "",
    "-1",
    "0",
    "1",
    "x",
    "nan",
    "1e400",
    "absent.toml",
    ".",
    "/dev/null",
    "/dev/zero",
    "file",
    "osfc",
    "a=b",
    "é",
    "\udcff",
]
ODD += [
    "start.heading=0:1:3",
    "start.heading=1:0:3",
    "start.heading=0:1:1000000000000",
    "controller.k1=nan:1:2",
    "=0:1:2",
]
ODD += [
    "start.position=0:1:2",
    "start.heading*=0:2",
    "plant.mass=0,1",
    "9" * 30,
    "c",
    "numpy",
    "deadzone,delay",
    "localhost",
]


class Case(NamedTuple):
    """One call of the command line, with the files that lie in its folder."""

    argv: list[str]
    files: dict[str, str]  # name -> bytes in hexadecimal


@functools.cache
def keys(presets: Sequence[str] = PRESETS) -> dict[str, Any]:
    """Every key of these presets' resolved configurations, and what stands there."""
    every: dict[str, Any] = {}

    def walk(table: object, prefix: str) -> None:
        if isinstance(table, dict) and table:
            for name, part in table.items():
                walk(part, f"{prefix}{name}.")
        every[prefix[:-1]] = table

    for preset in presets:
        walk(tomllib.loads(config.dump(config.load([preset] if preset else []))), "")
    return {key: value for key, value in every.items() if key}


def _near(rng: random.Random, value: object) -> object:
    """Another value of the same kind: numbers a little, or by powers of ten, larger or smaller."""
    if isinstance(value, bool) or not isinstance(value, int | float | list):
        return value
    if isinstance(value, list):
        return [_near(rng, part) for part in value]
    if isinstance(value, int):
        return max(1, value + rng.choice([-1, 0, 1]))
    return value * 10 ** rng.uniform(*rng.choice([(-0.1, 0.1), (-0.1, 0.1), (-1, 1), (-4, 4)]))


def _sound(rng: random.Random) -> Case:
    """An input that has a reason to be taken: gains, plants, paths, elements and draws with values of their kinds."""
    command = rng.choices(RUNS, RUN_WEIGHTS)[0]
    preset = rng.choice(PRESETS) if command in ("simulate", "sweep") else "robot" if command == "identify" else ""
    argv, files = [command, "--out", "out"], {}
    own = keys((preset,))
    places = [key for key, x in own.items() if key.startswith(("controller.", "scenario.")) and _tunable(x)]
    if command == "export":
        form = rng.choice(["c", "fmu", "nav2", "numpy", "ros2", "stablehlo"])
        kind = "base" if form == "nav2" else rng.choice(["unicycle", "car", "robot"])
        files["gains.toml"] = config.dump(config.load([kind])).encode().hex()
        return Case([*argv, "gains.toml", "--format", form], files)
    argv += ["--config", preset] if preset else []
    for setting in SMALL:
        argv += ["--set", setting]
    if command == "identify":
        first = 1 + 50 * rng.randrange(20)
        files["log.csv"] = b"".join([DRIVE[0], *DRIVE[first : first + 500]]).hex()
        return Case([*argv, "log.csv", "--fit", rng.choice(["delay", "deadzone", "vehicle"])], files)
    if not preset and command != "pareto" and rng.random() < 0.4:
        argv += ["--set", f"controller={rng.choice(LAWS)}"]
        places = [key for key in places if not key.startswith("controller.")]
    for setting in rng.sample(STRUCTURES, rng.choice([0, 1, 1, 2])):
        argv += ["--set", setting]
    if rng.random() < 0.3:
        actuators = list(own["scenario.deadzone"])
        argv += ["--set", f"scenario.actuators.{rng.choice(actuators)}.{rng.choice(ELEMENTS)}={{}}"]
    for key in rng.sample(places, rng.choice([0, 1, 2, 3])):
        argv += ["--set", f"{key}={json.dumps(_near(rng, own[key]))}"]
    if command == "sweep" and rng.random() < 0.8:
        key = rng.choice(["start.heading", "disturbance.amplitude", "limit"])
        argv += ["--over", f"{key}={rng.uniform(0.1, 1):.3g}:{rng.uniform(1, 3):.3g}:{rng.randrange(2, 5)}"]
    if rng.random() < 0.2:
        argv += rng.choice([["--quiet"], ["--seed=3"], ["--precision=32"]])
    return Case(argv, files)


def _tunable(value: object) -> bool:
    return isinstance(value, float) or (isinstance(value, list) and value != [] and all(map(_tunable, value)))


def _log(rng: random.Random) -> bytes:
    """Thirty rows of a drive, one cell of them odd."""
    rows = [[f"{0.02 * i:.2f}", *(f"{rng.uniform(-1, 1):.4f}" for _ in range(5))] for i in range(30)]
    rows[rng.randrange(30)][rng.randrange(6)] = rng.choice(
        ["nan", "1e308", "", "x", "-1e300", "1e5", "inf", "1_0", "0"]
    )
    header = rng.choice(["t,x,y,heading,acceleration,yaw_acceleration", "t,x,y,psi,a,b", "t;x;y", "t,t,x,y,heading,v"])
    return "\n".join([header, *map(",".join, rows)]).encode()


def _damaged(rng: random.Random, text: bytes) -> bytes:
    data = bytearray(text)
    for _ in range(rng.choice([1, 1, 3])):
        at = rng.randrange(len(data))
        kind = rng.randrange(3)
        data[at : at + (kind > 0)] = b"" if kind == 1 else bytes([rng.choice(b"=[]{}\"'0.e-,\n\0z")])
    return bytes(data[: rng.randrange(len(data))] if rng.random() < 0.2 else data)


def _file(rng: random.Random, name: str, settings: bytes) -> bytes:
    if rng.random() < 0.3:
        return rng.choice(DEBRIS)
    if name.endswith(".csv"):
        return _log(rng)
    if name.endswith(".json"):
        table = {"format": 1, "digest": "0", "size": 3, "shard": 3, "names": ["a"], "controllers": [""], "seed": 0}
        table |= {"metrics": {}, "leaves": {}, "config": "", "versions": {}, "shards": [[0, 3]]}
        table[rng.choice(list(table))] = rng.choice([None, 1, -1, "x", [], {}, 1e300, [[[]]]])
        return json.dumps(table).encode()
    return _damaged(rng, settings)


def draw(seed: int) -> Case:
    """The input of a seed."""
    rng = random.Random(seed)
    return _sound(rng) if rng.random() < SOUND else _odd(rng, list(keys()))


def _odd(rng: random.Random, names: list[str]) -> Case:
    """An input that is most likely refused: values, files and options that nobody should give."""
    command = rng.choices(COMMANDS, WEIGHTS)[0]
    preset = rng.choice(PRESETS) if command not in LONG else ""
    argv, files = [command, "--out", "out"], {}
    settings = config.dump(config.load([preset] if preset else [])).encode()
    for setting in SMALL if command != "export" else ():
        argv += ["--set", setting]
    if preset:
        argv += ["--config", preset]
    for _ in range(rng.choice([0, 1, 1, 1, 2, 4])):
        key = rng.choice(names)
        if rng.random() < 0.1:
            key = rng.choice(
                [f"{key}.self", f"{key}.x.y", key.upper(), f'"{key}"', key.partition(".")[2] or "a", f"{key}."]
            )
        argv += ["--set", f"{key}={rng.choice(VALUES)}"]
    if command == "identify" and rng.random() < 0.8:
        files["log.csv"] = _file(rng, "log.csv", settings).hex()
        argv.append("log.csv")
    if command == "export":
        files["gains.toml"] = _file(rng, "gains.toml", settings).hex()
        argv += ["gains.toml", "--format", rng.choice(["c", "fmu", "nav2", "numpy", "ros2", "stablehlo"])]
    if rng.random() < 0.25:
        files["mine.toml"] = _file(rng, "mine.toml", settings).hex()
        argv += ["--config", "mine.toml"]
    if command in ("simulate", "sweep", "tune") and rng.random() < 0.1:
        folder, name = ("out", "config.toml") if command == "tune" else ("out", "manifest.json")
        files[f"{folder}/{name}"] = _file(rng, name, settings).hex()
        argv += ["--from", "out", "--index", "0", "--out", "other"] if command == "simulate" else ["--resume"]
    for _ in range(rng.choice([0, 0, 0, 1, 2])):
        flag = rng.choice(FLAGS.get(command, []) + COMMON)
        argv += [flag] if flag in BARE else [f"{flag}={rng.choice(ODD)}"]
    if command in STUDIES:
        argv.append(f"--precision={rng.choice(['', 'x', '1', 'nan', '64.5'])}")
    return Case(argv, files)
