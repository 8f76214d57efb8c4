"""The dialect: standard messages are those of MAVLink, own messages survive the wire, enums agree with flight's."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import pymavlink
import pytest
from pymavlink.dialects.v20 import common, development

from flightsw.icd import enums, mavlink
from flightsw.icd.alerts import ALERTS, AlertId, Severity
from flightsw.link.access import Refusal
from ground.__main__ import main

STANDARD = (
    *("HEARTBEAT", "SYS_STATUS", "SYSTEM_TIME", "GPS_RAW_INT", "ESTIMATOR_STATUS", "STATUSTEXT"),
    *("PARAM_REQUEST_READ", "PARAM_REQUEST_LIST", "PARAM_VALUE", "PARAM_SET"),
    *("COMMAND_INT", "COMMAND_LONG", "COMMAND_ACK", "MESSAGE_INTERVAL"),
    *("FILE_TRANSFER_PROTOCOL", "TIMESYNC", "AUTOPILOT_VERSION"),
    *("AVAILABLE_MODES", "CURRENT_MODE", "AVAILABLE_MODES_MONITOR"),
)
IN_DEVELOPMENT = ("AVAILABLE_MODES", "CURRENT_MODE", "AVAILABLE_MODES_MONITOR")  # not in this pymavlink's common.xml


def theirs_of(name: str) -> Any:
    return development if name in IN_DEVELOPMENT else common


OWN_IDS = {
    61400: "LEONAV_NAV_STATE",
    61401: "LEONAV_INTEGRITY",
    61402: "LEONAV_INNOVATION",
    61403: "LEONAV_COUNTERS",
    61404: "LEONAV_TABLE_STATUS",
    61405: "LEONAV_ALERT",
    61406: "LEONAV_COVARIANCE",
    61407: "LEONAV_TIME_TO_FLAG",
    61408: "LEONAV_LINK",
    61409: "LEONAV_TIMING",
    61410: "LEONAV_STATE_UPLOAD",
    61411: "LEONAV_STATE_RESULT",
    61416: "LEONAV_CROSSLINK",
    61412: "LEONAV_GNSS_CHECK",
    61420: "LEONAV_PROTECTION",
    61421: "LEONAV_VELOCITY_CHECK",
}
_EXTREMES = {
    "uint8_t": 255,
    "uint16_t": 65535,
    "uint32_t": 2**32 - 1,
    "uint64_t": 2**64 - 1,
    "int8_t": -128,
    "int16_t": -32768,
    "int32_t": -(2**31),
    "int64_t": -(2**63),
    "float": 1.5,
    "double": -6_878_137.123456789,
}


def message_class(name: str, module: Any = mavlink) -> Any:
    return getattr(module, f"MAVLink_{name.lower()}_message")


def extreme(kind: Any) -> Any:
    """A message of a kind with every field at the end of its range."""
    values: list[Any] = []
    for field, type_ in zip(kind.fieldnames, kind.fieldtypes, strict=True):
        # array lengths come in the order on the wire
        length = kind.array_lengths[kind.ordered_fieldnames.index(field)]
        if type_ == "char":
            values.append(b"paper".ljust(length, b"x"))
        else:
            values.append([_EXTREMES[type_]] * length if length else _EXTREMES[type_])
    return kind(*values)


@pytest.mark.parametrize("name", STANDARD)
def test_standard_message_is_the_one_of_common_xml(name: str) -> None:
    """Id, CRC_EXTRA, fields, order on the wire, types and array lengths equal pymavlink's common dialect."""
    ours, theirs = message_class(name), message_class(name, theirs_of(name))
    for attribute in ("id", "crc_extra", "fieldnames", "ordered_fieldnames", "fieldtypes", "array_lengths"):
        assert getattr(ours, attribute) == getattr(theirs, attribute), attribute


def test_copied_enums_are_those_of_common_xml() -> None:
    for name, enum in mavlink.enums.items():
        if not name.startswith("LEONAV_"):
            ours = {value: entry.name for value, entry in enum.items()}
            theirs = {value: entry.name for value, entry in development.enums[name].items()}
            ours = {v: n for v, n in ours.items() if "ENUM_END" not in n}
            theirs = {v: n for v, n in theirs.items() if "ENUM_END" not in n}
            if name == "MAV_CMD":  # those that flight knows
                theirs = {v: n for v, n in theirs.items() if v in ours}
            assert ours == theirs, name


@pytest.mark.parametrize("name", STANDARD)
def test_standard_frame_is_read_by_pymavlink_common(name: str) -> None:
    """GIVEN a frame of ours WHEN common's parser reads it THEN it accepts the CRC and gives equal fields."""
    sent = extreme(message_class(name))
    frame = sent.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))
    (read,) = theirs_of(name).MAVLink(None).parse_buffer(frame)
    assert read.get_type() == name
    assert read.to_dict() == sent.to_dict()


def test_own_ids_are_the_agreed_ones() -> None:
    assert {i: k.msgname for i, k in mavlink.mavlink_map.items() if i >= 61400} == OWN_IDS
    assert not set(OWN_IDS) & set(common.mavlink_map)


@pytest.mark.parametrize("name", OWN_IDS.values())
def test_own_message_survives_the_wire(name: str) -> None:
    """GIVEN every field at the end of its range WHEN packed and parsed THEN equal, and within one frame."""
    sent = extreme(message_class(name))
    frame = sent.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))
    assert frame[0] == mavlink.PROTOCOL_MARKER_V2
    (read,) = mavlink.MAVLink(None).parse_buffer(frame)
    assert (read.get_srcSystem(), read.get_srcComponent(), read.get_type()) == (1, 1, name)
    assert read.to_dict() == sent.to_dict()


@pytest.mark.parametrize(
    ("name", "enum"),
    [
        ("LEONAV_MODE", enums.Mode),
        ("LEONAV_FLAG_STATE", enums.FlagState),
        ("LEONAV_VERDICT", enums.Verdict),
        ("LEONAV_VALIDITY", enums.Validity),
        ("LEONAV_DRIVER", enums.BoundDriver),
        ("LEONAV_DA_SOURCE", enums.DaSource),
        ("LEONAV_CERTIFICATE", enums.Certificate),
        ("LEONAV_GNSS_VERDICT", enums.GnssVerdict),
        ("LEONAV_REJECT_CAUSE", enums.RejectCause),
        ("LEONAV_ALERT_ID", AlertId),
        ("LEONAV_LINK_REFUSAL", Refusal),
        ("MAV_SEVERITY", Severity),
    ],
)
def test_enums_of_the_dialect_equal_flights(name: str, enum: Any) -> None:
    entries = {v: e.name for v, e in mavlink.enums[name].items() if not e.name.endswith("ENUM_END")}
    assert entries == {member.value: f"{name}_{member.name}" for member in enum}


def test_counters_hold_every_reject_cause() -> None:
    kind = message_class("LEONAV_COUNTERS")
    length = kind.array_lengths[kind.ordered_fieldnames.index("rejected")]
    assert length == enums.REJECT_CAUSES
    assert max(enums.RejectCause) < length


def test_alerts_fit_statustext_and_the_alerts_word() -> None:
    for number, alert in ALERTS.items():
        assert number == alert.id
        assert 0 < number < 63
        assert alert.text.isascii()
        assert 0 < len(alert.text) <= 50
    assert set(ALERTS) == set(AlertId)


def test_mavlogdump_reads_our_log_with_the_exported_dialect(tmp_path: Path) -> None:
    """GIVEN `ground icd export` and a pymavlink into which the dialect is copied WHEN mavlogdump reads a .tlog
    with every message THEN it prints every one of them."""
    assert main(["icd", "export", str(tmp_path / "icd")]) == 0
    # a pymavlink of our own, made of links, so that the installed one stays as it is
    original, copy = Path(pymavlink.__file__).parent, tmp_path / "site" / "pymavlink"
    (copy / "dialects" / "v20").mkdir(parents=True)
    for folder, kept in ((".", "dialects"), ("dialects", "v20"), ("dialects/v20", "")):
        for path in (original / folder).iterdir():
            if path.name != kept:
                (copy / folder / path.name).symlink_to(path)
    for name in ("leonav.py", "leonav.xml"):
        (copy / "dialects" / "v20" / name).write_bytes((tmp_path / "icd" / name).read_bytes())

    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    log = tmp_path / "link.tlog"
    with log.open("wb") as file:
        for i, kind in enumerate(mavlink.mavlink_map.values()):
            file.write(struct.pack(">Q", 1_230_768_000_000_000 + i) + extreme(kind).pack(sender))
    done = subprocess.run(
        [sys.executable, "-m", "pymavlink.tools.mavlogdump", "--dialect", "leonav", str(log)],
        env=os.environ | {"PYTHONPATH": str(tmp_path / "site"), "MAVLINK20": "1"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    for kind in mavlink.mavlink_map.values():
        assert f" {kind.msgname} {{" in done.stdout
