"""Who flies the chunks of a campaign: this process, a pool of processes, or a Dask cluster.

The result does not depend on it: a run draws from its own number. A chunk is kept as soon as it is finished; an
interrupt loses those under way, and a worker that dies has its chunk flown by another.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from pathlib import Path
from typing import Any

from flightsw.kernels.registry import warm_up
from ground.campaign import store
from ground.campaign.outage import Arrays, Flight, fly
from ground.errors import OperatorError
from ground.workers import serve

CHUNK_RUNS = 20
_DEATHS_IN_A_ROW = 5

Chunk = tuple[int, int]
Advance = Callable[[int], None]


Work = Callable[[Any, int, int], Arrays]


def fly_chunk(flight: Flight, first: int, last: int) -> Arrays:
    """Figures of runs first to last, stacked. What a worker does for a campaign of outages."""
    return store.stacked(fly(flight, run) for run in range(first, last + 1))


def complete(
    folder: Path,
    flight: Any,
    runs: int,
    advance: Advance,
    jobs: int = 1,
    dask: str | None = None,
    chunk_runs: int = CHUNK_RUNS,
    work: Work = fly_chunk,
) -> Arrays:
    """Fly what the folder lacks of runs 0 to runs - 1; figures of all of them, also written as one file.

    advance is told how many runs came in. work(flight, first, last): figures of a chunk, a function of a module;
    whatever it flies, a run must draw from its own number alone. dask: address of a scheduler, for example
    tcp://host:8786. Raises OperatorError; after KeyboardInterrupt finished chunks are kept and the same call goes on.
    """
    lacking = store.missing(folder, runs)
    advance(runs - len(lacking))
    chunks = store.chunked(lacking, chunk_runs)
    if dask is not None:
        flown = _on_dask(dask, flight, chunks, work)
    elif jobs > 1 and len(chunks) > 1:
        flown = _in_pool(min(jobs, len(chunks)), flight, chunks, work)
    else:
        flown = _here(flight, chunks, work)
    for (first, last), figures in flown:
        store.save_chunk(folder, first, last, figures)
        advance(last - first + 1)
    figures = store.collect(folder, runs)
    store.save_outages(folder, figures)
    return figures


def _here(flight: Any, chunks: list[Chunk], work: Work) -> Iterator[tuple[Chunk, Arrays]]:
    if chunks:
        warm_up()
    for chunk in chunks:
        yield chunk, work(flight, *chunk)


def _in_pool(jobs: int, flight: Any, chunks: list[Chunk], work: Work) -> Iterator[tuple[Chunk, Arrays]]:
    warm_up()  # kernels are compiled once, here; workers find them in the cache
    waiting = list(reversed(chunks))
    deaths = 0
    while waiting:
        flying: dict[Future[Arrays], Chunk] = {}
        # a fork would copy the threads of numba and satkit half alive
        context = multiprocessing.get_context("spawn")
        executor = ProcessPoolExecutor(jobs, mp_context=context, initializer=_make_ready, initargs=(os.getpid(),))
        try:
            while waiting or flying:
                while waiting and len(flying) < 2 * jobs:
                    chunk = waiting[-1]
                    flying[executor.submit(work, flight, *chunk)] = chunk  # raises, too, when the pool has died
                    waiting.pop()
                done, _ = wait(flying, return_when=FIRST_COMPLETED)
                for future in sorted(done, key=lambda one: flying[one]):
                    figures = future.result()
                    deaths = 0
                    yield flying.pop(future), figures
        except BrokenProcessPool:
            # one worker died, and with it the pool: all that was under way is flown again by another one
            deaths += 1
            waiting += sorted(flying.values(), reverse=True)
            if deaths >= _DEATHS_IN_A_ROW:
                raise OperatorError(
                    f"workers died {deaths} times without finishing a chunk, last at runs {waiting[-1]}; "
                    "is there memory enough? Finished chunks are kept; try --jobs 1"
                ) from None
        finally:
            executor.shutdown(wait=False, cancel_futures=True)


def _make_ready(parent: int) -> None:
    serve(parent)
    warm_up()


def _on_dask(address: str, flight: Any, chunks: list[Chunk], work: Work) -> Iterator[tuple[Chunk, Arrays]]:
    try:
        from distributed import Client, as_completed
    except ModuleNotFoundError:
        raise OperatorError(
            "--dask needs the package distributed, here and on the workers: pip install 'leonav[cluster]'"
        ) from None
    try:
        client = Client(address, timeout="10s")
    except (OSError, TimeoutError, ValueError) as error:
        raise OperatorError(
            f"--dask {address}: no scheduler answers ({type(error).__name__}); start one with `dask scheduler`, "
            "workers with `dask worker ADDRESS --nthreads 1`"
        ) from None
    with client:
        futures: dict[Any, Chunk] = {
            client.submit(work, flight, *chunk, pure=False, retries=_DEATHS_IN_A_ROW): chunk for chunk in chunks
        }
        try:
            for future in as_completed(list(futures)):
                yield futures[future], future.result()
                future.release()
        except OperatorError:
            raise
        except Exception as error:
            # whatever a worker raised, or the cluster's own: the finished chunks are kept
            raise OperatorError(f"--dask {address}: {type(error).__name__}: {error}") from error
        finally:
            with suppress(Exception):
                client.cancel(list(futures))
