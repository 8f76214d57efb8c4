"""GRACE-B's own pseudoranges on the bus: solved, tested and cleaned by flight, beside the fixes of the world."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from gnss_bench import checks, satellites
from harness import Flight, load

from flightsw.icd.enums import FlagState, GnssVerdict, Mode
from hil_sim.gnss import single_point
from hil_sim.gnss.precise_ephemeris import PreciseEphemeris
from hil_sim.gnss.recording import solve_recording
from hil_sim.gnss.rinex_obs import read_observations
from hil_sim.sensors.attitude import Pointing
from hil_sim.truth.earth_rotation import EarthOrientation

pytestmark = pytest.mark.real_data

DURATION_S = 1800
WITHOUT_CLOCK = 'time.start="2010-07-27T01:40:00"'  # the precise files have no clock of G09 for a quarter of an hour
WITH_OUTLIER = 'time.start="2010-07-27T10:10:00"'  # one satellite disagrees with the others for half an hour
FOLDER = "leo_grace"
OBSERVATIONS = "GRCB2080_00h-12h.10o.gz"
ORBITS = tuple(f"COD1594{day}.EPH.sp3.gz" for day in (1, 2, 3))
ANTENNA_M = (0.0, 0.0, -0.4)
LIFT = 'satellite_fault=[{kind="lift", start_s=900.0, duration_s=300.0, value=0.5}]'
FAULT = 'satellite_fault=[{kind="step", constellation="gps", count=1, start_s=900.0, duration_s=300.0, value=25.0}]'


class Flown(NamedTuple):
    """A flight, and the fixes that navigation was told: times (n,), error against the precise orbit (n,) [m]."""

    flight: Flight
    t_gps_ns: np.ndarray
    error_m: np.ndarray


@pytest.fixture(scope="module")
def folder(real_data: Path) -> Path:
    lacking = [name for name in (OBSERVATIONS, *ORBITS) if not (real_data / FOLDER / name).is_file()]
    if lacking:
        pytest.skip(f"{', '.join(lacking)} not among the real data")
    return real_data / FOLDER


@cache
def fly(*settings: str) -> Flown:
    times, places = [], []
    with Flight(load(f"time.duration_s={DURATION_S}", *settings, name="graceb_pseudoranges")) as flight:
        while flight.k < flight.world.n_ticks:
            flight.tick()
            if flight.out["fix_seen"][0]:
                times.append(int(flight.loop.fix_input["fix_gps_ns"][0]))
                places.append(flight.loop.fix_input["fix_r_itrf_m"][0].copy())
    t = np.array(times)
    return Flown(flight, t, error_of(flight, t, np.array(places)))


def error_of(flight: Flight, t: np.ndarray, r_itrf_m: np.ndarray) -> np.ndarray:
    """Distance (n,) [m] from the antenna of the precise orbit."""
    truth = flight.world.truth
    orientation = EarthOrientation(int(t[0]), int(t[-1]), None)
    found, _ = orientation.to_gcrf(t, r_itrf_m, np.zeros_like(r_itrf_m))
    antenna = truth.state_gcrf(t)[0] + Pointing().lever(truth, t, np.array(ANTENNA_M))[0]
    return np.linalg.norm(found - antenna, axis=1)


def test_flights_own_fixes_are_as_good_as_the_worlds(folder: Path) -> None:
    """GIVEN half an hour of recorded ranges THEN flight's fixes err by 1.3 m at most in the median (3-D, against CODE's
    orbit), and by no more than a twentieth above the world's own solution of the same epochs.
    """
    found = fly()
    assert len(found.t_gps_ns) >= 170
    assert np.median(found.error_m) <= 1.3
    world = solve_recording(folder / OBSERVATIONS, [folder / name for name in ORBITS], True)
    same = np.isin((world.t_gps_ns + 500_000) // 1_000_000, (found.t_gps_ns + 500_000) // 1_000_000)
    assert same.sum() >= 165
    theirs = error_of(found.flight, world.t_gps_ns[same], world.r_itrf_m[same])
    assert np.median(found.error_m) <= 1.05 * np.median(theirs)
    assert found.flight.out["mode"][0] == Mode.INTEGRATED


def test_a_satellite_without_a_clock_never_comes_to_the_test(folder: Path) -> None:
    """GIVEN G09 without a clock THEN it is refused before the test while that lasts (its last known place serves for a
    minute more), it is in no fix, and every epoch with five others is tested and gives one.
    """
    found = fly(WITHOUT_CLOCK)
    judged, used = checks(found.flight), satellites(found.flight, excluded=False)
    raw = found.flight.world.raw
    assert raw is not None
    ephemeris = PreciseEphemeris([folder / name for name in ORBITS], True)
    lacks = np.isnan(ephemeris.states(np.full(len(raw.t_gps_ns), 9), raw.t_gps_ns).clock_s)
    without = np.flatnonzero(raw.seen[: len(judged), 8] & lacks[: len(judged)])
    assert len(without) >= 60
    settled = without[7:]
    assert (judged["refused"][settled] == 1).all()
    assert not any("G9" in used[k] for k in settled)
    others = raw.seen[: len(judged)].sum(axis=1) - judged["refused"]
    told = np.isin(judged["gnss_verdict"], (GnssVerdict.CONSISTENT, GnssVerdict.EXCLUDED))
    assert told[others >= 5].all()
    assert not told[others < 5].any()
    assert np.median(found.error_m) <= 1.3


def test_a_real_outlier_is_named_as_the_world_names_it(folder: Path) -> None:
    """GIVEN a satellite that disagreed with the others that day THEN flight leaves out the one that the world's own
    test does, in nine of ten of its epochs, and the fixes stay within 1.3 m in the median.
    """
    found = fly(WITH_OUTLIER)
    observed = read_observations(folder / OBSERVATIONS)
    ephemeris = PreciseEphemeris([folder / name for name in ORBITS], True)
    solved = single_point.solve(observed, single_point.corrected_ranges(observed, ephemeris))
    rows = solved.checked.excluded[observed.epoch, solved.place]
    theirs = {
        (int(observed.t_ns[e]), f"G{prn}") for e, prn in zip(observed.epoch[rows], observed.prn[rows], strict=True)
    }
    judged, out = checks(found.flight), satellites(found.flight)
    ours = {(int(t), name) for t, names in zip(judged["t_gps_ns"], out, strict=True) for name in names}
    both = {pair for pair in theirs if judged["t_gps_ns"][0] <= pair[0] <= judged["t_gps_ns"][-1]}
    assert len(both) >= 50
    assert len(both & ours) >= 0.9 * len(both)
    assert np.median(found.error_m) <= 1.3


def test_a_fault_on_real_ranges_is_named_and_does_no_harm(folder: Path) -> None:
    """GIVEN 25 m on the highest satellite for five minutes THEN it is left out in nine of ten epochs that can tell, and
    the fixes stay as good.
    """
    clean, faulty = fly(), fly(FAULT)
    raw, good = faulty.flight.world.raw, clean.flight.world.raw
    assert raw is not None
    assert good is not None
    apart = raw.range_m - good.range_m
    (struck,) = np.flatnonzero(apart.any(axis=0))
    during = np.flatnonzero(apart[:, struck] != 0.0)
    out = satellites(faulty.flight)
    there = [k for k in during if raw.seen[k, struck] and k < len(out)]
    assert len(there) >= 10
    assert sum(f"G{struck + 1}" in out[k] for k in there) >= 0.9 * len(there)
    assert np.percentile(faulty.error_m, 95) <= np.percentile(clean.error_m, 95) + 0.5


def test_a_spoofer_on_real_ranges_meets_the_flag(folder: Path) -> None:
    """GIVEN ranges that agree on a place that rises by 0.5 m/s THEN the flag is up within 150 s of the onset,
    and no state without the flag errs by more than its bound or 3 m, though the test sees nothing.
    """
    flight = fly(LIFT).flight
    raw = flight.world.raw
    assert raw is not None
    seen = raw.seen & (raw.elevation_rad < 1.5)
    assert seen.sum() > 0.9 * raw.seen.sum()
    assert raw.elevation_rad[seen].min() < 0.5
    error, bound = flight.error_m(), flight.flown["bound_m"]
    clear = (flight.flown["flag"] == FlagState.CLEAR) & (flight.seconds > 600.0)
    assert (error[clear] <= np.minimum(bound[clear], 3.0)).all()
    up = flight.seconds[(flight.flown["flag"] != FlagState.CLEAR) & (flight.seconds > 900.0)]
    assert 900.0 < up[0] <= 1050.0
    age_s = (checks(flight)["t_gps_ns"] - flight.world.t_start_gps_ns) / 1e9
    told = [satellites(flight)[k] for k in np.flatnonzero((age_s > 900.0) & (age_s < 1200.0))]
    assert len(told) >= 25
    assert sum(bool(names) for names in told) <= 0.3 * len(told)


def test_gps_of_precise_orbits_is_a_sky_like_any(folder: Path) -> None:
    """GIVEN a simulated receiver of 1 m under the GPS satellites of SP3 files THEN its epochs agree, and the state errs
    by what one constellation of 1 m allows.
    """
    orbits = ", ".join(f'"{FOLDER}/{name}"' for name in ORBITS)
    sky = (f"pseudoranges.orbits=[{orbits}]", "pseudoranges.constellations=[]", "satellite_fault=[]")
    when = 'time.start="2010-07-27T03:00:00"'
    with Flight(load("time.duration_s=200", when, *sky, name="gnss_faults")) as flight:
        flight.fly()
    judged = checks(flight)
    assert len(judged) == 199
    assert (judged["gnss_verdict"] == GnssVerdict.CONSISTENT).mean() >= 0.97
    assert flight.error_m()[flight.seconds > 150.0].max() <= 2.0
