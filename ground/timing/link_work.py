"""A million ticks with the ground link open: what of a tick is the link's, and whether anything grows.

World and flight in lockstep as in a run; the link is that of a flight: a socket of this machine, signed both ways,
orders and requests every second, default rates, logs that rotate. Only what flight's own members take counts, tick by
tick: what world and ground station take is not flight's. It is taken twice, by the clock on the wall and by that of the
processor: on a machine with other work the first says how long others had the processor.
"""

from __future__ import annotations

import gc
import math
import os
import secrets
import socket
import sys
from collections.abc import Callable
from pathlib import Path
from time import thread_time_ns
from typing import Any

from flightsw import app
from flightsw.can_port import CanPort
from flightsw.clock import LockstepClock
from flightsw.icd import mavlink as m
from flightsw.journal import Journal
from flightsw.link_open import LinkOptions, open_ground_link
from flightsw.main_loop import MainLoop
from flightsw.process_account import ProcessAccount
from flightsw.schedule import Member
from ground.timing.report import LINK_SHARE
from hil_sim import scenario
from hil_sim.bus import VirtualBusPair
from hil_sim.sil import build_tables
from hil_sim.world import World

MEMBERS = ("orders", "alert", "telemetry", "answer")  # of the tick; `alert` keeps the events besides
TICKS = 1_000_000
QUICK_TICKS = 30_000
LIMIT_BYTES = 64_000_000  # of a log
_WARM = 0.1  # of the ticks: rings fill over some 20,000
_PARTS = 10
_HEARD_BYTES = 1 << 16
_LOOKS, _LOOK_TICKS = 8, 137  # instants at which what is held is looked at, and what lies between


class Station:
    """A ground station on a socket: a signed order and a parameter read every second, and all that it hears dropped."""

    def __init__(self, key: bytes) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.port = int(self._socket.getsockname()[1])
        self._peer: Any = None
        self._mav = m.MAVLink(self, srcSystem=255, srcComponent=190, use_native=False)
        self._mav.signing.secret_key = key
        self._mav.signing.sign_outgoing = True
        self.heard = self.sent = 0

    def write(self, frame: bytes | bytearray) -> None:
        """Called by the dialect with every packed frame."""
        if self._peer is not None:
            self._socket.sendto(frame, self._peer)
            self.sent += 1

    def order(self, stamp: int) -> None:
        """Ask for a message and for a parameter, both answered in flight's next tick."""
        self._mav.signing.timestamp = max(self._mav.signing.timestamp, stamp)
        wanted = float(m.MAVLINK_MSG_ID_CURRENT_MODE)
        self._mav.command_long_send(1, 1, m.MAV_CMD_REQUEST_MESSAGE, 0, wanted, 0, 0, 0, 0, 0, 0)
        self._mav.param_request_read_send(1, 1, b"LNK_REPEAT_S", -1)

    def listen(self) -> None:
        """Take everything that has come."""
        while True:
            try:
                _, self._peer = self._socket.recvfrom(_HEARD_BYTES)
            except BlockingIOError:
                return
            self.heard += 1

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def fly(ticks: int, folder: Path, report: Callable[[int], None]) -> dict[str, Any]:
    """Fly so many ticks in an empty folder; report: is given the ticks flown, now and then. Returns the account."""
    looked = (_PARTS + 1) * _LOOKS * _LOOK_TICKS
    duration_s = math.ceil((ticks + looked) / 10)  # ten ticks a second
    outage = "[{start_s=600.0, duration_s=900.0}]" if duration_s > 1500 else "[]"
    loaded = scenario.load("two_orbits", [f"time.duration_s={duration_s}", f"outage={outage}"])
    navigation, orientation, forces = build_tables(loaded, folder / "tables")
    period_ns = int(navigation.values["tick_period_ns"][0])
    world = World.build(loaded, period_ns)
    key = secrets.token_bytes(32)
    key_file = folder / "link.key"
    key_file.touch(mode=0o600)
    key_file.write_text(key.hex() + "\n", encoding="utf-8")
    station = Station(key)
    options = LinkOptions((f"udp:127.0.0.1:{station.port}",), key_file, folder / "link")
    opened = open_ground_link(options, world.start_unix_ns)
    journal = Journal(folder, LIMIT_BYTES)
    try:
        with VirtualBusPair() as pair:
            clock = LockstepClock(world.counter0_ns)
            loop = app.build(
                navigation,
                orientation,
                clock,
                CanPort(lambda: pair.flight),
                journal,
                opened.port,
                world.start_unix_ns,
                forces=forces,
            )
            loop.listen(opened.port, opened.access, folder / "link", folder)
            return _Flying(world, loop, pair, clock, station).fly(ticks, report)
    finally:
        journal.close()
        opened.port.close()
        station.close()


class _Flying:
    def __init__(
        self, world: World, loop: MainLoop, pair: VirtualBusPair, clock: LockstepClock, station: Station
    ) -> None:
        self._world, self._loop, self._pair, self._clock, self._station = world, loop, pair, clock, station
        self._members = [member for member in loop.schedule.members if member.name in MEMBERS]
        self._link_cpu_ns = 0
        for member in self._members:
            member.run = self._timed(member.run)
        self._accounts = self._new_accounts()
        self._second = max(1, 1_000_000_000 // loop.period_ns)
        self._tick = 0

    def _new_accounts(self) -> tuple[Member, ...]:
        """Of the link and of the whole tick, by the wall and by the processor."""
        budget_us = LINK_SHARE * self._loop.period_ns / 1000.0
        return tuple(Member(name, 1, budget_us, lambda: None) for name in ("link", "whole", "link_cpu", "whole_cpu"))

    def _timed(self, run: Callable[[], None]) -> Callable[[], None]:
        def timed() -> None:
            before_ns = thread_time_ns()
            run()
            self._link_cpu_ns += thread_time_ns() - before_ns

        return timed

    def fly(self, ticks: int, report: Callable[[int], None]) -> dict[str, Any]:
        """Warm, then fly; the account of what came after the warming."""
        warm = round(_WARM * ticks)
        self._go(warm, report)
        gc.collect()
        self._accounts = self._new_accounts()
        account = ProcessAccount()
        held = [self._held()]
        for part in range(1, _PARTS + 1):
            self._go(warm + (ticks - warm) * part // _PARTS, report)
            held.append(self._held())
        ground = self._loop.ground
        assert ground is not None
        return {
            "ticks": ticks,
            "warm_ticks": warm,
            "period_us": self._loop.period_ns / 1000.0,
            "wall_s": account.age_s(),
            **{member.name: member.summary() for member in self._accounts},
            "held": [{"blocks": blocks, "resident_bytes": resident} for blocks, resident in held],
            "messages": self._loop.link.messages,
            "heard": self._station.heard,
            "orders_sent": self._station.sent,
            "orders_taken": ground.uplink.accepted,
            "refused": sum(ground.uplink.refused),
            "process": account.summary(),
        }

    def _go(self, stop: int, report: Callable[[int], None]) -> None:
        world, loop, pair, clock = self._world, self._loop, self._pair, self._clock
        members, whole, period_ns = self._members, loop.schedule.whole, loop.period_ns
        link_wall, whole_wall, link_cpu, whole_cpu = self._accounts
        for k in range(self._tick, stop):
            if k % self._second == 0:
                self._station.order(loop.ground.access.now(loop.unix_ns()) if loop.ground is not None else 0)
            counter_ns = world.counter_ns(k)
            clock.wait_until(counter_ns)
            world.send_due(k, pair.world, 0.0)
            wall_ns, whole_ns = sum(member.total_ns for member in members), whole.total_ns
            self._link_cpu_ns, cpu_ns = 0, thread_time_ns()
            loop.run_tick()
            whole_cpu.account(thread_time_ns() - cpu_ns)
            link_cpu.account(self._link_cpu_ns)
            link_wall.account(sum(member.total_ns for member in members) - wall_ns)
            whole_wall.account(whole.total_ns - whole_ns)
            loop.rest(counter_ns + period_ns)
            while pair.world.recv(0.0) is not None:
                pass
            self._station.listen()
            if k % 1000 == 0:
                report(k)
        self._tick = max(self._tick, stop)

    def _held(self) -> tuple[int, int]:
        """Blocks and bytes held. Of some instants the least: what waits to be sent or written comes and goes."""
        blocks = []
        for _ in range(_LOOKS):
            self._go(self._tick + _LOOK_TICKS, _nobody)
            gc.collect()
            blocks.append(sys.getallocatedblocks())
        return min(blocks), resident_bytes()


def resident_bytes() -> int:
    """Memory of this process that is in use; 0 where the system does not tell."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


def _nobody(tick: int) -> None:
    del tick
