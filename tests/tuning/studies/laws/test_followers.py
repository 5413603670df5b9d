"""Laws that follow a route beside each other: which ones, under whose limits, and what is said of them."""

import dataclasses

import jax
import numpy as np
import pytest

import agvjax
from agvjax.metric_table import METRICS, Followed
from tuning.cli.main import main
from tuning.config.load import load
from tuning.ensemble.draws import sample
from tuning.io.kept import Kept
from tuning.studies.laws import followers, followers_page
from tuning.studies.laws.followers import LABELS, Tuned
from tuning.studies.laws.followers_page import SHOWN, rows, statements, table
from tuning.tune.rules import faults
from tuning.tune.tables import gains_of_laws


def test_the_laws_run_in_the_configured_computer_and_the_configured_one_is_as_it_is():
    config = load(["base"], ["controller.inner.lookahead_time=1.25", "controller.period=0.04", "simulate.dt=0.004"])
    laws = followers.laws(config)
    assert set(laws) == set(LABELS)
    assert laws["regulated_pure_pursuit"] is config.controller
    assert {float(law.period) for law in laws.values()} == {0.04}
    assert all(law.vehicle is config.controller.vehicle for law in laws.values())
    np.testing.assert_array_equal(laws["path_lqr"].inner.k_y, agvjax.PathLQR.designed(0.04).k_y)
    other = followers.laws(load(["base"], ['controller.inner={type="stanley"}']))
    assert float(other["regulated_pure_pursuit"].inner.desired_linear_vel) == pytest.approx(0.8)  # the profile's


@pytest.mark.parametrize("setting", ["tune.gains=all", "tune.search.rounds=2"])
def test_what_cannot_be_the_same_for_all_is_refused(setting, tmp_path, capsys):
    assert main(["compare", "--config", "base", "--set", setting, "--out", str(tmp_path / "out")]) == 2
    assert setting.replace("=", " = ") in capsys.readouterr().err and not (tmp_path / "out").exists()


def measured(distances, ok):
    """Metrics of vehicles whose distances are these, pace 1.5 s/m and variation 10."""
    size = len(distances)
    each = {name: np.zeros(size) for name, row in METRICS.items() if row.route}
    each |= {"cross_track_late": np.array(distances), "cross_track_peak_late": 2 * np.array(distances)}
    route = Followed(**(each | {"pace": np.full(size, 1.5)}))
    fields = {f.name: np.zeros((size, 2)) for f in dataclasses.fields(agvjax.Metrics) if f.default is not None}
    return agvjax.Metrics(**(fields | {"chatter": np.full((size, 2), 5.0), "ok": np.array(ok), "followed": route}))


def made(after, excess=0.0, ok=(True, True), over=()):
    law, sound = agvjax.PathPID(), (True, True)
    return Tuned(
        law, law, ("k_y", "k_psi"), excess, 3, 40, 400, list(over), measured([0.1, 0.3], sound), measured(after, ok)
    )


def test_rows_and_words_are_those_of_numbers_known_by_hand():
    found = {
        "stanley": made([0.02, 0.04]),
        "path_pid": made([0.01, 0.03], over=["mean total_chatter is 17, 0.30% above its limit 16.95"]),
        "path_lqr": made([0.001, 0.002], excess=0.1),
    }
    found["regulated_pure_pursuit"] = made([0.04, np.inf], ok=(True, False))
    lines = rows(found, SHOWN)
    assert [row["law"] for row in lines] == ["path_pid", "stanley", "regulated_pure_pursuit", "path_lqr"]
    first = lines[0]
    assert (first["mean_cross_track_late_before"], first["worst_cross_track_late_after"]) == pytest.approx((0.2, 0.03))
    assert (first["mean_total_chatter_after"], first["mean_pace_after"]) == pytest.approx((10.0, 1.5))
    assert lines[2]["diverged_after"] == 1 and lines[2]["worst_cross_track_late_after"] == pytest.approx(0.04)
    said = " ".join(statements(lines, SHOWN))
    assert "Smallest mean distance to the route: PID, 20.0 mm." in said and "Stanley 1.50" in said
    assert "PID, on validation vehicles: mean total_chatter is 17, 0.30% above its limit 16.95." in said
    assert "Limits not met by: LQR." in said and "Diverged runs after tuning: regulated pure pursuit 1." in said
    assert "| PID | 2 | 200.0 / 20.0 | 300.0 / 30.0 | 600.0 / 60.0 | 1.5 / 1.5 | 10 / 10 | 0 / 0 | 400 | 40 |" in table(
        lines, SHOWN
    )


def test_where_no_law_keeps_the_limits_that_is_said():
    assert statements(rows({"stanley": made([0.1, 0.2], excess=1.0)}, SHOWN), SHOWN) == ["No law meets the limits."]


SMALL = """
ensemble.size=4 ensemble.validation_size=4 tune.screen=8 tune.iterations=8 simulate.horizon=4 simulate.dt=0.01
tune.dt=0.01 simulate.integrator=euler tune.integrator=euler
""".split()


@pytest.mark.slow
@pytest.mark.usefixtures("promotion_as_optax_has_it")
def test_every_law_is_held_to_the_limits_of_the_configured_one(monkeypatch, tmp_path):
    """Judged again on the vehicles tuned on: variation and pace in multiples of the configured law's, not its own."""
    config = load(["base"], SMALL, faults)
    few = {name: law for name, law in followers.laws(config).items() if name in ("path_pid", "stanley")}
    monkeypatch.setattr(followers, "laws", lambda config: few)
    comparison, found = followers.compare(config, Kept(tmp_path / "tuned", followers.Searched), lambda name: None)
    monkeypatch.setattr(followers, "search", None)
    again = followers.compare(config, Kept(tmp_path / "tuned", followers.Searched), lambda name: None)[1]
    jax.tree.map(np.testing.assert_array_equal, again, found)
    seen = sample(config.scenario, config.ensemble.draws, 4, config.seed)

    def means(law):
        run = agvjax.evaluate(agvjax.check(law), seen, **config.timing("tune"))
        return {name: float(np.mean(run[name])) for name in ("total_chatter", "pace", "cross_track")}

    reference = means(config.controller)
    for tuned in found.values():
        start, after = means(tuned.start), means(tuned.controller)
        kept = after["total_chatter"] <= 1.5 * 1.01 * reference["total_chatter"]  # a run may round another way
        kept = kept and after["pace"] <= 1.001 * reference["pace"]
        assert kept or tuned.excess > 0
        assert tuned.excess > 0 or after["cross_track"] < 1.2 * start["cross_track"]
        own = [float(jax.tree.leaves(agvjax.leaves(tuned.controller)[name])[0]) for name in tuned.gains]
        assert own != [float(agvjax.leaves(tuned.start)[name]) for name in tuned.gains]
    assert any(tuned.excess == 0 for tuned in found.values())
    text = followers_page.write(comparison, found, tmp_path)
    assert "Stanley" in text and {"report.html", "comparison.csv"} <= {path.name for path in tmp_path.iterdir()}


def test_gains_of_laws_have_their_units_and_meanings():
    own = agvjax.Sampled(inner=agvjax.PathPID(), vehicle=agvjax.Base())
    tuned = agvjax.replace(own, {"inner.k_y": 2.5})
    (row,) = gains_of_laws({"PID": (own, tuned, ("inner.k_y",))}).splitlines()[2:]
    assert [cell.strip() for cell in row.split("|")[1:6]] == ["PID", "inner.k_y", "6", "2.5", "1/m^2"]
