"""The table of the inter-satellite monitor: who it is, what is normal, how often it may err, what it takes as an epoch.

Thresholds stand nowhere here: they follow from the noise and from the wanted false-alarm rate (crosslink/setup.py).
"""

from __future__ import annotations

from flightsw.icd.table_field import Field, Schema, group, real, whole

MAX_CROSSLINK_SATELLITES = 32
MAX_CROSSLINK_ONSETS = 10


def _error(name: str, what: str, default: float, rate: float) -> tuple[Field, Field]:
    return (
        real(f"sigma_{name}_m", "m", 0.0, 1e4, default, f"1-sigma of a healthy message: {what}"),
        real(f"sigma_{name}_rate_mps", "m/s", 0.0, 1e2, rate, "of its growth since the upload"),
    )


CROSSLINK = Schema(
    "crosslink",
    6,
    (
        *group(
            "constellation",
            whole("satellites", "count", 2, MAX_CROSSLINK_SATELLITES, 24, "numbers from 0 to one less are satellites"),
            whole("own", "1", 0, MAX_CROSSLINK_SATELLITES - 1, 0, "number of the satellite that flies this"),
            whole("two_way", "0 no, 1 yes", 0, 1, 0, "ranges are means of both ways: they know no clocks"),
            whole("both", "0 no, 1 yes", 0, 1, 1, "every pair is measured by both satellites"),
        ),
        *group(
            "noise",  # of healthy satellites; every threshold follows from it
            real("sigma_range_m", "m", 1e-3, 1e4, 11.8, "1-sigma of a range"),
            *_error("radial", "radial", 0.5, 0.0017),
            *_error("along", "along-track", 3.5, 0.0002),
            *_error("cross", "cross-track", 3.5, 0.0002),
            *_error("clock", "clock, as range", 0.0, 0.0),
        ),
        *group(
            "decision",
            real("p_false_alarm", "1", 1e-12, 0.05, 2e-7, "false alarms of one epoch, of each monitor as a whole"),
            real("slow_share", "1", 0.0, 0.99, 0.5, "share of it that belongs to slow faults; 0: not sought"),
            real("p_clear", "1", 1e-9, 0.5, 1e-3, "a statistic that is rarer does not speak for a satellite"),
            whole("clear_epochs", "count", 1, 100000, 30, "epochs in a row that speak for it before it is taken in"),
            whole("faulty_max", "count", 1, MAX_CROSSLINK_SATELLITES - 1, 6, "satellites named at a time, at most"),
        ),
        *group(
            "slow_faults",
            whole("block_epochs", "count", 10, 1000, 10, "epochs averaged into a block of the history"),
            Field(
                "onset_blocks",
                "i8",
                (MAX_CROSSLINK_ONSETS,),
                "blocks",
                -118,
                118,
                0,
                "ages of a slow fault that are tried; negative: mean of so many blocks; 0: none",
            ),
        ),
        *group(
            "epoch",  # what is taken from the bus
            real("epoch_s", "s", 0.01, 60.0, 1.0, "from one epoch to the next"),
            real("gap_max_s", "s", 0.02, 3600.0, 5.0, "after a longer gap the search for slow faults begins anew"),
            real("silence_max_s", "s", 0.02, 300.0, 2.5, "a satellite that was not judged for longer is not monitored"),
            real(
                "ephemeris_age_max_s", "s", 0.0, 5.0, 5.0, "older messages stand for nobody; two-body motion till then"
            ),
            real("latency_max_s", "s", 0.0, 60.0, 3.0, "an epoch that is older by onboard time is stale"),
            real("future_max_s", "s", 0.0, 10.0, 0.5, "an epoch may not be later than onboard time by more"),
            real("sigma_range_max_m", "m", 1e-3, 1e4, 25.0, "a range that claims to be worse is left out"),
            real("radius_min_m", "m", 6.4e6, 1e9, 6.5e6, "smaller is not in orbit"),
            real("radius_max_m", "m", 6.4e6, 1e9, 5.0e7, "larger is not in this constellation"),
            real("speed_max_mps", "m/s", 1e2, 2e4, 1.0e4, "faster is absurd"),
        ),
    ),
)
