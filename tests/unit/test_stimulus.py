"""The stimulus of a certificate: through every mode, replayed to the bit, and what differs is found and named."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from certificates import certified
from hypothesis import given
from hypothesis import strategies as st

import flightsw.tables.stimulus as replayed
from flightsw import app
from flightsw.icd.certificate import open_certificate
from flightsw.icd.enums import FlagState, Mode
from flightsw.icd.table_file import TableImage, decode
from flightsw.kernels import registry
from flightsw.records import INPUT
from flightsw.tables.stimulus import STEPS_MAX, StimulusRefused, check, encode
from ground.__main__ import main
from ground.campaign.stimulus import make
from ground.errors import OperatorError
from ground.tables.build import build_navigation, list_sets


@cache
def made(name: str) -> tuple[TableImage, np.ndarray, np.ndarray]:
    registry.warm_up()
    table = decode(build_navigation(name))
    return (table, *make(table))


def bent(monkeypatch: pytest.MonkeyPatch, at: int, change: Any) -> None:
    """From now on the step, called for the `at`-th time, answers something else."""
    step, calls = replayed.step, [0]

    def wrong(*records: np.ndarray) -> None:
        step(*records)
        if calls[0] == at:
            change(records)
        calls[0] += 1

    monkeypatch.setattr(replayed, "step", wrong)


@pytest.mark.parametrize("name", list_sets())
def test_every_shipped_set_has_a_stimulus_through_every_mode(name: str) -> None:
    """GIVEN a shipped set WHEN its stimulus is made THEN at most 200 steps pass through all modes, a burn, the flag
    and back to service; the replay gives every bit again."""
    table, inputs, outputs = made(name)
    assert len(inputs) <= STEPS_MAX
    assert set(outputs["mode"].tolist()) == {int(mode) for mode in Mode}
    assert inputs["burn_present"].sum() == 1
    raised = np.flatnonzero(outputs["flag"] == FlagState.RAISED)
    assert 0 < raised[0] <= raised[-1] < len(outputs) - 1
    assert outputs["outage_age_s"].max() > 300.0
    assert check(encode(inputs, outputs), table.values)


@pytest.mark.parametrize(
    ("field", "factor"), [("r_gcrf_m", 1e-8), ("bound_m", 1e-8), ("covariance", 1e-7), ("v_gcrf_mps", 1e-8)]
)
def test_an_answer_that_is_off_by_1e_8_is_refused_by_step_and_field(
    monkeypatch: pytest.MonkeyPatch, field: str, factor: float
) -> None:
    """GIVEN a step that answers a little wrong once WHEN replayed THEN refused, saying at which step and field."""
    table, inputs, outputs = made("flight")
    bent(monkeypatch, 50, lambda records: np.multiply(records[-1][field], 1.0 + factor, out=records[-1][field]))
    with pytest.raises(StimulusRefused, match=f"step 50 of {len(inputs)}, {field}"):
        check(encode(inputs, outputs), table.values)


@pytest.mark.parametrize("name", ["flight", "paper"])
def test_a_state_that_is_off_shows_from_there_on(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """GIVEN a step that leaves a state 0.1 m off, as a wrong kernel would WHEN replayed THEN the next step is named."""
    table, inputs, outputs = made(name)

    def move(records: Any) -> None:
        records[0]["x"][0, 0] += 0.1

    bent(monkeypatch, 30, move)
    with pytest.raises(StimulusRefused, match="step 31 of"):
        check(encode(inputs, outputs), table.values)


def test_a_mode_that_differs_is_refused_and_rounding_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a whole number that differs by one THEN refused; a real one by 1e-12 THEN accepted, said to differ."""
    table, inputs, outputs = made("paper")
    raw = encode(inputs, outputs)
    with monkeypatch.context() as patch:
        bent(patch, 12, lambda records: np.multiply(records[-1]["r_gcrf_m"], 1 + 1e-12, out=records[-1]["r_gcrf_m"]))
        assert not check(raw, table.values)
    bent(monkeypatch, 12, lambda records: np.add(records[-1]["mode"], 1, out=records[-1]["mode"]))
    with pytest.raises(StimulusRefused, match=r"step 12 of .*, mode: 2.0 where 1.0"):
        check(raw, table.values)


def test_the_stimulus_of_another_table_is_refused() -> None:
    """GIVEN a stimulus WHEN replayed on another table THEN refused: it depends on the table in its first bound."""
    _, inputs, outputs = made("paper")
    with pytest.raises(StimulusRefused, match="was certified"):
        check(encode(inputs, outputs), made("j2")[0].values)


def test_a_later_version_may_have_more_fields_and_not_fewer(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a stimulus of records with fewer fields WHEN replayed THEN what is new is zero; one with a field that
    this software lacks is refused by its name."""
    table, inputs, outputs = made("paper")
    fewer_in = [name for name in INPUT.names or () if not name.startswith("attitude_")]
    fewer_out = ["r_gcrf_m", "bound_m", "mode", "covariance"]
    assert check(encode(inputs[fewer_in].copy(), outputs[fewer_out].copy()), table.values)
    more = np.zeros(len(inputs), [*INPUT.descr, ("moon_phase", "<f8")])
    for name in INPUT.names or ():
        more[name] = inputs[name]
    with pytest.raises(StimulusRefused, match="input moon_phase is not what this software has"):
        check(encode(more, outputs), table.values)


@given(st.binary(max_size=300), st.integers(0, 80))
def test_no_bytes_raise_anything_but_refusal(raw: bytes, kept: int) -> None:
    """GIVEN any bytes behind any part of a true head WHEN opened THEN StimulusRefused, nothing else."""
    with pytest.raises(StimulusRefused):
        replayed.decode(encode(*made("paper")[1:])[:kept] + raw)


def test_a_stimulus_that_inflates_without_end_is_refused() -> None:
    """GIVEN columns of a true head, replaced by ten megabytes of zeros deflated WHEN opened THEN refused."""
    import zlib

    raw = encode(*made("paper")[1:])
    (count,) = np.frombuffer(raw, "<u2", 1, 10)
    head = raw[: 16 + 36 * int(count)]
    with pytest.raises(StimulusRefused, match="length announced"):
        replayed.decode(head + zlib.compress(bytes(10_000_000)))


def test_a_table_that_cannot_show_every_mode_is_told(tmp_path: Path) -> None:
    table = decode(build_navigation("paper", {"clear_fixes": 5000}))
    with pytest.raises(OperatorError, match="the return to service"):
        make(table)


def test_preflight_replays_and_refuses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a certified table WHEN flight starts THEN it flies as certified; with a step that computes something else
    it does not start, and the reason is the stimulus."""
    import harness

    table, inputs, outputs = made("paper")
    image = certified(build_navigation("paper"), stimulus=encode(inputs, outputs))
    loaded = harness.load('flight.table_set="paper"')
    monkeypatch.setattr(harness, "build_navigation", lambda *_: image)
    with harness.Flight(loaded) as flight:
        assert flight.loop.certificate == 2
        flight.fly(until_s=1.0)
    bent(monkeypatch, 3, lambda records: np.add(records[-1]["alerts"], 1, out=records[-1]["alerts"]))
    with pytest.raises(app.PreflightFailed, match=r"stimulus: step 3 of \d+, alerts"):
        harness.Flight(loaded)
    del table, tmp_path


def test_the_command_writes_what_sign_attaches(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table, out = tmp_path / "a.tbl", tmp_path / "stimulus"
    assert main(["table", "build", "paper", "--out", str(table)]) == 0
    assert main(["stimulus", str(table), "--out", str(out)]) == 0
    assert "steps through every mode" in capsys.readouterr().out
    assert check(out.read_bytes(), made("paper")[0].values)
    signed = decode(certified(table.read_bytes(), stimulus=out.read_bytes()))
    block = open_certificate(signed, None)
    assert block is not None
    assert block.stimulus == out.read_bytes()
