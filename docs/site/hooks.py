"""What mkdocs calls while it builds the site: pages are generated, files outside docs/ come along, equations are set.

Pages under docs/ are written for GitHub too: their links are those of the repository. What such a page links to becomes
a page of the site, and the link is turned to it.
"""

import posixpath
import re
from pathlib import Path
from typing import Any

import outside
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files, InclusionLevel
from mkdocs.structure.pages import Page

import reference

ROOT = Path(__file__).parents[2]
EQUATION = re.compile(r"^```math\n(.*?)^```$", re.M | re.S)
GENERATED: dict[str, str] = {}  # pages of the reference, by their place in the site
ALONG: dict[str, str] = {}  # files of the repository, by their place in the site


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Generate the reference, find what comes along, and give both their places in the navigation."""
    GENERATED.clear()
    GENERATED.update(reference.pages(ROOT))
    ALONG.clear()
    ALONG.update(outside.along(ROOT))
    config.nav = _listed(config.nav)
    return config


def _listed(entries: Any) -> Any:
    """The navigation with the pages of a folder in the place of `FOLDER/*`: its first page, then the others."""
    if isinstance(entries, dict):
        return {title: _listed(below) for title, below in entries.items()}
    if isinstance(entries, list):
        parts = [_listed(entry) for entry in entries]
        return [page for part in parts for page in (part if isinstance(part, list) else [part])]
    if not entries.endswith("/*"):
        return entries
    found = [uri for uri in [*GENERATED, *sorted(ALONG)] if uri.startswith(entries[:-1]) and uri.endswith(".md")]
    return sorted(found, key=lambda uri: uri != f"{entries[:-1]}index.md")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what is generated and what comes along."""
    for uri, text in GENERATED.items():
        files.append(File.generated(config, uri, content=text))
    for uri, path in ALONG.items():
        made: Any = {"content": outside.page(ROOT, path)} if uri.endswith(".md") else {"abs_src_path": str(ROOT / path)}
        files.append(File.generated(config, uri, inclusion=InclusionLevel.NOT_IN_NAV, **made))  # or where the nav says
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn links of the repository to pages of the site, and set equations, which need no script so."""
    uri = page.file.src_uri
    if uri not in GENERATED:
        home, here = posixpath.dirname(ALONG.get(uri, f"docs/{uri}")), posixpath.dirname(uri)
        if outside.is_folder(ROOT, ALONG.get(uri, "")):
            home = ALONG[uri]

        def turned(target: str) -> str:
            path = posixpath.normpath(posixpath.join(home, target))
            return posixpath.relpath(outside.place(ROOT, path), here or ".")

        markdown = outside.with_links(markdown, turned)
    return EQUATION.sub(lambda match: f'<div class="equation">{convert(match[1], display="block")}</div>\n', markdown)


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let the keyboard reach code, whose long lines are scrolled."""
    return re.sub(r"<pre>(?=(?:<span></span>)?<code>)", '<pre tabindex="0">', html)


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Name the search, which the theme leaves without a name."""
    search = 'data-md-component="search" role="dialog"'
    return output.replace(search, f'{search} aria-label="Search"')
