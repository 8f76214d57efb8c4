"""`ground icd`: generate the interface code and document from their sources, export them for other tools."""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from ground.errors import OperatorError

_ROOT = Path(__file__).resolve().parents[2]
_ICD = _ROOT / "flightsw" / "icd"
DBC = _ICD / "sensor_bus.dbc"
XML = _ICD / "leonav.xml"

_EXPORTED = ("sensor_bus.dbc", "leonav.xml", "can_frames.py", "frame_layout.py", "can_codec.py")

_HOW_TO_USE = """\
CAN:      cantools decode --single-line {folder}/sensor_bus.dbc < can.log
MAVLink:  put the dialect where your pymavlink looks for dialects,
            cp {folder}/leonav.py {folder}/leonav.xml \\
              "$(python -c 'import os, pymavlink; print(os.path.dirname(pymavlink.__file__))')/dialects/v20/"
          then read a log with
            MAVLINK20=1 mavlogdump.py --dialect leonav link.tlog"""


def add_arguments(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `icd` to the dispatcher."""
    parser = subparsers.add_parser("icd", description="Generate and export the interface.")
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    generate = actions.add_parser("generate", help="write can_frames.py, mavlink.py and docs/icd.md from their sources")
    generate.add_argument("--check", action="store_true", help="write nothing; exit 1 when one is out of date")
    export = actions.add_parser("export", help="write DBC, MAVLink XML and generated Python to a folder")
    export.add_argument("folder", metavar="DIR")


def run(args: argparse.Namespace) -> int:
    """Carry out `ground icd ...`; returns the exit status (1: `--check` found a file out of date)."""
    if args.action == "generate":
        return _generate(args.check)
    return _export(Path(args.folder))


def generated() -> dict[Path, str]:
    """What each generated file should hold: path -> text."""
    from ground.icdgen.dialect import render_mavlink
    from ground.icdgen.document import render_document
    from ground.icdgen.frames import read_bus, render_frames

    return {
        _ICD / "can_frames.py": render_frames(read_bus(DBC)),
        _ICD / "mavlink.py": render_mavlink(XML),
        _ROOT / "docs" / "icd.md": render_document(DBC, XML),
    }


def _generate(check: bool) -> int:
    if not (_ROOT / "pyproject.toml").is_file():
        raise OperatorError(f"{_ROOT}: not a source tree; run `ground icd generate` in a clone of leonav")
    stale = 0
    for path, text in generated().items():
        name = path.relative_to(_ROOT)
        if path.is_file() and path.read_text(encoding="utf-8") == text:
            print(f"{name}: up to date")
        elif check:
            print(f"{name}: out of date; run `ground icd generate` and commit it")
            stale = 1
        else:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
            print(f"{name}: written")
    return stale


def _export(folder: Path) -> int:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in _EXPORTED:
            text = (_ICD / name).read_text(encoding="utf-8")
            # the exported modules import each other from the folder: they need no leonav beside them
            (folder / name).write_text(text.replace("from flightsw.icd.", "from "), encoding="utf-8")
        # a dialect of pymavlink goes by the name of its file
        shutil.copyfile(_ICD / "mavlink.py", folder / "leonav.py")
    except OSError as error:
        raise OperatorError(f"{folder}: cannot be written: {error.strerror or error}") from error
    for name in (*_EXPORTED, "leonav.py"):
        print(folder / name)
    print(_HOW_TO_USE.format(folder=folder))
    return 0
