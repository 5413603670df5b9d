"""The page as a browser gets it: served on this computer alone, redrawn on a key, ended by Ctrl-C."""

import contextlib
import http.client
import os
import re
import signal
import socket
import sys
import time
import urllib.request

import pytest

import commands
from agvjax import InputError
from tuning.config import load
from tuning.studies.explore.rules import faults

FAST = [*commands.FAST, "tune.dt=0.01", "tune.integrator=euler"]
SET = [x for setting in FAST for x in ("--set", setting)]


@contextlib.contextmanager
def served(*options):
    """The command's process and the address that it says."""
    process = commands.start(["explore", *SET, *options])
    try:
        said = []
        for line in process.stdout:
            said.append(line)
            if match := re.search(r"http://127\.0\.0\.1:(\d+)/", line):
                break
        else:
            raise AssertionError(f"no address in {said}: {process.stderr.read()}")
        yield process, match[0], int(match[1])
    finally:
        process.kill()
        process.communicate()


def fetched(address):
    with urllib.request.urlopen(address, timeout=commands.HUNG) as answer:
        return answer.read()


def asked_by(origin, port, token):
    """The answer to a page of an origin that opens a connection for sliders and curves, with a token of the server."""
    upgrade = {"Upgrade": "websocket", "Connection": "Upgrade", "Origin": origin}
    upgrade |= {"Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA=="}
    upgrade |= {"Sec-WebSocket-Protocol": f"bokeh, {token}"}
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", port, timeout=commands.HUNG)) as line:
        line.request("GET", "/ws", headers=upgrade)
        return line.getresponse().status


@pytest.mark.slow
def test_it_is_served_here_alone_without_a_network_and_ends_on_ctrl_c(tmp_path):
    with served("--out", str(tmp_path / "out")) as (process, address, port):
        page = fetched(address).decode()
        assert "agvjax explore" in page
        scripts = re.findall(r'<script[^>]* src="([^"]+)"', page)
        assert scripts and all(name.startswith("/static/") for name in scripts)
        for name in scripts:
            assert len(fetched(address + name[1:])) > 1000
        (token,) = re.findall(r'"token":"([^"]+)"', page)
        assert asked_by("http://elsewhere.example", port, token) == 403  # another page may not talk to it
        assert asked_by(address.rstrip("/"), port, token) == 101
        time.sleep(0.5)  # or Ctrl-C comes before it could have failed
        with pytest.raises(OSError):  # another address of the same computer
            socket.create_connection(("127.0.0.2", port), timeout=5)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=commands.HUNG)
        assert process.returncode == 130
        assert "interrupted" in err and "Traceback" not in out + err
    assert commands.files_of(tmp_path / "out") == []


@pytest.mark.slow
def test_a_key_on_a_slider_redraws_in_chromium(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(commands.ROOT))
    from benchmarks import browser, explore

    if browser.found() is None:
        pytest.skip("no Chromium")
    drawn = "[...Bokeh.documents[0].all_models].find(m => m.name == 'controller.k1').value"

    async def visit(tab):
        seconds = await explore.moves(tab, 2)  # waits for a new table and new strokes, each time
        assert len(seconds) == 2
        return await tab.value(drawn)

    with served("--out", str(tmp_path / "out")) as (_, address, _):
        k1 = browser.visit(address, visit)
    assert k1 != pytest.approx(1.30103, abs=1e-4)  # log10(20), where it was: an odd number of keys


@pytest.mark.slow
def test_bad_input_ends_before_anything_is_served(tmp_path):
    (tmp_path / "mine.txt").write_text("")
    _, err = commands.run(["explore", "--out", str(tmp_path)], code=2)
    assert "--out" in err and commands.files_of(tmp_path) == ["mine.txt"]
    with pytest.raises(InputError, match=r"controller.k1 = -1.0"):
        load([], ["controller.k1=-1.0"], faults)


def test_without_bokeh_it_says_how_to_install_it(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    (fault,) = faults(None)
    assert "pip install 'agvjax[explore]'" in str(fault)


@pytest.mark.slow  # a tuning of its own
def test_tuning_from_the_page_is_that_of_the_command(tmp_path):
    from tuning.studies.explore.background import Desk
    from tuning.studies.explore.page import Page
    from tuning.studies.explore.rollout import Rollouts
    from tuning.studies.explore.sliders import movable

    config = load([], [*FAST, *commands.SHORT_TUNE, "tune.iterations=3", "ensemble.size=4"])
    environment = {k: v for k, v in os.environ.items() if k != "XLA_FLAGS"}
    desk = Desk(lambda: tmp_path, [sys.executable, "-P", "-m", "tuning.cli", "tune"], environment)
    page = Page(Rollouts(config, movable(config)), desk)
    page.handles["controller.k3"].value += 0.05
    page.tune()
    begin = time.monotonic()
    while page.tuning is not None and time.monotonic() - begin < 300:
        time.sleep(0.5)
        page.look()
    found = load([str(tmp_path / "tune-1" / "gains.toml")], note=lambda text: None).controller
    assert page.values["controller.k3"] == float(found.k3) != 10**1.05
    assert (tmp_path / "tune-1" / "report.html").exists() and "tuned in" in page.banner.text
