"""Rules between fields of a table: kept by every shipped set, enforced with names and remedy by ground and flight."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flightsw import app
from flightsw.icd.table_checks import HISTORY_EPOCHS, problems
from flightsw.icd.table_file import decode, encode
from flightsw.icd.table_schema import SCHEMAS
from flightsw.records import HISTORY
from ground.errors import OperatorError
from ground.tables.build import build_navigation, list_sets
from ground.tables.earth_orientation import build_earth_orientation
from ground.tables.forces import build_forces


def changed(image: bytes, **fields: Any) -> bytes:
    """A table with other values, whole and in range, as only a tool without the rules could make it."""
    table = decode(image)
    values = table.values.copy()
    for name, value in fields.items():
        values[name] = value
    return encode(table.kind, table.set_name, values)


def test_the_history_of_the_rules_is_that_of_the_records() -> None:
    assert HISTORY_EPOCHS == HISTORY


@pytest.mark.parametrize("name", list_sets())
def test_every_shipped_set_keeps_the_rules(name: str) -> None:
    table = decode(build_navigation(name))
    assert problems(table.kind, table.values) == []


def test_tables_without_rules_have_no_problems() -> None:
    assert problems("gravity_field", np.zeros(1, SCHEMAS["gravity_field"].dtype)) == []


NS = 1_000_000_000
BROKEN: list[tuple[dict[str, Any], list[str]]] = [
    ({"latency_max_s": 10.0, "nav_step_ns": NS // 2}, ["latency_max_s = 10 s", "nav_step_ns = 500000000", "5.5 s"]),
    ({"latency_max_s": 0.15}, ["latency_max_s = 0.15 s", "tick_period_ns = 100000000", "raise latency_max_s to 0.2"]),
    ({"tick_period_ns": NS}, ["latency_max_s = 1 s", "tick_period_ns = 1000000000", "1.1 at least"]),
    ({"limit_m": 100.0, "clear_limit_m": 100.5}, ["clear_limit_m = 100.5 m exceeds limit_m = 100 m", "lower"]),
    ({"overdue_s": 0.99}, ["overdue_s = 0.99 s", "nav_step_ns", "raise overdue_s to 1 at least"]),
    ({"overdue_s": 3.5}, ["overdue_s = 3.5 s exceeds autonomous_after_s = 3 s", "raise autonomous_after_s"]),
    ({"tick_period_ns": NS // 10 * 3, "latency_max_s": 2.0}, ["neither divides the other", "a multiple"]),
    ({"coast_step_ns": NS // 2}, ["coast_step_ns = 500000000", "0 for the same"]),
    ({"clock_start_pulses": 5, "clock_restart_pulses": 4}, ["clock_restart_pulses = 4 count", "0 for never"]),
    ({"clear_nis_low": 3.5}, ["clear_nis_low = 3.5 exceeds clear_nis_high = 3"]),
    ({"radius_min_m": 9.5e6}, ["radius_min_m = 9.5e+06 m exceeds radius_max_m = 9e+06 m"]),
    ({"latch_tolerance_s": 1e-8}, ["pulse_sigma_floor_s = 1e-07 s exceeds latch_tolerance_s = 1e-08 s"]),
]


@pytest.mark.parametrize(("fields", "said"), BROKEN, ids=[next(iter(fields)) for fields, _ in BROKEN])
def test_a_set_that_breaks_a_rule_is_refused_by_ground_and_by_flight(
    tmp_path: Path, fields: dict[str, Any], said: list[str]
) -> None:
    """GIVEN values that are each in range but not together WHEN ground builds, or flight loads what another tool built
    THEN it is refused with the names of the fields, their values and the remedy."""
    with pytest.raises(OperatorError) as by_ground:
        build_navigation("j2", fields)
    (tmp_path / app.NAVIGATION_FILE).write_bytes(changed(build_navigation("j2"), **fields))
    (tmp_path / app.EARTH_ORIENTATION_FILE).write_bytes(build_earth_orientation(1_300_000_000 * NS, 1_300_003_600 * NS))
    with pytest.raises(app.PreflightFailed) as by_flight:
        app.load_tables(tmp_path)
    assert app.NAVIGATION_FILE in str(by_flight.value)
    for text in said:
        assert text in str(by_ground.value)
        assert text in str(by_flight.value)


def test_every_broken_rule_is_told_at_once() -> None:
    with pytest.raises(OperatorError, match=r"overdue_s = 0\.5 .*also|also .*overdue_s = 0\.5 "):
        build_navigation("j2", {"overdue_s": 0.5, "clear_limit_m": 3000.0})


def test_the_ends_of_the_rules_are_allowed() -> None:
    fields = {"latency_max_s": 1.1, "nav_step_ns": NS // 10, "overdue_s": 0.1, "autonomous_after_s": 0.1}
    build_navigation("j2", {**fields, "clear_limit_m": 2000.0, "coast_step_ns": NS // 10, "clock_restart_pulses": 3})


def test_flight_refuses_forces_that_contradict_themselves(tmp_path: Path) -> None:
    image = changed(build_forces(), order=50, degree=20)
    assert problems("forces", decode(image).values) == ["order = 50 exceeds degree = 20; lower order or raise degree"]
    image = changed(build_forces(), valid_from_gps_ns=7, valid_until_gps_ns=7)
    (text,) = problems("forces", decode(image).values)
    assert "valid_from_gps_ns" in text
