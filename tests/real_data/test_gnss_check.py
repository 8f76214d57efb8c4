"""The consistency test on real pseudoranges of GPS, GLONASS and Galileo: a station whose place is known."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ground.__main__ import main

pytestmark = [pytest.mark.real_data, pytest.mark.compiled]


def test_three_hours_of_a_station(real_data: Path, tmp_path: Path) -> None:
    """GIVEN three hours at Esbjerg THEN every epoch is consistent, the mean is within 1 m, faults are found."""
    pytest.importorskip("georinex", reason="needs georinex: pip install 'leonav[rinex]'")
    folder = real_data / "static_esbc"
    status = main(
        [
            "gnss",
            "check",
            str(folder / "ESBC00DNK_R_20201770000_0900-1200_30S_MO.trimmed.rnx.gz"),
            "--sp3",
            str(folder / "GRG0MGXFIN_20201770000_01D_15M_ORB.SP3.gz"),
            *("--offset-enu", "0.51", "0.56", "0.02"),
            *("--faults", "200", "--out", str(tmp_path)),
        ]
    )
    found = json.loads((tmp_path / "check.json").read_text(encoding="utf-8"))
    assert status == 0
    assert found["epochs"] == 360
    assert set(found["verdicts"]) <= {"CONSISTENT", "EXCLUDED"}
    assert found["horizontal_mean_m"] < 1.0
    assert found["rows_excluded"] < 0.01 * found["rows"]
    assert found["biases_m"]["GLONASS"][0] == pytest.approx(-1.8, abs=1.0)
    assert found["biases_m"]["Galileo"][0] == pytest.approx(5.6, abs=1.0)
    for one in found["injected"]:
        assert one["each_removed"]["rate"] >= 0.98
