"""The reproduction ledger: every row names a test that exists, and docs/ledger.md has exactly the rows of the code."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from ground.studies.ledger import ROWS, VERDICTS, Row

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.claim)
def test_every_row_names_a_test_that_exists(row: Row) -> None:
    """GIVEN a row WHEN its test is looked up THEN the file has a function of that name."""
    path, _, name = row.test.partition("::")
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    assert name.startswith("test_")
    assert name in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
    assert row.verdict in VERDICTS


def test_the_document_has_exactly_the_rows_of_the_code() -> None:
    """GIVEN docs/ledger.md WHEN its table is read THEN claims, places, figures, verdicts and tests are the code's, in
    order, and every line has a measurement."""
    text = (ROOT / "docs" / "ledger.md").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line.startswith("| ") and "](../" in line]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    found = [(claim, where, paper, verdict.strip("*"), test) for claim, where, paper, _, verdict, test in cells]
    assert [row[:4] for row in found] == [(row.claim, row.where, row.paper, row.verdict) for row in ROWS]
    tests = [re.fullmatch(r"\[`(\w+)`\]\(\.\./(.+)\)", row[4]) for row in found]
    assert [f"{test[2]}::{test[1]}" for test in tests if test] == [row.test for row in ROWS]
    assert all(cell[3] and "nan" not in cell[3] for cell in cells)


def test_the_document_counts_its_verdicts() -> None:
    """GIVEN docs/ledger.md WHEN its sum is read THEN it is that of the rows."""
    counts = ", ".join(f"{sum(row.verdict == verdict for row in ROWS)} {verdict}" for verdict in VERDICTS)
    assert f"\n{counts}.\n" in (ROOT / "docs" / "ledger.md").read_text(encoding="utf-8")
