"""Who flies a campaign does not matter: one process or two, in whatever chunks, killed, interrupted, resumed."""

from __future__ import annotations

import builtins
import multiprocessing
import os
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ground.campaign import executor, seeds, store
from ground.campaign.ensemble import Ensemble
from ground.campaign.outage import Flight
from ground.errors import OperatorError

pytestmark = pytest.mark.compiled

RUNS = 6
FLIGHT = Flight(
    Ensemble(outage_s=(30.0, 30.0), acquisition_s=(30.0,), second_share=0.0), seeds.tuning(11), "flight", ()
)


def nothing(runs: int) -> None:
    del runs


def campaign(folder: Path, advance: Callable[[int], None] = nothing, **how) -> bytes:
    store.open_folder(folder, store.definition(FLIGHT, "code"))
    executor.complete(folder, FLIGHT, RUNS, advance, **how)
    return (folder / store.OUTAGES).read_bytes()


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Flown in this process, one chunk."""
    return campaign(tmp_path_factory.mktemp("here") / "c", chunk_runs=RUNS)


def test_an_interrupt_keeps_what_is_finished_and_other_chunks_give_the_same_bytes(tmp_path: Path, here: bytes) -> None:
    """GIVEN a campaign interrupted after two chunks of two WHEN resumed in chunks of three THEN only what was missing
    is flown, and the file is the same to the byte."""
    done: list[int] = []

    def interrupt(runs: int) -> None:
        done.append(runs)
        if sum(done) >= 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        campaign(tmp_path, interrupt, chunk_runs=2)
    assert store.missing(tmp_path, RUNS) == [4, 5]
    with pytest.raises(OperatorError, match="2 of 6 runs"):
        store.collect(tmp_path, RUNS)
    told: list[int] = []
    assert campaign(tmp_path, told.append, chunk_runs=3) == here
    assert told == [4, 2]
    assert not list(tmp_path.rglob("*.partial"))


@pytest.mark.slow
def test_a_killed_worker_loses_nothing(tmp_path: Path, here: bytes) -> None:
    """GIVEN two workers WHEN one is killed with SIGKILL after the first chunk THEN the campaign ends by itself, with
    the same bytes as in this process."""
    killed: list[int] = []

    def kill(runs: int) -> None:
        if runs and not killed:
            victim = multiprocessing.active_children()[0]
            assert victim.pid is not None
            os.kill(victim.pid, signal.SIGKILL)
            killed.append(victim.pid)

    assert campaign(tmp_path, kill, jobs=2, chunk_runs=1) == here
    assert killed


def test_dask_gives_the_same_bytes(tmp_path: Path, here: bytes) -> None:
    """GIVEN a Dask scheduler and a worker WHEN it flies the campaign THEN the bytes are the same."""
    distributed = pytest.importorskip("distributed")
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, protocol="tcp", host="127.0.0.1"
    )
    with cluster:
        assert campaign(tmp_path, dask=cluster.scheduler_address, chunk_runs=2) == here


def test_dask_that_is_not_there_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN no package distributed WHEN a cluster is asked for THEN the message says what to install."""
    usual = builtins.__import__

    def without(name: str, *args, **more):
        if name == "distributed":
            raise ModuleNotFoundError(name=name)
        return usual(name, *args, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(OperatorError, match=r"leonav\[cluster\]"):
        campaign(tmp_path, dask="tcp://127.0.0.1:1")


def test_a_folder_serves_one_campaign(tmp_path: Path) -> None:
    """GIVEN a folder of a campaign WHEN another table, seed or ensemble is to fly there THEN it is refused by name."""
    store.open_folder(tmp_path, store.definition(FLIGHT, "code"))
    for other, word in (
        (FLIGHT._replace(overrides=(("k_axis", 3.5),)), "table_crc32"),
        (FLIGHT._replace(seeds=seeds.tuning(12)), "seeds"),
        (FLIGHT._replace(ensemble=Ensemble()), "ensemble"),
    ):
        with pytest.raises(OperatorError, match=word):
            store.open_folder(tmp_path, store.definition(other, "code"))
    with pytest.raises(OperatorError, match="code_sha256"):
        store.open_folder(tmp_path, store.definition(FLIGHT, "other code"))


def test_a_torn_chunk_is_named(tmp_path: Path) -> None:
    """GIVEN a chunk cut short on disk WHEN collected THEN the message names it and says what to do."""
    store.open_folder(tmp_path, store.definition(FLIGHT, "code"))
    store.save_chunk(tmp_path, 0, 1, {"run": np.arange(2)})
    path = tmp_path / store.CHUNKS / "000000-000001.npz"
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(OperatorError, match="000000-000001"):
        store.collect(tmp_path, 2)


def test_chunks_are_consecutive() -> None:
    """GIVEN runs with a gap WHEN chunked THEN no chunk spans the gap and none is too long."""
    assert store.chunked([0, 1, 2, 5, 6, 7, 8], 3) == [(0, 2), (5, 7), (8, 8)]
    assert store.chunked([], 3) == []
