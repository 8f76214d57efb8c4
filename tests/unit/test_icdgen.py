"""Generated files are fresh, bad sources are refused with place and remedy, exports work alone."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from flightsw.icd import can_codec
from flightsw.icd.can_frames import LAYOUTS
from ground.__main__ import main
from ground.errors import OperatorError
from ground.icdgen.command import DBC, XML, generated
from ground.icdgen.dialect import render_mavlink
from ground.icdgen.frames import read_bus


def test_generated_files_are_fresh() -> None:
    """can_frames.py, mavlink.py and docs/icd.md are what their sources give now."""
    for path, text in generated().items():
        assert path.read_text(encoding="utf-8") == text, f"{path.name}: run `ground icd generate`, commit it"


def test_check_says_fresh_and_stale(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["icd", "generate", "--check"]) == 0
    real = generated()
    stale = {path: text + "\n" for path, text in real.items()}
    monkeypatch.setattr("ground.icdgen.command.generated", lambda: stale)
    capsys.readouterr()
    assert main(["icd", "generate", "--check"]) == 1
    assert capsys.readouterr().out.count("out of date; run `ground icd generate`") == len(real)
    assert all(path.read_text(encoding="utf-8") == text for path, text in real.items())


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("status : 168|8@1+", "status : 169|8@1+", "byte-aligned"),
        ("sigma_ns : 128|32@1- (1,0)", "sigma_ns : 128|32@1- (0.5,0)", "scaled signals"),
        ("status : 168|8@1+", "status : 168|6@1+", "use 8, 16, 32 or 64"),
        ("leap_seconds : 160|8@1-", "leap_seconds : 167|8@0-", "must be little-endian"),
        ('BA_ "VFrameFormat" BO_ 256 14;', 'BA_ "VFrameFormat" BO_ 256 0;', "VFrameFormat to 14"),
        ('BA_ "E2EDataId" BO_ 256 6709;', 'BA_ "E2EDataId" BO_ 256 11091;', "used twice"),
        ('BA_ "E2EDataId" BO_ 256 6709;', "", "give it a data id"),
        ("SG_ counter : 232|8@1+", "SG_ counter : 224|8@1+", "`counter` at byte 29"),
        ("SG_ crc : 240|16@1+", "SG_ checksum : 240|16@1+", "`crc` at byte 30"),
        ("BO_ 256 TIME_SYNC: 32 TIMING", "BO_ 256 TIME_SYNC: x TIMING", "not a readable DBC"),
    ],
)
def test_a_dbc_that_flight_cannot_pack_is_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    """GIVEN one thing wrong in the DBC WHEN generating THEN refused, naming the file and the remedy."""
    text = DBC.read_text(encoding="utf-8")
    assert text.count(old) >= 1
    bad = tmp_path / "bad.dbc"
    bad.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(OperatorError) as refused:
        read_bus(bad)
    assert said in str(refused.value)
    assert str(bad) in str(refused.value)


@pytest.mark.parametrize(
    ("old", "new"), [("</mavlink>", ""), ('type="double[3]"', 'type="quad[3]"'), ("<messages>", "<letters>")]
)
def test_an_xml_that_mavgen_refuses_names_the_file(tmp_path: Path, old: str, new: str) -> None:
    bad = tmp_path / "bad.xml"
    bad.write_text(XML.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
    with pytest.raises(OperatorError, match=r"bad\.xml"):
        render_mavlink(bad)


def test_export_stands_alone(tmp_path: Path) -> None:
    """GIVEN an export WHEN another Python without leonav imports it THEN it reads our frames, and cantools
    reads our candump text with the exported DBC."""
    assert main(["icd", "export", str(tmp_path)]) == 0
    lines = []
    for layout in LAYOUTS.values():
        buffer, view = can_codec.new_buffer(layout)
        view[layout.field_names[0]] = 123
        can_codec.seal(layout, buffer, 3)
        lines.append(f"(1230768000.123456) can0 {layout.frame_id:03X}##1{buffer.hex().upper()}")
    program = (
        "import sys; sys.path.insert(0, sys.argv[1]); import can_codec, can_frames, leonav\n"
        "for line in sys.stdin:\n"
        "    id, data = line.split()[2].split('##1')\n"
        "    layout = can_frames.LAYOUTS[int(id, 16)]\n"
        "    buffer, view = can_codec.new_buffer(layout)\n"
        "    assert can_codec.decode_into(layout, bytes.fromhex(data), buffer) == 0\n"
        "    print(view[layout.field_names[0]][0])\n"
    )
    # -I: neither the working directory nor PYTHONPATH; the editable install must not help either
    done = subprocess.run(
        [sys.executable, "-I", "-c", f"import sys; sys.modules['flightsw'] = None\n{program}", str(tmp_path)],
        input="\n".join(lines),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["123"] * len(LAYOUTS)

    decoded = subprocess.run(
        [sys.executable, "-m", "cantools", "decode", "--single-line", str(tmp_path / "sensor_bus.dbc")],
        input="\n".join(lines) + "\n",
        capture_output=True,
        text=True,
        check=False,
    )
    assert decoded.returncode == 0, decoded.stderr
    for layout in LAYOUTS.values():
        assert f":: {layout.name}({layout.field_names[0]}: 123" in decoded.stdout
