"""ITRF <-> GCRF by the IERS Conventions 2010 (TN 36, chapter 5, CIO based) with pyerfa.

Precession-nutation IAU 2006/2000A plus observed dX, dY; UT1 and polar motion interpolated from finals2000A.
Velocities carry w x r with w tilted by polar motion: [0, 0, w] would cost 0.7-1.2 mm/s. The sub-daily ocean-tide
terms of UT1 and polar motion are left out, both ways alike: against an orbit made with them up to 2 cm, 0.02 mm/s.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import erfa
import numpy as np

from hil_sim import gps_time
from hil_sim.errors import DataError

OMEGA_RADPS = 7.292115146706979e-5  # dERA/dUT1, IERS TN 36 eq. 5.15
MARGIN_NS = 3 * gps_time.DAY_NS
_NODE_STEP_NS = 1800 * gps_time.NS  # of precession-nutation: cubic interpolation errs below 1e-13 rad
_ARCSEC = np.pi / (180.0 * 3600.0)
_GPS_EPOCH_TAI_UTC_S = 19


class EarthOrientation:
    """Earth orientation over a span of GPS time.

    finals_path: IERS finals2000A file; None takes the one packaged with astropy-iers-data.
    Raises DataError when the span is not covered (observed or IERS-predicted rows).
    """

    def __init__(self, t_first_gps_ns: int, t_last_gps_ns: int, finals_path: Path | None = None) -> None:
        self.path = finals_path if finals_path is not None else packaged_finals()
        table = read_finals(self.path)
        mjd_first = (t_first_gps_ns - MARGIN_NS) // gps_time.DAY_NS + gps_time.GPS_EPOCH_MJD
        mjd_last = (t_last_gps_ns + MARGIN_NS) // gps_time.DAY_NS + gps_time.GPS_EPOCH_MJD
        rows = table[(table[:, 0] >= mjd_first) & (table[:, 0] <= mjd_last + 1)]
        if len(rows) < mjd_last - mjd_first or np.any(np.diff(rows[:, 0]) != 1.0):
            raise DataError(
                f"{self.path}: Earth orientation covers MJD {table[0, 0]:.0f} to {table[-1, 0]:.0f}, the run needs "
                f"{mjd_first} to {mjd_last}; give truth.earth_orientation_file a newer finals2000A.all, or move "
                "time.start"
            )
        self._rows = rows
        # UT1 - TAI runs through leap seconds without a step
        tai_utc = np.array([gps_time.tai_minus_utc_s(_calendar(mjd)) for mjd in rows[:, 0]])
        self._utc_midnight_gps_ns = np.array(
            [
                (int(mjd) - gps_time.GPS_EPOCH_MJD) * gps_time.DAY_NS + (int(d) - _GPS_EPOCH_TAI_UTC_S) * gps_time.NS
                for mjd, d in zip(rows[:, 0], tai_utc, strict=True)
            ],
            dtype=np.int64,
        )
        self._ut1_minus_tai_s = rows[:, 3] - tai_utc
        self._t0_ns = (int(t_first_gps_ns) // _NODE_STEP_NS - 2) * _NODE_STEP_NS
        count = (int(t_last_gps_ns) - self._t0_ns) // _NODE_STEP_NS + 4
        nodes_ns = self._t0_ns + np.arange(count, dtype=np.int64) * _NODE_STEP_NS
        x, y, s = erfa.xys06a(*gps_time.tt_two_part(nodes_ns))
        self._xys = np.stack((x, y, s), axis=1)

    def parameters(self, t_gps_ns: np.ndarray) -> tuple[np.ndarray, ...]:
        """xp, yp [rad], UT1 - TAI [s], dX, dY [rad] at GPS times, each (n,); linear between daily values."""
        t = (np.asarray(t_gps_ns, dtype=np.int64) - self._utc_midnight_gps_ns[0]) / 1e9
        grid = (self._utc_midnight_gps_ns - self._utc_midnight_gps_ns[0]) / 1e9
        xp, yp, d_x, d_y = (np.interp(t, grid, self._rows[:, k]) for k in (1, 2, 4, 5))
        return xp * _ARCSEC, yp * _ARCSEC, np.interp(t, grid, self._ut1_minus_tai_s), d_x * _ARCSEC, d_y * _ARCSEC

    def rotations(self, t_gps_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """GCRF -> ITRF matrices (n,3,3) and the Earth's angular velocity in ITRF (n,3) [rad/s]."""
        t_gps_ns = np.atleast_1d(np.asarray(t_gps_ns, dtype=np.int64))
        xp, yp, ut1_minus_tai, d_x, d_y = self.parameters(t_gps_ns)
        tt1, tt2 = gps_time.tt_two_part(t_gps_ns)
        xys = self._precession_nutation(t_gps_ns)
        celestial = erfa.c2ixys(xys[:, 0] + d_x, xys[:, 1] + d_y, xys[:, 2])
        ut1_minus_tt_days = (ut1_minus_tai - 32.184) / 86400.0
        angle = erfa.era00(tt1, tt2 + ut1_minus_tt_days)
        polar = erfa.pom00(xp, yp, erfa.sp00(tt1, tt2))
        matrices = erfa.c2tcio(celestial, angle, polar)
        return matrices, OMEGA_RADPS * polar[:, :, 2]

    def to_itrf(
        self, t_gps_ns: np.ndarray, r_gcrf_m: np.ndarray, v_gcrf_mps: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Position (n,3) [m] and Earth-fixed velocity (n,3) [m/s] in ITRF."""
        matrices, omega = self.rotations(t_gps_ns)
        r_itrf_m = np.einsum("nij,nj->ni", matrices, r_gcrf_m)
        v_itrf_mps = np.einsum("nij,nj->ni", matrices, v_gcrf_mps) - np.cross(omega, r_itrf_m)
        return r_itrf_m, v_itrf_mps

    def to_gcrf(
        self, t_gps_ns: np.ndarray, r_itrf_m: np.ndarray, v_itrf_mps: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Position (n,3) [m] and inertial velocity (n,3) [m/s] in GCRF."""
        matrices, omega = self.rotations(t_gps_ns)
        r_gcrf_m = np.einsum("nji,nj->ni", matrices, r_itrf_m)
        v_gcrf_mps = np.einsum("nji,nj->ni", matrices, v_itrf_mps + np.cross(omega, r_itrf_m))
        return r_gcrf_m, v_gcrf_mps

    def _precession_nutation(self, t_gps_ns: np.ndarray) -> np.ndarray:
        """X, Y, s (n,3) [rad]: four-point Lagrange between nodes."""
        i = np.clip((t_gps_ns - self._t0_ns) // _NODE_STEP_NS, 1, len(self._xys) - 3)
        s = ((t_gps_ns - self._t0_ns) - i * _NODE_STEP_NS) / _NODE_STEP_NS
        weights = (
            -s * (s - 1.0) * (s - 2.0) / 6.0,
            (s + 1.0) * (s - 1.0) * (s - 2.0) / 2.0,
            -(s + 1.0) * s * (s - 2.0) / 2.0,
            (s + 1.0) * s * (s - 1.0) / 6.0,
        )
        total = np.zeros((len(s), 3))
        for k, w in enumerate(weights):
            total += w[:, None] * self._xys[i + k - 1]
        return total


def packaged_finals() -> Path:
    """finals2000A.all of the installed astropy-iers-data."""
    import astropy_iers_data

    return Path(astropy_iers_data.IERS_A_FILE)


def read_finals(path: Path) -> np.ndarray:
    """Rows MJD, xp, yp [arcsec], UT1-UTC [s], dX, dY [arcsec] of a finals2000A file, shape (n, 6).

    Bulletin A columns of readme.finals2000A; rows without values (the far future) are left out, predicted rows
    without dX, dY take zero for these two (below 0.5 mas, 1.5 cm on the ground).
    """
    try:
        state = path.stat()
    except OSError as error:
        raise DataError(f"{path}: Earth orientation cannot be read: {error.strerror}") from None
    return _read_finals(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=2)  # a study builds hundreds of worlds from one file; a changed file is read anew
def _read_finals(path: Path, modified_ns: int, size: int) -> np.ndarray:
    del modified_ns, size
    rows = []
    try:
        with open(path, encoding="ascii") as lines:
            for line in lines:
                if len(line) < 69 or not line[58:68].strip() or not line[18:27].strip():
                    continue
                d_x, d_y = line[97:106].strip(), line[116:125].strip()
                rows.append(
                    (
                        float(line[7:15]),
                        float(line[18:27]),
                        float(line[37:46]),
                        float(line[58:68]),
                        float(d_x) * 1e-3 if d_x else 0.0,
                        float(d_y) * 1e-3 if d_y else 0.0,
                    )
                )
    except OSError as error:
        raise DataError(f"{path}: Earth orientation cannot be read: {error.strerror}") from None
    except (ValueError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: not an IERS finals2000A file: {error}") from None
    if not rows:
        raise DataError(f"{path}: holds no Earth orientation; it must be an IERS finals2000A file")
    table = np.array(rows)
    table.flags.writeable = False
    return table


def _calendar(mjd: float):  # type: ignore[no-untyped-def]
    return gps_time.to_calendar(int((mjd - gps_time.GPS_EPOCH_MJD) * gps_time.DAY_NS))
