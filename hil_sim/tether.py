"""A child process that does not outlive its parent, however that ends: also killed, when it can end nothing itself."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from collections.abc import Callable

_PR_SET_PDEATHSIG = 1


def tethered(number: signal.Signals) -> Callable[[], None] | None:
    """For `preexec_fn` of subprocess.Popen: the kernel sends the child this signal when the calling thread ends.

    None where the system has no such thing; the parent then ends its children as far as it can. What runs between fork
    and exec is two system calls, bound beforehand: no import, no lock.
    """
    if not sys.platform.startswith("linux"):
        return None
    prctl, parent = ctypes.CDLL(None).prctl, os.getpid()

    def tie() -> None:
        prctl(_PR_SET_PDEATHSIG, int(number), 0, 0, 0)
        if os.getppid() != parent:  # it died before the tie was made
            os._exit(128 + number)

    return tie
