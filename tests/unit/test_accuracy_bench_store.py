"""What the accuracy bench keeps: nothing is flown twice, and nothing stale is served."""

from __future__ import annotations

import multiprocessing
import os
import re
import signal
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ground.accuracy import bench, bench_store
from ground.accuracy.bench_cases import (
    LONG_FLIGHT,
    ORBITS,
    Case,
    Plan,
    cases_of,
)
from ground.accuracy.bench_flight import Part
from ground.errors import OperatorError

PLAN = Plan.of(86_400)


def case(**changes: Any) -> Case:
    """The simulated orbit with white fixes, three arcs."""
    plan = replace(PLAN, begins_s=PLAN.begins_s[:3])
    return replace(Case(ORBITS["simulated"], "white", plan, "flight"), **changes)


def flown_part(part: Part) -> dict[str, np.ndarray]:
    """Figures of a part that tell which it is."""
    if part.number == LONG_FLIGHT:
        return {"flight_t_s": np.arange(3.0)}
    return {"drag_scale": np.array(float(part.number)), "outage_ticks": np.array(10 + part.number)}


def test_a_case_is_kept_whole_and_not_flown_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a flown case WHEN the bench runs again THEN nothing flies, and the figures are the same."""
    flown: list[Part] = []
    monkeypatch.setattr(bench, "fly", lambda part: (flown.append(part), flown_part(part))[1])
    told: list[int] = []
    (first,) = bench.run([case()], tmp_path, None, {}, lambda: told.append(1))
    (second,) = bench.run([case()], tmp_path, None, {}, lambda: told.append(1))
    assert [part.number for part in flown] == [LONG_FLIGHT, 0, 1, 2]
    assert len(told) == 8
    assert (first.resumed, second.resumed) == (False, True)
    assert np.array_equal(first.figures["drag_scale"], [0.0, 1.0, 2.0])
    assert {k: v.tolist() for k, v in first.figures.items()} == {k: v.tolist() for k, v in second.figures.items()}


def test_a_stop_keeps_the_cases_that_are_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN Ctrl-C in the second case WHEN run again THEN only the second flies."""

    def stopped(part: Part) -> dict[str, np.ndarray]:
        if part.case.profile == "coloured" and part.number == 1:
            raise KeyboardInterrupt
        return flown_part(part)

    both = [case(), case(profile="coloured")]
    monkeypatch.setattr(bench, "fly", stopped)
    with pytest.raises(KeyboardInterrupt):
        bench.run(both, tmp_path, None, {}, lambda: None)
    monkeypatch.setattr(bench, "fly", flown_part)
    assert [one.resumed for one in bench.run(both, tmp_path, None, {}, lambda: None)] == [True, False]


def ended(part: Part) -> dict[str, np.ndarray]:
    """A worker that the system takes away."""
    os.kill(os.getpid(), signal.SIGKILL)
    return flown_part(part)


def test_a_worker_that_is_taken_away_is_told_in_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a process of the pool that is killed WHEN the bench waits for it THEN it says what to do."""
    monkeypatch.setattr(bench, "fly", ended)
    context = multiprocessing.get_context("spawn")
    with (
        ProcessPoolExecutor(1, mp_context=context) as workers,
        pytest.raises(OperatorError, match=r"ended from outside.*with fewer --jobs"),
    ):
        bench.run([case()], tmp_path, workers, {}, lambda: None)


@pytest.mark.parametrize(
    "change",
    [
        {"profile": "coloured"},
        {"table_set": "j2"},
        {"settings": ("flight.table.k_axis=3.5",)},
        {"degree": 70},
        {"plan": PLAN.quick()},
        {"orbit": ORBITS["simulated"]._replace(area_to_mass_m2pkg=0.02)},
    ],
)
def test_whatever_decides_the_figures_is_in_the_key(change: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    assert bench_store.key(case(), None) == bench_store.key(case(), None)
    assert bench_store.key(case(**change), None) != bench_store.key(case(), None)
    before = bench_store.key(case(), None)
    monkeypatch.setattr(bench_store, "code_hash", lambda: "another code")
    assert bench_store.key(case(), None) != before


def test_the_content_of_data_files_is_in_the_key(tmp_path: Path) -> None:
    """GIVEN two orbit files and two gravity files of one size WHEN keys are made THEN all differ."""
    files = [tmp_path / name for name in "ab"]
    for path in files:
        path.write_text(path.name)
    keys = {bench_store.key(case(), path) for path in files}
    keys |= {bench_store.key(case(gravity=path), None) for path in files}
    assert len(keys) == 4


@pytest.mark.parametrize("content", [b"", b"not a zip archive", None])
def test_a_kept_file_that_is_broken_is_flown_again(
    content: bytes | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """GIVEN an empty, a foreign or a cut file WHEN the bench runs THEN it flies and replaces it."""
    monkeypatch.setattr(bench, "fly", flown_part)
    bench.run([case()], tmp_path, None, {}, lambda: None)
    path = bench_store.path_of(tmp_path, case())
    path.write_bytes(path.read_bytes()[:-100] if content is None else content)
    (again,) = bench.run([case()], tmp_path, None, {}, lambda: None)
    assert not again.resumed
    assert bench_store.load(tmp_path, case(), bench_store.key(case(), None)) is not None


def test_cases_are_every_orbit_with_every_profile() -> None:
    some = cases_of([ORBITS["gracefo"], ORBITS["simulated"]], ("white", "coloured"), "flight", quick=True)
    assert [one.name for one in some] == [
        "gracefo-white",
        "gracefo-coloured",
        "simulated-white",
        "simulated-coloured",
    ]
    assert all(re.fullmatch(r"[a-z0-9_]+-[a-z_]+", one.name) for one in some)
    assert {one.plan.begins_s for one in some} == {(0, 1000, 2000)}


def test_a_profile_flies_the_set_made_for_it() -> None:
    """GIVEN receivers with lasting errors have a set of their own WHEN cases are made THEN it flies with them alone."""
    some = cases_of([ORBITS["simulated"]], ("white", "coloured"), "flight")
    assert [one.table_set for one in some] == ["flight", "flight_coloured"]
    assert [one.table_set for one in cases_of([ORBITS["simulated"]], ("coloured",), "j2")] == ["j2"]
