"""A certified table beside its set: it is what flies while the set is the one that was certified, and no longer."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from certificates import certified

from flightsw.icd.certificate import CERTIFICATE, open_certificate
from flightsw.icd.enums import Certificate
from flightsw.icd.table_file import decode
from flightsw.icd.table_saturation import saturation
from flightsw.kernels import registry
from flightsw.tables import stimulus
from ground.__main__ import main
from ground.errors import OperatorError
from ground.tables.build import SETS, build_navigation, list_sets
from ground.tables.certificate_file import read_certificate
from ground.tables.certified import SUFFIX, build_certified, keep_beside

CERTIFICATES = Path(__file__).resolve().parents[2] / "docs" / "certificates"


@pytest.fixture
def own_set(tmp_path: Path) -> Path:
    """A set of one's own."""
    return Path(shutil.copy(SETS / "flight.toml", tmp_path / "mine.toml"))


def test_a_certificate_beside_its_set_is_carried(own_set: Path, tmp_path: Path) -> None:
    """GIVEN a certificate beside its set WHEN tables are built THEN they carry it, and overridden ones do not."""
    bare = build_navigation(own_set)
    signed = certified(bare, key=None)
    assert keep_beside(signed, own_set) == own_set.with_suffix(SUFFIX)
    image, lacking = build_certified(own_set)
    assert lacking == ""
    block = open_certificate(decode(image), None)
    assert block is not None
    assert block.values["outages"][0] == 12_000
    assert build_navigation(own_set) == bare
    out = tmp_path / "t.tbl"
    assert main(["table", "build", str(own_set), "--out", str(out)]) == 0
    assert out.read_bytes() == image
    assert main(["table", "build", str(own_set), "--out", str(out), "--set", "limit_m=60"]) == 0
    assert not decode(out.read_bytes()).certificate


def test_a_set_changed_since_is_uncertified(own_set: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN a certificate beside its set WHEN the set is changed THEN its table has none, and the reason is said."""
    keep_beside(certified(build_navigation(own_set), key=None), own_set)
    own_set.write_text(own_set.read_text().replace("k_axis = 3.8", "k_axis = 3.7"))
    image, lacking = build_certified(own_set)
    assert image == build_navigation(own_set)
    assert "changed since it was certified" in lacking
    assert main(["table", "build", str(own_set), "--out", str(tmp_path / "t.tbl")]) == 0
    assert "not used" in capsys.readouterr().err


def test_a_damaged_certificate_is_not_carried(own_set: Path) -> None:
    """GIVEN a certified table with a byte flipped WHEN the table is built THEN it has none."""
    path = keep_beside(certified(build_navigation(own_set), key=None), own_set)
    held = bytearray(path.read_bytes())
    held[len(held) // 2] ^= 1
    path.write_bytes(held)
    assert build_certified(own_set)[0] == build_navigation(own_set)


def test_only_its_own_certificate_stands_beside_a_set(own_set: Path) -> None:
    """GIVEN a table of another set, or one without a certificate WHEN it is to stand beside THEN it is refused."""
    with pytest.raises(OperatorError, match="not the set that this table"):
        keep_beside(certified(build_navigation("j2"), key=None), own_set)
    with pytest.raises(OperatorError, match="carries no certificate"):
        keep_beside(build_navigation(own_set), own_set)


@pytest.mark.parametrize("name", list_sets())
def test_certificates_that_ship_are_those_of_their_sets(name: str) -> None:
    """GIVEN the sets that ship WHEN one has a certificate beside it THEN its table carries it."""
    image, lacking = build_certified(name)
    assert bool(decode(image).certificate) == (SETS / f"{name}{SUFFIX}").is_file()
    assert "not used" not in lacking


@pytest.mark.compiled
def test_set_flight_ships_certified_and_this_software_computes_what_was_certified() -> None:
    """GIVEN the set that ships certified WHEN its table is opened THEN it says what the published certificate says, of
    grade full and to a day; the kernels of this software answer its stimulus; the linter has nothing to say."""
    image, lacking = build_certified("flight")
    assert lacking == ""
    table = decode(image)
    block = open_certificate(table, None)
    assert block is not None
    published = read_certificate(CERTIFICATES / "flight-accf1d76.json")
    for field in CERTIFICATE.fields:
        if field.name not in ("issued_gps_ns", "stimulus_sha256"):
            assert (block.values[field.name] == published[field.name]).all(), field.name
    assert int(block.values["grade"][0]) == Certificate.FULL
    assert float(block.values["certified_age_s"][0]) == 86_400.0
    registry.warm_up()
    stimulus.check(block.stimulus, table.values)
    assert saturation(table.values, 86_400.0) == []
