"""How well positions determine derivatives: condition numbers of the observability matrices, exactly.

N_f[i, j] = i^(j-1) of the chain in units of its step, N_p = N_f D_f in physical ones, N_s with columns of length one.
The squared singular values of N_f D belong to the pencil (N_f' N_f, D^-2), whose entries are rational: the largest and
the least are found by powers of it and of its exact inverse, in whole numbers of hundreds of bits. In double precision
the numbers of n = 19 and 20 are noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from operator import mul
from typing import NamedTuple

import numpy as np

EARTH_M = 6_371_000
LARGEST = 30
_BITS = 600  # that a vector keeps; a matrix of n = 30 cancels some 400
_FINE = 1 << 300  # before a weight is divided out, so that nothing small is cut off
_SETTLED = Fraction(1, 10**18)
_ZERO = Fraction(0)
_EPS = 2.0**-52


class Condition(NamedTuple):
    """Condition numbers of a chain of n: physical, one stage (two stages: the same), first stage alone; in doubles."""

    n: int
    physical: float
    normalised: float
    first_stage: float
    physical_double: float
    normalised_double: float
    first_stage_double: float

    @property
    def digits(self) -> float:
        """Decimal digits that double precision has left in the normalised problem."""
        return max(0.0, -math.log10(_EPS * self.normalised))

    @property
    def solvable(self) -> str:
        """What double precision can do: in physical variables, in normalised ones only, or in neither."""
        if _EPS * self.physical < 1e-3:
            return "in both"
        return "normalised" if _EPS * self.normalised < 1e-3 else "in neither"


def powers(n: int) -> list[list[int]]:
    """N_f: row i = 1 to n, column j = 0 to n - 1, i to the j."""
    return [[i**j for j in range(n)] for i in range(1, n + 1)]


def scales(n: int, tau_s: Fraction, rho: Fraction) -> list[Fraction]:
    """Diagonal of D_f: 1, rho tau, rho tau^2 / 2, ..."""
    values = [Fraction(1)]
    for j in range(1, n):
        values.append(values[-1] * tau_s / j * (rho if j == 1 else 1))
    return values


def _inverse(rows: list[list[int]]) -> tuple[list[list[int]], int]:
    """Inverse of a whole-numbered matrix as (numerators, common denominator), by Gauss and Jordan in fractions."""
    n = len(rows)
    work = [[Fraction(v) for v in row] + [Fraction(int(i == j)) for j in range(n)] for i, row in enumerate(rows)]
    for k in range(n):  # the leading minors of a Vandermonde matrix are not zero: no pivoting
        pivot = work[k][k]
        work[k] = [value / pivot for value in work[k]]
        for i in range(n):
            if i != k and (share := work[i][k]):
                work[i] = [a - share * b for a, b in zip(work[i], work[k], strict=True)]
    common = math.lcm(*(value.denominator for row in work for value in row[n:]))
    return [[int(value * common) for value in row[n:]] for row in work], common


def _times(matrix: list[list[int]], x: list[int]) -> list[int]:
    return [sum(map(mul, row, x)) for row in matrix]


def _extreme(step: Callable[[list[int]], list[int]], gram: list[list[int]], weight: list[Fraction]) -> Fraction:
    """Where x' gram x / x' W x settles when `step` is repeated; to 1e-18 of itself."""
    # whatever the eigenvector, it has a part of this: no symmetry of the matrices makes it orthogonal
    x = [(-1) ** i * (i * i + 3) << _BITS for i in range(len(gram))]
    last = Fraction(0)
    while True:
        x = step(x)
        shift = max(abs(value).bit_length() for value in x) - _BITS
        x = [value >> shift if shift > 0 else value << -shift for value in x]
        quotient = sum(map(mul, x, _times(gram, x))) / sum((w * v * v for w, v in zip(weight, x, strict=True)), _ZERO)
        if abs(quotient - last) <= quotient * _SETTLED:
            return quotient
        last = quotient


def _condition(rows: list[list[int]], weight: list[Fraction]) -> float:
    """Condition number of rows W^-1/2: of the pencil (rows' rows, W), W diagonal."""
    columns = [list(column) for column in zip(*rows, strict=True)]
    gram = [_times(columns, column) for column in columns]
    inverse, _ = _inverse(rows)
    turned = [list(column) for column in zip(*inverse, strict=True)]

    def up(x: list[int]) -> list[int]:
        return [value * w.denominator * _FINE // w.numerator for value, w in zip(_times(gram, x), weight, strict=True)]

    def down(x: list[int]) -> list[int]:
        weighted = [value * w.numerator * _FINE // w.denominator for value, w in zip(x, weight, strict=True)]
        return _times(inverse, _times(turned, weighted))

    ratio = _extreme(up, gram, weight) / _extreme(down, gram, weight)
    return float(Fraction(math.isqrt((ratio.numerator << 200) // ratio.denominator), 1 << 100))


def condition(n: int, tau_s: Fraction, rho: Fraction = Fraction(1, EARTH_M)) -> Condition:
    """Condition numbers of a chain of n integrators at a step of tau_s [s]; ValueError for what is no chain."""
    if not 2 <= n <= LARGEST:
        raise ValueError(f"n {n}: give 2 to {LARGEST}")
    if not (tau_s > 0 and rho > 0):
        raise ValueError(f"tau {float(tau_s)}, rho {float(rho)}: must be positive")
    rows, d = powers(n), scales(n, tau_s, rho)
    squares = [Fraction(sum(row[j] * row[j] for row in rows)) for j in range(n)]
    n_f = np.array(rows, dtype=float)
    n_p = n_f * np.array([float(value) for value in d])
    return Condition(
        n,
        _condition(rows, [1 / (value * value) for value in d]),
        _condition(rows, squares),
        _condition(rows, [Fraction(1)] * n),
        float(np.linalg.cond(n_p)),
        float(np.linalg.cond(n_f / np.linalg.norm(n_f, axis=0))),
        float(np.linalg.cond(n_f)),
    )


def lines(found: list[Condition], tau_s: float, rho: float) -> list[str]:
    """The table, as the command prints it."""
    answer = [
        f"condition numbers, exact; tau {tau_s:g} s, rho {rho:.6g}; in brackets what double precision makes of them",
        f"{'n':>3} {'mu(N_p)':>25} {'mu(N_pN) = mu(N_s)':>25} {'mu(N_f)':>25} {'digits left':>12}  solvable in doubles",
    ]
    for one in found:
        pairs = (
            (one.physical, one.physical_double),
            (one.normalised, one.normalised_double),
            (one.first_stage, one.first_stage_double),
        )
        words = " ".join(f"{f'{exact:.7g} ({double:.4g})':>25}" for exact, double in pairs)
        answer.append(f"{one.n:>3} {words} {one.digits:>12.1f}  {one.solvable}")
    return answer
