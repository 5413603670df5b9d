"""The interactive page of runs: what it shows in a browser, from its file alone."""

import dataclasses

import numpy as np
import pytest

import agvjax
import commands
from agvjax import Base, Route, Sampled, Scenario
from tuning.io import pages
from tuning.io.curves import Track

STEPS = {"dt": 0.01, "n_steps": 60}
BASE = Sampled(inner=agvjax.PathPID(), vehicle=Base())
PROBLEMS = {
    "clock": (agvjax.NeuroBackstepping(), Scenario(), 6),
    "route": (BASE, Scenario.of(Base(), path=Route.through(np.array([[0.0, 0.0], [9.0, 0.0]]))), 5),
}
VALUES = """
[...Bokeh.documents[0].all_models].filter(m => m.type == 'ColumnDataSource')
    .map(m => m.get_column('position0') ?? m.data['position0']).filter(x => x).map(x => [...x])
"""
TITLES = "[...Bokeh.documents[0].all_models].filter(m => m.type == 'Div').map(m => m.text)"


def two_runs(law, scenario):
    other = dataclasses.replace(scenario.start, position=np.array([0.1, 0.2]))
    starts = (scenario, dataclasses.replace(scenario, start=other))
    return tuple(agvjax.simulate(law, one, **STEPS) for one in starts)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["clock", "route"])
def test_a_browser_draws_the_runs_from_the_file_alone(tmp_path, monkeypatch, name):
    monkeypatch.syspath_prepend(str(commands.ROOT))
    from benchmarks import browser

    law, scenario, over_time = PROBLEMS[name]
    runs = two_runs(law, scenario)
    link = pages.look_closer(tmp_path, {"<b>One & two": (scenario, runs)})
    assert link.startswith("[Look closer](runs.html)") and commands.files_of(tmp_path) == ["runs.html"]
    before = (tmp_path / "runs.html").read_bytes()
    pages.look_closer(tmp_path, {"<b>One & two": (scenario, runs)})
    assert (tmp_path / "runs.html").read_bytes() == before
    if browser.found() is None:
        pytest.skip("no Chromium")

    async def look(tab):
        await tab.until("window.Bokeh?.documents[0]?.all_models.size > 10")
        figures = await tab.value("[...Bokeh.documents[0].all_models].filter(m => m.type == 'Figure').length")
        loaded = await tab.value("performance.getEntriesByType('resource').length")
        titles = await tab.value(TITLES)
        return figures, loaded, titles, await tab.value(VALUES)

    figures, loaded, titles, values = browser.visit((tmp_path / "runs.html").as_uri(), look)
    assert figures == 1 + over_time and loaded == 0
    assert any("<h2>&lt;b&gt;One &amp; two</h2>" in title for title in titles)
    drawn = sorted(values, key=lambda x: x[0])
    for run, x in zip(sorted((np.asarray(run.position)[:, 0] for run in runs), key=lambda x: x[0]), drawn, strict=True):
        np.testing.assert_array_equal(x, run)


@pytest.mark.slow
def test_a_browser_draws_recordings_and_the_model_with_a_gap_where_that_begins_anew(tmp_path, monkeypatch):
    """The model has no row between 0.3 and 0.7 s; two rows are outliers, without a point of what is left."""
    monkeypatch.syspath_prepend(str(commands.ROOT))
    from benchmarks import browser

    t = np.round(0.1 * np.arange(12), 10)
    pose, there = np.column_stack([t, t**2, 0 * t]), (t < 0.35) | (t > 0.65)
    measured = Track(t, pose + 0.001, {"sent/cmd_v": np.sign(t - 0.55)}, {})
    off = np.where(np.arange(12) % 5 == 1, np.nan, 0.002)
    model = Track(t[there], pose[there], {"error/position": off[there], "error/heading": off[there]}, {})
    link = pages.look_at_logs(tmp_path, [("a & b.csv", measured, model), ("a & b.csv", measured, model)])
    assert link.startswith("[Look closer](logs.html)") and commands.files_of(tmp_path) == ["logs.html"]
    if browser.found() is None:
        pytest.skip("no Chromium")
    source = "[...Bokeh.documents[0].all_models].filter(m => m.type == 'GlyphRenderer' && m.glyph.type == '%s')"
    columns = (
        f"{source}.map(m => ['x', 'y'].map(k => [...m.data_source.get_column(k)].map(v => isFinite(v) ? v : null)))"
    )

    async def look(tab):
        await tab.until("window.Bokeh?.documents[0]?.all_models.size > 10")
        loaded = await tab.value("performance.getEntriesByType('resource').length")
        return loaded, *[await tab.value(columns % kind) for kind in ("Line", "Scatter", "Step")]

    loaded, lines, dots, steps = browser.visit((tmp_path / "logs.html").as_uri(), look)
    assert loaded == 0 and (len(lines), len(dots), len(steps)) == (2, 6, 2)
    assert lines[0][0] == [0.0, 0.1, 0.2, 0.3, None, 0.7, 0.8, 0.9, 1.0, 1.1]
    left = next(y for x, y in dots if len(y) == 9 and 2.0 in y)
    assert left == [2.0, None, *[2.0] * 6, None]  # mm
    assert steps[0][1] == [-1.0] * 6 + [1.0] * 6


def test_without_bokeh_there_is_no_page_and_no_link(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert (
        pages.look_closer(tmp_path, {}) == pages.look_at_logs(tmp_path, []) == "" and commands.files_of(tmp_path) == []
    )
