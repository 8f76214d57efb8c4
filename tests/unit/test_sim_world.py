"""The world's frames as the bus delivers them; the decoder here is struct by the DBC's published offsets."""

import struct
from binascii import crc_hqx

import can
import numpy as np
import pytest

from flightsw.icd.can_codec import new_buffer, seal
from flightsw.icd.can_frames import FLIGHT_HEARTBEAT, INTEGRITY, LAYOUTS, NAV_STATE
from hil_sim import scenario
from hil_sim.bus import Monitor, VirtualBusPair
from hil_sim.errors import BusError
from hil_sim.truth.satkit_data import satkit_time, session
from hil_sim.world import World

NS = 1_000_000_000
SYNC, POSITION, VELOCITY = 0x100, 0x110, 0x111


def build(*overrides: str) -> World:
    return World.build(scenario.load("two_orbits", ["time.duration_s=60", "outage=[]", *overrides]))


def fly(world: World) -> list[tuple[int, int, bytes]]:
    """(tick, identifier, payload) of everything flight would receive."""
    received = []
    with VirtualBusPair() as pair:
        for k in range(world.n_ticks):
            world.send_due(k, pair.world, 1e9 + k / 10)
            while (message := pair.flight.recv(0.0)) is not None:
                assert message.is_fd
                assert message.bitrate_switch
                assert message.timestamp == 1e9 + k / 10
                received.append((k, message.arbitration_id, bytes(message.data)))
    return received


def crc_is_right(frame_id: int, payload: bytes) -> bool:
    crc = crc_hqx(payload[:-2] + struct.pack("<H", LAYOUTS[frame_id].data_id), 0xFFFF)
    return struct.unpack("<H", payload[-2:])[0] == crc


def counters(received: list[tuple[int, int, bytes]], frame_id: int) -> list[int]:
    return [payload[-3] for _, i, payload in received if i == frame_id]


def test_every_epoch_arrives_once_in_order_and_after_its_latency() -> None:
    """GIVEN 0.2 s latency and a 10 Hz loop THEN pulse, position, velocity of second n come on the tick after."""
    world = build("gnss.latency_s=0.25", "oscillator.drift_ppm=0", "oscillator.random_walk=0")
    received = fly(world)
    assert [i for _, i, _ in received] == [SYNC, POSITION, VELOCITY] * 60
    assert [k for k, i, _ in received if i == POSITION] == [10 * n + 3 for n in range(60)]
    assert all(crc_is_right(i, payload) for _, i, payload in received)
    for frame_id in (SYNC, POSITION, VELOCITY):
        assert counters(received, frame_id) == list(range(60))


def test_content_of_a_fix() -> None:
    """Time stamps agree, the counter is the oscillator's, the position lies on the truth within its noise."""
    world = build("gnss.sigma_position_m=0", "gnss.sigma_velocity_mps=0", "oscillator.pulse_jitter_ns=0")
    received = fly(world)
    for n in (0, 37):
        t_true = world.t_start_gps_ns + n * NS
        _, _, sync = received[3 * n]
        _, _, position = received[3 * n + 1]
        _, _, velocity = received[3 * n + 2]
        t_sync, counter_sync, sigma_ns, leap, status = struct.unpack_from("<qqfbB", sync)
        t_fix, counter_fix, x, y, z = struct.unpack_from("<qqddd", position)
        t_velocity, vx, vy, vz = struct.unpack_from("<qddd", velocity)
        assert t_sync == t_fix == t_velocity == t_true
        assert counter_sync == counter_fix == world.oscillator.counter_ns(np.array([t_true]))[0]
        assert (sigma_ns, leap, status) == (1.0, 18, 1)
        r, v = world.truth.state_gcrf(np.array([t_true]))
        with session(t_true, t_true) as satkit:  # a second library takes the frame's numbers back to GCRF
            back_r, back_v = satkit.frametransform.itrf_to_gcrf_state(
                np.array([x, y, z]), np.array([vx, vy, vz]), satkit_time(satkit, t_true)
            )
        assert np.ravel(back_r) == pytest.approx(r[0], abs=1e-3)
        assert np.ravel(back_v) == pytest.approx(v[0], abs=2e-5)
        assert struct.unpack_from("<fffBB", position, 40) == (*[pytest.approx(1e-3)] * 3, 12, 3)


def test_ticks_follow_the_onboard_counter() -> None:
    """GIVEN a counter 100 ppm fast WHEN it has counted 60 s THEN 59.994 s of true time have passed."""
    world = build("oscillator.drift_ppm=100", "oscillator.random_walk=0")
    assert world.counter_ns(599) - world.counter_ns(0) == 599 * 100_000_000
    assert (world.t_true_gps_ns[599] - world.t_true_gps_ns[0]) / 1e9 == pytest.approx(59.9 / 1.0001, abs=1e-8)
    slow = build("oscillator.drift_ppm=-100", "oscillator.random_walk=0")
    assert slow.t_true_gps_ns[-1] > slow.t_start_gps_ns + 59.9 * NS
    assert len(slow.r_true_gcrf_m) == slow.n_ticks == 600


def test_nothing_reaches_flight_in_an_outage() -> None:
    """GIVEN an outage from 20 to 40 s and a frame held up for 5 s before it THEN the bus is silent in it."""
    world = build(
        "outage.0.start_s=20",
        "outage.0.duration_s=20",
        'fault=[{kind="late", start_s=18, duration_s=1, value=5}]',
    )
    seconds = {(world.t_true_gps_ns[k] - world.t_start_gps_ns) / 1e9 for k, _, _ in fly(world)}
    assert not [s for s in seconds if 20.0 <= s < 40.2]
    assert [s for s in seconds if s < 20.0]
    assert [s for s in seconds if s > 40.2]


def test_same_seed_same_frames() -> None:
    assert fly(build()) == fly(build())
    assert fly(build()) != fly(build("seed=2"))


def test_a_bus_nobody_drains_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil_sim.world.SEND_TIMEOUT_S", 0.01)
    monkeypatch.setattr("hil_sim.bus.RECEIVE_QUEUE_FRAMES", 5)
    world = build()
    with VirtualBusPair() as pair, pytest.raises(BusError, match="drains"):
        world.send_due(world.n_ticks - 1, pair.world, 0.0)


def test_every_run_has_a_channel_of_its_own() -> None:
    with VirtualBusPair() as one, VirtualBusPair() as other:
        one.world.send(can.Message(arbitration_id=1, data=b"x"), timeout=1.0)
        assert other.flight.recv(0.0) is None
        assert one.flight.recv(0.0) is not None


def test_a_frame_is_the_receivers_own_and_nobody_hears_himself() -> None:
    """GIVEN three ends of a bus WHEN one sends from a buffer and fills it again THEN both others have the frame as it
    was sent, each his own, and the sender has nothing."""
    with VirtualBusPair() as pair:
        third = pair.open_end()
        buffer = bytearray(b"before")
        sent = {"timestamp": 12.5, "arbitration_id": 0x123, "is_fd": True, "bitrate_switch": True}
        pair.flight.send(can.Message(data=buffer, is_extended_id=False, **sent))
        buffer[:] = b"after."
        heard = [end.recv(0.0) for end in (pair.world, third)]
        for message in heard:
            assert message is not None
            assert bytes(message.data) == b"before"
            assert {name: getattr(message, name) for name in sent} == sent
            assert not message.is_extended_id
            message.data[0] = 0
        assert pair.flight.recv(0.0) is None
        assert pair.world.recv(0.0) is None
        third.shutdown()
        pair.flight.send(can.Message(data=b"x"))
        for call in (lambda: third.recv(0.0), lambda: third.send(can.Message())):
            with pytest.raises(can.CanOperationError, match="closed"):
                call()


# -- monitor -------------------------------------------------------------------------------------------------


def publish(bus: can.BusABC, layout, counter: int = 0, **fields: float) -> None:
    buffer, record = new_buffer(layout)
    for name, value in fields.items():
        record[name] = value
    seal(layout, buffer, counter)
    bus.send(can.Message(arbitration_id=layout.frame_id, data=buffer, is_fd=True, is_extended_id=False), timeout=1.0)


def test_monitor_keeps_what_flight_said_by_tick(tmp_path) -> None:
    monitor = Monitor(5)
    with VirtualBusPair() as pair:
        for tick in (0, 1, 3):  # flight skipped tick 2
            publish(pair.flight, NAV_STATE, tick, x_gcrf_m=7e6 + tick, mode=1)
            publish(pair.flight, INTEGRITY, tick, bound_m=10.0 + tick, fix_age_s=0.2)
            publish(pair.flight, FLIGHT_HEARTBEAT, tick, tick=tick)
            assert monitor.drain(pair.world) == 3
    monitor.save(tmp_path / "monitor.npz")
    with np.load(tmp_path / "monitor.npz") as saved:
        assert saved["tick"].tolist() == [0, 1, 3]
        assert saved["nav"]["x_gcrf_m"].tolist() == [7e6, 7e6 + 1, 7e6 + 3]
        assert saved["integrity"]["bound_m"].tolist() == [10.0, 11.0, 13.0]
        assert saved["nav"].dtype == NAV_STATE.dtype
        assert saved["has_nav"].all()


def test_monitor_takes_nothing_on_trust() -> None:
    """A frame with a wrong CRC or length is counted, and its tick shows that nothing usable came."""
    monitor = Monitor(5)
    with VirtualBusPair() as pair:
        buffer, _ = new_buffer(NAV_STATE)
        seal(NAV_STATE, buffer, 0)
        buffer[3] ^= 1
        for data in (bytes(buffer), bytes(48)):
            pair.flight.send(
                can.Message(arbitration_id=0x200, data=data, is_fd=True, is_extended_id=False), timeout=1.0
            )
        publish(pair.flight, INTEGRITY, bound_m=1.0)
        publish(pair.flight, FLIGHT_HEARTBEAT, tick=0)
        monitor.drain(pair.world)
    records = monitor.records()
    assert monitor.bad_frames == 2
    assert records["has_nav"].tolist() == [False]
    assert records["has_integrity"].tolist() == [True]


def test_monitor_refuses_more_ticks_than_the_run_has() -> None:
    monitor = Monitor(1)
    with VirtualBusPair() as pair:
        for tick in range(2):
            publish(pair.flight, FLIGHT_HEARTBEAT, tick=tick)
        with pytest.raises(BusError, match="more than the 1 ticks"):
            monitor.drain(pair.world)
