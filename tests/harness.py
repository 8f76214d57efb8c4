"""A whole flight on a test's bench: simulated world, virtual bus, real main loop, tick by tick.

A test steps it, looks into any record between ticks, and puts frames of its own on the bus. What the navigation step
was told and what it said are recorded, so that two flights can be compared bit for bit.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any

import can
import numpy as np

import flightsw.main_loop
from flightsw import app
from flightsw.can_port import CanPort
from flightsw.clock import Clock, LockstepClock
from flightsw.icd import can_codec, mavlink
from flightsw.icd.can_frames import LAYOUTS
from flightsw.icd.enums import RejectCause
from flightsw.icd.table_file import TableImage, decode
from flightsw.journal import Journal
from flightsw.link.mavlink_out import Nowhere, Sink
from flightsw.provenance import identity
from flightsw.records import NAV, OUTPUT
from ground.tables.build import build_navigation
from ground.tables.earth_orientation import build_earth_orientation
from ground.tables.forces import build_force_tables
from hil_sim import scenario
from hil_sim.bus import VirtualBusPair
from hil_sim.scenario import LoadedScenario
from hil_sim.sil import function_tables
from hil_sim.world import World

NS = 1_000_000_000
HOUR_NS = 3600 * NS

# What a refused frame may never touch: time, state, covariances, bound, flag, stored dA.
STATE_FIELDS = (
    *("clock_valid", "clock_gps_ns", "clock_counter_ns", "clock_phase_ns", "clock_drift", "clock_p"),
    *("initialised", "t_gps_ns", "x", "P", "P_bound", "P_ahead", "P_bound_ahead", "pole", "row"),
    *("t_fix_gps_ns", "bound_own_m", "bound_own_3d_m", "bound_coast_m", "bound_coast_3d_m"),
    *("over_limit", "flag", "flag_age_s", "fixes_accepted"),
)


def load(*settings: str, name: str = "two_orbits") -> LoadedScenario:
    """A shipped scenario, a minute long and without an outage unless the settings say otherwise."""
    return scenario.load(name, ["time.duration_s=60", "outage=[]", *settings])


@lru_cache(maxsize=16)
def _orientation(start_gps_ns: int, stop_gps_ns: int) -> TableImage:
    return decode(build_earth_orientation(start_gps_ns, stop_gps_ns, None))


@lru_cache(maxsize=4)
def _forces(start_gps_ns: int) -> app.ForceTables:
    return app.ForceTables(*(decode(image) for image in build_force_tables(start_gps_ns)))


def tables(loaded: LoadedScenario) -> tuple[TableImage, TableImage]:
    """Navigation and Earth-orientation table of a scenario, as its run would fly them."""
    flight, start = loaded.scenario.flight, loaded.t_start_gps_ns
    stop = start + round(loaded.scenario.time.duration_s * NS)
    navigation = decode(build_navigation(flight.table_set, flight.table or None))
    return navigation, _orientation(start - HOUR_NS, stop + HOUR_NS)


def fault(kind: str, start_s: float, duration_s: float = 1.0, **more: Any) -> str:
    """One entry of a scenario's list of faults, as TOML."""
    keys = {"kind": kind, "start_s": float(start_s), "duration_s": float(duration_s), **more}
    pairs = [
        f'{key}="{value}"' if isinstance(value, str) else f"{key}={str(value).lower()}" for key, value in keys.items()
    ]
    return "{" + ", ".join(pairs) + "}"


def faults(*entries: str) -> str:
    """The setting that puts these faults into a scenario."""
    return f"fault=[{', '.join(entries)}]"


class Flight:
    """A world and a flight in lockstep; use as a context manager.

    `counts`: rejections by name of cause. `out`: the output record (1,) of the tick's last step. `flown`: OUTPUT of
    every tick so far. `published`: every frame flight sent. `bus` is flight's end, and fails when told to.
    """

    def __init__(
        self,
        loaded: LoadedScenario,
        folder: Path | None = None,
        sink: Sink | None = None,
        clock: Clock | None = None,
    ) -> None:
        self.loaded = loaded
        self.navigation, self.orientation = tables(loaded)
        self.period_ns = int(self.navigation.values["tick_period_ns"][0])
        self.world = World.build(loaded, self.period_ns)
        self.pair = VirtualBusPair()
        self.bus = FlakyBus(self.pair.flight)
        self.journal = Journal(folder)
        self.clock = clock if clock is not None else LockstepClock(self.world.counter0_ns)
        forces = _forces(loaded.t_start_gps_ns) if self.navigation.values["filter_model"][0] else None
        functions = [decode(image) for image in function_tables(loaded).values()]
        self.loop = app.build(
            self.navigation,
            self.orientation,
            self.clock,
            CanPort(self.bus.open),  # type: ignore[arg-type]
            self.journal,
            sink if sink is not None else Nowhere(),
            self.world.start_unix_ns,
            forces=forces,
            functions=functions,
        )
        self.forces, self.functions = forces, functions
        self.k = 0
        self.published: list[tuple[int, int, bytes]] = []  # tick, identifier, payload
        self.at_ticks = np.zeros(self.world.n_ticks, OUTPUT)
        self.fingerprints: list[int] = []  # of the state fields, one a tick

    def __enter__(self) -> Flight:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.journal.close()
        self.pair.close()

    @property
    def out(self) -> np.ndarray:
        return self.loop.memory.output

    @property
    def nav(self) -> np.ndarray:
        return self.loop.memory.nav

    @property
    def counts(self) -> dict[str, int]:
        """Rejections since start by name of cause, without the zeros."""
        counts = self.loop.rejected_by_cause()
        return {cause.name: counts[cause] for cause in RejectCause if counts[cause]}

    def put(self, frame_id: int, payload: bytes, **kind: Any) -> None:
        """Put a frame of the test's own on the bus."""
        keys: dict[str, Any] = {"is_extended_id": False, "is_fd": True, "bitrate_switch": True, **kind}
        self.pair.world.send(can.Message(arbitration_id=frame_id, data=payload, **keys), timeout=1.0)

    def tick(self, with_world: bool = True) -> None:
        """One tick: the world's frames (unless the test sends its own), flight, slack, and what flight published."""
        counter_ns = self.world.counter_ns(self.k)
        self.clock.wait_until(counter_ns)
        if with_world:
            self.world.send_due(self.k, self.pair.world, 0.0)
        self.loop.run_tick()
        self.loop.rest(counter_ns + self.period_ns)
        self.at_ticks[self.k] = self.out[0]
        self.fingerprints.append(state_fingerprint(self.nav))
        while (message := self.pair.world.recv(0.0)) is not None:
            self.published.append((self.k, message.arbitration_id, bytes(message.data)))
        self.k += 1

    def fly(self, until_s: float | None = None) -> Flight:
        """Tick to this age of the scenario, or to its end."""
        stop = self.world.n_ticks if until_s is None else min(self.world.n_ticks, round(until_s * NS / self.period_ns))
        while self.k < stop:
            self.tick()
        return self

    @property
    def flown(self) -> np.ndarray:
        """OUTPUT of the ticks flown so far (n,)."""
        return self.at_ticks[: self.k]

    @property
    def seconds(self) -> np.ndarray:
        """Age of the scenario at the ticks flown (n,) [s], nominal."""
        return np.arange(self.k) * (self.period_ns / NS)

    def error_m(self) -> np.ndarray:
        """Published position minus truth at the true instant of the tick, largest GCRF axis (n,) [m]."""
        return np.abs(self.flown["r_gcrf_m"] - self.world.r_true_gcrf_m[: self.k]).max(axis=1)


def save_run_tables(loaded: LoadedScenario, folder: Path) -> None:
    """Make a folder with the two tables of a scenario, and those of its functions."""
    build, start = loaded.scenario.flight, loaded.t_start_gps_ns
    folder.mkdir()
    (folder / app.NAVIGATION_FILE).write_bytes(build_navigation(build.table_set, build.table or None))
    stop = start + round(loaded.scenario.time.duration_s * NS)
    image = build_earth_orientation(start - HOUR_NS, stop + HOUR_NS, None)
    (folder / app.EARTH_ORIENTATION_FILE).write_bytes(image)
    if decode((folder / app.NAVIGATION_FILE).read_bytes()).values["filter_model"][0]:
        forces, field = build_force_tables(start)
        (folder / app.FORCES_FILE).write_bytes(forces)
        (folder / app.GRAVITY_FIELD_FILE).write_bytes(field)
    for kind, function in function_tables(loaded).items():
        (folder / f"{kind}.tbl").write_bytes(function)


def save_run(flight: Flight, folder: Path) -> Path:
    """Put beside the logs of a flight what a replay needs; returns the folder."""
    save_run_tables(flight.loaded, folder / "tables")
    (folder / "run.json").write_text(
        json.dumps(identity(flight.navigation, flight.orientation, *(flight.forces or ()), *flight.functions))
    )
    return folder


def flown(*settings: str, name: str = "two_orbits") -> Flight:
    """A scenario flown to its end; bus and journal are closed, the records remain."""
    with Flight(load(*settings, name=name)) as flight:
        return flight.fly()


def differing_fields(one: np.ndarray, other: np.ndarray, fields: Iterable[str] = STATE_FIELDS) -> list[str]:
    """Fields of two NAV records that are not the same bytes."""
    return [name for name in fields if one[name].tobytes() != other[name].tobytes()]


def state_fingerprint(nav: np.ndarray) -> int:
    """CRC-32 over the bits of the state fields of a NAV record."""
    return zlib.crc32(b"".join([nav[name].tobytes() for name in STATE_FIELDS]))


def whole_difference(one: np.ndarray, other: np.ndarray) -> list[str]:
    """All differing fields of two records of one kind, bit for bit."""
    return differing_fields(one, other, one.dtype.names or ())


class StepRecorder:
    """Keeps a copy of every input and output of the navigation step; put in its place with `install`."""

    def __init__(self) -> None:
        self._step = flightsw.main_loop.step
        self.inputs: list[bytes] = []
        self.outputs: list[bytes] = []

    def __call__(self, nav: np.ndarray, inputs: np.ndarray, *more: np.ndarray) -> None:
        self.inputs.append(inputs.tobytes())
        self._step(nav, inputs, *more)
        self.outputs.append(more[-1].tobytes())

    def install(self, monkeypatch: Any) -> StepRecorder:
        """From now on the loop calls this recorder, which calls the step."""
        monkeypatch.setattr(flightsw.main_loop, "step", self)
        return self


def reseal(frame_id: int, payload: bytes, counter: int | None = None) -> bytes:
    """The payload with a right CRC again, and with another alive counter if one is given."""
    layout = LAYOUTS[frame_id]
    buffer = bytearray(payload)
    can_codec.seal(layout, buffer, buffer[layout.counter_offset] if counter is None else counter)
    return bytes(buffer)


class FlakyBus:
    """A bus end that fails when told to: `fail(what)` makes the next `recv` or the n-th next `send` raise."""

    def __init__(self, inner: can.BusABC) -> None:
        self._inner = inner
        self._recv_error: Exception | None = None
        self._send_error: Exception | None = None
        self._sends_before = 0
        self.stays_down = False
        self.opened = 0
        self.shutdowns = 0

    def open(self) -> FlakyBus:
        """Flight's opener: refuses while `stays_down`."""
        if self.stays_down:
            raise can.CanInitializationError("no such device")
        self.opened += 1
        return self

    def fail_receiving(self, error: Exception) -> None:
        self._recv_error = error

    def fail_sending(self, error: Exception, after: int = 0) -> None:
        self._send_error, self._sends_before = error, after

    def recv(self, timeout: float | None = None) -> can.Message | None:
        error, self._recv_error = self._recv_error, None
        if error is not None:
            raise error
        return self._inner.recv(timeout)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self._send_error is not None:
            if self._sends_before == 0:
                error, self._send_error = self._send_error, None
                raise error
            self._sends_before -= 1
        self._inner.send(msg, timeout=timeout)

    def shutdown(self) -> None:
        self.shutdowns += 1


def frame(frame_id: int, counter: int = 0, **values: float) -> bytes:
    """A sealed frame of an identifier with these signals, the others zero."""
    layout = LAYOUTS[frame_id]
    buffer, record = can_codec.new_buffer(layout)
    for name, value in values.items():
        record[name] = value
    can_codec.seal(layout, buffer, counter)
    return bytes(buffer)


class Telemetry(list[Any]):
    """A sink that keeps every message, parsed by the generated dialect."""

    def __init__(self) -> None:
        super().__init__()
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = False

    def send(self, message: bytes | bytearray) -> None:
        """Called by flight with each packed message."""
        self.append(self._parser.parse_char(bytes(message)))

    def close(self) -> None:
        """Nothing to close."""

    def of(self, kind: str) -> list[Any]:
        """Messages of one type, in order."""
        return [message for message in self if message.get_type() == kind]


def read_tlog(path: Path) -> list[tuple[int, Any]]:
    """(Unix time [us], parsed message) of a link.tlog, read by its definition: `>Q` and a MAVLink 2 frame."""
    data, place, found = path.read_bytes(), 0, []
    parser = mavlink.MAVLink(None)
    while place < len(data):
        (unix_us,) = struct.unpack_from(">Q", data, place)
        length = 12 + data[place + 9] + (13 if data[place + 10] & 1 else 0)
        found.append((unix_us, parser.parse_char(data[place + 8 : place + 8 + length])))
        place += 8 + length
    return found


assert set(STATE_FIELDS) <= set(NAV.names or ())
