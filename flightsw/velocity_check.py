"""Function beside navigation: is a receiver's velocity the derivative of its positions? (flightsw/derivative/check.py)

Runs where there is a table `velocity_check`. It takes the innovations of the last fix, which navigation has recorded
whether it used them or not: position and velocity less the predicted orbit, GCRF. It tells, by an alert and a message;
what navigation uses is for navigation's own editing and monitor to say.
"""

from __future__ import annotations

import math

import numpy as np

from flightsw.derivative.check import check_fix
from flightsw.derivative.setup import Check, CheckSettings
from flightsw.icd.alerts import AlertId
from flightsw.icd.mavlink import MAVLINK_MSG_ID_LEONAV_VELOCITY_CHECK, MAVLink_leonav_velocity_check_message
from flightsw.icd.table_file import TableImage
from flightsw.link.message_layout import MessageLayout
from flightsw.records_io import RecordReader
from flightsw.services import Services

_FAULT_BIT = 1 << int(AlertId.RECEIVER_VELOCITY_FAULT)
# after these the orbit of before says nothing about the fixes of after
_ANEW = sum(
    1 << int(alert)
    for alert in (
        AlertId.INITIALISED,
        AlertId.REINITIALISED,
        AlertId.CLOCK_REINITIALISED,
        AlertId.MANOEUVRE_DETECTED,
        AlertId.STATE_UPLOADED,
    )
)
_BURNS = 1 << int(AlertId.BURN_ACTIVE)
_USED = -1
_U32 = 0xFFFFFFFF
_VELOCITY_CHECK = MessageLayout(MAVLink_leonav_velocity_check_message)


class VelocityCheck:
    """One check, made ready from its table; fixes that share a tick are looked at once, the last of them."""

    __slots__ = (
        "_check",
        "_places",
        "_reader",
        "_seen_ns",
        "_services",
        "_start_ns",
        "_threshold",
        "_variances",
        "_vectors",
        "conditions",
        "happened",
        "values",
    )

    name = "velocity_check"
    budget_us = 50.0

    def __init__(self, table: TableImage, services: Services) -> None:
        values = table.values
        fields = {name: float(values[name][0]) for name in values.dtype.names or ()}
        self._check = Check(CheckSettings(**fields))
        self._threshold = float(self._check.table["threshold"][0])
        self._reader = RecordReader(self._check.state)
        axes, states, _ = self._check.state.dtype["P"].shape
        first = self._reader.at["P"] + states + 1  # of the velocity of the first axis
        self._variances = [first + axis * states * states for axis in range(axes)]
        self._services = services
        self._places = services.places
        self._vectors = tuple(np.zeros(3) for _ in range(4))  # dr, dv, sigma of r, of v
        self._seen_ns = self._start_ns = 0
        self.conditions = self.happened = 0
        self.values = {int(AlertId.RECEIVER_VELOCITY_FAULT): self._bias_mps}
        services.downlink.add(MAVLINK_MSG_ID_LEONAV_VELOCITY_CHECK, "status", self.tell)

    def run(self) -> None:
        """Take the fix of the last tick, if there was one."""
        out, at = self._services.reading(), self._places
        fix = self._services.downlink.fix()
        fresh = bool(fix[at["fix_seen"]]) and int(fix[at["fix_gps_ns"]]) != self._seen_ns
        events = int(out[at["events"]]) | (int(fix[at["events"]]) if fresh else 0)
        if events & _ANEW or int(out[at["alerts"]]) & _BURNS:
            self._check.state["fixes"] = 0  # begins anew with the next fix, a fault forgotten
        if not fresh:
            return
        t_gps_ns = self._seen_ns = int(fix[at["fix_gps_ns"]])
        if fix[at["type_cause"]] != _USED or math.isnan(fix[at["innovation"] + 3]):
            return
        dr_m, dv_mps, sigma_r_m, sigma_v_mps = self._vectors
        place, spread = at["innovation"], at["innovation_sigma"]
        for axis in range(3):
            dr_m[axis], dv_mps[axis] = fix[place + axis], fix[place + 3 + axis]
            sigma_r_m[axis], sigma_v_mps[axis] = fix[spread + axis], fix[spread + 3 + axis]
        if self._start_ns == 0:
            self._start_ns = t_gps_ns
        t_s = (t_gps_ns - self._start_ns) * 1e-9
        check_fix(self._check.table, self._check.state, t_s, dr_m, dv_mps, sigma_r_m, sigma_v_mps)
        self.conditions = _FAULT_BIT if self._check.state["fault"][0] else 0

    def _bias_mps(self) -> float:
        """Length of the mean error of the velocity; NaN while nothing is tested."""
        state = self._check.state[0]
        return math.hypot(*state["bias_mps"].tolist()) if state["bias_count"] > 0.0 else math.nan

    def tell(self) -> None:
        """LEONAV_VELOCITY_CHECK."""
        state, at = self._reader.read(), self._reader.at
        bias, summed = at["bias_mps"], state[at["bias_count"]] > 0.0
        self._services.link.send(
            _VELOCITY_CHECK,
            self._seen_ns,
            min(int(state[at["fixes"]]), _U32),
            min(int(state[at["alarms"]]), _U32),
            state[at["statistic"]],
            self._threshold,
            *(state[bias : bias + 3] if summed else (math.nan, math.nan, math.nan)),
            math.sqrt(max(state[place] for place in self._variances)),
            int(state[at["armed"]]),
            int(state[at["fault"]]),
        )
