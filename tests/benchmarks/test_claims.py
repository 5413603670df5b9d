"""Figures of the documentation are those of the files that hold them; and how runs are compared with earlier ones."""

import json
import re

import pytest

from benchmarks import history
from benchmarks.__main__ import PARTS
from commands import ROOT

PAGE = (ROOT / "docs" / "claims.md").read_text(encoding="utf-8")
ROWS = [[cell.strip() for cell in line.strip("|").split("|")] for line in PAGE.splitlines() if ".json |" in line]
each_claim = pytest.mark.parametrize("claim", ROWS, ids=lambda claim: f"{claim[4]}-{claim[1]}")


def said(text):
    """A page as one line, without Markdown's line breaks."""
    return " ".join(text.split())


def of_row(file, chosen):
    """The row of a file whose columns have these values, spaces written as underscores."""
    wanted = dict(part.split("=", 1) for part in chosen.split())
    rows = json.loads((ROOT / "benchmarks" / "results" / file).read_text())["rows"]
    (found,) = [row for row in rows if all(str(row[k]).replace(" ", "_") == v for k, v in wanted.items())]
    return found


def rounded(value, figure):
    """Whether a value is this figure, to the digits that it has."""
    mantissa, _, exponent = figure.partition("e")
    unit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    if "." not in mantissa and not exponent:  # 2670: zeros at the end stand for digits that were left out
        unit = 10.0 ** (len(mantissa) - max(len(mantissa.rstrip("0")), min(3, len(mantissa))))
    return abs(value - float(figure)) <= 0.5000001 * unit


def test_there_are_claims_of_every_page_with_benchmarks():
    assert len(ROWS) > 25 and all(len(row) == 7 for row in ROWS)
    assert {row[4] for row in ROWS} >= {f"{part}.json" for part in ("rollout", "gradient", "python", "startup")}


@each_claim
def test_page_and_file_agree(claim):
    link, words, figure, command, file, chosen, column = claim
    page = (ROOT / "docs" / re.search(r"\((.+)\)", link)[1]).read_text(encoding="utf-8")
    first, colon, rest = words.partition(": ")
    if colon:  # of a table
        lines = [line.strip("|").split("|") for line in page.splitlines() if line.startswith(f"| {first} |")]
        assert [rest in [cell.strip() for cell in cells] for cells in lines] == [True]
    else:
        assert words in said(page)
    assert figure in words
    assert command == f"`make bench ARGS={file.removesuffix('.json')}`" and file.removesuffix(".json") in PARTS
    assert rounded(float(of_row(file, chosen)[column]), figure), of_row(file, chosen)[column]


def test_a_figure_is_compared_to_its_digits():
    assert rounded(0.6206, ".62") and not rounded(0.626, ".62")
    assert rounded(1.4398e-5, "1.4e-5") and not rounded(1.46e-5, "1.4e-5")
    assert rounded(2669.9, "2670") and rounded(2674, "2670") and not rounded(2676, "2670")
    assert rounded(612, "612") and not rounded(613, "612") and not rounded(9, "8")


def test_a_run_is_compared_with_the_last_one_on_the_same_machine(tmp_path):
    def row(processor, ratio, commit):
        machine = {"date": "2026-01-02", "processor": processor, "cores": 2, "python": "3.11", "versions": {"jax": "1"}}
        return history.kept({"part": "p", "machine": machine, "rows": [{"peer": "c", "ratio": ratio}]}, commit)

    path = tmp_path / "history.csv"
    assert history.append(row("one", 2.0, "aaa"), path) is None
    assert history.append(row("two", 5.0, "bbb"), path) is None
    old = history.append(row("one", 1.0, "ccc"), path)
    assert old["commit"] == "aaa"
    assert "c: ratio: 2 -> 1 (-50%)" in history.change(row("one", 1.0, "ccc"), old)
    assert len(path.read_text().splitlines()) == 4
    assert "0 of 1 figures" in history.change(row("one", 1.04, "ddd"), history.append(row("one", 1.04, "ddd"), path))


def test_a_result_in_words_or_a_count_is_no_part_of_what_a_row_is_about():
    """Else no figure of it would be found again where the result changes."""
    rows = [{"drive": "one", "verdict": "good", "told": 3, "rms": 2.0}, {"drive": "two", "verdict": "good", "rms": 4.0}]
    assert history.figures(rows) == {"one: rms": 2.0, "two: rms": 4.0}
    cases = [{"batch": 64, "precision": p, "peer": "c", "ratio": x} for p, x in (("float32", 1.0), ("float64", 2.0))]
    assert history.figures(cases) == {"64 float32: ratio": 1.0, "64 float64: ratio": 2.0}


def test_the_history_is_read_back():
    first, *rest = history.HISTORY.read_text().splitlines()
    assert first.split(",") == list(history.COLUMNS) and rest
