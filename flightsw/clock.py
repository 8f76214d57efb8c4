"""The onboard counter as flight sees it: injected, so that the same loop runs in lockstep and in real time."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A monotonic counter in nanoseconds, and a way to wait for a reading of it."""

    @property
    def lockstep(self) -> bool:
        """Whether time stands still while flight works: then nothing is ever late."""
        ...

    def counter_ns(self) -> int:
        """The counter now."""
        ...

    def wait_until(self, counter_ns: int) -> None:
        """Return at this reading, or at once if it has passed."""
        ...


class LockstepClock:
    """Time that only moves when the loop waits: flight is as fast as the machine, and the run repeatable."""

    __slots__ = ("_now_ns",)
    lockstep = True

    def __init__(self, counter_ns: int) -> None:
        self._now_ns = counter_ns

    def counter_ns(self) -> int:
        return self._now_ns

    def wait_until(self, counter_ns: int) -> None:
        self._now_ns = counter_ns


class RealTimeClock:
    """The machine's monotonic clock, started at a reading and scaled: speed 10 makes ten seconds of one."""

    __slots__ = ("_origin_ns", "_speed", "_start_ns")
    lockstep = False

    def __init__(self, counter_ns: int = 0, speed: float = 1.0) -> None:
        if not speed > 0.0:
            raise ValueError(f"speed {speed} is not positive")
        self._origin_ns = time.monotonic_ns()
        self._start_ns = counter_ns
        self._speed = speed

    def counter_ns(self) -> int:
        elapsed_ns = time.monotonic_ns() - self._origin_ns
        return self._start_ns + (elapsed_ns if self._speed == 1.0 else int(elapsed_ns * self._speed))

    def wait_until(self, counter_ns: int) -> None:
        # Python's sleep is clock_nanosleep on the monotonic clock with an absolute deadline.
        remaining_ns = (counter_ns - self.counter_ns()) / self._speed
        if remaining_ns > 0:
            time.sleep(remaining_ns * 1e-9)
