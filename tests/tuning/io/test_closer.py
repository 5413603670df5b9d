"""The interactive page of runs: what it shows in a browser, from its file alone."""

import dataclasses

import numpy as np
import pytest

import agvjax
import commands
from agvjax import Base, Route, Sampled, Scenario
from tuning.io import pages

STEPS = {"dt": 0.01, "n_steps": 60}
BASE = Sampled(inner=agvjax.PathPID(), vehicle=Base())
PROBLEMS = {
    "clock": (agvjax.NeuroBackstepping(), Scenario(), 6),
    "route": (BASE, Scenario.of(Base(), path=Route.through(np.array([[0.0, 0.0], [9.0, 0.0]]))), 5),
}
VALUES = """
[...Bokeh.documents[0].all_models].filter(m => m.type == 'ColumnDataSource')
    .map(m => [...(m.get_column('position0') ?? m.data['position0'])])
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


def test_without_bokeh_there_is_no_page_and_no_link(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert pages.look_closer(tmp_path, {}) == "" and commands.files_of(tmp_path) == []
