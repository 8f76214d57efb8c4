"""Tables of the functions beside navigation: defaults of their schemas, and settings on top."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from flightsw.icd.table_checks import problems
from flightsw.icd.table_file import TableRefused, encode
from flightsw.icd.table_schema import SCHEMAS
from ground.errors import OperatorError, did_you_mean

KINDS = ("velocity_check",)


def build_function(kind: str, overrides: Mapping[str, Any] | None = None) -> bytes:
    """Binary table of a function with the fields given and the defaults of all others; OperatorError for mistakes."""
    if kind not in KINDS:
        raise OperatorError(f'no function "{kind}"{did_you_mean(kind, KINDS)}; there are: {", ".join(KINDS)}')
    schema = SCHEMAS[kind]
    values = np.zeros(1, schema.dtype)
    for field in schema.fields:
        values[field.name] = field.default
    for name, value in (overrides or {}).items():
        names = [field.name for field in schema.fields]
        if name not in names:
            raise OperatorError(f'{kind}: no field "{name}"{did_you_mean(name, names)}; fields: {", ".join(names)}')
        try:
            values[name] = value
        except (TypeError, ValueError):
            raise OperatorError(f"{kind}: {name} = {value!r} is no number") from None
    if found := problems(kind, values):
        raise OperatorError(f"{kind}: {'; also '.join(found)}")
    try:
        return encode(kind, kind + ("*" if overrides else ""), values)
    except TableRefused as error:
        raise OperatorError(f"{kind}: {error}") from error
