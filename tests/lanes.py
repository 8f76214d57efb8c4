"""The second and third lane of `make test`: the same tests of the kernels, run on other code.

    --lane=bounds     kernels compiled with bounds checks (NUMBA_BOUNDSCHECK=1)
    --lane=coverage   kernels as plain Python (NUMBA_DISABLE_JIT=1), so that coverage sees their lines

A lane takes every test file that imports a compiled room, without its slow tests. No list is kept: a new file of
kernel tests is in both lanes by what it imports. Load with `-p tests.lanes`.

Plain Python is a thousand times slower than machine code. In the coverage lane a test is therefore broken off after
PATIENCE calls of compiled entries and counted as skipped: the lines it has reached are covered, its verdict is for
the other lanes to give.
"""

from __future__ import annotations

import ast
import os
from collections.abc import Callable, Iterator
from functools import wraps
from pathlib import Path
from typing import Any

import pytest

ROOMS = (
    "flightsw.kernels",
    "flightsw.nav",
    "flightsw.integrity",
    "flightsw.modes",
    "flightsw.crosslink",
    "flightsw.gnss",
    "flightsw.derivative",
)
FLAGS = {"bounds": "NUMBA_BOUNDSCHECK", "coverage": "NUMBA_DISABLE_JIT"}
FOLDERS = ("unit", "property")
PATIENCE = 100
_calls_left: list[int] = []  # of the test that runs; empty between tests, and in lanes that have all the time


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds --lane."""
    parser.addoption("--lane", choices=sorted(FLAGS), required=True, help="which lane of make test to run")


def pytest_configure(config: pytest.Config) -> None:
    """Refuses a lane without its flag: it would silently test the ordinary code."""
    lane = config.getoption("--lane")
    if os.environ.get(FLAGS[lane]) != "1":
        raise pytest.UsageError(f"--lane={lane} needs {FLAGS[lane]}=1 in the environment; use make test-{lane}")
    if lane == "coverage":
        give_records_attributes()


def imports_of(source: str) -> set[str]:
    """Full names of the modules a source text imports, `from a import b` as both `a` and `a.b`."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return names


def concerns_kernels(source: str) -> bool:
    """Whether a test file imports a compiled room."""
    return any(name == room or name.startswith(room + ".") for name in imports_of(source) for room in ROOMS)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files that a lane has nothing to do with, without importing them."""
    if collection_path.suffix != ".py" or collection_path.name == "conftest.py":
        return None
    inside = collection_path.relative_to(config.rootpath / "tests").parts[0] in FOLDERS
    return None if inside and concerns_kernels(collection_path.read_text(encoding="utf-8")) else True


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out slow tests, and in plain Python those that need machine code."""
    unwanted = ["slow"] + (["compiled"] if config.getoption("--lane") == "coverage" else [])
    dropped = [item for item in items if any(item.get_closest_marker(name) for name in unwanted)]
    if dropped:
        config.hook.pytest_deselected(items=dropped)
        items[:] = [item for item in items if item not in dropped]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Give each test of the coverage lane its number of calls."""
    if item.config.getoption("--lane") == "coverage":
        _calls_left[:] = [PATIENCE]
    try:
        return (yield)
    finally:
        _calls_left.clear()


def _spend_a_call() -> None:
    if _calls_left:
        _calls_left[0] -= 1
        if _calls_left[0] < 0:
            pytest.skip(f"broken off after {PATIENCE} calls: enough for coverage, too slow as plain Python")


def give_records_attributes() -> None:
    """Let kernels read `record.field` as plain Python too, where numpy offers that on record arrays only.

    Must run before the first compiled module is imported: entries are wrapped as they are declared.
    """
    import numpy as np

    from flightsw.kernels import registry

    declare_entry = registry.entry

    def entry(*argument_types: Any) -> Callable[[Callable[..., Any]], Any]:
        declare = declare_entry(*argument_types)

        def declare_wrapped(function: Callable[..., Any]) -> Any:
            plain = declare(function)

            @wraps(function)
            def call(*arguments: Any) -> Any:
                _spend_a_call()
                return plain(
                    *(a.view(np.recarray) if isinstance(a, np.ndarray) and a.dtype.names else a for a in arguments)
                )

            return call

        return declare_wrapped

    registry.entry = entry
