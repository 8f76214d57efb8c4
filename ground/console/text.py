"""Words for the terminal. Whatever came over the link passes `safe` before it is shown."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

GPS_EPOCH = datetime(1980, 1, 6)
MAX_LINK_TEXT = 120


def safe(text: object, limit: int = MAX_LINK_TEXT) -> str:
    """Text from the link with every control, format or unprintable character spelled out, cut to `limit`.

    Escape sequences could otherwise repaint the verdict, and bidirectional marks reorder it.
    """
    raw = text.decode("utf-8", "backslashreplace") if isinstance(text, bytes | bytearray) else str(text)
    raw = raw.rstrip("\x00")[: 4 * limit]
    spelled = "".join(c if c.isprintable() and not _combining(c) else _spell(c) for c in raw)
    return spelled if len(spelled) <= limit else spelled[: limit - 1] + "…"


def _combining(character: str) -> bool:
    return unicodedata.category(character).startswith("M")


def _spell(character: str) -> str:
    code = ord(character)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def metres(value: float | None) -> str:
    """`2.41 m`, `812 m`, `12.3 km`; `unknown` for what is not a number."""
    if value is None or math.isnan(value):
        return "unknown"
    if math.isinf(value):
        return "unlimited"
    if abs(value) >= 1e8:
        return f"{value:.2e} m"
    if abs(value) >= 9999.5:
        return f"{value / 1e3:.1f} km"
    return f"{value:.0f} m" if abs(value) >= 99.95 else f"{value:.1f} m" if abs(value) >= 9.995 else f"{value:.2f} m"


def metres_each(values: Sequence[float]) -> str:
    """`2.41  1.10  0.93 m`: several lengths in one unit, that of the largest."""
    known = [abs(value) for value in values if math.isfinite(value)]
    unit, scale = ("km", 1e3) if known and max(known) >= 9999.5 else ("m", 1.0)
    return f"{'  '.join(_short(value / scale) for value in values)} {unit}"


def _short(value: float) -> str:
    if math.isnan(value):
        return "?"
    if math.isinf(value) or abs(value) >= 1e6:
        return "inf" if math.isinf(value) else f"{value:.1e}"
    return f"{value:.0f}" if abs(value) >= 99.95 else f"{value:.1f}" if abs(value) >= 9.995 else f"{value:.2f}"


def seconds(value: float | None) -> str:
    """`0.4 s`, `213 s`, `2 h 05 min`; `never` for what is not a number (no fix yet, no flag)."""
    if value is None or not math.isfinite(value):
        return "never"
    if abs(value) < 99.95:
        return f"{value:.1f} s"
    if abs(value) < 5999.5:
        return f"{value:.0f} s"
    if abs(value) < 360000.0:
        return f"{value // 3600:.0f} h {value % 3600 // 60:02.0f} min"
    return f"{value / 86400.0:.3g} days"


def percent(share: float) -> str:
    """`137 %`, `19 %`, `0.1 %`: small shares are not rounded to nothing."""
    value = 100.0 * share
    return f"{value:.0f} %" if abs(value) >= 9.95 else f"{value:.2g} %"


def utc_clock(unix_s: float) -> str:
    """HH:MM:SS of the link's time (UTC)."""
    return _utc(unix_s, "%H:%M:%S")


def utc_stamp(unix_s: float) -> str:
    """Date and time of the link's time (UTC), for logs."""
    return _utc(unix_s, "%Y-%m-%dT%H:%M:%SZ")


def _utc(unix_s: float, pattern: str) -> str:
    try:
        return datetime.fromtimestamp(unix_s, UTC).strftime(pattern)
    except (ValueError, OverflowError, OSError):
        return "time?"


def gps_stamp(t_gps_ns: int) -> str:
    """Date and time on the GPS scale (no leap seconds), as flight counts it."""
    try:
        return (GPS_EPOCH + timedelta(microseconds=t_gps_ns // 1000)).strftime("%Y-%m-%d %H:%M:%S")
    except OverflowError:
        return "time?"
