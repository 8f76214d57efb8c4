"""A new navigation table in flight: staged, activated between ticks, on trial, confirmed or rolled back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from harness import Flight, load

from flightsw.icd.alerts import AlertId
from flightsw.icd.table_file import TableRefused, decode
from flightsw.tables import service as services
from flightsw.tables.service import OLDER_FILE, TAKEN_FILE, UPLOAD_FILE, TableService
from flightsw.tables.store import TableStore
from flightsw.tables.validate import Policy
from ground.tables.build import build_navigation

OLD = build_navigation("paper")
NEW = build_navigation("paper", {"limit_m": 1900.0})
TRIAL = 30


def equipped(flight: Flight, folder: Path, allow_saturating: bool = False) -> TableService:
    """The flight with a store in the folder and a service on it, as `flightsw run --table-store` has."""
    store = TableStore(folder, "navigation")
    store.begin_with(OLD, decode(OLD))
    memory = flight.loop.memory
    policy = Policy(allow_saturating=allow_saturating)
    service = TableService(
        flight.loop, memory.nav, memory.table, flight.navigation, policy, store, "a", folder, trial_ticks=TRIAL
    )
    flight.loop.keep_tables(service)
    return service


def happened(flight: Flight) -> list[str]:
    return [
        AlertId(int(event["alert_id"])).name
        for event in flight.loop.events.newest_first()[::-1]
        if AlertId(int(event["alert_id"])).name.startswith("TABLE_") and event["alert_id"] != AlertId.TABLE_UNCERTIFIED
    ]


def booted(folder: Path) -> int:
    found = TableStore(folder, "navigation").boot(decode)
    assert found is not None
    return found.table.crc32


def test_an_upload_is_staged_activated_tried_and_confirmed(tmp_path: Path) -> None:
    """GIVEN flight with fixes WHEN a table with another limit is put into the store's folder THEN it is told staged,
    then active from one whole tick on; the pointer moves only after the trial; what is read back is what was sent."""
    with Flight(load('flight.table_set="paper"')) as flight:
        service = equipped(flight, tmp_path)
        flight.fly(until_s=10.0)
        (tmp_path / UPLOAD_FILE).write_bytes(NEW)
        while not service.on_trial:
            flight.tick()
        assert (tmp_path / TAKEN_FILE).exists()
        flight.tick()
        assert happened(flight) == ["TABLE_STAGED", "TABLE_ACTIVATED"]
        assert booted(tmp_path) == decode(OLD).crc32
        for _ in range(TRIAL + 5):
            flight.tick()
        assert not service.on_trial
        assert booted(tmp_path) == decode(NEW).crc32
        assert service.dump() == NEW
        limits = flight.flown["limit_m"]
        change = int(np.flatnonzero(limits == 1900.0)[0])
        assert (limits[:change] == 2000.0).all()
        assert (limits[change:] == 1900.0).all()
        assert np.isfinite(flight.flown["bound_m"][change:]).all()
        flight.fly(until_s=20.0)
        assert happened(flight) == ["TABLE_STAGED", "TABLE_ACTIVATED"]


def test_an_older_or_bad_upload_is_refused_and_the_old_image_flies_on(tmp_path: Path) -> None:
    """GIVEN flight WHEN a damaged and a saturating table are sent THEN refused by event with the reason; every output
    is that of a flight to which nothing was sent."""
    with Flight(load('flight.table_set="paper"')) as plain, Flight(load('flight.table_set="paper"')) as flight:
        service = equipped(flight, tmp_path)
        reasons = []
        for second, raw in ((2.0, NEW[:-1]), (6.0, build_navigation("paper_table1"))):
            flight.fly(until_s=second)
            (tmp_path / OLDER_FILE).write_bytes(raw)
            flight.fly(until_s=second + 3.0)
            reasons.append(service.reason)
        plain.fly(until_s=9.0)
        assert "header announces" in reasons[0]
        assert "settles at 495 m" in reasons[1]
        assert happened(flight) == ["TABLE_REFUSED", "TABLE_REFUSED"]
        assert flight.flown.tobytes() == plain.flown.tobytes()
        with pytest.raises(TableRefused, match="no table is staged"):
            service.activate()
        assert booted(tmp_path) == decode(OLD).crc32


def test_a_table_that_fails_on_trial_is_rolled_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a table with which the bound cannot be computed WHEN it flies THEN within its trial the old table and the
    state of before are back, told; the bound is finite again and the pointer has not moved."""
    poison = build_navigation("paper", {"limit_m": 1800.0})
    with Flight(load('flight.table_set="paper"')) as flight:
        service = equipped(flight, tmp_path)
        flight.fly(until_s=10.0)
        before = flight.nav["x"][0].copy()
        # No range lets a table make NaN of a sound state; a fault in memory stands in for what nobody thought of.
        swap = flight.loop.fly_table

        def swap_and_break(table, last):
            swap(table, last)
            if table.crc32 == decode(poison).crc32:
                flight.nav["P"][0, 0, 0] = np.nan
                flight.nav["P_ahead"][0, 0, 0] = np.nan

        monkeypatch.setattr(flight.loop, "fly_table", swap_and_break)
        service.stage(poison, 1, activate=True)
        while not service.on_trial:
            flight.tick()
        for _ in range(TRIAL):
            flight.tick()
        assert not service.on_trial
        assert "rolled back" in service.reason
        assert happened(flight) == ["TABLE_STAGED", "TABLE_ACTIVATED", "TABLE_ROLLED_BACK"]
        assert service.dump() == OLD
        assert booted(tmp_path) == decode(OLD).crc32
        flight.fly(until_s=25.0)
        assert np.isfinite(flight.flown["bound_m"][-50:]).all()
        assert flight.loop.memory.nav["initialised"][0]
        assert np.abs(flight.nav["x"][0, :3] - before[:3]).max() > 0.0


def test_a_disk_that_fails_refuses_the_upload(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with Flight(load('flight.table_set="paper"')) as flight:
        service = equipped(flight, tmp_path)

        def full(*_: object) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(services.TableStore, "write", full)
        service.stage(NEW, 1, activate=True)
        flight.fly(until_s=2.0)
        assert "No space left on device" in service.reason
        assert happened(flight) == ["TABLE_REFUSED"]
        assert service.dump() == OLD
