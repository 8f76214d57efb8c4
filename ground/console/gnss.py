"""What flight says of its epochs of pseudoranges: the message as a value, a page of it, a few words for a line."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from rich.text import Text

from flightsw.icd.enums import Constellation, GnssVerdict
from ground.console.text import metres, seconds

_LETTERS = "GREC"  # RINEX: GPS, GLONASS, Galileo, BeiDou
_AXES = ("east", "north", "up")
_MEANING = {
    GnssVerdict.CONSISTENT: "all satellites agree",
    GnssVerdict.EXCLUDED: "they agree without those left out",
    GnssVerdict.AMBIGUOUS: "another set explains it nearly as well: no fix",
    GnssVerdict.UNTESTED: "as many unknowns as satellites: nothing can contradict",
    GnssVerdict.INCONSISTENT: "they contradict each other, and leaving some out does not help: no fix",
    GnssVerdict.TOO_FEW: "too few satellites for a fix",
    GnssVerdict.NO_SOLUTION: "no place fits the ranges",
    GnssVerdict.TOO_MANY: "more satellites than an epoch can hold",
    GnssVerdict.NO_EPOCH: "no epoch has been judged yet",
}


class GnssCheck(NamedTuple):
    """LEONAV_GNSS_CHECK as received; masks by constellation: bit i is satellite i + 1."""

    t_gps_ns: int
    used: tuple[int, ...]
    excluded: tuple[int, ...]
    age_s: float
    statistic: float
    threshold: float
    protection_m: tuple[float, ...]
    limit_m: tuple[float, ...]
    sigma_m: tuple[float, ...]
    epochs: int
    offered_count: int
    verdict: int
    refused: int
    dof: int
    available: int
    offered: int


def of_message(message: Any) -> GnssCheck:
    """The message as a value."""
    values: dict[str, Any] = {name: getattr(message, name) for name in GnssCheck._fields}
    for name in ("used", "excluded", "protection_m", "limit_m", "sigma_m"):
        values[name] = tuple(values[name])
    return GnssCheck(**values)


def verdict_word(verdict: int) -> str:
    """Name of a verdict; numbers this console does not know stay visible."""
    return GnssVerdict(verdict).name if verdict in GnssVerdict._value2member_map_ else f"VERDICT_{verdict}"


def names(masks: tuple[int, ...]) -> str:
    """Satellites of masks by constellation: 'G01 G17 R24', or 'none'."""
    found = [
        f"{letter}{number + 1:02}"
        for letter, mask in zip(_LETTERS, masks, strict=False)
        for number in range(64)
        if mask >> number & 1
    ]
    return " ".join(found) or "none"


def words(check: GnssCheck) -> str:
    """For the one line of plain mode."""
    out = f" without {names(check.excluded)}" if any(check.excluded) else ""
    return f"gnss {verdict_word(check.verdict)} {sum(mask.bit_count() for mask in check.used)} used{out}"


def page(check: GnssCheck | None, stale: str) -> Text:
    """The page; stale: a mark for what was not renewed, or nothing."""
    if check is None:
        return Text("this flight has said nothing of pseudoranges: no table of kind gnss flies", style="dim")
    text = Text()
    good = check.verdict in (GnssVerdict.CONSISTENT, GnssVerdict.EXCLUDED)
    text.append(f"verdict      {verdict_word(check.verdict)}", style="bold" if good else "bold yellow")
    meaning = next(
        (what for verdict, what in _MEANING.items() if verdict == check.verdict), "console older than flight?"
    )
    text.append(f": {meaning}{stale}\n")
    if check.verdict != GnssVerdict.NO_EPOCH:
        text.append(f"epoch        {seconds(check.age_s)} old when told\n")
    text.append(f"fix          {'handed to navigation' if check.offered else 'none handed to navigation'}")
    text.append(f"; {check.offered_count:,} of {check.epochs:,} epochs since start gave one\n")
    text.append(f"statistic    {_number(check.statistic)} of at most {_number(check.threshold)}")
    text.append(f", {check.dof} degrees of freedom\n")
    text.append(f"left out     {names(check.excluded)}", style="bold yellow" if any(check.excluded) else "")
    text.append(f"; before the test {check.refused}\n")
    for system, mask in zip(Constellation, check.used, strict=False):
        text.append(f"{system.name.lower():<13}{mask.bit_count():>2} used: {names(_alone(system, mask))}\n")
    text.append(f"\n{'':<13}{'level':>10}{'limit':>10}{'1-sigma':>10}\n", style="bold")
    for axis, level, limit, sigma in zip(_AXES, check.protection_m, check.limit_m, check.sigma_m, strict=False):
        beyond = not level <= limit
        text.append(f"{axis:<13}{_level(level):>10}{metres(limit):>10}{metres(sigma):>10}")
        text.append("  BEYOND\n" if beyond else "\n", style="bold yellow")
    return text


def _alone(system: Constellation, mask: int) -> tuple[int, ...]:
    return tuple(mask if index == system else 0 for index in range(len(_LETTERS)))


def _level(value: float) -> str:
    return "none" if not math.isfinite(value) else metres(value)


def _number(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "none"
