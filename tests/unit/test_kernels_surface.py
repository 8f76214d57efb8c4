"""Density against two published atmospheres, drag and radiation against satkit, the shadow against the disc itself."""

from __future__ import annotations

import numpy as np
import pytest
from flight_bench import T0_GPS_NS, circular_orbit, record
from force_bench import flight_model, satkit_moved

from flightsw.kernels import atmosphere, bodies, surface_forces
from hil_sim.truth.satkit_data import satkit_time, session

NS = 1_000_000_000
# U.S. Standard Atmosphere, 1976, table 1: height [km], density [kg/m3]; its exosphere has 1000 K
STANDARD_1976 = {
    120: 2.222e-8,
    200: 2.541e-10,
    300: 1.916e-11,
    400: 2.803e-12,
    500: 5.215e-13,
    600: 1.137e-13,
    800: 1.136e-14,
    1000: 3.561e-15,
}
AU = 149597870700.0


@pytest.mark.parametrize("height", STANDARD_1976)
def test_at_1000_kelvin_it_is_the_standard_atmosphere(height):
    assert atmosphere.density_of(float(height), 1000.0) == pytest.approx(STANDARD_1976[height], rel=0.02)


def sun_at(t_gps_ns):
    sun = np.zeros(3)
    bodies.sun_position(int(t_gps_ns), sun)
    return sun


def density_ratios(f107, ap, height_km, count=60):
    """Onboard density by NRLMSISE-00 at places all around the Earth, through a day."""
    rng = np.random.default_rng(3)
    forces = record(flight_model(f107=f107, f107_mean=f107, ap=ap).forces)
    ratios = []
    with session(T0_GPS_NS, T0_GPS_NS + 86400 * NS, fixed_f107=f107) as satkit:
        for _ in range(count):
            t = T0_GPS_NS + int(rng.integers(0, 86400)) * NS
            instant = satkit_time(satkit, t)
            latitude, longitude = np.degrees(np.arcsin(rng.uniform(-1, 1))), rng.uniform(-180, 180)
            place = satkit.itrfcoord(latitude_deg=latitude, longitude_deg=longitude, altitude=height_km * 1e3)
            r = np.array(satkit.frametransform.qitrf2gcrf(instant) * place.vector)
            phase = atmosphere.semiannual_phase(bodies.centuries(t))
            ratios.append(atmosphere.density(forces, phase, r, sun_at(t)) / satkit.density.nrlmsise(place, instant)[0])
    return np.log(ratios)


@pytest.mark.parametrize("f107", [70.0, 120.0, 200.0])
@pytest.mark.parametrize(("height", "off", "spread"), [(300, 0.25, 0.15), (500, 0.3, 0.3), (800, 0.7, 0.8)])
def test_density_follows_the_other_model_over_heights_and_the_solar_cycle(f107, height, off, spread):
    """NRLMSISE-00 rises 20-fold over this range of flux at 500 km; the drag scale takes up what remains."""
    ratios = density_ratios(f107, 4.0, height)
    assert abs(ratios.mean()) < off
    assert ratios.std() < spread


def test_density_is_smooth_over_the_day_and_greatest_in_the_afternoon():
    """GIVEN the Sun over the equator THEN the bulge lags it by two hours, and midnight brings no step."""
    forces = record(flight_model(f107=120.0, f107_mean=120.0, ap=4.0).forces)
    sun = np.array([AU, 0.0, 0.0])
    turn = np.radians(np.arange(0.0, 360.0, 0.5))
    places = 6.878e6 * np.stack((np.cos(turn), np.sin(turn), np.zeros_like(turn)), axis=1)
    rho = np.array([atmosphere.density(forces, 0.0, place, sun) for place in places])
    assert 25.0 < np.degrees(turn[np.argmax(rho)]) < 45.0
    assert rho.max() / rho.min() > 2.0
    assert np.abs(rho - np.roll(rho, 1)).max() < 0.02 * rho.max()


def test_density_has_a_value_anywhere():
    forces = record(flight_model().forces)
    for place in ((0.0, 0.0, 6.5e6), (0.0, 0.0, -6.4e6), (6.378e6, 0.0, 0.0), (1e9, 1.0, 2.0), (6.3e6, 0.0, 0.0)):
        assert 0.0 < atmosphere.density(forces, 0.3, np.array(place), sun_at(T0_GPS_NS)) < 1e-6


def test_drag_by_hand():
    """Equator, 500 km: against the motion relative to air that turns with the Earth; zero where it rests in the air."""
    forces = record(flight_model(area_to_mass_m2pkg=0.01, drag_coefficient=2.5).forces)
    r, pole, sun, out = np.array([6.878137e6, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), sun_at(T0_GPS_NS), np.zeros(3)
    surface_forces.drag(forces, 0.1, sun, pole, r, np.array([0.0, 6000.0, 4500.0]), out)
    air = 7.292115e-5 * r[0]
    relative = np.array([0.0, 6000.0 - air, 4500.0])
    rho = atmosphere.density(forces, 0.1, r, sun)
    np.testing.assert_allclose(out, -0.5 * 2.5 * 0.01 * rho * np.linalg.norm(relative) * relative, rtol=1e-13)
    surface_forces.drag(forces, 0.1, sun, pole, r, np.array([0.0, air, 0.0]), out)
    assert np.abs(out).max() < 1e-25


@pytest.mark.compiled
def test_drag_moves_a_satellite_as_in_satkit_by_the_ratio_of_the_densities():
    """400 km, 6000 s, Cd A/m of 0.1 m2/kg: a hundred metres on either density, and their ratio is theirs."""
    settings = {"degree": 4, "sun": "no", "moon": "no", "solid_tides": "no", "relativity": "no"}
    settings |= {"radiation_coefficient": 0.0, "drag_coefficient": 2.0}
    settings |= {"f107": 78.0, "f107_mean": 78.0, "ap": 6.0}
    start = circular_orbit(400e3)
    calm = flight_model(**settings, area_to_mass_m2pkg=0.0).propagate(T0_GPS_NS, start, 6000 * NS)
    moved = (flight_model(**settings, area_to_mass_m2pkg=0.05).propagate(T0_GPS_NS, start, 6000 * NS) - calm)[:3]
    expected = (satkit_moved(start, 6000.0, 4, drag=0.1) - satkit_moved(start, 6000.0, 4))[:3]
    ratio = np.linalg.norm(moved) / np.linalg.norm(expected)
    assert np.linalg.norm(expected) > 50.0
    assert 0.7 < ratio < 1.4
    assert moved @ expected > 0.999 * np.linalg.norm(moved) * np.linalg.norm(expected)


@pytest.mark.compiled
def test_sunlight_moves_a_satellite_as_in_satkit():
    """6000 s through sunlight and shadow, Cr A/m of 0.02 m2/kg: a metre; satkit's shadow is conical too."""
    settings = {"degree": 4, "sun": "no", "moon": "no", "solid_tides": "no", "relativity": "no"}
    settings |= {"drag_coefficient": 0.0, "radiation_coefficient": 2.0}
    start = circular_orbit(700e3)
    calm = flight_model(**settings, area_to_mass_m2pkg=0.0).propagate(T0_GPS_NS, start, 6000 * NS)
    moved = (flight_model(**settings, area_to_mass_m2pkg=0.01).propagate(T0_GPS_NS, start, 6000 * NS) - calm)[:3]
    expected = (satkit_moved(start, 6000.0, 4, radiation=0.02) - satkit_moved(start, 6000.0, 4))[:3]
    assert np.linalg.norm(expected) > 0.5
    assert np.linalg.norm(moved - expected) < 0.02 * np.linalg.norm(expected)


def test_pressure_in_full_sunlight_by_hand():
    """1361 W/m2 by the speed of light at one astronomical unit: 4.54e-6 Pa, away from the Sun."""
    forces = record(flight_model(area_to_mass_m2pkg=0.01, radiation_coefficient=1.5).forces)
    out = np.zeros(3)
    surface_forces.add_radiation(forces, np.array([0.0, 7e6, 0.0]), np.array([AU, 7e6, 0.0]), out)
    np.testing.assert_allclose(out, [-4.5398e-6 * 1.5 * 0.01, 0.0, 0.0], rtol=1e-4, atol=1e-20)


def visible_share(r, sun, count=400):
    """Share of a grid over the Sun's disc that is not behind the Earth, seen from r: the definition."""
    to_sun = sun - r
    distance = np.linalg.norm(to_sun)
    axis = to_sun / distance
    side = np.cross(axis, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    up = np.cross(side, axis)
    half = np.tan(np.arcsin(6.957e8 / distance))
    grid = (np.arange(count) + 0.5) / count * 2.0 - 1.0
    a, b = np.meshgrid(grid, grid)
    inside = a**2 + b**2 <= 1.0
    look = axis + half * (a[inside, None] * side + b[inside, None] * up)
    look /= np.linalg.norm(look, axis=1, keepdims=True)
    down = -r / np.linalg.norm(r)
    hidden = np.arccos(np.clip(look @ down, -1, 1)) < np.arcsin(6378137.0 / np.linalg.norm(r))
    return 1.0 - hidden.mean()


def test_illumination_is_the_visible_share_of_the_disc():
    sun = np.array([AU, 0.0, 0.0])
    shares = []
    penumbra = np.arange(111.5, 112.5, 0.02)  # the Earth's edge is 112.0 from its centre, the Sun 0.53 wide
    around = [0.0, 60.0, 108.0, 110.0, 111.0, 113.0, 114.0, 116.0, 150.0, 180.0]
    for angle in np.radians(np.sort(np.concatenate((penumbra, around)))):
        r = 6.878137e6 * np.array([np.cos(angle), np.sin(angle), 0.0])
        share = surface_forces.illumination(r, sun)
        if 0.0 < share < 1.0:
            shares.append(share)
            assert share == pytest.approx(visible_share(r, sun), abs=0.005)
        else:
            assert share == round(visible_share(r, sun), 3)
    assert len(shares) > 15
    assert np.all(np.diff(shares) < 0.0)
