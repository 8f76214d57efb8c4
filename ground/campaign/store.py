"""A campaign on disk: its definition as JSON, its finished chunks, and in the end all runs in one file.

    campaign.json             what is flown: ensemble, seeds, set, table, code; a folder serves one campaign only
    chunks/000120-000139.npz  finished runs, stacked; appears whole or not at all
    outages.npz               all runs in order; the same bytes whoever flew them, in whatever chunks

NPZ is open (zip of NPY, numpy.lib.format); every array has the run as its first axis.
"""

from __future__ import annotations

import json
import os
import re
import zipfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ground.campaign.outage import Arrays, Flight
from ground.errors import OperatorError

DEFINITION = "campaign.json"
CHUNKS = "chunks"
OUTAGES = "outages.npz"
_NAME = re.compile(r"^(\d{6,})-(\d{6,})\.npz$")


def definition(flight: Flight, code: str) -> dict[str, Any]:
    """What makes the figures of a run, beside its number. code: hash of all that flies, simulates and measures."""
    return {
        "format": "leonav campaign 1",
        "ensemble": flight.ensemble.document(),
        "ensemble_sha256": flight.ensemble.hash,
        "seeds": flight.seeds.document(),
        "table_set": flight.table_set,
        "overrides": dict(flight.overrides),
        "table_crc32": f"{int.from_bytes(flight.image()[-4:], 'little'):08x}",
        "code_sha256": code,
    }


def open_folder(folder: Path, what: dict[str, Any]) -> None:
    """Make the folder, or check that what it holds is this campaign. Raises OperatorError for another one."""
    path = folder / DEFINITION
    try:
        (folder / CHUNKS).mkdir(parents=True, exist_ok=True)
        if not path.exists():
            _write(path, (json.dumps(what, indent=2, sort_keys=True) + "\n").encode())
            return
        held = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise OperatorError(f"{folder}: cannot be written: {error.strerror}") from error
    except ValueError:
        raise OperatorError(f"{path}: not a definition of a campaign; name another folder") from None
    other = sorted(key for key in what if held.get(key) != what[key]) if isinstance(held, dict) else ["format"]
    if other:
        raise OperatorError(f"{folder}: holds another campaign ({', '.join(other)} differ); name another folder")


def missing(folder: Path, runs: int) -> list[int]:
    """Runs 0 to runs - 1 that no finished chunk holds."""
    held = {run for first, last, _ in _chunks(folder) for run in range(first, last + 1)}
    return [run for run in range(runs) if run not in held]


def chunked(runs: Sequence[int], size: int) -> list[tuple[int, int]]:
    """Consecutive runs as (first, last) of at most `size`."""
    found: list[tuple[int, int]] = []
    for run in runs:
        if found and run == found[-1][1] + 1 and run - found[-1][0] < size:
            found[-1] = (found[-1][0], run)
        else:
            found.append((run, run))
    return found


def stacked(flown: Iterable[Arrays]) -> Arrays:
    """Figures of several runs, each array with the run as its first axis. Metres to a part in ten million."""
    every = list(flown)
    return {name: np.stack([_small(one[name]) for one in every]) for name in sorted(every[0])}


def save_chunk(folder: Path, first: int, last: int, figures: Arrays) -> None:
    """Keep a finished chunk."""
    _save(folder / CHUNKS / f"{first:06d}-{last:06d}.npz", figures)


def collect(folder: Path, runs: int) -> Arrays:
    """Figures of runs 0 to runs - 1 in order. Raises OperatorError while some are missing."""
    lacking = missing(folder, runs)
    if lacking:
        raise OperatorError(f"{folder}: {len(lacking)} of {runs} runs are not flown yet; run the same command again")
    rows: dict[int, tuple[Arrays, int]] = {}
    for first, last, path in _chunks(folder):
        held = _read(path)
        rows |= {run: (held, run - first) for run in range(first, last + 1)}
    names = sorted(rows[0][0])
    return {name: np.stack([rows[run][0][name][rows[run][1]] for run in range(runs)]) for name in names}


def save_outages(folder: Path, figures: Arrays) -> Path:
    """All runs in one file."""
    return _save(folder / OUTAGES, figures)


def load_outages(path: Path) -> Arrays:
    """The file of all runs."""
    return _read(path)


def _chunks(folder: Path) -> list[tuple[int, int, Path]]:
    found = []
    for path in sorted((folder / CHUNKS).glob("*.npz")):
        name = _NAME.match(path.name)
        if name:
            found.append((int(name[1]), int(name[2]), path))
    return found


def _small(values: np.ndarray) -> np.ndarray:
    return values.astype(np.float32) if values.dtype == np.float64 and values.ndim > 0 else values


def _read(path: Path) -> Arrays:
    try:
        with path.open("rb") as stream, np.load(stream) as file:
            return {name: file[name] for name in file.files}
    except (OSError, zipfile.BadZipFile, ValueError, EOFError) as error:
        raise OperatorError(f"{path}: cannot be read ({error}); remove it and run the same command again") from error


def _save(path: Path, figures: Arrays) -> Path:
    partial = path.with_suffix(f".{os.getpid()}.partial")
    with partial.open("wb") as stream:
        np.savez_compressed(stream, **figures)  # type: ignore[arg-type]
        stream.flush()
        os.fsync(stream.fileno())
    os.replace(partial, path)
    return path


def _write(path: Path, content: bytes) -> None:
    partial = path.with_suffix(f".{os.getpid()}.partial")
    partial.write_bytes(content)
    os.replace(partial, path)
