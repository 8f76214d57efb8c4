"""From set files to navigation tables, and `ground table` on the command line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flightsw.icd.table_file import decode
from flightsw.icd.table_schema import NAVIGATION
from ground.__main__ import ROOMS, main
from ground.errors import OperatorError
from ground.tables.build import ROW_KEYS, build_navigation, list_sets


def values(name: str | Path, overrides: dict[str, Any] | None = None) -> np.void:
    return decode(build_navigation(name, overrides)).values[0]


ROW = """
[[tuning]]
sigma_fix_m = {sigma}
q_r_m2 = 1.0
q_v_m2ps2 = 0.01
q_a_m2ps4 = 1e-6
sigma_r_floor_m = 1.0
sigma_v_floor_mps = 1.0
bound_q_r_m2 = 26.1
bound_q_v_m2ps2 = 0.00423
bound_q_a_m2ps4 = 1.97e-7
bound_s_r_m = 2.01e4
bound_s_v_mps = 39.4
"""
EXAMPLE = (
    """name = "paper"
description = "two rows"
[loop]
nav_step_ns = 1_000_000_000
[dynamics]
gravity_model = "central"
[filter]
da_max_mps2 = 0.02
"""
    + ROW.format(sigma=1.0)
    + ROW.format(sigma=33.0)
    + """
[bound]
limit_m = 2000.0
"""
)


def edited(tmp_path: Path, old: str, new: str) -> Path:
    """The example with the first place of something changed."""
    assert old in EXAMPLE
    path = tmp_path / "mine.toml"
    path.write_text(EXAMPLE.replace(old, new, 1), encoding="utf-8")
    return path


@pytest.fixture
def example(tmp_path: Path) -> Path:
    return edited(tmp_path, "two rows", "two rows")


def test_every_shipped_set_builds_under_its_own_name() -> None:
    sets = list_sets()
    assert {"paper", "paper_table1", "j2"} <= set(sets)
    for name, description in sets.items():
        table = decode(build_navigation(name))
        assert (table.kind, table.set_name) == ("navigation", name)
        assert description


def test_the_papers_table_1_is_as_printed() -> None:
    """Table 1 of the paper: integrated (1, 0.01, 1e-6, 1, 1), autonomous (500, 0.05, 1e-6, 1000, 22)."""
    record = values("paper_table1")
    assert record["tuning_rows"] == 1
    keys = ("q_r_m2", "q_v_m2ps2", "q_a_m2ps4", "sigma_r_floor_m", "sigma_v_floor_mps")
    assert [record[f"tuning_{k}"][0] for k in keys] == [1.0, 0.01, 1e-6, 1.0, 1.0]
    keys = ("q_r_m2", "q_v_m2ps2", "q_a_m2ps4", "s_r_m", "s_v_mps")
    assert [record[f"tuning_bound_{k}"][0] for k in keys] == [500.0, 0.05, 1e-6, 1000.0, 22.0]
    assert (record["mu_m3ps2"], record["limit_m"], record["k_axis"]) == (3.9860044e14, 2000.0, 3.0)
    assert (record["gravity_model"], record["integrator"]) == (0, 0)


def test_what_a_set_leaves_out_takes_the_schemas_default() -> None:
    record = values("paper")
    for field in NAVIGATION.fields:
        if field.group in ("modes", "time", "telemetry", "fix"):
            assert record[field.name] == field.default, field.name


def test_words_and_numbers_mean_the_same() -> None:
    for word, number in (("J2", 1), ("j2", 1), ("central", 0)):
        assert values("paper", {"gravity_model": word})["gravity_model"] == number
        assert values("paper", {"dynamics.gravity_model": number})["gravity_model"] == number


def test_overrides_reach_field_cell_and_rows_and_mark_the_name(example: Path) -> None:
    """GIVEN overrides WHEN built THEN they hold, and the table no longer goes by the bare name of the set."""
    record = values(example, {"limit_m": 500, "tuning.1.bound_q_r_m2": np.float64(7.0)})
    assert record["limit_m"] == 500.0
    assert record["clear_limit_m"] == 250.0
    assert list(record["tuning_bound_q_r_m2"]) == [26.1, 7.0, 0.0, 0.0]
    row = dict.fromkeys(ROW_KEYS, 0.5) | {"bound_s_v_mps": 6}
    record = values(example, {"tuning": [row]})
    assert record["tuning_rows"] == 1
    assert record["tuning_bound_s_v_mps"][0] == 6.0
    assert decode(build_navigation("paper", {"limit_m": 500})).set_name == "paper*"
    assert decode(build_navigation("paper", {})).set_name == "paper"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("da_max_mps2 = 0.02", "da_max = 0.02", ["filter.da_max", 'did you mean "da_max_mps2"']),
        ("[filter]", "[fliter]", ["fliter", 'did you mean "filter"']),
        ("q_r_m2 = 1.0", 'q_r_m2 = "1.0"', ["tuning.0.q_r_m2", "not a number", "without quotes"]),
        ("q_r_m2 = 1.0", "q_r_m2 = true", ["tuning.0.q_r_m2", "not a number"]),
        ("q_r_m2 = 1.0", "q_r_m2 = [1.0]", ["tuning.0.q_r_m2", "not a number"]),
        ("q_r_m2 = 1.0", "q_r_m2 = -1.0", ["tuning.0.q_r_m2", "outside [0.0,"]),
        ("q_r_m2 = 1.0", "q_r_m2 = nan", ["tuning.0.q_r_m2", "nan is outside"]),
        ("q_r_m2 = 1.0", "q_r_m2 = inf", ["tuning.0.q_r_m2", "inf is outside"]),
        ("q_r_m2 = 1.0\n", "", ["tuning.0", "q_r_m2 missing"]),
        ("da_max_mps2 = 0.02", "limit_m = 1.0", ["filter.limit_m", "belongs to section [bound]"]),
        ("da_max_mps2 = 0.02", "tuning_q_r_m2 = 1.0", ["[[tuning]]"]),
        ("nav_step_ns = 1_000_000_000", "nav_step_ns = 1.0", ["loop.nav_step_ns", "not a whole number"]),
        ('gravity_model = "central"', 'gravity_model = "centre"', ['did you mean "central"']),
        ("bound_q_r_m2 = 26.1\n", "", ["tuning.0", "bound_q_r_m2 missing"]),
        ("q_r_m2 = 1.0", "q_rr_m2 = 1.0", ["tuning.0.q_rr_m2", 'did you mean "q_r_m2"']),
        ("sigma_fix_m = 33.0", "sigma_fix_m = 1.0", ["sigma_fix_m must rise"]),
        ("[[tuning]]", "[[tuning]]\n" * 4, ["5 rows; give 1 to 4"]),
        ("limit_m = 2000.0", "limit_m = 2000.0\nclear_limit_m = 2001.0", ["clear_limit_m", "exceeds limit_m"]),
        ('name = "paper"', "", ["name:", "give the set a name"]),
        ('name = "paper"', 'name = "an exceedingly long name of a set"', ["longer than 32"]),
        ('name = "paper"', "name = paper", ["not valid TOML"]),
        ("[bound]", "limit_m = 3\n[bound]", ["tuning.1.limit_m", "unknown key"]),
        ('description = "', 'remark = "', ["description"]),
    ],
)
def test_a_mistake_in_a_set_is_refused_with_file_key_and_remedy(
    tmp_path: Path, old: str, new: str, said: list[str]
) -> None:
    path = edited(tmp_path, old, new)
    with pytest.raises(OperatorError) as refused:
        build_navigation(path)
    for text in (str(path), *said):
        assert text in str(refused.value)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("limt_m", 1, 'did you mean "limit_m"'),
        ("bound.limt_m", 1, 'did you mean "limit_m"'),
        ("filter.limit_m", 1, "belongs to section [bound]"),
        ("limit_m", "far", "not a number"),
        ("tuning.2.q_r_m2", 1, "rows here: 0 to 1"),
        ("tuning.0", 1, "tuning.ROW.KEY"),
        ("tuning", 1, "[[tuning]]"),
        ("tuning", [], "0 rows"),
    ],
)
def test_a_mistake_in_an_override_names_the_override(example: Path, key: str, value: Any, said: str) -> None:
    with pytest.raises(OperatorError) as refused:
        build_navigation(example, {key: value})
    assert f"override {key}" in str(refused.value)
    assert said in str(refused.value)


def test_build_and_show_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN a set WHEN built with --set and shown THEN the binary says what was asked for."""
    out = tmp_path / "nav.tbl"
    assert main(["table", "build", "j2", "--out", str(out), "--set", "limit_m=50", "--set", "gravity_model=J2"]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["nav.tbl"]
    assert main(["table", "show", str(out)]) == 0
    said = capsys.readouterr().out
    assert "set          j2*" in said
    assert f"{decode(out.read_bytes()).crc32:08x}" in said
    for field in NAVIGATION.fields:
        assert field.name in said
    (limit,) = (line for line in said.splitlines() if line.startswith("limit_m"))
    assert limit.split()[1:3] == ["50.0", "m"]
    assert main(["table", "sets"]) == 0
    assert "paper_table1" in capsys.readouterr().out


def test_a_damaged_table_is_not_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = bytearray(build_navigation("paper"))
    image[100] ^= 4
    (tmp_path / "bad.tbl").write_bytes(image)
    assert main(["table", "show", str(tmp_path / "bad.tbl")]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "bad.tbl: refused: CRC-32 is wrong" in captured.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "the following arguments are required: COMMAND"),
        (["tabel"], 'did you mean "table"'),
        (["table"], "ACTION"),
        (["table", "build", "paper"], "--out"),
        (["table", "build", "papr", "--out", "x.tbl"], 'did you mean "paper"'),
        (["table", "build", "none.toml", "--out", "x.tbl"], "no such set file"),
        (["table", "build", "paper", "--out", "x.tbl", "--set", "limit_m"], "key=value"),
        (["table", "build", "paper", "--out", "x.tbl", "--set", "limit=1"], 'did you mean "limit_m"'),
        (["table", "build", "paper", "--out", "missing/x.tbl"], "cannot be written"),
        (["table", "show", "missing.tbl"], "cannot be read"),
        (["icd", "export"], "DIR"),
    ],
)
def test_an_operators_mistake_is_one_line_and_status_2(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        status = main(words)
    except SystemExit as exit_:  # argparse leaves this way
        status = int(exit_.code or 0)
    captured = capsys.readouterr()
    assert status == 2
    assert said in captured.err
    assert captured.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_help_imports_nothing_heavy() -> None:
    """GIVEN a new process WHEN `ground --help` runs THEN it names every room and imports none of the heavy."""
    program = (
        "import sys\nfrom ground.__main__ import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit as end:\n    assert end.code == 0\n"
        "heavy = {'numpy', 'numba', 'matplotlib', 'textual', 'cantools', 'erfa', 'pymavlink', 'satkit'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for name in ROOMS:
        assert name in done.stdout


def test_tables_need_no_compiler() -> None:
    """GIVEN a new process WHEN a table is built and shown THEN numba is not imported."""
    program = (
        "import sys\nfrom ground.tables import build, show, earth_orientation\n"
        "from flightsw.icd.table_file import decode\n"
        "show.render(decode(build.build_navigation('paper')))\n"
        "assert 'numba' not in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
