"""The axes of the orbit, from a state: what an operator thinks in, where messages speak GCRF."""

from __future__ import annotations

import math
from collections.abc import Sequence


def sigma_rtn_m(
    r_m: tuple[float, ...], v_mps: tuple[float, ...], upper: Sequence[float]
) -> tuple[float, float, float] | None:
    """1-sigma of the position along radial, along-track, cross-track [m]; None where state or covariance allow none.

    upper: of the covariance of (r, v) in GCRF, row by row, (21,).
    """
    w = _cross(r_m, v_mps)
    r, n = math.hypot(*r_m), math.hypot(*w)
    if not (r > 0.0 and n > 0.0 and math.isfinite(r) and math.isfinite(n)):
        return None
    radial, cross = tuple(c / r for c in r_m), tuple(c / n for c in w)
    p = ((upper[0], upper[1], upper[2]), (upper[1], upper[6], upper[7]), (upper[2], upper[7], upper[11]))
    variances = [
        sum(a[i] * p[i][j] * a[j] for i in range(3) for j in range(3)) for a in (radial, _cross(cross, radial), cross)
    ]
    if not all(variance >= 0.0 for variance in variances):
        return None
    return math.sqrt(variances[0]), math.sqrt(variances[1]), math.sqrt(variances[2])


def _cross(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
