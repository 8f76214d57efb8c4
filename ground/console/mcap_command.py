"""`ground mcap RUN_DIR`: a run's telemetry as an MCAP file, for Foxglove and whatever else reads that.

One channel for each kind of message, JSON with its schema; a number that is none becomes null. Times are of the log.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

from ground.errors import OperatorError

HELP = "write a run's telemetry as MCAP, for Foxglove and other viewers"
_JSON_TYPES = {"char": "string", "float": "number", "double": "number"}


def add_arguments(subparsers: Any) -> None:
    """The parser of `ground mcap`."""
    parser: argparse.ArgumentParser = subparsers.add_parser("mcap", help=HELP, description=HELP)
    parser.add_argument("run_dir", type=Path, metavar="RUN_DIR", help="folder that a run left")
    parser.add_argument("--out", type=Path, metavar="FILE", help="file to write (default RUN_DIR/run.mcap)")


def run(args: argparse.Namespace) -> int:
    """Write the file. Raises OperatorError for what cannot be read or written."""
    out = args.out or args.run_dir / "run.mcap"
    try:
        messages, kinds = export(args.run_dir, out)
    except OSError as error:
        raise OperatorError(f"--out {out}: cannot be written ({error.strerror}); name another file") from None
    print(f"{out}: {messages} messages of {kinds} kinds")
    return 0


def export(run_dir: Path, out: Path) -> tuple[int, int]:
    """Write link.tlog of a run, and run.json as metadata where there is one; messages and kinds written."""
    from mcap.writer import Writer

    from ground.console.tlog import TlogLink

    link = TlogLink(run_dir / "link.tlog", 1.0, lambda: 0.0)
    channels: dict[str, int] = {}
    count = 0
    with out.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="leonav")
        for sequence, (time_s, message) in enumerate(link.everything()):
            kind = message.get_type()
            if kind not in channels:
                schema = writer.register_schema(kind, "jsonschema", json.dumps(schema_of(message)).encode())
                channels[kind] = writer.register_channel(f"/mavlink/{kind}", "json", schema)
            time_ns = round(time_s * 1e6) * 1000
            data = json.dumps(values_of(message), allow_nan=False).encode()
            writer.add_message(channels[kind], time_ns, data, time_ns, sequence)
            count += 1
        record = run_dir / "run.json"
        if record.exists():
            writer.add_metadata("run", {"run.json": record.read_text(encoding="utf-8")})
        writer.finish()
    return count, len(channels)


def schema_of(message: Any) -> dict[str, Any]:
    """JSON schema of a kind of message, with its units."""
    properties = {}
    for name, kind, length in zip(message.fieldnames, message.fieldtypes, _lengths(message), strict=True):
        one: dict[str, Any] = {"type": _JSON_TYPES.get(kind.removesuffix("_mavlink_version"), "integer")}
        if one["type"] == "number":
            one = {"type": ["number", "null"]}
        unit = message.fieldunits_by_name.get(name)
        if unit:
            one["description"] = unit.strip("[]")
        properties[name] = {"type": "array", "items": one} if length and one["type"] != "string" else one
    return {"title": message.get_type(), "type": "object", "properties": properties}


def values_of(message: Any) -> dict[str, Any]:
    """The fields as JSON takes them."""
    return {name: _plain(getattr(message, name)) for name in message.fieldnames}


def _lengths(message: Any) -> list[int]:
    by_order = dict(zip(message.ordered_fieldnames, message.array_lengths, strict=True))
    return [by_order[name] for name in message.fieldnames]


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, bytes | bytearray):
        return value.decode("utf-8", "backslashreplace").rstrip("\0")
    return value
