"""The world of a scenario in real time, on a bus that other processes listen to as well.

World and flight share the machine's monotonic clock and a start that is given to both in a file: the onboard counter
reads counter_ns at monotonic_ns and runs `speed` times as fast. What time it is in the world is read from that clock,
never counted: a world that was held up is where it should be as soon as it runs again.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import can

from hil_sim.errors import BusError, SimulationError
from hil_sim.scenario import LoadedScenario
from hil_sim.world import World

_POLL_S = 0.02
_LATE_TICKS = 20  # older frames are not sent any more: nobody could use them


class SharedClock(NamedTuple):
    """The onboard counter in terms of the machine's monotonic clock."""

    monotonic_ns: int
    counter_ns: int
    speed: float

    def write(self, path: Path) -> None:
        """Leave it for others, whole at once."""
        fresh = path.with_suffix(".new")
        fresh.write_text(json.dumps(self._asdict()))
        fresh.replace(path)


def await_clock(path: Path) -> SharedClock:
    """The clock of a file, once the file is there."""
    while not path.exists():
        time.sleep(_POLL_S)
    return SharedClock(**json.loads(path.read_text()))


def fly(loaded: LoadedScenario, bus: can.BusABC, clock_file: Path, ready: Callable[[int], None]) -> int:
    """Send the world's frames as they fall due, to the end of the scenario.

    ready: told the counter of the first tick once everything is prepared; the clock is waited for after that.
    """
    world = World.build(loaded)
    ready(world.counter0_ns)
    clock = await_clock(clock_file)
    k = 0
    while k < world.n_ticks:
        due_ns = clock.monotonic_ns + k * world.tick_period_ns / clock.speed
        wait_s = (due_ns - time.monotonic_ns()) * 1e-9
        if wait_s > 0.0:
            time.sleep(wait_s)
        elapsed_ns = (time.monotonic_ns() - clock.monotonic_ns) * clock.speed
        k = min(world.n_ticks - 1, max(k, int(elapsed_ns // world.tick_period_ns)))
        world.skip_before(k - _LATE_TICKS)
        try:
            world.send_due(k, bus, time.time())
            while bus.recv(0.0) is not None:  # what the others say is not for the world
                pass
        except (can.CanError, OSError) as error:
            raise BusError(f"tick {k}: the bus takes no frame: {error}") from None
        k += 1
    return 0


def open_bus(text: str) -> can.BusABC:
    """The bus `interface:channel`; SimulationError where it cannot be opened."""
    interface, _, channel = text.partition(":")
    if interface == "remote":
        channel = f"ws://{channel}/"
    try:
        return can.Bus(interface=interface, channel=channel, fd=True)
    except (can.CanError, OSError, ValueError, ImportError) as error:
        raise SimulationError(f"--can {text}: cannot be opened: {error}") from error
