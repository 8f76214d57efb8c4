"""The flight force model alone against real precise orbits, from their published states, over 2000 s.

Frames through the flight Earth-orientation table and kernels. Starts 1000 s apart over the whole of every file, none
left out. ISSUE: median <= 0.4 m, max <= 0.8 m, largest axis, on Sentinel-3A and GRACE-FO C.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ground.accuracy.command import GRAVITY, ORBITS
from ground.accuracy.flight_model import FlightModel
from ground.accuracy.forces import flight_errors
from ground.accuracy.orbits import ReferenceOrbit, read_orbit
from ground.tables.gps_time import day_of_gps
from hil_sim.truth.earth_rotation import EarthOrientation
from hil_sim.truth.orbit_files.read import read_orbit as read_file

pytestmark = pytest.mark.real_data

SENTINEL_3A, GRACE_C, JASON_2, SENTINEL_1A = ORBITS


@cache
def orbit_of(path: Path) -> ReferenceOrbit:
    if not path.is_file():
        pytest.skip(f"{path.name} is not among the real data")
    return read_orbit(path)


def model_for(folder: Path, orbit: ReferenceOrbit, name: str, degree: int) -> FlightModel:
    gravity = folder / GRAVITY
    if not gravity.is_file():
        pytest.skip(f"{gravity.name} is not among the real data")
    middle = int(orbit.t_gps_ns[len(orbit.t_gps_ns) // 2])
    settings = {"degree": degree, "area_to_mass_m2pkg": ORBITS[name]}
    return FlightModel(orbit.orientation, gravity, settings, day_of_gps(middle))


@pytest.mark.parametrize(
    ("name", "degree", "median_m", "max_m"),
    [
        (SENTINEL_3A, 50, 0.4, 0.8),  # measured 0.09 and 0.32
        (SENTINEL_3A, 70, 0.4, 0.8),  # 0.08 and 0.27
        (GRACE_C, 70, 0.4, 0.8),  # 0.09 and 0.30
        (GRACE_C, 50, 0.4, 1.5),  # 0.23 and 1.16: at 500 km what lies beyond degree 50 is worth a metre
        (JASON_2, 50, 0.4, 0.8),  # 0.05 and 0.51, which satkit errs by too
        (SENTINEL_1A, 70, 0.4, 0.8),  # 0.09 and 0.16
    ],
    ids=["sentinel3a-50", "sentinel3a-70", "gracefo-70", "gracefo-50", "jason2-50", "sentinel1a-70"],
)
def test_2000_s_from_every_published_state(
    real_data: Path, name: str, degree: int, median_m: float, max_m: float
) -> None:
    """GIVEN every start of the file WHEN the model carries it 2000 s THEN it meets the orbit within the figures."""
    orbit = orbit_of(real_data / name)
    errors, _ = flight_errors(model_for(real_data, orbit, name, degree), orbit, 2000)
    print(f"{orbit.name} {degree}x{degree}: {len(errors.error_m)} starts, median {np.median(errors.error_m):.3f} m,")
    print(f"max {errors.error_m.max():.3f} m")
    assert len(errors.error_m) >= (10 if name == SENTINEL_1A else 80)
    assert np.median(errors.error_m) <= median_m
    assert errors.error_m.max() <= max_m


@pytest.mark.parametrize("name", [SENTINEL_3A, JASON_2, SENTINEL_1A], ids=["sentinel3a", "jason2", "sentinel1a"])
def test_frames_of_flight_agree_with_those_of_the_world(real_data: Path, name: str) -> None:
    """Two programs turn one Earth-fixed file to GCRF; the world takes daily values linearly: a centimetre or two."""
    orbit = orbit_of(real_data / name)
    world = EarthOrientation(int(orbit.t_gps_ns[0]), int(orbit.t_gps_ns[-1]))
    r_itrf, v_itrf = world.to_itrf(orbit.t_gps_ns, orbit.x[:, :3], orbit.x[:, 3:])
    samples = read_file(real_data / name)
    assert np.abs(r_itrf - samples.r_m).max() < 0.03
    assert np.abs(v_itrf - samples.v_mps).max() < 6e-5


def test_sentinel_file_reads_as_its_own_derivative_says(real_data: Path) -> None:
    """GIVEN positions and velocities 10 s apart WHEN positions are differentiated THEN they give the velocities."""
    path = real_data / SENTINEL_1A
    if not path.is_file():
        pytest.skip(f"{path.name} is not among the real data")
    samples = read_file(path)
    r = samples.r_m
    assert len(r) == 1186
    assert set(np.diff(samples.t_gps_ns)) == {10_000_000_000}
    # TAI=2023-08-23T12:32:16.035127 of the first vector, less 19 s, in days of GPS time since 1980-01-06
    assert samples.t_gps_ns[0] == (15935 * 86400 + 12 * 3600 + 31 * 60 + 57) * 10**9 + 35_127_000
    weights = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))
    slope = sum(w * (r[4 + k : len(r) - 4 + k] - r[4 - k : len(r) - 4 - k]) for k, w in weights) / 10.0
    assert np.abs(slope - samples.v_mps[4:-4]).max() < 1e-3
