"""What the inter-satellite monitor did in a run, in sentences for the verdict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

MAX_FAULTS_SHOWN = 4


def crosslink_story(links: Any) -> Iterator[str]:
    """Sentences for the `crosslinks` of a summary; none for a run without."""
    if not isinstance(links, Mapping):
        return
    own, faults = links.get("own"), links.get("faults") or []
    for fault in faults[:MAX_FAULTS_SHOWN]:
        yield _fault(fault, own)
    if len(faults) > MAX_FAULTS_SHOWN:
        yield f"{len(faults) - MAX_FAULTS_SHOWN} more wrong messages: see summary.json."
    for one in links.get("real_day") or []:
        yield (
            f"Flight excluded satellite {one.get('satellite')} at {one.get('named_s', 0.0):.0f} s; "
            f"what it really broadcast was wrong by {one.get('error_m', 0.0):.1f} m."
        )
    vain = links.get("named_in_vain") or []
    if "real_day" in links:
        yield f"Crosslinks: flight judged {links.get('epochs', 0):,} epochs of real messages as satellite {own}."
        return
    named = f"named {_satellites(vain)} without reason" if vain else "named nobody without reason"
    yield f"Crosslinks: flight judged {links.get('epochs', 0):,} epochs as satellite {own} and {named}."


def _fault(fault: Mapping[str, Any], own: Any) -> str:
    numbers = fault.get("satellites") or []
    parts = []
    if fault.get("jump_m"):
        parts.append(f"wrong by {fault['jump_m']:.3g} m")
    if fault.get("ramp_mps"):
        parts.append(f"ever more wrong by {fault['ramp_mps']:.3g} m/s")
    who = _satellites(numbers) + (", the flown one," if numbers == [own] else "")
    text = f"What {who} broadcast was {' and '.join(parts)} from {fault.get('start_s', 0.0):.0f} s"
    named_s, size_m = fault.get("named_s"), fault.get("size_when_named_m")
    if named_s is None:
        return f"{text}; flight NEVER found it."
    text += f"; flight named {'it' if len(numbers) == 1 else 'them'} {named_s:.1f} s later"
    if fault.get("ramp_mps") and size_m is not None:
        text += f", at {size_m:.1f} m"
    again_s = fault.get("taken_in_again_s")
    return f"{text}." if again_s is None else f"{text}, and took it in again {again_s:.0f} s after it was right."


def _satellites(numbers: list[int]) -> str:
    return f"satellite{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"
