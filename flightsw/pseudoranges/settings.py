"""The settings of the consistency test, from its table."""

from __future__ import annotations

import numpy as np

from flightsw.gnss.records import Consistency, Rule
from flightsw.gnss.setup import Settings
from flightsw.icd.gnss_schema import SYSTEMS

_AXES = ("east", "north", "up")


def settings_of(record: np.void) -> Settings:
    """Settings from a record of the schema `gnss`; ranges were checked when it was loaded."""

    def each(stem: str, names: tuple[str, ...], end: str = "") -> tuple[float, ...]:
        return tuple(float(record[f"{stem}_{name}{end}"]) for name in names)

    east, north, up = each("p_hmi", _AXES)
    east_m, north_m, up_m = each("alert_limit", _AXES, "_m")
    return Settings(
        rule=Rule(int(record["rule"])),
        test=Consistency(int(record["consistency"])),
        alpha=float(record["alpha"]),
        local_alpha=float(record["local_alpha"]),
        sigma_factor=float(record["sigma_factor"]),
        faulty_max=int(record["faulty_max"]),
        candidates_max=int(record["candidates_max"]),
        isolate_odds=float(record["isolate_odds"]),
        further=int(record["further"]),
        ambiguity=float(record["ambiguity"]),
        protect=bool(record["protect"]),
        p_satellite=each("p_satellite", SYSTEMS),
        p_constellation=each("p_constellation", SYSTEMS),
        p_hmi=(east, north, up),
        p_unmonitored=float(record["p_unmonitored"]),
        bias_m=float(record["nominal_bias_m"]),
        alert_limit_m=(east_m, north_m, up_m),
        ephemeris_age_max_s=float(record["ephemeris_age_max_s"]),
        signal_sigma_m=each("signal_sigma", SYSTEMS, "_m"),
        iono_share=float(record["iono_share"]),
        iono_layer_m=float(record["iono_layer_m"]),
        iono_error=float(record["iono_error"]),
        iono_floor_m=float(record["iono_floor_m"]),
        iono_alpha=each("iono_alpha", tuple("0123")),
        iono_beta=each("iono_beta", tuple("0123")),
    )
