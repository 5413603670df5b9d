"""What is sent of a sweep to another process, and that the same shards are made of it there."""

import contextlib
import pickle
import types

import pytest

from agvjax import InputError
from commands import ROOT, arguments
from laws import Proportional
from tuning import Between, Config, Simulate, Span, Sweep, run_sweep
from tuning import config as configuration
from tuning.cli import sweep as command
from tuning.cli.main import main
from tuning.compute import schedule
from tuning.config.complete import complete
from tuning.sweep import rules, run, work

pytestmark = pytest.mark.usefixtures("promotion_as_optax_has_it")
SMALL = ["simulate.horizon=0.3", "sweep.integrator=euler", "sweep.dt=0.01", "sweep.shard=3", "sweep.samples=7"]
OWN = ["scenario.plant=Omni", "scenario.path.type=Spiral", "scenario.heading=tangent", "controller=Spring"]


def elsewhere(config, laws, imports=()):
    """The shards that are made here, and those of what another process would be sent."""
    plan = work.planned(config)
    manifest = work.manifest_of(config, plan, laws)
    judges = work.judges(config, plan, list(laws.values()), manifest.block)
    jobs = run.jobs(run.parcel(manifest, imports), plan, judges)
    make = jobs.prepare(pickle.loads(pickle.dumps(jobs.about)))
    return [jobs.here(i) for i in range(manifest.shards)], [make(i) for i in range(manifest.shards)]


@pytest.mark.slow
def test_shards_of_what_is_sent_are_the_same_to_the_byte():
    more = {"sweep.ensemble": True, "sweep.over": [{"start.heading": {"between": [-0.7, 0.3]}}]}
    config = configuration.load(["unicycle"], SMALL, rules.faults, more, note=[].append)
    ours, theirs = elsewhere(config, {"configured": config.controller})
    assert len(ours) == 3 and len(set(ours)) == 3
    assert ours == theirs


def test_files_of_classes_of_ones_own_are_sent_along():
    file = str(ROOT / "tests" / "data" / "own.py")
    more = {"sweep.over": [{"start.heading": {"between": [-0.7, 0.3]}}]}
    config = configuration.load([], [*SMALL, *OWN], rules.faults, more, imports=[file], note=[].append)
    ours, theirs = elsewhere(config, {"configured": config.controller}, [file])
    assert ours == theirs


def test_a_scheduler_that_nobody_knows_leaves_no_folder(tmp_path):
    config = configuration.load([], [*SMALL, "sweep.ensemble=true"], rules.faults, note=[].append)
    with pytest.raises(InputError, match="local:0"):
        run_sweep(config, tmp_path / "sweep", scheduler="local:0")
    assert not list(tmp_path.iterdir())


def test_workers_are_let_go_before_the_report_and_not_asked_for_a_finished_sweep(tmp_path, monkeypatch):
    happened = []

    @contextlib.contextmanager
    def opened(spelled, note):
        happened.append(spelled)
        with schedule.opened(None, note) as engine:
            yield engine
        happened.append("closed")

    monkeypatch.setattr(command, "schedule", types.SimpleNamespace(opened=opened, checked=lambda spelled: None))
    monkeypatch.setattr(command, "conclude", lambda *_: happened.append("concluded"))
    argv = [*arguments("sweep", tmp_path / "out", SMALL, "--ensemble", "--quiet"), "--scheduler", "local:2"]
    for _ in range(2):
        assert main(argv) == 0
    assert happened == ["local:2", "closed", "concluded", None, "closed", "concluded"]


def test_a_law_that_only_python_knows_is_refused_before_anything_is_computed(tmp_path):
    over = ({"start.heading": Span(Between(-0.5, 0.5))},)
    sweep = Sweep(over=over, metrics=("total_rmse",), integrator="euler", samples=2, fails={}, radius=False)
    config = complete(Config(controller=Proportional(), simulate=Simulate(horizon=0.3), sweep=sweep))
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="Proportional"):
        run_sweep(config, tmp_path / "sweep", scheduler="local:1")
