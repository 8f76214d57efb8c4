"""The verdict an operator reads: flight's own word, refused wherever the evidence beside it disagrees.

The console never shows more trust than every received value supports: silence, a stale bound, a bound beyond
the limit, an unknown code or a contradiction each take TRUSTED away.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

from flightsw.icd.enums import Certificate, FlagState, Mode, Uncovered, Validity, Verdict
from ground.console.model import State, age_s
from ground.console.text import metres, percent, seconds
from ground.console.told import Integrity

LINK_TIMEOUT_S = 3.0  # three heartbeats missed
STALE_S = 3.0  # a value not renewed for this long is marked

CERTIFICATE_WORDS: dict[int, str] = {
    Certificate.UNCERTIFIED: "uncertified table",
    Certificate.QUICK: "table with quick certificate",
    Certificate.FULL: "certified table",
}


class Level(IntEnum):
    """How a verdict is coloured; the words alone already say it."""

    GOOD = 0
    CAUTION = 1
    BAD = 2
    UNKNOWN = 3


class Judgement(NamedTuple):
    """Verdict in words, what stands behind the table, and the reason in one sentence."""

    word: str
    certificate: str
    reason: str
    level: Level


def judge_link(state: State, now_s: float, link: object) -> Judgement:
    """The verdict at `now_s` on what came over a link, with what the link knows of signatures."""
    return judge(state, now_s, getattr(link, "forged_s", None), getattr(link, "unverified_s", None))


def judge(state: State, now_s: float, forged_s: float | None = None, unverified_s: float | None = None) -> Judgement:
    """The verdict at `now_s`.

    forged_s: when a message was heard last that could not be authenticated. unverified_s: when one was heard last that
    is signed, without a key here to verify it: what it says is shown, but calls nothing trusted.
    """
    silent_s = age_s(now_s, state.heard_s)
    if silent_s > LINK_TIMEOUT_S and forged_s is not None and now_s - forged_s <= LINK_TIMEOUT_S:
        reason = "messages arrive that are not signed with our key: nothing of them is believed"
        return Judgement("UNAUTHENTICATED", certificate_words(state), reason, Level.UNKNOWN)
    certificate = certificate_words(state)
    if silent_s > LINK_TIMEOUT_S:
        return Judgement("NO LINK", certificate, _silence(state, now_s), Level.UNKNOWN)
    integrity = state.integrity
    if integrity is None or age_s(now_s, state.integrity_s) > STALE_S:
        since = "yet" if integrity is None else f"for {seconds(age_s(now_s, state.integrity_s))}"
        reason = f"messages arrive, but no integrity {since}: nothing is known of the error"
        return Judgement("NO INTEGRITY DATA", certificate, reason, Level.UNKNOWN)
    word, reason, level = _weigh(integrity, _state_is_refused(state, now_s))
    if level != Level.BAD and unverified_s is not None and now_s - unverified_s <= LINK_TIMEOUT_S:
        reason = f"flight signs what it sends and no key is here to verify it (--key); unverified: {word}, {reason}"
        return Judgement("UNAUTHENTICATED", certificate, reason, Level.UNKNOWN)
    return Judgement(word, certificate, reason, level)


def certificate_words(state: State) -> str:
    """What stands behind the table in force; anything not known to be a certificate is none."""
    if state.integrity is None:
        return ""
    code = state.integrity.certificate
    if code in CERTIFICATE_WORDS:
        return CERTIFICATE_WORDS[code]
    return f"uncertified table (unknown code {code})"


def mode_word(mode: int) -> str:
    """Name of a mode; numbers this console does not know stay visible."""
    return Mode(mode).name if mode in Mode._value2member_map_ else f"MODE {mode}"


def _silence(state: State, now_s: float) -> str:
    if state.heard_s is None:
        return f"nothing heard from flight for {seconds(max(0.0, now_s - state.started_s))}; waiting"
    return f"silent for {seconds(age_s(now_s, state.heard_s))}; every value shown is that old or older"


def _state_is_refused(state: State, now_s: float) -> bool:
    """Flight itself published, just now, a state without its valid bit."""
    if state.nav is None or age_s(now_s, state.nav_s) > STALE_S:
        return False
    return not state.nav.validity & Validity.STATE_VALID


_NOT_COVERED: dict[int, str] = {
    Uncovered.HEIGHT: "at this height its certificate proves nothing",
    Uncovered.AGE: "the outage is older than its certificate proves",
    Uncovered.ACTIVITY: "the Sun is outside what its certificate covers",
    Uncovered.OVERRULED: "fixes overruled a trusted state, one of them is wrong: look, then reset the filter",
    Uncovered.CONVERGENCE: "too few fixes of the certified kind since the start, a burn or another kind of fix",
}


def _not_covered(cause: int) -> str:
    return _NOT_COVERED.get(cause, "outside what its certificate covers")


def _weigh(i: Integrity, state_refused: bool) -> tuple[str, str, Level]:
    bound, limit = i.driving_bound_m, i.limit_m
    against = f"bound {metres(bound)}, limit {metres(limit)}"
    if i.verdict == Verdict.NOT_READY:
        return "NOT READY", f"no state yet: {i.accepted_streak} fixes accepted in a row", Level.CAUTION
    if i.flag_state == FlagState.RAISED:
        if i.accepted_streak > 0 and i.outage_age_s == 0.0:
            reason = f"failure flag still up: {against}, {i.accepted_streak} fixes accepted in a row"
        else:
            reason = f"failure flag raised {seconds(i.flag_age_s)} after the last fix: {against}"
        return "DO NOT USE", reason, Level.BAD
    if i.flag_state == FlagState.STALE:
        return "DO NOT USE", "the bound cannot be computed (flag STALE)", Level.BAD
    if i.flag_state != FlagState.CLEAR or i.verdict not in Verdict._value2member_map_:
        reason = f"unknown code from flight (verdict {i.verdict}, flag {i.flag_state}): versions differ?"
        return "DO NOT USE", reason, Level.BAD
    if i.verdict == Verdict.DO_NOT_USE:
        return "DO NOT USE", f"flight says so in mode {mode_word(i.mode)}: {against}", Level.BAD
    if math.isnan(bound) or math.isnan(limit):
        return "DO NOT USE", f"flight says {Verdict(i.verdict).name}, but its bound is unknown", Level.BAD
    if not bound <= limit:
        return "DO NOT USE", f"{against}: beyond it, flag not up yet", Level.BAD
    if i.mode not in (Mode.INTEGRATED, Mode.AUTONOMOUS):
        reason = f"flight says {Verdict(i.verdict).name}, but its mode is {mode_word(i.mode)}"
        return "DO NOT USE", reason, Level.BAD
    if state_refused:
        why = ": outside what its certificate covers" if i.verdict == Verdict.NOT_CERTIFIED and i.certificate else ""
        return "DO NOT USE", f"flight publishes its state as not valid{why}", Level.BAD
    if i.verdict == Verdict.NOT_CERTIFIED:
        what = _not_covered(i.uncovered) if i.certificate else "no certificate stands behind the table"
        return "NOT CERTIFIED", f"{what}: {against}, fix {seconds(i.fix_age_s)} old", Level.CAUTION
    share = f"{percent(bound / limit)} of the limit" if limit > 0.0 and math.isfinite(limit) else against
    if i.verdict == Verdict.TRUSTED_COASTING or i.mode == Mode.AUTONOMOUS:
        reason = f"no fix accepted for {seconds(i.fix_age_s)}; bound {metres(bound)}, {share}"
        return "TRUSTED, COASTING", reason, Level.CAUTION
    reason = f"fix {seconds(i.fix_age_s)} old; bound {metres(bound)} within limit {metres(limit)}"
    return "TRUSTED", reason, Level.GOOD
