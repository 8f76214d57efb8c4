"""What every worker process of a campaign or study owes the one who waits for it."""

from __future__ import annotations

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1  # linux/prctl.h


def serve(parent: int) -> None:
    """Leave Ctrl-C to the parent, who ends its workers, and end with it, however it ends.

    parent: its process number. A parent that is killed can end nobody; without this its workers would fly on unseen.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it had ended before
        os._exit(1)
