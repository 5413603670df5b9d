"""The pages of the reference, made of what the program itself says: keys, metrics, commands, names of Python.

Nothing is described here. A key is what `tuning.config.described` says, a metric a row of `METRICS`, a command what
its parser has, a name in Python its docstring.
"""

import ast
import html
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import tuning
from agvjax.metric_table import METRICS, Metric
from tuning.cli.main import COMMANDS, EXIT_CODES
from tuning.cli.options import COMMON, Option
from tuning.config.described import LEFT_OPEN, Described, described, every_key, of_type
from tuning.config.names import CLASSES

TOOLS = "other"  # the page of single keys and of small tables
ALIKE = {"controller.vehicle": "scenario.plant"}  # where the same types may stand
INNER = re.compile(r"^controller(\.inner)+(?=\.|$)")
INTRO = (
    "Made from the program when this site is built. `agvjax` reads keys from `--config FILE.toml` and from `--set "
    "KEY=VALUE`; [Configuration](../../configuration.md) shows them in a file."
)


def pages(root: Path) -> dict[str, str]:
    """Every page of the reference by its place in the site, as Markdown."""
    return {
        "reference/index.md": _index(),
        "reference/commands.md": _commands(),
        **_keys(),
        "reference/metrics.md": _metrics(),
        **_python(root),
    }


def _index() -> str:
    rows = [
        "* [Commands](commands.md): each with its options, and the exit codes",
        "* [Keys](keys/index.md): every key of a configuration, with default, unit and rule",
        "* [Metrics](metrics.md): what can be a goal, a limit, or a failure criterion",
        "* [`agvjax`](agvjax/index.md): the simulator in Python",
        "* [`tuning`](tuning.md): tuning and sweeps in Python",
    ]
    return "\n".join(["# Reference", "", "These pages are made from the program itself.", "", *rows, ""])


# keys


def _keys() -> dict[str, str]:
    """A page for each large part of the configuration, one for the small ones, and the list of all keys."""
    tops: dict[str, list[Described]] = {}
    for key in every_key():
        tops.setdefault(key.partition(".")[0], []).append(described(key))
    large = {top: rows for top, rows in tops.items() if len(rows) > 30}
    small = [row for top, rows in tops.items() if top not in large for row in rows]
    texts = {top: _sections(rows) for top, rows in large.items()} | {TOOLS: _sections(small)}
    titles = {top: f"`[{top}]`" for top in large} | {TOOLS: "Runs, ensembles and other commands"}
    made = {
        f"reference/keys/{top}.md": f"# {titles[top]} {{#page.{top}}}\n\n{INTRO}\n\n{text}"
        for top, text in texts.items()
    }
    return {"reference/keys/index.md": _list_of_keys(texts), **made}


def _sections(rows: list[Described]) -> str:
    """Keys by the table of TOML that they stand in; where types differ, by type."""
    groups: dict[str, list[Described]] = {}
    for row in rows:
        groups.setdefault(row.key.rpartition(".")[0], []).append(row)
    parts = []
    alone = groups.pop("", [])
    if len(alone) == 1:  # the table that the page is of
        parts.append(f'<p id="{alone[0].key}">{_sentence(alone[0].text)}</p>\n')
    elif alone:
        parts += ["## Keys and tables at the top\n", _table(alone)]
    for group, members in groups.items():
        if INNER.match(group) and group != "controller.inner":
            continue  # the same types as in [controller]
        if any(group == place or group.startswith(f"{place}.") for place in ALIKE):
            continue
        parts.append(f"## `[{group}]` {{#table.{_anchor(group)}}}\n")
        parts.append(_by_type(group, members) if group in CLASSES else _table(members))
    return "\n".join(parts)


def _sentence(text: str) -> str:
    return f"{_marked(text[:1].upper() + text[1:])}." if text else ""


def _by_type(place: str, members: list[Described]) -> str:
    """The types that may stand in a place, each with its own keys; first what all of them have."""
    parts = [_table(row for row in members if row.key in (f"{place}.type", f"{place}.<gain>"))]
    classes = CLASSES[place]
    if place == "controller.inner":
        classes = {name: cls for name, cls in classes.items() if name not in CLASSES["controller"]}
        parts.append("The types of `[controller]` with their keys, and:\n")
    for name, cls in classes.items():
        rows = [row for row in of_type(place, name) if row.key.rpartition(".")[0] == place]
        about = f"In Python `agvjax.{cls.__name__}`." if cls else "Nothing of the kind."
        parts.append(f"### `{name}` {{#{place}.{name}}}\n\n{about}\n\n{_table(rows, f'{name}.') if rows else ''}")
    for alike, same in ALIKE.items():
        if same == place:
            parts.append(f"The same types may stand in `[{alike}]`.\n")
    return "\n".join(parts)


def _table(rows: Iterable[Described], kind: str = "") -> str:
    """Keys with what is said of each, as a table of HTML: texts hold bars and angle brackets."""
    lines = []
    for row in rows:
        place, _, name = row.key.rpartition(".")
        rule = row.rule if row.rule.startswith(row.kind) else "; ".join(filter(None, [row.kind, row.rule]))
        default = html.escape(row.default)
        if default and row.default != LEFT_OPEN:
            default = f"<code class='{'short' if len(row.default) < 25 else 'long'}'>{default}</code>"
        cells = [default, _marked(row.unit), _marked(rule)]
        head = f'<th scope="row" id="{_anchor(f"{place}.{kind}{name}" if kind else row.key)}">'
        lines.append(
            f"<tr>{head}<code>{html.escape(name)}</code></th>"
            + "".join(f"<td>{cell}</td>" for cell in [*cells, _marked(row.text)])
            + "</tr>"
        )
    titles = "".join(f'<th scope="col">{title}</th>' for title in ("Key", "Default", "Unit", "Value", "Meaning"))
    return f'<table class="keys"><thead><tr>{titles}</tr></thead><tbody>\n' + "\n".join(lines) + "\n</tbody></table>\n"


def _marked(text: str) -> str:
    """Text of a docstring as HTML: what stands between backticks is code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", html.escape(text))


def _anchor(key: str) -> str:
    return re.sub(r"[<>]", "", key)


def _list_of_keys(texts: dict[str, str]) -> str:
    """Every key in one list, each with a link to where it is described."""
    homes = {match: top for top, text in texts.items() for match in re.findall(r'id="([^"]+)"', text)}
    lines = []
    for key in sorted(every_key(), key=str.lower):
        home = next((anchor for anchor in _homes(key) if anchor in homes), "")
        row = described(key)
        said = row.text if len(row.text) < 100 else ""
        name = f"<code>{html.escape(key)}</code>"
        link = f'<a href="{homes[home]}.html#{home}">{name}</a>' if home else name
        lines.append(f"<li>{link} {_marked(said)}</li>")
    text = (
        "Every key with dots, as `--set` takes it. `<metric>`, `<leaf>`, `<actuator>` and the like stand for any name "
        "of that kind: `tune.limits.<metric>.worst` is `tune.limits.effort.worst` too. In a file a key is a line in "
        "the table of what stands before its last dot:"
    )
    example = "```toml\n[tune.limits.effort]\nworst = 1.0\n```"
    listed = '<ul class="keys">\n' + "\n".join(lines) + "\n</ul>"
    return f"# Every key\n\n{text}\n\n{example}\n\n{listed}\n"


def _homes(key: str) -> Iterator[str]:
    """Where a key may be described: under its own name, that of the same type elsewhere, or of its first type."""
    for alike, same in ALIKE.items():
        key = same + key[len(alike) :] if key.startswith(f"{alike}.") else key
    for name in (key, INNER.sub("controller", key)):
        yield _anchor(name)
        place, _, last = name.rpartition(".")
        for kind in CLASSES.get(place, ()):
            yield f"{place}.{kind}.{last}"


# metrics

KINDS = {
    "Of every run": lambda row: not (row.delivered or row.route or row.loop),
    "Of the actuator outputs": lambda row: row.delivered,
    "Of a route": lambda row: row.route,
    "Of the linearised loop": lambda row: row.loop,
}


def _metrics() -> str:
    parts = [
        "# Metrics",
        "",
        "Each can stand in `[tune.goals]`, `[tune.limits]`, `[sweep.fails]` and `sweep.metrics`, and in Python as "
        "`metrics[name]`. Where large is good the worst is the smallest.",
        "",
    ]
    for title, belongs in KINDS.items():
        parts += [f"## {title}", "", "| metric | unit | meaning | worst |", "|---|---|---|---|"]
        parts += [_metric(row) for row in METRICS.values() if belongs(row)] + [""]
    return "\n".join(parts)


def _metric(row: Metric) -> str:
    text = row.text.replace("|", "\\|")
    unit = "no unit" if row.unit == "1" else row.unit
    return f"| `{row.name}` | {unit} | {text} | {'smallest' if row.large else 'largest'} |"


# commands


def _commands() -> str:
    parts = ["# Commands", "", *_exit_codes(), "## Options that commands share", "", _options(COMMON), ""]
    for name, command in COMMANDS.items():
        help = f"{command.help[0].upper()}{command.help[1:]}."
        parts += [f"## agvjax {name}", "", help, "", f"```sh\nagvjax {name} {command.example}\n```", ""]
        parts += [_options(command.options), ""] if command.options else []
        shared = command.common
        named = ", ".join(f"`{option.names[0]}`" for option in shared)
        parts += [f"Of the shared options it has {named or 'none'}.", ""] if shared != COMMON else []
    return "\n".join(parts)


def _exit_codes() -> list[str]:
    return ["| exit code | meaning |", "|---|---|", *(f"| {code} | {text} |" for code, text in EXIT_CODES.items()), ""]


def _options(options: Iterable[Option]) -> str:
    rows = ["| option | meaning |", "|---|---|"]
    for names, keywords in options:
        value = keywords.get("metavar") or "|".join(map(str, keywords.get("choices", ())))
        value = "" if keywords.get("action") == "store_true" or not names[0].startswith("-") else value
        text = keywords.get("help") or f"one of {', '.join(map(str, keywords.get('choices', ())))}"
        text += " (required)" if keywords.get("required") else ""
        rows.append(f"| `{' '.join(filter(None, [*names, value]))}` | {text} |".replace("|LAW", "\\|LAW"))
    return "\n".join(rows)


# names of Python


def _python(root: Path) -> dict[str, str]:
    """The public names of both packages with their docstrings; those of the simulator a page for each group."""
    homes = _imported(root / "agvjax/__init__.py")
    groups = _groups(root / "agvjax/__init__.py")
    made, rows = {}, []
    for title, names in groups.items():
        place = f"{re.sub(r'[^a-z]+', '-', title.lower())}.md"
        listed = ", ".join(f"`{name}`" for name in names)
        rows.append(f"* [{title}]({place}): {listed}")
        directives = "\n".join(_directive(homes[name], f"agvjax.{name}") for name in names)
        made[f"reference/agvjax/{place}"] = f"# {title}\n\n{directives}"
    notation = (ast.get_docstring(ast.parse((root / "agvjax/__init__.py").read_text())) or "").partition("\n\n")
    index = f"# agvjax\n\n{notation[0]}\n\n" + "\n".join(rows) + f"\n\n## Symbols\n\n{notation[2]}\n"
    directives = "\n".join(
        _directive(f"tuning.{home}.{name}", f"tuning.{name}") for home, names in tuning._NAMES.items() for name in names
    )
    return {"reference/agvjax/index.md": index, **made, "reference/tuning.md": f"# tuning\n\n{directives}"}


def _directive(path: str, shown: str) -> str:
    """What mkdocstrings puts an object's documentation in place of; a module with its members, by full name."""
    return f"::: {path}\n    options:\n      heading: {shown}\n      toc_label: {shown.partition('.')[2]}\n"


def _imported(file: Path) -> dict[str, str]:
    """Where each name that a package imports is defined."""
    package, homes = file.parent.name, {}
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                homes[alias.asname or alias.name] = ".".join(filter(None, [package, node.module, alias.name]))
    return homes


def _groups(file: Path) -> dict[str, list[str]]:
    """The public names by the comments that group them."""
    groups: dict[str, list[str]] = {}
    title = ""
    for line in file.read_text(encoding="utf-8").splitlines():
        if line.startswith("# "):
            title = line[2].upper() + line[3:]
        elif line.startswith("__all__"):
            groups.setdefault(title, []).extend(ast.literal_eval(line.partition("= ")[2]))
    return groups
