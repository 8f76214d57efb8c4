"""`ground accuracy step`: what it times is there, and what is wrong is named."""

from __future__ import annotations

import pytest

from ground.__main__ import main
from ground.accuracy import step_cost

pytest.importorskip("satkit")


@pytest.mark.compiled
def test_every_figure_is_a_time() -> None:
    """GIVEN a small field WHEN timed once THEN a second with a fix takes two calls and more than one without, and the
    line of the table says so."""
    (cost,) = step_cost.measure((8,), rounds=1)
    assert cost.degree == 8
    assert 1.9 < cost.calls < 2.1
    assert cost.fix_us == pytest.approx(cost.calls * cost.call_us)
    assert cost.mean_us > 0.0
    assert cost.satkit_us > 0.0
    assert 0.0 < cost.outage_us < cost.fix_us  # steps of ten seconds, no correction: a fifth of it
    assert step_cost.table([cost]).splitlines()[-1].split()[0] == "8"


def test_a_degree_that_is_none_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["accuracy", "step", "--degree", "1"]) == 2
    assert "give 2 to 120" in capsys.readouterr().err
