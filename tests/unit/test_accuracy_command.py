"""`ground accuracy`: what is chosen, refused and printed, on an orbit made here by two-body motion."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from flight_bench import T0_GPS_NS, circular_orbit, itrf_from_gcrf_oracle, to_itrf, two_body

from ground.__main__ import main
from ground.accuracy.forces import starts
from ground.accuracy.orbits import read_orbit
from ground.errors import OperatorError

NS = 1_000_000_000
TIMES = T0_GPS_NS + np.arange(0, 4000, 10) * NS


def sentinel_file(folder: Path, frame: str = "EARTH_FIXED") -> Path:
    """An orbit of two bodies in the form of a Sentinel orbit file; frames by pyerfa."""
    r, v = two_body(circular_orbit(700e3), TIMES)
    r_itrf, v_itrf = to_itrf(TIMES, r, v)
    rows = []
    for t, state in zip(TIMES, np.hstack((r_itrf, v_itrf)), strict=True):
        tai = datetime(1980, 1, 6) + timedelta(seconds=int(t // NS) + 19)
        values = zip(("X", "Y", "Z", "VX", "VY", "VZ"), state, strict=True)
        rows.append(f"<OSV><TAI>TAI={tai.isoformat()}.000000</TAI>")
        rows.append("".join(f"<{name}>{value:.6f}</{name}>" for name, value in values) + "</OSV>")
    path = folder / "S1X.EOF"
    text = f"<Earth_Explorer_File><Ref_Frame>{frame}</Ref_Frame>{''.join(rows)}</Earth_Explorer_File>"
    path.write_text(text, encoding="ascii")
    return path


def test_an_earth_fixed_file_comes_back_in_gcrf(tmp_path: Path) -> None:
    """GIVEN an orbit turned to ITRF by pyerfa WHEN flight turns it back THEN a millimetre, and 0.01 mm/s, at most."""
    orbit = read_orbit(sentinel_file(tmp_path))
    r, v = two_body(circular_orbit(700e3), TIMES)
    assert np.array_equal(orbit.t_gps_ns, TIMES)
    assert np.abs(orbit.x[:, :3] - r).max() < 1e-3
    assert np.abs(orbit.x[:, 3:] - v).max() < 1e-5
    assert itrf_from_gcrf_oracle(TIMES[:1]).shape == (1, 3, 3)


def test_starts_are_at_least_1000_s_apart_and_none_that_fits_is_left_out(tmp_path: Path) -> None:
    orbit = read_orbit(sentinel_file(tmp_path))
    assert starts(orbit, 900) == [0, 100, 200, 300]
    assert starts(orbit, 2000) == [0, 100]
    assert starts(orbit, 900, at_most=2) == [0, 200]
    with pytest.raises(OperatorError, match="shorter than 7200 s"):
        starts(orbit, 7200)


def test_command_prints_errors_and_costs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN a two-body orbit WHEN the model of degree 2 flies beside it THEN kilometres, both with it and satkit."""
    path = str(sentinel_file(tmp_path))
    assert main(["accuracy", "forces", "--orbit", path, "--degree", "2", "--peer-starts", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    rows = {tuple(line.split()[:2]): line.split() for line in lines if line.split()[:1] in (["flight"], ["satkit"])}
    ours, peer = rows["flight", "2000"], rows["satkit", "2000"]
    assert float(ours[4]) > 5e3
    assert float(ours[4]) == pytest.approx(float(peer[4]), rel=0.2)
    assert any("shorter than 7200 s" in line for line in lines)
    assert any("4 evaluations" in line for line in lines)


def test_integrators_are_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(sentinel_file(tmp_path))
    assert main(["accuracy", "integrators", "--orbit", path, "--degree", "4"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines() if line.split()[:1] == ["RKN5"]]
    assert [int(row[1]) for row in rows] == [1, 2, 5, 10, 15, 30, 60, 90]
    assert float(rows[-1][2]) > float(rows[0][2])


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("none.sp3", None, "no such orbit file"),
        ("orbit.txt", "x", "unknown kind of orbit file"),
        ("bad.EOF", "not xml", "not a Sentinel orbit file"),
        ("bad.sp3", "not sp3", "bad.sp3"),
    ],
)
def test_a_file_that_does_not_serve_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, text: str | None, said: str
) -> None:
    path = tmp_path / name
    if text is not None:
        path.write_text(text)
    assert main(["accuracy", "forces", "--orbit", str(path)]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_a_sentinel_file_in_another_frame_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OperatorError, match="MOON_FIXED"):
        read_orbit(sentinel_file(tmp_path, "MOON_FIXED"))


def test_without_data_or_files_it_says_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LEONAV_DATA", str(tmp_path))
    assert main(["accuracy", "forces"]) == 2
    assert "set LEONAV_DATA" in capsys.readouterr().err
