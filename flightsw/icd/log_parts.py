"""Names of the parts of a log that is limited in size: can.000001.log, can.000002.log, ..., and can.log, the newest.

Parts are numbered from 1 and never renumbered, so a missing first part says that the beginning was dropped. Each ends
with a whole entry; one after the other they are the log.
"""

from __future__ import annotations

import re
from pathlib import Path

_DIGITS = 6


def part_path(path: Path, number: int) -> Path:
    """Where the part of this number of a log lies. path: the log itself, the newest part."""
    return path.with_name(f"{path.stem}.{number:0{_DIGITS}d}{path.suffix}")


def closed_parts(path: Path) -> list[tuple[int, Path]]:
    """Number and path of the parts before the newest, oldest first; none where the log was never divided."""
    pattern = re.compile(rf"{re.escape(path.stem)}\.(\d{{{_DIGITS},}}){re.escape(path.suffix)}")
    found = ((pattern.fullmatch(entry.name), entry) for entry in path.parent.glob(f"{path.stem}.*{path.suffix}"))
    return sorted((int(match[1]), entry) for match, entry in found if match is not None)


def all_parts(path: Path) -> list[Path]:
    """Every part in order, the newest last."""
    return [*(part for _, part in closed_parts(path)), path]


def lacks_beginning(path: Path) -> bool:
    """Whether the oldest part was dropped to keep the limit."""
    closed = closed_parts(path)
    return bool(closed) and closed[0][0] != 1
