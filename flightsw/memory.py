"""Allocates every record of flight once; `reset` refills them in place."""

from __future__ import annotations

import math

import numpy as np

from flightsw.integrity.axis_levels import axis_levels
from flightsw.integrity.time_to_flag import look_ahead
from flightsw.kernels.spherical_harmonics import load_field
from flightsw.records import (
    AHEAD,
    ENVELOPE,
    FIELD,
    FORCE_TABLE,
    FORCE_WORK,
    GRAVITY_TABLE,
    INPUT,
    NAV,
    ORIENTATION,
    OUTPUT,
    TABLE,
    WORK,
)

_DEGREE_AHEAD = 8

WHOLE = 10**9  # steps of a prediction: to its end


class Memory:
    """The records that one navigation function works on, each an array of one.

    A fresh instance holds no state: nothing is shared between instances.
    """

    __slots__ = (
        "ahead",
        "field",
        "field_ahead",
        "forces",
        "input",
        "levels",
        "nav",
        "orientation",
        "output",
        "scratch",
        "table",
        "work",
    )

    def __init__(self) -> None:
        self.nav = np.zeros(1, NAV)
        self.input = np.zeros(1, INPUT)
        self.output = np.zeros(1, OUTPUT)
        self.work = np.zeros(1, WORK)
        self.table = np.zeros(1, TABLE)
        self.orientation = np.zeros(1, ORIENTATION)
        self.forces = np.zeros(1, FORCE_TABLE)
        self.field = np.zeros(1, FIELD)
        self.scratch = np.zeros(1, FORCE_WORK)
        self.ahead = np.zeros(1, AHEAD)
        self.levels = np.zeros((2, 3))
        self.field_ahead = np.zeros(1, FIELD)  # gravity of low degree, for predictions
        for image in (self.table, self.orientation, self.forces, self.field, self.field_ahead):
            image.flags.writeable = False
        self.reset()

    def reset(self) -> None:
        """Forget all state, as after power-up; tables stay."""
        for record in (self.nav, self.input, self.output, self.work, self.scratch, self.ahead):
            record.view(np.uint8)[:] = 0
        self.nav["pole"][0, 2] = 1.0
        self.nav["flag_age_s"] = math.nan
        self.nav["da_bin"] = -1

    def load(self, navigation: np.ndarray, orientation: np.ndarray) -> None:
        """Copy the payloads of the two tables (arrays of one record) into flight's aligned images."""
        _fill(self.table, navigation)
        _fill(self.orientation, orientation)

    def load_navigation(self, navigation: np.ndarray) -> None:
        """Copy the payload of another navigation table (an array of one record) over the one that flies."""
        _fill(self.table, navigation)

    def load_envelope(self, certificate: np.ndarray | None) -> None:
        """Copy where a certificate (an array of one record) holds beside the navigation table; None: it has none."""
        self.table.flags.writeable = True
        for name in ENVELOPE:
            self.table[name] = 0.0 if certificate is None else certificate[name.removeprefix("envelope_")]
        self.table.flags.writeable = False

    def load_forces(self, forces: np.ndarray, gravity_field: np.ndarray) -> None:
        """Copy the force table and make the gravity field that flies from its coefficients.

        Raises ValueError where the force table asks for a higher degree than the field has.
        """
        source = np.zeros(1, GRAVITY_TABLE)
        source.flags.writeable = False
        _fill(source, gravity_field)
        _fill(self.forces, forces)
        loaded = _make_field(source, self.forces, self.field)
        low = np.zeros(1, FORCE_TABLE)
        low[:] = self.forces
        low["degree"] = low["order"] = min(_DEGREE_AHEAD, int(self.forces["order"][0]))
        low["gradient_degree"] = 2
        low.flags.writeable = False
        loaded = _make_field(source, low, self.field_ahead) and loaded
        if not loaded:
            asked, given = int(self.forces["degree"][0]), int(source["degree"][0])
            raise ValueError(f"forces of degree {asked} on a gravity field of degree {given}")

    def predict(self, counter_now_ns: int, steps: int = WHOLE) -> None:
        """At most so many steps of a prediction of the flag from here, into `ahead`."""
        look_ahead(
            self.nav,
            self.table,
            self.orientation,
            self.forces,
            self.field_ahead,
            self.work,
            self.scratch,
            self.ahead,
            counter_now_ns,
            steps,
        )

    def protect(self, bound_m: float, t_gps_ns: int) -> np.ndarray:
        """Levels (2, 3) [m] of the bound published for this stamp, GCRF and RTN; the next call overwrites them."""
        axis_levels(self.nav, self.table, self.work, bound_m, t_gps_ns, self.levels)
        return self.levels

    def share_tables(self, other: Memory) -> None:
        """Fly the tables of another memory: its images, not copies of them."""
        self.table, self.orientation = other.table, other.orientation
        self.forces, self.field, self.field_ahead = other.forces, other.field, other.field_ahead


def _make_field(source: np.ndarray, forces: np.ndarray, field: np.ndarray) -> bool:
    field.flags.writeable = True
    loaded = load_field(source, forces, field)
    field.flags.writeable = False
    return bool(loaded)


def _fill(image: np.ndarray, payload: np.ndarray) -> None:
    image.flags.writeable = True
    for name in payload.dtype.names or ():
        image[name] = payload[name]
    image.flags.writeable = False
