"""A certification from the first draw to certificate.json: attempt, flight, summary, report."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flightsw.icd.table_file import decode
from ground.campaign import attempts, certificate, code, endurance, endurance_summary, executor, flown, seeds, store
from ground.campaign.ensemble import Ensemble
from ground.campaign.outage import Arrays, Flight
from ground.errors import OperatorError
from ground.tables.build import build_navigation

CERTIFICATE = "certificate.json"
LONG, LONG_OUTAGES = "long", "long_outages.json"
QUICK_RUNS, QUICK_LONG_RUNS = 48, 12


class Certified(NamedTuple):
    """What came of it: the certificate as written, the figures of all runs, the ensemble."""

    document: dict[str, Any]
    figures: Arrays
    ensemble: Ensemble
    targets: list[certificate.Target]


def code_hash(long: bool = False) -> str:
    """SHA-256 over the code that flies, simulates and measures outages; long: those flown past the flag."""
    return code.hash_of("ground.campaign.endurance" if long else "ground.campaign.outage")


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
    judge: bool = False,
    **how: Any,
) -> Certified:
    """Fly and sum up. how: jobs, dask, chunk_runs of `executor.complete`. Raises OperatorError.

    judge: fly nothing, sum up what another version of this software may have flown. Long outages of the same table, if
    the folder has any (`endure`), go into the certificate: they say to what age.
    """
    attempt = _begin(folder, table_set, ensemble, runs, quick, again, None if judge else code_hash())
    figures = store.collect(attempt.place, runs) if judge else fly(attempt.place, attempt.flight, runs, advance, **how)
    summary = certificate.summarise(ensemble, figures)
    targets = certificate.judge(summary)
    counts = [int(np.sum(figures["cell"] == cell)) for cell in ensemble.cells]
    grade = certificate.grade_of(ensemble, counts, quick)
    long = _long_outages(folder, attempt.what["table_sha256"])
    if long is not None:
        # one that does not say so counts as of integrity
        targets += [certificate.Target(**({"integrity": True} | line)) for line in long["targets"]]
    document = _document(attempt, grade, summary["pooled"], targets, folder) | {
        "format": "leonav certificate 1",
        "envelope": certificate.envelope(ensemble, figures) | _certified_age(ensemble, long),
        "summary": summary,
        "long": long,
    }
    _write(folder / CERTIFICATE, document)
    return Certified(document, figures, ensemble, targets)


def endure(
    folder: Path,
    table_set: str,
    ensemble: Ensemble,
    runs: int,
    advance: executor.Advance,
    quick: bool = False,
    again: bool = False,
    fly: Callable[..., Arrays] = executor.complete,
    judge: bool = False,
    **how: Any,
) -> Certified:
    """Fly outages past the flag and sum up; ensemble: of `endurance.ensemble_of`. As `certify`, in folder/long."""
    place = folder / LONG
    attempt = _begin(place, table_set, ensemble, runs, quick, again, None if judge else code_hash(long=True))
    if judge:
        figures = store.collect(attempt.place, runs)
    else:
        flight = endurance.flight_of(attempt.flight)
        figures = fly(attempt.place, flight, runs, advance, work=endurance.fly_chunk, **how)
    summary = endurance_summary.summarise(figures, ensemble.outage_s[1])
    targets = endurance_summary.judge(summary)
    grade = endurance_summary.grade_of(figures, quick)
    document = _document(attempt, grade, summary["pooled"], targets, place) | {
        "format": "leonav long outages 1",
        "summary": summary,
    }
    _write(place / LONG_OUTAGES, document)
    return Certified(document, figures, ensemble, targets)


def finished(
    folder: Path, table_set: str, ensemble: Ensemble, runs: int, long: bool, quick: bool
) -> tuple[Flight, Arrays]:
    """What a finished campaign flew, and its figures. Raises OperatorError where it is another one, or not finished."""
    place = folder / LONG if long else folder
    attempt = _begin(place, table_set, ensemble, runs, quick, False, None)
    return attempt.flight, store.collect(attempt.place, runs)


class _Attempt(NamedTuple):
    number: int
    what: dict[str, Any]
    image: bytes
    flight: Flight
    place: Path


def _begin(
    folder: Path, table_set: str, ensemble: Ensemble, runs: int, quick: bool, again: bool, code: str | None
) -> _Attempt:
    """Write the attempt down, and make the folder of its runs. code: hash; None: the last attempt, whatever flew it."""
    image = build_navigation(table_set)
    what = {
        "table_set": table_set,
        "table_sha256": hashlib.sha256(image).hexdigest(),
        "ensemble_sha256": ensemble.hash,
        "code_sha256": code,
        "runs": runs,
        "quick": quick,
    }
    if code is None:
        code = what["code_sha256"] = _flown_by(folder, what)
    before = None if quick else attempts.shipped(table_set, folder.name == LONG)
    number = int(attempts.begin(folder, what, again, before)["attempt"])
    flight = Flight(ensemble, seeds.certification(image, ensemble.document(), number), table_set)
    place = folder / f"attempt-{number:03d}"
    store.open_folder(place, store.definition(flight, code))
    return _Attempt(number, what, image, flight, place)


def _flown_by(folder: Path, what: dict[str, Any]) -> str:
    """Hash of the code of the last attempt. Raises OperatorError where that is of something else, or there is none."""
    held = attempts.read(folder)
    if not held:
        raise OperatorError(f"{folder}: nothing was flown there; fly first, or name the folder of a campaign")
    last = held[-1]["what"]
    other = sorted(key for key, value in what.items() if key != "code_sha256" and last.get(key) != value)
    if other:
        raise OperatorError(f"{folder}: its last attempt is of something else ({', '.join(other)} differ)")
    return str(last["code_sha256"])


def _document(
    attempt: _Attempt, grade: str, pooled: dict[str, Any], targets: list[certificate.Target], folder: Path
) -> dict[str, Any]:
    """Finish the attempt; what every document of a campaign says."""
    missed = [line.what for line in targets if line.met is False]
    unproven = certificate.unproven(targets)
    result = {
        "grade": grade,
        "outages": pooled["outages"],
        "violated": pooled["violated"],
        "upper_limit_95": pooled["upper_limit_95"],
        "missed": len(missed),
    }
    ensemble = attempt.flight.ensemble
    return {
        "grade": grade,
        "certified": grade == "full" and not unproven,
        "table_set": attempt.what["table_set"],
        "table_crc32": f"{decode(attempt.image).crc32:08x}",
        "table_sha256": attempt.what["table_sha256"],
        "code_sha256": attempt.what["code_sha256"],
        "ensemble": ensemble.document(),
        "ensemble_sha256": ensemble.hash,
        "seeds": attempt.flight.seeds.document(),
        "attempt": attempt.number,
        "attempts": attempts.finish(folder, attempt.number, result),
        "targets": [line._asdict() for line in targets],
        "missed": missed,
        "unproven": unproven,
    }


def _long_outages(folder: Path, table_sha256: str) -> dict[str, Any] | None:
    """What long outages of the same table have shown, or None."""
    path = folder / LONG / LONG_OUTAGES
    try:
        held = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise OperatorError(f"{path}: cannot be read ({error}); fly the long outages again") from error
    return held if isinstance(held, dict) and held.get("table_sha256") == table_sha256 else None


def _certified_age(ensemble: Ensemble, long: dict[str, Any] | None) -> dict[str, float]:
    """To the end of the outages; to that of long ones where these are as many as a certificate takes."""
    proven = long is not None and long["grade"] == "full"
    return {"age_s": float(long["summary"]["longest_s"]) if long is not None and proven else ensemble.outage_s[1]}


def _write(path: Path, document: dict[str, Any]) -> None:
    path.write_text(json.dumps(document, indent=2, sort_keys=True, allow_nan=False) + "\n", encoding="utf-8")
