"""Real-time hygiene of the process: once, before the first tick. What is not permitted is said, not hidden."""

from __future__ import annotations

import ctypes
import gc
import os
import sys

_MCL_CURRENT, _MCL_FUTURE = 1, 2
_FIFO_PRIORITY = 50


def settle_garbage() -> None:
    """Collect once, then take everything that lives now out of the collector's sight and switch it off.

    The loop makes no cycles, so nothing is left for a collector to find; a pass of it would cost milliseconds.
    """
    gc.collect()
    gc.freeze()
    gc.disable()


def lock_memory() -> str | None:
    """Keep every page in memory; None, or why that is not permitted."""
    if not sys.platform.startswith("linux"):
        return f"no mlockall on {sys.platform}"
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) != 0:
        return os.strerror(ctypes.get_errno())
    return None


def use_fifo() -> str | None:
    """Ask for the SCHED_FIFO class; None, or why that is not permitted."""
    if not hasattr(os, "sched_setscheduler"):
        return f"no SCHED_FIFO on {sys.platform}"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_FIFO_PRIORITY))
    except OSError as error:
        return error.strerror
    return None


def scheduling() -> str:
    """The class in which this process is scheduled, as it is now."""
    if not hasattr(os, "sched_getscheduler"):
        return "ordinary"
    names = {os.SCHED_FIFO: "SCHED_FIFO", os.SCHED_RR: "SCHED_RR"}
    return names.get(os.sched_getscheduler(0), "ordinary")


def prepare(real_time: bool = True) -> list[str]:
    """All of it; returns what could not be had, in words. real_time False: ordinary scheduling, memory not locked."""
    settle_garbage()
    if not real_time:
        return []
    refused = (("memory not locked", lock_memory()), ("no real-time scheduling", use_fifo()))
    return [f"{what}: {why}" for what, why in refused if why is not None]
