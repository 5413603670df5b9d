"""Exported FMUs in FMPy, which reads and runs them by the standard alone: law and vehicle beside `simulate`."""

import dataclasses
import functools
import io
import json
import re
import shutil
import socket
import subprocess
import zipfile
from xml.etree import ElementTree

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax._pytree import POSITIVE
from agvjax.leaves import replace
from agvjax.paths.heading import reference
from commands import ROOT
from tuning import config as configuration
from tuning.cli.main import main
from tuning.export import artefact, program
from tuning.export.fmu import archive, controller, plant
from tuning.export.fmu.description import Model, fmi2, fmi3
from tuning.export.fmu.units import powers
from tuning.export.fmu.variables import TUNABLE, Variable, check, clock

fmpy = pytest.importorskip("fmpy")
from fmpy.fmi2 import FMU2Slave  # noqa: E402
from fmpy.fmi3 import FMU3Slave  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler is installed")
STRICT = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic", "-fPIC", "-shared"]
VERSIONS = ("fmi2", "fmi3")
TIMED = agvjax.Sampled(
    inner=agvjax.NeuroBackstepping(k1=3.0, k2=10.0, Lam=2.0, omega_n=30.0),
    vehicle=agvjax.Unicycle(),
    anti_windup=agvjax.BackCalculation(speed=0.8, limits=np.array([3.0, 6.0])),
)
PAPER = ['controller.type="sampled"', "simulate.dt=0.005", "simulate.horizon=4.0"]
TURNED = ["simulate.horizon=4.0", "scenario.start.heading=0.3"]
CASES = {  # presets and changes
    "route": (["base"], ["simulate.horizon=4.0", "scenario.start.position=[8.5, -0.2]", "scenario.start.heading=0.3"]),
    "paper": ([], PAPER),
    "unicycle": (["unicycle"], ["simulate.horizon=4.0"]),
    "car": (["car"], ["simulate.horizon=4.0"]),
    "robot": (["robot"], ['scenario.sensor="none"', "ensemble.draws={}", "simulate.horizon=4.0"]),
    "ackermann": (["ackermann"], TURNED),
    "forklift": (["forklift"], TURNED),
    "late": (
        ["base"],
        ["simulate.horizon=4.0", "scenario.start.heading=0.3", "scenario.actuators.left.delay.jitter=0.03"],
    ),
    "pushed": ([], [*PAPER, 'scenario.disturbance={type="step", time=1.237, amplitude=0.3}']),
    "rough": ([], [*PAPER, 'scenario.disturbance={type="band_limited_noise", seed=3.0}']),
}
ELEMENTS = "delay={time=0.03, jitter=0.01, slots=4}, saturation={upper=2.0, lower=-2.0}, quantisation={step=0.01}"
ELEMENTS += ", lag={time_constant=0.05}, backlash={gap=0.02}, rate_limit={rate=20.0}"
CASES["every element"] = (["unicycle"], ["simulate.horizon=4.0", f"scenario.actuators.acceleration={{{ELEMENTS}}}"])
ICE = 'scenario.plant.surface={type="patch", center=[0.5, 1.0], radius=2.0, factor=0.3}'
CASES["icy car"] = (["car"], ["simulate.horizon=4.0", ICE])
each_version = pytest.mark.parametrize("version", VERSIONS)


@functools.cache
def config(name):
    return configuration.load(*CASES[name])


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Archives of law and vehicle of a case, by version."""

    @functools.cache
    def of(name):
        folder, found = tmp_path_factory.mktemp(name), {}
        (folder / "gains.toml").write_text(configuration.gains_table(config(name).controller))
        (folder / "config.toml").write_text(configuration.dump(config(name)))
        known = artefact.read(str(folder / "gains.toml"))
        for kind, form in (("law", controller), ("vehicle", plant)):
            for file, content in form.files(known).items():
                (folder / file).write_bytes(content if isinstance(content, bytes) else content.encode())
                version = file.split(".")[1]
                if version in VERSIONS:
                    found[kind, version] = folder / file
                    with zipfile.ZipFile(folder / file) as archive:
                        archive.extractall(folder / f"{kind}_{version}")
        return found

    return of


class Unit:
    """An instance of an FMU, its variables by name."""

    def __init__(self, file, kind, version, name="one"):
        self.about = fmpy.read_model_description(str(file))
        folder, kinds = str(file.parent / f"{kind}_{version}"), {"fmi2": FMU2Slave, "fmi3": FMU3Slave}
        identity = self.about.coSimulation.modelIdentifier
        self.said, self.version = [], version
        self.fmu = kinds[version](
            guid=self.about.guid, unzipDirectory=folder, modelIdentifier=identity, instanceName=name
        )
        self.references = {v.name: v.valueReference for v in self.about.modelVariables}
        if version == "fmi3":
            self.fmu.instantiate(logMessage=lambda environment, status, category, text: self.said.append(text.decode()))
        else:
            from fmpy import fmi2

            self.log = fmi2.fmi2CallbackLoggerTYPE(lambda c, n, s, category, text: self.said.append(text.decode()))
            calls = fmi2.fmi2CallbackFunctions()
            calls.logger, calls.allocateMemory = self.log, fmi2.fmi2CallbackAllocateMemoryTYPE(fmi2.calloc)
            calls.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmi2.free)
            self.fmu.instantiate(callbacks=calls)

    def begin(self, time=0.0, **values):
        if self.version == "fmi2":
            self.fmu.setupExperiment(startTime=time)
        self.set(**values)
        self.fmu.enterInitializationMode(**({} if self.version == "fmi2" else {"startTime": time}))
        self.fmu.exitInitializationMode()
        return self

    def set(self, values=None, **more):
        values = {**(values or {}), **more}
        (self.fmu.setReal if self.version == "fmi2" else self.fmu.setFloat64)(
            [self.references[name] for name in values], [float(x) for x in values.values()]
        )

    def get(self, prefix):
        names = [name for name in self.references if name.startswith(prefix) and name not in ("limited", "status")]
        numbers = [self.references[name] for name in names]
        values = self.fmu.getReal(numbers) if self.version == "fmi2" else self.fmu.getFloat64(numbers)
        return dict(zip(names, values, strict=True))

    def status(self):
        numbers = [self.references["status"]]
        return (self.fmu.getInteger(numbers) if self.version == "fmi2" else self.fmu.getInt32(numbers))[0]

    def step(self, time, size):
        self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=size)


def asked(name):
    """What is asked for at a time, by variable; nothing of a law that follows a route."""
    case = config(name)
    if case.controller.follows():
        return lambda t: {}
    at = jax.jit(lambda t: reference(case.scenario.path, case.scenario.heading, t))

    def variables(t):
        found = {}
        for field, x in vars(at(jnp.asarray(t))).items():
            if x is not None:
                ends = ("_x", "_y") if np.ndim(x) else ("",)
                found |= zip((f"reference.{field}{end}" for end in ends), np.ravel(x).tolist(), strict=True)
        return found

    return variables


def drive(law, vehicle, name, periods, part=1):
    """The loop of a master that steps the law before the vehicle, `part` communication steps in a period."""
    period, seen, wanted = float(config(name).controller.period), [], asked(name)
    for k in range(periods):
        seen.append(vehicle.get("measurement."))
        law.set({**seen[-1], **wanted(k * period)})
        for i in range(part):
            t = (k + i / part) * period
            law.step(t, period / part)
            vehicle.set(law.get("command."))
            vehicle.step(t, period / part)
    return np.array([list(row.values()) for row in seen]), list(seen[0])


def loop(files, version, name, **options):
    """Both, started, and driven."""
    law, vehicle = (Unit(files[kind, version], kind, version).begin() for kind in ("law", "vehicle"))
    periods = round(config(name).simulate.horizon / float(config(name).controller.period))
    return drive(law, vehicle, name, periods, **options)


@functools.cache
def simulated(name):
    """Position, velocity and heading at the law's instants."""
    case = config(name)
    every = round(float(case.controller.period) / case.simulate.dt)
    run = agvjax.simulate(case.controller, case.scenario, save_every=every, **case.timing())
    assert run.ok
    return np.concatenate([run.position, run.velocity, run.heading[:, None]], axis=1)[:-1]


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in CASES if name != "paper"]


@pytest.mark.parametrize("name", ["paper", *SLOW])
def test_law_and_vehicle_drive_as_the_simulator_does(name, exported):
    wanted = simulated(name)
    assert np.ptp(wanted[:, :2], axis=0).min() > 0.03 and np.ptp(wanted[:, 4]) > 0.05  # it does move, and turn
    for version in VERSIONS:
        got, names = loop(exported(name), version, name)
        assert names[:5] == [
            f"measurement.{x}" for x in ("position_x", "position_y", "velocity_x", "velocity_y", "heading")
        ]
        deviation = np.abs(got[:, :5] - wanted).max()
        print(f"{name} {version}: {deviation:.1e}")
        assert deviation < 1e-9


@each_version
@pytest.mark.parametrize("kind", ["law", "vehicle"])
@pytest.mark.parametrize("name", ["route", "paper"])
def test_fmpy_finds_no_problem(name, kind, version, exported):
    assert validate_fmu(str(exported(name)[kind, version])) == []


@each_version
def test_fmpys_own_master_runs_each_alone(version, exported):
    """A vehicle that is sent .5 m/s straight on: both wheels deliver .95 (.5 - .06) m/s once .08 s have passed."""
    files = exported("route")
    out = fmpy.simulate_fmu(str(files["law", version]), stop_time=1.0, output=["command.left"])
    assert len(out) == 21 and np.isfinite(out["command.left"]).all()
    start = {"command.left": 0.5, "command.right": 0.5, "start.heading": 0.0}
    names = ["delivered.left", "measurement.velocity_x"]
    out = fmpy.simulate_fmu(str(files["vehicle", version]), stop_time=2.0, start_values=start, output=names)
    late = np.round(out["time"] / 0.005) >= 17  # of the step that begins then, at the latest
    assert np.allclose(out["delivered.left"][late], 0.418, rtol=1e-12)
    assert not out["delivered.left"][out["time"] < 0.08].any() and abs(out["measurement.velocity_x"][-1] - 0.418) < 1e-5


@each_version
def test_an_instance_drives_the_same_again_after_a_reset_and_beside_another(version, exported):
    files, name = exported("route"), "route"
    law, vehicle = (Unit(files[kind, version], kind, version).begin() for kind in ("law", "vehicle"))
    first, _ = drive(law, vehicle, name, 40)
    for unit in (law, vehicle):
        unit.fmu.reset()
        unit.begin()
    again, _ = drive(law, vehicle, name, 40)
    assert np.array_equal(first, again)
    pairs = []
    for turn in (0.0, 0.6):  # two loops, period by period: the second starts turned and with other gains
        law, vehicle = (Unit(files[kind, version], kind, version, f"{kind}{turn}") for kind in ("law", "vehicle"))
        gains = {"inner.lookahead_dist": 0.9} if turn else {}
        pairs.append((law.begin(**gains), vehicle.begin(**{"start.heading": 0.3 + turn})))
    period, seen = 0.05, ([], [])
    for k in range(40):
        for (law, vehicle), row in zip(pairs, seen, strict=True):
            now = vehicle.get("measurement.")
            row.append(list(now.values()))
            law.set(now)
            law.step(k * period, period)
            vehicle.set(law.get("command."))
            vehicle.step(k * period, period)
    assert np.array_equal(seen[0], first) and np.abs(np.array(seen[1]) - first).max() > 0.1


@each_version
def test_a_state_is_saved_restored_and_serialised(version, exported):
    files = exported("paper")
    law = Unit(files["law", version], "law", version).begin()
    seen = {"measurement.position_x": 0.3, "measurement.heading": 0.2, "reference.velocity_x": 0.4}
    law.set(seen)
    for k in range(5):
        law.step(0.02 * k, 0.02)
    save, use = ("getFMUstate", "setFMUstate") if version == "fmi2" else ("getFMUState", "setFMUState")
    pack, unpack = ("serializeFMUstate", "deSerializeFMUstate") if version == "fmi2" else ("serializeFMUState",) * 2
    kept = getattr(law.fmu, save)()
    data = getattr(law.fmu, pack)(kept)

    def onward(unit):
        for k in range(5, 9):
            unit.step(0.02 * k, 0.02)
        return unit.get("command.")

    wanted = onward(law)
    getattr(law.fmu, use)(kept)
    assert onward(law) == wanted
    other = Unit(files["law", version], "law", version, "two").begin()
    getattr(other.fmu, use)(getattr(other.fmu, unpack.replace("serializeFMUState", "deserializeFMUState"))(data))
    assert onward(other) == wanted
    getattr(law.fmu, save.replace("get", "free"))(kept)


@each_version
def test_gains_and_parameters_set_at_run_time_act_as_if_exported_and_from_the_next_step_on(version, exported):
    """Beside the law of JAX, stepped with one gain and then with another."""
    name, rng = "paper", np.random.default_rng(0)
    sampled, law = config(name).controller, Unit(exported(name)["law", version], "law", version).begin()
    changed = replace(sampled, {"inner.k1": 2.5, "inner.zeta": 0.9})
    step = jax.jit(lambda law, *arguments: law.step(*arguments))
    state, wanted = None, asked(name)
    for k in range(8):
        t, (x, y, u, v, heading, rate) = 0.02 * k, 0.3 * rng.normal(size=6)
        law.set(wanted(t))
        names = ("position_x", "position_y", "velocity_x", "velocity_y", "heading", "yaw_rate")
        law.set({f"measurement.{n}": number for n, number in zip(names, (x, y, u, v, heading, rate), strict=True)})
        if k == 4:
            law.set({"inner.k1": 2.5, "inner.zeta": 0.9})
        law.step(t, 0.02)
        seen = agvjax.Measurement(
            position=jnp.array([x, y]),
            velocity=jnp.array([u, v]),
            heading=jnp.asarray(heading),
            yaw_rate=jnp.asarray(rate),
        )
        at = reference(config(name).scenario.path, config(name).scenario.heading, jnp.asarray(t))
        state = sampled.inner.init(seen, at) if state is None else state
        done = step(sampled if k < 4 else changed, state, seen, at)
        state, inputs = done.law, done.command.inputs
        got = list(law.get("command.").values())
        assert np.allclose(got, [inputs["heading"], *inputs["position"]], rtol=1e-12, atol=1e-12)


@pytest.mark.slow
@each_version
def test_a_vehicle_whose_parameters_are_set_drives_as_the_simulators_with_these(version, exported):
    """Deadzones, lag and delay of one wheel, before the start."""
    case, files = config("route"), exported("route")
    values = {"deadzone.left.threshold_right": 0.09, "plant.time_constant": 0.2, "actuators.left.delay.time": 0.1}
    scenario = replace(case.scenario, values | {"start.position": np.array([8.7, -0.1])})
    run = agvjax.simulate(case.controller, scenario, save_every=10, **case.timing())
    law = Unit(files["law", version], "law", version).begin()
    vehicle = Unit(files["vehicle", version], "vehicle", version)
    vehicle.begin(**values, **{"start.position[0]": 8.7, "start.position[1]": -0.1})
    got, _ = drive(law, vehicle, "route", 80)
    deviation = np.abs(got[:, :2] - run.position[:-1]).max()
    assert deviation < 1e-9 and np.abs(got[:, :2] - simulated("route")[:, :2]).max() > 0.1


@each_version
def test_steps_may_be_parts_or_multiples_of_the_period_and_no_other(version, exported):
    files, name = exported("route"), "route"
    whole, _ = loop(files, version, name)
    parts, _ = loop(files, version, name, part=5)  # of .01 s, two of the vehicle's steps
    assert np.array_equal(whole, parts)
    tiny = Unit(files["law", version], "law", version).begin()
    tiny.set({"measurement.position_x": 8.5})
    tiny.step(0.0, 1e-6)  # the law looks in its very first step, however short
    assert any(tiny.get("command.").values())
    once, twice = (Unit(files["law", version], "law", version, n).begin() for n in ("once", "twice"))
    seen = {"measurement.position_x": 8.5, "measurement.velocity_x": 0.5, "measurement.heading": 0.2}
    once.set(seen)
    once.step(0.0, 0.15)
    twice.set(seen)
    for k in range(3):
        twice.step(0.05 * k, 0.05)
    assert once.get("command.") == twice.get("command.")
    before = once.get("")
    for time, size in ((0.2, 0.05), (0.15, -0.05), (0.15, float("nan"))):
        with pytest.raises(Exception, match="DoStep"):
            once.step(time, size)
    once.step(0.15, 0.03)
    with pytest.raises(Exception, match="DoStep"):
        once.step(0.18, 0.03)  # past .2 s, where the law looks
    assert "looks at 0.2" in once.said[-1].replace("0.20000000000000001", "0.2") and len(once.said) == 4
    once.step(0.18, 0.02)  # what was refused changed nothing
    once.step(0.2, 0.05)
    assert before != once.get("")
    vehicle = Unit(files["vehicle", version], "vehicle", version).begin()
    with pytest.raises(Exception, match="DoStep"):
        vehicle.step(0.0, 0.012)
    assert "multiples of 0.005" in vehicle.said[-1].replace("0.0050000000000000001", "0.005")


@each_version
def test_what_cannot_be_is_refused_with_a_message(version, exported):
    files = exported("route")
    law = Unit(files["law", version], "law", version).begin()
    for values, why in (
        ({"inner.lookahead_dist": 0.0}, "cannot be 0"),
        ({"inner.lookahead_dist": float("nan")}, "cannot be nan"),
        ({"command.left": 1.0}, "no input and no parameter"),
        ({"period": 0.1}, "no input and no parameter"),
    ):
        with pytest.raises(Exception, match="fmi.Set"):
            law.set(values)
        assert why in law.said[-1]
    vehicle = Unit(files["vehicle", version], "vehicle", version).begin()
    with pytest.raises(Exception, match="fmi.Set"):
        vehicle.set({"start.heading": 0.0})
    assert "fixed" in vehicle.said[-1]
    vehicle.set({"command.left": float("nan")})
    with pytest.raises(Exception, match="DoStep"):
        vehicle.step(0.0, 0.05)
    assert "no number any more" in vehicle.said[-1]
    vehicle.set({"command.left": 0.3})
    vehicle.step(0.0, 0.05)
    for k in range(10, 13):  # one each 5 ms: with the fourth the first, of t = 0, would be due at .08 s and is gone
        vehicle.set({"command.left": 0.01 * k})
        if k == 12:
            with pytest.raises(Exception, match="DoStep"):
                vehicle.step(0.005 * k, 0.005)
            assert "forgot a command" in vehicle.said[-1]
        else:
            vehicle.step(0.005 * k, 0.005)


@each_version
def test_a_measurement_that_is_no_number_gives_a_warning_and_commands_of_zero(version, exported):
    law = Unit(exported("route")["law", version], "law", version).begin()
    good = {"measurement.position_x": 8.5, "measurement.position_y": 0.0}
    law.set(good)
    law.step(0.0, 0.05)
    assert law.status() == 0 and any(law.get("command.").values())
    law.set({"measurement.position_x": float("nan")})
    law.step(0.05, 0.05)
    assert law.status() == 1 and set(law.get("command.").values()) == {0.0} and "NaN" in law.said[-1]
    law.set(good)
    law.step(0.1, 0.05)
    assert law.status() == 0 and any(law.get("command.").values())


def test_an_fmu_of_another_export_is_not_instantiated(exported):
    for version, instantiate in (("fmi2", FMU2Slave), ("fmi3", FMU3Slave)):
        folder = str(exported("route")["law", version].parent / f"law_{version}")
        about = {"unzipDirectory": folder, "modelIdentifier": "agv_controller", "instanceName": "one"}
        with pytest.raises(Exception, match="instantiate"):
            instantiate(guid="0" * 64, **about).instantiate()
    said = []
    with pytest.raises(Exception, match="instantiate"):
        known = fmpy.read_model_description(str(exported("route")["law", "fmi3"])).guid
        log = lambda environment, status, category, text: said.append(text.decode())  # noqa: E731
        FMU3Slave(guid=known, **about).instantiate(eventModeUsed=True, logMessage=log)
    assert said == ["it has no event mode"]


TOGETHER = r"""
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#define DECLARED(p) \
    void *p##fmi2Instantiate(const char *, int, const char *, const char *, const void *, int, int); \
    void p##fmi2FreeInstance(void *); \
    int p##fmi2EnterInitializationMode(void *); int p##fmi2ExitInitializationMode(void *); \
    int p##fmi2GetReal(void *, const unsigned[], size_t, double[]); \
    int p##fmi2SetReal(void *, const unsigned[], size_t, const double[]); \
    int p##fmi2GetFMUstate(void *, void **); int p##fmi2FreeFMUstate(void *, void **); \
    int p##fmi2SerializedFMUstateSize(void *, void *, size_t *); \
    int p##fmi2SerializeFMUstate(void *, void *, char[], size_t); \
    int p##fmi2DeSerializeFMUstate(void *, const char[], size_t, void **); int p##fmi2SetFMUstate(void *, void *); \
    int p##fmi2DoStep(void *, double, double, int);
DECLARED(law_)
DECLARED(car_)
int main(int argc, char **argv) {
    const unsigned seen[6] = {SEEN}, measured[6] = {MEASURED}, asked[2] = {ASKED}, commanded[2] = {COMMANDED};
    double numbers[6], commands[2];
    void *law = law_fmi2Instantiate("law", 1, argv[1], "", NULL, 0, 0), *state = NULL, *copy = NULL;
    void *car = car_fmi2Instantiate("car", 1, argv[2], "", NULL, 0, 0);
    size_t size = 0;
    char *bytes;
    int k, bad = argc != 3 || law == NULL || car == NULL;
    if (bad) return 1;
    bad |= law_fmi2EnterInitializationMode(law) | law_fmi2ExitInitializationMode(law);
    bad |= car_fmi2EnterInitializationMode(car) | car_fmi2ExitInitializationMode(car);
    for (k = 0; k < 60; k++) {
        bad |= car_fmi2GetReal(car, measured, 6, numbers) | law_fmi2SetReal(law, seen, 6, numbers);
        bad |= law_fmi2DoStep(law, 0.05 * k, 0.05, 1) | law_fmi2GetReal(law, asked, 2, commands);
        bad |= car_fmi2SetReal(car, commanded, 2, commands) | car_fmi2DoStep(car, 0.05 * k, 0.05, 1);
    }
    bad |= law_fmi2GetFMUstate(law, &state) | law_fmi2SerializedFMUstateSize(law, state, &size);
    bytes = malloc(size);
    bad |= law_fmi2SerializeFMUstate(law, state, bytes, size) | law_fmi2DeSerializeFMUstate(law, bytes, size, &copy);
    bad |= law_fmi2SetFMUstate(law, copy) | law_fmi2FreeFMUstate(law, &copy) | law_fmi2FreeFMUstate(law, &state);
    bad |= car_fmi2DoStep(car, 1.0, 0.05, 1) != 3; /* not where it is */
    free(bytes);
    law_fmi2FreeInstance(law);
    car_fmi2FreeInstance(car);
    printf("%.17g %.17g\n", numbers[0], numbers[1]);
    return bad;
}
"""


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_sources_of_both_make_one_program_that_is_clean_under_the_sanitizers(exported, tmp_path):
    files, parts = exported("route"), []
    wanted, _ = loop(files, "fmi2", "route")
    about = {kind: fmpy.read_model_description(str(files[kind, "fmi2"])) for kind in ("law", "vehicle")}
    flags = ["gcc", *STRICT[:-2], "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    for kind, prefix in (("law", "law_"), ("vehicle", "car_")):
        home = files[kind, "fmi2"].parent / f"{kind}_fmi2" / "sources"
        for source in about[kind].buildConfigurations[0].sourceFileSets[0].sourceFiles:
            parts.append(str(tmp_path / f"{source}.o"))
            command = [*flags, f"-DFMI2_FUNCTION_PREFIX={prefix}", "-c", str(home / source), "-o", parts[-1]]
            subprocess.run(command, check=True)

    def references(kind, start):
        return ",".join(str(v.valueReference) for v in about[kind].modelVariables if v.name.startswith(start))

    text = TOGETHER
    places = ("SEEN", "law", "measurement."), ("MEASURED", "vehicle", "measurement.")
    for word, kind, start in (*places, ("ASKED", "law", "command."), ("COMMANDED", "vehicle", "command.")):
        text = text.replace(f"= {{{word}}}", f"= {{{references(kind, start)}}}")
    (tmp_path / "main.c").write_text(text)
    subprocess.run([*flags, str(tmp_path / "main.c"), *parts, "-lm", "-o", str(tmp_path / "both")], check=True)
    command = [str(tmp_path / "both"), about["law"].guid, about["vehicle"].guid]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert np.abs(np.array(done.stdout.split(), float) - wanted[59, :2]).max() < 1e-12


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("name", ["paper", pytest.param("route", marks=pytest.mark.slow)])
def test_compilers_have_nothing_to_say_of_the_sources(name, compiler, exported, tmp_path):
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    for (kind, version), file in exported(name).items():
        sources = [str(x) for x in (file.parent / f"{kind}_{version}" / "sources").glob("*.c")]
        command = [compiler, *STRICT, "-O0" if name == "paper" else "-O2", *sources, "-o", tmp_path / "made", "-lm"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0 and not done.stderr, done.stderr


def test_without_a_compiler_an_fmu_has_its_sources_alone_and_that_is_said(tmp_path, monkeypatch):
    (tmp_path / "gains.toml").write_text(configuration.gains_table(TIMED))
    (tmp_path / "config.toml").write_text('[scenario]\nplant = "unicycle"\n')
    said = []
    known = artefact.read(str(tmp_path / "gains.toml"), note=said.append)
    monkeypatch.setattr(archive.shutil, "which", lambda name: None)
    for form, word, why in ((controller, "", "no C compiler is found"), (plant, "false", "false fails")):
        monkeypatch.setenv("CC", word)
        said.clear()
        files = form.files(known)
        assert len(said) == 1 and why in said[0] and "no binary" in said[0]
        for version in VERSIONS:
            file = tmp_path / f"{form.NAME}.{version}.fmu"
            file.write_bytes(files[file.name])
            assert validate_fmu(str(file)) == []
            with zipfile.ZipFile(file) as found:
                assert not [name for name in found.namelist() if name.startswith("binaries/")]
                assert f"sources/{form.NAME}.c" in found.namelist()


@pytest.mark.slow
def test_the_same_export_is_the_same_archive_to_the_byte(exported, tmp_path):
    files = exported("paper")
    folder = files["law", "fmi2"].parent
    again = controller.files(artefact.read(str(folder / "gains.toml")))
    for version in VERSIONS:
        assert again[f"agv_controller.{version}.fmu"] == files["law", version].read_bytes()


def test_what_a_person_has_written_stands_in_the_xml_as_it_is():
    odd = "a < b & \"c\" > 'd' ]]> --> Grüße"
    about = Variable("x.y[0]", "m->x", TUNABLE, 0.5, "m", odd, POSITIVE)
    model = Model("law", odd, odd, 0.05, [clock, about], {}, [])
    for text, tag in ((fmi2(model, "token", []), "ScalarVariable"), (fmi3(model, "token"), "Float64")):
        root = ElementTree.fromstring(text)
        assert root.attrib["description"] == odd and root.attrib["generationTool"] == odd
        assert root.findall(f"ModelVariables/{tag}")[1].attrib["description"] == f"{odd}; > 0"


def test_units_are_powers_of_base_units():
    assert powers("m/s^2") == {"m": 1, "s": -2} and powers("rad/s") == {"rad": 1, "s": -1}
    assert powers("1/(m^2 s)") == {"m": -2, "s": -1} and powers("kg m^2") == {"kg": 1, "m": 2}
    assert powers("Nm s/rad") == {"kg": 1, "m": 2, "s": -1, "rad": -1}  # kg m^2 s^-2 s
    assert powers("1") == powers("s/s") == {}
    for words in ("m^0.5/s^1.5", "unit of the command", "m/s^2, m/s^2, rad/s", "", "furlong", "m//s", "m^x"):
        assert powers(words) is None, words


def test_a_variable_without_a_name_of_its_own_is_refused():
    for names, word in ((["a.b", "a.b"], "twice"), (["a b"], "none of a variable"), (["a.1"], "none of a variable")):
        with pytest.raises(ValueError, match=word):
            check([Variable(name, "", TUNABLE) for name in names])


def test_a_delay_that_the_law_remembers_is_no_longer_than_its_memory():
    """Four inputs of .02 s each."""
    law = dataclasses.replace(TIMED, prediction=agvjax.Predictor(delay=0.05, slots=4))
    found = {v.name: v for v in controller.variables_of(law, program.step(law))}
    assert found["prediction.delay"].bounds == (0.0, 0.08) and "at most 0.08" in found["prediction.delay"].rule.text
    assert found["prediction.delay"].allows("x") == "x >= 0.0 && x <= 0.08"
    assert found["inner.k1"].allows("x") == "x > 0.0" and found["period"].role.variability == "constant"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--format", "c", "--what", "plant"], "--what = plant: must be of --format fmu"),
        (["--format", "fmu", "--what", "plant"], "config.toml beside the gains"),
        (
            ["--format", "fmu", "--what", "plant", "--config", "recorded.toml"],
            "a vehicle that can be exported (the vehicle uses",
        ),
    ],
)
def test_vehicles_that_cannot_be_exported_are_refused_before_anything_is_written(options, words, tmp_path, capsys):
    (tmp_path / "gains.toml").write_text(configuration.gains_table(TIMED))
    record = '[scenario]\nplant = "unicycle"\n[scenario.disturbance]\ntype = "recorded"\n'
    (tmp_path / "recorded.toml").write_text(
        record + "times = [0.0, 1.0]\nvalues = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]\n"
    )
    options = [str(tmp_path / x) if x.endswith(".toml") else x for x in options]
    assert main(["export", str(tmp_path / "gains.toml"), *options, "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert words in said and "Traceback" not in said and not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_vehicle_whose_sensor_is_noisy_is_exported_without_and_that_is_said(exported, tmp_path):
    """It is the robot whose loop is compared, but for the sensor."""
    said, case = [], configuration.load(["robot"])
    (tmp_path / "gains.toml").write_text(configuration.gains_table(case.controller))
    (tmp_path / "config.toml").write_text(configuration.dump(case))
    files = plant.files(artefact.read(str(tmp_path / "gains.toml"), note=said.append))
    assert len(said) == 1 and "noise is left out" in said[0]
    with (
        zipfile.ZipFile(exported("robot")["vehicle", "fmi2"]) as wanted,
        zipfile.ZipFile(io.BytesIO(files["agv_plant.fmi2.fmu"])) as got,
    ):
        code = [x.read("sources/agv_plant.c") for x in (wanted, got)]
    assert code[0] == code[1]


def test_the_command_writes_both_versions_of_the_vehicle_and_asks_no_network(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(socket.socket, "connect", None)
    (tmp_path / "gains.toml").write_text(configuration.gains_table(TIMED))
    (tmp_path / "config.toml").write_text('[scenario]\nplant = "unicycle"\n')
    out = tmp_path / "out"
    command = ["export", str(tmp_path / "gains.toml"), "--format", "fmu", "--what", "plant", "--name", "cart"]
    assert main([*command, "--out", str(out)]) == 0
    assert "4 files" in capsys.readouterr().out
    assert {file.name for file in out.iterdir()} == {"cart.fmi2.fmu", "cart.fmi3.fmu", "README.md", "provenance.json"}
    told = json.loads((out / "provenance.json").read_text())
    for version in VERSIONS:
        with zipfile.ZipFile(out / f"cart.{version}.fmu") as found:
            assert json.loads(found.read("resources/provenance.json")) == told
            assert told["configuration_sha256"] in found.read("sources/cart.h").decode()
    assert "`deadzone.acceleration.threshold_right`" in (out / "README.md").read_text()


@pytest.mark.slow
def test_the_commands_and_the_loop_of_the_page_run(tmp_path, monkeypatch):
    text = (ROOT / "docs" / "fmu.md").read_text()
    commands = [line for line in re.findall(r"^agvjax (.*)$", text, re.M) if "presets" in line]
    (code,) = re.findall(r"```python\n(.*?)```", text, re.S)
    monkeypatch.chdir(tmp_path)
    for command in commands:
        assert main([str(ROOT / word) if word.endswith(".toml") else word for word in command.split()]) == 0
    space = {}
    exec(code, space)
    case = configuration.load(["base"])
    run = agvjax.simulate(case.controller, case.scenario, dt=0.005, n_steps=4000, save_every=10)
    assert np.abs(np.array(space["way"]) - run.position[:-1]).max() < 1e-9
