"""Fixes solved from observations, against satellites and a receiver that move in an inertial frame (gnss_files)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from gnss_files import T0_NS, World, to_earth_fixed, write_rinex

from hil_sim.errors import DataError
from hil_sim.gnss import carrier_velocity, single_point
from hil_sim.gnss.antennas import offsets_toward_earth_m
from hil_sim.gnss.exclusion import Verdict, chi_square_threshold
from hil_sim.gnss.precise_ephemeris import PreciseEphemeris
from hil_sim.gnss.recording import solve_recording
from hil_sim.gnss.rinex_obs import read_observations
from hil_sim.truth.earth_rotation import EarthOrientation

STAMPS_S = np.arange(0.0, 3600.0, 10.0)
# SP3 prints half a millimetre, RINEX the same, and the geometry multiplies: 3 mm at worst of centimetres
POSITION_M = 0.02


def solved(folder: Path, world: World, ranges: dict[int, np.ndarray], antennas: bool = False, **options):
    """Observations, ephemeris, ranges and fixes of a written recording."""
    observed = read_observations(write_rinex(folder / "x.10o", STAMPS_S, ranges, **options))
    ephemeris = PreciseEphemeris([world.write_sp3(folder / "x.sp3")], antennas)
    corrected = single_point.corrected_ranges(observed, ephemeris)
    return observed, ephemeris, corrected, single_point.solve(observed, corrected)


def error_m(world: World, fixes) -> np.ndarray:
    """Distance of good fixes (n,) [m] from the receiver at the times that the fixes say."""
    t_s = (fixes.t_gps_ns - T0_NS) / 1e9
    return np.linalg.norm(fixes.r_itrf_m - world.receiver_earth_fixed(t_s), axis=1)[fixes.good]


def test_fixes_are_where_the_receiver_was(tmp_path: Path) -> None:
    """GIVEN noiseless ranges with light time, the Earth's turn, clocks and relativity WHEN solved THEN centimetres.

    Left out, the turn alone would cost 30 m, relativity up to 14 m, the receiver's clock 2 mm of motion.
    """
    world = World()
    observed, _, _, fixes = solved(tmp_path, world, world.observe(STAMPS_S))
    assert fixes.good.all()
    assert error_m(world, fixes).max() < POSITION_M
    assert np.abs(fixes.clock_m / 299_792_458.0 - world.clock_s).max() < 1e-10
    assert np.all(observed.t_ns - fixes.t_gps_ns == round(world.clock_s * 1e9))


@pytest.mark.parametrize("clock_s", [-3e-4, 2e-3])
def test_a_receiver_clock_far_off_moves_the_time_of_the_fix(tmp_path: Path, clock_s: float) -> None:
    """GIVEN a receiver whose clock is off by milliseconds WHEN solved THEN the fix is right at the true instant."""
    world = World(clock_s=clock_s)
    _, _, _, fixes = solved(tmp_path, world, world.observe(STAMPS_S))
    assert error_m(world, fixes).max() < POSITION_M


def test_antennas_are_put_in_their_places(tmp_path: Path) -> None:
    """GIVEN signals from antennas up to 2.7 m below the centres of mass WHEN solved THEN it shows who knows of them."""
    offsets = offsets_toward_earth_m(T0_NS, T0_NS + 10**9)
    world = World(antenna_m=np.concatenate(([0.0], offsets)))
    ranges = world.observe(STAMPS_S)
    _, _, _, fixes = solved(tmp_path, world, ranges, antennas=True)
    assert error_m(world, fixes).max() < POSITION_M
    _, _, _, without = solved(tmp_path, world, ranges)
    assert 0.3 < np.median(error_m(world, without)) < 3.0
    assert np.median(without.sigma_m) > 3.0 * np.median(fixes.sigma_m)  # and it knows that it knows less


def test_antennas_of_another_year_are_refused() -> None:
    with pytest.raises(DataError, match=r"2010-05-28 to 2011-07-16, not for 2018-.*recorded_antennas = false"):
        offsets_toward_earth_m(14_000 * 86_400 * 10**9, 14_001 * 86_400 * 10**9)


def test_no_clock_is_interpolated_across_a_missing_one(tmp_path: Path) -> None:
    """GIVEN a satellite without clock at 30 min WHEN solved THEN it is left out from 15 to 45 min, and nothing errs."""
    world = World()
    ranges = world.observe(STAMPS_S)
    prn = next(prn for prn, values in ranges.items() if np.isfinite(values[150]))
    observed = read_observations(write_rinex(tmp_path / "x.10o", STAMPS_S, ranges))
    ephemeris = PreciseEphemeris([world.write_sp3(tmp_path / "x.sp3", missing=(prn,))], antennas=False)
    corrected = single_point.corrected_ranges(observed, ephemeris)
    lost = np.isinf(corrected.sigma_m)
    minutes = (observed.t_ns[observed.epoch] - T0_NS) / 60e9
    hit = (observed.prn == prn) & (minutes > 15.0) & (minutes <= 45.0)  # signals left a moment before
    assert hit.sum() > 10
    assert np.array_equal(lost, hit)
    assert corrected.without_clock == hit.sum()
    fixes = single_point.solve(observed, corrected)
    assert error_m(world, fixes).max() < POSITION_M


def test_one_faulty_satellite_is_found_and_left_out(tmp_path: Path) -> None:
    """GIVEN 15 m too much on one satellite WHEN solved THEN just it is excluded and the fix is right again."""
    world = World()
    ranges = world.observe(STAMPS_S)
    prn = max(ranges, key=lambda who: np.isfinite(ranges[who]).sum())
    ranges[prn] = ranges[prn] + 15.0
    observed, _, _, fixes = solved(tmp_path, world, ranges)
    hit = (observed.prn == prn) & (fixes.satellites[observed.epoch] >= 5)
    excluded = fixes.checked.excluded[observed.epoch, fixes.place]
    assert hit.sum() > 50
    assert np.array_equal(excluded, hit)
    assert error_m(world, fixes).max() < POSITION_M


def test_two_faulty_satellites_are_found(tmp_path: Path) -> None:
    """GIVEN two satellites wrong at once, one of which hides the other WHEN solved THEN both are named."""
    world = World()
    ranges = world.observe(STAMPS_S)
    long = sorted(ranges, key=lambda who: np.isfinite(ranges[who]).sum())[-2:]
    ranges[long[0]] = ranges[long[0]] + 15.0
    ranges[long[1]] = ranges[long[1]] - 40.0
    observed, _, _, fixes = solved(tmp_path, world, ranges)
    excluded = fixes.checked.excluded
    both = excluded.sum(axis=1) == 2
    assert both.sum() > 20
    assert set(observed.prn[excluded[observed.epoch, fixes.place]]) == set(long)
    clean = both | ~np.isin(np.arange(len(fixes.good)), observed.epoch[np.isin(observed.prn, long)])
    assert error_m(world, fixes)[clean[fixes.good]].max() < POSITION_M


def test_too_few_satellites_are_no_fix_and_four_are_unchecked(tmp_path: Path) -> None:
    world = World()
    ranges = world.observe(STAMPS_S)
    seen = [prn for prn, values in ranges.items() if np.isfinite(values[:3]).all()]
    for prn in ranges:
        ranges[prn][0] = ranges[prn][0] if prn in seen[:3] else np.nan
        ranges[prn][1] = ranges[prn][1] if prn in seen[:4] else np.nan
    _, _, _, fixes = solved(tmp_path, world, ranges)
    assert [Verdict(v) for v in fixes.verdict[:3]] == [Verdict.TOO_FEW, Verdict.UNCHECKED, Verdict.GOOD]
    assert not fixes.good[0]
    assert np.isnan(fixes.r_itrf_m[0]).all()


def test_covariance_tells_the_scatter(tmp_path: Path) -> None:
    """GIVEN noise of the sigma that the strength stands for WHEN solved THEN errors scatter as the covariance says."""
    world = World(antenna_m=np.concatenate(([0.0], offsets_toward_earth_m(T0_NS, T0_NS + 10**9))))
    rng = np.random.default_rng(7)
    sigma_m = float(single_point.pseudorange_sigma_m(np.array([40.0]), 1)[0])
    assert 0.4 < sigma_m < 0.5  # code minus carrier of GRACE-B between 35 and 50: 0.45 m
    # the ionosphere-free combination of equal errors on both frequencies is that error
    ranges = {
        prn: values + sigma_m * rng.standard_normal(len(values)) for prn, values in world.observe(STAMPS_S).items()
    }
    _, _, _, fixes = solved(tmp_path, world, ranges, antennas=True, strength=40.0)
    t_s = (fixes.t_gps_ns - T0_NS) / 1e9
    error = (fixes.r_itrf_m - world.receiver_earth_fixed(t_s))[fixes.good]
    nees = np.einsum("mi,mi->m", error, np.linalg.solve(fixes.covariance_m2[fixes.good], error[..., None])[..., 0])
    # chi-square with 3 degrees of freedom, 360 epochs: mean 3 within four sigmas
    assert abs(nees.mean() - 3.0) < 4.0 * np.sqrt(6.0 / len(nees))


# CRC Standard Mathematical Tables: chi-square exceeded with probability 0.001 and 0.05
@pytest.mark.parametrize(
    ("freedom", "at_001", "at_05"),
    [(1, 10.828, 3.841), (2, 13.816, 5.991), (3, 16.266, 7.815), (4, 18.467, 9.488), (7, 24.322, 14.067)],
)
def test_chi_square_as_tabled(freedom: int, at_001: float, at_05: float) -> None:
    assert chi_square_threshold(freedom) == pytest.approx(at_001, abs=6e-4)
    assert chi_square_threshold(freedom, 0.05) == pytest.approx(at_05, abs=6e-4)


def test_carrier_gives_velocity(tmp_path: Path) -> None:
    """GIVEN phases that count ranges to half a millimetre WHEN differenced THEN velocity to a few mm/s, at the epoch.

    The mean velocity of the 10 s before would be 40 m/s off. The world's Earth turns about z of the frame; that of the
    product has precessed by 23 mas a day of its table, which is why inertial velocity is not compared.
    """
    world = World()
    observed, ephemeris, corrected, fixes = solved(tmp_path, world, world.observe(STAMPS_S))
    orientation = EarthOrientation(int(observed.t_ns[0]), int(observed.t_ns[-1]))
    found = carrier_velocity.solve(observed, corrected, fixes, ephemeris, orientation)
    assert found.good[1:].all()
    assert not found.good[0]
    t_s = (fixes.t_gps_ns - T0_NS) / 1e9
    h = 0.05
    places = [world.receiver_earth_fixed(t_s + k * h) for k in (-2, -1, 1, 2)]
    v = (places[0] - 8.0 * places[1] + 8.0 * places[2] - places[3]) / (12.0 * h)
    error = np.linalg.norm(found.v_itrf_mps - v, axis=1)[1:]
    # this world has no J2, the solver does: 5 s of 0.024 m/s2 at the poles
    assert 0.02 < error.max() < 0.15
    bare = _without_j2(observed, ephemeris, corrected, fixes, orientation)
    assert np.linalg.norm(bare - v, axis=1)[1:].max() < 5e-3


def _without_j2(observed, ephemeris, corrected, fixes, orientation) -> np.ndarray:
    """Velocities of the solver where its gravity is that of this world."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(carrier_velocity, "J2", 0.0)
        return carrier_velocity.solve(observed, corrected, fixes, ephemeris, orientation).v_itrf_mps


def test_slips_of_the_carrier_are_left_out(tmp_path: Path) -> None:
    """GIVEN a slip that the receiver tells of, and one that it does not WHEN differenced THEN no velocity is spoilt."""
    world = World()
    ranges = world.observe(STAMPS_S)
    prn = max(ranges, key=lambda who: np.isfinite(ranges[who]).sum())
    at = np.flatnonzero(np.isfinite(ranges[prn]))
    path = write_rinex(tmp_path / "x.10o", STAMPS_S, ranges, slips=((int(at[20]), prn),))
    text = path.read_text()
    ephemeris = PreciseEphemeris([world.write_sp3(tmp_path / "x.sp3")], antennas=False)
    outcomes = []
    for silent in (False, True):
        if silent:
            path.write_text("\n".join(_without_lock_bit(line) for line in text.splitlines()) + "\n")
        observed = read_observations(path)
        corrected = single_point.corrected_ranges(observed, ephemeris)
        fixes = single_point.solve(observed, corrected)
        orientation = EarthOrientation(int(observed.t_ns[0]), int(observed.t_ns[-1]))
        outcomes.append(carrier_velocity.solve(observed, corrected, fixes, ephemeris, orientation))
    told, untold = outcomes
    assert (told.excluded, untold.excluded) == (0, 1)
    assert np.nanmax(np.abs(told.v_itrf_mps - untold.v_itrf_mps)) < 5e-3


def _without_lock_bit(line: str) -> str:
    """A line of observations with its first two loss-of-lock columns blank."""
    if len(line) < 80 or line[14:15] not in "01":
        return line
    return line[:14] + " " + line[15:30] + " " + line[31:]


def test_recording_is_what_its_parts_give(tmp_path: Path) -> None:
    world = World()
    ranges = world.observe(STAMPS_S)
    rinex = write_rinex(tmp_path / "x.10o", STAMPS_S, ranges)
    recording = solve_recording(rinex, [world.write_sp3(tmp_path / "x.sp3")], antennas=False)
    t_s = (recording.t_gps_ns - T0_NS) / 1e9
    assert np.linalg.norm(recording.r_itrf_m - world.receiver_earth_fixed(t_s), axis=1).max() < POSITION_M
    assert recording.counts["epochs"] == recording.counts["fixes"] == len(STAMPS_S)
    assert recording.counts["velocities"] == len(STAMPS_S) - 1 == recording.has_velocity.sum()
    assert recording.counts["observations"] == sum(int(np.isfinite(values).sum()) for values in ranges.values())
    assert to_earth_fixed(np.zeros(1), np.ones((1, 3))).tolist() == [[1.0, 1.0, 1.0]]


def test_what_does_not_serve_is_refused(tmp_path: Path) -> None:
    world = World()
    rinex = write_rinex(tmp_path / "x.10o", STAMPS_S[:5], world.observe(STAMPS_S[:5]))
    with pytest.raises(DataError, match="no precise orbit file"):
        solve_recording(rinex, [])
    with pytest.raises(DataError, match=r"y\.sp3: no such file"):
        solve_recording(rinex, [tmp_path / "y.sp3"])
    late = world.write_sp3(tmp_path / "late.sp3", (24.0, 30.0))
    with pytest.raises(DataError, match="no satellite clock for any of its observations; name SP3 files of its days"):
        solve_recording(rinex, [late], antennas=False)
    short = world.write_sp3(tmp_path / "short.sp3", (0.0, 1.0))
    with pytest.raises(DataError, match=r"short\.sp3: their epochs do not form one grid"):
        solve_recording(rinex, [short], antennas=False)
    gap = [world.write_sp3(tmp_path / name, hours) for name, hours in (("a.sp3", (-4.0, 0.0)), ("b.sp3", (1.0, 5.0)))]
    with pytest.raises(DataError, match=r"a\.sp3, b\.sp3: their epochs do not form one grid"):
        solve_recording(rinex, gap, antennas=False)
