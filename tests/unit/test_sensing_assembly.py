"""Frames into the inputs of the navigation step: every value at its place, only whole epochs, all refusals counted."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

import numpy as np
import pytest
from harness import frame
from hypothesis import given
from hypothesis import strategies as st

from flightsw.can_port import CanPort
from flightsw.icd.can_frames import ATTITUDE, BURN, GNSS_POSITION, GNSS_VELOCITY, NAV_COMMAND, TIME_SYNC
from flightsw.icd.enums import REJECT_CAUSES, FixType, RejectCause
from flightsw.icd.frame_layout import FrameLayout
from flightsw.journal import Journal
from flightsw.sensing.can_receiver import CanReceiver
from flightsw.sensing.epoch_assembly import EPOCHS, EpochAssembly

PRESENT = ("pulse_present", "fix_present", "burn_present", "attitude_present", "command_present")
INT64 = st.integers(-(2**63), 2**63 - 1)
BYTE = st.integers(0, 255)
F64 = st.floats(width=64)
F32 = st.floats(width=32)


class _Silence:
    def recv(self, timeout: float | None = None) -> None:
        del timeout

    def shutdown(self) -> None:
        """Nothing to shut down."""


class Bench:
    """Receiver and assembly with nothing behind them; alive counters run by themselves."""

    def __init__(self) -> None:
        self.rejected = [0] * REJECT_CAUSES
        self.assembly = EpochAssembly(self.rejected)
        port = CanPort(lambda: _Silence())  # type: ignore[arg-type, return-value]
        self.receiver = CanReceiver(port, Journal(None), self.assembly, self.rejected)
        self._counters: dict[int, Iterator[int]] = {}
        self.assembly.begin(1)

    def take(self, layout: FrameLayout, counter: int | None = None, **values: float) -> None:
        running = self._counters.setdefault(layout.frame_id, count())
        chosen = next(running) if counter is None else counter
        self.receiver.take(layout.frame_id, frame(layout.frame_id, chosen & 0xFF, **values))

    def row(self, index: int = 0) -> np.void:
        return self.assembly.inputs[index]

    def present(self) -> list[str]:
        """What the rows of this tick hold, in order."""
        return [name for row in self.assembly.inputs[: self.assembly.count] for name in PRESENT if row[name]]

    @property
    def counts(self) -> dict[str, int]:
        return {RejectCause(i).name: n for i, n in enumerate(self.rejected) if n}


@given(INT64, INT64, st.tuples(F64, F64, F64), st.tuples(F32, F32, F32), BYTE, BYTE)
def test_every_value_of_a_burn_arrives(
    start: int, duration: int, dv: tuple, sigma: tuple, axes: int, burn: int
) -> None:
    """GIVEN any content WHEN a BURN frame is taken THEN the step is told exactly that: judging is navigation's part."""
    bench = Bench()
    values = dict(zip(("dv_x_mps", "dv_y_mps", "dv_z_mps"), dv, strict=True))
    values |= dict(zip(("sigma_x_mps", "sigma_y_mps", "sigma_z_mps"), sigma, strict=True))
    bench.take(BURN, t_start_gps_ns=start, duration_ns=duration, frame=axes, burn_id=burn, **values)
    row = bench.row()
    assert bench.present() == ["burn_present"]
    assert (row["burn_start_gps_ns"], row["burn_duration_ns"]) == (start, duration)
    assert (row["burn_frame"], row["burn_id"]) == (axes, burn)
    np.testing.assert_array_equal(row["burn_dv_mps"], dv)
    np.testing.assert_array_equal(row["burn_sigma_mps"], sigma)


@given(INT64, st.tuples(F32, F32, F32, F32), F32)
def test_every_value_of_an_attitude_arrives(t: int, q: tuple, sigma: float) -> None:
    bench = Bench()
    bench.take(ATTITUDE, t_gps_ns=t, sigma_rad=sigma, **dict(zip(("q_w", "q_x", "q_y", "q_z"), q, strict=True)))
    row = bench.row()
    assert bench.present() == ["attitude_present"]
    assert row["attitude_gps_ns"] == t
    np.testing.assert_array_equal(row["attitude_q"], q)
    np.testing.assert_array_equal(row["attitude_sigma_rad"], sigma)


@given(BYTE, BYTE, BYTE)
def test_every_value_of_a_command_arrives(command: int, target: int, value: int) -> None:
    bench = Bench()
    bench.take(NAV_COMMAND, command=command, target=target, value=value)
    row = bench.row()
    assert bench.present() == ["command_present"]
    assert (row["command_id"], row["command_target"], row["command_value"]) == (command, target, value)


POSITION = {"t_gps_ns": 5, "t_counter_ns": 6, "x_itrf_m": 7e6, "sigma_x_m": 2.0, "satellites": 9}


def test_a_position_without_velocity_is_a_fix_by_itself() -> None:
    """GIVEN a GNSS_POSITION of POSITION_3D THEN the epoch is complete, and its velocity is no number."""
    bench = Bench()
    bench.take(GNSS_POSITION, fix_type=FixType.POSITION_3D, **POSITION)
    row = bench.row()
    assert bench.present() == ["fix_present"]
    assert row["fix_has_velocity"] == 0
    assert row["fix_type"] == FixType.POSITION_3D
    assert (row["fix_gps_ns"], row["fix_counter_ns"], row["fix_satellites"]) == (5, 6, 9)
    np.testing.assert_array_equal(row["fix_r_itrf_m"], (7e6, 0.0, 0.0))
    np.testing.assert_array_equal(row["fix_sigma_r_m"], (2.0, 0.0, 0.0))
    assert np.isnan(row["fix_v_itrf_mps"]).all()
    assert np.isnan(row["fix_sigma_v_mps"]).all()
    assert bench.counts == {}


def test_a_fix_with_its_velocity_says_so_also_where_a_position_alone_was_before() -> None:
    """GIVEN a tick with a position alone WHEN the next tick brings both halves THEN nothing of the former remains."""
    bench = Bench()
    bench.take(GNSS_POSITION, fix_type=FixType.POSITION_3D, **POSITION)
    bench.assembly.begin(2)
    bench.take(GNSS_POSITION, 1, fix_type=FixType.FIX_3D, **POSITION)
    assert bench.assembly.count == 0
    bench.take(GNSS_VELOCITY, 1, t_gps_ns=5, vx_itrf_mps=1.0, vy_itrf_mps=2.0, vz_itrf_mps=3.0, sigma_vx_mps=0.5)
    row = bench.row()
    assert row["fix_has_velocity"] == 1
    assert row["fix_type"] == FixType.FIX_3D
    np.testing.assert_array_equal(row["fix_v_itrf_mps"], (1.0, 2.0, 3.0))
    np.testing.assert_array_equal(row["fix_sigma_v_mps"], (0.5, 0.0, 0.0))
    bench.assembly.begin(3)
    bench.take(GNSS_POSITION, 2, fix_type=FixType.POSITION_3D, **POSITION)
    assert bench.row()["fix_has_velocity"] == 0
    assert np.isnan(bench.row()["fix_v_itrf_mps"]).all()


def test_a_position_alone_ends_the_wait_of_the_one_before_and_takes_no_velocity() -> None:
    """GIVEN a 3-D position that waits WHEN one without velocity comes THEN the first is counted as incomplete; the
    velocity that comes later finds no position."""
    bench = Bench()
    bench.take(GNSS_POSITION, 0, fix_type=FixType.FIX_3D, **POSITION)
    bench.take(GNSS_POSITION, 1, fix_type=FixType.POSITION_3D, **POSITION | {"t_gps_ns": 9})
    assert bench.counts == {"INCOMPLETE_EPOCH": 1}
    assert bench.row()["fix_gps_ns"] == 9
    for counter in (0, 1):  # of either position
        bench.take(GNSS_VELOCITY, counter, t_gps_ns=5 if counter == 0 else 9)
    assert bench.present() == ["fix_present"]
    assert bench.counts == {"INCOMPLETE_EPOCH": 2}


def test_a_new_tick_forgets_every_kind_of_epoch_and_keeps_the_order_of_arrival() -> None:
    """GIVEN one frame of each kind THEN one input each, as they came; WHEN the next tick begins THEN none is left."""
    bench = Bench()
    bench.take(NAV_COMMAND, command=1)
    bench.take(TIME_SYNC, status=1)
    bench.take(ATTITUDE, q_w=1.0)
    bench.take(GNSS_POSITION, fix_type=FixType.POSITION_3D, **POSITION)
    bench.take(BURN, burn_id=3)
    assert bench.present() == [f"{name}_present" for name in ("command", "pulse", "attitude", "fix", "burn")]
    bench.assembly.begin(77)
    assert bench.assembly.count == 0
    assert not any(bench.assembly.inputs[name].any() for name in PRESENT)
    assert (bench.assembly.inputs["counter_now_ns"] == 77).all()


@pytest.mark.parametrize("layout", [BURN, ATTITUDE, NAV_COMMAND], ids=lambda layout: layout.name)
def test_a_flood_of_a_kind_overflows_and_is_counted(layout: FrameLayout) -> None:
    """GIVEN 64 good frames of a kind in one tick THEN as many epochs as a tick can hold; the others are counted."""
    bench = Bench()
    for _ in range(64):
        bench.take(layout)
    assert bench.assembly.count == EPOCHS
    assert bench.counts == {"RECEIVE_OVERFLOW": 64 - EPOCHS}
    assert bench.receiver.accepted == 64


@pytest.mark.parametrize("layout", [BURN, ATTITUDE, NAV_COMMAND], ids=lambda layout: layout.name)
def test_a_repeated_and_a_skipped_counter_of_a_kind_are_counted(layout: FrameLayout) -> None:
    bench = Bench()
    for counter in (4, 4, 8):
        bench.take(layout, counter)
    assert bench.assembly.count == 2
    assert bench.counts == {"REPEATED_COUNTER": 1, "LOST_FRAMES": 3}
