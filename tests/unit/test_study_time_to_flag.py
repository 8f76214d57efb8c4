"""`ground study time_to_flag`: what is summed up, and one of its flights."""

from __future__ import annotations

import math

import pytest

from ground.studies import time_to_flag
from ground.studies.time_to_flag import Found


def found(sun: str, day: str, *ages: tuple[float, float]) -> list[Found]:
    """Flights made up, one for each pair of ages."""
    return [Found(sun, day, 60 * k, 70.0, 4.0, pair) for k, pair in enumerate(ages)]


def test_the_least_age_decides() -> None:
    """GIVEN a quiet Sun that reaches all, beyond the horizon at 2000 m, and an active one with a phase that does not
    WHEN summed up THEN the least age of each is judged, and JSON knows no infinity."""
    quiet, active = time_to_flag.DAYS["solar minimum"][0], time_to_flag.DAYS["solar maximum"][0]
    every = [
        *found("solar minimum", quiet, (9500.0, math.inf), (8000.0, 120_000.0), (12_000.0, math.inf)),
        *found("solar maximum", active, (5500.0, 36_000.0), (3500.0, 30_000.0)),
    ]
    by = {(line["sun"], line["limit_m"]): line for line in time_to_flag.summarise(every)}
    assert by["solar minimum", 50.0]["reached"]
    assert not by["solar minimum", 50.0]["goal_reached"]
    assert by["solar minimum", 2000.0]["goal_reached"]
    assert by["solar minimum", 2000.0]["median_s"] is None
    assert not by["solar maximum", 50.0]["reached"]
    assert by["solar maximum", 2000.0]["least_s"] == 30_000.0
    flights = time_to_flag.as_document(every)["flights"]
    assert flights[0]["t_flag_s"] == [9500.0, None]


@pytest.mark.compiled
def test_a_satellite_at_500_km_flies_for_hours() -> None:
    """GIVEN two revolutions of fixes at a quiet Sun WHEN flight is asked at the loss THEN it has hours to 50 m, and
    to 2000 m several times as long."""
    task = time_to_flag.tasks()[0]
    to_50_s, to_2000_s = time_to_flag.fly(task).t_flag_s
    assert 7000.0 < to_50_s < 30_000.0
    assert to_2000_s > 3.0 * to_50_s
