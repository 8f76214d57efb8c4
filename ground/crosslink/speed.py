"""What an epoch costs: the own satellite alone, every pair ranging once, every pair ranging both ways."""

from __future__ import annotations

import os
from dataclasses import replace
from time import perf_counter_ns, thread_time_ns
from typing import Any

import numpy as np

from flightsw.crosslink.monitor import monitor_epoch, monitor_step
from flightsw.crosslink.setup import MonitorMemory
from ground.crosslink.scene import Setting, ready

_EPOCHS = 400
_HISTORY = 1210  # epochs before them: the search for slow faults has all its blocks only after twenty minutes


def measure(setting: Setting, epochs: int = _EPOCHS) -> dict[str, Any]:
    """Microseconds an epoch, by kind: links, least, median, 99 %; of the processor's own time, which others on the
    machine do not lengthen, the median of the whole, that of the judgement, and what 99 % of all steps stay below; and
    the load of the machine meanwhile."""
    found: dict[str, Any] = {}
    for name, both in (("one way, once", False), ("one way, both", True)):
        memory, pairs = ready(replace(setting, both=both), 0.0)
        found[name] = _timed(memory, len(pairs), epochs)
    memory, pairs = ready(replace(setting, both=True), 0.0)
    mine = np.flatnonzero(pairs[:, 0] == 0)
    for name in ("receiver", "sender", "range_m"):
        memory.epoch[name][0, : len(mine)] = memory.epoch[name][0, mine].copy()
    memory.epoch["links"] = len(mine)
    found["own satellite alone"] = _timed(memory, len(mine), epochs)
    found["load"] = os.getloadavg()[0]
    return found


def _timed(memory: MonitorMemory, links: int, epochs: int) -> dict[str, float]:
    arguments, left = memory.arguments(), memory.verdict["left"]
    for _ in range(_HISTORY):
        memory.epoch["links"] = links
        monitor_epoch(*arguments)
    took_us, own_us, judged_us = np.empty(epochs), np.empty(epochs), np.empty(epochs)
    steps_us: list[float] = []
    for epoch in range(epochs):
        memory.epoch["links"] = links
        before, own_before = perf_counter_ns(), thread_time_ns()
        monitor_step(*arguments, 1)
        judged_us[epoch] = (thread_time_ns() - own_before) / 1e3
        while left[0] > 0:
            step_before = thread_time_ns()
            monitor_step(*arguments, 0)
            steps_us.append((thread_time_ns() - step_before) / 1e3)
        own_us[epoch] = (thread_time_ns() - own_before) / 1e3
        took_us[epoch] = (perf_counter_ns() - before) / 1e3
    low, middle, high = np.quantile(took_us, (0.0, 0.5, 0.99))
    return {
        "links": links,
        "least_us": float(low),
        "median_us": float(middle),
        "p99_us": float(high),
        "processor_us": float(np.median(own_us)),
        "judged_us": float(np.median(judged_us)),
        "step_p99_us": float(np.quantile([*judged_us, *steps_us], 0.99)),
    }
