"""What every section of a scenario is made of."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct


def range_meta(low: float, high: float, why: str) -> Meta:
    """Limits of a number, and what it is."""
    return Meta(ge=low, le=high, description=why)


StartAge = Annotated[float, range_meta(0.0, 1e7, "seconds after the scenario's start")]
Probability = Annotated[float, range_meta(0.0, 1.0, "probability, 0 to 1")]


class Section(Struct, forbid_unknown_fields=True, frozen=True):
    """Base of every table of a scenario."""
