"""What the ground may order of a flight, whatever the link it comes by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

from flightsw.icd.alerts import AlertId
from flightsw.icd.table_file import TableRefused
from flightsw.memory import Memory
from flightsw.nav.flight_model import FLIGHT
from flightsw.sensing.epoch_assembly import EpochAssembly
from flightsw.tables.service import TableService

NO_STATE = (-2, math.nan)  # what the step says of a tick without a state from the ground


class Obeying(Protocol):
    """The loop, as far as orders reach into it."""

    out: tuple[float, ...]
    out_reader: Any
    armed: bool
    restart: bool
    counter_ns: int
    memory: Memory
    tables: TableService | None

    def unix_ns(self) -> int:
        """Log time of the tick."""
        ...

    def note(self, alert: AlertId) -> None:
        """Tell this with the next alerts."""
        ...


class Orders:
    """Carries orders out. `upload`: the file of the navigation table that was sent up, None where none can be."""

    __slots__ = ("_assembly", "_loop", "_stage", "outcome", "upload")

    def __init__(self, loop: Obeying, assembly: EpochAssembly) -> None:
        self._loop = loop
        self._assembly = assembly
        self.upload: Path | None = None
        self._stage: bool | None = None  # older tables too; None: nothing is to be staged
        self.outcome = NO_STATE  # of a state that was sent up, told by the loop

    # -- what holds now

    @property
    def out(self) -> tuple[float, ...]:
        """The output record of the last navigation step."""
        return self._loop.out

    @property
    def armed(self) -> bool:
        """Whether a raised flag withdraws the state."""
        return self._loop.armed

    @property
    def counter_ns(self) -> int:
        """The onboard counter at this tick."""
        return self._loop.counter_ns

    def unix_ns(self) -> int:
        """Log time of the tick."""
        return self._loop.unix_ns()

    def table_state(self) -> int:
        """0 nothing new, 1 a table is staged, 2 the active one is on trial."""
        tables = self._loop.tables
        if tables is None:
            return 0
        return 2 if tables.on_trial else 1 if tables.staged is not None else 0

    def table_reason(self) -> str:
        """Why the last table was refused or rolled back."""
        return self._loop.tables.reason if self._loop.tables is not None else ""

    # -- orders

    def command_navigation(self, command: int, target: int, value: int) -> bool:
        """Give navigation an order with this tick; False where the tick is full."""
        return self._assembly.put_command(command, target, value)

    def edits_measurements(self) -> bool:
        """Whether the filter that flies edits types of measurements; the paper's does not."""
        return int(self._loop.memory.table["filter_model"][0]) == FLIGHT

    def upload_state(self, t_gps_ns: int, frame: int, state: Sequence[float], covariance: Sequence[float]) -> bool:
        """Give navigation a state with this tick: (6) and the upper triangle (21); False where the tick is full."""
        self.outcome = NO_STATE
        return self._assembly.put_upload(t_gps_ns, frame, state, covariance)

    def upload_outcome(self) -> tuple[int, float]:
        """What this tick's step said: RejectCause, -1 taken, -2 there was none; NIS against the state there was."""
        return self.outcome

    def arm_flag(self, armed: bool) -> None:
        """Whether a raised flag withdraws the state; a start always arms it."""
        self._loop.armed = armed

    def end_for_restart(self) -> None:
        """End after this tick, to be started again."""
        self._loop.restart = True

    def stage_upload(self, older: bool) -> None:
        """Hand what was sent up to validation, in the slack. Raises TableRefused where flight has no store."""
        self._tables()
        if self.upload is None:
            raise TableRefused("this flight takes no uploads")
        self._stage = older

    def work_slice(self) -> None:
        """Read an upload that is to be staged; a slack job."""
        if self._stage is None or self.upload is None:
            return
        older, self._stage = self._stage, None
        tables = self._tables()
        try:
            raw = self.upload.read_bytes()
        except OSError as error:
            tables.refuse(f"{self.upload.name}: cannot be read ({error.strerror}); send it up first")
            return
        tables.stage(raw, int(self.out[self._loop.out_reader.at["t_gps_ns"]]), older)

    def active_table(self) -> bytes:
        """The table that flies, as a file; empty where flight has no store."""
        return self._loop.tables.dump() if self._loop.tables is not None else b""

    def activate_table(self) -> None:
        """Fly the staged table before the next tick. Raises TableRefused where none is staged."""
        self._tables().activate()

    def roll_back_table(self) -> None:
        """Fly the table of before. Raises TableRefused where none is on trial."""
        self._tables().give_up_trial()

    def note_refused_orders(self) -> None:
        """Tell that orders were refused."""
        self._loop.note(AlertId.LINK_REFUSED)

    def _tables(self) -> TableService:
        if self._loop.tables is None:
            raise TableRefused("this flight has no store of tables")
        return self._loop.tables
