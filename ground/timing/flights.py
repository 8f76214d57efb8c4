"""Whole processes timed from outside: flights in lockstep and in real time, starts with and without compiled kernels.

Every flight is a process of its own, so that nothing of the measuring is in it; what it says of itself is timing.json.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from ground.errors import OperatorError

LOCKSTEP = {  # name -> scenario and settings
    "the paper's filter": ("two_orbits", ()),
    "the flight filter": ("nominal", ()),
    "every function": ("soak", ("crosslink.period_s=1.0",)),
}
NOTHING_WRONG = ("outage=[]", "fault=[]", "satellite_fault=[]", "crosslink_fault=[]")  # of a scenario cut short
REAL_TIME = {  # name -> period of the tick, duration, and whether flight asks for real-time scheduling
    "10 Hz": (100_000_000, 600.0, True),
    "10 Hz, ordinary scheduling": (100_000_000, 600.0, False),
    "100 Hz": (10_000_000, 60.0, True),
    "100 Hz, ordinary scheduling": (10_000_000, 60.0, False),
}
_SPARE_S = 5.0  # of the scenario, that its end is not what is measured


def lockstep(scenario: str, settings: tuple[str, ...], folder: Path) -> dict[str, Any]:
    """timing.json of a scenario flown as fast as the machine can; with simulated_s, how long it lasted there."""
    words = [word for setting in settings for word in ("--set", setting)]
    _run("hil_sim", "run", scenario, *words, "--out", str(folder))
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return {**_timing(folder), "simulated_s": float(summary["simulated_s"])}


def real_time(period_ns: int, duration_s: float, fifo: bool, folder: Path) -> dict[str, Any]:
    """timing.json of flight beside world, bus hub and console, each a process, at the pace of the clock on the wall."""
    settings = (f"time.duration_s={duration_s + _SPARE_S}", "outage=[]", f"flight.table.tick_period_ns={period_ns}")
    words = [word for setting in settings for word in ("--set", setting)]
    asked = () if fifo else ("--no-real-time",)
    _run("hil_sim", "demo", "demo", "--plain", "--out", str(folder), *asked, *words)
    return _timing(folder)


def start(folder: Path, cold: bool) -> float:
    """Seconds from nothing to the end of the first tick; cold: with every kernel still to be compiled."""
    tables = folder / "tables"
    if not tables.exists():
        _run("hil_sim", "run", "nominal", "--set", "outage=[]", "--set", "time.duration_s=10", "--out", str(folder))
    environment = dict(os.environ)
    if cold:
        environment["LEONAV_CACHE_DIR"] = str(folder / "cold")
    began = time.perf_counter()
    _run("flightsw", "run", "--can", "virtual:timing", "--tables", str(tables), "--ticks", "1", environment=environment)
    return time.perf_counter() - began


def _run(*words: str, environment: dict[str, str] | None = None) -> None:
    done = subprocess.run([sys.executable, "-m", *words], capture_output=True, text=True, env=environment, check=False)
    if done.returncode != 0:
        said = (done.stderr.strip() or done.stdout.strip() or "nothing").splitlines()[-1]
        raise OperatorError(f"{' '.join(words[:3])} has ended with status {done.returncode}: {said}")


def _timing(folder: Path) -> dict[str, Any]:
    try:
        return dict(json.loads((folder / "timing.json").read_text(encoding="utf-8")))
    except (OSError, ValueError) as error:
        raise OperatorError(f"{folder / 'timing.json'}: not left by the flight ({error})") from None
