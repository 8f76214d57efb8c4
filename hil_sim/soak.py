"""A flight without an end: a scenario lap after lap in lockstep, and whether anything grows, slips or errs.

Composition root, like sil.py. After every lap stands a mark: memory, collector, slips, a digest of all that flight said
on CAN and MAVLink in that lap, and whether its bound held. In the end the beginning is flown once more by a new flight
in the aged process: it must say the same, to the last bit.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import can
import msgspec
import numpy as np

from flightsw import app
from flightsw.can_port import CanPort
from flightsw.clock import LockstepClock
from flightsw.icd.can_frames import CROSSLINK_STATUS
from flightsw.icd.enums import FlagState, RejectCause
from flightsw.icd.table_file import TableImage
from flightsw.journal import Journal
from flightsw.main_loop import MainLoop
from flightsw.onboard import Refused
from ground.errors import OperatorError
from ground.exit_status import STOPPED
from hil_sim import gps_time, sil, soak_report
from hil_sim.bus import SEND_TIMEOUT_S, Monitor, VirtualBusPair
from hil_sim.errors import BusError, ScenarioError
from hil_sim.evaluation import align
from hil_sim.laps import Lap, Prepared, start_of
from hil_sim.scenario import LoadedScenario

LOG_LIMIT_BYTES = 64 << 20
CHECKPOINT_S = 600.0
AGAIN_TICKS = 20_000  # of the beginning, flown again in the end
RESULT = "soak.json"
_TOLD_TICKS = 2000
_SPARE_S = 60.0
_CROSSLINK_ID = CROSSLINK_STATUS.frame_id


class Listener(Monitor):
    """The other onboard systems and the ground: takes a digest of every byte that flight says, in order."""

    def __init__(self, n_ticks: int) -> None:
        super().__init__(n_ticks)
        self.digest = hashlib.sha256()
        self.messages = 0

    def _accept(self, frame_id: int, data: bytearray) -> None:
        self.digest.update(frame_id.to_bytes(4, "little"))
        self.digest.update(data)
        if frame_id != _CROSSLINK_ID:  # which would be kept in a list that grows
            super()._accept(frame_id, data)


class _Downlink:
    """The sink of MAVLink messages: the present lap's listener."""

    def __init__(self) -> None:
        self.listener: Listener | None = None

    def send(self, message: bytes | bytearray) -> None:
        if self.listener is not None:
            self.listener.digest.update(message)
            self.listener.messages += 1

    def close(self) -> None:
        """Nothing to close."""


class Tables(NamedTuple):
    """All that flies."""

    navigation: TableImage
    orientation: TableImage
    forces: app.ForceTables | None
    functions: tuple[TableImage, ...]


class Flight:
    """World's bus, link and one main loop in lockstep."""

    def __init__(self, tables: Tables, counter0_ns: int, start_unix_ns: int, folder: Path | None) -> None:
        self.start_unix_ns, self.counter0_ns = start_unix_ns, counter0_ns
        self.pair, self.downlink, self.journal = VirtualBusPair(), _Downlink(), Journal(folder, LOG_LIMIT_BYTES)
        self.clock = LockstepClock(counter0_ns)
        self.loop: MainLoop = app.build(
            tables.navigation,
            tables.orientation,
            self.clock,
            CanPort(lambda: self.pair.flight),
            self.journal,
            self.downlink,
            start_unix_ns,
            forces=tables.forces,
            functions=tables.functions,
            checkpoints=None if folder is None else app.Checkpoints(folder / "soak.ckpt", CHECKPOINT_S),
        )

    def fly(self, lap: Lap, listener: Listener, stop: int, tell: Any) -> None:
        """Tick through the first `stop` ticks of a lap. What it says is the listener's."""
        loop, clock, bus, period_ns = self.loop, self.clock, self.pair.world, self.loop.period_ns
        self.downlink.listener = listener
        due, frame_id, ends, payload = lap.due, lap.frame_id, lap.ends, lap.payload
        sent = 0
        for k in range(stop):
            tick = lap.first_tick + k
            counter_ns = self.counter0_ns + tick * period_ns
            clock.wait_until(counter_ns)
            until = int(due[k])
            if sent < until:
                stamp_s = (self.start_unix_ns + tick * period_ns) * 1e-9
                edges = ends[sent : until + 1].tolist()
                for i, identifier in enumerate(frame_id[sent:until].tolist()):
                    message = can.Message(
                        timestamp=stamp_s,
                        arbitration_id=identifier,
                        is_extended_id=False,
                        is_fd=True,
                        bitrate_switch=True,
                        data=payload[edges[i] : edges[i + 1]],
                    )
                    try:
                        bus.send(message, timeout=SEND_TIMEOUT_S)
                    except can.CanError as error:
                        raise BusError(f"tick {tick}: the bus takes no frame ({error})") from None
                sent = until
            loop.run_tick()
            loop.rest(counter_ns + period_ns)
            listener.drain(bus)
            if k % _TOLD_TICKS == 0:
                tell(tick)

    def close(self) -> None:
        """Journal and bus."""
        self.journal.close()
        self.pair.close()


def run(loaded: LoadedScenario, out_dir: Path, ticks: int, expected: Path | None = None) -> int:
    """Fly so many ticks; leaves soak.json, brought up to date with every lap, and soak.md. Returns the exit status.

    0: flat, and all digests as they should be. 1: not. 130: stopped by hand; what was flown is told.
    expected: soak.json of another soak; the digests of the laps that both have must be the same.
    Raises SimulationError where scenario or tables do not allow it.
    """
    reference = _read(expected)
    soak_report.keep_large_blocks_apart()
    sil.prepare_folder(out_dir)
    (out_dir / RESULT).unlink(missing_ok=True)
    try:
        tables = _build_tables(loaded, ticks, out_dir / "tables")
    except (OperatorError, Refused, app.PreflightFailed) as error:
        raise ScenarioError(str(error)) from error
    period_ns = int(tables.navigation.values["tick_period_ns"][0])
    start = start_of(loaded, ticks, period_ns)
    unix_ns = gps_time.to_unix_ns(loaded.t_start_gps_ns)
    account = soak_report.Account(loaded.scenario.name, ticks, start.laps, period_ns)
    stopped = False
    with Prepared(loaded, ticks, period_ns) as prepared:
        _tell(f"{ticks:,} ticks of {loaded.scenario.name} in {start.laps:,} laps; compiling, and preparing the first")
        flight = Flight(tables, start.counter0_ns, unix_ns, out_dir)
        beginning: Lap | None = None
        try:
            while (lap := prepared.next()) is not None:
                if beginning is None:
                    beginning = _first_ticks(lap, min(AGAIN_TICKS, len(lap.due)))
                    account.began(flight.loop)
                _lap(flight, lap, account)
                del lap
                account.mark(flight.loop)
                _write(out_dir, account.found(flight.loop))
        except KeyboardInterrupt:
            stopped = True
        finally:
            flight.close()
    found = account.found(flight.loop)
    found["stopped_by_hand"] = stopped
    if beginning is not None and not stopped and account.marks:
        _tell("the beginning once more, by a new flight in this process")
        found["beginning_again"] = _again(tables, start.counter0_ns, unix_ns, beginning, account)
    counts = flight.loop.rejected_by_cause()
    found["rejected_by_cause"] = {cause.name: counts[cause] for cause in RejectCause if counts[cause]}
    found["expected"] = soak_report.compare(found, reference) if reference is not None else None
    found["failures"] = soak_report.failures(found)
    _write(out_dir, found)
    text = soak_report.render(found)
    (out_dir / "soak.md").write_text(text, encoding="utf-8")
    print(text)
    return STOPPED if stopped else int(bool(found["failures"]))


def _lap(flight: Flight, lap: Lap, account: soak_report.Account) -> None:
    """Fly a lap and enter what came of it."""
    listener = Listener(len(lap.due))
    before = account.blocks()
    began_s = time.perf_counter()
    first = min(AGAIN_TICKS, len(lap.due))

    def tell(tick: int) -> None:
        account.tell(tick, began_s, lap.first_tick)

    if lap.number == 0:
        flight.fly(lap, listener, first, tell)
        account.beginning = listener.digest.hexdigest()
        rest = _from(lap, first)
        flight.fly(rest, listener, len(rest.due), tell)
    else:
        flight.fly(lap, listener, len(lap.due), tell)
    account.flown_s += time.perf_counter() - began_s
    grown = account.blocks() - before
    truth = {
        "tick": np.arange(lap.first_tick, lap.first_tick + len(lap.due), dtype=np.int64),
        "t_true_gps_ns": lap.t_true_gps_ns,
        "r_gcrf_m": lap.r_gcrf_m,
        "v_gcrf_mps": lap.v_gcrf_mps,
    }
    record = align(truth, listener.records())
    guarded = record.offered & (record.flag == FlagState.CLEAR)
    account.enter(
        listener.digest.digest(),
        grown=grown,
        frames=int(lap.due[-1]),
        published=listener.received,
        messages=listener.messages,
        bad=listener.bad_frames,
        unheard=len(lap.due) - listener.rows,
        violations=int(np.count_nonzero(guarded & ~(record.bound_m >= record.error_m))),
        flagged=int(np.count_nonzero(record.flag != FlagState.CLEAR)),
        error_m=float(record.error_m[guarded].max(initial=0.0)),
    )


def _again(tables: Tables, counter0_ns: int, unix_ns: int, lap: Lap, account: soak_report.Account) -> dict[str, Any]:
    flight = Flight(tables, counter0_ns, unix_ns, None)
    try:
        listener = Listener(len(lap.due))
        flight.fly(lap, listener, len(lap.due), lambda tick: None)
    finally:
        flight.close()
    digest = listener.digest.hexdigest()
    return {"ticks": len(lap.due), "first": account.beginning, "again": digest, "same": digest == account.beginning}


def _first_ticks(lap: Lap, count: int) -> Lap:
    """The first ticks of a lap, with copies of what they need, so that the rest is let go."""
    frames = int(lap.due[count - 1])
    return lap._replace(
        t_true_gps_ns=lap.t_true_gps_ns[:count].copy(),
        r_gcrf_m=lap.r_gcrf_m[:count].copy(),
        v_gcrf_mps=lap.v_gcrf_mps[:count].copy(),
        due=lap.due[:count].copy(),
        frame_id=lap.frame_id[:frames].copy(),
        ends=lap.ends[: frames + 1].copy(),
        payload=lap.payload[: int(lap.ends[frames])],
    )


def _from(lap: Lap, first: int) -> Lap:
    """The ticks of a lap from one on."""
    frames = int(lap.due[first - 1])
    return lap._replace(
        first_tick=lap.first_tick + first,
        due=lap.due[first:] - frames,
        frame_id=lap.frame_id[frames:],
        ends=lap.ends[frames:],
    )


def _build_tables(loaded: LoadedScenario, ticks: int, folder: Path) -> Tables:
    """As for a run, for as long as the ticks last."""
    period_ns = int(sil.build_tables(loaded, folder)[0].values["tick_period_ns"][0])
    time_ = msgspec.structs.replace(loaded.scenario.time, duration_s=ticks * period_ns / gps_time.NS + _SPARE_S)
    lasting = loaded._replace(scenario=msgspec.structs.replace(loaded.scenario, time=time_))
    navigation, orientation, forces = sil.build_tables(lasting, folder)
    return Tables(navigation, orientation, forces, app.load_function_tables(folder))


def _read(path: Path | None) -> dict[str, Any] | None:
    if path is None:
        return None
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError) as error:
        raise ScenarioError(f"--expect {path}: cannot be read ({error}); give the soak.json of another soak") from None


def _write(folder: Path, found: dict[str, Any]) -> None:
    fresh = folder / f"{RESULT}.new"
    # not indented: that encoder leaves cycles behind for the collector
    fresh.write_text(json.dumps(found) + "\n", encoding="utf-8")
    os.replace(fresh, folder / RESULT)


def _tell(text: str) -> None:
    print(f"soak: {text}", file=sys.stderr, flush=True)
