"""Epochs of pseudoranges out of frames: only whole ones go on, whatever the order; everything else is counted."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightsw.icd.can_codec import new_buffer
from flightsw.icd.can_frames import GNSS_EPHEMERIS, GNSS_EPOCH, GNSS_RANGES
from flightsw.icd.enums import REJECT_CAUSES, RejectCause
from flightsw.icd.frame_layout import FrameLayout
from flightsw.icd.table_file import decode
from flightsw.pseudoranges.assembly import EPOCHS, RawAssembly
from flightsw.pseudoranges.latch import Latch
from flightsw.pseudoranges.settings import settings_of
from flightsw.pseudoranges.telling import single
from ground.tables.function_sets import build_function

NOW_NS = 10_000_000_000_000


def content(layout: FrameLayout, **values: Any) -> bytearray:
    buffer, record = new_buffer(layout)
    for name, value in values.items():
        record[name] = value
    return buffer


def ranges(t: int, *numbers: int) -> bytearray:
    rows = {f"satellite_{k}": number for k, number in enumerate(numbers)}
    rows |= {f"range_{k}_m": 2e7 + number for k, number in enumerate(numbers)}
    return content(GNSS_RANGES, t_gps_ns=t, count=len(numbers), **rows)


def end(t: int, count: int, counter_ns: int = NOW_NS - 1000) -> bytearray:
    return content(GNSS_EPOCH, t_gps_ns=t, t_counter_ns=counter_ns, count=count)


@pytest.fixture
def raw() -> RawAssembly:
    return RawAssembly([0] * REJECT_CAUSES, 1.0)


def counted(raw: RawAssembly) -> dict[str, int]:
    return {cause.name: raw._rejected[cause] for cause in RejectCause if raw._rejected[cause]}


def test_rows_of_several_frames_are_one_epoch(raw: RawAssembly) -> None:
    """GIVEN five satellites in two frames and the end THEN one epoch of five rows, as they were sent."""
    raw.take_ranges(ranges(5, 1, 2, 3))
    raw.take_ranges(ranges(5, 9, 8))
    raw.take_epoch(end(5, 5), NOW_NS)
    assert raw.count == 1
    epoch = raw.raws[0]
    assert (epoch["t_gps_ns"], epoch["t_counter_ns"], epoch["count"]) == (5, NOW_NS - 1000, 5)
    assert epoch["satellite"][:5].tolist() == [1, 2, 3, 9, 8]
    assert epoch["range_m"][:5].tolist() == [2e7 + n for n in (1, 2, 3, 9, 8)]
    assert counted(raw) == {}


def test_an_epoch_of_no_satellite_is_one(raw: RawAssembly) -> None:
    raw.take_epoch(end(5, 0), NOW_NS)
    assert raw.count == 1
    assert raw.raws["count"][0] == 0


@pytest.mark.parametrize("count", [2, 4, 0])
def test_a_wrong_count_is_no_epoch(raw: RawAssembly, count: int) -> None:
    raw.take_ranges(ranges(5, 1, 2, 3))
    raw.take_epoch(end(5, count), NOW_NS)
    assert raw.count == 0
    assert counted(raw) == {"INCOMPLETE_EPOCH": 1}


def test_an_epoch_that_waits_over_a_tick_is_whole(raw: RawAssembly) -> None:
    """GIVEN one epoch complete and the next begun WHEN the tick ends THEN the next is completed in the tick after."""
    raw.take_ranges(ranges(5, 1, 2, 3))
    raw.take_epoch(end(5, 3), NOW_NS)
    raw.take_ranges(ranges(6, 4, 5, 6))
    raw.clear()
    raw.take_ranges(ranges(6, 7))
    raw.take_epoch(end(6, 4, NOW_NS), NOW_NS)
    assert raw.count == 1
    assert raw.raws["satellite"][0, :4].tolist() == [4, 5, 6, 7]


def test_more_rows_than_an_epoch_holds_are_told_and_not_written(raw: RawAssembly) -> None:
    """GIVEN 99 satellites THEN the count says so, and the records behind are as they were."""
    before = raw.raws[1:].tobytes()
    for first in range(1, 100, 3):
        raw.take_ranges(ranges(5, first, first + 1, first + 2))
    raw.take_epoch(end(5, 99), NOW_NS)
    assert raw.raws["count"][0] == 99
    assert raw.raws[1:].tobytes() == before


def test_a_receiver_that_once_jumps_ahead_is_heard_again(raw: RawAssembly) -> None:
    """GIVEN an epoch stamped a century ahead THEN the next with a right stamp goes on; the same counter does not."""
    raw.take_epoch(end(2**62, 0, NOW_NS - 500), NOW_NS)
    raw.take_epoch(end(7, 0, NOW_NS - 400), NOW_NS)
    assert raw.count == 2
    raw.take_epoch(end(8, 0, NOW_NS - 400), NOW_NS)
    assert counted(raw) == {"TIME_REPEATED": 1}


def test_a_tick_holds_so_many_epochs(raw: RawAssembly) -> None:
    """GIVEN more whole epochs in a tick than it holds THEN the rest are counted and no held one is overwritten."""
    for k in range(EPOCHS + 2):
        raw.take_ranges(ranges(k + 1, k + 1))
        raw.take_epoch(end(k + 1, 1, NOW_NS - 100 + k), NOW_NS)
    assert raw.count == EPOCHS
    assert raw.raws["satellite"][:EPOCHS, 0].tolist() == [1, 2, 3, 4]
    assert counted(raw) == {"RECEIVE_OVERFLOW": 2}


def test_a_place_of_a_satellite_is_kept_until_it_is_withdrawn(raw: RawAssembly) -> None:
    """GIVEN a place WHEN one comes that is no number, or not to be used THEN there is none any longer."""
    values = {f"{axis}_itrf_m": 1e7 for axis in "xyz"} | {f"v{axis}_itrf_mps": 1e3 for axis in "xyz"}
    good = {"t_ref_gps_ns": 3, "satellite": 64, "constellation": 3, "status": 1, "issue": 7, **values}
    known = raw.ephemerides["known"][0]
    for change in ({"clock_m": np.nan}, {"status": 0}, {"x_itrf_m": np.inf}):
        raw.take_ephemeris(content(GNSS_EPHEMERIS, **good))
        assert known[3, 63] == 1
        raw.take_ephemeris(content(GNSS_EPHEMERIS, **good | change))
        assert known[3, 63] == 0
    for change in ({"satellite": 0}, {"satellite": 65}, {"constellation": 4}):
        raw.take_ephemeris(content(GNSS_EPHEMERIS, **good | change))
    assert known.sum() == 0
    assert counted(raw) == {"OUT_OF_RANGE": 3, "NOT_FINITE": 2}


@given(st.lists(st.tuples(st.integers(0, 2), st.binary(min_size=64, max_size=64)), max_size=40))
def test_no_frame_raises_or_leaves_its_place(frames: list[tuple[int, bytes]]) -> None:
    """GIVEN any bytes as any of the frames, in any order THEN nothing is raised, and counts stay in their bounds."""
    raw = RawAssembly([0] * REJECT_CAUSES, 1.0)
    for kind, data in frames:
        if kind == 0:
            raw.take_ranges(bytearray(data))
        elif kind == 1:
            raw.take_epoch(bytearray(data[: GNSS_EPOCH.length]), struct.unpack("<q", data[:8])[0])
        else:
            raw.take_ephemeris(bytearray(data))
        assert 0 <= raw.count <= EPOCHS
    raw.clear()
    assert set(np.unique(raw.ephemerides["known"]).tolist()) <= {0, 1}


@given(st.lists(st.booleans(), max_size=60), st.integers(1, 5), st.integers(1, 8))
def test_a_latch_changes_only_after_so_many_in_a_row(seen: list[bool], after: int, until: int) -> None:
    """GIVEN any history THEN what holds is what the last run that was long enough said."""
    latch = Latch(after, until)
    expected = False
    for k, now in enumerate(seen):
        latch.note(now)
        wanted = until if expected else after
        if len(seen[: k + 1]) >= wanted and all(one is not expected for one in seen[k + 1 - wanted : k + 1]):
            expected = not expected
        assert latch.holds is expected


def test_what_float32_cannot_hold_is_infinite() -> None:
    values = [single(value) for value in (1e300, 3.0, float("inf"))]
    assert struct.unpack("<3f", struct.pack("<3f", *values)) == (float("inf"), 3.0, float("inf"))
    assert np.isnan(single(float("nan")))


def test_the_shipped_set_states_the_priors_that_its_sources_give() -> None:
    """GIVEN the shipped set THEN its priors are those of the standards that it names, by constellation."""
    settings = settings_of(decode(build_function("gnss", "gnss")).values[0])
    assert settings.p_satellite == (1e-5, 1e-4, 3e-5, 1e-4)
    assert settings.p_constellation == (1e-8, 1e-4, 2e-4, 1e-4)
    assert settings.p_hmi == (1e-7, 1e-7, 1e-7)
    assert settings.protect
