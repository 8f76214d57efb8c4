"""What the rules look at: the sources as text and syntax trees, and who imports whom. No module is imported."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("flightsw", "ground", "hil_sim")

# Written by `ground icd generate`, never by hand: the rules for hand-written code do not apply.
GENERATED = {
    "flightsw/icd/mavlink.py": "written by pymavlink's generator from leonav.xml",
    "flightsw/icd/can_frames.py": "written from sensor_bus.dbc",
    "docs/icd.md": "written from both sources",
    "ground/tuning/lanes_step.py": "written by ground/tuning/lanes_source.py",
}


@dataclass(frozen=True)
class Source:
    """One Python file: its path from the root of the repository, and its text."""

    path: str
    text: str

    @cached_property
    def tree(self) -> ast.Module:
        """Its syntax tree."""
        return ast.parse(self.text, self.path)

    @property
    def module(self) -> str:
        """Its dotted name; that of the package for an __init__.py."""
        return self.path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")

    def imports(self) -> Iterator[tuple[int, str]]:
        """(line, module) of every import, wherever it stands; `from a import b` as `a.b`, relative ones resolved."""
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    yield node.lineno, alias.name
            elif isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    yield node.lineno, f"{self._origin(node)}.{alias.name}"

    def _origin(self, node: ast.ImportFrom) -> str:
        if not node.level:
            return node.module or ""
        package = self.module.split(".")
        if not self.path.endswith("__init__.py"):
            package = package[:-1]
        package = package[: len(package) - node.level + 1]
        return ".".join(package + ([node.module] if node.module else []))


@cache
def sources() -> tuple[Source, ...]:
    """Every Python file of the three packages."""
    return tuple(
        Source(path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8"))
        for package in PACKAGES
        for path in sorted((ROOT / package).rglob("*.py"))
    )


def is_within(name: str, module: str) -> bool:
    """Whether a dotted name is the module or lies in it."""
    return name == module or name.startswith(module + ".")


@cache
def graph(files: tuple[Source, ...]) -> dict[str, set[str]]:
    """Module -> modules among `files` that it imports when it is imported or later, itself excluded."""
    known = {source.module for source in files}
    edges: dict[str, set[str]] = {}
    for source in files:
        targets: set[str] = set()
        for _, name in source.imports():
            # `from package import module` names the module; `from module import thing` only the thing in it.
            target = name if name in known else name.rpartition(".")[0]
            if target in known and target != source.module:
                targets.add(target)
        edges[source.module] = targets
    return edges


def reachable(edges: Mapping[str, set[str]], start: str) -> set[str]:
    """Every module that importing `start` can bring in, itself included."""
    seen: set[str] = set()
    waiting = [start]
    while waiting:
        module = waiting.pop()
        if module not in seen:
            seen.add(module)
            waiting.extend(edges.get(module, ()))
    return seen


def find_cycle(edges: Mapping[str, set[str]]) -> list[str]:
    """A circle of imports as the modules along it, the first repeated at the end; empty when there is none."""
    done: set[str] = set()

    def visit(module: str, trail: list[str]) -> list[str]:
        if module in trail:
            return [*trail[trail.index(module) :], module]
        if module in done:
            return []
        for target in sorted(edges.get(module, ())):
            if found := visit(target, [*trail, module]):
                return found
        done.add(module)
        return []

    for module in sorted(edges):
        if found := visit(module, []):
            return found
    return []
