"""A stale kernel must never be served, and bounds checks must check: the folder's key sees to both (docs/adr/0001)."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
from source_tree import ROOT, graph, reachable, sources

# A kernel, and in another file an entry that calls it: the arrangement numba's own cache does not see through.
_CALLEE = """
from flightsw.kernels.registry import kernel

@kernel
def answer(values):
    return {answer}
"""
_CALLER = """
import numpy as np
from flightsw.kernels.registry import VECTOR, entry, warm_up
from flightsw.nav.probe_callee import answer

@entry(VECTOR)
def ask(values):
    return answer(values)

def run():
    warm_up()
    # The array is a part of a longer one, so that reading one past its end is harmless.
    print(ask(np.arange(16.0)[:8]))
"""
_RUN = "from flightsw.nav import probe_caller; probe_caller.run()"
_RUN_WITHOUT_KEY = f"""
from pathlib import Path
import os
from flightsw.kernels import kernel_cache
kernel_cache.cache_folder = lambda: Path(os.environ["LEONAV_CACHE_DIR"]) / "one"
{_RUN}
"""


@pytest.fixture
def copied_flight(tmp_path: Path) -> Path:
    """A folder with a copy of the flight package, free to be edited."""
    shutil.copytree(ROOT / "flightsw", tmp_path / "flightsw", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def _load_kernel_cache(folder: Path) -> ModuleType:
    path = folder / "flightsw" / "kernels" / "kernel_cache.py"
    spec = importlib.util.spec_from_file_location("copied_kernel_cache", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "edited", ["kernels/linalg.py", "nav/filter.py", "integrity/bound.py", "records.py", "modes.py", "icd/alerts.py"]
)
def test_an_edit_of_compiled_code_changes_the_folder(copied_flight: Path, edited: str) -> None:
    """GIVEN the folder of a copy WHEN one compiled file or file of constants is edited THEN the folder is another."""
    cache = _load_kernel_cache(copied_flight)
    before = cache.cache_folder()
    with (copied_flight / "flightsw" / edited).open("a") as file:
        file.write("\n# edited\n")
    assert cache.cache_folder() != before


def test_an_edit_of_plain_code_keeps_the_folder(copied_flight: Path) -> None:
    """GIVEN the folder of a copy WHEN a file that is never compiled is edited THEN nothing compiles anew."""
    cache = _load_kernel_cache(copied_flight)
    before = cache.cache_folder()
    with (copied_flight / "flightsw" / "journal.py").open("a") as file:
        file.write("\n# edited\n")
    assert cache.cache_folder() == before


@pytest.mark.parametrize("variable", ["NUMBA_BOUNDSCHECK", "NUMBA_CPU_NAME", "LEONAV_CACHE_DIR"])
def test_options_change_the_folder(monkeypatch: pytest.MonkeyPatch, variable: str) -> None:
    """GIVEN the folder WHEN an option of the compiler or the place is set THEN the folder is another."""
    from flightsw.kernels import kernel_cache

    monkeypatch.delenv(variable, raising=False)
    before = kernel_cache.cache_folder()
    monkeypatch.setenv(variable, "1")
    assert kernel_cache.cache_folder() != before


def test_the_key_covers_every_source_of_machine_code() -> None:
    """GIVEN what the navigation step imports, to the end WHEN compared with the key's files THEN none is left out."""
    from flightsw.kernels import kernel_cache

    keyed = {path.relative_to(ROOT).as_posix() for path in kernel_cache.compiled_sources()}
    paths = {source.module: source.path for source in sources()}
    reached = {paths[module] for module in reachable(graph(sources()), "flightsw.nav.step")}
    assert reached - keyed == set()


def _probe(folder: Path, script: str = _RUN, **options: str) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    environment |= {"PYTHONPATH": str(folder), "LEONAV_CACHE_DIR": str(folder / "cache"), **options}
    return subprocess.run(
        [sys.executable, "-c", script], cwd=folder, env=environment, capture_output=True, text=True, timeout=300
    )


def _write_probe(folder: Path, answer: str) -> None:
    nav = folder / "flightsw" / "nav"
    (nav / "probe_callee.py").write_text(_CALLEE.format(answer=answer))
    if not (nav / "probe_caller.py").exists():
        (nav / "probe_caller.py").write_text(_CALLER)


def _answer(outcome: subprocess.CompletedProcess[str]) -> float:
    assert outcome.returncode == 0, outcome.stderr
    return float(outcome.stdout)


@pytest.mark.parametrize(
    ("script", "served"), [(_RUN, 2.0), (_RUN_WITHOUT_KEY, 1.0)], ids=["as it flies", "without the key"]
)
def test_an_edited_callee_is_compiled_anew(copied_flight: Path, script: str, served: float) -> None:
    """GIVEN a warm cache WHEN the file of a callee is edited THEN the new kernel is served.

    The second case takes the key away and shows what it is there for: numba then serves the stale one.
    """
    _write_probe(copied_flight, "1.0 + 0.0 * values[0]")
    assert _answer(_probe(copied_flight, script)) == 1.0
    assert _answer(_probe(copied_flight, script)) == 1.0
    _write_probe(copied_flight, "2.0 + 0.0 * values[0]")
    assert _answer(_probe(copied_flight, script)) == served


def test_reading_out_of_range_raises_with_bounds_checks(copied_flight: Path) -> None:
    """GIVEN a cache warm with unchecked kernels WHEN bounds checks are asked for THEN reading past the end raises."""
    _write_probe(copied_flight, "values[values.size]")
    assert _probe(copied_flight).returncode == 0
    outcome = _probe(copied_flight, NUMBA_BOUNDSCHECK="1")
    assert outcome.returncode != 0
    assert "IndexError" in outcome.stderr


def test_a_second_copy_finds_its_kernels_compiled(copied_flight: Path) -> None:
    """GIVEN a warm cache WHEN the same sources lie somewhere else THEN they are served from it, nothing is added."""
    _write_probe(copied_flight, "1.0 + 0.0 * values[0]")
    other = copied_flight / "elsewhere"
    shutil.copytree(copied_flight / "flightsw", other / "flightsw", ignore=shutil.ignore_patterns("__pycache__"))
    cache = copied_flight / "cache"
    assert _answer(_probe(copied_flight)) == 1.0
    before = {path: path.stat().st_mtime_ns for path in cache.rglob("*.nb*")}
    assert before
    assert _answer(_probe(other, LEONAV_CACHE_DIR=str(cache))) == 1.0
    assert {path: path.stat().st_mtime_ns for path in cache.rglob("*.nb*")} == before
