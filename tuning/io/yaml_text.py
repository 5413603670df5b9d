"""YAML as text: where every value stands, and who else it is a value of, so that one can be replaced and no other."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from typing import NamedTuple

import yaml
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from .numbers import REAL
from .plain import DEEPEST

MOST = 100_000  # values, aliases followed: a few lines of aliases of aliases can mean millions
MERGE, TAGS = "tag:yaml.org,2002:merge", "tag:yaml.org,2002:"
BLOCKS = ("|", ">")  # styles of a scalar that ends where the next line begins

Path = tuple[str, ...]  # keys, from the outermost to the innermost; items of a list by their number


class Leaf(NamedTuple):
    """A value that is no table, and where it stands.

    An alias stands for what its anchor has: `node` is that, `start` and `end` are of the alias.
    """

    path: Path
    node: Node
    start: int  # of what one replaces to change the value, in characters from the text's beginning
    end: int
    line: int  # counted from 1
    alias: bool
    key: ScalarNode | None  # None in a list
    table: MappingNode | None  # the one it is a value of, which has it itself or merged it (`<<`)
    own: bool  # whether that table has it itself


class Document(NamedTuple):
    """A text with all its values in their order, and the paths by which one comes to each of its tables."""

    text: str
    leaves: list[Leaf]
    tables: dict[int, list[Path]]  # by the node's id

    def others(self, leaf: Leaf) -> list[Leaf]:
        """The other values that change where this one is replaced."""
        same = [other for other in self.leaves if other.start == leaf.start or (other.node is leaf.node)]
        return [other for other in same if other is not leaf and (not leaf.alias or other.start == leaf.start)]


class _Composer(yaml.SafeLoader):
    """Keeps where aliases stand: a composed tree has their anchors' nodes only."""

    def __init__(self, text: str):
        super().__init__(text)
        self.aliases: dict[tuple[int, int], tuple[int, int, int]] = {}  # of table and key: start, end, line

    def compose_node(self, parent: Node | None, index: object) -> Node | None:
        if parent is not None and self.check_event(yaml.AliasEvent):
            event = self.peek_event()
            place = event.start_mark.index, event.end_mark.index, event.start_mark.line + 1
            self.aliases[id(parent), index if isinstance(index, int) else id(index)] = place
        return super().compose_node(parent, index)  # type: ignore[arg-type]  # a key or a number, or None of a root


def parse(text: str) -> Document:
    """All values of a text of one document.

    Raises:
        ValueError: it is no YAML, several documents, or nested or repeated without measure.
    """
    try:
        composer = _Composer(text)
        root = composer.get_single_node()
        document = Document(text, [], defaultdict(list))
        for leaf in _walk(document, composer, root, ()) if root is not None else ():
            document.leaves.append(leaf)
            if len(document.leaves) > MOST:
                raise ValueError(f"its aliases stand for more than {MOST} values")
    except yaml.YAMLError as error:
        raise ValueError(" ".join(str(error).split())) from error
    except RecursionError as error:
        raise ValueError(_DEEP) from error
    return document


_DEEP = f"tables or lists are nested more than {DEEPEST} times"


def _walk(document: Document, composer: _Composer, node: Node, path: Path) -> Iterator[Leaf]:
    """The values within a table or list."""
    if len(path) > DEEPEST:
        raise ValueError(_DEEP)
    if isinstance(node, SequenceNode):
        for index, item in enumerate(node.value):
            yield from _value(document, composer, item, (*path, str(index)), (node, index), None, None)
    if isinstance(node, MappingNode):
        for key, item, home in _entries(document, node, path, 0):
            yield from _value(document, composer, item, (*path, _name(key)), (home, id(key)), key, node)


def _value(
    document: Document,
    composer: _Composer,
    node: Node,
    path: Path,
    place: tuple[Node, int],
    key: Node | None,
    table: MappingNode | None,
) -> Iterator[Leaf]:
    """The value at a place, a node and what it is there, or those within it."""
    if not isinstance(node, ScalarNode):
        yield from _walk(document, composer, node, path)
        return
    home, index = place
    alias = composer.aliases.get((id(home), index))
    start, end = node.start_mark.index, node.end_mark.index
    start, end, line = alias or (_bare(document.text, start, end), end, node.start_mark.line + 1)
    named = key if isinstance(key, ScalarNode) else None
    yield Leaf(path, node, start, end, line, alias is not None, named, table, home is table)


def _entries(document: Document, table: MappingNode, path: Path, depth: int) -> Iterator[tuple[Node, Node, Node]]:
    """Keys, values, and the table that has them itself: first its own, then what it merges and has not."""
    document.tables[id(table)].append(path)
    if depth > DEEPEST or len(document.tables[id(table)]) > MOST:
        raise ValueError(_DEEP)
    own = [(key, value) for key, value in table.value if key.tag != MERGE]
    seen = {_name(key) for key, _ in own}
    yield from ((key, value, table) for key, value in own)
    for _, merged in (pair for pair in table.value if pair[0].tag == MERGE):
        for source in merged.value if isinstance(merged, SequenceNode) else [merged]:
            if not isinstance(source, MappingNode):
                raise ValueError(f"line {source.start_mark.line + 1}: only tables can be merged by <<")
            found = [entry for entry in _entries(document, source, path, depth + 1) if _name(entry[0]) not in seen]
            seen |= {_name(key) for key, _, _ in found}
            yield from found


def _name(key: Node) -> str:
    """A key as text; one that is a list or a table has none of its own."""
    return key.value if isinstance(key, ScalarNode) else "?"


def _bare(text: str, start: int, end: int) -> int:
    """Where a value begins behind its anchor and tag."""
    while text[start:end].startswith(("&", "!")):
        words = text[start:end].split(maxsplit=1)
        if len(words) < 2:
            return end
        start = end - len(words[1])
    return start


def plain(node: Node) -> float | int | bool | str | None:
    """What a scalar means; a number that is spelled as no program of ROS reads it is text, a list too.

    A power of ten without a point, `1e-3`, is text to PyYAML and a number to ROS: a number here.
    """
    text = str(node.value)
    kind = node.tag.removeprefix(TAGS) if isinstance(node, ScalarNode) else ""
    if kind == "bool":
        return text.lower() in yaml.SafeLoader.bool_values and yaml.SafeLoader.bool_values[text.lower()]
    if kind == "int":
        return int(text) if text.lstrip("+-").isdecimal() else text
    if kind == "float" and text.lstrip("+-").lower() in (".nan", ".inf"):
        return float(text.replace(".", "", 1))
    number = kind == "float" or (isinstance(node, ScalarNode) and node.style is None and kind == "str")
    return float(text) if number and REAL.fullmatch(text) else None if kind == "null" else text
