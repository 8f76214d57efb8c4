"""Instructions of a tick, counted by valgrind: a figure that neither the neighbours nor the frequency change.

Two runs of the same scenario, one longer by some ticks, are flown as ever and then replayed, each under callgrind; the
difference by these ticks is what one of them costs: bus, codec, step, telemetry, logs, and the reading of the journal,
without the world. Start and tables fall out. valgrind knows no AVX-512: kernels are compiled for a processor
without it, so that the count is comparable with itself only.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ground.errors import OperatorError
from ground.timing.flights import NOTHING_WRONG

SHORT_S, LONG_S = 20.0, 320.0  # of a scenario: a start costs some millions more or less, a tick half a million
CPU = "x86-64-v3"  # AVX2: the most that valgrind executes
_TOTAL = re.compile(r"Collected\s*:\s*(\d+)")
_TICKS_PER_S = 10
_PYTHON = (sys.executable, "-m")
SCENARIOS = {
    "the flight filter": ("nominal", ("outage=[]",)),
    "every function": ("soak", ("crosslink.period_s=1.0", *NOTHING_WRONG)),
}


def _lasting(seconds: float) -> list[str]:
    return ["--set", f"time.duration_s={seconds}"]


def missing() -> str | None:
    """Why nothing can be counted here; None where it can."""
    return None if shutil.which("valgrind") else "valgrind is not installed here; perf counts no instructions either"


def count(scenario: str, settings: tuple[str, ...], tell: Callable[[str], None]) -> dict[str, Any]:
    """Instructions of a tick in lockstep, world and logs included; OperatorError where a flight fails."""
    # the same machine code in every count, and nothing in an order that a random hash decides
    environment = {**os.environ, "NUMBA_CPU_NAME": CPU, "NUMBA_CPU_FEATURES": "", "PYTHONHASHSEED": "0"}
    words = [word for setting in settings for word in ("--set", setting)]
    counted = []
    with tempfile.TemporaryDirectory() as folder:
        for seconds in (SHORT_S, LONG_S):
            run = Path(folder) / f"{seconds:.0f}"
            tell(f"{scenario}: {seconds:.0f} s flown with kernels for {CPU}, then replayed under valgrind, minutes")
            _run([*_PYTHON, "hil_sim", "run", scenario, *words, *_lasting(seconds), "--out", str(run)], environment)
            valgrind = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder}/callgrind.out"]
            said = _run([*valgrind, *_PYTHON, "flightsw", "replay", str(run)], environment)
            total = _TOTAL.search(said)
            if total is None:
                raise OperatorError("valgrind has counted nothing")
            counted.append(int(total.group(1)))
    ticks = round((LONG_S - SHORT_S) * _TICKS_PER_S)
    return {"ticks": ticks, "instructions": (counted[1] - counted[0]) / ticks}


def _run(command: list[str], environment: dict[str, str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    if done.returncode != 0:
        said = (done.stderr.strip() or done.stdout.strip() or "nothing").splitlines()[-1]
        raise OperatorError(f"{command[0]} has ended with status {done.returncode}: {said}")
    return done.stderr
