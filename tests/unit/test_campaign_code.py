"""What code a certificate names: all that an outage is flown by, and nothing else."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from ground.campaign import code
from ground.campaign.certify import code_hash


def test_all_that_an_outage_loads_is_named() -> None:
    """GIVEN a fresh interpreter that imports what flies outages WHEN asked what of this project it has loaded THEN
    nothing that the sources do not name, but for what numba loads to know where its cache lies."""
    for module in ("ground.campaign.outage", "ground.campaign.endurance"):
        told = subprocess.run(
            [sys.executable, "-c", f"import sys, {module}; print(*sys.modules)"],
            capture_output=True,
            text=True,
            check=True,
        ).stdout.split()
        ours = {name for name in told if name.partition(".")[0] in ("flightsw", "ground", "hil_sim")}
        assert len(ours) > 50
        assert ours - {"flightsw.kernels.cache_locator"} <= set(code.imported_by(module))


def test_other_rooms_are_not() -> None:
    """GIVEN the code of an outage THEN navigation, bound, world and ensemble are in it; the link, the console and other
    flight functions are not."""
    named = set(code.imported_by("ground.campaign.outage"))
    assert {"flightsw.nav.step", "flightsw.integrity.bound", "flightsw.kernels.gravity", "flightsw"} <= named
    assert {"hil_sim.truth.propagated", "ground.campaign.ensemble", "ground.campaign.cells"} <= named
    for room in ("flightsw.link", "flightsw.crosslink", "flightsw.gnss", "flightsw.derivative", "ground.console"):
        assert not any(name == room or name.startswith(room + ".") for name in named)


def test_a_change_in_any_of_it_changes_the_hash(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a tree of three modules WHEN one that is imported through another changes THEN the hash does; WHEN one that
    nobody imports does THEN not."""
    for name, text in (("nav", "from flightsw import frames\n"), ("frames", "X = 1\n"), ("link", "Y = 1\n")):
        (tmp_path / "flightsw").mkdir(exist_ok=True)
        (tmp_path / "flightsw" / f"{name}.py").write_text(text)
    (tmp_path / "flightsw" / "__init__.py").touch()
    monkeypatch.setattr(code, "_ROOT", tmp_path)

    def hashed() -> str:
        code.hash_of.cache_clear()
        return code.hash_of("flightsw.nav")

    try:
        first = hashed()
        (tmp_path / "flightsw" / "link.py").write_text("Y = 2\n")
        assert hashed() == first
        (tmp_path / "flightsw" / "frames.py").write_text("X = 2\n")
        assert hashed() != first
        with pytest.raises(LookupError, match="nothing: no module"):
            code.hash_of("flightsw.nothing")
    finally:
        code.hash_of.cache_clear()


def test_long_outages_name_what_flies_them_too() -> None:
    """GIVEN both kinds of campaigns THEN their hashes differ, and neither depends on what is loaded already."""
    assert code_hash() != code_hash(long=True)
    assert "ground.campaign.endurance" not in code.imported_by("ground.campaign.outage")
    assert set(code.imported_by("ground.campaign.outage")) < set(code.imported_by("ground.campaign.endurance"))
