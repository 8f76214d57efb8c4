"""`ground mcap`: what is in the log is in the file, read back with mcap's own reader."""

from __future__ import annotations

import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("mcap", reason="mcap (extra mcap) is not installed")

from console_story import frames, write_tlog
from mcap.reader import make_reader

from flightsw.icd import mavlink
from ground.__main__ import main

STOP_S = 30


def test_every_message_is_in_the_file_at_its_time_with_its_values(tmp_path: Path, capsys: Any) -> None:
    write_tlog(tmp_path / "link.tlog", STOP_S)
    (tmp_path / "run.json").write_text('{"seed": 7}')
    assert main(["mcap", str(tmp_path)]) == 0
    decoder = mavlink.MAVLink(None)
    sent = [(t_us, decoder.decode(bytearray(frame))) for t_us, frame in frames(STOP_S)]
    assert f"{len(sent)} messages of {len({m.get_type() for _, m in sent})} kinds" in capsys.readouterr().out
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file)
        read = list(reader.iter_messages(log_time_order=False))
        assert {record.name: dict(record.metadata) for record in reader.iter_metadata()} == {
            "run": {"run.json": '{"seed": 7}'}
        }
    assert Counter(schema.name for schema, _, _ in read) == Counter(m.get_type() for _, m in sent)
    by_sequence = sorted(read, key=lambda entry: entry[2].sequence)
    for (t_us, message), (schema, channel, found) in zip(sent, by_sequence, strict=True):
        assert channel.topic == f"/mavlink/{message.get_type()}"
        assert found.log_time == t_us * 1000
        values = json.loads(found.data)
        properties = json.loads(schema.data)["properties"]
        assert set(values) == set(properties) == set(message.fieldnames)
        for name, value in values.items():
            original = getattr(message, name)
            if isinstance(original, float) and not math.isfinite(original):
                assert value is None
            elif isinstance(original, list):
                assert properties[name]["type"] == "array"
                assert value == [one if math.isfinite(one) else None for one in original]
            else:
                assert value == original
    integrity = next(json.loads(schema.data) for schema, _, _ in read if schema.name == "LEONAV_INTEGRITY")
    assert integrity["properties"]["bound_m"] == {"type": ["number", "null"], "description": "m"}


def test_what_cannot_be_read_or_written_is_one_line(tmp_path: Path, capsys: Any) -> None:
    assert main(["mcap", str(tmp_path)]) == 2
    assert "link.tlog: cannot be read" in capsys.readouterr().err
    write_tlog(tmp_path / "link.tlog", 2)
    assert main(["mcap", str(tmp_path), "--out", str(tmp_path / "absent" / "x.mcap")]) == 2
    assert "name another file" in capsys.readouterr().err
