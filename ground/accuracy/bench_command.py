"""`ground accuracy bench`: the flight filter on real and simulated orbits, its figures written and judged."""

from __future__ import annotations

import argparse
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ground.errors import OperatorError, did_you_mean
from ground.exit_status import STOPPED

if TYPE_CHECKING:
    from ground.accuracy.bench_cases import Case, Orbit

BENCH_HELP = "the whole filter: convergence, steady error, error without fixes, back to steady; table, plots, verdict"
USUAL_PROFILES = "white,position_only,coloured"
USUAL_AREA_TO_MASS_M2PKG = 0.005


def add_bench(actions: Any) -> None:
    """The parser of `ground accuracy bench`."""
    bench = actions.add_parser("bench", help=BENCH_HELP, description=BENCH_HELP)
    bench.add_argument(
        "--out", required=True, type=Path, metavar="DIR", help="folder of the results; resumed if it has any"
    )
    bench.add_argument(
        "--orbits",
        nargs="+",
        metavar="NAME|FILE",
        help="sentinel3a, gracefo, jason2, sentinel1a, simulated, simulated_storm, or an orbit file: SP3, GEORB .orb, "
        "Sentinel .EOF, CCSDS OEM, also .gz (default: all names whose data are at hand)",
    )
    bench.add_argument(
        "--profiles", metavar="LIST", help=f"of fixes, with commas (default {USUAL_PROFILES}; with --quick white)"
    )
    bench.add_argument("--oscillator", action="store_true", help="white fixes also with a perfect clock, to compare")
    bench.add_argument(
        "--set-name",
        default="flight",
        metavar="SET",
        help="table set that flies; where a set SET_PROFILE ships, with that profile (default flight)",
    )
    bench.add_argument(
        "--set", dest="settings", metavar="KEY=VALUE", action="append", default=[],
        help="override a key of the scenario, for example flight.table.k_axis=3; may be repeated",
    )  # fmt: skip
    bench.add_argument("--gravity", metavar="FILE", type=Path, help="ICGEM file (default: EGM2008, else packaged)")
    bench.add_argument("--degree", type=int, metavar="N", help="degree and order of gravity (default: the schema's)")
    bench.add_argument("--satellite", metavar="ID", help="of orbit files that hold several")
    bench.add_argument(
        "--velocity-unit", default="auto", metavar="UNIT",
        help="of orbit files: m/s, dm/s, km/s, or derive from positions (default auto: found out)",
    )  # fmt: skip
    bench.add_argument("--time-scale", metavar="SCALE", help="of orbit files, instead of their own: gps, utc, tai, tt")
    bench.add_argument(
        "--start", metavar="TIME", help="first instant of orbit files that is flown, GPS time, as 2018-12-26T12:00:00"
    )
    bench.add_argument(
        "--area-to-mass", type=float, metavar="M2PKG",
        help=f"cross-section by mass of the satellites of orbit files [m2/kg] (default {USUAL_AREA_TO_MASS_M2PKG})",
    )  # fmt: skip
    bench.add_argument("--quick", action="store_true", help="one orbit, three starts: whether all works, in a minute")
    bench.add_argument("--jobs", type=int, metavar="N", help="processes to fly in (default: 2, or 1 on one processor)")


def run_bench(args: argparse.Namespace, data: Path, gravity: Path | None) -> int:
    """Fly, write, print, return 0; misses are said, and are no error. data: folder of real orbits."""
    if args.jobs is not None and args.jobs < 1:
        raise OperatorError(f"--jobs {args.jobs}: give 1 or more")
    if args.out.exists() and not args.out.is_dir():
        raise OperatorError(f"--out {args.out}: is a file; name a folder")
    if args.area_to_mass is not None and not 0.0 <= args.area_to_mass <= 1.0:
        raise OperatorError(f"--area-to-mass {args.area_to_mass}: give 0 to 1 m2/kg")
    from ground.accuracy import bench, bench_report, bench_store, bench_summary, bench_verdict
    from ground.studies.flights import pool, progress_bar, usual_jobs

    cases = _cases(args, data, gravity)
    files = {case.orbit.name: path for case in cases if (path := _file_of(case.orbit, data)) is not None}
    _check_settings(cases)
    total = sum(len(bench_store.parts(case)) for case in cases)
    jobs = min(usual_jobs() if args.jobs is None else args.jobs, total)
    try:
        args.out.mkdir(parents=True, exist_ok=True)
        with progress_bar("flying", total) as advance, pool(jobs) as workers:
            flown = bench.run(cases, args.out, workers, files, advance)
    except OSError as error:
        raise OperatorError(f"--out {args.out}: cannot be written: {error.strerror}") from error
    except KeyboardInterrupt:
        print("\nstopped; finished cases are kept, the same command goes on from there", file=sys.stderr)
        return STOPPED
    from ground.accuracy.bench_plots import make_figures

    summaries = [bench_summary.summarise(one.case, one.figures) for one in flown]
    lines = bench_verdict.judge(summaries)
    content = bench_report.document(summaries, lines, bench_store.code_hash())
    written = bench_report.write(args.out, content, lines)
    written += make_figures(flown, args.out / "figures")
    for summary in summaries:
        print(bench_report.terminal(summary))
    for text in bench_report.pooled_lines(summaries):
        print(text)
    print("\nWanted, goal and measured (issue items):")
    print(bench_report.verdict_head())
    for text in bench_report.verdict_lines(lines):
        print(text)
    missed = sum(not line.met for line in lines)
    print(f"\n{len(lines) - missed} of {len(lines)} met, {missed} missed")
    resumed = sum(one.resumed for one in flown)
    if resumed:
        print(f"{resumed} of {len(flown)} cases were flown before, with the same code, tables and data")
    print(f"written: {', '.join(str(path.relative_to(args.out)) for path in written)} in {args.out}")
    return 0


def _cases(args: argparse.Namespace, data: Path, gravity: Path | None) -> list[Case]:
    from ground.accuracy import bench_cases

    usual = "white" if args.quick else USUAL_PROFILES
    profiles = bench_cases.chosen_profiles(usual if args.profiles is None else args.profiles)
    if args.oscillator:
        profiles = tuple(dict.fromkeys((*profiles, "white", bench_cases.PERFECT_CLOCK)))
    orbits = [_orbit(word, args, data) for word in args.orbits] if args.orbits else _all_orbits(data, args.quick)
    names = [orbit.name for orbit in orbits]
    for name in names:
        if names.count(name) > 1:
            raise OperatorError(f"--orbits: {name} twice; name each orbit once, rename one of two files of one name")
    if args.degree is not None and args.degree < 2:
        raise OperatorError(f"--degree {args.degree}: give 2 or more")
    return bench_cases.cases_of(orbits, profiles, args.set_name, args.settings, gravity, args.degree, args.quick)


def _orbit(word: str, args: argparse.Namespace, data: Path) -> Orbit:
    """A known orbit by its name, or that of a file."""
    from ground.accuracy.bench_cases import ORBITS, orbit_of_file

    if word in ORBITS:
        orbit = ORBITS[word]
        path = _file_of(orbit, data)
        if path is not None and not path.is_file():
            raise OperatorError(f"--orbits {word}: no file {path}; set LEONAV_DATA to the folder of real orbits")
        return orbit
    path = Path(word)
    if not path.is_file():
        hint = did_you_mean(word, ORBITS)
        raise OperatorError(f"--orbits {word}: neither a file nor one of {', '.join(ORBITS)}{hint}")
    area = USUAL_AREA_TO_MASS_M2PKG if args.area_to_mass is None else args.area_to_mass
    try:
        start = None if args.start is None else datetime.fromisoformat(args.start)
    except ValueError:
        start = datetime.max.replace(tzinfo=UTC)
    if start is not None and start.tzinfo is not None:
        raise OperatorError(f"--start {args.start}: give a date and time of GPS time, for example 2018-12-26T12:00:00")
    return orbit_of_file(path, area, args.satellite, args.velocity_unit, args.time_scale, start)


def _all_orbits(data: Path, quick: bool) -> list[Orbit]:
    """Every known orbit whose data are at hand; says which are not. For a quick look one that needs none."""
    from ground.accuracy.bench_cases import ORBITS

    if quick:
        return [ORBITS["simulated"]]
    found = []
    for orbit in ORBITS.values():
        path = _file_of(orbit, data)
        if path is None or path.is_file():
            found.append(orbit)
        else:
            print(f"left out: {orbit.name}: no file {path}; set LEONAV_DATA to the folder of real orbits")
    return found


def _file_of(orbit: Orbit, data: Path) -> Path | None:
    return None if orbit.file is None else data / orbit.file


def _check_settings(cases: list[Case]) -> None:
    """Refuse what no flight can be made of before the first is flown."""
    from ground.accuracy.bench_cases import LONG_FLIGHT
    from ground.accuracy.bench_flight import force_tables
    from ground.studies.flights import load
    from ground.tables.build import build_navigation

    orbits = set()
    for case in cases:
        loaded = load(case.orbit.scenario, case.scenario_settings(LONG_FLIGHT))
        build_navigation(case.table_set, loaded.scenario.flight.table or None)
        if case.orbit.name not in orbits:
            force_tables(case, loaded.t_start_gps_ns)
            orbits.add(case.orbit.name)
