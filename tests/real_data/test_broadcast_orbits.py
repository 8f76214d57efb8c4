"""What satellites broadcast against where precise orbits have them; the station's check with broadcast orbits."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ground.__main__ import main
from ground.gnss.broadcast import Broadcast
from ground.gnss.ephemeris import LIGHT_MPS, Precise

pytestmark = pytest.mark.real_data
# medians [m] found with other software, data README of the station; GRGS's orbits are of the centre of mass
MEDIAN_M = {"G": 1.34, "E": 0.92, "R": 2.94}


def _files(real_data: Path) -> tuple[list[Path], Path]:
    folder = real_data / "static_esbc"
    return sorted(folder.glob("*_MN.rnx.gz")), folder / "GRG0MGXFIN_20201770000_01D_15M_ORB.SP3.gz"


def test_broadcast_orbits_are_metres_from_precise_ones(real_data: Path) -> None:
    """GIVEN a day of three constellations THEN medians are the known ones, clocks agree to metres, none is wild."""
    navigation, precise = _files(real_data)
    names = tuple(f"{system}{number:02d}" for system in "GER" for number in range(1, 37))
    sp3 = Precise(precise)
    t_ns = np.broadcast_to(sp3.t_ns[4:-4, None], (len(sp3.t_ns) - 8, len(names)))
    (r, clock), (r_precise, clock_precise) = Broadcast(navigation).states(names, t_ns), sp3.states(names, t_ns)
    apart = np.linalg.norm(r - r_precise, axis=2)
    offset = LIGHT_MPS * (clock - clock_precise)
    for system, median in MEDIAN_M.items():
        mine = np.array([name[0] == system for name in names])
        found, clocks = apart[:, mine], offset[:, mine]
        found = found[np.isfinite(found)]
        assert len(found) > 800
        assert np.median(found) == pytest.approx(median, abs=0.15)
        assert found.max() < 25.0
        scatter = clocks - np.nanmedian(clocks, axis=1)[:, None]  # less what the constellations' times are apart
        assert np.nanstd(scatter) < 2.5


@pytest.mark.compiled
def test_three_hours_of_a_station_with_broadcast_orbits(real_data: Path, tmp_path: Path) -> None:
    """GIVEN three hours at Esbjerg THEN every epoch is consistent, the mean is within 1 m, faults are found."""
    pytest.importorskip("georinex", reason="needs georinex: pip install 'leonav[rinex]'")
    navigation, _ = _files(real_data)
    observed = real_data / "static_esbc" / "ESBC00DNK_R_20201770000_0900-1200_30S_MO.trimmed.rnx.gz"
    words = ["gnss", "check", str(observed), "--nav", *map(str, navigation), "--offset-enu", "0.51", "0.56", "0.02"]
    assert main([*words, "--faults", "200", "--no-figures", "--out", str(tmp_path)]) == 0
    found = json.loads((tmp_path / "check.json").read_text(encoding="utf-8"))
    assert found["verdicts"] == {"CONSISTENT": 360}
    assert found["horizontal_mean_m"] < 1.0
    for one in found["injected"]:
        assert one["each_removed"]["rate"] >= 0.98
