"""What 'worst found', 'worst of n', 'proved' and 'with probability' mean, the same in every report, none mixed."""

import ast
import re

import pytest

from claimed import unqualified
from commands import ROOT
from tuning.io import statements

SAYS = ("page", "tables", "words", "captions", "caveats", "figures", "place", "sentences")  # names of files that report
CLAIMED = {"worst found": statements.FOUND, "proved": statements.PROVED, "with probability": statements.PROBABLE}


def told(path):
    """The texts of a file that reach a reader: strings with a blank in them, docstrings left out."""
    tree = ast.parse(path.read_text())
    docs = {
        ast.get_docstring(n, clean=False)
        for n in ast.walk(tree)
        if isinstance(n, ast.FunctionDef | ast.ClassDef | ast.Module)
    }
    inside = {id(part) for n in ast.walk(tree) if isinstance(n, ast.JoinedStr) for part in ast.walk(n) if part is not n}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield "".join(p.value if isinstance(p, ast.Constant) else "{}" for p in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in inside:
            if node.value not in docs and " " in node.value.strip():
                yield node.value


PAGES = sorted(p for p in (ROOT / "tuning").rglob("*.py") if any(p.stem.endswith(name) for name in SAYS))


@pytest.mark.parametrize("path", PAGES, ids=lambda p: str(p.relative_to(ROOT / "tuning")))
def test_no_report_says_worst_without_saying_which(path):
    assert [hit for text in told(path) for hit in unqualified(text)] == []


def test_the_search_for_such_words_finds_what_there_is():
    rooms = {"tune", "sweep", "rare", "speed", "laws", "margins", "identify", "vehicles"}
    assert len(PAGES) > 25 and rooms <= {path.parent.name for path in PAGES}
    assert unqualified("mean and worst error") and unqualified("in the worst case") and unqualified("worst, tuned")
    assert not unqualified("worst found in the box") and not unqualified("worst of 256 before") and not unqualified("")
    assert not unqualified("worst total_rmse misses its limit") and not unqualified("it is in worst.json")


OWN_LINE = [  # every kind of report, by what writes it
    "tune/page", "sweep/page", "apply/page", "sweep/rare/page", "identify/page", "studies/speed/page",
    "studies/laws/page", "studies/laws/followers_page", "studies/remedies/page", "studies/margins/page",
    "studies/vehicles/page",
]  # fmt: skip


@pytest.mark.parametrize("name", OWN_LINE)
def test_every_report_has_its_own_line_of_what_its_words_mean(name):
    text = (ROOT / "tuning" / f"{name}.py").read_text()
    assert re.search(r"statements\.said\(|said_of\(|tables\.words\(", text)


def test_each_kind_of_claim_has_one_meaning_and_its_own_words():
    for name, kind in CLAIMED.items():
        assert name == kind and statements.of_kind(kind).startswith(f"{name}: ")
    found, proved, probable = (statements.MEANING[kind] for kind in CLAIMED.values())
    assert "bounds the true largest below" in found and "no search bounds it above" in found
    assert "without samples" in proved and "95 %" not in proved
    assert "drawn at random" in probable and "95 %" in probable
    assert not {"proved", "with probability"} & {w for text in (found,) for w in re.findall(r"\w+", text)}


def test_the_largest_of_draws_says_what_share_may_exceed_it():
    assert statements.worst_of(256) == "worst of 256"
    text = statements.of_draws(59)
    assert text.startswith("worst of 59: the largest of 59 random draws; with 95 % confidence at most 0.05 of all")
    assert statements.of_least(299, "tightest") == (
        "tightest: the smallest of 299 random draws; with 95 % confidence at most 0.01 of all draws lie below it"
    )
