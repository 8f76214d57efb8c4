"""Frames of the crosslink terminal into epochs: only complete ones, messages at their instant, all refusals counted."""

from __future__ import annotations

import math
from itertools import count

import numpy as np
import pytest
from harness import frame
from hypothesis import given
from hypothesis import strategies as st

from flightsw.crosslink.records import EPOCH
from flightsw.icd.can_frames import CROSSLINK_EPHEMERIS, CROSSLINK_RANGES
from flightsw.icd.enums import REJECT_CAUSES, RejectCause
from flightsw.icd.table_file import decode
from flightsw.sensing.crosslink_assembly import CrosslinkAssembly
from ground.tables.function_sets import build_function

T_NS = 1_230_000_000_000_000_000
S = 1_000_000_000
MU = 3.986004418e14
A_M = 25_508_000.0
RATE = math.sqrt(MU / A_M**3)
BYTE = st.integers(0, 255)


def on_circle(angle_rad: float) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity on a circular orbit in the xy plane, exact."""
    ahead = np.array([math.cos(angle_rad), math.sin(angle_rad), 0.0])
    beside = np.array([-math.sin(angle_rad), math.cos(angle_rad), 0.0])
    return A_M * ahead, A_M * RATE * beside


class Bench:
    """An assembly with nothing behind it. now_ns: onboard time, 0 unknown."""

    def __init__(self, **settings: float) -> None:
        self.rejected = [0] * REJECT_CAUSES
        self.now_ns = 0
        self.one_by_one = True  # each frame in a tick of its own
        table = decode(build_function("crosslink", "crosslink", overrides={"satellites": 8, **settings}))
        self.assembly = CrosslinkAssembly(table.values, self.rejected, lambda: self.now_ns)
        self.epoch = np.zeros(1, EPOCH)
        self._counter = count()

    @property
    def counts(self) -> dict[str, int]:
        return {cause.name: self.rejected[cause] for cause in RejectCause if self.rejected[cause]}

    def message(self, satellite: float, t_ns: int = T_NS, angle_rad: float = 0.0, **more: float) -> None:
        r, v = on_circle(angle_rad)
        values = {
            "t_ref_gps_ns": t_ns,
            **{f"{axis}_gcrf_m": x for axis, x in zip("xyz", r, strict=True)},
            **{f"v{axis}_gcrf_mps": x for axis, x in zip("xyz", v, strict=True)},
            "satellite": satellite,
            "healthy": 1,
            "issue": 7,
        }
        payload = frame(CROSSLINK_EPHEMERIS.frame_id, next(self._counter) & 0xFF, **{**values, **more})
        self.assembly.take_ephemeris(bytearray(payload))
        self._tick()

    def ranges(
        self, receiver: int, links: list[tuple[int, float]], total: int, t_ns: int = T_NS, **more: float
    ) -> None:
        values: dict[str, float] = {"t_gps_ns": t_ns, "receiver": receiver, "links_total": total, "sigma_m": 11.8}
        for place in range(5):
            sender, range_m = links[place] if place < len(links) else (255, 0.0)
            values |= {f"sender_{place + 1}": sender, f"range_{place + 1}_m": range_m}
        payload = frame(CROSSLINK_RANGES.frame_id, next(self._counter) & 0xFF, **{**values, **more})
        self.assembly.take_ranges(bytearray(payload))
        self._tick()

    def _tick(self) -> None:
        if self.one_by_one:
            self.assembly.assemble()

    def filled(self) -> np.void:
        assert self.assembly.ready
        self.assembly.fill(self.epoch)
        return self.epoch[0]

    def links(self) -> list[tuple[int, int, float]]:
        record = self.filled()
        return [
            (int(record["receiver"][k]), int(record["sender"][k]), float(record["range_m"][k]))
            for k in range(record["links"])
        ]


def test_an_epoch_is_complete_with_the_last_of_its_links_and_no_earlier() -> None:
    bench = Bench()
    bench.ranges(0, [(1, 1e7), (2, 2e7), (3, 3e7), (4, 4e7), (5, 5e7)], 8)
    bench.ranges(0, [(6, 6e7)], 8)
    assert not bench.assembly.ready
    bench.ranges(1, [(0, 1.5e7), (2, 2.5e7)], 8)
    assert bench.links() == [(0, s, s * 1e7) for s in range(1, 7)] + [(1, 0, 1.5e7), (1, 2, 2.5e7)]
    assert bench.counts == {}
    assert not bench.assembly.ready


def test_an_epoch_that_lacks_a_frame_is_dropped_whole_and_the_next_one_taken() -> None:
    """GIVEN an epoch of which one frame was lost WHEN the next begins THEN the first is counted and never judged."""
    bench = Bench()
    bench.ranges(0, [(1, 1e7)], 2)
    bench.ranges(0, [(1, 2e7)], 2, T_NS + S)
    assert not bench.assembly.ready
    bench.ranges(1, [(0, 3e7)], 2, T_NS + S)
    assert bench.links() == [(0, 1, 2e7), (1, 0, 3e7)]
    assert int(bench.epoch["t_gps_ns"][0]) == T_NS + S
    assert bench.counts == {"INCOMPLETE_EPOCH": 1}
    assert bench.assembly.incomplete == 1


def test_two_epochs_in_one_tick_leave_the_newer() -> None:
    bench = Bench()
    bench.ranges(0, [(1, 1e7)], 1)
    bench.ranges(0, [(1, 2e7)], 1, T_NS + S)
    assert bench.links() == [(0, 1, 2e7)]
    assert bench.counts == {"RECEIVE_OVERFLOW": 1}


@pytest.mark.parametrize(
    ("link", "more", "cause"),
    [
        ((1, math.nan), {}, "NOT_FINITE"),
        ((1, math.inf), {}, "NOT_FINITE"),
        ((1, 1e7), {"sigma_m": 26.0}, "SIGMA"),
        ((1, 1e7), {"sigma_m": 0.0}, "SIGMA"),
        ((1, 1e7), {"sigma_m": math.nan}, "NOT_FINITE"),
        ((0, 1e7), {}, "OUT_OF_RANGE"),  # of a satellite to itself
        ((8, 1e7), {}, "OUT_OF_RANGE"),  # no such satellite
    ],
)
def test_a_link_that_cannot_be_used_is_left_out_of_its_epoch(
    link: tuple[int, float], more: dict[str, float], cause: str
) -> None:
    bench = Bench()
    bench.ranges(0, [link], 2, **more)
    bench.ranges(2, [(3, 3e7)], 2)
    assert bench.links() == [(2, 3, 3e7)]
    assert bench.counts == {cause: 1}


@pytest.mark.parametrize("more", [{"links_total": 0}, {"links_total": 257}, {"two_way": 1}, {}])
def test_a_frame_that_is_none_of_this_constellation_begins_nothing(more: dict[str, float]) -> None:
    bench = Bench()
    bench.ranges(0 if more else 8, [(1, 1e7)], 1, **more)
    assert not bench.assembly.ready
    assert bench.counts == {"OUT_OF_RANGE": 1}


def test_the_same_link_twice_counts_once() -> None:
    bench = Bench()
    bench.ranges(0, [(1, 1e7), (1, 2e7), (2, 3e7)], 3)
    assert bench.links() == [(0, 1, 1e7), (0, 2, 3e7)]
    assert bench.counts == {"TIME_REPEATED": 1}


def test_epochs_of_another_time() -> None:
    """GIVEN onboard time WHEN an epoch is older than 3 s, or lies half a second ahead THEN it is refused; an epoch that
    was judged is not judged again; one a little older than that is late; one much older is a terminal begun anew."""
    bench = Bench()
    bench.now_ns = T_NS
    bench.ranges(0, [(1, 1e7)], 1, T_NS - 3 * S - 1)
    bench.ranges(0, [(1, 1e7)], 1, T_NS + S // 2 + 1)
    assert bench.counts == {"TIME_STALE": 1, "TIME_FUTURE": 1}
    bench.now_ns = 0
    bench.ranges(0, [(1, 1e7)], 1)
    bench.ranges(0, [(1, 1e7)], 1)
    bench.ranges(0, [(1, 1e7)], 1, T_NS - S)
    assert bench.counts == {"TIME_STALE": 2, "TIME_FUTURE": 1, "TIME_REPEATED": 1}
    assert bench.links() == [(0, 1, 1e7)]
    bench.ranges(0, [(1, 4e7)], 1, T_NS - 61 * S)
    assert bench.links() == [(0, 1, 4e7)]


def test_messages_are_brought_to_the_instant_of_the_epoch() -> None:
    """GIVEN messages up to five seconds old, or a second early, WHEN an epoch is complete THEN positions are those of
    the orbit at the epoch within a centimetre, clocks have run on; an older message stands for nobody."""
    bench = Bench()
    ages_s = (0.0, 1.0, 5.0, -1.0, 5.1)
    for satellite, age_s in enumerate(ages_s):
        bench.message(
            satellite, T_NS - round(age_s * S), 0.3 * satellite - RATE * age_s, clock_m=100.0, clock_rate_mps=0.5
        )
    bench.ranges(0, [(1, 1e7)], 1)
    record = bench.filled()
    assert record["known"][:6].tolist() == [1, 1, 1, 1, 0, 0]
    assert record["issue"][:4].tolist() == [7] * 4
    for satellite, age_s in enumerate(ages_s[:4]):
        r, v = on_circle(0.3 * satellite)
        assert record["r_m"][satellite] == pytest.approx(r, abs=0.01)
        assert record["v_mps"][satellite] == pytest.approx(v, abs=0.001)
        assert record["clock_m"][satellite] == pytest.approx(100.0 + 0.5 * age_s, abs=1e-9)


@pytest.mark.parametrize(
    ("more", "cause"),
    [
        ({"x_gcrf_m": math.nan}, "NOT_FINITE"),
        ({"clock_m": math.inf}, "NOT_FINITE"),
        ({"x_gcrf_m": 1e3}, "OUT_OF_RANGE"),
        ({"x_gcrf_m": 1e9}, "OUT_OF_RANGE"),
        ({"vx_gcrf_mps": 2e4}, "OUT_OF_RANGE"),
        ({"clock_m": 1e9}, "OUT_OF_RANGE"),
        ({"satellite": 8}, "OUT_OF_RANGE"),
        ({"t_ref_gps_ns": 0}, "OUT_OF_RANGE"),
    ],
)
def test_an_absurd_message_leaves_the_one_before_it(more: dict[str, float], cause: str) -> None:
    bench = Bench()
    bench.message(3, angle_rad=0.5)
    bench.message(**{"satellite": 3, **more})
    bench.ranges(0, [(1, 1e7)], 1)
    assert bench.filled()["r_m"][3] == pytest.approx(on_circle(0.5)[0], abs=1e-6)
    assert bench.counts == {cause: 1}


@given(
    st.lists(
        st.tuples(
            st.integers(-(2**63), 2**63 - 1) | st.integers(T_NS, T_NS + 3),
            *(st.floats(width=64) for _ in range(5)),
            st.floats(width=32),
            BYTE,
            *(BYTE for _ in range(5)),
            st.integers(0, 65535) | st.integers(0, 9),
            BYTE,
        ),
        max_size=12,
    ),
    st.lists(st.tuples(st.integers(-(2**63), 2**63 - 1), st.floats(width=64), st.floats(width=32), BYTE), max_size=4),
)
def test_any_content_is_taken_or_counted(
    ranges: list[tuple[float, ...]], messages: list[tuple[int, float, float, int]]
) -> None:
    """GIVEN frames of any content THEN nothing raises, and what an epoch holds are finite links of known numbers."""
    bench = Bench()
    names = [name for name in CROSSLINK_RANGES.field_names if name not in ("counter", "crc")]
    for t_ns, x, rate, satellite in messages:
        bench.message(satellite, t_ns, x_gcrf_m=x, clock_rate_mps=rate)
    for values in ranges:
        payload = frame(CROSSLINK_RANGES.frame_id, 0, **dict(zip(names, values, strict=True)))
        bench.assembly.take_ranges(bytearray(payload))
        bench.assembly.assemble()
        if bench.assembly.ready:
            record = bench.filled()
            n = int(record["links"])
            assert 0 <= n <= 256
            assert (record["receiver"][:n] < 8).all()
            assert (record["sender"][:n] < 8).all()
            assert np.isfinite(record["range_m"][:n]).all()
            assert np.isfinite(record["r_m"][:8]).all()


def test_frames_that_come_together_are_taken_in_order_whatever_their_number() -> None:
    """GIVEN 200 frames of 100 epochs in a tick THEN what waits, and what is counted, is as if they came one by one."""
    one_by_one, together = Bench(), Bench()
    together.one_by_one = False
    for bench in (one_by_one, together):
        bench.message(1, angle_rad=0.5)
        bench.message(9)
        for second in range(100):
            bench.ranges(0, [(1, 1e7 + second)], 2, T_NS + second * S)
            bench.ranges(2, [(1, 2e7), (1, 3e7)][: 2 - second % 2], 2, T_NS + second * S)
    together.assembly.assemble()
    assert together.links() == one_by_one.links() == [(0, 1, 1e7 + 99), (2, 1, 2e7)]
    assert together.epoch.tobytes() == one_by_one.epoch.tobytes()
    assert together.counts == one_by_one.counts
    assert together.counts["RECEIVE_OVERFLOW"] == 99
