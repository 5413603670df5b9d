"""Every block of code in README and docs: commands are commands, TOML is read, and all of it runs (slow)."""

import itertools
import os
import re
import shlex
import shutil
import tomllib

import pytest

import agvjax
from commands import FAST, HUNG, ROOT, python, start
from runs import logged
from tuning.cli.main import COMMANDS, parser
from tuning.config.load import load
from tuning.identify.log import commands_of
from tuning.io.viewers import Asked, write_runs

PAGES = ["README.md", *sorted(str(path.relative_to(ROOT)) for path in (ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.S | re.M)
SEARCH = [f"tune.search.{part}" for part in ("scouts=4", "starts=1", "iterations=1", "checks=0", "rounds=0")]
TUNE = [
    *FAST,
    "criteria.late=0.5",
    "ensemble.size=2",
    "ensemble.validation_size=2",
    "tune.iterations=1",
    "tune.screen=4",
    *SEARCH,
]
SMALL = {  # enough to go all the way through
    "simulate": FAST,
    "tune": TUNE,
    "sweep": ["simulate.horizon=20", "sweep.dt=0.01", "sweep.samples=2", "sweep.radius=false"],
    "margins": ["simulate.horizon=8", "margins.vehicles=1", "margins.instants=2"],
    "speed": [*TUNE, "speed.points=2"],
    "certify": ["simulate.horizon=5", "sweep.dt=0.01", "certify.halvings=0", "certify.boxes=1", *SEARCH],
    "identify": ['identify.fit=["deadzone"]', "identify.bootstrap=20", "identify.starts=1", "identify.drives=0"],
    "apply": ["apply.vehicles=59", "apply.starts=1", "apply.samples=4", *SEARCH, 'identify.fit=["deadzone"]'],
    "watch": ["watch.logs=99", 'identify.fit=["deadzone"]'],
}
# Run by tests of their own, at length; a page that stays open; processes that wait for each other, or for a cluster.
ELSEWHERE = ("compare", "explore", "reproduce", "vehicles", "completion")
BY_OTHERS = "docs/extending.md", "docs/fmu.md"  # tests/test_docs.py, tests/tuning/export/test_export_fmu.py
APART = "--num-processes", "--coordinator", "--scheduler", "--evidence"


def blocks(page):
    return FENCE.findall((ROOT / page).read_text(encoding="utf-8"))


def lines(page):
    """The lines of a page's shell blocks, those that go on joined, loops written out, without comments."""
    text = "".join(body for kind, body in blocks(page) if kind == "sh").replace("\\\n", " ")
    for loop in re.findall(r"^for .*$", text, re.M):
        name, values, body = re.fullmatch(r"for (\w+) in (.*?); do (.*); done", loop).groups()
        text = text.replace(loop, "\n".join(body.replace(f"${name}", value) for value in values.split()))
    words = (shlex.split(line.partition(" > ")[0], comments=True) for line in text.splitlines())
    return [line for line in words if line]


def calls(page):
    """The calls of `agvjax` on a page: their words, without the program's."""
    found = []
    for words in lines(page):
        at = next((i for i, word in enumerate(words) if re.fullmatch(r"(.*/)?agvjax", word)), None)
        if at is not None and words[0] != "make":
            found.append([word for word in words[at + 1 :] if word != "$resume"])
    return found


MADE = ("robot.toml", "found/scenario.toml", "tuned/gains.toml", "mine/gains.toml", "later/scenario.toml", "tuned")
ALL = [pytest.param(page, call, id=f"{page}: {' '.join(call)}"[:90]) for page in PAGES for call in calls(page)]


@pytest.fixture
def files(tmp_path, monkeypatch):
    """The files that the pages speak of, made of what the repository has."""
    for name in ("robot.toml", "late.toml"):
        bodies = [body for page in PAGES for kind, body in blocks(page) if kind == "toml" and f"# {name}\n" in body]
        (tmp_path / name).write_text("".join(bodies))
    for name in ("track.csv", "aisle.csv", "other.csv"):
        (tmp_path / name).write_text("x,y\n0,0\n8,0\n8,4\n0,4\n")
    shutil.copy(ROOT / "tests/data/nav2/courier.yaml", tmp_path / "nav2_params.yaml")
    for folder in ("tuned", "mine", "runs/tune-..."):
        shutil.copytree(ROOT / "tests/data/before-rooms/tune-done", tmp_path / folder)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_block_says_what_language_it_is_in():
    kinds = {(page, kind) for page in PAGES for kind, _ in blocks(page)}
    assert {kind for _, kind in kinds} <= {"sh", "toml", "python", "c", "math", "text"}
    assert len(ALL) > 50


@pytest.mark.parametrize("page", PAGES)
def test_a_line_of_the_shell_is_understood(page):
    """Options are options, targets are in the Makefile, extras are in pyproject.toml."""
    targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.M))
    extras = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"])
    for call in calls(page):
        assert parser().parse_args(call).command in COMMANDS or "--version" in call
    for words in lines(page):
        if words[0] == "make" and words[1] != "-C":
            assert set(words[1:]) <= targets, words
        for extra in itertools.chain(*(re.findall(r"\[([\w,]+)\]", w) for w in words if "install" in words)):
            assert set(extra.split(",")) <= extras, words


@pytest.mark.parametrize("page", PAGES)
def test_toml_is_read_and_so_is_what_commands_set(page, files):
    preset = {"docs/deadzone.md": "base", "docs/following.md": "base", "docs/tutorial.md": "base"}
    preset |= {"docs/robot.md": "robot", "docs/vehicles.md": "unicycle"}
    if page == "docs/extending.md":  # by tests/test_docs.py: its files come with classes of one's own
        return
    for number, (_, body) in enumerate(block for block in blocks(page) if block[0] == "toml"):
        (files / f"{number}.toml").write_text(body)
        load([*([preset[page]] if page in preset else []), f"{number}.toml"], note=[].append)
    for call in calls(page):
        asked = parser().parse_args(call)
        given = [name for name in getattr(asked, "config", []) if name not in MADE]
        if asked.command in SMALL and len(given) == len(asked.config) and "/shared" not in str(asked.out):
            load(given, [*asked.set, *SMALL[asked.command]], note=[].append)


def small(call):
    """A call with few runs of few steps, and a folder of its own."""
    counts = [re.sub(r"(:[\d.]+:[\d.]+):\d+$", r"\1:2", word) for word in call]
    counts = ["8" if before == "--samples" else word for before, word in zip(["", *counts], counts, strict=False)]
    settings = [x for text in SMALL.get(call[0], []) for x in ("--set", text)]
    if call[0] == "identify" and not parser().parse_args(call).logs:  # it suggests a drive, or does nothing
        settings += ["--set", "identify.drives=1"]
    if call[0] == "new":
        settings = ["--vehicle", "differential", "--rate", "20", "--delay", "0.04", "--deadzone", "0.05"]
    return counts + settings


def called(call):
    """Run a call as it stands but for its size; what is this short may end with gains or numbers that are no good."""
    words = small(call)
    if "--resume" in words:
        called([word for word in call if word != "--resume"])
    elif "--out" in words:
        out = words[words.index("--out") + 1]
        shutil.rmtree(out, ignore_errors=True) if os.path.isdir(out) else os.path.exists(out) and os.remove(out)
    elif words[0] == "new":
        os.remove("robot.toml")
    elif words[0] not in ("explain", "--version"):
        words += ["--out", f"runs/{words[0]}-{len(os.listdir('runs'))}"]
    process = start(words)
    _, err = process.communicate(timeout=HUNG)
    short = words[0] in ("tune", "speed", "certify", "identify", "margins", "log", "apply", "watch")
    assert process.returncode == 0 or (process.returncode == 1 and short), err
    assert "Traceback" not in err, err
    if words[0] == "tune":
        out = words[words.index("--out") + 1]
        assert os.path.isfile(f"{out}/gains.toml"), err
        for folder in {"tuned", "mine", "runs/tune-..."} - {out}:
            shutil.rmtree(folder)
            shutil.copytree(out, folder)


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if page not in BY_OTHERS])
def test_the_commands_of_a_page_run_in_their_order_and_so_does_its_python(page, files):
    if "drive.csv" in str(calls(page)):
        drives("robot")
    if "drive.mcap" in str(calls(page)):
        recording("base")
    before = [call for earlier in PAGES[: PAGES.index(page)] for call in calls(earlier)]
    for call in calls(page):
        apart = call[0] in ELSEWHERE or "/shared/chance" in call or any(word in call for word in APART)
        if not apart and (call not in before or "--out" in call):
            called(call)
    for kind, body in blocks(page):
        if kind == "python" and page not in ("README.md", "docs/python.md"):  # those by tests/test_docs.py
            python(PRELUDE + body if "MyLaw" in body else body)


PRELUDE = """
import agvjax
@agvjax.pytree
class MyLaw(agvjax.Law):
    stiffness: float = agvjax.number(9.0, "1/s^2", agvjax.POSITIVE)
    damping: float = agvjax.number(6.0, "1/s", agvjax.POSITIVE)
    def init(self, measurement, reference):
        return ()
    def law(self, flow, memory, measurement, reference):
        position = self.stiffness * (reference.position - measurement.position)
        position += self.damping * (reference.velocity - measurement.velocity) + reference.acceleration
        turned = agvjax.wrap(reference.heading - measurement.heading)
        return agvjax.Command(position=position, heading=reference.heading_rate + 5.0 * turned), ()
"""


def drives(preset):
    """Two drives of a preset's vehicle, as they would be logged."""
    config = load([preset])
    for file, heading in (("drive.csv", 0.3), ("other.csv", -0.3)):
        scenario = agvjax.replace(config.scenario, {"start.heading": heading})
        trajectory = agvjax.simulate(config.controller, scenario, dt=0.005, n_steps=4000, save_every=4)
        logged(file, trajectory, commands_of(scenario.plant))


def recording(preset):
    """A drive of a preset's vehicle, as ROS 2 records it."""
    config = load([preset])
    trajectory = agvjax.simulate(config.controller, config.scenario, dt=0.005, n_steps=4000, save_every=4)
    write_runs(Asked(mcap="drive.mcap"), {"": trajectory}, config.scenario.plant)
