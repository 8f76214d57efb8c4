"""Certificates for the tests: a record with every field filled in, and tables that carry it."""

from __future__ import annotations

from typing import Any

import numpy as np

from flightsw.icd.certificate import CERTIFICATE, attach, content_crc32
from flightsw.icd.table_file import TableImage, decode

KEY = b"a key of the tests, no other one"
STIMULUS = b"not looked into here"


def record(table: TableImage, **changes: Any) -> np.ndarray:
    """A certificate (1,) of grade FULL for this table, with some fields changed."""
    values = np.zeros(1, CERTIFICATE.dtype)
    fields: dict[str, Any] = {
        "grade": 2,
        "table_crc32": content_crc32(table),
        "issued_gps_ns": 1_400_000_000 * 10**9,
        "attempt": 1,
        "ensemble_sha256": (1, -2, 3, -4),
        "outages": 12_000,
        "violations": 9,
        "clopper_pearson_upper": 0.0014,
        "altitude_min_km": 350.0,
        "altitude_max_km": 1400.0,
        "certified_age_s": 86_400.0,
        "f107_min": 65.0,
        "f107_max": 250.0,
        "fix_sigma_min_m": 0.5,
        "fix_sigma_max_m": 10.0,
        "velocity_sigma_min_mps": 0.001,
        "velocity_sigma_max_mps": 0.2,
        "positions_alone": 1,
        "convergence_s": 600.0,
        "burns": 1,
        "limits_m": (50.0, 2000.0, 0.0, 0.0),
        **changes,
    }
    for name, value in fields.items():
        values[name] = value
    return values


def certified(image: bytes, key: bytes | None = KEY, stimulus: bytes = STIMULUS, **changes: Any) -> bytes:
    """The table of an image, certified and signed."""
    table = decode(image)
    return attach(table, record(table, **changes), stimulus, key)
