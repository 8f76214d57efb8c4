"""Figures of a run: drawn from synthetic runs whose events are known by construction."""

from __future__ import annotations

import argparse
import json
import struct
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flightsw.icd.can_frames import INTEGRITY, NAV_STATE
from flightsw.icd.enums import FlagState, Mode, Validity, Verdict

pytest.importorskip("matplotlib")

from ground.reports import command, style
from ground.reports.figures import make_figures
from ground.reports.run_folder import NotARun, load_run

NAMES = [
    "0_overview.png",
    "1_coordinates.png",
    "2_integrated_error.png",
    "3_acceleration_correction.png",
    "4_mixed_mode_error.png",
    "5_outage_error_and_bound.png",
]
START_NS = 914_803_216_000_000_000
LIMIT_M = 2000.0
FLAG_AGE_S = 513.0


def write_run(folder: Path, *, outage: bool = True, estimate: bool = True, tick_s: float = 1.0) -> Path:
    """A satellite in a circular orbit whose error and bound grow as t^2 in an outage: events by arithmetic.

    Error 0.003 t^2 on the fastest axis reaches 2000 m at 816 s; bound 0.0076 t^2 at 513 s.
    """
    rng = np.random.default_rng(5)
    t_s = np.arange(0.0, 9000.0, tick_s)
    phase = 2.0 * np.pi * t_s / 5580.0
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, 0.35, 0.94]])
    r_m = 6.8e6 * (np.cos(phase)[:, None] * tilt[0] + np.sin(phase)[:, None] * tilt[1])
    start_s, end_s = 5580.0, 7580.0
    age_s = np.where((t_s >= start_s) & (t_s <= end_s), t_s - start_s, 0.0) * outage
    error_m = rng.normal(0.0, 0.25, r_m.shape) + 0.003 * age_s[:, None] ** 2 * [1.0, -0.4, 0.2]
    bound_m = 2.0 + 40.0 * np.exp(-t_s / 90.0) + 0.0076 * age_s**2
    mode = np.full(t_s.size, Mode.INTEGRATED)
    mode[t_s < 4.0] = Mode.INIT
    mode[age_s > 3.0] = Mode.AUTONOMOUS
    raised = (bound_m >= LIMIT_M) | ((t_s > end_s) & (t_s < end_s + 30.0) & outage)
    mode[raised & (age_s > 0.0)] = Mode.FAILED

    nav = np.zeros(t_s.size, NAV_STATE.dtype)
    for i, axis in enumerate("xyz"):
        nav[f"{axis}_gcrf_m"] = r_m[:, i] + error_m[:, i]
    nav["validity"] = np.where(mode == Mode.INIT, 0, Validity.INITIALISED | Validity.STATE_VALID)
    nav["mode"] = mode
    integrity = np.zeros(t_s.size, INTEGRITY.dtype)
    integrity["bound_m"], integrity["limit_m"] = np.where(mode == Mode.INIT, np.nan, bound_m), LIMIT_M
    integrity["fix_age_s"] = age_s
    integrity["mode"], integrity["verdict"] = mode, Verdict.TRUSTED
    integrity["flag_state"] = np.where(raised, FlagState.RAISED, FlagState.CLEAR)

    t_ns = START_NS + (t_s * 1e9).astype(np.int64)
    da = 0.01 * np.column_stack([np.sin(2 * phase), np.cos(2 * phase), np.sin(phase)])
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(
        folder / "truth.npz",
        tick=np.arange(t_s.size),
        t_true_gps_ns=t_ns,
        r_gcrf_m=r_m,
        v_gcrf_mps=np.zeros_like(r_m),
        fix_t_gps_ns=t_ns[:5000],
        fix_r_gcrf_m=r_m[:5000],
        fix_error_m=rng.normal(0.0, 1.0, (5000, 3)),
        da_t_gps_ns=t_ns[::10],
        da_true_mps2=da[::10],
        outages=START_NS + np.array([[start_s, end_s]] if outage else [], dtype=np.int64).reshape(-1, 2) * 10**9,
    )
    # The monitor hears flight only after start-up: its first ticks are missing.
    np.savez(folder / "monitor.npz", tick=np.arange(t_s.size)[3:], nav=nav[3:], integrity=integrity[3:])
    if estimate:
        noisy = da + rng.normal(0.0, 5e-4, da.shape)
        np.savez(folder / "estimate.npz", t_gps_ns=t_ns, da_mps2=noisy)
    (folder / "summary.json").write_text(json.dumps({"scenario": "synthetic", "integrated": {}, "outages": []}))
    return folder


def test_every_figure_is_drawn_and_has_a_picture_in_it(tmp_path: Path) -> None:
    """GIVEN a run with an outage WHEN figures are made THEN six PNGs of the same size, none of them blank."""
    paths = make_figures(write_run(tmp_path))

    assert [path.name for path in paths] == NAMES
    sizes = {struct.unpack(">II", path.read_bytes()[16:24]) for path in paths}
    assert len(sizes) == 1
    assert all(path.stat().st_size > 15_000 for path in paths)


def test_equal_runs_give_equal_files(tmp_path: Path) -> None:
    first = make_figures(write_run(tmp_path / "a"))
    second = make_figures(write_run(tmp_path / "b"))

    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]


def test_events_of_an_outage_are_found_where_arithmetic_puts_them(tmp_path: Path) -> None:
    """GIVEN bound 2 + 0.0076 t^2 and error 0.003 t^2 THEN flag at 512.8 s and crossing at 816.5 s."""
    (outage,) = load_run(write_run(tmp_path)).outages

    assert outage.last_fix_s == pytest.approx(5580.0, abs=1e-6)
    assert outage.flag_s == pytest.approx(5580.0 + FLAG_AGE_S, abs=1.0)
    assert outage.crossed_s == pytest.approx(5580.0 + 816.5, abs=1.5)
    assert outage.back_in_service_s == pytest.approx(7580.0 + 30.0, abs=1.0)


def test_nothing_is_read_as_an_error_before_flight_has_a_state(tmp_path: Path) -> None:
    run = load_run(write_run(tmp_path))
    starting = run.mode == Mode.INIT

    assert starting.any()
    assert np.isnan(run.error_m[starting]).all()
    assert np.isnan(run.bound_m[starting]).all()
    assert np.isfinite(run.error_m[~starting]).all()


def test_ticks_without_output_are_left_out(tmp_path: Path) -> None:
    """GIVEN ticks on which nothing was published (rows of zeros) THEN they are no error of 6800 km."""
    run_dir = write_run(tmp_path)
    monitor = dict(np.load(run_dir / "monitor.npz"))
    monitor["has_nav"] = np.arange(monitor["tick"].size) % 7 != 0
    monitor["nav"][~monitor["has_nav"]] = np.zeros((), NAV_STATE.dtype)
    monitor["nav"]["validity"] = Validity.INITIALISED
    np.savez(run_dir / "monitor.npz", **monitor)
    run = load_run(run_dir)

    assert run.t_s.size == np.count_nonzero(monitor["has_nav"])
    assert np.nanmax(run.error_m[run.t_s > 100.0]) < 13_000.0


def test_a_run_without_outage_and_without_estimate_is_drawn(tmp_path: Path) -> None:
    run_dir = write_run(tmp_path, outage=False, estimate=False)

    assert len(make_figures(run_dir)) == len(NAMES)
    assert load_run(run_dir).outages == ()


def test_a_run_that_never_initialised_is_drawn(tmp_path: Path) -> None:
    """GIVEN flight that only ever said INIT WHEN figures are made THEN they are empty, not an exception."""
    run_dir = write_run(tmp_path)
    monitor = dict(np.load(run_dir / "monitor.npz"))
    monitor["integrity"]["mode"] = Mode.INIT
    monitor["nav"]["validity"] = 0
    np.savez(run_dir / "monitor.npz", **monitor)

    assert len(make_figures(run_dir)) == len(NAMES)


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda d: (d / "truth.npz").unlink(), "no truth.npz"),
        (lambda d: (d / "monitor.npz").write_bytes(b"PK\x03\x04 not an archive"), "monitor.npz: unreadable"),
        (lambda d: (d / "summary.json").write_text("[1]"), "not a JSON object"),
        (lambda d: np.savez(d / "truth.npz", tick=np.arange(3)), "do not fit together"),
    ],
)
def test_a_damaged_run_is_refused_by_name(tmp_path: Path, damage: Any, says: str) -> None:
    run_dir = write_run(tmp_path)
    damage(run_dir)

    with pytest.raises(NotARun, match=says):
        make_figures(run_dir)


def test_thinning_keeps_the_peak_and_the_gap() -> None:
    t = np.arange(100_000.0)
    y = np.sin(t / 500.0)
    y[54_321] = 9.0
    y[20_000:30_000] = np.nan

    thinned_t, thinned_y = style.thin(t, y, 500)

    assert thinned_t.size <= 1000
    assert np.nanmax(thinned_y) == 9.0
    assert np.isnan(thinned_y[(thinned_t > 20_500) & (thinned_t < 29_500)]).all()


def test_buckets_give_the_rms_of_noise() -> None:
    rng = np.random.default_rng(3)
    b = style.buckets(np.arange(100_000.0), rng.normal(1.0, 2.0, 100_000), 10)

    np.testing.assert_allclose(b.mean, 1.0, atol=0.1)
    np.testing.assert_allclose(b.rms, np.sqrt(5.0), rtol=0.05)


@pytest.mark.parametrize(
    ("value", "text"), [(2000.0, "2 km"), (999.6, "1 km"), (0.1, "0.1 m"), (494.2, "494 m"), (np.nan, "none")]
)
def test_metres_are_written_as_people_say_them(value: float, text: str) -> None:
    assert style.metres(value) == text


def report(run_dir: Path) -> int:
    parser = argparse.ArgumentParser()
    command.add_arguments(parser.add_subparsers())
    return command.run(parser.parse_args(["report", str(run_dir)]))


def test_report_makes_figures_again_and_prints_the_verdict(tmp_path: Path, capsys: Any) -> None:
    run_dir = write_run(tmp_path)

    assert report(run_dir) == 0
    assert "VERDICT: NO OUTAGE" in capsys.readouterr().out
    assert sorted(path.name for path in (run_dir / "figures").iterdir()) == NAMES


def test_report_refuses_a_folder_that_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(NotARun, match="no such folder"):
        report(tmp_path / "absent")
    with pytest.raises(NotARun, match=r"not a run: no summary\.json"):
        report(tmp_path)
    (tmp_path / "summary.json").write_text("{}")
    with pytest.raises(NotARun, match="no scenario, integrated, outages"):
        report(tmp_path)


if __name__ == "__main__":  # python tests/unit/test_reports_figures.py DIR: look at the pictures
    import sys

    began = time.perf_counter()
    write_run(Path(sys.argv[1]), tick_s=0.1)
    print(f"written in {time.perf_counter() - began:.1f} s")
    began = time.perf_counter()
    print(make_figures(Path(sys.argv[1])), f"{time.perf_counter() - began:.1f} s")
