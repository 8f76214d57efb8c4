"""Gravity beyond degree 70, where satkit ends: what it adds to a known motion, by Encke's method.

Below 600 km a flight model that is complete to degree 70 lacks micrometres per second squared of gravity. A truth that
ends there as well would not show it. Degrees from 71 on are EGM96's, which no flight table reads.

Harmonics: Cunningham's recursion as in Montenbruck, Gill, Satellite Orbits (2000), equations (3.29) to (3.33), which
knows no pole; all points of a block at once. Unnormalised, they stay within the range of a double up to degree 120.
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path

import numpy as np

from hil_sim.errors import DataError
from hil_sim.scenario_schema import MU_EGM2008_M3PS2
from hil_sim.truth.earth_rotation import EarthOrientation
from hil_sim.truth.hermite import HermiteTrack
from hil_sim.truth.piecewise import PiecewiseTrack

HIGHEST_DEGREE = 120
STEP_NS = 10_000_000_000  # of the integration; the field is sampled at its middle too
_BLOCK = 64  # points at a time: what they need stays in the processor's cache
_MODEL = "EGM96.gfc"


class DisplacedTrack:
    """A track, and on top a small displacement of it."""

    def __init__(self, track: HermiteTrack | PiecewiseTrack, displacement: HermiteTrack) -> None:
        self._track, self._displacement = track, displacement

    @property
    def t_first_ns(self) -> int:
        """First instant served [ns]."""
        return max(self._track.t_first_ns, self._displacement.t_first_ns)

    @property
    def t_last_ns(self) -> int:
        """Last instant served [ns]."""
        return min(self._track.t_last_ns, self._displacement.t_last_ns)

    def evaluate(self, t_ns: np.ndarray, derivatives: int = 1) -> list[np.ndarray]:
        """[r (n,3) m, v (n,3) m/s, a (n,3) m/s2, ...] up to `derivatives`; ValueError outside the track."""
        parts = zip(
            self._track.evaluate(t_ns, derivatives), self._displacement.evaluate(t_ns, derivatives), strict=True
        )
        return [known + added for known, added in parts]


def displace(
    track: HermiteTrack | PiecewiseTrack,
    t_start_gps_ns: int,
    degrees: tuple[int, int],
    finals_path: Path | None = None,
) -> DisplacedTrack:
    """The track with gravity of the degrees from .. to (both included) added; state at the start as it was.

    Encke: the displacement follows the sampled field and the gradient of central gravity along the given track, fourth
    order Runge-Kutta. It stays below some tens of metres, where what it changes in the field is below 1e-5 of it.
    """
    first = -((t_start_gps_ns - track.t_first_ns) // STEP_NS)
    last = (track.t_last_ns - t_start_gps_ns) // STEP_NS
    half = STEP_NS // 2
    t_ns = t_start_gps_ns + np.arange(2 * first, 2 * last + 1, dtype=np.int64) * half
    r_gcrf_m = track.evaluate(t_ns, 0)[0]
    matrices, _ = EarthOrientation(int(t_ns[0]), int(t_ns[-1]), finals_path).rotations(t_ns)
    field = acceleration_itrf(np.einsum("nij,nj->ni", matrices, r_gcrf_m), *degrees)
    forcing = np.einsum("nji,nj->ni", matrices, field)
    radius = np.linalg.norm(r_gcrf_m, axis=1)[:, None, None]
    unit = r_gcrf_m[:, :, None] / radius
    gradient = MU_EGM2008_M3PS2 / radius**3 * (3.0 * unit * unit.transpose(0, 2, 1) - np.eye(3))
    nodes = np.zeros((last - first + 1, 6))
    for k in range(-first, last - first):
        nodes[k + 1] = _runge_kutta(nodes[k], forcing, gradient, 2 * k, 1)
    for k in range(-first, 0, -1):
        nodes[k - 1] = _runge_kutta(nodes[k], forcing, gradient, 2 * k, -1)
    t0_ns = t_start_gps_ns + first * STEP_NS
    return DisplacedTrack(track, HermiteTrack(t0_ns, STEP_NS, nodes[:, :3].copy(), nodes[:, 3:].copy()))


def _runge_kutta(y: np.ndarray, forcing: np.ndarray, gradient: np.ndarray, at: int, way: int) -> np.ndarray:
    """y (6,) one step on from sample `at`, forward (way 1) or back (-1); samples lie half a step apart."""
    h = way * STEP_NS / 1e9

    def rate(z: np.ndarray, k: int) -> np.ndarray:
        return np.concatenate((z[3:], forcing[k] + gradient[k] @ z[:3]))

    k1 = rate(y, at)
    k2 = rate(y + 0.5 * h * k1, at + way)
    k3 = rate(y + 0.5 * h * k2, at + way)
    k4 = rate(y + h * k3, at + 2 * way)
    return y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def acceleration_itrf(r_itrf_m: np.ndarray, lowest: int, highest: int) -> np.ndarray:
    """Acceleration (n,3) [m/s2] at ITRF positions (n,3) [m] by EGM96's degrees lowest .. highest, both included.

    ValueError for degrees that it does not serve.
    """
    if not 2 <= lowest <= highest <= HIGHEST_DEGREE:
        raise ValueError(f"degrees {lowest} to {highest}: from 2 to {HIGHEST_DEGREE}, in order")
    model = _coefficients(highest)
    return np.concatenate(
        [_block(model, r_itrf_m[k : k + _BLOCK], lowest, highest) for k in range(0, len(r_itrf_m), _BLOCK)]
        or [np.empty((0, 3))]
    )


def _block(model: tuple[float, float, np.ndarray, np.ndarray], r_m: np.ndarray, lowest: int, highest: int):  # type: ignore[no-untyped-def]
    gm, radius, c_all, s_all = model
    size = highest + 2
    r2 = np.sum(r_m * r_m, axis=1)
    x, y, z = (radius * r_m[:, k] / r2 for k in range(3))
    rho = radius * radius / r2
    # rows n - 2, n - 1, n of V and W: (orders, points)
    v = [np.zeros((size + 1, len(r_m))) for _ in range(3)]
    w = [np.zeros((size + 1, len(r_m))) for _ in range(3)]
    v[1][0] = radius / np.sqrt(r2)
    total = np.zeros((3, len(r_m)))
    for n in range(1, size):
        v2, v1, vn = v[(n - 1) % 3], v[n % 3], v[(n + 1) % 3]
        w2, w1, wn = w[(n - 1) % 3], w[n % 3], w[(n + 1) % 3]
        m = np.arange(n)[:, None]
        low, high = (2 * n - 1) / (n - m) * z, (n + m - 1) / (n - m) * rho
        vn[:n] = low * v1[:n] - high * v2[:n]
        wn[:n] = low * w1[:n] - high * w2[:n]
        vn[n] = (2 * n - 1) * (x * v1[n - 1] - y * w1[n - 1])
        wn[n] = (2 * n - 1) * (x * w1[n - 1] + y * v1[n - 1])
        degree = n - 1  # whose accelerations take the functions of the degree above
        if degree < lowest:
            continue
        c, s = c_all[degree, : degree + 1, None], s_all[degree, : degree + 1, None]
        m = np.arange(degree + 1)[:, None]
        above_v, above_w = vn[1 : degree + 2], wn[1 : degree + 2]
        total[0] -= np.sum((c * above_v + s * above_w)[1:], axis=0) / 2.0 + c[0] * above_v[0]
        total[1] -= np.sum((c * above_w - s * above_v)[1:], axis=0) / 2.0 + c[0] * above_w[0]
        below = ((degree - m + 2.0) * (degree - m + 1.0) / 2.0)[1:]
        below_v, below_w = below * vn[:degree], below * wn[:degree]
        total[0] += np.sum(c[1:] * below_v + s[1:] * below_w, axis=0)
        total[1] += np.sum(s[1:] * below_v - c[1:] * below_w, axis=0)
        total[2] -= np.sum((degree - m + 1.0) * (c * vn[: degree + 1] + s * wn[: degree + 1]), axis=0)
    return (gm / radius**2 * total).T


@lru_cache(maxsize=2)
def _coefficients(highest: int) -> tuple[float, float, np.ndarray, np.ndarray]:
    """GM [m3/s2], radius [m], unnormalised C and S (highest + 1, highest + 1) of the packaged EGM96."""
    try:
        import satkit_data
    except ImportError as error:
        raise DataError(f"{error.name} is not installed; the simulator needs: pip install 'leonav[sim]'") from None
    path = Path(next(iter(satkit_data.__path__))) / "data" / _MODEL
    header: dict[str, float] = {}
    c = np.zeros((highest + 1, highest + 1))
    s = np.zeros_like(c)
    try:
        with path.open(encoding="ascii", errors="replace") as lines:
            for line in lines:
                words = line.split()
                if len(words) >= 2 and words[0] in ("earth_gravity_constant", "radius"):
                    header[words[0]] = float(words[1])
                elif len(words) >= 5 and words[0] == "gfc" and int(words[1]) <= highest:
                    n, m = int(words[1]), int(words[2])
                    scale = _normalisation(n, m)
                    c[n, m], s[n, m] = scale * float(words[3]), scale * float(words[4])
        return header["earth_gravity_constant"], header["radius"], c, s
    except (OSError, ValueError, KeyError) as error:
        raise DataError(f"{path}: gravity beyond degree 70 cannot be read: {error}") from None


def _normalisation(n: int, m: int) -> float:
    """What a fully normalised coefficient is multiplied with."""
    logarithm = math.lgamma(n - m + 1) - math.lgamma(n + m + 1)
    return math.sqrt((1.0 if m == 0 else 2.0) * (2 * n + 1)) * math.exp(0.5 * logarithm)
