"""The accuracy bench: flies every case, keeps what is flown, and sums it up.

Every orbit flies with every profile of fixes; noise is drawn anew for each outage, no start is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from ground.accuracy import bench_store
from ground.accuracy.bench_cases import Case
from ground.accuracy.bench_flight import Arrays, Part, fly
from ground.errors import OperatorError


class Flown(NamedTuple):
    """A case and its figures; resumed: from an earlier run of the bench."""

    case: Case
    figures: Arrays
    resumed: bool


def run(
    cases: Sequence[Case],
    folder: Path,
    workers: ProcessPoolExecutor | None,
    orbit_files: dict[str, Path],
    advance: Callable[[], None],
) -> list[Flown]:
    """Fly what is not yet kept in the folder; a case is kept as soon as its last part is flown.

    orbit_files: orbit name -> the file it is read from. advance is called for each part, flown now or before. Raises
    OperatorError where data or settings do not allow a part.
    """
    keys = {case: bench_store.key(case, orbit_files.get(case.orbit.name)) for case in cases}
    kept = {case: bench_store.load(folder, case, keys[case]) for case in cases}
    to_fly = [case for case in cases if kept[case] is None]
    for case in cases:
        if kept[case] is not None:
            for _ in bench_store.parts(case):
                advance()
    everything = [Part(case, number) for case in to_fly for number in bench_store.parts(case)]
    # closed, whatever happens: parts not yet begun are then given up
    with closing(_each(workers, everything)) as results:
        for case in to_fly:
            figures: list[Arrays] = []
            for _ in bench_store.parts(case):
                figures.append(next(results))
                advance()
            bench_store.save(folder, case, keys[case], bench_store.stacked(figures))
            kept[case] = bench_store.load(folder, case, keys[case])
    found = []
    for case in cases:
        known = kept[case]
        assert known is not None
        found.append(Flown(case, known, case not in to_fly))
    return found


def _each(workers: ProcessPoolExecutor | None, everything: Sequence[Part]) -> Generator[Arrays, None, None]:
    try:
        yield from map(fly, everything) if workers is None else workers.map(fly, everything)
    except BrokenProcessPool:
        raise OperatorError(
            "a process of the bench was ended from outside, perhaps for want of memory; finished cases are kept: "
            "give the same command again, with fewer --jobs"
        ) from None
