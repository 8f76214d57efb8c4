"""Allocates every record of flight once; `reset` refills them in place."""

from __future__ import annotations

import math

import numpy as np

from flightsw.records import INPUT, NAV, ORIENTATION, OUTPUT, TABLE, WORK


class Memory:
    """The records that one navigation function works on, each an array of one.

    A fresh instance holds no state: nothing is shared between instances.
    """

    __slots__ = ("input", "nav", "orientation", "output", "table", "work")

    def __init__(self) -> None:
        self.nav = np.zeros(1, NAV)
        self.input = np.zeros(1, INPUT)
        self.output = np.zeros(1, OUTPUT)
        self.work = np.zeros(1, WORK)
        self.table = np.zeros(1, TABLE)
        self.orientation = np.zeros(1, ORIENTATION)
        self.table.flags.writeable = False
        self.orientation.flags.writeable = False
        self.reset()

    def reset(self) -> None:
        """Forget all state, as after power-up; tables stay."""
        for record in (self.nav, self.input, self.output, self.work):
            record.view(np.uint8)[:] = 0
        self.nav["pole"][0, 2] = 1.0
        self.nav["flag_age_s"] = math.nan
        self.nav["da_bin"] = -1

    def load(self, navigation: np.ndarray, orientation: np.ndarray) -> None:
        """Copy the payloads of the two tables (arrays of one record) into flight's aligned images."""
        for image, payload in ((self.table, navigation), (self.orientation, orientation)):
            image.flags.writeable = True
            for name in payload.dtype.names or ():
                image[name] = payload[name]
            image.flags.writeable = False
