"""The Earth's gravity to high degree: acceleration and gradient in ITRF from fully normalised coefficients.

Cartesian derivatives of a solid harmonic are solid harmonics of the next degree: the acceleration is a series like the
potential itself, with three sets of coefficients made once from the table (L. E. Cunningham, Celest. Mech. 2 (1970)
207; O. Montenbruck and E. Gill, Satellite Orbits, 2000, equations 3.27 to 3.33), and the gradient is one more
derivative of it. The harmonics are written as

    (R / r)^(n + 1) A_nm(z / r) ((x + i y) / r)^m,   A_nm(sin phi) = P_nm(sin phi) / cos^m phi, normalised

(S. Pines, AIAA Journal 11 (1973) 1508), which nothing divides by cos phi: there is no singularity at the poles. A_nm
comes from the recursion over the degree at fixed order, stable far beyond degree 120 (J. B. Lundberg and B. E.
Schutz, J. Guid. Contr. Dyn. 11 (1988) 31). A row is one degree: its orders are independent of each other, so that
the compiler works on several at once. 3 us at degree 50, where reading the coefficients begins to set the pace.
"""

from __future__ import annotations

import math

from flightsw.kernels.registry import entry, frozen_records, kernel, records
from flightsw.records import FIELD, FORCE_TABLE, GRAVITY_TABLE, HARMONIC_BLOCK, HARMONIC_GROUP, HARMONIC_ROWS


@kernel
def _derive(degree, order, c, s, out):
    """Coefficients of the derivatives by x, y, z of the series c, s [n, m]: six arrays in `out`, C and S of each.

    The factors are those of Montenbruck and Gill, equation 3.33, times the ratio of the normalisations.
    """
    out[:, :, :] = 0.0
    cx, sx, cy, sy, cz, sz = out[0], out[1], out[2], out[3], out[4], out[5]
    for n in range(degree + 1):
        scale = (2.0 * n + 1.0) / (2.0 * n + 3.0)
        for m in range(min(n, order) + 1):
            cnm = c[n, m]
            snm = s[n, m]
            along = math.sqrt(scale * (n + m + 1.0) * (n - m + 1.0))
            cz[n + 1, m] -= along * cnm
            sz[n + 1, m] -= along * snm
            if m == 0:
                raised = math.sqrt(0.5 * scale * (n + 1.0) * (n + 2.0))
                cx[n + 1, 1] -= raised * cnm
                sy[n + 1, 1] -= raised * cnm
                continue
            raised = 0.5 * math.sqrt(scale * (n + m + 1.0) * (n + m + 2.0))
            cx[n + 1, m + 1] -= raised * cnm
            sx[n + 1, m + 1] -= raised * snm
            cy[n + 1, m + 1] += raised * snm
            sy[n + 1, m + 1] -= raised * cnm
            doubled = 2.0 if m == 1 else 1.0  # the normalisation of order 0 lacks a factor 2
            lowered = 0.5 * math.sqrt(doubled * scale * (n - m + 1.0) * (n - m + 2.0))
            cx[n + 1, m - 1] += lowered * cnm
            cy[n + 1, m - 1] += lowered * snm
            if m > 1:  # order 0 has no sine
                sx[n + 1, m - 1] += lowered * snm
                sy[n + 1, m - 1] -= lowered * cnm


@kernel
def _load_recursion(field):
    """Factors of A_nm = ahead u A_(n-1)m - behind A_(n-2)m and of A_nn = sectoral A_(n-1)(n-1)."""
    field.ahead[:, :] = 0.0
    field.behind[:, :] = 0.0
    field.sectoral[0] = 1.0
    field.sectoral[1] = math.sqrt(3.0)
    for n in range(2, HARMONIC_ROWS):
        field.sectoral[n] = math.sqrt((2.0 * n + 1.0) / (2.0 * n))
    for n in range(HARMONIC_ROWS):
        for m in range(n):
            both = (2.0 * n + 1.0) / ((n - m) * (n + m))
            field.ahead[n, m] = math.sqrt(both * (2.0 * n - 1.0))
            if m < n - 1:
                field.behind[n, m] = math.sqrt(both * (n - m - 1.0) * (n + m - 1.0) / (2.0 * n - 3.0))


@entry(frozen_records(GRAVITY_TABLE), frozen_records(FORCE_TABLE), records(FIELD))
def load_field(table, forces, field):
    """Make the field that flies from a table of coefficients, to the degree and order of the force table.

    False, and nothing changed, where the force table asks for more than there is.
    """
    source = table[0]
    wanted = forces[0]
    ready = field[0]
    if wanted.degree > source.degree or wanted.order > wanted.degree:
        return False
    ready.gm_m3ps2 = source.gm_m3ps2
    ready.radius_m = source.radius_m
    ready.tide_system = source.tide_system
    ready.degree = wanted.degree
    ready.order = wanted.order
    ready.gradient_degree = min(wanted.gradient_degree, wanted.degree)
    ready.gradient_order = min(ready.gradient_degree, wanted.order)
    _load_recursion(ready)
    ready.potential[:, :, :] = 0.0
    for n in range(source.degree + 1):
        for m in range(n + 1):
            place = n * (n + 1) + 2 * m
            ready.potential[0, n, m] = source.coefficients[place]
            ready.potential[1, n, m] = source.coefficients[place + 1]
    c = ready.potential[0]
    s = ready.potential[1]
    _derive(ready.degree, ready.order, c, s, ready.acceleration)
    degree = ready.gradient_degree
    order = ready.gradient_order
    first = ready.truncated
    _derive(degree, order, c, s, first)
    _derive(degree + 1, order + 1, first[0], first[1], ready.gradient[0:6])
    _derive(degree + 1, order + 1, first[2], first[3], ready.gradient[6:12])
    return True


@kernel
def _whole_blocks(count):
    """Orders to sum over for `count` of them: what lies beyond is zero, and whole blocks go fastest."""
    return (count + HARMONIC_BLOCK - 1) // HARMONIC_BLOCK * HARMONIC_BLOCK


@kernel
def _next_row(field, n, count, z, rho, older, old, new):
    """Row n of (R / r)^(n + 1) A_nm into `new` from rows n - 2 and n - 1; zero beyond order n."""
    ahead = field.ahead[n]
    behind = field.behind[n]
    rho2 = rho * rho
    for m in range(count):
        new[m] = ahead[m] * z * old[m] - behind[m] * rho2 * older[m]
    if n > 0:
        new[n] = field.sectoral[n] * rho * old[n - 1]


@kernel
def _sum_rows(field, coefficients, degree, order, r, work, sums):
    """Sums over the degree, order by order, of coefficients times (R / r)^(n + 1) A_nm.

    Four degrees are taken together: a loop over the orders is short, and to enter it costs as much as to run it.
    """
    size = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    rho = field.radius_m / size
    z = rho * r[2] / size
    row0, row1, row2, row3 = work.rows[0], work.rows[1], work.rows[2], work.rows[3]
    # the recursion multiplies by zero what it does not have: it must be finite
    work.rows[:, :] = 0.0
    for j in range(sums.shape[0]):
        sums[j, :] = 0.0
    for n in range(0, degree + 1, HARMONIC_GROUP):
        count = _whole_blocks(min(n + HARMONIC_GROUP - 1, order) + 1)
        _next_row(field, n, count, z, rho, row2, row3, row0)
        if n == 0:
            row0[0] = rho
        _next_row(field, n + 1, count, z, rho, row3, row0, row1)
        _next_row(field, n + 2, count, z, rho, row0, row1, row2)
        _next_row(field, n + 3, count, z, rho, row1, row2, row3)
        for j in range(sums.shape[0]):
            c0, c1, c2, c3 = coefficients[j, n], coefficients[j, n + 1], coefficients[j, n + 2], coefficients[j, n + 3]
            total = sums[j]
            for m in range(count):
                total[m] += c0[m] * row0[m] + c1[m] * row1[m] + c2[m] * row2[m] + c3[m] * row3[m]


@kernel
def acceleration(field, r, work, out):
    """Gravity at r [m, ITRF] into out [m/s2, ITRF], to the degree and order that were loaded."""
    order = field.order + 1
    sums = work.sums[0:6]
    _sum_rows(field, field.acceleration, field.degree + 1, order, r, work, sums)
    size = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    x = r[0] / size
    y = r[1] / size
    c = 1.0
    s = 0.0
    ax = 0.0
    ay = 0.0
    az = 0.0
    for m in range(order + 1):
        ax += sums[0, m] * c + sums[1, m] * s
        ay += sums[2, m] * c + sums[3, m] * s
        az += sums[4, m] * c + sums[5, m] * s
        c, s = c * x - s * y, c * y + s * x
    scale = field.gm_m3ps2 / (field.radius_m * field.radius_m)
    out[0] = scale * ax
    out[1] = scale * ay
    out[2] = scale * az


@kernel
def gradient(field, r, work, out):
    """d(acceleration)/dr at r [m, ITRF] into the 3x3 `out` [1/s2, ITRF], to the gradient's own degree."""
    order = field.gradient_order + 2
    sums = work.sums
    _sum_rows(field, field.gradient, field.gradient_degree + 2, order, r, work, sums)
    size = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    x = r[0] / size
    y = r[1] / size
    c = 1.0
    s = 0.0
    xx = 0.0
    xy = 0.0
    xz = 0.0
    yy = 0.0
    yz = 0.0
    for m in range(order + 1):
        xx += sums[0, m] * c + sums[1, m] * s
        xy += sums[2, m] * c + sums[3, m] * s
        xz += sums[4, m] * c + sums[5, m] * s
        yy += sums[8, m] * c + sums[9, m] * s
        yz += sums[10, m] * c + sums[11, m] * s
        c, s = c * x - s * y, c * y + s * x
    scale = field.gm_m3ps2 / (field.radius_m * field.radius_m * field.radius_m)
    out[0, 0] = scale * xx
    out[0, 1] = scale * xy
    out[0, 2] = scale * xz
    out[1, 0] = out[0, 1]
    out[1, 1] = scale * yy
    out[1, 2] = scale * yz
    out[2, 0] = out[0, 2]
    out[2, 1] = out[1, 2]
    out[2, 2] = -out[0, 0] - out[1, 1]  # Laplace
