"""Names and texts of a user never leave their literals in a generated file, and numbers keep their types."""

import ast
import importlib
import json
import random
import re
import shutil
import subprocess

import jax
import numpy as np
import pytest
import yaml

import agvjax
from agvjax import Route
from tuning.config.write import gains_table
from tuning.export import FORMATS, artefact, c, c_language, names, nav2, parameters, program, ros2
from tuning.export import numpy as numpy_file
from tuning.io.files import finite

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
PIECES = [
    "*/", "/*", "//", "\\", "\n", "\r", '"', "'", '"""', "'''", "??/", "??=", "\\\n", "*\\\n/", "\0", "\x07",
    "\x85", "\u2028", "\u202e", "\ud800", "é", "𝕏", "@STEP@", "@NAME@", "${HOME}", "$(touch x)", "`touch x`", "]]>",
    "<!--", "-->", "&", "<x/>", ": ", " #", "- ", "{", "}", "[", "]", "%n", "*a", "&a", "!!python/object:os.system",
    "|", ">", ";", "#error out", '#include "x"', '");', 'R"(', ')"', "../", "/etc", "name", "int", "a", "_", "9", " ",
    "x.y", "import os",
]  # fmt: skip
LAW = agvjax.Sampled(inner=agvjax.PathPID(), vehicle=agvjax.Base(), period=0.05)
LINE = Route.through([[0.0, 0.0], [2.0, 0.0], [4.0, 1.0]], 0.5)


def drawn(count, pieces, seed):
    rng = random.Random(seed)
    return ["".join(rng.choices(pieces, k=rng.randint(1, 6))) for _ in range(count)]


def test_of_a_thousand_hostile_names_none_is_one():
    """And of a thousand that are nearly right only those of small letters, digits and single underscores."""
    assert all(names.faults(name) for name in drawn(1000, PIECES, 1) if not re.fullmatch("[a-z_0-9]+", name))
    tame = drawn(1000, ["a", "b9", "_", "x", "7", "node", "A", "-", "\n", "é", "int", "nav2_core", "."], 2)
    taken = [name for name in tame if not names.faults(name)]
    assert 100 < len(taken) < 900
    assert all(re.fullmatch(r"[a-z](_?[a-z0-9])*\Z", name) and name.isascii() for name in taken)
    assert not {"int", "nav2_core", "node\n"} & set(taken)


TEXTS = drawn(1000, PIECES, 3)


@pytest.fixture(scope="module")
def facts(tmp_path_factory):
    """The provenance of a law, with plain texts and with hostile ones where a file of a user could have them."""
    folder = tmp_path_factory.mktemp("facts")
    (folder / "config.toml").write_text('[scenario]\nplant = "base"\n[scenario.path]\ntype = "route"\n')
    with open(folder / "config.toml", "a") as file:
        file.write("points = [[0.0, 0.0], [2.0, 0.0], [4.0, 1.0]]\nspeed = 0.5\n")
    (folder / "gains.toml").write_text(gains_table(LAW))
    found = artefact.read(str(folder / "gains.toml"))
    told, texts, many = found.provenance, iter(TEXTS), len(found.provenance["gains"])
    gains = {name: fact | {"unit": "m", "rule": "> 0"} for name, fact in told["gains"].items()}
    plain = found._replace(provenance=told | {"gains": gains})
    each = {name: [next(texts) for _ in range(len(TEXTS) // (2 * many))] for name in gains}
    rules = {name: "> 0 " + "".join(part) for name, part in each.items()}
    worse = {name: fact | {"unit": "".join(TEXTS[i::many]), "rule": rules[name]} for i, (name, fact) in
             enumerate(gains.items())}  # fmt: skip
    hostile = told | {"gains": worse, "source": "".join(TEXTS), "verdict": "".join(TEXTS), "vehicle": TEXTS[0]}
    hostile |= {"law": ["Sampled", "".join(TEXTS)], "uncertainty": {text: [text] for text in TEXTS}}
    return plain, found._replace(provenance=hostile)


@pytest.fixture(scope="module")
def texts(facts):
    """By the form of an export its files with plain texts and with hostile ones."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("step", "start"):  # once, for all forms
            made = getattr(program, name)(facts[0].controller)
            patch.setattr(program, name, lambda law, made=made: made)
        for module in (c, numpy_file):  # the vectors of self-tests, which nobody has a text in
            patch.setattr(module, "table", lambda found, step: (["none"], np.zeros((32, 1))))
        files = {}
        for form in ("nav2", "ros2", "numpy", "stablehlo"):
            module = importlib.import_module(FORMATS[form])
            patch.setattr(parameters, "of_gains", lambda law, gains: dict.fromkeys(gains, "a gain"))
            before = module.files(facts[0], "law")
            patch.setattr(parameters, "of_gains", lambda law, gains: dict.fromkeys(gains, "".join(TEXTS)))
            files[form] = before, module.files(facts[1], "law")
    return files


def stripped(folder, text):
    """Of C and C++, without comments: by the preprocessor."""
    file = folder / "text.cpp"
    file.write_text(text, encoding="utf-8")
    flags = ["-std=c++11", "-trigraphs", "-fpreprocessed", "-dD", "-E", "-P"]  # both as strict as any
    return subprocess.run(["gcc", *flags, file], capture_output=True, text=True, check=True).stdout


def without_texts(module):
    """A module without its docstring and provenance, and that."""
    tree, told = ast.parse(module), None
    tree.body = tree.body[1:]
    for node in list(tree.body):
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "PROVENANCE":
            told = ast.literal_eval(node.value)
            tree.body.remove(node)
    return ast.dump(tree), told


def without_descriptions(tree):
    """A tree of tables without the descriptions, and those."""
    found = []

    def walk(part):
        if not isinstance(part, dict):
            return part
        found.extend(part[key] for key in part if key == "description" and isinstance(part[key], str))
        return {key: walk(x) for key, x in part.items() if not (key == "description" and isinstance(x, str))}

    return walk(tree), found


@needs_gcc
@pytest.mark.parametrize("form", ["nav2", "ros2", "numpy", "stablehlo"])
def test_a_thousand_hostile_texts_change_no_code_of_any_form(form, texts, facts, tmp_path):
    """Compared with the files that plain texts give: by the preprocessor, the parser of Python, that of YAML."""
    before, after = texts[form]
    assert before.keys() == after.keys()
    seen = set()
    for name in before:
        kind, one, other = name.rpartition(".")[2], before[name], after[name]
        seen.add(kind)
        if kind in ("c", "h", "cpp", "hpp"):
            assert stripped(tmp_path, one) == stripped(tmp_path, other), name
        elif kind == "py":
            (code, _), (changed, told) = map(without_texts, (one, other))
            assert code == changed, name
            assert told is None or told == finite(facts[1].provenance)
        elif kind == "yaml":
            (tree, _), (changed, said) = (without_descriptions(yaml.safe_load(text)) for text in (one, other))
            assert tree == changed, name
            assert not [text for text in said if set('"\\`\n\r\0') & set(text)]  # what is made of it has no escapes
        elif kind == "json":
            json.loads(other)
        elif kind not in ("md", "bin", "txt"):
            assert one == other, name
    assert {"nav2": {"c", "h", "cpp", "hpp", "yaml", "xml", "txt"}, "ros2": {"py", "yaml", "xml", "cfg"}}.get(
        form, set()
    ) <= seen
    if form == "nav2":
        assert before["CMakeLists.txt"] == after["CMakeLists.txt"]
        (tmp_path / "law.h").write_text(after["law/law.h"])
        (tmp_path / "law.c").write_text('#include "law.h"\nint main(void) {return 0;}\n')
        flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-fsyntax-only"]
        subprocess.run(["gcc", *flags, tmp_path / "law.c"], check=True)


@needs_gcc
def test_a_comment_of_c_ends_where_it_should_for_each_of_a_thousand_texts(tmp_path):
    notes = [c_language.note(text) for text in TEXTS]
    found = stripped(tmp_path, "\n".join(f"int a{i}; /* {note} */ int b{i};" for i, note in enumerate(notes)))
    assert found.split("\n")[:-1] == [f"int a{i}; int b{i};" for i in range(len(TEXTS))]


# ---- numbers keep their types


def whole(law, folder):
    """An artefact whose gains are written as a person writes them: 3 and not 3.0."""
    text = re.sub(r"(\d+)\.0\b", r"\1", gains_table(law))
    (folder / "gains.toml").write_text(text)
    path = '[scenario.path]\ntype = "route"\npoints = [[0, 0], [2, 0], [4, 1]]\nspeed = 1\n'
    limits = "limits = { acceleration = 1, deceleration = 1 }\n"
    plant = '[scenario]\nplant = "base"\n'
    if law.follows():
        (folder / "config.toml").write_text(plant + path + limits)
    return artefact.read(str(folder / "gains.toml"))


UNICYCLE = agvjax.Sampled(
    inner=agvjax.NeuroBackstepping(k1=3.0), vehicle=agvjax.Unicycle(L=1.0), anti_windup=agvjax.BackCalculation()
)
SCALARS = {"double": "float", "double_array": "float", "bool": "bool", "string": "str"}


TORQUES = agvjax.Sampled(inner=agvjax.Backstepping(), vehicle=agvjax.DifferentialDrive())


@pytest.mark.parametrize(("module", "law"), [(ros2, UNICYCLE), (ros2, TORQUES), (ros2, LAW), (nav2, LAW)])
def test_every_number_in_yaml_is_of_the_type_that_is_declared(module, law, tmp_path):
    """By the tags of a parser of YAML 1.1: ROS refuses 3 where a double is declared; so is each bound one."""
    jax.config.update("jax_enable_x64", True)
    tables = module.tables(whole(law, tmp_path))
    values = yaml.compose(parameters.dumped({name: table["default_value"] for name, table in tables.items()}))
    ends = yaml.compose(parameters.dumped({name: table.get("validation", {}) for name, table in tables.items()}))

    def tags(node):
        parts = node.value if isinstance(node, yaml.SequenceNode) else [node]
        return {part.tag.rpartition(":")[2] for part in parts}

    assert len(tables) > 15
    for (name, value), (_, rules) in zip(values.value, ends.value, strict=True):
        kind = SCALARS[tables[name.value]["type"]]
        assert tags(value) <= {kind}, name.value
        for rule, bounds in rules.value:
            assert tags(bounds) <= {"int" if rule.value == "fixed_size<>" else kind}, name.value
