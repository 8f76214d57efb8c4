"""The table of the inter-satellite monitor: built, refused, and what a monitor is made of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from flightsw.crosslink.setup import Settings
from flightsw.crosslink_function import settings_of
from flightsw.icd.table_checks import problems
from flightsw.icd.table_file import decode
from ground.__main__ import main
from ground.errors import OperatorError
from ground.tables.function_sets import SETS, build_function


def test_the_shipped_set_is_the_papers_constellation() -> None:
    """GIVEN the shipped set THEN the monitor is that of the studies: Table 2, 2e-7 an epoch, all pairs both ways."""
    table = decode(build_function("crosslink", "crosslink"))
    assert (table.kind, table.set_name) == ("crosslink", "crosslink")
    assert settings_of(table.values) == Settings(both=True)


def test_a_set_may_be_changed_and_says_so() -> None:
    table = decode(
        build_function("crosslink", "crosslink", overrides={"own": 3, "two_way": "yes", "onset_blocks": [-3, 7]})
    )
    settings = settings_of(table.values)
    assert (settings.own, settings.two_way, settings.onset_blocks) == (3, True, (-3, 7))
    assert table.set_name == "crosslink*"


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ({"own": 24}, "own = 24 is not below satellites = 24"),
        ({"faulty_max": 24}, "lower faulty_max"),
        ({"satellites": 33}, "outside"),
        ({"sigma_range": 10.0}, "sigma_range_m"),
        ({"onset_blocks": list(range(1, 12))}, "at most 10"),
        ({"onset_blocks": 4}, "give a list"),
        ({"gap_max_s": 0.5}, "epoch_s"),
        ({"sigma_range_m": "11.8"}, "is not a number"),
    ],
)
def test_what_no_monitor_can_be_built_from_is_refused(overrides: dict[str, object], said: str) -> None:
    with pytest.raises(OperatorError, match=said):
        build_function("crosslink", "crosslink", overrides=overrides)


def test_a_file_with_a_key_in_the_wrong_place_is_refused(tmp_path: Path) -> None:
    text = (SETS / "crosslink.toml").read_text(encoding="utf-8")
    bad = tmp_path / "bad.toml"
    bad.write_text(text.replace("[decision]", "[decision]\nown = 1"), encoding="utf-8")
    with pytest.raises(OperatorError, match=r"belongs to section \[constellation\]"):
        build_function("crosslink", bad)
    with pytest.raises(OperatorError, match="no set 'nobody' of kind crosslink"):
        build_function("crosslink", "nobody")


def test_flight_refuses_a_table_that_breaks_a_rule() -> None:
    table = decode(build_function("crosslink", "crosslink"))
    values = table.values.copy()
    values["own"] = 30
    assert problems("crosslink", values) == ["own = 30 is not below satellites = 24; lower own"]


def test_the_command_builds_and_shows_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "crosslink.tbl"
    assert main(["table", "build-function", "crosslink", "crosslink", "--out", str(out), "--set", "own=4"]) == 0
    assert main(["table", "show", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "kind         crosslink" in shown
    assert "-3 -12 4 7 10 16 24 36 54 80" in shown
