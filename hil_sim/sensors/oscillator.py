"""The onboard counter: counter(t) = offset + (1 + drift) (t - t0) + random walks of phase and drift.

Absolute times stay int64 nanoseconds; only the deviation from true time, milliseconds at most, is a float.
"""

from __future__ import annotations

import numpy as np

from hil_sim.gps_time import NS
from hil_sim.scenario_schema import Oscillator as OscillatorSettings

MARGIN_S = 120
_ITERATIONS = 4  # of the inverse; each shrinks the error by the drift, at most 1e-4


class Oscillator:
    """Counter over [t_start, t_start + duration] with a margin on both sides.

    The random walks are drawn once a second; the phase is linear in between.
    """

    def __init__(
        self,
        settings: OscillatorSettings,
        t_start_gps_ns: int,
        duration_ns: int,
        stream: np.random.Generator,
    ) -> None:
        self.t_start_gps_ns = int(t_start_gps_ns)
        self.offset_ns = round(settings.offset_s * 1e9)
        self._t0_ns = self.t_start_gps_ns - MARGIN_S * NS
        nodes = -(-int(duration_ns) // NS) + 2 * MARGIN_S + 1
        walk_ns = np.cumsum(stream.standard_normal(nodes)) * settings.random_walk * 1e9
        if settings.drift_walk > 0.0:
            walked = np.cumsum(stream.standard_normal(nodes)) * settings.drift_walk
            walked -= walked[MARGIN_S]
            walk_ns[1:] += np.cumsum(walked[:-1]) * 1e9
        walk_ns -= walk_ns[MARGIN_S]
        drift_ns = settings.drift_ppm * 1e-6 * (np.arange(nodes) - MARGIN_S) * 1e9
        self._deviation_ns = drift_ns + walk_ns

    def counter_ns(self, t_gps_ns: np.ndarray) -> np.ndarray:
        """Counter reading (n,) int64 [ns] at true times (n,) [ns]."""
        t_gps_ns = np.asarray(t_gps_ns, dtype=np.int64)
        return self.offset_ns + (t_gps_ns - self.t_start_gps_ns) + self._deviation(t_gps_ns)

    def true_time_ns(self, counter_ns: np.ndarray) -> np.ndarray:
        """True time (n,) int64 [ns] at which the counter shows the reading, to 1 ns."""
        elapsed_ns = np.asarray(counter_ns, dtype=np.int64) - self.offset_ns
        t_gps_ns = self.t_start_gps_ns + elapsed_ns
        for _ in range(_ITERATIONS):
            t_gps_ns = self.t_start_gps_ns + elapsed_ns - self._deviation(t_gps_ns)
        return t_gps_ns

    def _deviation(self, t_gps_ns: np.ndarray) -> np.ndarray:
        since_ns = t_gps_ns - self._t0_ns
        i = np.clip(since_ns // NS, 0, len(self._deviation_ns) - 2)
        share = (since_ns - i * NS) / NS
        d = self._deviation_ns
        return np.rint(d[i] + share * (d[i + 1] - d[i])).astype(np.int64)
