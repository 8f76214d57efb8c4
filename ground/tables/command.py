"""`ground table`: build, show and list binary tables."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from ground.errors import OperatorError


def add_arguments(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `table` to the dispatcher."""
    parser = subparsers.add_parser("table", description="Build and show the binary tables that flight loads.")
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")

    build = actions.add_parser("build", help="make a binary navigation table from a set")
    build.add_argument("set", metavar="SET", help="name of a shipped set, or a .toml file")
    build.add_argument("--out", metavar="FILE", required=True, help="binary table to write")
    build.add_argument(
        "--set",
        dest="settings",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="override a key of the set, for example limit_m=500 or tuning.0.bound_s_r_m=1e5; may be repeated",
    )

    gravity = actions.add_parser("build-gravity", help="make a gravity field table from an ICGEM model file")
    gravity.add_argument("file", metavar="FILE", nargs="?", help=".gfc or .gfc.gz; default: ITU_GRACE16 of satkit-data")
    gravity.add_argument("--degree", metavar="N", type=int, default=120, help="largest degree kept (default 120)")
    gravity.add_argument("--out", metavar="TABLE", required=True, help="binary table to write")

    forces = actions.add_parser("build-forces", help="make a force table: defaults, space weather of a day, settings")
    forces.add_argument("--out", metavar="TABLE", required=True, help="binary table to write")
    forces.add_argument("--name", metavar="NAME", default="forces", help="name that the table carries")
    forces.add_argument("--day", metavar="YYYY-MM-DD", help="space weather of this day; the table is valid around it")
    forces.add_argument(
        "--valid-days", metavar="DAYS", type=float, help="how long before and after, with --day (default 45)"
    )
    forces.add_argument("--space-weather", metavar="FILE", help="CelesTrak SW-All.csv; default: that of satkit-data")
    forces.add_argument(
        "--set",
        dest="settings",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="a field of the table, for example degree=70 or area_to_mass_m2pkg=0.002; may be repeated",
    )

    show = actions.add_parser("show", help="print a binary table")
    show.add_argument("file", metavar="FILE")

    actions.add_parser("sets", help="list the sets that ship")


def run(args: argparse.Namespace) -> int:
    """Carry out `ground table ...`; returns the exit status."""
    if args.action == "build":
        return _build(args.set, Path(args.out), args.settings)
    if args.action == "build-gravity":
        from ground.tables.gravity_field import build_gravity_field

        return _write(Path(args.out), build_gravity_field(args.file, args.degree))
    if args.action == "build-forces":
        return _build_forces(args)
    if args.action == "show":
        from ground.tables.show import read_table, render

        print(render(read_table(args.file)))
        return 0
    from ground.tables.build import list_sets

    for name, description in list_sets().items():
        print(f"{name:<16} {description}")
    return 0


def _build(name: str, out: Path, settings: list[str]) -> int:
    from ground.tables.build import build_navigation, parse_setting

    return _write(out, build_navigation(name, dict(parse_setting(text) for text in settings)))


def _build_forces(args: argparse.Namespace) -> int:
    from ground.tables.build import parse_setting
    from ground.tables.forces import VALID_DAYS, build_forces, parse_day

    settings = dict(parse_setting(text) for text in args.settings)
    day = parse_day(args.day) if args.day else None
    valid_days = VALID_DAYS if args.valid_days is None else args.valid_days
    return _write(Path(args.out), build_forces(settings, args.name, day, valid_days, args.space_weather))


def _write(out: Path, image: bytes) -> int:
    from flightsw.icd.table_file import decode

    write_whole(out, image)
    table = decode(image)
    print(f"{out}: {table.kind} table, set {table.set_name}, {len(image)} bytes, CRC-32 {table.crc32:08x}")
    return 0


def write_whole(path: Path, image: bytes) -> None:
    """Write to a new file beside `path`, then rename: a reader sees the old table or the new, never half."""
    fresh = path.with_name(path.name + ".new")
    try:
        with fresh.open("wb") as file:
            file.write(image)
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(path)
    except OSError as error:
        raise OperatorError(f"{path}: cannot be written: {error.strerror or error}") from error
