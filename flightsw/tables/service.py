"""A new navigation table in flight: validated and staged in the slack, activated between two ticks, on trial at first.

    upload -> STAGED (on disk, in the slot that does not fly) -> on trial -> confirmed, the pointer moves
       '-> refused                                                  '-> rolled back, with the state of before the swap

A table on trial that makes the bound incomputable or gives the state up is taken back. Until it is confirmed the
pointer names the old one: a table that brings flight down is not flown by the next start.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Protocol

import numpy as np

from flightsw.checkpoint import Capture, restore
from flightsw.icd.alerts import AlertId
from flightsw.icd.enums import FlagState
from flightsw.icd.table_file import TableImage, TableRefused, encode
from flightsw.tables.store import TableStore, other
from flightsw.tables.validate import DEFAULT_POLICY, Policy, accept_in_flight

TRIAL_TICKS = 600
_POLL_SLICES = 10  # looks for an upload
UPLOAD_FILE, OLDER_FILE, TAKEN_FILE = "upload.tbl", "upload.older.tbl", "upload.taken"
_DIVERGED_BIT = 1 << int(AlertId.DIVERGED)
# What was said to flight since the swap, and must outlive a roll-back.
_ORDERS = ("edit_ordered", "burn_id", "burn_frame", "burn_start_gps_ns", "burn_duration_ns", "burn_dv_mps")


class Flying(Protocol):
    """What the service needs of the loop."""

    def fly_table(self, table: TableImage, nav_row_last: int) -> None:
        """Take this table into use; called between two ticks."""

    def note(self, alert: AlertId) -> None:
        """Let this be told with the next tick."""


class TableService:
    """The active table, at most one that is staged or on trial, and the store they come from.

    nav, table_record: the records (1,) of flight's memory. `reason`: why the last upload was refused or rolled back.
    """

    def __init__(
        self,
        flying: Flying,
        nav: np.ndarray,
        table_record: np.ndarray,
        active: TableImage,
        policy: Policy = DEFAULT_POLICY,
        store: TableStore | None = None,
        slot: str = "a",
        upload_folder: Path | None = None,
        trial_ticks: int = TRIAL_TICKS,
    ) -> None:
        self._flying = flying
        self._nav = nav
        self._record = table_record
        self.active = active
        self.staged: TableImage | None = None
        self.before: TableImage | None = None  # flies again if the one on trial fails
        self.reason = ""
        self._policy = policy
        self._store = store
        self._slot = slot
        self._upload_folder = upload_folder
        self._trial_ticks = trial_ticks
        self._trial = 0  # ticks of the trial still to go
        self._had_state = False
        self._capture: Capture | None = None
        self._job: Iterator[None] | None = None
        self._swap = False
        self._give_up = False
        self._slices = 0

    @property
    def on_trial(self) -> bool:
        """Whether the active table has yet to prove itself."""
        return self.before is not None

    # -- orders

    def stage(self, raw: bytes, t_now_gps_ns: int, older: bool = False, activate: bool = False) -> None:
        """Begin to validate and store an upload; the slack goes on with it. activate: as soon as it is staged."""
        if self.on_trial:
            self.refuse("a table is on trial; send it again after that")
            return
        self.staged, self._swap = None, False
        self._job = self._stage(raw, t_now_gps_ns, self._policy._replace(older=older), activate)

    def activate(self) -> None:
        """Swap to the staged table before the next tick. Raises TableRefused where none is staged."""
        if self.staged is None:
            raise TableRefused("no table is staged")
        self._swap = True

    def give_up_trial(self) -> None:
        """Take the table on trial back before the next tick. Raises TableRefused where none is on trial."""
        if not self.on_trial:
            raise TableRefused("no table is on trial")
        self._give_up = True

    def dump(self) -> bytes:
        """The table that flies, as a file, read back from the record that the compiled step reads."""
        values = np.zeros(1, self.active.values.dtype)
        for name in values.dtype.names or ():
            values[name] = self._record[name]
        a = self.active
        return encode(a.kind, a.set_name, values, a.certificate, a.valid_from_gps_ns, a.valid_to_gps_ns)

    def read_back_differs(self) -> bool:
        """Whether what flies is not, byte for byte, the table that was accepted."""
        a = self.active
        return self.dump() != encode(
            a.kind, a.set_name, a.values, a.certificate, a.valid_from_gps_ns, a.valid_to_gps_ns
        )

    # -- between two ticks

    def between_ticks(self, flag: int, bound_m: float, happened: int) -> None:
        """Judge the trial by the tick that has passed, or carry out a swap. Cheap where there is nothing to do."""
        if self.before is not None:
            if self._give_up:
                self._roll_back("the ground asked for it")
                return
            self._judge(flag, bound_m, happened)
        elif self._swap and self.staged is not None:
            self._activate(self.staged, flag)

    def _activate(self, table: TableImage, flag: int) -> None:
        self._swap, self.staged = False, None
        self._had_state = bool(self._nav["initialised"][0]) and flag != FlagState.STALE
        if self._had_state:
            self._capture = Capture(self._nav, self.active.crc32)
            self._capture.take()
        self.before, self.active, self._give_up = self.active, table, False
        self._trial = self._trial_ticks
        self._flying.fly_table(table, int(table.values["tuning_rows"][0]) - 1)
        if self.read_back_differs():
            self._roll_back("read-back of the table differs from what was accepted")
            return
        self._flying.note(AlertId.TABLE_ACTIVATED)

    def _judge(self, flag: int, bound_m: float, happened: int) -> None:
        if self._had_state:
            if happened & _DIVERGED_BIT:
                self._roll_back("the state diverged on trial")
                return
            if flag == FlagState.STALE or not math.isfinite(bound_m):
                self._roll_back("the bound could not be computed on trial")
                return
        elif self._nav["initialised"][0]:
            self._had_state = True  # judged from the next tick on
            return
        else:
            return  # nothing is proven without a state
        self._trial -= 1
        if self._trial <= 0:
            self.before, self._capture = None, None
            if self._store is not None:
                self._job = self._confirm(self._store, other(self._slot), self.active)

    def _roll_back(self, reason: str) -> None:
        old = self.before
        assert old is not None
        self.reason = f"set {self.active.set_name}: rolled back: {reason}"
        self.active, self.before = old, None
        self._flying.fly_table(old, int(old.values["tuning_rows"][0]) - 1)
        if self._capture is not None:
            orders = {name: self._nav[name].copy() for name in _ORDERS}
            restore(self._nav, bytes(self._capture.image), old.crc32)
            for name, value in orders.items():
                self._nav[name] = value
            self._capture = None
        self._flying.note(AlertId.TABLE_ROLLED_BACK)

    # -- in the slack

    def work_slice(self, t_now_gps_ns: int) -> None:
        """A bounded part of what there is to do; looks for an upload now and then."""
        if self._job is not None:
            try:
                next(self._job)
            except StopIteration:
                self._job = None
            except TableRefused as error:
                self._job = None
                self.refuse(str(error))
            except OSError as error:
                self._job = None
                self.refuse(f"cannot be stored ({error.strerror})")
            return
        self._slices += 1
        if self._upload_folder is not None and self._slices % _POLL_SLICES == 0 and not self.on_trial:
            self._look_for_upload(self._upload_folder, t_now_gps_ns)

    def _look_for_upload(self, folder: Path, t_now_gps_ns: int) -> None:
        for name in (UPLOAD_FILE, OLDER_FILE):
            with suppress(OSError):
                raw = (folder / name).read_bytes()
                (folder / name).replace(folder / TAKEN_FILE)
                self.stage(raw, t_now_gps_ns, name == OLDER_FILE, activate=True)
                return

    def _stage(self, raw: bytes, t_now_gps_ns: int, policy: Policy, activate: bool) -> Iterator[None]:
        yield
        table = yield from accept_in_flight(raw, self.active, t_now_gps_ns, policy)
        yield
        if self._store is not None:
            yield from self._store.write(other(self._slot), raw)
            if self._store.path(other(self._slot)).read_bytes() != raw:
                raise TableRefused("what the disk holds is not what was written; send it again")
        self.staged, self._swap = table, activate
        self._flying.note(AlertId.TABLE_STAGED)

    def _confirm(self, store: TableStore, slot: str, table: TableImage) -> Iterator[None]:
        yield
        store.point(slot, table)
        self._slot = slot

    def refuse(self, reason: str) -> None:
        """Tell that an upload is not taken, and why."""
        self.reason = f"refused: {reason}"
        self._flying.note(AlertId.TABLE_REFUSED)
