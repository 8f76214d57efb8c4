"""Every kind of fault does on the wire what its description says, and nothing outside its window."""

import struct
from pathlib import Path

import numpy as np
import pytest

from hil_sim import scenario
from hil_sim.bus import VirtualBusPair
from hil_sim.fault_kinds import KINDS
from hil_sim.world import World

NS = 1_000_000_000
SYNC, POSITION, VELOCITY = 0x100, 0x110, 0x111
WINDOW = range(20, 25)
Frames = list[tuple[int, int, bytes]]


def fly(*faults: str) -> tuple[World, Frames]:
    """(second of the run in which it arrives, identifier, payload) of every frame."""
    listed = ", ".join("{" + fault + "}" for fault in faults)
    world = World.build(
        scenario.load(
            "two_orbits",
            ["time.duration_s=60", "outage=[]", "oscillator.drift_ppm=0", f"fault=[{listed}]", "gnss.latency_s=0"],
        )
    )
    received = []
    with VirtualBusPair() as pair:
        for k in range(world.n_ticks):
            world.send_due(k, pair.world, 0.0)
            while (message := pair.flight.recv(0.0)) is not None:
                received.append((k // 10, message.arbitration_id, bytes(message.data)))
    return world, received


def of(received: Frames, frame_id: int) -> list[bytes]:
    return [payload for _, i, payload in received if i == frame_id]


def positions(received: Frames) -> np.ndarray:
    return np.array([struct.unpack_from("<ddd", p, 16) for p in of(received, POSITION)])


def velocities(received: Frames) -> np.ndarray:
    return np.array([struct.unpack_from("<ddd", p, 8) for p in of(received, VELOCITY)])


def times(received: Frames, frame_id: int) -> np.ndarray:
    return np.array([struct.unpack_from("<q", p)[0] for p in of(received, frame_id)])


@pytest.fixture(scope="module")
def clean() -> tuple[World, Frames]:
    return fly()


def window(kind: str, extra: str = "") -> str:
    return f'kind="{kind}", start_s=20, duration_s=5{extra}'


def test_position_and_velocity_steps(clean) -> None:
    _, received = fly(
        window("position_step", ', value=500, axis="z"'), window("velocity_step", ', value=-3, axis="all"')
    )
    moved = positions(received) - positions(clean[1])
    assert np.flatnonzero(moved.any(axis=1)).tolist() == list(WINDOW)
    assert moved[WINDOW] == pytest.approx(np.array([[0.0, 0.0, 500.0]] * 5), abs=1e-6)
    assert (velocities(received) - velocities(clean[1]))[WINDOW] == pytest.approx(-3.0, abs=1e-9)


@pytest.mark.parametrize(("kind", "rate_mps"), [("position_ramp", 0.0), ("consistent_ramp", 4.0)])
def test_a_ramp_grows_from_its_start_and_ends_with_its_window(clean, kind: str, rate_mps: float) -> None:
    """GIVEN 4 m/s for 5 s along z THEN 0, 4, 8, 12, 16 m in the window and nothing outside; the velocity is true with
    `position_ramp`, and the derivative of the drift with `consistent_ramp`."""
    _, received = fly(window(kind, ', value=4, axis="z"'))
    moved = positions(received) - positions(clean[1])
    faster = velocities(received) - velocities(clean[1])
    assert np.flatnonzero(moved.any(axis=1)).tolist() == list(WINDOW)[1:]
    assert moved[WINDOW, 2] == pytest.approx([0.0, 4.0, 8.0, 12.0, 16.0], abs=1e-6)
    assert not moved[:, :2].any()
    assert faster[WINDOW, 2] == pytest.approx(rate_mps, abs=1e-9)
    assert np.count_nonzero(faster) == (5 if rate_mps else 0)


def test_a_consistent_ramp_moves_as_its_own_velocity_says(clean) -> None:
    """GIVEN 60 s of a consistent ramp without noise THEN the positions are the integral of the velocities, as they are
    without it: the residual of Simpson's rule is the same."""

    def residual(fault: str) -> float:
        quiet = ["gnss.sigma_position_m=0", "gnss.sigma_velocity_mps=0", "outage=[]", "time.duration_s=60"]
        fixes = World.build(scenario.load("two_orbits", [*quiet, f"fault=[{fault}]"]))._fixes
        r, v = fixes.r_itrf_m[:, 0], fixes.v_itrf_mps[:, 0]
        return float(np.abs(r[2::2] - r[:-2:2] - (v[:-2:2] + 4.0 * v[1:-1:2] + v[2::2]) / 3.0).max())

    assert residual('{kind="consistent_ramp", start_s=0, duration_s=100, value=25}') < residual("") + 1e-6 < 1e-4
    assert residual('{kind="position_ramp", start_s=0, duration_s=100, value=25}') == pytest.approx(50.0, abs=1e-3)


def test_nan_and_absurd() -> None:
    _, received = fly(window("nan", ', axis="y", target="velocity"'), 'kind="absurd", start_s=40, value=1e300')
    assert np.isnan(velocities(received)[WINDOW, 1]).all()
    assert np.isfinite(positions(received)).all()
    assert positions(received)[40, 0] == 1e300


@pytest.mark.parametrize(("hold", "stamps"), [("false", 60), ("true", 55)])
def test_frozen_fix(clean, hold: str, stamps: int) -> None:
    _, received = fly(window("frozen_fix", f", hold_time={hold}"))
    assert (positions(received)[WINDOW] == positions(clean[1])[19]).all()
    assert len(set(times(received, POSITION))) == stamps
    assert positions(received)[25] == pytest.approx(positions(clean[1])[25], abs=0)


@pytest.mark.parametrize(
    ("fault", "fix_s", "sync_s"),
    [
        (window("time_jump", ", value=0.001"), 0.001, 0.001),
        (window("time_jump", ', value=1, target="sync"'), 0.0, 1.0),
        (window("sync_jump", ", value=1"), 0.0, 1.0),
        (window("leap_second"), 1.0, 1.0),
        (window("week_rollover"), -1024 * 604800.0, -1024 * 604800.0),
    ],
)
def test_wrong_times(clean, fault: str, fix_s: float, sync_s: float) -> None:
    _, received = fly(fault)
    for frame_id, expected in ((POSITION, fix_s), (VELOCITY, fix_s), (SYNC, sync_s)):
        shift = times(received, frame_id) - times(clean[1], frame_id)
        assert (shift[WINDOW] == round(expected * NS)).all()
        assert np.count_nonzero(shift) in (0, 5)


def test_leap_second_fault_also_announces_it() -> None:
    _, received = fly(window("leap_second"))
    announced = [struct.unpack_from("<b", p, 20)[0] for p in of(received, SYNC)]
    assert announced == [19 if n in WINDOW else 18 for n in range(60)]


def test_time_running_backwards() -> None:
    world, received = fly(window("time_backwards"))
    seconds = (times(received, POSITION) - world.t_start_gps_ns) // NS
    assert seconds[18:27].tolist() == [18, 19, 20, 19, 18, 17, 16, 25, 26]


def test_late_frames_arrive_later_and_out_of_order() -> None:
    world, received = fly(window("late", ", value=7"))
    arrived = {
        (t - world.t_start_gps_ns) // NS: s
        for s, t in zip([s for s, i, _ in received if i == POSITION], times(received, POSITION), strict=True)
    }
    assert {n: arrived[n] for n in (19, 20, 24, 25)} == {19: 19, 20: 27, 24: 31, 25: 25}


def counters(received: Frames, frame_id: int) -> list[int]:
    return [p[-3] for p in of(received, frame_id)]


def test_counters() -> None:
    """Standing still, jumping once, restarting at zero after a silence."""
    _, stood = fly(window("repeat_counter"))
    expected = [*range(20), *[19] * 5, *range(20, 55)]
    assert counters(stood, POSITION) == counters(stood, VELOCITY) == counters(stood, SYNC) == expected
    _, skipped = fly(window("skip_counter", ', value=3, target="velocity"'))
    assert counters(skipped, POSITION) == list(range(60))
    assert counters(skipped, VELOCITY) == [*range(20), *range(23, 63)]
    _, reset = fly(window("receiver_reset"))
    assert counters(reset, POSITION) == [*range(20), *range(35)]
    assert not [s for s, _, _ in reset if s in WINDOW]


def test_dropped_frames() -> None:
    _, received = fly('kind="frame_drop", start_s=0, duration_s=60, probability=0.5, target="velocity"')
    assert len(of(received, POSITION)) == 60
    assert 15 <= len(of(received, VELOCITY)) <= 45
    assert set(counters(received, VELOCITY)) < set(range(60))


def test_flipped_bits_and_truncation(clean) -> None:
    _, received = fly(window("bit_flip"), 'kind="truncate", start_s=40, value=12, target="position"')
    for frame_id in (SYNC, POSITION, VELOCITY):
        pairs = zip(of(received, frame_id), of(clean[1], frame_id), strict=True)
        flipped = [bin(int.from_bytes(a) ^ int.from_bytes(b)).count("1") if len(a) == len(b) else -1 for a, b in pairs]
        expected = [1 if n in WINDOW else 0 for n in range(60)]
        if frame_id == POSITION:
            expected[40] = -1
            assert len(of(received, POSITION)[40]) == 12
        assert flipped == expected


def test_a_fault_leaves_the_noise_of_all_others_alone(clean) -> None:
    """GIVEN a random fault WHEN another is put before it THEN the same receiver noise is drawn."""
    world, _ = fly(window("bit_flip", ", probability=0.3"), window("frame_drop", ", probability=0.3"))
    assert np.array_equal(world.truth_arrays()["fix_error_m"], clean[0].truth_arrays()["fix_error_m"])


def test_every_kind_is_exercised_here() -> None:
    text = Path(__file__).read_text(encoding="utf-8")
    assert [kind for kind in KINDS if f'"{kind}"' not in text] == []
