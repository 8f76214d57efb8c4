"""Ticks that come late: counted and told, never caught up; and a paced run that keeps its pace."""

import time

import numpy as np
import pytest
from harness import Flight, Telemetry, load

from flightsw.clock import LockstepClock, PacedClock, RealTimeClock
from flightsw.icd.alerts import AlertId

PERIOD_NS = 100_000_000


class LateClock:
    """A real clock of the test's own: every reading costs 1 us, the n-th tick takes as long as `delays_ns[n]`."""

    lockstep = False

    def __init__(self, counter_ns: int, delays_ns: dict[int, int]) -> None:
        self.now_ns = counter_ns
        self.delays_ns = delays_ns
        self.waits = 0
        self.begun: list[int] = []

    def counter_ns(self) -> int:
        self.now_ns += 1000
        return self.now_ns

    def wait_until(self, counter_ns: int) -> None:
        self.now_ns = max(self.now_ns, counter_ns)
        self.begun.append(self.now_ns)
        self.now_ns += self.delays_ns.get(self.waits, 0)
        self.waits += 1


def fly(delays_ns: dict[int, int], ticks: int = 50) -> tuple[Flight, LateClock, Telemetry]:
    loaded = load()
    sink = Telemetry()
    clock = LateClock(5_000_000_000, delays_ns)
    with Flight(loaded, sink=sink, clock=clock) as flight:
        flight.loop.run(ticks)
    return flight, clock, sink


def test_ticks_in_time_slip_never() -> None:
    flight, clock, sink = fly(dict.fromkeys(range(50), 90000000))
    assert flight.loop.slips == 0
    assert np.diff(clock.begun) == pytest.approx(PERIOD_NS, abs=1e5)
    assert [m for m in sink.of("LEONAV_ALERT") if m.alert_id == AlertId.TICK_SLIP] == []


@pytest.mark.parametrize(
    ("delay_ns", "slips"), [(100_500_000, 1), (150_000_000, 1), (250_000_000, 2), (1_950_000_000, 19)]
)
def test_a_long_tick_is_counted_by_the_ticks_it_cost(delay_ns: int, slips: int) -> None:
    """GIVEN one tick that takes longer than its period THEN each tick that could not begin when due is one slip, the
    alert goes out with the next tick, and later ticks are on the old grid again.
    """
    flight, clock, sink = fly({10: delay_ns})
    assert flight.loop.slips == slips
    assert flight.loop.tick == 50
    told = [m for m in sink.of("LEONAV_ALERT") if m.alert_id == AlertId.TICK_SLIP]
    assert len(told) == 1
    grid = (np.array(clock.begun) - clock.begun[0]) / PERIOD_NS
    assert grid[:11] == pytest.approx(np.arange(11), abs=1e-3)
    assert grid[12:] == pytest.approx(np.arange(12, 50) + slips - 1, abs=1e-3)
    counted = [m.slips for m in sink.of("LEONAV_COUNTERS")]
    assert counted[0] == 0


def test_nothing_is_caught_up() -> None:
    """GIVEN a stall of two seconds THEN 50 ticks take two seconds longer: no burst of ticks makes good for it."""
    _, clock, _ = fly({10: 2_000_000_000})
    assert (clock.begun[-1] - clock.begun[0]) / 1e9 == pytest.approx(4.9 + 1.9, abs=0.11)
    gaps = np.diff(clock.begun)
    assert np.count_nonzero(gaps < 0.9 * PERIOD_NS) <= 1


def test_an_overload_is_a_slip_in_every_tick() -> None:
    """GIVEN ticks that always take one and a half periods THEN every tick slips, and telemetry shows it."""
    flight, _, sink = fly(dict.fromkeys(range(101), 150000000), ticks=101)
    assert flight.loop.slips >= 50
    assert sink.of("LEONAV_COUNTERS")[-1].slips > 20


def test_slack_ends_at_the_deadline() -> None:
    """GIVEN a tick that used its period up THEN no slack job runs before the next; with time left all of them run."""
    flight, _, _ = fly(dict.fromkeys(range(20), 200000000), ticks=20)
    assert flight.loop.schedule.summary()["journal"]["runs"] == 0
    flight, _, _ = fly({}, ticks=20)
    assert flight.loop.schedule.summary()["journal"]["runs"] == 20


def test_lockstep_never_slips() -> None:
    with Flight(load("time.duration_s=10"), clock=LockstepClock(7)) as flight:
        flight.loop.run(100)
    assert flight.loop.slips == 0


def test_paced_run_keeps_its_pace(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN 100 readings a tenth of a second apart at speed 50 THEN they last 0.2 s; a stall is counted in whole
    periods and pushes back what follows.
    """
    wall = Wall()
    monkeypatch.setattr("flightsw.clock.time", wall)
    clock = PacedClock(1000, PERIOD_NS, 50.0)
    for n in range(101):
        clock.wait_until(1000 + n * PERIOD_NS)
        assert clock.counter_ns() == 1000 + n * PERIOD_NS
    assert wall.now_ns / 1e9 == pytest.approx(0.2, abs=1e-3)
    assert clock.missed == 0
    wall.now_ns += 21_000_000  # ten and a half periods of 2 ms
    clock.wait_until(1000 + 101 * PERIOD_NS)
    assert clock.missed == 9
    clock.wait_until(1000 + 151 * PERIOD_NS)
    assert wall.now_ns / 1e9 == pytest.approx((151 + 9) * 0.002, abs=1e-3)


class Wall:
    """Stands for the time module: sleeping takes exactly as long as it should."""

    def __init__(self) -> None:
        self.now_ns = 0

    def monotonic_ns(self) -> int:
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9)


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan")])
def test_an_impossible_pace_is_refused(speed: float) -> None:
    with pytest.raises(ValueError, match="not positive"):
        PacedClock(0, PERIOD_NS, speed)


def test_real_time_clock_waits_for_its_reading() -> None:
    """The reading after a wait is never before the one waited for; a past one returns at once."""
    clock = RealTimeClock(10**15)
    target = clock.counter_ns() + 20_000_000
    clock.wait_until(target)
    assert clock.counter_ns() >= target
    before = time.monotonic_ns()
    clock.wait_until(0)
    assert time.monotonic_ns() - before < 1_000_000_000
