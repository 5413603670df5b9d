"""The controller on realistic vehicle models: every figure of `agvjax vehicles`."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import agvjax
from agvjax import NeuroBackstepping, NoAntiWindup, Sampled, Scenario, Start, Unicycle

from ...config.settings import Config
from ...ensemble.draws import Between, sample
from ...io.files import Json
from ...tune.problem import pose
from ...tune.rounds import solve
from .drive import Drive, drive
from .worlds import CommonRoadWorld, RobotWorld

BAND, LATE, G = 0.05, 4.0, 9.81  # m, s, m/s^2
LAPS, CAR_LATE, CAR_STARTS = 2, 10.0, 20  # laps of the car's path, when its error counts, and how many starts
UNSEEN = 64  # vehicles with limits that no tuning saw
FAR = (-2.1, 2.1)  # m, 3 m off the path


class Told(NamedTuple):
    """What is said of one run."""

    ok: bool
    rmse: float  # m, of the distance to the reference
    settling: float  # s, last time outside the band; infinite where it is outside in the last second
    late: float  # m, largest after `LATE`


class Study(NamedTuple):
    """Everything the report shows."""

    paper: dict[str, Told]  # the paper's gains on the unicycle
    peaks: dict[str, float]
    lost: int  # of `starts`, with 20 ms of delay
    starts: int
    limited: dict[str, Told]
    unseen: Told  # the worst of the validation starts in each
    car: dict[str, dict[str, float]]
    robot: list[Json]
    tuned: dict[str, tuple[agvjax.Law, agvjax.Law]]  # controllers before and after
    runs: Json  # for the figures
    without: list[str]  # what could not be run, and why


def told(t: np.ndarray | Array, error: np.ndarray | Array, ok: bool = True, late: float = LATE) -> Told:
    """What is said of a distance over time."""
    t, error = np.asarray(t), np.asarray(error)
    outside = t[error > BAND]
    settled = not outside.size or outside[-1] < t[-1] - 1.0
    settling = (float(outside[-1]) if outside.size else 0.0) if settled and ok else np.inf
    rmse = float(np.sqrt(np.trapezoid(error**2, t) / t[-1]))
    return Told(bool(ok), rmse, settling, float(error[t >= late].max()))


def distance(run: agvjax.Trajectory) -> np.ndarray:
    """Of the reference point to where it should be [m]."""
    return np.linalg.norm(np.asarray(run.position) - np.asarray(run.reference_position), axis=-1)


def of_run(run: agvjax.Trajectory) -> Told:
    """What is said of a trajectory."""
    return told(run.t, distance(run), bool(run.ok))


def tuned(config: Config) -> Any:  # a sampled law, as the presets have it
    """The gains that a search from the configured ones ends with; all else is left to `agvjax tune`."""
    brief = dataclasses.replace(config.tune.search, rounds=0, starts=1, iterations=1, scouts=1, checks=0)
    brief = dataclasses.replace(config, tune=dataclasses.replace(config.tune, search=brief, screen=0))
    return solve(pose(brief)).controller


def delayed(scenario: agvjax.Scenario, time: float) -> agvjax.Scenario:
    """The scenario with every actuator that much late and nothing else in its way."""
    chain = agvjax.Chain(delay=agvjax.Delay(time=time))
    return dataclasses.replace(scenario, actuators=dict.fromkeys(scenario.plant.actuators, chain))


def paper_gains(config: Config) -> Json:
    """The paper's gains on the unicycle: continuous, sampled, by Euler, with delay; and from how many starts."""
    plain, law = Scenario.of(Unicycle()), Sampled(vehicle=Unicycle())
    late = delayed(plain, 0.02)
    runs = {
        "continuous": agvjax.simulate(NeuroBackstepping(), plain),
        "50 Hz, exact": agvjax.simulate(law, plain),
        "50 Hz, Euler": agvjax.simulate(dataclasses.replace(law, euler=True), plain),
        "50 Hz, exact, 20 ms late": agvjax.simulate(law, late),
    }
    draws = {"start.position": Between(-0.5, 0.5), "start.heading": Between(-0.5, 1.0)}
    many = agvjax.evaluate(law, sample(late, draws, 64, config.seed))
    first = runs["continuous"]
    virtual, inputs = (np.abs(np.asarray(x[0])) for x in (first.command, first.inputs))
    peaks = {"virtual": float(virtual.max()), "acceleration": float(inputs[0]), "yaw_acceleration": float(inputs[1])}
    return {
        "paper": {name: of_run(run) for name, run in runs.items()},
        "peaks": peaks,
        "lost": int((~np.asarray(many.ok)).sum()),
        "starts": 64,
        "runs": runs,
    }


def limited(config: Config) -> Json:
    """The unicycle with limits and delay: gains set by hand, tuned, and tuned but without anti-windup."""
    after = tuned(config)
    laws = {
        "by hand": config.controller,
        "tuned": after,
        "tuned, no anti-windup": dataclasses.replace(after, anti_windup=NoAntiWindup()),
    }
    judged, runs = {}, {}
    for name, law in laws.items():
        for where, start in (("paper's start", Start()), ("3 m off", Start(position=jnp.array(FAR)))):
            runs[f"{name}, {where}"] = run = agvjax.simulate(law, dataclasses.replace(config.scenario, start=start))
            judged[f"{name}, {where}"] = of_run(run)
    unseen = sample(config.scenario, config.ensemble.draws, UNSEEN, config.seed + 1)
    t, errors, ok, _ = _many(after, unseen, config.simulate.dt, 12.0)
    each = [told(t, error, good) for error, good in zip(errors, ok, strict=True)]
    worst = Told(all(x.ok for x in each), *(max(getattr(x, f) for x in each) for f in ("rmse", "settling", "late")))
    return {"limited": judged, "unseen": worst, "tuned": (config.controller, after), "runs": runs}


def _many(
    law: agvjax.Law, batch: agvjax.Batch, dt: float, horizon: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, agvjax.Trajectory]:
    """Instants, distances (B, N), which are sound, and the trajectories, of a batch."""
    every = max(1, round(0.02 / dt))
    steps = round(horizon / dt) // every * every
    rolled = jax.vmap(
        lambda scenario: agvjax.simulate(law, scenario, dt=dt, n_steps=steps, save_every=every), in_axes=(batch.axes,)
    )
    runs = jax.device_get(jax.jit(rolled)(batch.scenario))
    return runs.t[0], distance(runs), runs.ok, runs


def car(config: Config) -> Json:
    """Two laps from starts it was not tuned on, in our model and, nominal, in CommonRoad's own."""
    after = tuned(config)
    unseen = sample(config.scenario, config.ensemble.draws, CAR_STARTS, config.seed + 1)
    horizon = LAPS * 2 * np.pi / float(agvjax.leaves(config.scenario)["path.omega"])
    rows, drawn = {}, {}
    for name, law in (("by hand", config.controller), ("tuned", after)):
        t, errors, ok, runs = _many(law, unseen, config.simulate.dt, horizon)
        rows[f"{name}, {CAR_STARTS} starts"] = _car_row(config, t, errors, runs, bool(ok.all()))
        drawn[name] = jax.tree.map(lambda x: x[0], runs)
    without = []
    try:
        nominal = dataclasses.replace(config.scenario, disturbance=agvjax.NoDisturbance())
        driven = drive(CommonRoadWorld(), agvjax.check(after), agvjax.check(nominal), horizon)
        assert isinstance(driven, Drive)
        rows["tuned, CommonRoad's own model"] = _car_row(config, driven.t, driven.error[None], _one(driven), True)
    except ImportError as error:
        without.append(str(error))
    return {"car": rows, "tuned": (config.controller, after), "runs": drawn, "without": without}


def _one(driven: Drive) -> Any:
    """A drive with a leading axis, as a batch of trajectories has."""
    return Drive(*(np.asarray(x)[None] for x in driven))


def _car_row(config: Config, t: np.ndarray, errors: np.ndarray, runs: agvjax.Trajectory, ok: bool) -> dict[str, float]:
    plant: Any = config.scenario.plant  # a single track, as the preset has it
    late = np.asarray(t) >= CAR_LATE
    delivered = np.abs(np.asarray(runs.delivered)).max(axis=(0, 1))
    row = {"ok": ok, "late": float(errors[:, late].max()), "acceleration": delivered[0], "steering_rate": delivered[1]}
    row["limited"] = float(np.asarray(runs.limited).mean(axis=1).max())
    psi = np.asarray(runs.heading)[0][late]
    for name, behind in (("center of gravity", float(plant.lf)), ("rear axle", float(plant.L))):
        place = np.asarray(runs.position)[0][late] - behind * np.stack([np.cos(psi), np.sin(psi)], axis=1)
        row[name] = float(_off_path(config.scenario.path, place).max())
    return {key: float(value) for key, value in row.items()}


def _off_path(path: Any, places: np.ndarray) -> np.ndarray:
    """Distance of places (N, 2) to the path as a curve [m]."""
    lap = 2 * np.pi / float(path.omega)
    curve = np.asarray(jax.vmap(path)(np.linspace(0, lap, 20_001)))
    return np.array([np.min(np.hypot(*(curve - place).T)) for place in places[::5]])


def unseen_paths() -> Json:
    """Paths that the robot is not tuned on: a circle, a lemniscate, and a closed spline through eight points."""
    corners = np.array([[0, 0], [1.2, -0.2], [2.0, 0.5], [1.5, 1.4], [0.6, 1.0], [-0.4, 1.6], [-1.2, 1.0], [-0.9, 0.2]])
    return {
        "circle": agvjax.Circle(radius=1.0, omega=0.6),
        "lemniscate": agvjax.Lemniscate(amplitude=1.2, omega=0.5),
        "spline": agvjax.Waypoints.through(corners, speed=0.5, closed=True),
    }


def robot(config: Config) -> Json:
    """Tuned on our plant, driven in MuJoCo: the paper's law as it is, its gains in the same structure, tuned gains."""
    after = tuned(config)
    laws = {
        "paper's law as it is": Sampled(vehicle=after.vehicle),
        "paper's gains": dataclasses.replace(after, inner=NeuroBackstepping()),
        "tuned gains": after,
    }
    rows, drawn, without = [], {}, []
    try:
        world = RobotWorld(float(agvjax.leaves(config.scenario)["plant.L"]))
    except ImportError as error:
        return {"robot": rows, "tuned": (config.controller, after), "runs": drawn, "without": [str(error)]}
    for path_name, path in unseen_paths().items():
        origin = np.asarray(path(np.float64(0.0)))
        start = Start(position=jnp.asarray(origin + [-0.3, 0.3]), velocity=jnp.zeros(2), heading=0.5)
        scene = dataclasses.replace(config.scenario, path=path, heading=agvjax.Tangent(), start=start)
        quiet = dataclasses.replace(scene, sensor=None)
        for law_name, law in laws.items():
            noisy, clean = (drive(world, agvjax.check(law), agvjax.check(s), 12.0) for s in (scene, quiet))
            assert isinstance(noisy, Drive) and isinstance(clean, Drive)
            rows.append({"path": path_name, "law": law_name} | _robot_row(noisy, clean))
            drawn[path_name, law_name] = noisy
    return {"robot": rows, "tuned": (config.controller, after), "runs": drawn, "without": without}


def _robot_row(noisy: Drive, clean: Drive) -> dict[str, float]:
    seen, still = told(noisy.t, noisy.error), told(clean.t, clean.error)
    return {
        "rmse": seen.rmse,
        "late": seen.late,
        "late_without_noise": still.late,
        "rms_torque": float(np.sqrt(np.mean(np.sum(noisy.delivered**2, axis=1)))),
        "variation": float(np.abs(np.diff(noisy.delivered, axis=0)).sum()),
    }


def study(configs: Mapping[str, Config], tick: Callable[[str], None]) -> Study:
    """All of it; `tick(name)` as each part is done."""
    parts: dict[str, Json] = {}
    makers = {"paper": paper_gains, "unicycle": limited, "car": car, "robot": robot}
    for name, make in makers.items():
        parts[name] = make(configs["unicycle" if name == "paper" else name])
        tick(name)
    fields = {key: value for part in parts.values() for key, value in part.items() if key in Study._fields}
    fields["tuned"] = {name: part["tuned"] for name, part in parts.items() if "tuned" in part}
    fields["runs"] = {name: part["runs"] for name, part in parts.items()}
    fields["without"] = [text for part in parts.values() for text in part.get("without", [])]
    return Study(**fields)
