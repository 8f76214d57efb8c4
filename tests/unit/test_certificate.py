"""The certificate of a table: opened whole or refused, bound to its table, authenticated by its key."""

from __future__ import annotations

import hashlib
import hmac
import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from certificates import KEY, STIMULUS, certified, record
from hypothesis import given
from hypothesis import strategies as st

from flightsw.icd.certificate import (
    CERTIFICATE,
    CertificateRefused,
    content_crc32,
    decode_block,
    encode_block,
    hash_text,
    open_certificate,
)
from flightsw.icd.enums import Certificate
from flightsw.icd.table_file import decode, encode
from ground.__main__ import main
from ground.errors import OperatorError
from ground.tables.build import build_navigation
from ground.tables.certificate_file import read_certificate

TABLE = decode(build_navigation("paper"))
OTHER = decode(build_navigation("paper", {"limit_m": 1999.0}))


def resealed(image: bytes) -> bytes:
    """The image with a right CRC again."""
    return image[:-4] + struct.pack("<I", zlib.crc32(image[:-4]))


def test_round_trip_through_a_table_file() -> None:
    """GIVEN a certificate WHEN attached and the file read THEN every field, the stimulus and the table are there."""
    table = decode(certified(build_navigation("paper")))
    block = open_certificate(table, KEY)
    assert block is not None
    for name in CERTIFICATE.dtype.names or ():
        if name != "stimulus_sha256":
            assert np.array_equal(block.values[name], record(TABLE)[name]), name
    assert hash_text(block.values["stimulus_sha256"][0]) == hashlib.sha256(STIMULUS).hexdigest()
    assert (block.stimulus, block.grade, block.signed) == (STIMULUS, Certificate.FULL, True)
    assert table.values.tobytes() == TABLE.values.tobytes()


def test_content_crc_is_that_of_the_table_as_built() -> None:
    """GIVEN a table as built WHEN certified THEN its content still has the CRC-32 that `table build` printed."""
    assert content_crc32(TABLE) == TABLE.crc32
    assert content_crc32(decode(certified(build_navigation("paper")))) == TABLE.crc32


def test_the_mac_is_hmac_sha256_of_the_whole_file_before_it() -> None:
    """The MAC read by hand from the end of the file and computed by the standard library from what precedes it."""
    image = certified(build_navigation("paper"))
    assert image[-36:-4] == hmac.new(KEY, image[:-36], hashlib.sha256).digest()


@pytest.mark.parametrize("place", [20, 52, 90, 1100, -60, -40])
def test_a_change_with_a_right_crc_is_refused_by_the_key(place: int) -> None:
    """GIVEN a signed table WHEN a byte of name, validity, payload, record or stimulus changes and the CRC is made right
    again THEN it is refused, by the certificate or by the HMAC."""
    image = bytearray(certified(build_navigation("paper"), issued_gps_ns=2**61 - 1))
    image[place] ^= 1
    try:
        table = decode(resealed(bytes(image)))
    except ValueError:
        return  # the table itself is out of range: refused even earlier
    with pytest.raises(CertificateRefused):
        open_certificate(table, KEY)


@pytest.mark.parametrize(
    ("image", "key", "said"),
    [
        (build_navigation("paper"), KEY, "carries no certificate"),
        (certified(build_navigation("paper"), None), KEY, "not signed"),
        (certified(build_navigation("paper"), b"another key, as long as it"), KEY, "HMAC of the certificate is wrong"),
    ],
)
def test_missing_unsigned_or_signed_by_another_is_refused(image: bytes, key: bytes, said: str) -> None:
    with pytest.raises(CertificateRefused, match=said):
        open_certificate(decode(image), key)


def test_without_a_key_nothing_is_authenticated() -> None:
    """GIVEN no key WHEN an unsigned or a foreign certificate is opened THEN it serves; no certificate is None."""
    assert open_certificate(TABLE, None) is None
    for key in (None, b"another key, as long as it"):
        block = open_certificate(decode(certified(build_navigation("paper"), key)), None)
        assert block is not None
        assert block.grade == Certificate.FULL


@pytest.mark.parametrize("key", [None, KEY])
def test_the_certificate_of_another_table_is_refused(key: bytes | None) -> None:
    """GIVEN a table that differs in one value WHEN it carries the certificate of the first THEN refused, both named."""
    stolen = decode(certified(build_navigation("paper"))).certificate
    thief = decode(encode(OTHER.kind, OTHER.set_name, OTHER.values, stolen))
    with pytest.raises(CertificateRefused, match=f"{TABLE.crc32:08x}.*{OTHER.crc32:08x}"):
        open_certificate(thief, key)


def test_a_grade_without_stimulus_or_evidence_is_refused() -> None:
    with pytest.raises(CertificateRefused, match="without a stimulus"):
        certified(build_navigation("paper"), stimulus=b"")
    for changes in ({"outages": 0, "violations": 0}, {"certified_age_s": 0.0}):
        with pytest.raises(CertificateRefused, match="certify again"):
            certified(build_navigation("paper"), **changes)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"grade": 3}, "grade"),
        ({"violations": 12_001}, "12001 violations"),
        ({"altitude_min_km": 1500.0}, "altitude_min_km"),
        ({"f107_min": 300.0}, "f107_min"),
        ({"certified_age_s": np.nan}, "certified_age_s"),
        ({"clopper_pearson_upper": 1.5}, "clopper_pearson_upper"),
    ],
)
def test_impossible_values_are_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(CertificateRefused, match=said):
        certified(build_navigation("paper"), **changes)


def test_a_block_cut_or_lengthened_is_refused() -> None:
    block = encode_block(record(TABLE), STIMULUS)
    decode_block(block)
    for length in range(len(block)):
        with pytest.raises(CertificateRefused):
            decode_block(block[:length])
    with pytest.raises(CertificateRefused):
        decode_block(block + b"\0")


@given(st.binary(max_size=600), st.booleans())
def test_no_bytes_raise_anything_but_refusal(raw: bytes, with_head: bool) -> None:
    """GIVEN any bytes, also behind a true head WHEN opened THEN CertificateRefused, nothing else."""
    with pytest.raises(CertificateRefused):
        decode_block(encode_block(record(TABLE))[:20] + raw if with_head else raw)


DOCUMENT: dict[str, Any] = {
    "grade": "quick",
    "table_crc32": f"{TABLE.crc32:08x}",
    "ensemble_sha256": "ab" * 32,
    "outages": 100,
    "violations": 0,
    "clopper_pearson_upper": 0.0296,
    "envelope": {
        "altitude_km": [350, 1400.0],
        "certified_age_s": 2000,
        "f107_min": 70,
        "f107_max": 200.5,
        "fix_sigma_min_m": 1,
        "fix_sigma_max_m": 5,
        "velocity_sigma_mps": [0.01, 0.05],
        "positions_alone": True,
        "convergence_s": 600,
        "burns": True,
        "limits_m": [50, 2000],
    },
    "cells": [{"altitude_km": [350, 450], "outages": 9}],
}


def written(folder: Path, document: Any) -> Path:
    path = folder / "certificate.json"
    path.write_text(json.dumps(document))
    return path


def test_certificate_json_is_read_liberally(tmp_path: Path) -> None:
    """GIVEN a certificate with its envelope in a section or flat, CRC as text or number WHEN read THEN the same."""
    flat = {**DOCUMENT, **DOCUMENT["envelope"], "table_crc32": TABLE.crc32, "ensemble_sha256": "sha256:" + "AB" * 32}
    del flat["envelope"]
    values = read_certificate(written(tmp_path, DOCUMENT))
    assert read_certificate(written(tmp_path, flat)).tobytes() == values.tobytes()
    one = values[0]
    assert (one["grade"], one["table_crc32"], one["burns"], one["attempt"]) == (1, TABLE.crc32, 1, 1)
    assert (one["altitude_min_km"], one["altitude_max_km"], one["f107_max"]) == (350.0, 1400.0, 200.5)
    assert one["limits_m"].tolist() == [50.0, 2000.0, 0.0, 0.0]
    assert hash_text(one["ensemble_sha256"]) == "ab" * 32


def test_certificate_json_of_ground_certify_is_read(tmp_path: Path) -> None:
    """GIVEN the names under which `ground certify` writes WHEN read THEN the same record; a full certification that
    missed a target is not signed."""
    made = {
        "grade": "quick",
        "certified": False,
        "table_crc32": f"{TABLE.crc32:08x}",
        "ensemble_sha256": "ab" * 32,
        "attempt": 1,
        "envelope": {
            "perigee_altitude_km": [350, 1000.0],
            "apogee_altitude_km": 1400.0,
            "age_s": 2000.0,
            "f107_sfu": [70.0, 200.5],
            "sigma_position_m": [1.0, 5.0],
            "sigma_velocity_mps": [0.01, 0.05],
            "positions_alone": True,
            "fixes_before_s": 600.0,
            "announced_burns_mps": [0.0, 0.5],
        },
        "summary": {"pooled": {"outages": 100, "violated": 0, "upper_limit_95": 0.0296}},
    }
    expected = read_certificate(written(tmp_path, DOCUMENT))
    expected["limits_m"] = 0.0
    assert read_certificate(written(tmp_path, made)).tobytes() == expected.tobytes()
    made["envelope"]["announced_burns_mps"] = [0.0, 0.0]  # type: ignore[index]
    assert read_certificate(written(tmp_path, made))["burns"][0] == 0
    with pytest.raises(OperatorError, match="missed tightness; a table that missed is not signed"):
        read_certificate(written(tmp_path, {**made, "grade": "full", "missed": ["tightness"]}))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"outages": None}, "outages: None is no whole number"),
        ({"outages": 1.5}, "outages: 1.5 is no whole number"),
        ({"grade": "best"}, "none of uncertified, quick, full"),
        ({"ensemble_sha256": "ab"}, "no SHA-256"),
        ({"table_crc32": "xyz"}, "no CRC-32"),
        ({"envelope": {}}, "altitude_min_km: missing"),
    ],
)
def test_a_bad_certificate_json_names_file_and_key(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    with pytest.raises(OperatorError, match=said) as caught:
        read_certificate(written(tmp_path, {**DOCUMENT, **change}))
    assert "certificate.json" in str(caught.value)


def test_sign_verify_show_and_diff_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN a table, its certificate and a key WHEN signed THEN verify says so, another key or table is refused."""
    table, other, key, wrong = (str(tmp_path / name) for name in ("a.tbl", "b.tbl", "key", "wrong"))
    document = str(written(tmp_path, DOCUMENT))
    (tmp_path / "stimulus").write_bytes(STIMULUS)
    assert main(["table", "build", "paper", "--out", table]) == 0
    assert main(["table", "build", "paper", "--set", "limit_m=1500", "--out", other]) == 0
    assert main(["table", "verify", table]) == 1
    assert "UNCERTIFIED" in capsys.readouterr().out
    for path in (key, wrong):
        assert main(["table", "key", path]) == 0
        assert Path(path).stat().st_mode & 0o077 == 0
    words = ["table", "sign", table, "--certificate", document, "--key", key]
    assert main(words) == 2
    assert "without a stimulus" in capsys.readouterr().err
    assert main([*words, "--stimulus", str(tmp_path / "stimulus")]) == 0
    assert main(["table", "sign", other, "--certificate", document, "--stimulus", str(tmp_path / "stimulus")]) == 2
    assert "is that of table" in capsys.readouterr().err
    assert main(["table", "verify", table, "--key", key]) == 0
    said = capsys.readouterr().out
    assert "QUICK" in said
    assert "HMAC         right" in said
    assert main(["table", "verify", table, "--key", wrong]) == 2
    assert "HMAC of the certificate is wrong" in capsys.readouterr().err
    assert main(["table", "show", table]) == 0
    said = capsys.readouterr().out
    assert "certified_age_s" in said
    assert f"{TABLE.crc32:08x}" in said
    assert main(["table", "diff", table, table]) == 0
    assert main(["table", "diff", table, other]) == 1
    said = capsys.readouterr().out
    assert "limit_m: 2000.0 | 1500.0 m" in said
    assert "certificate: QUICK" in said
    # signed once more, the table keeps its stimulus
    assert main(words) == 0


def test_a_key_in_use_is_not_replaced_and_a_short_one_not_taken(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "key"
    path.write_bytes(b"short\n")
    assert main(["table", "key", str(path)]) == 2
    assert "exists" in capsys.readouterr().err
    assert path.read_bytes() == b"short\n"
    assert main(["table", "build", "paper", "--out", str(tmp_path / "a.tbl")]) == 0
    assert main(["table", "verify", str(tmp_path / "a.tbl"), "--key", str(path)]) == 2
    assert "a key of 5 bytes" in capsys.readouterr().err
