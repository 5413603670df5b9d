"""`agvjax apply`: both sets of gains on the same vehicles, files for the robot or none, and what it does not take."""

import dataclasses
import json
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import agvjax
from mass import Mass, Spring
from tuning import config as configuration
from tuning.apply import apply, page
from tuning.apply.compare import drawn
from tuning.apply.known import Known
from tuning.apply.rules import faults
from tuning.cli.main import main
from tuning.config.settings import Apply, Config, Criteria, Ensemble, Search, Simulate, Tune, Weights
from tuning.ensemble.draws import Between

HORIZON = 3.0


@agvjax.pytree
class Here(agvjax.Path):
    """A path that stays where it begins."""

    def __call__(self, t):
        return jnp.zeros(2) + 0.0 * t


def problem(**settings):
    """A mass 1 m away, on a spring whose push has an unknown slope."""
    zone = agvjax.Deadzone(slope_right=1.0, slope_left=1.0, threshold_right=0.0, threshold_left=0.0)
    start = agvjax.Start(position=jnp.array([1.0, 0.0]), velocity=jnp.zeros(2), heading=jnp.zeros(()))
    scenario = agvjax.Scenario(
        plant=Mass(), deadzone={"push": zone}, disturbance=agvjax.NoDisturbance(), path=Here(), start=start
    )
    draws = {f"deadzone.push.slope_{side}": Between(0.6, 1.4) for side in ("left", "right")}
    search = Search(starts=2, iterations=4, scouts=4, checks=0)
    config = Config(
        controller=Spring(k=4.0, c=4.0),
        scenario=scenario,
        simulate=Simulate(dt=0.01, horizon=HORIZON),
        criteria=Criteria(late=0.0),
        ensemble=Ensemble(draws=draws),
        tune=Tune(gains=("k", "c"), goals={"total_rmse": Weights(mean=1.0)}, limits={}, dt=0.01, search=search),
        apply=Apply(**{"vehicles": 60, "samples": 8} | settings),
    )
    return configuration.check(config, faults)


def by_scipy(k, c, right, left):
    """The rms of x of x'' = slope (-k x - c x'), pushed to the right by one slope and to the left by the other."""

    def rate(t, s):
        push = -k * s[0] - c * s[1]
        return [s[1], (right if push > 0 else left) * push, s[0] ** 2]

    return np.sqrt(solve_ivp(rate, (0, HORIZON), [1.0, 0.0, 0.0], rtol=1e-9, atol=1e-12).y[2, -1] / HORIZON)


def decided(current, new, **settings):
    return apply(Known(problem(**settings), "good", (), ("drive.csv",)), current, new)


@pytest.fixture(scope="module")
def better():
    return decided(Spring(k=4.0, c=4.0), Spring(k=9.0, c=6.0))


def test_costs_are_those_of_the_mass_by_another_integrator(better):
    """1 is the mean of the current gains; the same vehicles for both, and slopes from 0.6 to 1.4."""
    batch = drawn(problem())
    sides = [np.asarray(batch.values[f"deadzone.push.slope_{side}"]) for side in ("right", "left")]
    assert min(map(np.min, sides)) > 0.6 and max(map(np.max, sides)) < 1.4
    old, new = (np.array([by_scipy(*gains, *pair) for pair in zip(*sides)]) for gains in ((4, 4), (9, 6)))  # noqa: B905
    np.testing.assert_allclose(better.compared.costs, np.stack([old, new]) / old.mean(), rtol=2e-4)


def test_a_stiffer_spring_as_well_damped_is_accepted_and_back_it_is_refused(better):
    """Both are damped critically: x = (1 + w t) exp(-w t), which for w = 3 lies below that for w = 2."""
    assert better.decision.accepted and better.decision.worse == 0
    back = decided(Spring(k=9.0, c=6.0), Spring(k=4.0, c=4.0))
    assert not back.decision.accepted and back.decision.worse == 60


def test_the_worst_vehicle_that_is_found_is_at_the_corner_of_the_weakest_push(better):
    """The weakest push to the left, which is the way back, is worst for both; the search is no worse than the draws."""
    costs, worst = better.compared.costs, better.compared.worst
    for law in (0, 1):
        assert worst[law].max() >= costs[law].max()
    corner = by_scipy(4, 4, 0.6, 0.6) / by_scipy(4, 4, 1.4, 1.4)
    assert corner > 1 and better.compared.found[0]["deadzone.push.slope_left"] < 0.75


def test_vehicles_are_drawn_once_each_and_all_begin_from_the_same_starts():
    config = configuration.load(["base"], ["apply.vehicles=59", "apply.starts=3"])
    batch = drawn(config)
    track = np.asarray(batch.values["deadzone.left.threshold_right"]).reshape(59, 3)
    starts = np.asarray(batch.values["start.position"]).reshape(59, 3, 2)
    assert np.unique(track[:, 0]).size == 59 and (track == track[:, :1]).all()
    assert np.unique(starts[0, :, 1]).size == 3 and (starts == starts[:1]).all()


def test_the_same_gains_are_as_good_as_themselves():
    same = decided(Spring(), Spring())
    assert same.decision.accepted and same.decision.worse == 0
    np.testing.assert_array_equal(same.compared.costs[0], same.compared.costs[1])


def test_gains_that_diverge_are_refused():
    found = decided(Spring(k=4.0, c=4.0), Spring(k=4.0, c=-30.0))
    assert not found.decision.accepted and "60 of 60 vehicles diverge" in " ".join(found.decision.reasons)


def test_too_few_vehicles_to_show_anything_are_no_setting():
    with pytest.raises(agvjax.InputError, match=r"apply\.vehicles = 58.*at least 59"):
        problem(vehicles=58)


def written(folder, result):
    folder.mkdir()
    contents = b"[controller]\nk1 = 1.0\r\n# old\n", b"[controller]\nk1 = 2.0\n"
    return page.write(problem(), result, ("old.toml", "new.toml"), contents, folder)


def with_a_config(result):
    """Of a configuration that can be written: classes of a test cannot."""
    return result._replace(known=result.known._replace(config=Config()))


def test_accepted_gains_and_their_way_back_are_there_byte_for_byte(better, tmp_path, monkeypatch):
    monkeypatch.setattr(configuration, "dump", lambda config: "")
    text = written(tmp_path / "run", better)
    assert (tmp_path / "run" / "gains.toml").read_bytes() == b"[controller]\nk1 = 2.0\n"
    assert (tmp_path / "run" / "back.toml").read_bytes() == b"[controller]\nk1 = 1.0\r\n# old\n"
    assert "Accepted" in text and "worse on 0" in text
    told = json.loads((tmp_path / "run" / "decision.json").read_text())
    assert told["accepted"] and told["worse"] == 0 and told["reasons"] == []
    assert "byte for byte" in (tmp_path / "run" / "report.html").read_text()


def test_of_refused_gains_there_is_no_file_for_the_robot(better, tmp_path, monkeypatch):
    monkeypatch.setattr(configuration, "dump", lambda config: "")
    decision = better.decision._replace(accepted=False, reasons=("on 3 of 60 vehicles they are worse",))
    text = written(tmp_path / "run", better._replace(decision=decision))
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert not {"gains.toml", "back.toml"} & names and "report.html" in names
    assert "Refused" in text and "On 3 of 60 vehicles they are worse." in text


def test_nothing_is_simulated_for_a_log_that_tells_nothing():
    found = apply(Known(problem(), "bad", ("the log does not tell the vehicle: bad",), ("a.csv",)), Spring(), Spring())
    assert not found.decision.accepted and found.compared is None
    assert "does not tell" in page.verdict(found)


def test_copies_of_one_vehicle_show_nothing_of_others():
    config = problem()
    config = dataclasses.replace(config, ensemble=Ensemble(draws={"start.heading": Between(-0.1, 0.1)}))
    found = apply(Known(config, "good", (), ("a.csv",)), Spring(k=4.0, c=4.0), Spring(k=9.0, c=6.0))
    assert not found.decision.accepted and found.compared is None
    assert "one vehicle" in page.verdict(found)


# ---- the command line


@pytest.fixture
def files(tmp_path):
    """Gains of one base, and a folder that says that its log is good for nothing."""
    law = '[controller]\ntype = "sampled"\nperiod = 0.05\nvehicle = "base"\ninner = "path_pid"\n'
    (tmp_path / "new.toml").write_text(law)
    (tmp_path / "old.toml").write_text(law + "# the one on the robot\n")
    found = tmp_path / "found"
    found.mkdir()
    (found / "scenario.toml").write_text('[scenario]\nplant = "base"\n[scenario.path]\ntype = "route"\npoints = '
                                         "[[0.0, 0.0], [5.0, 0.0]]\n[simulate]\ndt = 0.01\n")  # fmt: skip
    told = {"good": False, "conclusion": "These numbers are not good: none.", "change": None, "logs": ["day.csv"]}
    (found / "estimates.json").write_text(json.dumps(told))
    line = ["apply", str(tmp_path / "new.toml"), "--over", str(tmp_path / "old.toml")]
    line += ["--out", str(tmp_path / "out"), "--quiet", "--set", "tune.search.starts=1"]
    return SimpleNamespace(folder=tmp_path, found=found, line=line)


def test_gains_are_refused_with_a_reason_and_exit_code_1(files):
    assert main([*files.line, "--identified", str(files.found)]) == 1
    report = (files.folder / "out" / "report.md").read_text()
    assert "Refused" in report and "These numbers are not good: none." in report
    assert not (files.folder / "out" / "gains.toml").exists()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda line, f: [x for x in line if x not in ("--over", str(f.folder / "old.toml"))], "--over"),
        (lambda line, f: line, "--log"),
        (lambda line, f: [*line, "--identified", str(f.folder / "nowhere")], "nowhere"),
        (lambda line, f: [*line, "--identified", str(f.found), "--set", "controller.period=0.1"], "no gain"),
        (lambda line, f: [*line, "--identified", str(f.found), "--set", "apply.vehicles=12"], "apply.vehicles"),
        (lambda line, f: [*line, "--identified", str(f.found), "--log", "day.csv"], "--log"),
        (
            lambda line, f: [*line, "--log", str(f.folder / "none.csv"), "--config", str(f.found / "scenario.toml")],
            "none.csv",
        ),
    ],
)
def test_what_does_not_go_together_is_bad_input_and_leaves_nothing(files, change, said, capsys):
    assert main(change(files.line, files)) == 2
    assert said in capsys.readouterr().err and not (files.folder / "out").exists()


def test_a_folder_that_says_nothing_of_a_log_is_bad_input(files, capsys):
    (files.found / "estimates.json").write_text("{}")
    assert main([*files.line, "--identified", str(files.found)]) == 2
    assert "estimates.json" in capsys.readouterr().err and not (files.folder / "out").exists()


def test_an_empty_folder_of_the_user_stays(files):
    (files.found / "estimates.json").write_text("{}")
    (files.folder / "out").mkdir()
    assert main([*files.line, "--identified", str(files.found)]) == 2
    assert list((files.folder / "out").iterdir()) == []


def test_the_vehicle_is_that_of_the_log_and_not_that_of_the_file_of_the_new_gains(files):
    """A run of `tune` leaves the vehicle that it tuned for beside its gains: that is not the one on the floor."""
    with (files.folder / "new.toml").open("a") as stream:
        stream.write('[scenario.plant]\ntype = "base"\ntrack = 0.9\n[ensemble.draws]\n')
        stream.write('"plant.track" = { between = [0.8, 1.0] }\n')
    found = (files.found / "scenario.toml").read_text()
    draws = '[ensemble.draws]\n"plant.track" = { between = [0.45, 0.55] }\n'
    (files.found / "scenario.toml").write_text(
        found.replace('plant = "base"', 'plant = { type = "base", track = 0.5 }') + draws
    )
    assert main([*files.line, "--identified", str(files.found)]) == 1
    there = configuration.load([str(files.folder / "out" / "config.toml")], [])
    assert there.scenario.plant.track == 0.5 and there.ensemble.draws["plant.track"] == Between(0.45, 0.55)


def test_a_log_of_another_kind_of_vehicle_is_refused(files, capsys):
    with (files.folder / "new.toml").open("a") as stream:
        stream.write('[scenario.plant]\ntype = "base"\n')
    found = (files.found / "scenario.toml").read_text()
    (files.found / "scenario.toml").write_text(found.replace('plant = "base"', 'plant = "ackermann"'))
    assert main([*files.line, "--identified", str(files.found)]) == 2
    said = capsys.readouterr().err
    assert "--identified" in said and "Ackermann" in said and not (files.folder / "out").exists()
