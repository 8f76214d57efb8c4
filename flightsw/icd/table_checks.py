"""What the fields of a table must be together: rules that no range of a single field can say.

Ground applies them when it builds a table, flight when it loads one. Each rule names its fields, what they are, and
what to change. Values must be within their ranges already (table_file.check_ranges).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

from flightsw.icd.table_schema import CROSSLINK, FORCES, NAVIGATION, VELOCITY_CHECK

# Grid epochs that flight keeps for late fixes; a test holds it equal to flightsw.records.HISTORY.
HISTORY_EPOCHS = 12
# What a receiver needs, beside the wait for the next tick, to compute a fix and send it.
RECEIVER_MARGIN_S = 0.1

_KNOWN = (NAVIGATION, FORCES, CROSSLINK, VELOCITY_CHECK)
_UNITS = {field.name: field.unit for schema in _KNOWN for field in schema.fields}


def problems(kind: str, values: np.ndarray) -> list[str]:
    """Every rule that a table breaks, in words; empty for a sound one. values: shape (1,), dtype of the schema."""
    rules = _RULES.get(kind)
    return list(rules(values[0])) if rules else []


def _said(record: np.void, name: str) -> str:
    return f"{name} = {record[name]:g} {_UNITS[name]}".removesuffix(" 1")


def _ordered(record: np.void, low: str, high: str, strictly: bool = False) -> Iterator[str]:
    if record[low] > record[high]:
        yield f"{_said(record, low)} exceeds {_said(record, high)}; lower {low} or raise {high}"
    elif strictly and record[low] == record[high]:
        yield f"{_said(record, low)} is that of {high}; lower {low} or raise {high}"


def _navigation(record: np.void) -> Iterator[str]:
    for low, high in (
        ("clear_limit_m", "limit_m"),
        ("clear_nis_low", "clear_nis_high"),
        ("radius_min_m", "radius_max_m"),
        ("overdue_s", "autonomous_after_s"),
        ("pulse_sigma_floor_s", "latch_tolerance_s"),
    ):
        yield from _ordered(record, low, high)
    yield from _rows(record)
    yield from _grid(record)
    if 0 < record["clock_restart_pulses"] < record["clock_start_pulses"]:
        yield (
            f"{_said(record, 'clock_restart_pulses')} is fewer than {_said(record, 'clock_start_pulses')}: "
            "time would be restarted by less than first sets it; raise clock_restart_pulses, or give 0 for never"
        )


def _rows(record: np.void) -> Iterator[str]:
    sigmas = [float(sigma) for sigma in record["tuning_sigma_fix_m"][: int(record["tuning_rows"])]]
    if any(b <= a for a, b in pairwise(sigmas)):
        yield f"tuning: sigma_fix_m must rise from row to row, is {sigmas}; put the rows in order"


def _grid(record: np.void) -> Iterator[str]:
    tick_ns, step_ns, coast_ns = (int(record[name]) for name in ("tick_period_ns", "nav_step_ns", "coast_step_ns"))
    tick_s, step_s = tick_ns * 1e-9, step_ns * 1e-9
    latency_s = float(record["latency_max_s"])
    reach_s = (HISTORY_EPOCHS - 1) * step_s
    if latency_s > reach_s:
        yield (
            f"{_said(record, 'latency_max_s')} reaches behind the {HISTORY_EPOCHS} epochs that flight keeps of "
            f"nav_step_ns = {step_ns}: {reach_s:g} s; lower latency_max_s or raise nav_step_ns"
        )
    least_s = tick_s + RECEIVER_MARGIN_S
    if latency_s < least_s - 1e-9:
        yield (
            f"{_said(record, 'latency_max_s')} is less than tick_period_ns = {tick_ns} and {RECEIVER_MARGIN_S:g} s of "
            f"the receiver: a fix that waits for its tick would be stale; raise latency_max_s to {least_s:g} at least"
        )
    if max(tick_ns, step_ns) % min(tick_ns, step_ns):
        yield (
            f"tick_period_ns = {tick_ns} and nav_step_ns = {step_ns}: neither divides the other, so ticks would differ "
            "in the epochs they hold; make one a multiple of the other"
        )
    if 0 < coast_ns < step_ns:
        yield (
            f"coast_step_ns = {coast_ns} is shorter than nav_step_ns = {step_ns}; give at least that, or 0 for the same"
        )
    if record["overdue_s"] < step_s:
        yield (
            f"{_said(record, 'overdue_s')} is shorter than nav_step_ns = {step_ns}: every fix would be overdue before "
            f"its epoch; raise overdue_s to {step_s:g} at least"
        )


def _forces(record: np.void) -> Iterator[str]:
    yield from _ordered(record, "order", "degree")
    yield from _ordered(record, "valid_from_gps_ns", "valid_until_gps_ns", strictly=True)


def _crosslink(record: np.void) -> Iterator[str]:
    for name in ("own", "faulty_max"):
        if record[name] >= record["satellites"]:
            yield f"{name} = {record[name]} is not below satellites = {record['satellites']}; lower {name}"
    for low, high in (("epoch_s", "gap_max_s"), ("radius_min_m", "radius_max_m")):
        yield from _ordered(record, low, high)
    yield from _ordered(record, "epoch_s", "silence_max_s", strictly=True)


def _velocity_check(record: np.void) -> Iterator[str]:
    yield from _ordered(record, "clear", "threshold", strictly=True)
    yield from _ordered(record, "reference", "step_max", strictly=True)


_RULES: dict[str, Callable[[np.void], Iterator[str]]] = {
    NAVIGATION.name: _navigation,
    FORCES.name: _forces,
    CROSSLINK.name: _crosslink,
    VELOCITY_CHECK.name: _velocity_check,
}
