"""The documentation as a site: what the reference must name is there, links lead somewhere, nothing needs a network."""

import html
import html.parser
import importlib.util
import re
import shlex
import shutil
import urllib.parse
from pathlib import Path

import pytest

import agvjax
import tuning
from agvjax.metric_table import METRICS
from commands import ROOT, run
from tuning.cli.main import COMMANDS, parser
from tuning.config.described import every_key
from tuning.config.load import load
from tuning.config.names import CLASSES

pytestmark = pytest.mark.slow  # `make docs`, with warnings as errors, builds the site too

LOADED = {"script": "src", "link": "href", "img": "src", "iframe": "src", "source": "src", "video": "src"}


class Seen(html.parser.HTMLParser):
    """What a page has: anchors, links, what it loads, headings, pictures."""

    def __init__(self, text):
        super().__init__()
        self.ids, self.links, self.loaded, self.levels, self.pictures = [], [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.ids += [found["id"]] if "id" in found else []
        self.links += [found["href"]] if tag == "a" and "href" in found else []
        if tag in LOADED and found.get("rel") not in ("canonical", "next", "prev"):
            self.loaded += [found[LOADED[tag]]] if LOADED[tag] in found else []
        self.levels += [int(tag[1])] if re.fullmatch("h[1-6]", tag) else []
        self.pictures += [found] if tag == "img" else []


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """The built site, a page by its place in it; warnings are errors."""
    folder = tmp_path_factory.mktemp("site")
    run(["build", "--quiet", "--strict", "--config-file", str(ROOT / "mkdocs.yml"), "--site-dir", str(folder)],
        program=("-m", "mkdocs"))  # fmt: skip
    pages = {str(path.relative_to(folder)): path.read_text(encoding="utf-8") for path in folder.rglob("*.html")}
    yield folder, pages, {name: Seen(text) for name, text in pages.items()}
    shutil.rmtree(folder)


def test_every_public_name_is_in_the_reference_of_python(site):
    ids = {anchor for name, page in site[2].items() if name.startswith("reference/") for anchor in page.ids}
    for package, names in ((agvjax, agvjax.__all__), (tuning, tuning._HOMES)):
        assert len(names) >= 30
        # an object's anchor is its full path: agvjax.simulate.simulate
        missing = [n for n in names if not any(re.fullmatch(rf"{package.__name__}[.\w]*\.{n}", x) for x in ids)]
        assert not missing


def test_every_key_is_in_the_list_of_keys_and_leads_to_its_row(site):
    _, pages, seen = site
    listed = pages["reference/keys/index.html"]
    rows = re.findall(r'<li><a href="([^"]+)"><code>([^<]+)</code>', listed)
    found = {html.unescape(key): link for link, key in rows}
    assert set(found) == set(every_key())
    for key, link in found.items():
        page, _, anchor = link.partition("#")
        assert anchor in seen[f"reference/keys/{page}"].ids, key
        last = key.replace("<", "").replace(">", "").rpartition(".")[2]
        assert anchor.rpartition(".")[2] == last, (key, anchor)


def test_a_row_says_default_unit_rule_and_meaning(site):
    text = site[1]["reference/keys/controller.html"]
    row = re.search(r'id="controller\.neuro_backstepping\.k1">.*?</tr>', text)[0]
    assert all(word in row for word in ("<code>k1</code>", ">20<", "1/s", "&gt; 0", "eq. (32)"))
    assert 'id="tune.limits.metric.worst"' in site[1]["reference/keys/tune.html"]


def test_every_type_is_there(site):
    ids = {anchor for name, page in site[2].items() if name.startswith("reference/keys") for anchor in page.ids}
    for place, classes in CLASSES.items():
        home = re.sub(r"^controller(\.inner)+(?=\.|$)", "controller", place)  # the same types stand within laws
        home = home.replace("controller.vehicle", "scenario.plant")
        missing = [n for n in classes if not {f"{home}.{n}", f"{place}.{n}"} & ids]
        assert place == "elements" or not missing, place
    elements = site[1]["reference/keys/scenario.html"]
    assert all(re.search(rf"\b{name}\b", elements) for name in CLASSES["elements"])


def test_every_metric_and_command_is_there(site):
    _, pages, seen = site
    assert all(f"<code>{name}</code>" in pages["reference/metrics.html"] for name in METRICS)
    assert {f"agvjax-{name}" for name in COMMANDS} <= set(seen["reference/commands.html"].ids)
    text = html.unescape(pages["reference/commands.html"])
    for command in COMMANDS.values():
        assert all(option.names[0] in text for option in command.options)
    assert all(f"<td>{code}</td>" in pages["reference/commands.html"] for code in (0, 1, 2, 130))


def test_links_and_what_is_loaded_are_in_the_site(site):
    folder, _, seen = site
    count = 0
    for name, page in seen.items():
        for link in page.links + page.loaded:
            parts = urllib.parse.urlsplit(link)
            if parts.scheme or parts.netloc:
                assert link in page.links, f"{name} loads {link}"
                continue
            if name == "404.html":  # its links are from the root of a server
                continue
            target = (folder / name).parent / urllib.parse.unquote(parts.path) if parts.path else folder / name
            target = target / "index.html" if target.is_dir() else target
            assert target.is_file(), f"{name} leads to {link}"
            place = str(target.resolve().relative_to(folder.resolve()))
            anchor = urllib.parse.unquote(parts.fragment)
            assert not anchor or place not in seen or anchor in seen[place].ids, f"{name} leads to {link}"
            count += 1
    assert count > 5000  # there is something to hold


def test_every_page_of_the_docs_is_in_the_navigation():
    listed = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    pages = [path.name for path in (ROOT / "docs").glob("*.md")]
    assert len(pages) > 10 and not [page for page in pages if not re.search(rf"\b{page}\b", listed)]


def test_the_readme_lists_every_command():
    table = [line for line in (ROOT / "README.md").read_text(encoding="utf-8").splitlines() if line.startswith("| `")]
    said = set(re.findall(r"`(?:agvjax )?(\w+)[^`]*`", "\n".join(line.split("|")[1] for line in table)))
    assert said == set(COMMANDS)


def test_no_style_loads_from_a_network(site):
    sheets = list(site[0].rglob("*.css"))
    assert len(sheets) >= 3
    for sheet in sheets:
        assert not re.search(r"(url\(|@import)\s*[\"']?(https?:)?//", sheet.read_text(encoding="utf-8")), sheet


def test_headings_are_in_order_and_pictures_have_words(site):
    for name, page in site[2].items():
        assert page.levels[:1] == [1] and page.levels.count(1) == 1, (name, page.levels[:3])
        steps = [(a, b) for a, b in zip(page.levels, page.levels[1:], strict=False) if b > a + 1]
        assert not steps, name
        assert all(picture.get("alt") for picture in page.pictures), name
        assert len(set(page.ids)) == len(page.ids), (name, {x for x in page.ids if page.ids.count(x) > 1})


def test_the_commands_of_the_tutorial_are_commands_and_its_file_is_read(tmp_path):
    text = (ROOT / "docs/tutorial.md").read_text(encoding="utf-8")
    lines = [line for block in re.findall(r"```sh\n(.*?)```", text, re.S) for line in block.splitlines()]
    calls = [shlex.split(line)[1:] for line in lines if line.startswith("agvjax ")]
    names = [parser().parse_args(call).command for call in calls]
    assert [n for n in names if n] == ["simulate", "simulate", "tune", "simulate", "margins", "export"]
    assert [int(n) for n in re.findall(r"^## (\d+)\.", text, re.M)] == list(range(1, 11))
    robot, limit = re.findall(r"```toml\n(.*?)```", text, re.S)
    (tmp_path / "robot.toml").write_text(robot + limit)
    config = load(["base", str(tmp_path / "robot.toml")])
    assert config.controller.inner.desired_linear_vel == 0.6
    assert config.tune.limits["cross_track_peak_late"].worst == 0.15
    assert config.ensemble.size == 64


THEMES = {"landmark-unique"}  # of the theme: its menus for wide and for narrow screens have one name
VIOLATIONS = """axe.run(document, { resultTypes: ['violations'] }).then(found => found.violations.map(
  rule => [rule.id, rule.nodes.map(node => node.target.join(' ')).slice(0, 3)]))"""


FEW = ["index.html", "tuning.html", "reference/keys/tune.html"]


@pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_pages_are_accessible_by_the_rules_of_axe(every, site, monkeypatch):
    """Contrast, names, headings, landmarks, what the keyboard reaches: in a browser, in a light and a dark page."""
    monkeypatch.syspath_prepend(str(ROOT))
    from benchmarks import browser

    if browser.found() is None:
        pytest.skip("no Chromium")
    rules = Path(importlib.util.find_spec("axe_core_python").origin).with_name("axe.min.js").read_text(encoding="utf-8")
    folder, pages, _ = site
    looked_at = [name for name in pages if "/" not in name and name != "404.html"]
    looked_at += [
        "reference/metrics.html",
        "reference/commands.html",
        "reference/keys/tune.html",
        "project/index.html",
    ]

    async def visit(tab):
        found = {}
        for scheme in ("light", "dark"):
            asked = {"name": "prefers-color-scheme", "value": scheme}
            await tab.call("Emulation.setEmulatedMedia", features=[asked])
            for name in looked_at:
                await tab.go((folder / name).as_uri())
                await tab.value(f"{rules}; 0")
                wrong = [rule for rule in await tab.value(VIOLATIONS) if rule[0] not in THEMES]
                found |= {(name, scheme): wrong} if wrong else {}
        return found

    assert len(looked_at) > 15 and set(FEW) <= set(pages)
    looked_at = looked_at if every else FEW
    assert browser.visit("about:blank", visit) == {}


BOX = "document.querySelector('[data-md-component=search-query]')"
SEARCHED = f"""(box => {{
  document.querySelector('#__search').click();
  box.focus();
  box.value = 'limit cycle';
  for (const kind of ['keyup', 'input']) box.dispatchEvent(new Event(kind, {{ bubbles: true }}));
}})({BOX})"""
HITS = "[...document.querySelectorAll('.md-search-result__item a')].map(link => link.href)"


@pytest.mark.parametrize("page", ["index.html", "reference/keys/tune.html"])
def test_a_page_that_is_opened_as_a_file_can_be_searched(page, site, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT))
    from benchmarks import browser

    if browser.found() is None:
        pytest.skip("no Chromium")
    folder, address = site[0], (site[0] / page).as_uri()

    async def visit(tab):
        await tab.until(f"{BOX} !== null")
        await tab.value(SEARCHED)
        await tab.until(f"{HITS}.length > 0")
        return await tab.value(HITS)

    assert f"{folder.as_uri()}/deadzone.html#limit-cycles" in browser.visit(address, visit)
