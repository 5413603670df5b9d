"""Exported FMUs in FMPy, which reads and runs them by the standard alone: law and vehicle in a loop beside `simulate`."""

import functools
import io
import json
import os
import shutil
import subprocess
import zipfile

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import agvjax
from agvjax import leaves
from agvjax.paths.heading import reference
from tuning import config as configuration
from tuning.cli.main import main
from tuning.export import artefact
from tuning.export.fmu import controller, plant

fmpy = pytest.importorskip("fmpy")
from fmpy.fmi2 import FMU2Slave  # noqa: E402
from fmpy.fmi3 import FMU3Slave  # noqa: E402

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler is installed")
STRICT = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic", "-fPIC", "-shared"]
VERSIONS = ("fmi2", "fmi3")
PAPER = ['controller.type="sampled"', "simulate.dt=0.005", "simulate.horizon=4.0"]
CASES = {  # presets and changes
    "route": (["base"], ["simulate.horizon=4.0", "scenario.start.position=[8.5, -0.2]", "scenario.start.heading=0.3"]),
    "paper": ([], PAPER),
    "unicycle": (["unicycle"], ["simulate.horizon=4.0"]),
    "car": (["car"], ["simulate.horizon=4.0"]),
    "robot": (["robot"], ['scenario.sensor="none"', "ensemble.draws={}", "simulate.horizon=4.0"]),
    "ackermann": (["ackermann"], ["simulate.horizon=4.0"]),
    "forklift": (["forklift"], ["simulate.horizon=4.0"]),
    "late": (["base"], ["simulate.horizon=4.0", "scenario.actuators.left.delay.jitter=0.03"]),
    "pushed": ([], [*PAPER, 'scenario.disturbance={type="step", time=1.237, amplitude=0.3}']),
    "rough": ([], [*PAPER, 'scenario.disturbance={type="band_limited_noise", seed=3.0}']),
}
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
        names = [name for name in self.references if name.startswith(prefix)]
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


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in CASES if name not in ("route", "paper")]


@pytest.mark.parametrize("name", ["route", "paper", *SLOW])
def test_law_and_vehicle_drive_as_the_simulator_does(name, exported):
    wanted = simulated(name)
    assert np.ptp(wanted[:, 0]) > 0.3  # it does move
    for version in VERSIONS:
        got, names = loop(exported(name), version, name)
        assert names[:5] == [f"measurement.{x}" for x in ("position_x", "position_y", "velocity_x", "velocity_y", "heading")]
        deviation = np.abs(got[:, :5] - wanted).max()
        print(f"{name} {version}: {deviation:.1e}")
        assert deviation < 1e-9
