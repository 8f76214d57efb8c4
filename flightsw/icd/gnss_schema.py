"""The table of the consistency test of pseudoranges (flightsw/pseudoranges): where it lies, the function flies."""

from __future__ import annotations

from flightsw.icd.table_field import Schema, group, real, whole

SYSTEMS = ("gps", "glonass", "galileo", "beidou")  # in the order of enums.Constellation

GNSS = Schema(
    "gnss",
    5,
    (
        *group(
            "epoch",  # what may enter one
            real("latency_max_s", "s", 0.0, 10.0, 1.0, "an epoch measured longer ago is not judged"),
            real("ephemeris_age_max_s", "s", 1.0, 600.0, 60.0, "an older place of a satellite is not used"),
            *(
                real(f"signal_sigma_{name}_m", "m", 0.0, 1e3, 0.0, "sigma of orbit and clock, added to the receiver's")
                for name in SYSTEMS
            ),
        ),
        *group(
            "ionosphere",  # of a receiver of one frequency; Klobuchar's coefficients are those of the GPS message
            real("iono_share", "1", 0.0, 1.0, 0.0, "of the vertical delay, above the receiver; 0: two frequencies"),
            real("iono_layer_m", "m", 1e3, 1e7, 3e5, "how far above the receiver the layer is that rays pass"),
            real("iono_error", "1", 0.0, 10.0, 0.5, "1-sigma of the model as a share of what it says"),
            real("iono_floor_m", "m", 0.0, 1e3, 0.3, "1-sigma of the vertical delay besides"),
            *(
                real(f"iono_alpha_{k}", f"s/sc^{k}", -1e-3, 1e-3, value, "amplitude of the day")
                for k, value in enumerate((4.6566e-9, 1.4901e-8, -5.9605e-8, -1.1921e-7))
            ),
            *(
                real(f"iono_beta_{k}", f"s/sc^{k}", -1e9, 1e9, value, "length of the day")
                for k, value in enumerate((81_920.0, 98_304.0, -65_536.0, -524_290.0))
            ),
        ),
        *group(
            "test",
            whole("consistency", "0 chi_square, 1 markov, 2 none", 0, 2, 0, "test of all residuals; none: a study"),
            real("alpha", "1", 1e-12, 0.5, 5e-4, "its false alarms per epoch"),
            real("local_alpha", "1", 0.0, 0.5, 5e-4, "the same, of the largest normalised residual; 0: none"),
            real("sigma_factor", "1", 0.01, 1e3, 1.0, "bound of the unit-weight standard deviation"),
        ),
        *group(
            "exclusion",
            whole("rule", "0 greedy, 1 probable", 0, 1, 1, "the paper's, or the most probable consistent rest"),
            whole("faulty_max", "count", 0, 8, 7, "satellites that may be left out of an epoch; 0: no exclusion"),
            whole("candidates_max", "count", 0, 1_000_000, 20_000, "sets that may be looked at in one epoch"),
            real("isolate_odds", "1", -100.0, 100.0, 7.0, "2 ln of the odds against one more fault"),
            whole("further", "count", 0, 8, 2, "exclusions beyond the fewest that are weighed"),
            real("ambiguity", "1", 0.0, 1e3, 4.6, "2 ln of the odds below which two explanations are not told apart"),
        ),
        *group(
            "protection",  # levels by solution separation
            whole("protect", "0 no, 1 yes", 0, 1, 1, "whether levels are made"),
            *(real(f"p_satellite_{name}", "1", 0.0, 0.1, None, "prior of one satellite's fault") for name in SYSTEMS),
            *(real(f"p_constellation_{name}", "1", 0.0, 0.1, None, "prior of a common fault") for name in SYSTEMS),
            *(
                real(f"p_hmi_{axis}", "1", 1e-12, 0.1, 1e-7, "allowed: error beyond the level, not told")
                for axis in ("east", "north", "up")
            ),
            real("p_unmonitored", "1", 0.0, 1.0, 0.7, "share of the above below which pairs are no modes"),
            real("nominal_bias_m", "m", 0.0, 100.0, 0.0, "largest bias of a healthy range"),
            *(
                real(f"alert_limit_{axis}_m", "m", 0.1, 1e6, 10.0, "level beyond which an alert holds")
                for axis in ("east", "north", "up")
            ),
        ),
        *group(
            "fix",
            whole("offer_untested", "0 no, 1 yes", 0, 1, 0, "offer a fix that nothing can contradict"),
            whole("hold_beyond_limit", "0 no, 1 yes", 0, 1, 0, "offer no fix whose level exceeds the alert limit"),
            real("sigma_floor_m", "m", 0.0, 1e3, 0.1, "no fix claims to be better on any axis"),
        ),
        *group(
            "alerts",  # of conditions that last
            whole("raise_epochs", "count", 1, 10000, 3, "epochs in a row with it before an alert"),
            whole("clear_epochs", "count", 1, 100000, 30, "epochs in a row without it before the alert ends"),
        ),
    ),
)
