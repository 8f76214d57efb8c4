"""`pip install leonav` without extras is what flies: every part of flight starts, the rest says what it lacks."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from flightsw.onboard import Refused, open_port

ROOT = Path(__file__).resolve().parents[2]

# Refuses to import the given top-level modules, as if they were not installed; then runs a command line.
_BLOCKED = """
import importlib, json, sys
blocked, module, words = json.loads(sys.argv[1])

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in blocked:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Blocker())
if words is None:
    for name in module:
        importlib.import_module(name)
else:
    sys.exit(importlib.import_module(module).main(words))
"""


def _name(requirement: str) -> str:
    return re.split(r"[^A-Za-z0-9._-]", requirement, maxsplit=1)[0].lower().replace("_", "-").replace(".", "-")


def _closure(names: list[str]) -> set[str]:
    """Installed distributions that these need, themselves included; extras of theirs are not."""
    seen: set[str] = set()
    waiting = [_name(name) for name in names]
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        try:
            needs = metadata.requires(name) or []
        except metadata.PackageNotFoundError:  # for another platform
            continue
        seen.add(name)
        waiting += [_name(need) for need in needs if "extra ==" not in need]
    return seen


def modules_of_extras() -> list[str]:
    """Top-level modules that are there only because of an extra, by pyproject.toml and the installed metadata."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = [requirement for listed in project["optional-dependencies"].values() for requirement in listed]
    only_extras = _closure(extras) - _closure(project["dependencies"])
    return sorted(
        module
        for module, owners in metadata.packages_distributions().items()
        if {_name(owner) for owner in owners} <= only_extras
    )


def _run(module: str | list[str], words: list[str] | None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", _BLOCKED, json.dumps([modules_of_extras(), module, words])],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
    )


def test_what_is_blocked_is_what_the_extras_bring() -> None:
    """GIVEN the extras WHEN their modules are listed THEN the known ones are there and none of the base install."""
    blocked = modules_of_extras()
    assert {"satkit", "erfa", "msgspec", "cantools", "matplotlib", "textual", "rich", "pytest"} <= set(blocked)
    assert not {"numpy", "numba", "llvmlite", "can", "pymavlink"} & set(blocked)


# the client of the demo's bus hub is imported when a bus `remote:` is asked for, and named where it lacks its library
_ON_DEMAND = {"flightsw.remote_bus"}


def test_flight_needs_no_extra() -> None:
    """GIVEN the base install WHEN every module of flight is imported THEN none is missing anything."""
    modules = [
        path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".").removesuffix(".__init__")
        for path in sorted((ROOT / "flightsw").rglob("*.py"))
    ]
    assert set(modules) > _ON_DEMAND
    modules = [name for name in modules if name not in _ON_DEMAND]
    outcome = _run(modules, None)
    assert outcome.returncode == 0, outcome.stderr


@pytest.mark.parametrize("tool", ["flightsw", "ground", "hil_sim"])
def test_help_needs_no_extra(tool: str) -> None:
    """GIVEN the base install WHEN a command is asked for help THEN it answers."""
    outcome = _run(f"{tool}.__main__", ["--help"])
    assert (outcome.returncode, outcome.stdout.split()[:2]) == (0, ["usage:", tool]), outcome.stderr


@pytest.mark.parametrize(
    ("tool", "words", "remedy"),
    [
        ("hil_sim", ["run", "nominal"], "pip install 'leonav[sim"),
        ("hil_sim", ["list"], "pip install 'leonav[sim"),
        ("ground", ["console", "--plain", "--udp", "127.0.0.1:0"], "pip install 'leonav[ground"),
        ("ground", ["icd", "generate"], "pip install 'leonav[ground"),
    ],
)
def test_a_missing_extra_is_named(tool: str, words: list[str], remedy: str) -> None:
    """GIVEN the base install WHEN a command needs an extra THEN it says the remedy in one line, no traceback."""
    outcome = _run(f"{tool}.__main__", words)
    assert outcome.returncode == 2, outcome.stderr
    assert remedy in outcome.stderr
    assert len(outcome.stderr.strip().splitlines()) == 1


def test_a_bus_hub_without_its_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN no python-can-remote WHEN flight is asked for the bus of a hub THEN the refusal names the remedy."""
    monkeypatch.delitem(sys.modules, "flightsw.remote_bus", raising=False)
    for name in ("can_remote", "can_remote.client"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(Refused, match=r"pip install 'leonav\[sim\]'"):
        open_port("remote:127.0.0.1:1")
