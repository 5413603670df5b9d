"""Files of the repository outside docs/ that come along into the site, because a page links to them."""

import json
import posixpath
import re
from collections.abc import Callable
from pathlib import Path

FIRST = ("README.md", "EQUATIONS.md", "CONTRIBUTING.md", "CHANGELOG.md", "notebooks", "benchmarks/results")
PICTURES = (".png", ".gif", ".svg")
SHOWN = (".md", ".ipynb", ".toml", ".py")  # of a folder
# code, which stays as it is, or the target of a link that is no address
LINK = re.compile(r"(```.*?^```|`[^`\n]+`)|\]\(([^)\s#:]+)(#[^)\s]*)?\)", re.M | re.S)


def with_links(markdown: str, turned: Callable[[str], str]) -> str:
    """The text with every link to a file `turned`; not those in code."""

    def one(match: re.Match[str]) -> str:
        return match[1] or f"]({turned(match[2])}{match[3] or ''})"

    return LINK.sub(one, markdown)


def is_folder(root: Path, path: str) -> bool:
    """Whether a path of the repository is a folder."""
    return bool(path) and (root / path).is_dir()


def place(root: Path, path: str) -> str:
    """Where in the site a file of the repository is: what is no page or picture becomes a page that shows it."""
    if path.startswith("docs/"):
        return path.removeprefix("docs/")
    if is_folder(root, path):
        return f"project/{path}/index.md"
    if path.endswith((".md", *PICTURES)):
        return f"project/{path}"
    return f"project/{path.removesuffix('.ipynb')}.md"


def along(root: Path) -> dict[str, str]:
    """The files that come along, by their place in the site: the first, and all that is linked from them or docs/.

    Raises:
        FileNotFoundError: a page links to a file that is not there.
    """
    found: dict[str, str] = {}
    seen: set[str] = set()
    queue = [*FIRST, *(f"docs/{page.name}" for page in sorted((root / "docs").glob("*.md")))]
    while queue:
        path = queue.pop(0)
        if path in seen:
            continue
        seen.add(path)
        if not path.startswith("docs/"):
            if not (root / path).exists():
                raise FileNotFoundError(f"a page of the documentation links to {path}, which is not there")
            found[place(root, path)] = path
        if not path.endswith(PICTURES) and (root / path).exists():
            home = path if is_folder(root, path) else posixpath.dirname(path)
            targets: list[str] = []
            with_links(page(root, path), lambda target, to=targets: to.append(target) or target)
            queue += [posixpath.normpath(posixpath.join(home, target)) for target in targets]
    return found


def page(root: Path, path: str) -> str:
    """A file or a folder of the repository as Markdown."""
    file = root / path
    if file.is_dir():
        return _folder(file)
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".md":
        return text
    if file.suffix == ".ipynb":
        return _notebook(text, path)
    kind = {".py": "python", ".toml": "toml", ".cff": "yaml"}.get(file.suffix, "text")
    return f"# `{path}`\n\n````{kind}\n{text}````\n"


def _folder(folder: Path) -> str:
    """A list of what is in a folder."""
    titles = {file.name: _title(file) for file in sorted(folder.iterdir()) if file.suffix in SHOWN}
    rows = [f"* [{title}]({name})" for name, title in titles.items() if name != "__init__.py"]
    return "\n".join([f"# {folder.name.capitalize()}", "", *rows, ""])


def _title(file: Path) -> str:
    """The first heading of a page or a notebook; the name of anything else."""
    text = page(file.parent, file.name) if file.suffix in (".md", ".ipynb") else ""
    heading = re.search(r"^# (.+)$", text, re.M)
    return heading[1] if heading else f"`{file.name}`"


def _notebook(text: str, path: str) -> str:
    """The text and the code of a notebook, which is kept without outputs."""
    parts = []
    for cell in json.loads(text)["cells"]:
        body = "".join(cell["source"])
        parts.append(body if cell["cell_type"] == "markdown" else f"```python\n{body}\n```")
    parts.insert(1, f"*Shown without its outputs; run `{path}` in Jupyter to see them:* `pip install '.[notebooks]'`.")
    return "\n\n".join(parts) + "\n"
