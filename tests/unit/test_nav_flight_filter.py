"""The flight filter through the step: what is used, edited and recorded, and what the monitor makes of faults.

Truth is Kepler's, fixes have white noise of 10 m and 0.1 m/s where nothing else is said.
"""

from __future__ import annotations

import numpy as np
import pytest
from flight_filter_bench import errors_rtn, fixes_every_second, fly, flying_memory, kepler

from flightsw.icd.alerts import AlertId

FOUND_MANOEUVRE = 1 << int(AlertId.MANOEUVRE_DETECTED)
REINITIALISED = 1 << int(AlertId.REINITIALISED)


@pytest.mark.compiled
@pytest.mark.parametrize(("dv_mps", "sigma_r_m", "sigma_v_mps"), [(5.0, 1.0, 0.03), (20.0, 10.0, 0.1)])
def test_a_manoeuvre_that_the_gate_refuses_is_followed_too(dv_mps: float, sigma_r_m: float, sigma_v_mps: float) -> None:
    """GIVEN a kick so large that the gate refuses all fixes after it WHEN the monitor finds it THEN the state is
    corrected and opened by it at once: fixes are used again, nothing starts anew, a bound is broken for 5 s at most."""
    truth = kepler(kicks=[(1200.4, dv_mps * np.array([0.6, 0.0, 0.8]))])
    noise = np.random.default_rng(1)
    inputs = fixes_every_second(0, 1800, truth, noise, sigma_r_m, sigma_v_mps)
    outputs = fly(flying_memory(monitor_use="yes"), inputs)
    after = slice(1201, None)
    assert np.count_nonzero(outputs["events"] & FOUND_MANOEUVRE) == 1
    assert not (outputs["events"][after] & REINITIALISED).any()
    refused = np.flatnonzero(outputs["fix_cause"][after] >= 0)
    assert 2 <= len(refused) <= 6
    assert refused.max() <= 6
    error = np.abs(outputs["r_gcrf_m"] - truth(outputs["t_gps_ns"])[0]).max(axis=1)
    assert np.count_nonzero(error[after] > outputs["bound_m"][after]) <= 5
    dr, _ = errors_rtn(outputs[-300:], truth)
    assert np.sqrt((dr**2).sum(axis=1).mean()) <= 0.3 * sigma_r_m
