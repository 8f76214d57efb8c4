"""XML as a tree whose elements know their line, which the standard library's ElementTree forgets."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.parsers import expat

from hil_sim.errors import DataError


class Node:
    """One element: tag without namespace, attributes, text (stripped), children, line where it begins."""

    __slots__ = ("attributes", "children", "line", "tag", "text")

    def __init__(self, tag: str, attributes: dict[str, str], line: int) -> None:
        self.tag = tag.rpartition(":")[2]
        self.attributes = attributes
        self.line = line
        self.text = ""
        self.children: list[Node] = []

    def every(self, tag: str) -> Iterator[Node]:
        """All elements of this name below, in order, at any depth."""
        for child in self.children:
            if child.tag == tag:
                yield child
            yield from child.every(tag)

    def first(self, tag: str) -> Node | None:
        """The first of `every`, None if there is none."""
        return next(self.every(tag), None)

    def content(self, tag: str) -> str | None:
        """Text of the first element of this name below, None if there is none."""
        node = self.first(tag)
        return None if node is None else node.text


def parse(path: Path, text: str, kind: str) -> Node:
    """The root element. `kind` names what was expected. Raises DataError with file and line."""
    top = Node("", {}, 0)
    open_nodes = [top]
    parser = expat.ParserCreate()
    parser.buffer_text = True

    def start(tag: str, attributes: dict[str, str]) -> None:
        node = Node(tag, attributes, parser.CurrentLineNumber)
        open_nodes[-1].children.append(node)
        open_nodes.append(node)

    def end(tag: str) -> None:
        del tag
        open_nodes.pop()

    def characters(data: str) -> None:
        open_nodes[-1].text = (open_nodes[-1].text + data).strip()

    def entity(*declaration: object) -> None:
        raise DataError(f"{path}: line {parser.CurrentLineNumber}: {declaration[0]!r}: entities are not read")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = characters
    parser.EntityDeclHandler = entity
    try:
        # the text is decoded already, whatever its declaration says
        parser.Parse(text.encode("utf-8"), True)
    except expat.ExpatError as error:
        raise DataError(f"{path}: line {error.lineno}: not a {kind}: {expat.ErrorString(error.code)}") from None
    return top.children[0]
