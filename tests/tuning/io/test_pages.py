"""Pages show names as they are written, and run nothing of them."""

from html.parser import HTMLParser

import pytest

from tuning.io.pages import grid, html


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
        *("html", "head", "meta", "title", "style", "body", "h1", "p", "code"),
        *("table", "thead", "tbody", "tr", "th", "td"),
    }
    assert sum(tag in ("th", "td") for tag, _ in page.tags) == 4
    assert not any(key.startswith("on") or "javascript" in str(value) for _, a in page.tags for key, value in a.items())
    assert name.replace("`", "") in page.text
