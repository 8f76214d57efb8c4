"""`ground table`: build, show, compare, sign, verify and list binary tables."""

from __future__ import annotations

import argparse
import os
import sys
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

    function = actions.add_parser("build-function", help="make the table with which a function beside navigation flies")
    function.add_argument("kind", metavar="KIND", help="for example velocity_check")
    function.add_argument("--out", metavar="TABLE", required=True, help="binary table to write: KIND.tbl in its folder")
    function.add_argument(
        "--set",
        dest="settings",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="a field of the table; may be repeated",
    )

    show = actions.add_parser("show", help="print a binary table")
    show.add_argument("file", metavar="FILE")

    diff = actions.add_parser("diff", help="what differs between two binary tables; exit status 1 where something does")
    diff.add_argument("file", metavar="FILE")
    diff.add_argument("other", metavar="OTHER")

    sign = actions.add_parser("sign", help="attach a certificate to a table, and sign it with a key")
    sign.add_argument("file", metavar="TABLE")
    sign.add_argument(
        "--certificate", metavar="JSON", required=True, help="certificate.json that `ground certify` left"
    )
    sign.add_argument(
        "--stimulus", metavar="FILE", help="of `ground stimulus`; default: the one that the table carries"
    )
    sign.add_argument("--key", metavar="FILE", help="key of the HMAC-SHA256; not signed without")
    sign.add_argument("--out", metavar="FILE", help="table to write; default: in place of TABLE")
    sign.add_argument("--beside", metavar="SET.toml", help="keep it beside this set, too, whose tables it then is")

    verify = actions.add_parser("verify", help="check a table as flight does; exit status 1 for an uncertified one")
    verify.add_argument("file", metavar="TABLE")
    verify.add_argument("--key", metavar="FILE", help="key that must have signed it; the HMAC is not checked without")

    key = actions.add_parser("key", help="make a random key for `sign` and `verify`")
    key.add_argument("file", metavar="FILE")

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
    if args.action == "build-function":
        from ground.tables.build import parse_setting
        from ground.tables.functions import build_function

        settings = dict(parse_setting(text) for text in args.settings)
        return _write(Path(args.out), build_function(args.kind, settings))
    if args.action == "show":
        from ground.tables.show import read_table, render

        print(render(read_table(args.file)))
        return 0
    if args.action in _CERTIFICATES:
        return _CERTIFICATES[args.action](args)
    from ground.tables.build import list_sets

    for name, description in list_sets().items():
        print(f"{name:<16} {description}")
    return 0


def _build(name: str, out: Path, settings: list[str]) -> int:
    from flightsw.icd.table_file import decode
    from flightsw.icd.table_saturation import saturation
    from ground.tables.build import build_navigation, parse_setting
    from ground.tables.certified import build_certified

    if settings:
        image, lacking = build_navigation(name, dict(parse_setting(text) for text in settings)), ""
    else:
        image, lacking = build_certified(name)
    _write(out, image)
    if "not used" in lacking:
        print(lacking, file=sys.stderr)
    for text in saturation(decode(image).values):
        print(f"{out}: flight REFUSES this table: {text}", file=sys.stderr)
    return 0


def _build_forces(args: argparse.Namespace) -> int:
    from ground.tables.build import parse_setting
    from ground.tables.forces import VALID_DAYS, build_forces, parse_day

    settings = dict(parse_setting(text) for text in args.settings)
    day = parse_day(args.day) if args.day else None
    valid_days = VALID_DAYS if args.valid_days is None else args.valid_days
    return _write(Path(args.out), build_forces(settings, args.name, day, valid_days, args.space_weather))


def _diff(args: argparse.Namespace) -> int:
    from ground.tables.show import read_table
    from ground.tables.sign import describe, differences

    one, other = read_table(args.file), read_table(args.other)
    found = differences(one, other)
    print(f"{args.file}: {describe(one)}\n{args.other}: {describe(other)}")
    print("\n".join(found) or "no difference")
    return 1 if found else 0


def _sign(args: argparse.Namespace) -> int:
    from ground.tables.show import read_table
    from ground.tables.sign import read_key, sign

    key = read_key(Path(args.key)) if args.key else None
    stimulus = _read(Path(args.stimulus)) if args.stimulus else b""
    image = sign(read_table(args.file), Path(args.certificate), stimulus, key)
    _write(Path(args.out or args.file), image)
    if args.beside:
        from ground.tables.certified import keep_beside

        print(f"{keep_beside(image, Path(args.beside))}: tables of this set carry its certificate from now on")
    return 0


def _verify(args: argparse.Namespace) -> int:
    from ground.tables.show import read_table
    from ground.tables.sign import describe, read_key, render_certificate, verify

    table = read_table(args.file)
    block = verify(table, read_key(Path(args.key)) if args.key else None, args.file)
    print(describe(table))
    print("\n".join(render_certificate(block)))
    print("HMAC         right" if args.key else "HMAC         not checked: no --key")
    return 0 if block is not None and block.grade else 1


def _key(args: argparse.Namespace) -> int:
    from ground.tables.sign import make_key

    make_key(Path(args.file))
    print(f"{args.file}: a new key; keep it secret, and give it to flight with --table-key")
    return 0


_CERTIFICATES = {"diff": _diff, "sign": _sign, "verify": _verify, "key": _key}


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise OperatorError(f"{path}: cannot be read: {error.strerror or error}") from error


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
