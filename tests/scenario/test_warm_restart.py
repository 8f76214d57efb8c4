"""Warm restart: flight goes on from a checkpoint, not from nothing, and never from one it should not trust."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from harness import HOUR_NS, Flight, load

from flightsw import __main__ as command_line
from flightsw import app, replay
from flightsw.can_port import CanPort
from flightsw.checkpoint import Resume, capture, restore
from flightsw.icd.enums import Mode, Validity
from flightsw.icd.table_file import decode
from flightsw.journal import Journal
from flightsw.link.mavlink_out import Nowhere
from flightsw.provenance import identity
from flightsw.records import NAV
from ground.tables.build import build_navigation
from ground.tables.earth_orientation import build_earth_orientation
from ground.tables.forces import build_force_tables

SAVED_S = 400.0
RESTART_S = 1000.0  # ten minutes after the checkpoint
END_S = 1100.0


def reboot(flight: Flight, resume: Resume | None, folder: Path | None = None) -> None:
    """A new process on the same bus: all memory is gone, the counter goes on."""
    flight.journal.close()
    flight.journal = Journal(folder)
    flight.loop = app.build(
        flight.navigation,
        flight.orientation,
        flight.clock,
        CanPort(flight.bus.open),  # type: ignore[arg-type]
        flight.journal,
        Nowhere(),
        flight.world.start_unix_ns + flight.k * flight.period_ns,
        resume=resume,
    )


def flown_to_the_restart(flight: Flight) -> bytes:
    """Fly to the restart; the checkpoint of SAVED_S."""
    flight.fly(SAVED_S)
    image = capture(flight.nav, flight.navigation.crc32)
    flight.fly(RESTART_S)
    return image


def seconds_until(flight: Flight, condition: np.ndarray) -> float:
    """Time from the restart to the first tick at which a condition holds [s]."""
    after = flight.seconds >= RESTART_S
    return float(flight.seconds[after & condition][0]) - RESTART_S


def test_flight_goes_on_from_a_checkpoint_of_ten_minutes_ago() -> None:
    """GIVEN a flight whose processor restarts WHEN it resumes from a checkpoint 10 min old THEN with onboard time, 3 s
    later, it propagates over the gap and is INTEGRATED with the third fix from then on, within 8 s; whenever the state
    is offered, its bound holds; and what it had learned is there: every bin of the stored acceleration.
    """
    with Flight(load(f"time.duration_s={END_S}", "flight.table_set='j2'")) as flight:
        image = flown_to_the_restart(flight)
        reboot(flight, Resume(image, NAV, flight.navigation.crc32, 3600.0))
        flight.fly()
    learned = np.zeros(1, NAV)
    restore(learned, image, flight.navigation.crc32)
    resume = flight.loop.resume
    assert resume is not None
    assert not resume.dropped
    assert resume.age_s == pytest.approx(RESTART_S - SAVED_S, abs=6.0)
    valid = flight.flown["validity"] & Validity.STATE_VALID != 0
    assert seconds_until(flight, valid) < 8.0
    assert seconds_until(flight, flight.flown["mode"] == Mode.INTEGRATED) < 8.0
    assert (flight.flown["mode"][flight.seconds >= RESTART_S + 8.0] == Mode.INTEGRATED).all()
    offered = valid & (flight.seconds >= RESTART_S)
    assert offered.sum() > 900
    assert (flight.error_m()[offered] <= flight.flown["bound_m"][offered]).all()
    bins = np.flatnonzero(learned["da_samples"][0])
    assert len(bins) > 5
    assert (flight.nav["da_mean"][0, bins] == learned["da_mean"][0, bins]).all()
    assert "GATE" not in flight.counts


def test_the_flight_filter_goes_on_from_a_checkpoint(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN the flight filter, with drag scale and factorised covariance WHEN it resumes from 10 min ago THEN it is
    INTEGRATED within 8 s, its error then below 3 m as before, where a cold start has that of single fixes for minutes.
    """
    loaded = load(f"time.duration_s={END_S}", "flight.table_set='flight'", "gnss.sigma_position_m=3")
    images = build_force_tables(loaded.t_start_gps_ns)
    forces = app.ForceTables(*(decode(image) for image in images))
    monkeypatch.setattr(app, "build", partial(app.build, forces=forces))
    with Flight(loaded) as flight:
        image = flown_to_the_restart(flight)
        reboot(flight, Resume(image, NAV, flight.navigation.crc32, 3600.0))
        flight.fly()
    assert seconds_until(flight, flight.flown["mode"] == Mode.INTEGRATED) < 8.0
    offered = (flight.flown["validity"] & Validity.STATE_VALID != 0) & (flight.seconds >= RESTART_S)
    assert offered.sum() > 900
    assert (flight.error_m()[offered] <= flight.flown["bound_m"][offered]).all()
    assert flight.error_m()[offered].max() < 3.0


def test_a_restart_clears_no_flag() -> None:
    """GIVEN a checkpoint of a flight whose flag was up WHEN flight resumes from it THEN it is FAILED from its first
    tick with a state until 30 fixes in a row have proven it, as without a restart.
    """
    settings = (f"time.duration_s={END_S}", "outage=[{start_s=390.0, duration_s=20.0}]", "flight.table_set='j2'")
    with Flight(load(*settings)) as flight:
        flight.fly(SAVED_S)
        flight.nav["flag"] = 1
        image = capture(flight.nav, flight.navigation.crc32)
        flight.fly(RESTART_S)
        reboot(flight, Resume(image, NAV, flight.navigation.crc32, 3600.0))
        flight.fly()
    after = flight.seconds >= RESTART_S + 5.0
    cleared_s = seconds_until(flight, after & (flight.flown["flag"] == 0))
    assert (flight.flown["mode"][after & (flight.seconds < RESTART_S + cleared_s)] == Mode.FAILED).all()
    assert 30.0 <= cleared_s < 45.0  # clear_fixes


@pytest.mark.parametrize("max_age_s", [0.1, 590.0])
def test_a_state_that_is_too_old_is_dropped_and_flight_starts_from_fixes(max_age_s: float) -> None:
    with Flight(load(f"time.duration_s={END_S}")) as flight:
        image = flown_to_the_restart(flight)
        reboot(flight, Resume(image, NAV, flight.navigation.crc32, max_age_s))
        flight.fly()
    resume = flight.loop.resume
    assert resume is not None
    assert resume.dropped
    assert flight.nav["t_fix_gps_ns"][0] > flight.world.t_start_gps_ns + round(1e9 * (END_S - 3))
    assert (flight.flown["bound_m"][flight.seconds > RESTART_S + 20.0] < 100.0).all()
    assert flight.error_m()[-100:].max() < 30.0


def test_a_checkpoint_waits_for_time() -> None:
    """GIVEN a restart inside an outage, without pulses THEN nothing is offered; WHEN they return THEN the state is."""
    outage_s = 1040.0 - RESTART_S
    settings = (f"time.duration_s={END_S}", f"outage=[{{start_s={RESTART_S}, duration_s={outage_s}}}]")
    with Flight(load(*settings)) as flight:
        image = flown_to_the_restart(flight)
        reboot(flight, Resume(image, NAV, flight.navigation.crc32, 3600.0))
        flight.fly(1039.0)
        assert flight.loop.resume is not None
        assert flight.loop.resume.pending
        assert not flight.flown["validity"][flight.seconds >= RESTART_S].any()
        flight.fly()
    assert not flight.loop.resume.dropped
    assert seconds_until(flight, flight.flown["mode"] == Mode.INTEGRATED) < outage_s + 8.0


def save_resumed_run(flight: Flight, folder: Path, resume: Resume) -> None:
    """Beside the logs of a resumed flight, what its replay needs."""
    (folder / "tables").mkdir()
    build, start = flight.loaded.scenario.flight, flight.loaded.t_start_gps_ns
    stop = start + round(flight.loaded.scenario.time.duration_s * 1e9)
    (folder / "tables" / app.NAVIGATION_FILE).write_bytes(build_navigation(build.table_set, build.table or None))
    image = build_earth_orientation(start - HOUR_NS, stop + HOUR_NS, None)
    (folder / "tables" / app.EARTH_ORIENTATION_FILE).write_bytes(image)
    (folder / app.RESUME_FILE).write_bytes(resume.image)
    record = identity(flight.navigation, flight.orientation, resume=resume)
    (folder / "run.json").write_text(json.dumps(record))


def test_a_resumed_flight_replays_and_only_with_its_checkpoint(tmp_path: Path, capsys) -> None:
    """GIVEN the logs of a flight that began with a checkpoint THEN they replay to the same bytes; WHEN it is another
    one, damaged, or gone THEN replay refuses, and says so."""
    with Flight(load("time.duration_s=130")) as flight:
        flight.fly(60.0)
        image = capture(flight.nav, flight.navigation.crc32)
        flight.fly(70.0)
        other = capture(flight.nav, flight.navigation.crc32)
        resume = Resume(image, NAV, flight.navigation.crc32, 3600.0)
        reboot(flight, resume, tmp_path)
        flight.fly()
    assert not resume.dropped
    save_resumed_run(flight, tmp_path, resume)
    assert replay.check_versions(tmp_path) == []
    assert replay.replay(tmp_path, tmp_path / "again") == (600, None, None)

    (tmp_path / app.RESUME_FILE).write_bytes(other)
    (found,) = replay.check_versions(tmp_path)
    assert "checkpoint" in found
    assert command_line.main(["replay", str(tmp_path)]) == 2
    assert "checkpoint here is not that of the run" in capsys.readouterr().err
    outcome = replay.replay(tmp_path, tmp_path / "again")
    assert outcome.can_differs_at is not None

    (tmp_path / app.RESUME_FILE).write_bytes(image[:-1])
    assert command_line.main(["replay", str(tmp_path)]) == 2
    assert "header announces" in capsys.readouterr().err
    (tmp_path / app.RESUME_FILE).unlink()
    assert command_line.main(["replay", str(tmp_path)]) == 2
    assert "the run began with a checkpoint" in capsys.readouterr().err


# -- the command


@pytest.fixture(scope="module")
def table_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tables")
    start = load().t_start_gps_ns
    (folder / "navigation.tbl").write_bytes(build_navigation("j2"))
    (folder / "earth_orientation.tbl").write_bytes(build_earth_orientation(start, start + 10**13, None))
    return folder


def test_an_unfit_checkpoint_is_told_and_flight_starts_without_it(tmp_path: Path, table_folder: Path, capfd) -> None:
    """GIVEN a file that is missing, then one that is no checkpoint WHEN flight is told to resume from it THEN it says
    why not and navigates all the same; its run names no checkpoint."""
    given = tmp_path / "nav.ckpt"
    for said in ("cannot be read", "too few"):
        words = ["run", "--can", "virtual:warm", "--tables", str(table_folder), "--ticks", "2", "--resume", str(given)]
        assert command_line.main([*words, "--out", str(tmp_path / "run"), "--checkpoint", str(tmp_path / "x")]) == 0
        captured = capfd.readouterr()
        assert f"--resume {given}" in captured.err
        assert said in captured.err
        assert "starting without it" in captured.err
        assert "0 checkpoints written, 0 failed" in captured.out
        assert json.loads((tmp_path / "run" / "run.json").read_text())["checkpoint"] is None
        given.write_bytes(b"too short")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--checkpoint", "no/such/folder/nav.ckpt"], "no such folder"),
        (["--checkpoint-period", "0"], "seconds from 0.1"),
        (["--checkpoint-period", "nan"], "seconds from 0.1"),
        (["--resume-max-age", "long"], "seconds from 0.1"),
    ],
)
def test_wrong_arguments_are_refused(table_folder: Path, capsys, words: list[str], said: str) -> None:
    arguments = ["run", "--can", "virtual:warm", "--tables", str(table_folder), "--ticks", "1", *words]
    try:
        status = command_line.main(arguments)
    except SystemExit as end:
        status = int(end.code or 0)
    assert status == 2
    assert said in capsys.readouterr().err


def test_a_run_keeps_the_checkpoint_that_it_resumes_from(tmp_path: Path, table_folder: Path, capfd) -> None:
    """GIVEN a checkpoint of this table WHEN flight resumes from it THEN run.json names its hash and the folder holds
    it, ready to be replayed."""
    with Flight(load("flight.table_set='j2'")) as flight:
        flight.fly(30.0)
        image = capture(flight.nav, flight.navigation.crc32)
    (tmp_path / "nav.ckpt").write_bytes(image)
    run = tmp_path / "run"
    words = ["run", "--can", "virtual:warm", "--tables", str(table_folder), "--ticks", "3", "--out", str(run)]
    assert command_line.main([*words, "--resume", str(tmp_path / "nav.ckpt")]) == 0
    capfd.readouterr()
    assert (run / app.RESUME_FILE).read_bytes() == image
    assert json.loads((run / "run.json").read_text())["checkpoint"]["max_age_s"] == 7200.0
    assert command_line.main(["replay", str(run)]) == 0
