"""Condition numbers of the derivative chain: the paper's table, exact values from mpmath, what doubles cannot do."""

from __future__ import annotations

from fractions import Fraction

import mpmath
import numpy as np
import pytest

from ground.__main__ import main
from ground.derivative.conditioning import EARTH_M, condition, powers, scales

RHO = Fraction(1, EARTH_M)
# n, mu(N_p) at 0.2 s and at 1 s, mu(N_s), mu(N_f): from the paper, more digits by an independent recomputation
TABLE = (
    (2, 6.3710e7, 1.2742e7, 6.162278, 6.854102),
    (3, 7.279459e8, 6.084354e7, 39.00775, 70.92313),
    (4, 8.004691e9, 2.229065e8, 262.9437, 1171.013),
    (5, 8.778139e10, 7.478301e8, 1852.415, 26169.69),
    (10, 1.396809e16, 2.463363e11, 4.1966207e7, 2.106258e12),
)


@pytest.mark.parametrize(("n", "fine", "coarse", "normalised", "first"), TABLE)
def test_the_papers_table(n: int, fine: float, coarse: float, normalised: float, first: float) -> None:
    """GIVEN the paper's n and steps WHEN the condition numbers are computed THEN they are the table's to 1e-6."""
    small, whole = condition(n, Fraction("0.2")), condition(n, Fraction(1))
    assert small.physical == pytest.approx(fine, rel=1e-6)
    assert whole.physical == pytest.approx(coarse, rel=1e-6)
    for found in (small, whole):
        assert found.normalised == pytest.approx(normalised, rel=1e-6)
        assert found.first_stage == pytest.approx(first, rel=1e-6)


@pytest.mark.parametrize("n", [2, 7, 12])
def test_singular_values_of_mpmath_agree(n: int) -> None:
    """GIVEN the matrices in 120 digits WHEN mpmath takes their singular values THEN the ratios are ours to 1e-14."""
    found = condition(n, Fraction("0.2"))
    with mpmath.workdps(120):
        n_f = mpmath.matrix(powers(n))
        d = [mpmath.mpf(v.numerator) / v.denominator for v in scales(n, Fraction("0.2"), RHO)]
        for value, columns in (
            (found.first_stage, [mpmath.mpf(1)] * n),
            (found.physical, d),
            (found.normalised, [1 / mpmath.norm(n_f[:, j]) for j in range(n)]),
        ):
            s = mpmath.svd_r(n_f * mpmath.diag(columns), compute_uv=False)
            assert value == pytest.approx(float(s[0] / s[n - 1]), rel=1e-14)


@pytest.mark.parametrize("tau", ["0.2", "1", "7/3"])
def test_one_stage_and_two_stages_are_one(tau: str) -> None:
    """GIVEN N_p of any step WHEN its columns are normalised at once THEN it is N_s, and so is its condition number."""
    n = 6
    n_p = np.array(powers(n), float) * [float(v) for v in scales(n, Fraction(tau), RHO)]
    n_s = np.array(powers(n), float)
    np.testing.assert_allclose(n_p / np.linalg.norm(n_p, axis=0), n_s / np.linalg.norm(n_s, axis=0), rtol=1e-14)
    assert condition(n, Fraction(tau)).normalised == condition(n, Fraction("0.2")).normalised


def test_beyond_ten_doubles_are_noise() -> None:
    """GIVEN n = 19 and 20 THEN the exact numbers are those of a recomputation, and doubles are five powers off."""
    for n, first in ((19, 1.728475e29), (20, 1.801977e31)):
        found = condition(n, Fraction("0.2"))
        assert found.first_stage == pytest.approx(first, rel=1e-6)
        assert found.first_stage_double < 1e-3 * found.first_stage
        assert found.solvable == "in neither"
    assert condition(5, Fraction("0.2")).solvable == "in both"
    assert condition(10, Fraction("0.2")).solvable == "normalised"


def test_the_command_prints_the_table_and_names_mistakes(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["derivative", "conditioning", "--n", "5", "--tau", "0.2"]) == 0
    assert "1852.415" in capsys.readouterr().out
    for words in (["--n", "1"], ["--n", "31"], ["--tau", "0"], ["--tau", "x"], ["--rho", "-1"]):
        assert main(["derivative", "conditioning", *words]) == 2
        assert "ground: error: --" in capsys.readouterr().err
