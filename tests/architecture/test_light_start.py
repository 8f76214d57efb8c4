"""Help and mistakes must answer at once: they never import numba, nor anything else that takes long."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from source_tree import ROOT

HEAVY = ("numba", "llvmlite", "matplotlib", "satkit", "textual", "scipy")

# Runs each command line in one interpreter and reports, for each, its exit status and the heavy modules there now.
_PROBE = """
import contextlib, importlib, io, json, sys
module, cases, heavy = json.loads(sys.argv[1])
main = importlib.import_module(module).main
report = []
for words in cases:
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            status = main(words)
        except SystemExit as end:
            status = end.code
    report.append([status, said.getvalue(), [name for name in heavy if name in sys.modules]])
print(json.dumps(report))
"""

HELP = [["--help"]]
FLIGHT = [["run", "--help"], ["replay", "--help"]]
GROUND = [["table", "--help"], ["icd", "--help"], ["console", "--help"], ["report", "--help"]]
WORLD = [["list"], ["run", "--help"], ["show", "nominal"]]
WRONG = {
    "flightsw": [[], ["fly"], ["run"], ["replay"], ["run", "--ticks", "many"]],
    "ground": [[], ["tabel"], ["table", "biuld"], ["console", "--udp", "nowhere"], ["icd"]],
    "hil_sim": [[], ["fly"], ["run"], ["run", "nomnal"], ["run", "nominal", "--set", "gnss.sigma_postion_m=1"]],
}


def start(tool: str, cases: list[list[str]]) -> list[tuple[int, str, list[str]]]:
    """(exit status, what was said, heavy modules loaded) of each command line, in an interpreter of its own."""
    done = subprocess.run(
        [sys.executable, "-c", _PROBE, json.dumps([f"{tool}.__main__", cases, HEAVY])],
        cwd=ROOT,
        env={**os.environ, "COLUMNS": "200"},
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    return [tuple(line) for line in json.loads(done.stdout)]


@pytest.mark.parametrize(("tool", "cases"), [("flightsw", FLIGHT), ("ground", GROUND), ("hil_sim", WORLD)])
def test_help_is_light(tool: str, cases: list[list[str]]) -> None:
    """GIVEN a command WHEN it is asked for help or lists THEN it answers with status 0 and loads nothing heavy."""
    cases = HELP + cases
    for words, (status, said, heavy) in zip(cases, start(tool, cases), strict=True):
        assert status in (0, None), (words, said)
        assert len(said.splitlines()) > 2
        assert heavy == [], words


@pytest.mark.parametrize("tool", WRONG)
def test_mistakes_are_light(tool: str) -> None:
    """GIVEN a command WHEN its arguments are wrong THEN it refuses with status 2, says why, loads nothing heavy."""
    for words, (status, said, heavy) in zip(WRONG[tool], start(tool, WRONG[tool]), strict=True):
        assert status == 2, (words, said)
        assert said.strip()
        assert heavy == [], words


def test_a_heavy_start_is_seen() -> None:
    """GIVEN a flight whose tables are missing, which imports flight WHEN it is asked to run THEN numba is seen."""
    ((status, _, heavy),) = start("flightsw", [["run", "--can", "virtual:x", "--tables", "missing"]])
    assert status == 2
    assert "numba" in heavy
