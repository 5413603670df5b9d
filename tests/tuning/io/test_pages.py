"""Pages show names as they are written, and run nothing of them."""

from html.parser import HTMLParser

import pytest

from tuning.io.pages import grid, html, picture, publish


class Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.text = [], ""

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_data(self, data):
        self.text += data


NAMES = ["<img src=x onerror=alert(1)>.csv", "<script>alert(1)</script>", "a|b", "`x` <b>", "[go](javascript:alert(1))"]


@pytest.mark.parametrize("name", NAMES)
def test_a_name_in_the_data_becomes_no_tag_and_no_column(tmp_path, name):
    page = Tags()
    page.feed(html(f"# {name}\n\n{name}\n\n{grid(['log', name], [[name, 1.0]])}", tmp_path, name))
    assert {tag for tag, _ in page.tags} <= {
        *("html", "head", "meta", "title", "style", "body", "main", "h1", "p", "code"),
        *("table", "thead", "tbody", "tr", "th", "td"),
    }
    assert sum(tag in ("th", "td") for tag, _ in page.tags) == 4
    assert not any(key.startswith("on") or "javascript" in str(value) for _, a in page.tags for key, value in a.items())
    assert name.replace("`", "") in page.text


REPORT = f"""# Is it safe?

Asked of a robot.

{picture("run.png", 'Its "path" in the plane.')}

## One

## Fine print

small & hidden

## Three

## Four

## Five
"""


def test_a_report_says_what_made_it_lists_its_sections_and_folds_the_fine_print(tmp_path, monkeypatch):
    (tmp_path / "run.png").write_bytes(b"picture")
    monkeypatch.setattr("sys.argv", ["/somewhere/bin/agvjax", "tune", "--set", "a=[1, 2]"])
    publish(tmp_path, REPORT, ("Fine print",))
    plain, text = ((tmp_path / f"report.{kind}").read_text() for kind in ("md", "html"))
    assert plain.splitlines()[:3] == ["# Is it safe?", "", plain.splitlines()[2]]
    assert "Made by `agvjax tune --set 'a=[1, 2]'`, agvjax " in plain and "/somewhere" not in plain
    page = Tags()
    page.feed(text)
    tags = [tag for tag, _ in page.tags]
    assert tags.count("details") == 1 and tags.count("figcaption") == 1 and tags.count("nav") == 1
    assert text.index("<details>") < text.index("Fine print</h2>") < text.index("small &amp; hidden")
    assert text.index("small &amp; hidden") < text.index("</details>") < text.index(">Three</h2>")
    links = [a["href"] for tag, a in page.tags if tag == "a"]
    assert links == [f"#{a['id']}" for tag, a in page.tags if tag == "h2"] and len(links) == 5
    assert next(a["alt"] for tag, a in page.tags if tag == "img") == "Its 'path' in the plane"
    assert all(not value.startswith("http") for _, a in page.tags for value in a.values())


def test_a_report_made_in_python_names_no_command(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["my_script.py", "secret"])
    publish(tmp_path, "# Title\n\nText.\n")
    assert "secret" not in (tmp_path / "report.md").read_text()
