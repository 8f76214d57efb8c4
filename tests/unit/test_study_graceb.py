"""`ground study graceb`: what its figures say, and when they fall short."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from ground.studies.graceb import VARIANTS, Found, Spread, as_document, table

SMALL = Spread(0.3, 0.6, 0.4, 1.0)
FOUND = Found(
    variant="positions",
    fixes=4308,
    raw_m=Spread(0.6, 1.8, 0.9, 7.5),
    started_s=70.0,
    filtered_m=SMALL,
    filtered_mps=Spread(5e-4, 9e-4, 6e-4, 1.4e-3),
    beyond_bound=0,
    epochs=350_999,
    gap_start_s=[8000.0 + 1000.0 * k for k in range(10)],
    gap_largest_m=[0.5] * 9 + [2.5],
    gap_worst_to_bound=[0.3] * 9 + [0.7],
    gap_m={"300": SMALL, "2000": SMALL},
)


def test_spread_of_errors() -> None:
    """GIVEN errors 1 to 100 WHEN spread THEN median, 95 %, root mean square and largest as by hand."""
    spread = Spread.of(np.arange(1.0, 101.0))
    assert (spread.median, spread.largest) == (50.5, 100.0)
    assert spread.q95 == pytest.approx(95.05)
    assert spread.rms == pytest.approx(np.sqrt(338350 / 100))


def test_figures_as_text_and_as_numbers() -> None:
    """GIVEN figures that meet what is asked WHEN printed and written THEN every one is there, and the goal is told."""
    text = table([FOUND])
    assert "4308 fixes, raw" in text
    assert "1.40 mm/s" in text
    assert "10 gaps of 2000 s" in text
    assert "largest within any gap 2.50 m, error / bound at most 0.70" in text
    assert "reached, the goal too" in text
    document = json.loads(json.dumps(as_document([FOUND])))
    assert document["variants"][0]["gap_m"]["2000"]["median"] == 0.3
    assert document["variants"][0]["shortfalls"] == []
    assert document["wanted"]["gap_largest_m"] == 10.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"filtered_m": Spread(1.4, 2.0, 1.5, 3.0)}, "MISSED: median 1.40 m with fixes, wanted 1.3 m"),
        ({"filtered_m": Spread(float("nan"), 2.0, 1.5, 3.0)}, "MISSED: median nan m"),
        ({"gap_largest_m": [0.5] * 9 + [11.0]}, "MISSED: 11.0 m in a gap, wanted 10 m"),
        ({"gap_largest_m": [0.5] * 9}, "MISSED: 9 gaps, wanted 10"),
        ({"filtered_m": Spread(1.1, 2.0, 1.5, 3.0)}, "reached, not the goal of 0.9 m"),
    ],
)
def test_what_is_missed_is_said(change: dict, said: str) -> None:
    assert said in table([dataclasses.replace(FOUND, **change)])


def test_variants_have_names_of_their_own() -> None:
    assert len({variant.name for variant in VARIANTS}) == len(VARIANTS) == 3
