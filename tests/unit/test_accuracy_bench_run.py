"""`ground accuracy bench --quick` flown once, looked at from all sides; and what the command refuses."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from orbit_writers import oem_kvn

from flightsw.icd.table_file import decode
from flightsw.memory import Memory
from ground.__main__ import main
from ground.accuracy import bench
from ground.accuracy.bench_cases import LONG_FLIGHT, ORBITS, Case, Plan, orbit_of_file
from ground.accuracy.bench_flight import force_tables
from ground.accuracy.flight_model import FlightModel
from ground.campaign import arc
from ground.errors import OperatorError
from ground.studies.flights import COARSE_TICK_NS, NS, Prepared, prepare

QUICK = ["accuracy", "bench", "--quick"]
CASE = Case(ORBITS["simulated"], "white", Plan.of(86_400).quick(), "flight")


class Ran:
    """What a quick run left."""

    def __init__(self, folder: Path, printed: str) -> None:
        self.folder = folder
        self.printed = printed
        self.document: dict[str, Any] = json.loads((folder / "accuracy.json").read_text(encoding="utf-8"))
        self.summary = self.document["cases"][0]
        with np.load(folder / "flights" / "simulated-white.npz") as file:
            self.figures = {name: file[name] for name in file.files}


@pytest.fixture(scope="module")
def no_data(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A machine without real orbits."""
    folder = tmp_path_factory.mktemp("no_data")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LEONAV_DATA", str(folder))
        yield folder


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory, no_data: Path) -> Ran:
    """The quick bench, flown in two processes."""
    out = tmp_path_factory.mktemp("bench") / "new" / "folder"
    with pytest.MonkeyPatch.context() as patch:
        said: list[str] = []
        patch.setattr("builtins.print", lambda *words, **_: said.append(" ".join(map(str, words))))
        assert main([*QUICK, "--out", str(out), "--jobs", "2"]) == 0
    return Ran(out, "\n".join(said))


def outage_world(last_fix_s: float, ages_s: int) -> Prepared:
    """The first arc's scenario with a real outage after the fix of that age."""
    outage = f"outage=[{{start_s={last_fix_s + 0.5!r}, duration_s={float(ages_s)!r}}}]"
    return prepare("two_orbits", [*CASE.scenario_settings(0), outage], COARSE_TICK_NS)


def memory_of(prepared: Prepared) -> Memory:
    memory = Memory()
    memory.load(prepared.table().values, prepared.orientation.values)
    memory.load_forces(*(decode(table).values for table in force_tables(CASE, prepared.world.t_start_gps_ns)))
    return memory


def last_fix_s(prepared: Prepared) -> float:
    """GPS time since the start of the last fix that flight has before the outage of a plan begins [s]."""
    inputs, ticks = prepared.inputs
    before = inputs[(prepared.age_s[ticks] < CASE.plan.convergence_s) & (inputs["fix_present"] == 1)]
    return (int(before["fix_gps_ns"].max()) - prepared.world.t_start_gps_ns) / NS


def test_errors_are_those_of_an_outage_in_the_simulated_world(ran: Ran) -> None:
    """GIVEN an arc, flown by holding its inputs back WHEN the world itself has the outage THEN the errors agree.

    In the world the frames are never sent; positions at all ages of the curve agree to the rounding of what is kept.
    """
    prepared = prepare("two_orbits", CASE.scenario_settings(0), COARSE_TICK_NS)
    fix_s = last_fix_s(prepared)
    world = outage_world(fix_s, CASE.plan.ages_s[-1] + 60)
    inputs, ticks = world.inputs
    outputs = arc.fly(memory_of(world), inputs)
    for k, age in enumerate(CASE.plan.curve_s):
        tick = int(np.searchsorted(world.age_s, fix_s + age))
        last = np.searchsorted(ticks, tick, side="right") - 1
        error = outputs["r_gcrf_m"][last] - world.world.r_true_gcrf_m[tick]
        np.testing.assert_allclose(ran.figures["outage_error_m"][0, k], error, atol=1e-4)
        assert ran.figures["outage_bound_m"][0, k] == pytest.approx(outputs["bound_m"][last], rel=1e-5)


def test_a_return_is_that_of_an_outage_in_the_simulated_world(ran: Ran) -> None:
    """GIVEN the arc's return of fixes after 600 s WHEN the world's outage ends there THEN the errors agree."""
    prepared = prepare("two_orbits", CASE.scenario_settings(0), COARSE_TICK_NS)
    fix_s = last_fix_s(prepared)
    tick = int(np.searchsorted(prepared.age_s, fix_s + 600.0))
    # the first fix again is the one that arrives after the tick before; the world's outage ends half a second earlier
    world = outage_world(fix_s, round(prepared.age_s[tick - 1] - fix_s) - 1)
    inputs, ticks = world.inputs
    outputs = arc.fly(memory_of(world), inputs)
    for second in (0, 1, 5, 60, 400, 899):
        last = np.searchsorted(ticks, tick + second, side="right") - 1
        error = np.linalg.norm(outputs["r_gcrf_m"][last] - world.world.r_true_gcrf_m[tick + second])
        assert ran.figures["return_3d_m"][0, 0, second] == pytest.approx(error, abs=1e-4)


def test_the_floor_is_the_force_model_from_the_true_state(ran: Ran) -> None:
    """GIVEN the true state at the last fix WHEN the ground's own model carries it on THEN it errs by the floor."""
    prepared = prepare("two_orbits", CASE.scenario_settings(0), COARSE_TICK_NS)
    t = prepared.world.t_start_gps_ns + round(last_fix_s(prepared) * NS)
    memory = memory_of(prepared)
    settings = {name: memory.forces[name][0].item() for name in ("area_to_mass_m2pkg", "degree", "f107", "ap")}
    model = FlightModel(memory.orientation, None, settings | {"f107_mean": float(memory.forces["f107_mean"][0])})
    truth = prepared.world.truth
    r, v = truth.state_gcrf(np.array([t]))
    for age in (60, 300, 900):
        end = model.propagate(t, np.hstack((r[0], v[0])), age * NS)
        error = end[:3] - truth.state_gcrf(np.array([t + age * NS]))[0][0]
        np.testing.assert_allclose(ran.figures["floor_m"][0, age // 20 - 1], error, atol=2e-4)
    # EGM2008 to degree 70, NRLMSISE-00 against degree 50 and another density: not nothing, and not much in 900 s
    assert 1e-3 < np.abs(ran.figures["floor_m"][:, -1]).max() < 0.5
    fitted, usual = (np.sum(ran.figures[name] ** 2, axis=(1, 2)) for name in ("floor_drag_m", "floor_m"))
    assert np.all(fitted <= usual * (1.0 + 1e-5))


def test_the_json_is_what_the_arrays_say(ran: Ran) -> None:
    """GIVEN the arrays that were kept WHEN the figures are taken from them anew THEN accuracy.json has them."""
    f, plan = ran.figures, CASE.plan
    steady = f["flight_t_s"] >= plan.convergence_s
    said = ran.summary["steady"]
    assert said["rms_3d_m"] == pytest.approx(np.sqrt(np.mean(f["flight_3d_m"][steady].astype(float) ** 2)), rel=1e-5)
    assert said["rms_3d_mps"] == pytest.approx(
        np.sqrt(np.mean(f["flight_3d_mps"][steady].astype(float) ** 2)), rel=1e-5
    )
    assert said["max_3d_m"] == pytest.approx(f["flight_3d_m"][steady].max(), rel=1e-5)
    assert said["nees_per_state"] == pytest.approx(f["flight_nees"][steady].mean() / 6.0, rel=1e-4)
    assert list(ran.summary["outages"]) == ["60", "300", "900"]
    for age, entry in ran.summary["outages"].items():
        k = int(age) // 20 - 1
        error = np.abs(f["outage_error_m"][:, k]).max(axis=1)
        assert entry["starts"] == len(error) == 3
        assert entry["median_m"] == pytest.approx(sorted(error)[1], rel=1e-5)
        assert entry["max_m"] == pytest.approx(max(error), rel=1e-5)
        assert entry["worst_error_to_bound"] == pytest.approx(max(error / f["outage_bound_m"][:, k]), rel=1e-5)
        assert [one["error_m"][age] for one in ran.summary["starts"]] == pytest.approx(error.tolist(), rel=1e-5)
    assert [one["start_s"] for one in ran.summary["starts"]] == [3000, 4000, 5000]
    assert ran.summary["back_to_steady"]["600"]["runs"] == 3
    assert ran.document["schema"] == "leonav accuracy bench, version 1"


def test_three_arcs_share_no_noise_and_start_at_their_phases(ran: Ran) -> None:
    """GIVEN arcs 1000 s apart WHEN their phases and convergence are compared THEN 63.4 degrees apart, nothing equal."""
    phase = np.unwrap(np.radians(ran.figures["start_phase_deg"]))
    np.testing.assert_allclose(np.degrees(np.diff(phase)), 360.0 * 1000.0 / 5676.98, atol=2.0)
    first, second, third = ran.figures["converging_3d_m"][:, 30:]  # from five minutes on
    for a, b in ((first, second), (second, third), (first, third)):
        assert abs(np.corrcoef(a, b)[0, 1]) < 0.9
        assert np.abs(a - b).max() > 1e-3


def test_what_is_printed_and_written(ran: Ran) -> None:
    """GIVEN the run WHEN its text is read THEN figures, verdict with misses counted, table and three pictures."""
    assert f"steady 3-D rms {ran.summary['steady']['rms_3d_m']:.2f} m" in ran.printed
    met = sum(line["met"] for line in ran.document["verdict"])
    total = len(ran.document["verdict"])
    assert f"{met} of {total} met, {total - met} missed" in ran.printed
    table = (ran.folder / "accuracy.md").read_text(encoding="utf-8")
    assert f"| simulated | white | 900 s | 3 | {ran.summary['outages']['900']['median_m']:.2f} m |" in table
    for row in table.splitlines():
        if row.startswith("| simulated"):
            assert row.endswith("|")
    pictures = sorted(path.name for path in (ran.folder / "figures").iterdir())
    assert pictures == ["outage_white.png", "return_white.png", "steady_white.png"]
    assert all(path.read_bytes()[:4] == b"\x89PNG" for path in (ran.folder / "figures").iterdir())


def test_the_same_again_flies_nothing(
    ran: Ran, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """GIVEN a finished folder WHEN asked again THEN the same document without a flight; another noise flies."""

    def refuse(part: Any) -> Any:
        raise OperatorError(f"flies {part.number}")

    monkeypatch.setattr(bench, "fly", refuse)
    before = (ran.folder / "accuracy.json").read_bytes()
    assert main([*QUICK, "--out", str(ran.folder), "--jobs", "1"]) == 0
    assert "1 of 1 cases were flown before" in capsys.readouterr().out
    assert (ran.folder / "accuracy.json").read_bytes() == before
    louder = ["--set", "gnss.sigma_position_m=11.0"]
    assert main([*QUICK, "--out", str(ran.folder), "--jobs", "1", *louder]) == 2
    assert f"flies {LONG_FLIGHT}" in capsys.readouterr().err


def test_an_interrupt_ends_without_a_trace(
    no_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stop(part: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr(bench, "fly", stop)
    assert main([*QUICK, "--out", str(tmp_path), "--jobs", "1"]) == 130
    assert "finished cases are kept" in capsys.readouterr().err


def test_an_orbit_file_by_path_is_flown(
    no_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """GIVEN satkit's orbit in a CCSDS OEM file, UTC, GCRF WHEN the bench is given its path THEN it flies on it.

    With fixes the error is that of any orbit at 500 km: decimetres. A second of time scale would be 7.6 km.
    """
    truth = prepare("two_orbits", ["time.duration_s=6300.0", "outage=[]"], COARSE_TICK_NS).world.truth
    t = np.arange(truth.t_first_gps_ns, truth.t_last_gps_ns, 60 * NS)
    path = tmp_path / "made here.v1.oem"
    path.write_text(oem_kvn([(t, *truth.state_gcrf(t))], frame="GCRF"), encoding="ascii")
    out = tmp_path / "out"
    words = ["--orbits", str(path), "--area-to-mass", "0.01", "--jobs", "1", "--out", str(out)]
    assert main([*QUICK, *words]) == 0
    assert "made_here, white fixes" in capsys.readouterr().out
    (summary,) = json.loads((out / "accuracy.json").read_text(encoding="utf-8"))["cases"]
    assert summary["steady"]["rms_3d_m"] < 2.0
    assert summary["area_to_mass_m2pkg"] == 0.01
    assert summary["shortened"]
    assert summary["start_gps"] == (datetime(1980, 1, 6) + np.timedelta64(-(-int(t[0]) // NS), "s").item()).isoformat()


def test_options_of_orbit_files_reach_the_scenario(tmp_path: Path) -> None:
    truth = prepare("two_orbits", ["time.duration_s=6300.0", "outage=[]"], COARSE_TICK_NS).world.truth
    t = np.arange(truth.t_first_gps_ns, truth.t_last_gps_ns, 60 * NS)
    path = tmp_path / "x.oem"
    path.write_text(oem_kvn([(t, *truth.state_gcrf(t))], frame="GCRF", scale="GPS"), encoding="ascii")
    orbit = orbit_of_file(path, 0.02, velocity_unit="km/s", time_scale="TAI")
    assert set(orbit.settings) == {
        'orbit.source="file"',
        f"orbit.file={json.dumps(str(path))}",
        'orbit.velocity_unit="km/s"',
        'orbit.time_scale="tai"',
    }
    # read as TAI, which is 19 s ahead, the same stamps are 19 s earlier in GPS time
    assert (orbit_of_file(path, 0.02).start - orbit.start).total_seconds() == 19.0
    assert orbit.span_s == (int(t[-1]) - int(t[0])) // NS


def test_an_orbit_file_is_flown_from_a_later_start(tmp_path: Path) -> None:
    """GIVEN a file WHEN a start within it is given THEN the orbit begins there and is named after it; outside, its span
    is told."""
    truth = prepare("two_orbits", ["time.duration_s=6300.0", "outage=[]"], COARSE_TICK_NS).world.truth
    t = np.arange(truth.t_first_gps_ns, truth.t_last_gps_ns, 60 * NS)
    path = tmp_path / "x.oem"
    path.write_text(oem_kvn([(t, *truth.state_gcrf(t))], frame="GCRF", scale="GPS"), encoding="ascii")
    whole = orbit_of_file(path, 0.02)
    later = orbit_of_file(path, 0.02, start=whole.start + timedelta(seconds=1000.5))
    assert (later.start - whole.start).total_seconds() == 1001.0
    assert later.span_s == whole.span_s - 1001
    assert later.name == f"x_{later.start:%Y%m%dT%H%M}"
    for wrong in (whole.start - timedelta(seconds=1), whole.start + timedelta(days=1)):
        with pytest.raises(OperatorError, match=f"is known from {whole.start.isoformat()}"):
            orbit_of_file(path, 0.02, start=wrong)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--orbits", "sentinel3"], "--orbits sentinel3: neither a file nor one of sentinel3a, gracefo, jason2"),
        (["--orbits", "sentinel3"], 'did you mean "sentinel3a"?'),
        (["--orbits", "sentinel3a"], "set LEONAV_DATA to the folder of real orbits"),
        (["--orbits", "simulated", "simulated"], "simulated twice"),
        (["--profiles", "whit"], 'did you mean "white"?'),
        (["--profiles", ","], "--profiles: give one or more of white"),
        (["--orbits", __file__, "--start", "noon"], "--start noon: give a date and time"),
        (["--jobs", "0"], "--jobs 0: give 1 or more"),
        (["--degree", "1"], "--degree 1: give 2 or more"),
        (["--degree", "500"], "degree: 500 is outside"),
        (["--area-to-mass", "3"], "--area-to-mass 3.0: give 0 to 1 m2/kg"),
        (["--set-name", "fligth"], 'did you mean "flight"?'),
        (["--set", "gnss.sigma=1"], "unknown key"),
        (["--set", "flight.table.k_axes=1"], 'did you mean "k_axis"?'),
        (["--gravity", "none.gfc"], "none.gfc"),
    ],
)
def test_mistakes_are_told_before_anything_flies(
    words: list[str], told: str, no_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """GIVEN a mistake WHEN the command runs THEN one line says what and what to do, status 2, nothing is written."""
    assert main([*QUICK, "--out", str(tmp_path / "out"), *words]) == 2
    error = capsys.readouterr().err
    assert told in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_folder_that_is_a_file_is_refused(no_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out").write_text("x")
    assert main([*QUICK, "--out", str(tmp_path / "out")]) == 2
    assert "is a file; name a folder" in capsys.readouterr().err


def test_an_orbit_file_that_is_too_short_or_none_is_refused(
    no_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = prepare("two_orbits", ["time.duration_s=600.0", "outage=[]"], COARSE_TICK_NS).world.truth
    t = np.arange(truth.t_first_gps_ns, truth.t_last_gps_ns, 30 * NS)
    short = tmp_path / "short.oem"
    short.write_text(oem_kvn([(t, *truth.state_gcrf(t))], frame="GCRF"), encoding="ascii")
    words = [tmp_path / "nonsense.sp3", short]
    words[0].write_text("nonsense")
    for path, told in zip(words, ("nonsense.sp3", "too short: 4500 s are the least"), strict=True):
        assert main([*QUICK, "--out", str(tmp_path / "out"), "--orbits", str(path)]) == 2
        assert told in capsys.readouterr().err


def test_orbits_whose_data_are_not_at_hand_are_named(
    no_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """GIVEN no data WHEN all orbits are asked for THEN the real ones are left out by name, the simulated ones fly."""
    asked: list[str] = []

    def stop(part: Any) -> Any:
        asked.append(part.case.orbit.name)
        raise KeyboardInterrupt

    monkeypatch.setattr(bench, "fly", stop)
    assert main(["accuracy", "bench", "--out", str(tmp_path), "--jobs", "1", "--profiles", "white"]) == 130
    printed = capsys.readouterr().out
    for name in ("sentinel3a", "gracefo", "jason2", "sentinel1a"):
        assert f"left out: {name}" in printed
    assert asked == ["simulated"]
