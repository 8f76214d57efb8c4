"""Flown cases on disk: what was flown is kept, and is not flown again while everything that decides it is the same.

A case is one .npz of figures of its parts and the key of what it was flown with. Arrays of arcs are stacked: the first
axis is the arc, in order of the plan.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
import platform
import zipfile
from collections.abc import Sequence
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path

import numpy as np

import flightsw
from flightsw.provenance import package_hash
from ground.accuracy.bench_cases import LONG_FLIGHT, Case
from ground.accuracy.bench_flight import Arrays
from ground.errors import OperatorError
from ground.tables.build import build_navigation

FOLDER = "flights"
_ROOT = Path(flightsw.__file__).resolve().parents[1]
# beside flight itself: everything that makes a part's figures, not what draws and prints them
_SOURCES = (
    "hil_sim/**/*.py",
    "hil_sim/scenarios/*.toml",
    "ground/campaign/*.py",
    "ground/tables/*.py",
    "ground/studies/flights.py",
    "ground/accuracy/bench_cases.py",
    "ground/accuracy/bench_flight.py",
)
_LIBRARIES = ("numpy", "numba", "llvmlite", "satkit", "satkit-data", "pyerfa", "astropy-iers-data")


@lru_cache(maxsize=1)
def code_hash() -> str:
    """SHA-256 over the code that flies, simulates and measures."""
    digest = hashlib.sha256(package_hash().encode())
    for pattern in _SOURCES:
        for path in sorted(_ROOT.glob(pattern)):
            digest.update(path.relative_to(_ROOT).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def key(case: Case, orbit_file: Path | None) -> str:
    """SHA-256 over all that decides the figures of a case: code, versions, tables, scenario, data, plan."""
    words = {
        "code": code_hash(),
        "versions": {name: importlib.metadata.version(name) for name in _LIBRARIES},
        "machine": [platform.python_version(), platform.machine()],
        "navigation": hashlib.sha256(build_navigation(case.table_set)).hexdigest(),
        "orbit": case.orbit._asdict() | {"start": case.orbit.start.isoformat()},
        "orbit_file": None if orbit_file is None else _file_hash(orbit_file),
        "gravity": None if case.gravity is None else _file_hash(case.gravity),
        "degree": case.degree,
        "plan": asdict(case.plan),
        "settings": [case.scenario_settings(part) for part in parts(case)],
    }
    return hashlib.sha256(json.dumps(words, sort_keys=True).encode()).hexdigest()


def parts(case: Case) -> list[int]:
    """The long flight and every arc."""
    return [LONG_FLIGHT, *range(len(case.plan.begins_s))]


def stacked(flown: Sequence[Arrays]) -> Arrays:
    """Figures of a case from those of its parts, in the order of `parts`; those of arcs are stacked."""
    long_flight, *arcs = flown
    return long_flight | {name: np.stack([one[name] for one in arcs]) for name in arcs[0]}


def path_of(folder: Path, case: Case) -> Path:
    """Where a case is kept."""
    return folder / FOLDER / f"{case.name}.npz"


def save(folder: Path, case: Case, its_key: str, figures: Arrays) -> None:
    """Keep a case; the file appears whole or not at all."""
    path = path_of(folder, case)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    with partial.open("wb") as stream:
        np.savez_compressed(stream, key=np.array(its_key), **{k: _small(v) for k, v in figures.items()})  # type: ignore[arg-type]
    os.replace(partial, path)


def load(folder: Path, case: Case, its_key: str) -> Arrays | None:
    """The kept figures of a case; None where there are none, or others were flown."""
    path = path_of(folder, case)
    try:
        with path.open("rb") as stream, np.load(stream) as file:
            if str(file["key"]) != its_key:
                return None
            return {name: file[name] for name in file.files if name != "key"}
    except (FileNotFoundError, zipfile.BadZipFile, KeyError, ValueError, EOFError):
        return None
    except OSError as error:
        raise OperatorError(f"{path}: cannot be read: {error.strerror}") from error


def _small(values: np.ndarray) -> np.ndarray:
    """Errors of metres to a part in ten million: half the size on disk."""
    return values.astype(np.float32) if values.dtype == np.float64 else values


@lru_cache(maxsize=32)
def _file_hash(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise OperatorError(f"{path}: cannot be read: {error.strerror}") from error
