"""EQUATIONS.md stays true: every number of the paper, where it is computed, and what would fail if it were wrong."""

import ast
import functools
import io
import re
import tokenize

import pytest

from commands import ROOT

NUMBERS = range(1, 73)
HEADER = ["eq.", "what it says", "code", "test"]
NO_CODE = "proof only"
WIDEST = 10  # a range of more numbers than this names a chapter of the paper, not its equations
SOURCES = sorted(p for package in ("agvjax", "tuning") for p in (ROOT / package).rglob("*.py"))

# (41), (21)-(25); not the (0) of H(0), not a shape (2,)
MENTION = re.compile(r"(?<![\w\])}])\((\d{1,3})\)(?:-\((\d{1,3})\))?")
# the numbers that a docstring begins with: "Eq. (11).", "Eqs. (45) and (67), one estimate"
OPENING = re.compile(r"Eqs?\. (?:\(\d+\)(?:-|, and |, | and )?)+")
REFERENCE = re.compile(r"`([\w/.]+\.py)::([\w.]+)`")


def mentioned(text):
    """First and last number of every range that a text mentions; a number alone is both."""
    return [(int(first), int(last or first)) for first, last in MENTION.findall(" ".join(text.split()))]


def mentions(text):
    """The equations a text mentions, all those of a range included unless it is too wide."""
    ranges = [range(first, last + 1) for first, last in mentioned(text)]
    return {number for numbers in ranges if len(numbers) <= WIDEST for number in numbers}


def claims(text):
    """The equations that a comment claims: those it mentions, but not as neighbours of what it means."""
    return mentions(re.sub(r"\b(after|before) eqs?\. \(\d+\)", "", text))


def opening(doc):
    """The numbers that a docstring begins with: by the house rules those of what it implements."""
    match = OPENING.match(" ".join(doc.split()))
    return mentions(match.group()) if match else set()


class Source:
    """A file: its named objects, and its comments and strings with the lines they stand on."""

    def __init__(self, path):
        text = path.read_text(encoding="utf-8")
        self.tree = ast.parse(text)
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        self.comments = [(t.start[0], t.string) for t in tokens if t.type == tokenize.COMMENT]
        self.objects = {"": self.tree}
        for node in self.tree.body:
            for name in named(node):
                self.objects[name] = node
            if isinstance(node, ast.ClassDef):
                self.objects |= {f"{node.name}.{name}": inner for inner in node.body for name in named(inner)}

    def said(self, name):
        """What an object says: its docstrings and other strings, and the comments on its lines."""
        node = self.objects[name]
        first, last = (node.lineno, node.end_lineno) if name else (1, float("inf"))
        strings = [s.value for s in ast.walk(node) if isinstance(s, ast.Constant) and isinstance(s.value, str)]
        return strings + [comment for line, comment in self.comments if first <= line <= last]

    def docstrings(self):
        """Every named object's docstring, the module's under the name ""."""
        return {name: ast.get_docstring(node, clean=False) or "" for name, node in self.objects.items()}


def named(node):
    """The names a statement defines, as far as a reference may use them."""
    return [node.name] if isinstance(node, ast.ClassDef | ast.FunctionDef) else []


@functools.cache
def source(file):
    return Source(ROOT / file)


def split(line):
    return [cell.strip() for cell in line.strip().removeprefix("|").removesuffix("|").split("|")]


def table():
    lines = [line for line in (ROOT / "EQUATIONS.md").read_text(encoding="utf-8").splitlines() if line.startswith("|")]
    assert split(lines[0]) == HEADER
    assert set("".join(split(lines[1]))) <= set(":-")
    return [dict(zip(HEADER, split(line), strict=True)) for line in lines[2:]]


ROWS = table()
IN_CODE = {int(row["eq."]): REFERENCE.findall(row["code"]) for row in ROWS}
each_row = pytest.mark.parametrize("row", ROWS, ids=lambda row: f"eq{row['eq.']}")
each_file = pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))


# What counts as a mention


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("eq. (41)", {41}),
        ("Eqs. (21)-(25), (41), (57), (63) without the network", {*range(21, 26), 41, 57, 63}),
        ("eqs. (48), (52) and (70)", {48, 52, 70}),
        ("Z2 = v - phi1  # (21); and\n(24)", {21, 24}),
        ("the stability proof of eqs. (26)-(72)", set()),
        ("eqs. (26)-(72), in it (33)", {33}),
        ("H(0) of shape (2,) or (), f[0](1), 2024 (2024), eq. 41", set()),
    ],
)
def test_mentions_are_numbers_in_parentheses(text, numbers):
    assert mentions(text) == numbers


@pytest.mark.parametrize(
    ("text", "numbers"), [("# (22)", {22}), ("# m/s^2, f2, after eq. (36)", set()), ("before eq. (50); eq. (24)", {24})]
)
def test_what_stands_after_an_equation_does_not_claim_it(text, numbers):
    assert claims(text) == numbers


@pytest.mark.parametrize(
    ("doc", "numbers"),
    [
        ("Eq. (11). What an actuator delivers, eq. (12).", {11}),
        ("Eqs. (45) and (67), one estimate for both axes.", {45, 67}),
        ("Eqs. (26), (34), (51), (58), with phi.", {26, 34, 51, 58}),
        ("Eqs. (21)-(25), (41) without the network.", {*range(21, 26), 41}),
        ("After eq. (32). The velocity.", set()),
        ("", set()),
    ],
)
def test_opening_of_a_docstring(doc, numbers):
    assert opening(doc) == numbers


# The table


def test_every_equation_has_one_row_in_order():
    assert [row["eq."] for row in ROWS] == [str(n) for n in NUMBERS]


@each_row
def test_row_says_what_where_and_tested_by_what(row):
    assert row["what it says"]
    tests = REFERENCE.findall(row["test"])
    assert ", ".join(f"`{file}::{name}`" for file, name in tests) == row["test"]
    if row["code"] != NO_CODE:
        references = REFERENCE.findall(row["code"])
        assert references and tests
        assert ", ".join(f"`{file}::{name}`" for file, name in references) == row["code"]


@each_row
def test_code_exists_and_names_the_equation(row):
    for file, name in REFERENCE.findall(row["code"]):
        assert ROOT / file in SOURCES, file
        code = source(file)
        assert name in code.objects, f"{file} has no {name}"
        own = mentions("\n".join(code.said(name)))
        module = mentions(code.docstrings()[""])
        assert int(row["eq."]) in own | module, f"{file}::{name} nowhere names ({row['eq.']})"


@each_row
def test_test_exists(row):
    for file, name in REFERENCE.findall(row["test"]):
        assert (ROOT / file).is_file(), file
        assert name.startswith("test_") and name in source(file).objects, f"{file} has no {name}"


# The code


@each_file
def test_every_number_mentioned_is_one_of_the_papers(path):
    said = source(str(path.relative_to(ROOT))).said("")
    assert {number for text in said for ends in mentioned(text) for number in ends} <= set(NUMBERS)
    assert not [text for text in said if re.search(r"\b[Ee]qs?\b\.? *\d", text)]  # "eq. 41": what no one would find


@each_file
def test_every_docstring_that_opens_with_an_equation_is_in_its_row(path):
    file = str(path.relative_to(ROOT))
    for name, doc in source(file).docstrings().items():
        for number in opening(doc):
            listed = [other for where, other in IN_CODE[number] if where == file]
            kin = [other for other in listed if within(other, name) or within(name, other)]
            assert kin, f"{file}::{name} claims ({number}); its row has {listed or 'nothing of this file'}"


def within(inner, outer):
    return f"{inner}.".startswith(f"{outer}.")


@each_file
def test_nothing_claims_what_only_the_proof_needs(path):
    code = source(str(path.relative_to(ROOT)))
    docs = set(code.docstrings().values())
    claimed = {number for doc in docs for number in opening(doc)}
    claimed |= {number for text in code.said("") if text not in docs for number in claims(text)}
    assert not claimed & {int(row["eq."]) for row in ROWS if row["code"] == NO_CODE}
