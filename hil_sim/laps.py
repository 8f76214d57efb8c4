"""A scenario flown again and again: orbit, time and onboard counter go on, and the dice are thrown anew every lap.

Each lap is a scenario like any other, that begins where the one before has ended. At its beginning the receiver starts
again, and constellations stand where their pattern says: one more thing that flight must bear. Laps are prepared beside
flight, in a process of their own, so that what they need is none of flight's memory.
"""

from __future__ import annotations

import math
import multiprocessing
import signal
from collections.abc import Iterator
from datetime import datetime, timedelta
from multiprocessing.connection import Connection
from typing import NamedTuple

import msgspec
import numpy as np

from hil_sim.errors import SimulationError
from hil_sim.frames import FrameSeries, in_order
from hil_sim.gps_time import NS
from hil_sim.scenario import LoadedScenario
from hil_sim.scenario_schema import MU_EGM2008_M3PS2, Orbit
from hil_sim.sensors.oscillator import Oscillator
from hil_sim.sensors.streams import open_streams
from hil_sim.truth.interface import TrackTruth
from hil_sim.world import build_truth, sense

LAP_BRANCH = 1  # of a scenario's seed; the world's own is another
_GPS_EPOCH = datetime(1980, 1, 6)
_SPARE_S = 60.0


class Lap(NamedTuple):
    """What befalls flight in one lap of n ticks, m frames; the ticks are numbered through all laps.

    t_true_gps_ns (n,): true instants of the ticks; r_gcrf_m, v_gcrf_mps (n,3): truth there. due (n,): how many frames
    have arrived by each. frame_id (m,), payload: all of them end to end, frame i from ends[i] to ends[i + 1].
    """

    number: int
    first_tick: int
    t_true_gps_ns: np.ndarray
    r_gcrf_m: np.ndarray
    v_gcrf_mps: np.ndarray
    due: np.ndarray
    frame_id: np.ndarray
    ends: np.ndarray
    payload: bytes


class Start(NamedTuple):
    """What flight must know before the first lap: the onboard counter at the first tick, and the laps to come."""

    counter0_ns: int
    laps: int


def start_of(loaded: LoadedScenario, ticks: int, period_ns: int) -> Start:
    """Of a soak of so many ticks."""
    oscillator = _oscillator(loaded)
    counter0_ns = int(oscillator.counter_ns(np.array([loaded.t_start_gps_ns]))[0])
    return Start(counter0_ns, math.ceil(ticks * period_ns / (loaded.scenario.time.duration_s * NS) - 1e-9))


def laps(loaded: LoadedScenario, ticks: int, period_ns: int) -> Iterator[Lap]:
    """The laps of so many ticks in order; the last is as long as is needed. Raises SimulationError as a run does."""
    first_ns, lap_s = loaded.t_start_gps_ns, loaded.scenario.time.duration_s
    counter0_ns, count = start_of(loaded, ticks, period_ns)
    truth = build_truth(_lasting(loaded, ticks * period_ns / NS * (1.0 + 1e-4) + _SPARE_S))
    counter_ns, tick = counter0_ns, 0
    late: FrameSeries | None = None
    number = 0
    while tick < ticks:
        start_ns = first_ns + round(number * lap_s * NS)
        left_s = (ticks - tick) * period_ns / NS * (1.0 + 1e-4) + 1.0
        whole = number < count - 1 or left_s >= lap_s
        one = _at(loaded, number, start_ns, counter_ns, truth)
        if not whole:
            one = _lasting(one, max(left_s, 10.0))
        end_ns = start_ns + round(one.scenario.time.duration_s * NS)
        sensed = sense(one, truth, _silent)
        frames = sensed.frames.keep(sensed.frames.t_true_gps_ns < end_ns)
        if late is not None:
            frames = in_order([late, frames])
        # ticks by the onboard counter, which goes through all laps; the oscillator of a lap begins with its reading
        counters = counter0_ns + np.arange(tick, tick + (end_ns - start_ns) // period_ns + 1000) * period_ns
        t_true = sensed.oscillator.true_time_ns(counters)
        t_true = t_true[: min(int(np.searchsorted(t_true, end_ns)), ticks - tick)]
        due = np.searchsorted(frames.arrival_gps_ns, t_true, side="right")
        arrived = np.arange(len(frames.payload)) < due[-1]
        late, frames = frames.keep(~arrived), frames.keep(arrived)
        r, v = truth.state_gcrf(t_true)
        yield Lap(
            number,
            tick,
            t_true,
            r,
            v,
            due.astype(np.int64),
            np.array(frames.frame_id, np.int64),
            np.cumsum([0, *map(len, frames.payload)], dtype=np.int64),
            b"".join(frames.payload),
        )
        tick += len(t_true)
        number += 1
        counter_ns = int(sensed.oscillator.counter_ns(np.array([end_ns]))[0])


def _oscillator(loaded: LoadedScenario) -> Oscillator:
    duration_ns = round(loaded.scenario.time.duration_s * NS)
    stream = open_streams(loaded.scenario.seed).oscillator
    return Oscillator(loaded.scenario.oscillator, loaded.t_start_gps_ns, duration_ns, stream)


def _lasting(loaded: LoadedScenario, duration_s: float) -> LoadedScenario:
    time = msgspec.structs.replace(loaded.scenario.time, duration_s=duration_s)
    return loaded._replace(scenario=msgspec.structs.replace(loaded.scenario, time=time))


def _at(loaded: LoadedScenario, number: int, start_ns: int, counter_ns: int, truth: TrackTruth) -> LoadedScenario:
    """The scenario as it begins at another instant, on the truth there, with a seed of its own; the first is itself."""
    if number == 0:
        return loaded
    scenario = loaded.scenario
    began = _GPS_EPOCH + timedelta(microseconds=start_ns // 1000)
    seed = np.random.SeedSequence(scenario.seed, spawn_key=(LAP_BRANCH, number)).generate_state(1, np.uint64)[0]
    changed = msgspec.structs.replace(
        scenario,
        seed=int(seed) & (2**63 - 1),
        time=msgspec.structs.replace(scenario.time, start=began.isoformat(), scale="gps"),
        orbit=_osculating(scenario.orbit, truth, start_ns),
        oscillator=msgspec.structs.replace(scenario.oscillator, offset_s=counter_ns / 1e9),
    )
    return loaded._replace(scenario=changed)


def _osculating(orbit: Orbit, truth: TrackTruth, t_gps_ns: int) -> Orbit:
    """The orbit with the elements that place a pattern of satellites: size, plane and place of the truth."""
    r, v = (state[0] for state in truth.state_gcrf(np.array([t_gps_ns], np.int64)))
    radius, h = float(np.linalg.norm(r)), np.cross(r, v)
    node = np.array([-h[1], h[0], 0.0]) / math.hypot(h[0], h[1])
    beside = np.cross(h, node) / np.linalg.norm(h)
    return msgspec.structs.replace(
        orbit,
        period_s=None,
        semi_major_axis_m=1.0 / (2.0 / radius - float(v @ v) / MU_EGM2008_M3PS2),
        inclination_deg=math.degrees(math.acos(h[2] / float(np.linalg.norm(h)))),
        raan_deg=math.degrees(math.atan2(node[1], node[0])),
        argument_of_latitude_deg=math.degrees(math.atan2(float(r @ beside), float(r @ node))),
    )


class Prepared:
    """Laps of another process, one ahead of what is flown. Use as a context manager; `next` gives None at the end."""

    def __init__(self, loaded: LoadedScenario, ticks: int, period_ns: int) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_prepare, args=(theirs, loaded, ticks, period_ns), daemon=True)
        self._process.start()
        theirs.close()

    def next(self) -> Lap | None:
        """The next lap; waits for it. Raises SimulationError where it cannot be."""
        try:
            self._pipe.send(None)
            found = self._pipe.recv()
        except (EOFError, OSError) as error:
            raise SimulationError("the process that prepares the laps has died") from error
        if isinstance(found, SimulationError):
            raise found
        return found if isinstance(found, Lap) else None

    def __enter__(self) -> Prepared:
        return self

    def __exit__(self, *_: object) -> None:
        self._pipe.close()
        self._process.terminate()
        self._process.join()


def _prepare(pipe: Connection, loaded: LoadedScenario, ticks: int, period_ns: int) -> None:
    """A lap is made before it is asked for, and no second one before the first is taken."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # ctrl-C is flight's to answer
    try:
        for lap in laps(loaded, ticks, period_ns):
            pipe.recv()
            pipe.send(lap)
        pipe.recv()
        pipe.send(None)
    except SimulationError as error:
        pipe.recv()
        pipe.send(error)
    except (EOFError, OSError):
        return


def _silent(text: str) -> None:
    del text
