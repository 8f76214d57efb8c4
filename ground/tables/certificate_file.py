"""certificate.json, as certification writes it, to the record that travels with a table.

Names are those of the record (flightsw/icd/certificate.py) or those of `ground certify`; the envelope may stand in a
section of its own, counts in `summary.pooled`. A pair `altitude_km = [low, high]` serves for `altitude_min_km` and
`altitude_max_km`; hashes are 64 hexadecimal digits; the CRC-32 of the table is a number or 8 such digits. What a
certificate holds besides is left to its readers.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from flightsw.icd.certificate import CERTIFICATE, LIMITS, hash_words
from flightsw.icd.enums import Certificate
from flightsw.icd.table_schema import Field
from ground.errors import OperatorError

# other names under which a field may be found, and sections in which one may stand
_ALSO = {
    "table_crc32": ("table_crc", "crc32", "table"),
    "ensemble_sha256": ("ensemble_hash", "ensemble"),
    "violations": ("violated",),
    "clopper_pearson_upper": (
        "upper_limit_95",
        "clopper_pearson_95_upper",
        "cp_upper",
        "cp95_upper",
        "clopper_pearson",
    ),
    "altitude_max_km": ("apogee_altitude_km",),
    "certified_age_s": ("age_max_s", "age_s"),
    "fix_sigma_max_m": ("sigma_fix_max_m",),
    "convergence_s": ("fixes_before_s",),
    "burns": ("announced_burns", "announced_burns_mps"),
    "limits_m": ("limit_m", "limits", "eps_m"),
}
# field -> names of a [low, high] that hold it, and which of the two
_PAIRS = {
    "altitude_min_km": (("altitude_km", "perigee_altitude_km"), 0),
    "altitude_max_km": (("altitude_km", "apogee_altitude_km"), 1),
    "f107_min": (("f107", "f107_sfu"), 0),
    "f107_max": (("f107", "f107_sfu"), 1),
    "fix_sigma_min_m": (("sigma_position_m",), 0),
    "fix_sigma_max_m": (("sigma_position_m",), 1),
    "velocity_sigma_min_mps": (("velocity_sigma_mps", "sigma_velocity_mps"), 0),
    "velocity_sigma_max_mps": (("velocity_sigma_mps", "sigma_velocity_mps"), 1),
}
_FILLED_IN = ("stimulus_sha256", "issued_gps_ns")
_OPTIONAL = {"attempt": 1, "limits_m": (), "positions_alone": 0}
_MISSING = object()


def read_certificate(path: Path) -> np.ndarray:
    """The record (1,) of a certificate.json, without stimulus and time of issue.

    Raises OperatorError naming file and key.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise OperatorError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise OperatorError(f"{path}: not JSON: {error}") from error
    if not isinstance(document, dict):
        raise OperatorError(f"{path}: holds no certificate; `ground certify` writes one")
    if document.get("certified") is False and str(document.get("grade")).lower() == "full":
        lacking = ", ".join(str(one) for one in document.get("unproven") or document.get("missed") or ["its targets"])
        raise OperatorError(f"{path}: certification missed {lacking}; a table that missed is not signed: tune it anew")
    values = np.zeros(1, CERTIFICATE.dtype)
    for field in CERTIFICATE.fields:
        if field.name in _FILLED_IN:
            continue
        found = _find(document, field.name)
        if found is _MISSING:
            found = _OPTIONAL.get(field.name, _MISSING)
        if found is _MISSING:
            raise OperatorError(f"{path}: {field.name}: missing; certify again ({field.why})")
        values[field.name][0] = _convert(f"{path}: {field.name}", field, found)
    return values


def _find(document: dict[str, Any], name: str) -> Any:
    names = (name, *_ALSO.get(name, ()))
    summary = document.get("summary")
    pooled = summary.get("pooled") if isinstance(summary, dict) else None
    places = [place for place in (document, document.get("envelope"), pooled) if isinstance(place, dict)]
    for place in places:
        for one in names:
            pair_instead = name in _PAIRS and isinstance(place.get(one), list)
            if one in place and not isinstance(place[one], dict) and not pair_instead:
                return place[one]
        if name in _PAIRS:
            pairs, index = _PAIRS[name]
            for pair in pairs:
                if isinstance(place.get(pair), list) and len(place[pair]) == 2:
                    return place[pair][index]
    return _MISSING


def _convert(where: str, field: Field, value: Any) -> Any:
    if field.name == "grade" and isinstance(value, str):
        try:
            return int(Certificate[value.upper()])
        except KeyError:
            raise OperatorError(f'{where}: "{value}" is none of uncertified, quick, full') from None
    if field.name.endswith("_sha256"):
        text = str(value).lower().removeprefix("sha256:")
        if not re.fullmatch("[0-9a-f]{64}", text):
            raise OperatorError(f"{where}: {value!r} is no SHA-256 of 64 hexadecimal digits")
        return hash_words(bytes.fromhex(text))
    if field.name == "table_crc32" and isinstance(value, str):
        if not re.fullmatch("(0x)?[0-9a-fA-F]{1,8}", value):
            raise OperatorError(f"{where}: {value!r} is no CRC-32 of 8 hexadecimal digits")
        return int(value, 16)
    if field.name == "limits_m":
        limits = list(value) if isinstance(value, (list, tuple)) else [value]
        if len(limits) > LIMITS or not all(_is_number(one) for one in limits):
            raise OperatorError(f"{where}: {value!r}: give up to {LIMITS} numbers [m]")
        return [float(one) for one in limits] + [0.0] * (LIMITS - len(limits))
    if field.name in ("burns", "positions_alone") and isinstance(value, bool):
        return int(value)
    if field.name == "burns" and isinstance(value, list) and all(_is_number(one) for one in value):
        return int(any(one > 0.0 for one in value))
    if not _is_number(value) or (field.kind == "i8" and value != int(value)):
        raise OperatorError(f"{where}: {value!r} is no {'whole ' if field.kind == 'i8' else ''}number [{field.unit}]")
    return int(value) if field.kind == "i8" else float(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e300
