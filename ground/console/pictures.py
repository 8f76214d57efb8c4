"""Pictures of the console for the operator's guide, as SVG: a run's log replayed, pages turned to, the screen kept.

    python -m ground.console.pictures RUN_DIR/link.tlog docs/images

The log is that of the scenario burn_in_outage: the moments below are its own.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
from pathlib import Path
from typing import NamedTuple

from ground.console.tlog import TlogLink
from ground.console.view import ConsoleApp

SIZE = (100, 30)
_NEVER_S = 1e6


class Shot(NamedTuple):
    """One picture: its name, seconds into the log, keys pressed before it is taken."""

    name: str
    at_s: float
    keys: tuple[str, ...] = ()


SHOTS = (
    Shot("console_fixes", 5600.0, ("1",)),
    Shot("console_coasting", 6500.0, ("1",)),
    Shot("console_flag", 7200.0, ("1",)),
    Shot("console_alarms", 7200.0, ("2",)),
    Shot("console_filter", 7725.0, ("3",)),
    Shot("console_events", 7900.0, ("7", "f")),
    Shot("console_recovered", 7900.0, ("1",)),
)


def take(log: Path, folder: Path, shots: tuple[Shot, ...] = SHOTS) -> list[Path]:
    """Make the pictures, in order of their times, and return where they lie. OperatorError for a log that is none."""
    now_s = [0.0]
    link = TlogLink(log, 1.0, lambda: now_s[0])
    app = ConsoleApp(link, _NEVER_S)
    made: list[Path] = []

    async def session() -> None:
        async with app.run_test(size=SIZE) as pilot:
            for shot in shots:
                goal_s = min(link.start_s + shot.at_s, link.stop_s)
                link.seek(goal_s - link.now_s())
                while link.seeking:
                    app.step()
                app.step()
                await pilot.press(*shot.keys)
                app.redraw()
                await pilot.pause()
                made.append(folder / f"{shot.name}.svg")
                made[-1].write_text(app.export_screenshot(title=f"ground console, {shot.name[8:]}"), encoding="utf-8")

    asyncio.run(session())
    return made


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Make the pictures of the operator's guide.")
    parser.add_argument("log", type=Path, metavar="LINK_TLOG")
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    options = parser.parse_args()
    for path in take(options.log, options.folder):
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
