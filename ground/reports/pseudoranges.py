"""What the consistency test of pseudoranges did in a run, in sentences for the verdict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

MAX_FAULTS_SHOWN = 4


def fix_words(found: Any) -> str | None:
    """What fixes a run with pseudoranges had, in the place of their error, which only the world's own fixes have."""
    if not isinstance(found, Mapping):
        return None
    fixes, epochs = found.get("fixes", 0), found.get("epochs", 0)
    if not fixes:
        return f"no fix out of {epochs:,} epochs of pseudoranges"
    each = found.get("satellites")
    return f"{fixes:,} fixes made on board of {epochs:,} epochs of pseudoranges, {each} satellites each"


def pseudorange_story(found: Any) -> Iterator[str]:
    """Sentences for the `pseudoranges` of a summary; none for a run without."""
    if not isinstance(found, Mapping):
        return
    faults = found.get("faults") or []
    for fault in faults[:MAX_FAULTS_SHOWN]:
        yield _fault(fault)
    if len(faults) > MAX_FAULTS_SHOWN:
        yield f"{len(faults) - MAX_FAULTS_SHOWN} more faults of satellites: see summary.json."
    vain, epochs = found.get("in_vain", 0), found.get("epochs", 0)
    yield f"A satellite without such a fault was left out in {vain:,} of {epochs:,} epochs."


def _fault(fault: Mapping[str, Any]) -> str:
    names = fault.get("satellites") or []
    who = ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "") or "no satellite"
    text = f"{who}: {fault.get('kind', 'fault')} from {fault.get('start_s', 0.0):.0f} s"
    after_s, epochs = fault.get("named_after_s"), fault.get("epochs", 0)
    if not epochs:
        return f"{text}; no epoch was judged meanwhile."
    if after_s is None and fault.get("kind") == "lift":
        return f"{text}; all ranges agree, no test of one epoch can name them: the gate has to see it."
    if after_s is None:
        return f"{text}; NEVER named exactly in {epochs} epochs."
    return f"{text}; named exactly after {after_s:.0f} s, in {fault.get('named', 0)} of {epochs} epochs."
