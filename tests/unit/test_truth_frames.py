"""Earth orientation of the simulator (pyerfa), against satkit's own IERS 2010 reduction and direct ERFA calls."""

import erfa
import numpy as np
import pytest

from hil_sim import gps_time
from hil_sim.errors import DataError
from hil_sim.truth.earth_rotation import OMEGA_RADPS, EarthOrientation, packaged_finals, read_finals
from hil_sim.truth.satkit_data import satkit_time, session

T0_NS = 1_230_336_018_000_000_000  # 2019-01-01T00:00:00 UTC
SPAN_NS = 6 * 3600 * gps_time.NS


@pytest.fixture(scope="module")
def orientation() -> EarthOrientation:
    return EarthOrientation(T0_NS, T0_NS + SPAN_NS)


def states(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    t = T0_NS + rng.integers(0, SPAN_NS // 1000, n) * 1000
    r = rng.standard_normal((n, 3))
    v = rng.standard_normal((n, 3))
    return t, 6.9e6 * r / np.linalg.norm(r, axis=1)[:, None], 7.6e3 * v / np.linalg.norm(v, axis=1)[:, None]


def test_agrees_with_satkit(orientation: EarthOrientation) -> None:
    """Two reductions by two libraries from one finals2000A: below 1 mm and 0.02 mm/s."""
    t, r_itrf, v_itrf = states(40)
    r, v = orientation.to_gcrf(t, r_itrf, v_itrf)
    with session(T0_NS, T0_NS + SPAN_NS) as satkit:
        for i in range(len(t)):
            peer_r, peer_v = satkit.frametransform.itrf_to_gcrf_state(r_itrf[i], v_itrf[i], satkit_time(satkit, t[i]))
            assert np.abs(r[i] - np.ravel(peer_r)).max() < 1e-3
            assert np.abs(v[i] - np.ravel(peer_v)).max() < 2e-5


def test_there_and_back(orientation: EarthOrientation) -> None:
    t, r_itrf, v_itrf = states(200)
    back_r, back_v = orientation.to_itrf(t, *orientation.to_gcrf(t, r_itrf, v_itrf))
    assert np.abs(back_r - r_itrf).max() < 1e-8
    assert np.abs(back_v - v_itrf).max() < 1e-11


def test_interpolated_precession_nutation_equals_direct(orientation: EarthOrientation) -> None:
    t, _, _ = states(50)
    matrices, _ = orientation.rotations(t)
    tt1, tt2 = gps_time.tt_two_part(t)
    xp, yp, ut1_tai, d_x, d_y = orientation.parameters(t)
    x, y, s = erfa.xys06a(tt1, tt2)
    direct = erfa.c2tcio(
        erfa.c2ixys(x + d_x, y + d_y, s),
        erfa.era00(tt1, tt2 + (ut1_tai - 32.184) / 86400.0),
        erfa.pom00(xp, yp, erfa.sp00(tt1, tt2)),
    )
    assert np.abs(matrices - direct).max() < 1e-13


def test_ut1_runs_through_a_leap_second_without_a_step() -> None:
    """GIVEN the leap second at the end of 2016 WHEN UT1 - TAI is taken around it THEN it changes by milliseconds."""
    leap_ns = 1_167_264_018_000_000_000  # 2017-01-01T00:00:00 UTC
    around = EarthOrientation(leap_ns - SPAN_NS, leap_ns + SPAN_NS)
    _, _, ut1_tai, _, _ = around.parameters(leap_ns + np.array([-3600, -1, 0, 1, 3600]) * gps_time.NS)
    assert np.ptp(ut1_tai) < 1e-3
    assert ut1_tai[2] == pytest.approx(-36.408, abs=2e-3)  # UT1-UTC +0.5914 s and TAI-UTC 37 s on that day


def test_polar_motion_belongs_in_the_velocity(orientation: EarthOrientation) -> None:
    """Leaving it out of w costs up to a millimetre per second at 6900 km."""
    t, r_itrf, v_itrf = states(200)
    matrices, omega = orientation.rotations(t)
    _, v = orientation.to_gcrf(t, r_itrf, v_itrf)
    untilted = np.einsum("nji,nj->ni", matrices, v_itrf + np.cross([0.0, 0.0, OMEGA_RADPS], r_itrf))
    assert 3e-4 < np.linalg.norm(v - untilted, axis=1).max() < 2e-3
    assert np.linalg.norm(omega, axis=1) == pytest.approx(OMEGA_RADPS, rel=1e-12)


def test_packaged_table_is_real() -> None:
    rows = read_finals(packaged_finals())
    day = rows[rows[:, 0] == 58484.0][0]  # 2019-01-01
    assert day[1:4] == pytest.approx([0.0763, 0.2680, -0.0374], abs=2e-2)
    assert np.all(np.diff(rows[:, 0]) == 1.0)


def test_span_outside_the_table_is_refused() -> None:
    far_ns = 2_500_000_000 * gps_time.NS  # 2059
    with pytest.raises(DataError, match="earth_orientation_file"):
        EarthOrientation(far_ns, far_ns + SPAN_NS)


def test_file_that_is_no_finals_is_refused(tmp_path) -> None:
    wrong = tmp_path / "finals.txt"
    wrong.write_text("this is not Earth orientation\n")
    with pytest.raises(DataError, match="finals2000A"):
        EarthOrientation(T0_NS, T0_NS + SPAN_NS, wrong)
