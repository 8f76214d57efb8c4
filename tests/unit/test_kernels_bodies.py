"""Sun and Moon against the JPL ephemeris, their attraction against 40 digits, the tide against its definition."""

from __future__ import annotations

import numpy as np
import pytest
from flight_bench import T0_GPS_NS, circular_orbit, record
from force_bench import bare_field, flight_model, satkit_moved
from mpmath import mp, mpf

from flightsw.kernels import bodies
from hil_sim.truth.satkit_data import satkit_time, session

NS = 1_000_000_000
DAY_NS = 86_400 * NS


def position(kind, t_gps_ns):
    out = np.full(3, np.nan)
    kind(int(t_gps_ns), out)
    return out


@pytest.mark.parametrize(
    ("kind", "name", "degrees", "relative"),
    [(bodies.sun_position, "Sun", 0.012, 1e-4), (bodies.moon_position, "Moon", 0.09, 1.4e-3)],
)
def test_sun_and_moon_are_where_the_jpl_ephemeris_has_them(kind, name, degrees, relative):
    """DE440 over sixteen years. Montenbruck and Gill, section 3.3.2: several arcminutes, 500 km for the Moon."""
    times = np.random.default_rng(1).integers(900_000_000, 1_400_000_000, 150) * NS
    with session(int(times.min()), int(times.max())) as satkit:
        for t in times:
            got = position(kind, t)
            body = getattr(satkit.solarsystem, name)
            expected = np.array(satkit.jplephem.geocentric_pos(body, satkit_time(satkit, int(t))))
            sizes = np.linalg.norm(got), np.linalg.norm(expected)
            assert np.degrees(np.arccos(got @ expected / (sizes[0] * sizes[1]))) < degrees
            assert sizes[0] == pytest.approx(sizes[1], rel=relative)


@pytest.mark.parametrize("kind", [bodies.sun_position, bodies.moon_position])
@pytest.mark.parametrize("size", [6.6e6, 4.2e7])
def test_third_body_agrees_with_forty_digits(kind, size):
    """Sources: the difference of two attractions, taken with enough digits to subtract them."""
    rng = np.random.default_rng(2)
    body = position(kind, T0_GPS_NS)
    for _ in range(20):
        r = rng.standard_normal(3)
        r *= size / np.linalg.norm(r)
        with mp.workdps(40):
            d = [mpf(b) - mpf(x) for b, x in zip(body, r, strict=True)]
            far = mp.sqrt(sum(mpf(b) ** 2 for b in body)) ** 3
            near = mp.sqrt(sum(x * x for x in d)) ** 3
            expected = np.array([float(4.9e12 * (x / near - mpf(b) / far)) for x, b in zip(d, body, strict=True)])
        out = np.array([1.0, -2.0, 3.0])  # it adds
        bodies.add_third_body(4.9e12, r, body, out)
        alone = np.zeros(3)
        bodies.add_third_body(4.9e12, r, body, alone)
        assert np.linalg.norm(alone - expected) <= 1e-14 * np.linalg.norm(expected)
        assert np.array_equal(out, np.array([1.0, -2.0, 3.0]) + alone)


@pytest.mark.compiled
@pytest.mark.parametrize(("force", "share"), [("sun", 0.001), ("moon", 0.004), ("tides", 0.01), ("relativity", 0.01)])
def test_each_force_moves_a_satellite_as_in_satkit(force, share):
    """What one force alone displaces in 6000 s, metres to centimetres, against satkit's (JPL ephemeris, IERS tides)."""
    settings = {"degree": 4, **dict.fromkeys(("sun", "moon", "solid_tides", "relativity"), "no")}
    settings["area_to_mass_m2pkg"] = 0.0
    start = circular_orbit(700e3)
    key = {"tides": "solid_tides"}.get(force, force)
    moved = flight_model(**{**settings, key: "yes"}).propagate(T0_GPS_NS, start, 6000 * NS)
    moved = (moved - flight_model(**settings).propagate(T0_GPS_NS, start, 6000 * NS))[:3]
    expected = satkit_moved(start, 6000.0, 4, **{force: True}) - satkit_moved(start, 6000.0, 4)
    assert np.linalg.norm(expected[:3]) > 0.1
    assert np.linalg.norm(moved - expected[:3]) <= share * np.linalg.norm(expected[:3])


def tidal_form(field, bodies_itrf):
    form = np.zeros((3, 3))
    for gm, body in bodies_itrf:
        bodies.add_tide(field, gm, body, form)
    return form


def test_tidal_acceleration_is_the_gradient_of_its_potential():
    """IERS (2010), equation 6.6, in angles: complex Love numbers, P_nm written out; differentiated with 40 digits."""
    field = record(bare_field())
    body, r = (2.1e8, -1.7e8, 1.5e8), (-3.1e6, 4.2e6, 4.6e6)
    form, got = tidal_form(field, [(4.9e12, np.array(body))]), np.zeros(3)
    bodies.add_tidal_acceleration(field, form, np.array(r), got)
    with mp.workdps(40):
        love = [mp.mpc("0.30190"), mp.mpc("0.29830", "-0.00144"), mp.mpc("0.30102", "-0.00130")]
        squared_norm = [mpf(5), mpf(5) / 3, mpf(5) / 12]

        def angles(x, y, z):
            return mp.sqrt(x * x + y * y + z * z), mp.atan2(z, mp.sqrt(x * x + y * y)), mp.atan2(y, x)

        def legendre(latitude):
            s, c = mp.sin(latitude), mp.cos(latitude)
            return [(3 * s * s - 1) / 2, 3 * s * c, 3 * c * c]

        def potential(*place):
            size, latitude, longitude = angles(*place)
            far, of_body, at = angles(*(mpf(b) for b in body))
            gm, radius = mpf("3.986004415e14"), mpf("6378136.3")
            total = mpf(0)
            for m in range(3):
                change = love[m] / 5 * mpf("4.9e12") / gm * (radius / far) ** 3 * legendre(of_body)[m]
                change *= mp.exp(mp.mpc(0, -m * at))  # dC - i dS, one normalisation here and one below
                wave = change.real * mp.cos(m * longitude) - change.imag * mp.sin(m * longitude)
                total += squared_norm[m] * wave * legendre(latitude)[m]
            return gm / size * (radius / size) ** 2 * total

        place = [mpf(x) for x in r]
        expected = np.array([float(mp.diff(potential, place, tuple(int(i == j) for j in range(3)))) for i in range(3)])
    assert np.linalg.norm(got - expected) <= 1e-13 * np.linalg.norm(expected)
    assert abs(np.trace(form)) <= 1e-15 * np.abs(form).max()


def test_mean_tide_over_the_nodal_period_is_the_permanent_tide():
    """IERS (2010), equation 6.14: C20 keeps -0.3146 x 4.4228e-8 x k20 in the mean; a zero-tide field has it already.

    Over 18.6 years of Sun and Moon what is left to a zero-tide field is nearly nothing.
    """
    field, zero_tide = record(bare_field()), record(bare_field(tide_system=1))
    times = T0_GPS_NS + np.linspace(0.0, 18.61 * 365.25, 4001) * DAY_NS
    total = np.zeros((3, 3))
    for t in times[:-1]:
        places = [(bodies.GM_SUN_M3PS2, bodies.sun_position), (bodies.GM_MOON_M3PS2, bodies.moon_position)]
        total += tidal_form(field, [(gm, position(kind, t)) for gm, kind in places]) / 4000
    c20 = total[2, 2] / np.sqrt(5.0)
    assert c20 == pytest.approx(-0.31460 * 4.4228e-8 * 0.30190, rel=0.01)
    untouched = np.zeros((3, 3))
    bodies.subtract_permanent_tide(field, untouched)
    assert (untouched == 0.0).all()
    bodies.subtract_permanent_tide(zero_tide, total)
    assert abs(total[2, 2]) < 0.01 * 4.2e-9 * np.sqrt(5.0)
