"""The onboard density of the upper atmosphere: a Jacchia temperature over a Bates profile in diffusive equilibrium.

The temperature of the exosphere follows the solar flux, the geomagnetic index and, with the diurnal bulge, the Sun
(L. G. Jacchia, Smithsonian Astrophysical Observatory Special Report 332, 1971, equations 14 to 21). Below it the
temperature falls as D. R. Bates, Proc. Roy. Soc. A 253 (1959) 451, has it, for which each gas has a closed form from
its number at 120 km upward. These numbers, the temperature there and the steepness of the profile are those of the
U.S. Standard Atmosphere, 1976, tables 4 to 8: at 1000 K this model is that atmosphere. Hydrogen is Jacchia's.

Smooth everywhere, so that integrators keep their order. It is not the model that truth is simulated with; what it
errs by, some tens of per cent, the scale on drag takes up.
"""

from __future__ import annotations

import math

from flightsw.kernels.registry import kernel

_BASE_KM = 120.0
_BASE_K = 360.0
_STEEPNESS_PKM = 0.01875
_RADIUS_KM = 6356.766
_BOLTZMANN = 1.380649e-23
_DALTON_KG = 1.66053906660e-27
_GRAVITY_AT_BASE = 9.80665 * (_RADIUS_KM / (_RADIUS_KM + _BASE_KM)) ** 2
# m g / (k s) [K] of one dalton, s the steepness [1/m]: what `gamma` is for one kelvin
_GAMMA_K = _DALTON_KG * _GRAVITY_AT_BASE / (_BOLTZMANN * _STEEPNESS_PKM * 1e-3)

# mass [dalton], number at 120 km [1/m3], thermal diffusion
_NITROGEN = (28.0134, 3.726e17)
_OXYGEN_ATOM = (15.9994, 9.275e16)
_OXYGEN = (31.9988, 4.395e16)
_ARGON = (39.948, 1.366e15)
_HELIUM = (4.0026, 3.888e13)
_HELIUM_DIFFUSION = -0.40
_HYDROGEN_DALTON = 1.00784
_HYDROGEN_BASE_KM = 500.0

_EQUATORIAL_RADIUS_KM = 6378.137
_FLATTENING = 1.0 / 298.257223563
_DEGREE = math.pi / 180.0
_HALF_TURN = math.pi
# the range in which the profile is meant; outside it the nearest end is taken
_LOWEST_KM = 120.0
_HIGHEST_KM = 2500.0


@kernel
def _geopotential_km(height_km):
    """Height over 120 km, flattened for gravity's fall with height (Bates, Walker)."""
    return (height_km - _BASE_KM) * (_RADIUS_KM + _BASE_KM) / (_RADIUS_KM + height_km)


@kernel
def density_of(height_km, exosphere_k):
    """Density [kg/m3] at a geodetic height for the temperature of the exosphere [K]."""
    height_km = min(max(height_km, _LOWEST_KM), _HIGHEST_KM)
    zeta = _geopotential_km(height_km)
    fall = math.exp(-_STEEPNESS_PKM * zeta)
    a = 1.0 - _BASE_K / exosphere_k
    log_ratio = math.log((1.0 - a) / (1.0 - a * fall))
    gamma = _GAMMA_K / exosphere_k
    slope = log_ratio - _STEEPNESS_PKM * zeta
    total = _NITROGEN[0] * _NITROGEN[1] * math.exp(log_ratio + _NITROGEN[0] * gamma * slope)
    total += _OXYGEN_ATOM[0] * _OXYGEN_ATOM[1] * math.exp(log_ratio + _OXYGEN_ATOM[0] * gamma * slope)
    total += _OXYGEN[0] * _OXYGEN[1] * math.exp(log_ratio + _OXYGEN[0] * gamma * slope)
    total += _ARGON[0] * _ARGON[1] * math.exp(log_ratio + _ARGON[0] * gamma * slope)
    total += _HELIUM[0] * _HELIUM[1] * math.exp((1.0 + _HELIUM_DIFFUSION) * log_ratio + _HELIUM[0] * gamma * slope)
    # Jacchia 1971, equation 11, hydrogen at 500 km [1/cm3]; the temperature hardly changes above.
    log_k = math.log10(exosphere_k)
    hydrogen = 1e6 * 10.0 ** (73.13 - 39.40 * log_k + 5.5 * log_k * log_k)
    above = _STEEPNESS_PKM * (zeta - _geopotential_km(_HYDROGEN_BASE_KM))
    total += _HYDROGEN_DALTON * hydrogen * math.exp(-_HYDROGEN_DALTON * gamma * above)
    return _DALTON_KG * total


@kernel
def exosphere_temperature(f107, f107_mean, ap, r, sun):
    """Temperature of the exosphere [K] over r, with the Sun at `sun` [m, GCRF].

    Source: Jacchia 1971, equations 14 to 17 (solar flux, bulge); L. G. Jacchia, J. Slowey and F. Verniani, J. Geophys.
    Res. 72 (1967) 1423 (geomagnetic index).
    """
    night = 379.0 + 3.24 * f107_mean + 1.3 * (f107 - f107_mean)
    latitude = math.atan2(r[2], math.sqrt(r[0] * r[0] + r[1] * r[1]))
    declination = math.atan2(sun[2], math.sqrt(sun[0] * sun[0] + sun[1] * sun[1]))
    hour_angle = math.atan2(r[1] * sun[0] - r[0] * sun[1], r[0] * sun[0] + r[1] * sun[1])
    tau = hour_angle - 37.0 * _DEGREE + 6.0 * _DEGREE * math.sin(hour_angle + 43.0 * _DEGREE)
    if tau < -_HALF_TURN:
        tau += 2.0 * _HALF_TURN
    near = math.cos(0.5 * abs(latitude - declination)) ** 2.2
    far = math.sin(0.5 * abs(latitude + declination)) ** 2.2
    day = math.cos(0.5 * tau)
    bulge = 1.0 + 0.3 * far + 0.3 * (near - far) * day * day * day
    return night * bulge + ap + 125.0 * (1.0 - math.exp(-0.08 * ap))


@kernel
def semiannual_phase(centuries_tt):
    """g(t) of the semiannual variation, `centuries_tt` since J2000.0. Source: Jacchia 1971, equations 20, 21."""
    # years since 1958 January 1.0: JD 2436204.5
    year = (centuries_tt * 36525.0 + 2451545.0 - 2436204.5) / 365.2422
    year -= math.floor(year)
    turn = 2.0 * math.pi
    tau = year + 0.09544 * ((0.5 + 0.5 * math.sin(turn * year + 6.035)) ** 1.650 - 0.5)
    return 0.02835 + 0.3817 * (1.0 + 0.4671 * math.sin(turn * tau + 4.137)) * math.sin(2.0 * turn * tau + 4.259)


@kernel
def height_km(r):
    """Height over the ellipsoid to some ten metres, from the radius and the sine of the latitude; r [m]."""
    size = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    sine = r[2] / size
    return size * 1e-3 - _EQUATORIAL_RADIUS_KM * (1.0 - _FLATTENING * sine * sine)


@kernel
def density(forces, semiannual, r, sun):
    """Density [kg/m3] at r with the Sun at `sun` [m, GCRF], semiannual phase from `semiannual_phase`."""
    height = height_km(r)
    kelvin = exosphere_temperature(forces.f107, forces.f107_mean, forces.ap, r, sun)
    # Jacchia 1971, equation 19
    reach = (5.876e-7 * max(height, 1.0) ** 2.331 + 0.06328) * math.exp(-2.868e-3 * height)
    return density_of(height, kelvin) * 10.0 ** (reach * semiannual)
