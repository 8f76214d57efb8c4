"""What a navigation table must pass before it may be staged: every check, in the order of their cost."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import NamedTuple

from flightsw.icd.certificate import open_certificate
from flightsw.icd.table_checks import problems
from flightsw.icd.table_file import TableImage, TableRefused, decode
from flightsw.icd.table_saturation import saturation_in_slices
from flightsw.icd.table_schema import NAVIGATION
from flightsw.tables import stimulus

# What records, rates or the grid of epochs are laid out by: such a table flies after a restart only.
FIXED_IN_FLIGHT = ("tick_period_ns", "nav_step_ns", "coast_step_ns", "filter_model", "stored_da_bins")
# States that exist where this is not zero.
_STATES_OF = ("gnss_bias_sigma_m", "gnss_periodic_sigma_m")


class Policy(NamedTuple):
    """What the operator decided. key: tables must be signed with it. older: one older than the active is taken too."""

    key: bytes | None = None
    allow_saturating: bool = False
    older: bool = False


DEFAULT_POLICY = Policy()


def accept(raw: bytes, policy: Policy) -> TableImage:
    """A table that may fly from a start; TableRefused with the reason. Its stimulus is preflight's to replay."""
    return _drain(_accept(raw, policy))


def _drain(work: Generator[None, None, TableImage]) -> TableImage:
    while True:
        try:
            next(work)
        except StopIteration as end:
            table: TableImage = end.value
            return table


def _accept(raw: bytes, policy: Policy) -> Generator[None, None, TableImage]:
    table = decode(raw)
    if table.kind != NAVIGATION.name:
        raise TableRefused(f"holds a table of kind {table.kind}; {NAVIGATION.name} is needed here")
    if found := problems(table.kind, table.values):
        raise TableRefused("; also ".join(found))
    block = open_certificate(table, policy.key)
    if not policy.allow_saturating:
        age_s = float(block.values["certified_age_s"][0]) if block is not None else 0.0
        if found := (yield from saturation_in_slices(table.values, age_s)):
            raise TableRefused("; also ".join(found))
    return table


def accept_at_start(raw: bytes, policy: Policy) -> TableImage:
    """As `accept`, and its stimulus is replayed: the kernels must be warm."""
    table = accept(raw, policy)
    for _ in _replay(table):
        pass
    return table


def _replay(table: TableImage) -> Iterator[None]:
    block = open_certificate(table, None)
    if block is not None and block.stimulus:
        try:
            yield from stimulus.check_in_slices(block.stimulus, table.values)
        except stimulus.StimulusRefused as error:
            raise TableRefused(str(error)) from error


def accept_in_flight(
    raw: bytes, active: TableImage, t_now_gps_ns: int, policy: Policy
) -> Generator[None, None, TableImage]:
    """A table that may take the place of `active`, after a few milliseconds of work at each turn.

    Raises TableRefused with the reason. t_now_gps_ns: onboard time, 0 while it is not known.
    """
    table = yield from _accept(raw, policy)
    _check_validity(table, t_now_gps_ns)
    if not policy.older:
        _check_order(table, active)
    for name in FIXED_IN_FLIGHT:
        old, new = active.values[name][0], table.values[name][0]
        if old != new:
            raise TableRefused(f"{name} = {new}, active {old}: cannot change in flight; load it at a restart")
    for name in _STATES_OF:
        if (active.values[name][0] > 0.0) != (table.values[name][0] > 0.0):
            raise TableRefused(f"{name} brings or takes away filter states: cannot change in flight; restart with it")
    yield from _replay(table)
    return table


def _check_validity(table: TableImage, t_now_gps_ns: int) -> None:
    begin, end = table.valid_from_gps_ns, table.valid_to_gps_ns
    if not begin and not end:
        return
    if not t_now_gps_ns:
        raise TableRefused("has a validity, and onboard time is not known yet; send it again once it is")
    if t_now_gps_ns < begin:
        raise TableRefused(f"valid from {begin} GPS ns, now is {t_now_gps_ns}: not valid yet")
    if end and t_now_gps_ns > end:
        raise TableRefused(f"valid to {end} GPS ns, now is {t_now_gps_ns}: its validity has expired; build it anew")


def _check_order(table: TableImage, active: TableImage) -> None:
    """A table says how new it is by its certificate's time of issue, else by the begin of its validity."""
    new, old = _issued(table), _issued(active)
    if old and not new:
        raise TableRefused("carries no certificate, the active table does; say `older` to fly it all the same")
    if new < old or (new == old and table.valid_from_gps_ns < active.valid_from_gps_ns):
        raise TableRefused("is older than the active table; say `older` to fly it all the same")


def _issued(table: TableImage) -> int:
    block = open_certificate(table, None)
    return int(block.values["issued_gps_ns"][0]) if block is not None and block.grade else 0
