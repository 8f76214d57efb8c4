"""A certification from the first draw to certificate.json: attempt, flight, summary, report."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import flightsw
from flightsw.icd.table_file import decode
from flightsw.provenance import package_hash
from ground.campaign import attempts, certificate, executor, flown, seeds, store
from ground.campaign.ensemble import Ensemble
from ground.campaign.outage import Arrays, Flight
from ground.errors import OperatorError
from ground.tables.build import build_navigation

CERTIFICATE = "certificate.json"
QUICK_RUNS = 48
_ROOT = Path(flightsw.__file__).resolve().parents[1]
# beside flight itself: everything that makes the figures of a run, not what sums them up
_SOURCES = (
    "hil_sim/**/*.py",
    "ground/tables/*.py",
    *(f"ground/campaign/{name}.py" for name in ("arc", "cells", "ensemble", "flown", "outage", "seeds")),
)


class Certified(NamedTuple):
    """What came of it: the certificate as written, the figures of all runs, the ensemble."""

    document: dict[str, Any]
    figures: Arrays
    ensemble: Ensemble
    targets: list[certificate.Target]


@lru_cache(maxsize=1)
def code_hash() -> str:
    """SHA-256 over the code that flies, simulates and measures."""
    digest = hashlib.sha256(package_hash().encode())
    for pattern in _SOURCES:
        for path in sorted(_ROOT.glob(pattern)):
            digest.update(path.relative_to(_ROOT).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def ensemble_of(table_set: str, quick: bool) -> Ensemble:
    """The ensemble that a set is certified on: its noise is what the set says it can take."""
    image = decode(build_navigation(table_set))
    if not flown.flies_forces(image):
        raise OperatorError(
            f"--set {table_set}: flies the paper's filter; only sets of the flight filter are certified"
        )
    noise = "coloured" if float(image.values["gnss_bias_sigma_m"][0]) > 0.0 else "white"
    if quick:
        return Ensemble(noise=noise, outage_s=(600.0, 600.0), acquisition_s=(60.0, 300.0, 600.0))
    return Ensemble(noise=noise)


def certify(
    folder: Path,
    table_set: str,
    ensemble: Ensemble,
    runs: int,
    advance: executor.Advance,
    quick: bool = False,
    again: bool = False,
    fly: Callable[..., Arrays] = executor.complete,
    **how: Any,
) -> Certified:
    """Fly and sum up. how: jobs, dask, chunk_runs of `executor.complete`. Raises OperatorError."""
    image = build_navigation(table_set)
    what = {
        "table_set": table_set,
        "table_sha256": hashlib.sha256(image).hexdigest(),
        "ensemble_sha256": ensemble.hash,
        "code_sha256": code_hash(),
        "runs": runs,
        "quick": quick,
    }
    attempt = attempts.begin(folder, what, again)
    number = int(attempt["attempt"])
    flight = Flight(ensemble, seeds.certification(image, ensemble.document(), number), table_set)
    place = folder / f"attempt-{number:03d}"
    store.open_folder(place, store.definition(flight, code_hash()))
    figures = fly(place, flight, runs, advance, **how)
    summary = certificate.summarise(ensemble, figures)
    targets = certificate.judge(summary)
    counts = [int(np.sum(figures["cell"] == cell)) for cell in ensemble.cells]
    grade = certificate.grade_of(ensemble, counts, quick)
    missed = [line.what for line in targets if line.met is False]
    pooled = summary["pooled"]
    result = {
        "grade": grade,
        "outages": pooled["outages"],
        "violated": pooled["violated"],
        "upper_limit_95": pooled["upper_limit_95"],
        "missed": len(missed),
    }
    every = attempts.finish(folder, number, result)
    document = {
        "format": "leonav certificate 1",
        "grade": grade,
        "certified": grade == "full" and not missed,
        "table_set": table_set,
        "table_crc32": f"{decode(image).crc32:08x}",
        "table_sha256": what["table_sha256"],
        "code_sha256": what["code_sha256"],
        "ensemble": ensemble.document(),
        "ensemble_sha256": ensemble.hash,
        "seeds": flight.seeds.document(),
        "attempt": number,
        "attempts": every,
        "envelope": certificate.envelope(ensemble, figures),
        "summary": summary,
        "targets": [line._asdict() for line in targets],
        "missed": missed,
    }
    text = json.dumps(document, indent=2, sort_keys=True, allow_nan=False) + "\n"
    (folder / CERTIFICATE).write_text(text, encoding="utf-8")
    return Certified(document, figures, ensemble, targets)
