"""A journal flown again: identical where code and tables are, refused in words where they are not."""

import json
from collections.abc import Callable
from pathlib import Path

import can
import pytest
from harness import Flight, fault, faults, frame, load, save_run

from flightsw import __main__ as command_line
from flightsw import provenance, replay
from flightsw.journal import candump_line

FAULTS = {
    "late frames": fault("late", 15, 10, value=0.9),
    "very late frames": fault("late", 15, 10, value=4.0),
    "dropped frames": fault("frame_drop", 10, 30, probability=0.5),
    "dropped positions": fault("frame_drop", 10, 30, probability=0.5, target="position"),
    "flipped bits": fault("bit_flip", 10, 30, probability=0.7),
    "truncated frames": fault("truncate", 10, 5, value=12),
    "nothing left of the frames": fault("truncate", 10, 5, value=0),
    "numbers that are none": fault("nan", 10, 5, axis="all"),
    "absurd numbers": fault("absurd", 10, 5, value=1e300),
    "repeated counters": fault("repeat_counter", 10, 5),
    "receiver reset": fault("receiver_reset", 10, 5),
    "time backwards": fault("time_backwards", 10, 5),
    "restart from fixes": fault("position_step", 10, 40, value=5000.0),
}


def assert_replays(run_dir: Path, ticks: int) -> None:
    outcome = replay.replay(run_dir, run_dir / "again")
    assert outcome == (ticks, None, None)


@pytest.mark.parametrize("name", FAULTS)
def test_replay_is_identical(tmp_path: Path, name: str) -> None:
    """GIVEN a run with a fault on the way to flight WHEN its journal is flown again THEN the same bytes go out."""
    with Flight(
        load("time.duration_s=45", "outage=[{start_s=25.0, duration_s=6.0}]", faults(FAULTS[name])), tmp_path
    ) as flight:
        flight.fly()
    assert_replays(save_run(flight, tmp_path), 450)


def fly_with(folder: Path, meddle: Callable[[Flight], None], *settings: str) -> Flight:
    with Flight(load("time.duration_s=20", *settings), folder) as flight:
        while flight.k < flight.world.n_ticks:
            meddle(flight)
            flight.tick()
    return flight


def test_burns_attitudes_and_commands_are_in_the_journal(tmp_path: Path) -> None:
    """GIVEN frames of these kinds, good and damaged THEN the journal holds each as it came, in its place, and flown
    again the same bytes go out."""
    put: list[str] = []

    def meddle(flight: Flight) -> None:
        k = flight.k
        for frame_id, every, values in (
            (0x120, 23, {"t_start_gps_ns": 1_230_000_000_000_000_000 + k, "dv_y_mps": 0.25, "burn_id": k % 7}),
            (0x130, 10, {"t_gps_ns": 1_230_000_000_000_000_000 + k, "q_w": 1.0, "sigma_rad": 1e-3}),
            (0x140, 61, {"command": 9, "target": 9, "value": 9}),
        ):
            if k % every == 3:
                good = frame(frame_id, k // every, **values)
                for payload in (good, good[:-1] + bytes([good[-1] ^ 1])):
                    flight.put(frame_id, payload)
                    put.append(f"{frame_id:03X}##1{payload.hex().upper()} R")

    flight = fly_with(tmp_path, meddle)
    assert flight.counts["BAD_CRC"] == len(put) // 2 == 9 + 20 + 4
    journal = (tmp_path / "can.log").read_text(encoding="ascii").splitlines()
    heard = [line.split(maxsplit=2)[2] for line in journal]
    assert [line for line in heard if line[:3] in ("120", "130", "140")] == put
    assert_replays(save_run(flight, tmp_path), 200)


def test_foreign_frames_under_flights_own_identifiers(tmp_path: Path) -> None:
    """GIVEN another node that sends what only flight may send THEN the journal keeps the two apart by direction."""

    def meddle(flight: Flight) -> None:
        if flight.k % 7 == 0:
            flight.put(0x202, frame(0x202, flight.k, tick=10 * flight.k, t_counter_ns=5))
        if flight.k % 5 == 0:
            flight.put(0x200, frame(0x200, flight.k, x_gcrf_m=1.0))
            flight.put(0x201, b"short")

    flight = fly_with(tmp_path, meddle)
    assert flight.counts["UNKNOWN_ID"] == 29 + 2 * 40
    assert_replays(save_run(flight, tmp_path), 200)


def test_frames_of_every_sort(tmp_path: Path) -> None:
    """GIVEN extended, remote, error and classic frames THEN each is in the journal and counted again in the replay."""

    def meddle(flight: Flight) -> None:
        flight.put(0x110, b"12345678", is_extended_id=True)
        flight.put(0x1ABCDEF, bytes(64), is_extended_id=True)
        flight.put(0x110, b"", is_remote_frame=True, is_fd=False, bitrate_switch=False)
        flight.put(0x4, bytes(8), is_error_frame=True, is_fd=False, bitrate_switch=False)
        flight.put(0x7FF, b"1234", is_fd=False, bitrate_switch=False)
        flight.put(0x110, b"", is_fd=False, bitrate_switch=False)

    flight = fly_with(tmp_path, meddle)
    assert flight.counts["UNKNOWN_ID"] == 5 * 200
    assert flight.counts["BAD_LENGTH"] == 200
    assert_replays(save_run(flight, tmp_path), 200)


def test_a_flood_that_is_drained_over_many_ticks(tmp_path: Path) -> None:
    def meddle(flight: Flight) -> None:
        if flight.k == 100:
            for number in range(1500):
                flight.put(0x7AA, number.to_bytes(4, "little"))

    flight = fly_with(tmp_path, meddle)
    assert_replays(save_run(flight, tmp_path), 200)


@pytest.mark.parametrize("down_ticks", [0, 1, 30])
@pytest.mark.parametrize("place", ["receive", 0, 1, 2])
def test_a_bus_that_was_lost_is_lost_again(tmp_path: Path, place: int | str, down_ticks: int) -> None:
    """GIVEN a bus that fails while receiving or at the n-th frame sent, and comes back in a later slack THEN the replay
    is deaf in the same ticks: alert, error count and state are the same.
    """

    def meddle(flight: Flight) -> None:
        if flight.k in (60, 150):
            flight.bus.stays_down = down_ticks > 0
            if place == "receive":
                flight.bus.fail_receiving(can.CanOperationError("gone"))
            else:
                flight.bus.fail_sending(OSError("gone"), after=int(place))
        if flight.k in (60 + down_ticks, 150 + down_ticks):
            flight.bus.stays_down = False

    flight = fly_with(tmp_path, meddle)
    assert flight.loop.port.reconnects == 2
    assert flight.counts["BUS_ERROR"] == 2
    assert_replays(save_run(flight, tmp_path), 200)


@pytest.mark.parametrize("place", ["receive", 0, 2])
def test_a_bus_lost_in_the_last_tick(tmp_path: Path, place: int | str) -> None:
    def meddle(flight: Flight) -> None:
        if flight.k == 199 and place == "receive":
            flight.bus.fail_receiving(OSError("gone"))
        elif flight.k == 199:
            flight.bus.fail_sending(OSError("gone"), after=int(place))

    flight = fly_with(tmp_path, meddle)
    assert flight.loop.port.reconnects == 1
    assert_replays(save_run(flight, tmp_path), 200)


def test_slips_of_a_flight_in_real_time_come_again(tmp_path: Path) -> None:
    """GIVEN a clock on which ticks take long now and then WHEN replayed THEN slips and their alerts are the same."""

    class SlowClock:
        lockstep = False

        def __init__(self, counter_ns: int) -> None:
            self.now_ns = counter_ns + 123  # a real clock never begins on a round number
            self.readings = 0

        def counter_ns(self) -> int:
            self.readings += 1
            self.now_ns += 300_000_777 if self.readings % 97 == 0 else 1_001
            return self.now_ns

        def wait_until(self, counter_ns: int) -> None:
            self.now_ns = max(self.now_ns, counter_ns)

    loaded = load("time.duration_s=20")
    with Flight(loaded, tmp_path, clock=SlowClock(10**12)) as flight:
        flight.loop.anchor(1_600_000_000_123_456_789)
        flight.loop.run(200)
    assert flight.loop.slips > 10
    assert_replays(save_run(flight, tmp_path), 200)


@pytest.fixture
def run_dir(tmp_path: Path) -> Path:
    with Flight(load("time.duration_s=10"), tmp_path) as flight:
        flight.fly()
    return save_run(flight, tmp_path)


def command(*arguments: object) -> int:
    return command_line.main(["replay", *map(str, arguments)])


def test_other_tables_are_refused_and_named(run_dir: Path, capsys) -> None:
    """GIVEN a table other than the one flown THEN exit 2 and its name and CRC; with --force it flies and differs."""
    from ground.tables.build import build_navigation

    (run_dir / "tables" / "navigation.tbl").write_bytes(build_navigation("j2", {"limit_m": 1.0, "clear_limit_m": 0.5}))
    assert command(run_dir) == 2
    said = capsys.readouterr().err
    assert "table navigation has CRC" in said
    assert "--force" in said
    assert command(run_dir, "--force") == 1
    captured = capsys.readouterr()
    assert "table navigation has CRC" in captured.err
    assert "DIFFERENT" in captured.out
    assert "differs from byte" in captured.out


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ("flight_source_sha256", "compiled flight code"),
        ("flight_package_sha256", "outside the kernels"),
        ("machine", "the run flew on riscv"),
    ],
)
def test_other_code_is_refused_and_named(run_dir: Path, capsys, key: str, said: str) -> None:
    record = json.loads((run_dir / "run.json").read_text())
    record[key] = "riscv"
    (run_dir / "run.json").write_text(json.dumps(record))
    assert command(run_dir) == 2
    assert said in capsys.readouterr().err
    assert command(run_dir, "--force") == 0
    assert said in capsys.readouterr().err


def test_other_versions_are_refused_and_named(run_dir: Path, capsys) -> None:
    record = json.loads((run_dir / "run.json").read_text())
    record["versions"]["numba"] = "0.1"
    del record["versions"]["numpy"]
    (run_dir / "run.json").write_text(json.dumps(record))
    assert command(run_dir) == 2
    said = capsys.readouterr().err
    assert "the run flew with 0.1" in said
    assert "the run flew with an unknown version" in said


def test_every_source_of_flight_is_in_the_hash(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """GIVEN a copy of flight in which one letter of any room differs THEN the hash differs."""
    import shutil

    package = Path(provenance.__file__).parent
    copy = tmp_path / "flightsw"
    shutil.copytree(package, copy)
    monkeypatch.setattr(provenance, "_PACKAGE", copy)
    before = provenance.package_hash()
    for name in ("link/telemetry.py", "nav/step.py", "main_loop.py"):
        path = copy / name
        path.write_text(path.read_text() + "#")
        after = provenance.package_hash()
        assert after != before
        before = after


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda d: (d / "run.json").unlink(), "run.json"),
        (lambda d: (d / "run.json").write_text("{"), "run.json"),
        (lambda d: (d / "run.json").write_text("[]"), "not the record of a run"),
        (lambda d: (d / "can.log").unlink(), "can.log: missing"),
        (lambda d: (d / "can.log").write_text(""), "holds no whole tick"),
        (lambda d: (d / "can.log").write_text("hello\n"), "line 1 is not candump text"),
        (lambda d: (d / "link.tlog").unlink(), "link.tlog: missing"),
        (lambda d: (d / "tables" / "navigation.tbl").unlink(), "navigation.tbl: cannot be read"),
        (lambda d: (d / "tables" / "navigation.tbl").write_bytes(b"x" * 9000), "navigation.tbl: refused"),
        (lambda d: lose_lines(d / "can.log"), "the journal lost entries"),
    ],
)
def test_what_is_no_run_is_refused_in_one_line(run_dir: Path, capsys, spoil: Callable[[Path], None], said: str) -> None:
    spoil(run_dir)
    assert command(run_dir) == 2
    captured = capsys.readouterr()
    assert said in captured.err
    assert len(captured.err.splitlines()) == 1
    assert captured.out == ""


def lose_lines(path: Path) -> None:
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:40] + lines[60:]))


def test_a_run_is_never_overwritten_by_its_replay(run_dir: Path, capsys) -> None:
    before = (run_dir / "can.log").read_bytes()
    assert command(run_dir, "--out", run_dir) == 2
    assert "is the run itself" in capsys.readouterr().err
    assert (run_dir / "can.log").read_bytes() == before


def test_journal_lines_are_candumps(tmp_path: Path) -> None:
    """Every sort of frame as flight writes it is read back by python-can as what it was (candump -L -x)."""
    from flightsw.journal import ERROR, EXTENDED, REMOTE

    lines = [
        candump_line(1_500_000_000_123_456_789, 0x110, True, b"\x01\x02"),
        candump_line(1_500_000_000_223_456_000, 0x202, False, bytes(32)),
        candump_line(1_500_000_000_323_456_000, 0x1ABCDEF | EXTENDED, True, b"\xff"),
        candump_line(1_500_000_000_423_456_000, 0x110 | REMOTE, True, b""),
        candump_line(1_500_000_000_523_456_000, 0x40 | ERROR, False, bytes(8)),
    ]
    path = tmp_path / "can.log"
    path.write_text("".join(lines))
    messages = list(can.CanutilsLogReader(path))
    assert [m.arbitration_id for m in messages] == [0x110, 0x202, 0x1ABCDEF, 0x110, 0x40]
    assert [m.is_rx for m in messages] == [True, False, True, True, False]
    assert [m.is_fd for m in messages] == [True, True, True, False, False]
    assert [m.is_extended_id for m in messages[:4]] == [False, False, True, False]
    assert [m.is_remote_frame for m in messages] == [False, False, False, True, False]
    assert not any(m.is_error_frame for m in messages[:4])
    assert messages[0].timestamp == pytest.approx(1_500_000_000.123456, abs=1e-6)
    assert bytes(messages[0].data) == b"\x01\x02"


def test_orders_of_the_ground_are_obeyed_again(tmp_path: Path) -> None:
    """GIVEN a flight whose ground reset its filter, disarmed the flag and was refused things WHEN it is replayed THEN
    can.log is the same byte for byte, without the key; without the orders it would not be."""
    from link_bench import Linked

    from flightsw.icd import mavlink

    run = tmp_path / "run"
    run.mkdir()
    with Linked("outage=[{start_s=20.0, duration_s=20.0}]", logs=run) as flight:
        flight.fly(until_s=10.0)
        assert flight.ask(mavlink.LEONAV_CMD_RESET_FILTER) == 0
        flight.fly(until_s=25.0)
        assert flight.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0) == 0
        flight.station.parameter(b"LNK_REPEAT_S", 3.0)
        flight.wire.up.append(b"\xfd" * 50)
        flight.fly()
    save_run(flight, run)
    record = json.loads((run / "run.json").read_text())
    for two_way, same in ((True, True), (False, False)):
        (run / "run.json").write_text(json.dumps({**record, "two_way_link": two_way}))
        outcome = replay.replay(run, tmp_path / f"replayed_{two_way}")
        assert outcome.ticks == 600
        assert (outcome.can_differs_at is None) is same
