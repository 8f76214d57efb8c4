"""The bound axis by axis: the largest axis has the bound itself, every axis what its covariance gives it.

Oracle: the covariances multiplied out with numpy from the factors, and rotated with numpy.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from flight_bench import NS, T0_GPS_NS, loaded_memory, record
from flight_filter_bench import MU, ORBIT, fixes_every_second, flying_memory, kepler, rtn
from hypothesis import given, settings
from hypothesis import strategies as st

from flightsw.kernels.registry import warm_up
from flightsw.memory import Memory
from flightsw.nav import flight_model
from flightsw.records import STATES
from ground.campaign import arc

STEP_NS = NS
RATE_RADPS = math.sqrt(MU / np.linalg.norm(ORBIT[:3]) ** 3)


def factors(rng: np.random.Generator, states: int, scale_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Factors (20, 20) as flight holds them, D on the diagonal of U, and the covariance they stand for.

    states: that are in use; the others are zero.
    """
    u = np.eye(STATES) + np.triu(rng.normal(size=(STATES, STATES)), 1)
    d = np.abs(rng.normal(size=STATES)) * scale_m**2 * (np.arange(STATES) < states)
    return np.triu(u, 1) + np.diag(d), u @ np.diag(d) @ u.T


def along(p: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Standard deviations of the position along the columns."""
    return np.sqrt(np.diag(axes.T @ p[:3, :3] @ axes))


def turned(axes: np.ndarray, angle_rad: float) -> np.ndarray:
    """The orbit's axes so far on along a circle."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return axes @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def at_epoch(memory: Memory) -> Any:
    """A record with the orbit of the bench at T0, in time with fixes, nothing in doubt."""
    nav = memory.nav
    nav["initialised"] = nav["clock_valid"] = 1
    nav["t_gps_ns"] = nav["t_fix_gps_ns"] = T0_GPS_NS
    nav["clock_gps_ns"] = T0_GPS_NS + 1000 * NS  # a pulse later than all that is asked: its own variance counts
    nav["x"][0, :6] = ORBIT[:6]
    return nav


SIZES = st.floats(-3.0, 4.0).map(lambda exponent: 10.0**exponent)


@settings(max_examples=200)
@given(seed=st.integers(0, 2**32 - 1), scale_m=SIZES, growth=st.floats(0.2, 5.0), doubt=st.floats(0.0, 50.0))
def test_an_axis_has_what_its_covariance_gives_it(seed: int, scale_m: float, growth: float, doubt: float) -> None:
    """GIVEN any covariance of the flight filter at both ends of an interval WHEN its bound is taken apart THEN each
    axis, of GCRF and of the orbit, has k sigma of the worse end, times the margin, plus the doubt."""
    warm_up()
    rng = np.random.default_rng(seed)
    memory = flying_memory(lever_sigma_m=0.0, attitude_sigma_rad=0.0)
    nav, margin, k = at_epoch(memory), rng.uniform(1.0, 2.0), 3.3
    states = int(flight_model.states(record(memory.table)))
    _, start = factors(rng, states, scale_m)
    nav["UD_ahead"][0], end = factors(rng, states, scale_m * growth)
    sigma_s = 10.0 ** rng.uniform(-9.0, -2.0)
    nav["clock_p"][0, 0, 0] = sigma_s**2
    rate = np.concatenate((ORBIT[3:6], -MU / np.linalg.norm(ORBIT[:3]) ** 3 * ORBIT[:3]))
    nav["covariance"][0] = start[:6, :6]
    end = end[:6, :6] + sigma_s**2 * np.outer(rate, rate)
    nav["monitor_doubt_m"] = doubt
    axes = rtn(ORBIT[:3], ORBIT[3:6])
    sigma = np.maximum(along(start, np.eye(3)), along(end, np.eye(3)))
    sigma_rtn = np.maximum(along(start, axes), along(end, turned(axes, RATE_RADPS * STEP_NS / NS)))
    bound_m = margin * k * sigma.max() + doubt
    levels = memory.protect(bound_m, T0_GPS_NS)
    np.testing.assert_allclose(levels[0], margin * k * sigma + doubt, rtol=1e-9)
    np.testing.assert_allclose(levels[1], margin * k * sigma_rtn + doubt, rtol=1e-7)
    assert levels[0].max() == bound_m


@settings(max_examples=100)
@given(seed=st.integers(0, 2**32 - 1), overdue=st.booleans())
def test_the_papers_filter_by_the_covariance_that_bounds_it(seed: int, overdue: bool) -> None:
    """Its own covariance while fixes come, that of (17) once one is overdue; the larger of both ends of the step."""
    warm_up()
    rng = np.random.default_rng(seed)
    memory = loaded_memory("paper")
    nav = at_epoch(memory)
    roots = rng.normal(size=(4, 9, 9)) * np.repeat([300.0, 0.5, 1e-4], 3)[:, None]
    names = ("P", "P_ahead", "P_bound", "P_bound_ahead")
    held = dict(zip(names, roots @ roots.transpose(0, 2, 1), strict=True))
    for name, p in held.items():
        nav[name][0] = p
    ends = [held[name] for name in (names[2:] if overdue else names[:2])]
    sigma = np.sqrt(np.maximum(np.diag(ends[0]), np.diag(ends[1])))[:3]
    levels = memory.protect(3.0 * sigma.max(), T0_GPS_NS + (2 * NS if overdue else 0))
    np.testing.assert_allclose(levels[0], 3.0 * sigma, rtol=1e-12)
    assert levels[0].max() == 3.0 * sigma.max()
    assert (levels[1] > 0.0).all()


@given(bound=st.sampled_from([math.nan, math.inf, -math.inf]))
def test_where_there_is_no_bound_no_axis_has_one(bound: float) -> None:
    warm_up()
    memory = flying_memory()
    at_epoch(memory)
    assert np.isnan(memory.protect(bound, T0_GPS_NS)).all()


def test_a_bound_without_a_covariance_behind_it_is_that_of_every_axis() -> None:
    """GIVEN a record whose covariances are nothing yet, or not a number THEN no axis has less than the bound."""
    warm_up()
    memory = flying_memory(lever_sigma_m=0.0, attitude_sigma_rad=0.0)
    nav = at_epoch(memory)
    assert (memory.protect(7.5, T0_GPS_NS) == 7.5).all()
    nav["covariance"][0, 1, 1] = math.nan
    assert (memory.protect(7.5, T0_GPS_NS) == 7.5).all()


@pytest.mark.compiled
@pytest.mark.parametrize("kind", ["flight", "paper"])
def test_in_flight_the_largest_axis_is_the_published_bound_to_the_bit(kind: str) -> None:
    """GIVEN fixes, an outage and fixes again WHEN levels are asked for after each step THEN the largest is the bound
    that the step published, the sphere is no smaller than half of it, and nothing that flight keeps has changed."""
    warm_up()
    memory = flying_memory(fixes_margin=1.25) if kind == "flight" else loaded_memory("paper")
    inputs = fixes_every_second(0, 300, kepler(), np.random.default_rng(8))
    inputs["fix_present"][120:240] = 0
    coasted = 0
    for k in range(len(inputs)):
        out = arc.fly(memory, inputs[k : k + 1])[0]
        before = memory.nav.tobytes()
        levels = memory.protect(float(out["bound_m"]), int(out["t_gps_ns"]))
        assert memory.nav.tobytes() == before
        if math.isnan(out["bound_m"]):
            assert np.isnan(levels).all()
            continue
        coasted += out["outage_age_s"] > 0.0
        assert levels[0].max() == out["bound_m"]
        assert (levels > 0.0).all()
        # three axes at right angles hold the whole variance, whichever they are
        assert np.linalg.norm(levels[0]) == pytest.approx(np.linalg.norm(levels[1]), rel=0.02)
    assert coasted > 100
