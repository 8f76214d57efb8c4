"""GPS time of the simulator, against dates worked out by hand."""

from datetime import datetime

import numpy as np
import pytest

from hil_sim import gps_time


@pytest.mark.parametrize(
    ("moment", "scale", "expected_s"),
    [
        (datetime(1980, 1, 6), "gps", 0),
        (datetime(2019, 1, 1), "gps", 2034 * 604800 + 172800),  # GPS week 2034, Tuesday
        (datetime(2019, 1, 1), "utc", 2034 * 604800 + 172800 + 18),
        (datetime(2019, 1, 1), "tai", 2034 * 604800 + 172800 - 19),
        (datetime(2016, 12, 31), "utc", 1929 * 604800 + 518400 + 17),  # the day before the last leap second
    ],
)
def test_calendar(moment: datetime, scale: str, expected_s: int) -> None:
    assert gps_time.from_calendar(moment, scale) == expected_s * gps_time.NS


def test_leap_second_of_2017() -> None:
    before = gps_time.from_calendar(datetime(2016, 12, 31, 23, 59, 50), "utc")
    after = gps_time.from_calendar(datetime(2017, 1, 1), "utc")
    assert after - before == 11 * gps_time.NS
    assert gps_time.leap_seconds(before) == 17
    assert gps_time.leap_seconds(after) == 18


def test_unix_time_of_the_paper_scenario() -> None:
    """2019-01-01T00:00:00 GPS is 2018-12-31T23:59:42 UTC, Unix time 1546300782."""
    assert gps_time.to_unix_ns(gps_time.from_calendar(datetime(2019, 1, 1), "gps")) == 1_546_300_782 * gps_time.NS


def test_terrestrial_time_date() -> None:
    t = np.array([gps_time.from_calendar(datetime(2000, 1, 1, 12), "tai")]) - 32_184_000_000
    day, fraction = gps_time.tt_two_part(t)
    assert day[0] + fraction[0] == 2_451_545.0  # J2000.0
