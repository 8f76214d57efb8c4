"""Means and covariances of an ensemble in lanes, against flight's own kernels one arc at a time."""

import numpy as np
import pytest

from flightsw.icd.table_file import decode
from flightsw.kernels import gravity, integrators
from flightsw.kernels.registry import MATRIX, VECTOR, entry, records
from flightsw.nav import filter
from flightsw.records import TABLE, WORK
from ground.tables.build import build_navigation
from ground.tuning import ensemble
from ground.tuning.wide import OPTIONS, scratch

ROW = np.array([1.0, 0.01, 1e-6, 12.0, 0.15])
TURN = 0.3


@entry(records(TABLE), VECTOR, VECTOR, MATRIX, records(WORK))
def _one(tables, pole, x, p, works):
    """One step of an arc as flight does it: gradient at its beginning, transition, noise, mean, measurements."""
    table, work = tables[0], works[0]
    gravity.gradient(table, x[0:3], pole, work.gradient)
    filter.transition(table, 1.0, work.gradient, work)
    integrators.euler(table, x, 1.0, pole, work.stages)
    filter.predict_covariance(table, 0, 1.0, p, work, p)
    filter.gain(p, work.R, work)
    filter.condition(p, work.R, work, p)


def flight_table() -> np.ndarray:
    table = np.zeros(1, TABLE)
    values = decode(build_navigation("paper")).values
    for name in values.dtype.names or ():
        table[name] = values[name]
    table["gravity_model"], table["integrator"] = gravity.J2, integrators.EULER
    for name, value in zip(("tuning_q_r_m2", "tuning_q_v_m2ps2", "tuning_q_a_m2ps4"), ROW, strict=False):
        table[name][0, 0] = value
    return table


def drawn(arcs: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(7)
    angle = rng.uniform(0.0, 2.0 * np.pi, arcs)
    x = np.zeros((arcs, 9))
    x[:, 0], x[:, 2] = 6.9e6 * np.cos(angle), 6.9e6 * np.sin(angle)
    x[:, 3], x[:, 5] = -7600.0 * np.sin(angle), 7600.0 * np.cos(angle)
    x[:, 1], x[:, 6:] = 1e4 * rng.standard_normal(arcs), 1e-5 * rng.standard_normal((arcs, 3))
    root = rng.standard_normal((arcs, 9, 9)) * np.repeat((3.0, 0.3, 1e-3), 3)[:, None]
    return x, root @ root.transpose(0, 2, 1)


@pytest.mark.compiled
@pytest.mark.parametrize("threads", [1, 2])
def test_every_lane_is_what_flight_computes(threads: int) -> None:
    """GIVEN 37 arcs, two groups of lanes and some, and a pole that is tilted WHEN flown for 300 s THEN every arc has
    the state and the covariance that flight's kernels give, but for rounding."""
    pole = np.array([np.sin(TURN), 0.0, np.cos(TURN)])
    table, work = flight_table(), np.zeros(1, WORK)
    work["R"][0] = np.diag(np.repeat(ROW[3:] ** 2, 3))
    x0, p0 = drawn(37)
    record = table[0]
    field = ensemble.Field(float(record["mu_m3ps2"]), float(record["j2"]), float(record["equatorial_radius_m"]), pole)
    x, p = ensemble.fly(x0, p0, field, ROW, 300, threads=threads)
    for arc in (0, 7, 15, 16, 31, 32, 36):
        x1, p1 = x0[arc].copy(), p0[arc].copy()
        for _ in range(300):
            _one(table, pole, x1, p1, work)
        assert x[arc] == pytest.approx(x1, rel=1e-11, abs=1e-9)
        sigma = np.sqrt(np.diag(p1))
        assert np.abs((p[arc] - p1) / np.outer(sigma, sigma)).max() < 1e-9


def test_no_liberty_but_contraction_is_taken() -> None:
    """A NaN must stay one: of fastmath only what leaves it alone."""
    assert OPTIONS["fastmath"] == {"contract"}
    x0, p0 = drawn(2)
    x0[1, 0] = np.nan
    field = ensemble.Field(3.986e14, 1.08e-3, 6378137.0, np.array([0.0, 0.0, 1.0]))
    x, p = ensemble.fly(x0, p0, field, ROW, 3)
    assert np.isfinite(x[0]).all()
    assert np.isfinite(p[0]).all()
    assert np.isnan(x[1, 0])
    assert np.isnan(p[1, :6, :6]).any()


def test_scratch_begins_a_line_of_the_cache() -> None:
    """GIVEN scratch of any size, other memory taken in between THEN it begins at a multiple of 64 bytes, all zeros."""
    kept = []
    for size in (16, 1296, 1296, 48):
        kept += [np.zeros(3), scratch(3, size)]
        assert kept[-1].ctypes.data % 64 == 0
        assert kept[-1].shape == (3, size)
        assert kept[-1].flags.c_contiguous
        assert not kept[-1].any()
