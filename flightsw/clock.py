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


class PacedClock(LockstepClock):
    """Lockstep for spectators: a reading is shown when real time, times `speed`, has reached it.

    Flight works on the very readings of a lockstep run, so a paced run is repeatable and leaves the same logs. A
    reading that comes late by a period or more is late for good: what follows keeps its pace, nothing is caught up.
    """

    __slots__ = ("_origin_ns", "_period_ns", "_speed", "_start_ns", "missed")

    def __init__(self, counter_ns: int, period_ns: int, speed: float) -> None:
        if not speed > 0.0:
            raise ValueError(f"speed {speed} is not positive")
        super().__init__(counter_ns)
        self._start_ns = counter_ns
        self._period_ns = period_ns
        self._speed = speed
        self._origin_ns = -1
        self.missed = 0  # whole periods by which the run has fallen behind its pace

    def wait_until(self, counter_ns: int) -> None:
        now_ns = time.monotonic_ns()
        if self._origin_ns < 0:
            self._origin_ns = now_ns
        due_ns = self._origin_ns + (counter_ns - self._start_ns) / self._speed
        behind = int((now_ns - due_ns) * self._speed) // self._period_ns
        if behind > 0:
            self.missed += behind
            self._origin_ns += int(behind * self._period_ns / self._speed)
        elif now_ns < due_ns:
            time.sleep((due_ns - now_ns) * 1e-9)
        super().wait_until(counter_ns)


class SharedClock:
    """A counter that other processes of this machine read too: `speed` times as fast as its monotonic clock.

    It reads counter_ns where the monotonic clock reads monotonic_ns.
    """

    __slots__ = ("_counter_ns", "_monotonic_ns", "_speed")
    lockstep = False

    def __init__(self, monotonic_ns: int, counter_ns: int, speed: float) -> None:
        if not speed > 0.0:
            raise ValueError(f"speed {speed} is not positive")
        self._monotonic_ns = monotonic_ns
        self._counter_ns = counter_ns
        self._speed = speed

    def counter_ns(self) -> int:
        return self._counter_ns + int((time.monotonic_ns() - self._monotonic_ns) * self._speed)

    def wait_until(self, counter_ns: int) -> None:
        remaining_ns = (counter_ns - self.counter_ns()) / self._speed
        if remaining_ns > 0:
            time.sleep(remaining_ns * 1e-9)


class RealTimeClock:
    """The machine's monotonic clock, started at a reading."""

    __slots__ = ("_origin_ns",)
    lockstep = False

    def __init__(self, counter_ns: int = 0) -> None:
        self._origin_ns = time.monotonic_ns() - counter_ns

    def counter_ns(self) -> int:
        return time.monotonic_ns() - self._origin_ns

    def wait_until(self, counter_ns: int) -> None:
        # Python's sleep is clock_nanosleep on the monotonic clock with an absolute deadline.
        remaining_ns = counter_ns - self.counter_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns * 1e-9)
