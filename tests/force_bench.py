"""A bench for the force model: the flight model over two-body orbits, and satkit as a peer, forces on and off."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from flight_bench import T0_GPS_NS, loaded_memory, record

from flightsw.records import FIELD, FORCE_TABLE, FORCE_WORK, GRAVITY_TABLE
from ground.accuracy.flight_model import FlightModel
from ground.tables.gravity_field import packaged_model

NO_FORCES = {"solid_tides": "no", "sun": "no", "moon": "no", "relativity": "no", "area_to_mass_m2pkg": 0.0}
ZERO = np.zeros(3)


@cache
def flight_model(**settings: Any) -> FlightModel:
    """EGM96 and the Earth orientation around T0; settings are those of the force table."""
    return FlightModel(loaded_memory("j2").orientation, packaged_model("EGM96"), settings)


def bare_field(c20: float = 0.0, degree: int = 2, tide_system: int = 0) -> np.ndarray:
    """A field of coefficients by hand: only C00 and C20; (1,) records.FIELD."""
    from flightsw.kernels.spherical_harmonics import load_field

    table, forces, field = np.zeros(1, GRAVITY_TABLE), np.zeros(1, FORCE_TABLE), np.zeros(1, FIELD)
    table["gm_m3ps2"], table["radius_m"], table["tide_system"] = 3.986004415e14, 6378136.3, tide_system
    table["degree"] = degree
    table["coefficients"][0, 0] = 1.0
    table["coefficients"][0, 6] = c20
    forces["degree"] = forces["order"] = forces["gradient_degree"] = degree
    table.flags.writeable = forces.flags.writeable = False
    assert load_field(table, forces, field)
    field.flags.writeable = False
    return field


def work() -> Any:
    """Scratch full of NaN: what a kernel does not set it may not read."""
    scratch = np.zeros(1, FORCE_WORK)
    scratch.view(np.float64)[:] = np.nan
    return record(scratch)


def satkit_moved(state: np.ndarray, duration_s: float, degree: int, **forces: Any) -> np.ndarray:
    """State (6,) after satkit carried `state` from T0 on EGM96 with the forces named in `forces`."""
    from hil_sim.truth.satkit_data import satkit_time, session

    end_ns = T0_GPS_NS + round(duration_s * 1e9)
    with session(T0_GPS_NS, end_ns) as satkit:
        settings = satkit.propsettings(
            abs_error=1e-12,
            rel_error=1e-12,
            gravity_degree=degree,
            gravity_model=satkit.gravmodel.egm96,
            use_sun_gravity=forces.get("sun", False),
            use_moon_gravity=forces.get("moon", False),
            use_spaceweather=True,
            tide_model=satkit.tidemodel.solid_step1 if forces.get("tides") else satkit.tidemodel.none,
        )
        settings.use_relativistic_correction = forces.get("relativity", False)
        surface = satkit.satproperties(cdaoverm=forces.get("drag", 0.0), craoverm=forces.get("radiation", 0.0))
        result = satkit.propagate(
            state,
            satkit_time(satkit, T0_GPS_NS),
            duration_secs=duration_s,
            propsettings=settings,
            satproperties=surface,
        )
        return np.array(result.state)
