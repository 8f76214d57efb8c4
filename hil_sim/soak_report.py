"""The account of a soak: a mark after every lap, what must hold between them, and all of it as text.

Marks are written into arrays made before the first tick: an account that grows would be what it looks for.
"""

from __future__ import annotations

import ctypes
import gc
import hashlib
import os
import resource
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from flightsw.main_loop import MainLoop

SPARE_BLOCKS = 64  # of memory that flying may leave behind in a whole soak, its first lap left out
SPARE_BYTES = 16 << 20  # of the resident set
_M_MMAP_THRESHOLD, _LARGE_BYTES = -3, 1 << 20  # malloc.h
_DIGEST_BYTES = 32
_MARK = np.dtype(
    [
        ("ticks", "i8"),
        ("wall_s", "f8"),
        ("flown_s", "f8"),
        ("blocks", "i8"),
        ("grown", "i8"),
        ("rss_bytes", "i8"),
        ("collected", "i8", (3,)),
        ("unreachable", "i8"),
        ("slips", "i8"),
        ("dropped", "i8"),
        ("frames", "i8"),
        ("published", "i8"),
        ("messages", "i8"),
        ("bad", "i8"),
        ("unheard", "i8"),
        ("violations", "i8"),
        ("flagged", "i8"),
        ("error_m", "f8"),
    ]
)


class Account:
    """Marks of the laps flown so far. `enter` after a lap what it was, `mark` when nothing of it is held any more."""

    def __init__(self, scenario: str, ticks: int, laps: int, period_ns: int) -> None:
        self.scenario, self.wanted, self.period_ns = scenario, ticks, period_ns
        self._rows = np.zeros(laps + 2, _MARK)  # a slow counter may need a few ticks of one lap more
        self._digests = bytearray(_DIGEST_BYTES * len(self._rows))
        self.marks = 0
        self.flown_s = 0.0
        self.beginning = ""
        self._own_passes, self._unreachable = 0, 0
        self._began_s = time.perf_counter()
        self._collected = _collected()
        self._trim = _trimming()
        self._page = os.sysconf("SC_PAGE_SIZE")
        self._bar = sys.stderr.isatty()

    def began(self, loop: MainLoop) -> None:
        """The first tick comes next."""
        del loop
        gc.collect()
        self._began_s = time.perf_counter()
        self._collected = _collected()

    def blocks(self) -> int:
        """Blocks of memory that are held. The interpreter's stores of freed floats and tuples are emptied before."""
        self._unreachable += gc.collect()
        self._own_passes += 1
        return sys.getallocatedblocks()

    def enter(self, digest: bytes, **values: float) -> None:
        """What a lap was."""
        row = self._rows[self.marks]
        for name, value in values.items():
            row[name] = value
        at = self.marks * _DIGEST_BYTES
        self._digests[at : at + _DIGEST_BYTES] = digest

    def mark(self, loop: MainLoop) -> None:
        """Memory and the rest, between two laps."""
        row = self._rows[self.marks]
        row["ticks"], row["slips"], row["dropped"] = loop.tick, loop.slips, loop.journal.dropped
        row["wall_s"], row["flown_s"] = time.perf_counter() - self._began_s, self.flown_s
        row["blocks"], row["unreachable"] = self.blocks(), self._unreachable
        row["rss_bytes"] = self._resident()
        for generation, (now, then) in enumerate(zip(_collected(), self._collected, strict=True)):
            row["collected"][generation] = now - then - (self._own_passes if generation == 2 else 0)
        self.marks += 1
        if not self._bar:
            speed = float(row["ticks"]) * self.period_ns * 1e-9 / max(self.flown_s, 1e-9)
            print(
                f"soak: {int(row['ticks']):,} of {self.wanted:,} ticks, {speed:.0f} times real time, "
                f"{int(row['blocks']):,} blocks, {int(row['rss_bytes']) >> 20} MiB, "
                f"{int(row['violations'])} violations",
                file=sys.stderr,
                flush=True,
            )

    def tell(self, tick: int, lap_began_s: float, lap_first_tick: int) -> None:
        """A line of progress on a terminal."""
        if not self._bar or not tick:
            return
        speed = (tick - lap_first_tick) / max(time.perf_counter() - lap_began_s, 1e-9)
        left_s = (self.wanted - tick) / speed if speed > 0.0 else 0.0
        done = tick / self.wanted
        blocks = "#" * round(30 * done)
        sys.stderr.write(f"\r[{blocks:<30}] {100 * done:5.1f} %  {speed:6.0f} ticks/s  {left_s / 60.0:6.1f} min left ")
        if tick >= self.wanted - 1:
            sys.stderr.write("\n")
        sys.stderr.flush()

    def _resident(self) -> int:
        self._trim(0)
        try:
            with open("/proc/self/statm", encoding="ascii") as statm:
                return int(statm.read().split()[1]) * self._page
        except OSError:  # no such account there: the largest it ever was
            return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024

    def found(self, loop: MainLoop) -> dict[str, Any]:
        """All marks as plain numbers, and the accounts of the loop's members."""
        rows = self._rows[: self.marks]
        laps = []
        for i, row in enumerate(rows):
            at = i * _DIGEST_BYTES
            values = {name: row[name].tolist() for name in _MARK.names or ()}
            laps.append({**values, "digest": self._digests[at : at + _DIGEST_BYTES].hex()})
        return {
            "scenario": self.scenario,
            "ticks_wanted": self.wanted,
            "ticks": int(loop.tick),
            "simulated_s": loop.tick * self.period_ns * 1e-9,
            "wall_s": time.perf_counter() - self._began_s,
            "flown_s": self.flown_s,
            "slips": loop.slips,
            "alerts": loop.events.sequence,
            "digest": hashlib.sha256(bytes(self._digests[: self.marks * _DIGEST_BYTES])).hexdigest(),
            "laps": laps,
            "members": loop.schedule.summary(),
        }


def failures(found: dict[str, Any]) -> list[str]:
    """What must hold and does not, in words; what was flown in full laps is judged, however many they are."""
    laps = found["laps"]
    said = []
    if found["slips"]:
        said.append(f"{found['slips']} slips in lockstep")
    if len(laps) > 1:
        first, last = laps[0], laps[-1]
        if (grown := sum(lap["grown"] for lap in laps[1:])) > SPARE_BLOCKS:
            said.append(f"{grown:,} more blocks of memory held by what flew after the first lap")
        if unreachable := last["unreachable"] - first["unreachable"]:
            said.append(f"{unreachable:,} objects in cycles, which only the collector frees")
        if last["rss_bytes"] - first["rss_bytes"] > SPARE_BYTES:
            said.append(f"{(last['rss_bytes'] - first['rss_bytes']) >> 20} MiB more resident than after the first lap")
        if last["collected"][2] - first["collected"][2]:
            said.append(f"{last['collected'][2] - first['collected'][2]} generation-2 passes of the collector")
    for name, what in (
        ("dropped", "entries of the journal dropped"),
        ("bad", "published frames that are not intact"),
        ("unheard", "ticks of which nothing was heard"),
        ("violations", "epochs with a bound below the error and no flag"),
    ):
        total = laps[-1][name] if laps and name == "dropped" else sum(lap[name] for lap in laps)
        if total:
            said.append(f"{total:,} {what}")
    again = found.get("beginning_again")
    if again is not None and not again["same"]:
        said.append("the beginning, flown again, gave other telemetry")
    expected = found.get("expected")
    if expected is not None and expected["different"]:
        said.append(f"lap {expected['different'][0]} gave other telemetry than expected")
    return said


def compare(found: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """Digests of the laps that both soaks have in full."""
    pairs = [
        (i, mine["digest"] == theirs["digest"])
        for i, (mine, theirs) in enumerate(zip(found["laps"], other["laps"], strict=False))
        if mine["ticks"] == theirs["ticks"]
    ]
    return {"laps": len(pairs), "different": [i for i, same in pairs if not same]}


def render(found: dict[str, Any]) -> str:
    """Markdown of a soak."""
    laps, ticks = found["laps"], found["ticks"]
    whole = found["members"]["tick"]
    speed = found["simulated_s"] / max(found["flown_s"], 1e-9)
    lines = [f"# Soak: {found['scenario']}, {ticks:,} of {found['ticks_wanted']:,} ticks", ""]
    if found.get("stopped_by_hand"):
        lines += ["STOPPED BY HAND: what follows holds for the laps that were flown to their end, and no others.", ""]
    failed = found.get("failures", [])
    lines += [
        f"FAILED: {'; '.join(failed)}." if failed else "Flat, no slips, the bound held, digests as they should be."
    ]
    if ticks and whole["runs"]:
        lines += [
            "",
            f"- {found['simulated_s']:,.0f} s simulated, {speed:,.0f} times real time while flying, "
            f"{found['wall_s']:,.0f} s in all (with the wait for laps)",
            f"- a tick: p50 {whole['p50_us']:,.0f}, p99 {whole['p99_us']:,.0f}, p99.9 {whole['p99.9_us']:,.0f}, "
            f"max {whole['max_us']:,.0f} us",
            f"- {found['slips']} slips, {found['alerts']:,} alerts",
        ]
    if laps:
        first, last = laps[0], laps[-1]
        passes = [b - a for a, b in zip(first["collected"], last["collected"], strict=True)]
        after = last["ticks"] - first["ticks"]
        lines += [
            f"- after the first lap, in {after:,} ticks: {sum(lap['grown'] for lap in laps[1:]):+,} blocks of memory, "
            f"{(last['rss_bytes'] - first['rss_bytes']) / 2**20:+.1f} MiB resident, collector passes "
            f"{passes[0]}/{passes[1]}/{passes[2]} by generation",
            f"- {sum(lap['frames'] for lap in laps):,} frames received, "
            f"{sum(lap['published'] for lap in laps):,} published, "
            f"{sum(lap['messages'] for lap in laps):,} MAVLink messages, {last['dropped']} entries dropped",
            f"- largest error without a flag {max(lap['error_m'] for lap in laps):,.1f} m; "
            f"{sum(lap['violations'] for lap in laps):,} violations; "
            f"{sum(lap['flagged'] for lap in laps):,} ticks with a flag",
            f"- digest of {len(laps):,} laps: {found['digest']}",
        ]
    if again := found.get("beginning_again"):
        word = "the same" if again["same"] else "OTHER"
        lines.append(f"- its first {again['ticks']:,} ticks flown again in this process: {word} telemetry")
    if expected := found.get("expected"):
        lines.append(f"- {expected['laps']:,} laps compared with another soak, {len(expected['different'])} differ")
    if rejected := found.get("rejected_by_cause"):
        lines.append("- rejected: " + ", ".join(f"{name} {count:,}" for name, count in rejected.items()))
    if laps:
        lines += [
            "",
            "| lap | ticks | grown | blocks | MiB | passes | violations | digest |",
            "|---|---|---|---|---|---|---|---|",
        ]
        shown = sorted({0, 1, 2, len(laps) // 4, len(laps) // 2, 3 * len(laps) // 4, len(laps) - 2, len(laps) - 1})
        for i in shown:
            if 0 <= i < len(laps):
                lap = laps[i]
                passes_text = "/".join(str(count) for count in lap["collected"])
                lines.append(
                    f"| {i} | {lap['ticks']:,} | {lap['grown']:+} | {lap['blocks']:,} | {lap['rss_bytes'] / 2**20:.1f} "
                    f"| {passes_text} | {lap['violations']} | {lap['digest'][:16]} |"
                )
    return "\n".join(lines) + "\n"


def keep_large_blocks_apart() -> None:
    """Laps come and go by tens of megabytes: let the allocator map each by itself, so that its pages go with it.

    Left alone it takes them from the heap once it has freed one, and the holes between them look like growth.
    """
    with suppress(OSError, AttributeError):  # not glibc
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)


def _trimming() -> Callable[[int], int]:
    """glibc's malloc_trim, which returns free pages: what is resident then is what is held. Looked up once: to look it
    up leaves cycles behind."""
    try:
        found: Callable[[int], int] = ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError):  # not glibc
        return lambda kept: kept
    return found


def _collected() -> list[int]:
    return [int(generation["collections"]) for generation in gc.get_stats()]
