"""What is said of an epoch of pseudoranges: on the bus when it was judged, to the ground at the rate of the status."""

from __future__ import annotations

import math
from collections.abc import Sequence

from flightsw.icd import mavlink as m
from flightsw.icd.can_frames import GNSS_CHECK, GNSS_EXCLUDED, GNSS_USED
from flightsw.link.mavlink_out import MavlinkOut
from flightsw.link.message_layout import MessageLayout
from flightsw.pseudoranges.judged import Judged
from flightsw.publishing import Outbox, Publisher

_FLOAT_MAX = 3.4e38  # beyond it struct packs no float32
_U8, _U32 = 0xFF, 0xFFFFFFFF
_CHECK = MessageLayout(m.MAVLink_leonav_gnss_check_message)


def single(value: float) -> float:
    """A value that float32 can hold; what is too large is infinite, NaN stays NaN."""
    return math.inf if value > _FLOAT_MAX else value


class Teller:
    """Fills the frames and the message."""

    __slots__ = ("_check", "_excluded", "_limits_m", "_link", "_publisher", "_used")

    def __init__(self, publisher: Publisher, link: MavlinkOut, limits_m: Sequence[float]) -> None:
        self._publisher = publisher
        self._link = link
        self._limits_m = tuple(single(limit) for limit in limits_m)
        self._check = Outbox(GNSS_CHECK)
        self._used = Outbox(GNSS_USED)
        self._excluded = Outbox(GNSS_EXCLUDED)

    def publish(self, unix_ns: int, judged: Judged) -> None:
        """GNSS_CHECK, GNSS_USED, GNSS_EXCLUDED."""
        send = self._publisher.send
        send(
            self._check,
            unix_ns,
            judged.t_gps_ns,
            single(judged.statistic),
            single(judged.threshold),
            *(single(level) for level in judged.protection_m),
            *self._limits_m,
            *(single(sigma) for sigma in judged.sigma_m),
            judged.verdict,
            sum(mask.bit_count() for mask in judged.used),
            sum(mask.bit_count() for mask in judged.excluded),
            min(judged.refused, _U8),
            min(max(judged.dof, 0), _U8),
            judged.available,
            judged.offered,
        )
        send(self._used, unix_ns, judged.t_gps_ns, *judged.used)
        send(self._excluded, unix_ns, judged.t_gps_ns, *judged.excluded)

    def tell(self, judged: Judged, age_s: float, epochs: int, offered: int) -> None:
        """LEONAV_GNSS_CHECK."""
        self._link.send(
            _CHECK,
            judged.t_gps_ns,
            *judged.used,
            *judged.excluded,
            single(age_s),
            single(judged.statistic),
            single(judged.threshold),
            *(single(level) for level in judged.protection_m),
            *self._limits_m,
            *(single(sigma) for sigma in judged.sigma_m),
            epochs & _U32,
            offered & _U32,
            judged.verdict,
            min(judged.refused, _U8),
            min(max(judged.dof, 0), _U8),
            judged.available,
            judged.offered,
        )
