"""The information form of the weighted test against dense algebra, and against its covariance form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightsw.crosslink.declare import entry
from flightsw.crosslink.records import COLUMNS, PARAMETERS, TEST
from flightsw.crosslink.weighted_test import evaluate, exclude, prepare, restore, statistic_left
from flightsw.kernels.registry import I8, VECTOR, records, warm_up

SATELLITES = 6


@entry(records(TEST), VECTOR, VECTOR, VECTOR, I8, I8)
def judged(tests, residual_m, sigma_m, left, constant, out):
    """Prepare and evaluate; into left (satellites,) the statistics of the others without satellite `out`."""
    test = tests[0]
    left[0] = -1.0
    if prepare(test, left.shape[0], sigma_m, sigma_m, constant != 0):
        evaluate(test, residual_m)
        restore(test)
        exclude(test, out)
        for satellite in range(left.shape[0]):
            left[satellite], _ = statistic_left(test, satellite)


def a_test(seed: int, links: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A test with random links, noise and sensitivities, its A (links, 4n) and residuals."""
    rng = np.random.default_rng(seed)
    tests = np.zeros(1, TEST)
    test = tests[0]
    test["links"] = links
    a = np.zeros((links, SATELLITES * PARAMETERS))
    for link in range(links):
        ends = rng.choice(SATELLITES, 2, replace=False)
        test["receiver"][link], test["sender"][link] = ends
        test["h"][link] = test["h_bias"][link] = rng.standard_normal((2, PARAMETERS))
        for end, satellite in enumerate(ends):
            a[link, PARAMETERS * satellite : PARAMETERS * (satellite + 1)] = test["h"][link, end]
    test["noise_m2"][:links] = rng.uniform(0.5, 4.0, links)
    return tests, a, 3.0 * rng.standard_normal(links)


@given(
    seed=st.integers(0, 2**32 - 1),
    links=st.integers(1, 60),
    sigma_m=st.lists(st.sampled_from([0.0, 1e-3, 0.5, 3.5, 40.0]), min_size=4, max_size=4),
    out=st.integers(0, SATELLITES - 1),
)
@settings(deadline=None, max_examples=60)
def test_both_forms_are_one_test(seed: int, links: int, sigma_m: list[float], out: int) -> None:
    """GIVEN any links, noise and healthy errors WHEN judged in either form THEN degrees of freedom and statistics,
    with a satellite excluded too, are the same, and those of dense algebra."""
    warm_up()
    tests, a, r = a_test(seed, links)
    left, other_left = np.zeros(SATELLITES), np.zeros(SATELLITES)
    judged(tests, r, np.array(sigma_m), left, 1, out)
    dof, statistic = np.array(tests["dof"][0, :SATELLITES]), np.array(tests["statistic"][0, :SATELLITES])
    errors = SATELLITES * np.count_nonzero(sigma_m)
    assert tests["informed"][0] == (errors < links)
    # a rate shows in no link of these: h_rate is zero, so that what moves does not matter
    judged(tests, r, np.array(sigma_m), other_left, 0, out)
    assert tests["informed"][0] == 0
    np.testing.assert_array_equal(dof, tests["dof"][0, :SATELLITES])
    np.testing.assert_allclose(statistic, tests["statistic"][0, :SATELLITES], rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(left, other_left, rtol=1e-6, atol=1e-7)
    d = np.tile(sigma_m, SATELLITES)
    s = np.diag(np.array(tests["noise_m2"][0, :links])) + (a * d**2) @ a.T
    for satellite in range(SATELLITES):
        of = np.linalg.solve(np.linalg.cholesky(s), np.column_stack([a, r]))
        columns = of[:, PARAMETERS * satellite : PARAMETERS * (satellite + 1)]
        estimate, *_ = np.linalg.lstsq(columns, of[:, -1], rcond=1e-4)
        expected = np.sum((columns @ estimate) ** 2)
        if dof[satellite] == PARAMETERS:
            assert statistic[satellite] == pytest.approx(expected, rel=1e-6, abs=1e-8)


assert SATELLITES * PARAMETERS <= COLUMNS
