"""What was timed, as text for the terminal and for docs/timing.md."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

LINK_SHARE = 0.15  # of the tick
MEMBER_COLUMNS = ("runs", "mean_us", "p50_us", "p99_us", "p99.9_us", "max_us", "budget_us", "over_budget")

_HEAD = """\
# What a tick, a kernel and a start cost

Written by `ground timing --doc docs/timing.md`; nothing here is typed by hand. Durations depend on the machine and on
what else it does (the load is said): what to hold on to are ratios within one run, counts, and medians. Tests assert
none of it but what a busy machine can promise (`tests/timing`).
"""


def render(found: dict[str, Any]) -> str:
    """Markdown of all parts that were measured."""
    machine = found["machine"]
    parts = [
        _HEAD,
        f"{machine['processor']}, {machine['processors']} processors, load {machine['load']:.2f} at the beginning; "
        f"Python {machine['python']}, numba {machine['numba']}, numpy {machine['numpy']}; {machine['day']}.\n",
    ]
    makers: dict[str, Callable[[Any], str]] = {
        "kernels": _kernels,
        "lanes": _lanes,
        "ticks": _ticks,
        "soak": _soak,
        "instructions": _instructions,
        "start": _start,
        "realtime": _real_time,
        "link": _link,
    }
    return "\n".join([*parts, *(make(found[name]) for name, make in makers.items() if name in found)])


def _kernels(ways: list[dict[str, Any]]) -> str:
    flight_ns = ways[0]["step_ns"]
    lines = [
        "## The nine-state filter, one predict and update\n",
        "Least of some rounds over an arc of 2000 s, the ways taken in turn. The difference is the largest of the last",
        "covariance to flight's, in shares of the standard deviations.\n",
        "| | ns a step | to flight's | difference |",
        "|---|---|---|---|",
    ]
    for way in ways:
        ratio = way["step_ns"] / flight_ns
        lines.append(f"| {way['name']} | {way['step_ns']:,.0f} | {ratio:.2f} | {way['difference']:.0e} |")
    return "\n".join(lines) + "\n"


def _lanes(ways: list[dict[str, Any]]) -> str:
    one = ways[-1]["arcs_per_s"]
    lines = [
        "## The ensemble of (17) in lanes\n",
        "Arcs of 2000 s a second: the mean by Euler with J2, a covariance with six pseudo-measurements, each",
        "second. The best of some rounds, ways in turn; the first so short that no neighbour is in all of them.\n",
        "| | arcs a second | to flight's |",
        "|---|---|---|",
    ]
    lines += [f"| {way['name']} | {way['arcs_per_s']:,.0f} | {way['arcs_per_s'] / one:.1f} |" for way in ways]
    return "\n".join(lines) + "\n"


def _instructions(found: dict[str, Any]) -> str:
    lines = ["## Instructions of a tick\n"]
    if "missing" in found:
        return "\n".join([*lines, f"Not counted: {found['missing']}.\n"])
    lines += [
        "Of replays, bus and logs included, counted by valgrind as the difference of a longer and a shorter one, with",
        "kernels compiled for AVX2, the most it knows. Neighbours and frequency are not in it.\n",
        "| | instructions a tick | ticks |",
        "|---|---|---|",
    ]
    lines += [f"| {name} | {one['instructions']:,.0f} | {one['ticks']:,} |" for name, one in found.items()]
    return "\n".join(lines) + "\n"


def _ticks(flights: dict[str, dict[str, Any]]) -> str:
    lines = ["## A tick in lockstep\n", "World, virtual bus, codec, step, telemetry and logs in one process.\n"]
    for name, timing in flights.items():
        speed = timing["simulated_s"] / timing["wall_s"]
        lines += [
            f"### {name[0].upper()}{name[1:]}\n",
            f"{timing['ticks']:,} ticks, {speed:,.0f} times real time, {timing['slips']} slips; {_process(timing)}.\n",
            *_members(timing["members"]),
            "",
        ]
    return "\n".join(lines)


def _soak(found: dict[str, Any]) -> str:
    first, last = found["first"], found["last"]
    passes = "/".join(str(b - a) for a, b in zip(first["collected"], last["collected"], strict=True))
    failures = found.get("failures") or []
    again = found.get("beginning_again")
    lines = [
        "## A long flight\n",
        f"`make soak`, scenario {found['scenario']}: {found['ticks']:,} ticks in {found['flown_laps']:,} laps, "
        f"{found['simulated_s'] / found['flown_s']:,.0f} times real time, {found['slips']} slips, "
        f"{found['alerts']:,} alerts. {('FAILED: ' + '; '.join(failures)) if failures else 'Nothing failed'}.\n",
        f"After the first lap, in {last['ticks'] - first['ticks']:,} ticks: {found['grown']:+,} blocks of memory by "
        f"what flew, {(last['rss_bytes'] - first['rss_bytes']) / 2**20:+.1f} MiB resident, collector passes {passes} "
        f"by generation, {last['dropped']} entries dropped.",
        f"Digest of all telemetry: {found['digest']}."
        + (
            f" The first {again['ticks']:,} ticks flown again: {'the same' if again['same'] else 'OTHER'}."
            if again
            else ""
        )
        + "\n",
        *_members(found["members"]),
    ]
    return "\n".join(lines) + "\n"


def _start(found: dict[str, float]) -> str:
    lines = ["## From nothing to the end of the first tick\n"]
    lines += [f"- {name}: {seconds:.1f} s" for name, seconds in found.items()]
    return "\n".join(lines) + "\n"


def _real_time(flights: dict[str, dict[str, Any]]) -> str:
    lines = [
        "## Real time\n",
        "Flight beside world, bus hub and console, each a process of this machine; where it is permitted, and not said",
        "otherwise, with SCHED_FIFO and locked memory. `wake` is how late ticks began.\n",
    ]
    for name, timing in flights.items():
        lines += [
            f"### {name}\n",
            f"{timing['scheduling']} scheduling, {timing['ticks']:,} ticks, {timing['slips']} slips; "
            f"{_process(timing)}.\n",
            *_members(timing["members"]),
            "",
        ]
    return "\n".join(lines)


def _link(found: dict[str, Any]) -> str:
    period_us, held, link = found["period_us"], found["held"], found["link_cpu"]
    lines = [
        "## The ground link\n",
        f"{link['runs']:,} ticks in lockstep after {found['warm_ticks']:,} to warm, one every {period_us / 1000:g} ms:",
        f"a UDP peer of this machine, signed both ways, default rates; {found['heard']:,} messages down,",
        f"{found['orders_taken']:,} of {found['orders_sent']:,} orders and requests taken, {found['refused']} refused.",
        f"{_process(found)[0].upper()}{_process(found)[1:]}.\n",
        "| of one tick | mean | p50 | p99 | p99.9 | max |",
        "|---|---|---|---|---|---|",
    ]
    columns = ("mean_us", "p50_us", "p99_us", "p99.9_us", "max_us")
    for name, key in (("the link's work", "link"), ("all work", "whole")):
        for clock, member in (("processor", found[f"{key}_cpu"]), ("wall", found[key])):
            lines.append(
                f"| {name}, {clock} [us] | " + " | ".join(f"{member[column]:,.1f}" for column in columns) + " |"
            )
    shares = " | ".join(f"{link[column] / period_us:.2%}" for column in columns)
    lines += [
        f"| the link's share of the tick, processor | {shares} |",
        "",
        f"More than {LINK_SHARE:.0%} of the tick: {link['over_budget']:,} of {link['runs']:,} ticks. "
        f"Of the work of a tick the link's is {link['mean_us'] / found['whole_cpu']['mean_us']:.0%}.\n",
        "Held at the beginning, and after each tenth:\n",
        "| | " + " | ".join(str(part) for part in range(len(held))) + " |",
        "|---|" + "---|" * len(held),
        "| blocks | " + " | ".join(f"{at['blocks'] - held[0]['blocks']:+,}" for at in held) + " |",
        "| resident, kB | "
        + " | ".join(f"{(at['resident_bytes'] - held[0]['resident_bytes']) / 1e3:+,.0f}" for at in held)
        + " |",
    ]
    return "\n".join(lines) + "\n"


def _process(timing: dict[str, Any]) -> str:
    process = timing["process"]
    passes = "/".join(str(count) for count in process["collector_passes"])
    words = [f"collector passes {passes} by generation", f"{process['net_blocks']:,} more blocks of memory held"]
    if "major_page_faults" in process:
        words.append(f"{process['major_page_faults']} major and {process['minor_page_faults']} minor page faults")
        words.append(f"preempted {process['preempted']:,} times")
    if process["load"] is not None:
        words.append(f"load {process['load']:.2f} at its end")
    return ", ".join(words)


def _members(members: dict[str, dict[str, Any]]) -> list[str]:
    lines = ["| | " + " | ".join(name.removesuffix("_us").replace("_", " ") for name in MEMBER_COLUMNS) + " |"]
    lines.append("|---|" + "---|" * len(MEMBER_COLUMNS))
    for name, member in members.items():
        if not member["runs"]:
            continue
        cells = [f"{member[c]:,.1f}" if c.endswith("_us") else f"{member[c]:,}" for c in MEMBER_COLUMNS]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    lines += ["", "Microseconds."]
    return lines
