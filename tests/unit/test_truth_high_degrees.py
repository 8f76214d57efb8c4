"""Gravity beyond degree 70 in the truth: the field against another implementation, its effect against a direct run."""

import msgspec
import numpy as np
import pytest
from mpmath import mp, mpf

from hil_sim import gps_time, scenario
from hil_sim.errors import ScenarioError
from hil_sim.scenario_schema import MU_EGM2008_M3PS2, TruthModel
from hil_sim.truth import high_degrees, propagated
from hil_sim.truth.earth_rotation import EarthOrientation
from tests.unit.test_truth_propagated import ORBIT_500_KM

T0_NS = scenario.load("two_orbits").t_start_gps_ns
SECONDS = gps_time.NS


def potential(point: list[mpf], lowest: int, highest: int) -> mpf:
    """EGM96's potential [m2/s2] of some degrees at a point, by associated Legendre functions."""
    gm, radius, c, s = high_degrees._coefficients(highest)
    x, y, z = point
    r = mp.sqrt(x * x + y * y + z * z)
    t, u = z / r, mp.sqrt(x * x + y * y) / r
    longitude = mp.atan2(y, x)
    total, diagonal = mpf(0), mpf(1)
    for m in range(highest + 1):
        if m:
            diagonal *= (2 * m - 1) * u
        before, now = mpf(0), diagonal
        for n in range(m, highest + 1):
            if n > m:
                before, now = now, ((2 * n - 1) * t * now - (n + m - 1) * before) / (n - m)
            if n >= lowest:
                turned = mpf(c[n, m]) * mp.cos(m * longitude) + mpf(s[n, m]) * mp.sin(m * longitude)
                total += (mpf(radius) / r) ** n * now * turned
    return mpf(gm) / r * total


@pytest.mark.parametrize("latitude_deg", [-89.9999, -37.0, 0.0, 61.5, 89.0])
def test_the_field_is_the_gradient_of_the_potential(latitude_deg: float) -> None:
    """GIVEN a point at 400 km, also next to the pole WHEN the potential, summed with 60 digits, is differentiated THEN
    it is the acceleration, to 1e-9 of it."""
    latitude, longitude = np.radians(latitude_deg), 0.7
    r = 6_778_136.3 * np.array(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)]
    )
    with mp.workdps(60):
        h = mpf("1e-3")
        expected = []
        for axis in range(3):
            ends = []
            for way in (1, -1):
                point = [mpf(float(k)) for k in r]
                point[axis] += way * h
                ends.append(potential(point, 71, 76))
            expected.append(float((ends[0] - ends[1]) / (2 * h)))
    found = high_degrees.acceleration_itrf(r[None, :], 71, 76)[0]
    assert np.linalg.norm(found - expected) < 1e-9 * np.linalg.norm(expected)


def test_degrees_to_seventy_are_what_satkit_lacks() -> None:
    """GIVEN truths of satkit to degree 50 and to degree 70 WHEN degrees 51 to 70 are added to the first THEN it follows
    the second within a third of the difference: so far EGM96, of ten years before GRACE, may be from EGM2008."""
    duration = 3000 * SECONDS
    low = propagated.propagate(ORBIT_500_KM, TruthModel(gravity_degree=50), T0_NS, duration)
    high = propagated.propagate(ORBIT_500_KM, TruthModel(gravity_degree=70), T0_NS, duration)
    added = propagated.propagate(ORBIT_500_KM, TruthModel(gravity_degree=50, gravity_beyond=70), T0_NS, duration)
    t = T0_NS + np.arange(0, 3001, 100, dtype=np.int64) * SECONDS
    wanted = high.state_gcrf(t)[0] - low.state_gcrf(t)[0]
    found = added.state_gcrf(t)[0] - low.state_gcrf(t)[0]
    assert np.linalg.norm(wanted[-1]) > 0.5
    assert np.linalg.norm(found - wanted, axis=1).max() < np.linalg.norm(wanted, axis=1).max() / 3
    assert np.abs(found[0]).max() < 1e-9


def test_the_displacement_is_that_of_a_direct_integration() -> None:
    """GIVEN degrees 71 to 110 at 400 km WHEN a two-body motion is integrated directly with and without them in steps of
    1 s THEN the difference is the displacement along that motion, to 1e-3 of it."""
    orbit = msgspec.structs.replace(ORBIT_500_KM, semi_major_axis_m=6_778_136.3)
    start = propagated.initial_state(orbit)
    span = 300
    t = T0_NS + np.arange(2 * span + 1, dtype=np.int64) * SECONDS // 2
    matrices, _ = EarthOrientation(int(t[0]), int(t[-1])).rotations(t)

    def rate(y: np.ndarray, k: int, whole: bool) -> np.ndarray:
        a = -MU_EGM2008_M3PS2 / np.linalg.norm(y[:3]) ** 3 * y[:3]
        if whole:
            a = a + matrices[k].T @ high_degrees.acceleration_itrf((matrices[k] @ y[:3])[None, :], 71, 110)[0]
        return np.concatenate((y[3:], a))

    def fly(whole: bool) -> np.ndarray:
        y, rows = start.copy(), [start]
        for k in range(span):
            k1 = rate(y, 2 * k, whole)
            k2 = rate(y + 0.5 * k1, 2 * k + 1, whole)
            k3 = rate(y + 0.5 * k2, 2 * k + 1, whole)
            k4 = rate(y + k3, 2 * k + 2, whole)
            y = y + (k1 + 2 * k2 + 2 * k3 + k4) / 6.0
            rows.append(y)
        return np.array(rows)

    known = fly(False)
    tens = known[::10]
    track = high_degrees.HermiteTrack(T0_NS, 10 * SECONDS, tens[:, :3].copy(), tens[:, 3:].copy())
    moved = high_degrees.displace(track, T0_NS, (71, 110))
    at = T0_NS + np.arange(0, span + 1, 7, dtype=np.int64) * SECONDS
    found = moved.evaluate(at)[0] - track.evaluate(at)[0]
    wanted = (fly(True) - known)[::7, :3]
    assert np.linalg.norm(wanted[-1]) > 0.005
    assert np.linalg.norm(found - wanted, axis=1).max() < 1e-3 * np.linalg.norm(wanted, axis=1).max()


@pytest.mark.parametrize("degrees", [(1, 10), (80, 71), (71, 121)])
def test_degrees_it_does_not_have_are_refused(degrees: tuple[int, int]) -> None:
    """GIVEN degrees out of range or order WHEN a field is asked of them THEN it is refused."""
    with pytest.raises(ValueError, match="degrees"):
        high_degrees.acceleration_itrf(np.array([[7e6, 0.0, 0.0]]), *degrees)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (("truth.gravity_beyond=50",), ("truth.gravity_beyond", "not above truth.gravity_degree")),
        (("truth.gravity_beyond=121",), ("truth.gravity_beyond",)),
    ],
)
def test_a_wrong_degree_is_refused_by_name(settings: tuple[str, ...], words: tuple[str, ...]) -> None:
    """GIVEN a degree that adds nothing, or more than there is WHEN the scenario is loaded THEN the key is named."""
    with pytest.raises(ScenarioError) as caught:
        scenario.load("two_orbits", settings)
    for word in words:
        assert word in str(caught.value)
