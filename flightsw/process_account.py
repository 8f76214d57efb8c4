"""What the operating system and the interpreter did to a flight while it ticked: kept in every run's timing.json."""

from __future__ import annotations

import gc
import os
import sys
import time
from typing import Any

try:
    import resource
except ModuleNotFoundError:  # no such accounts there
    resource = None  # type: ignore[assignment]

_FIELDS = {
    "minor_page_faults": "ru_minflt",
    "major_page_faults": "ru_majflt",
    "waits": "ru_nvcsw",
    "preempted": "ru_nivcsw",
}


class ProcessAccount:
    """Counts from its making to `summary`: page faults, context switches, passes of the collector, blocks of memory."""

    def __init__(self) -> None:
        self._began_s = time.perf_counter()
        self._usage = _usage()
        self._passes = _passes()
        self._blocks = sys.getallocatedblocks()

    def age_s(self) -> float:
        """Wall time since its making."""
        return time.perf_counter() - self._began_s

    def summary(self) -> dict[str, Any]:
        """What has changed. collector_passes: by generation. net_blocks: more blocks allocated than at the beginning.
        load: of the machine over the last minute, and its processors."""
        usage = _usage()
        return {
            **{name: usage[name] - self._usage[name] for name in usage},
            "collector_passes": [now - then for now, then in zip(_passes(), self._passes, strict=True)],
            "net_blocks": sys.getallocatedblocks() - self._blocks,
            "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
            "processors": os.cpu_count(),
        }


def _usage() -> dict[str, int]:
    if resource is None:
        return {}
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return {name: int(getattr(usage, field)) for name, field in _FIELDS.items()}


def _passes() -> list[int]:
    return [int(generation["collections"]) for generation in gc.get_stats()]
