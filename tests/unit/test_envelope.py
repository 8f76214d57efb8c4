"""The envelope of a certificate in flight: never trusted outside of it, and the certified age raises the flag."""

from __future__ import annotations

from typing import Any

import harness
import numpy as np
import pytest
from certificates import certified
from certificates import record as certificate
from flight_bench import (
    NS,
    circular_orbit,
    finish,
    loaded_memory,
    put_fixes,
    record,
    run,
    steady_calls,
    two_body,
)
from flight_filter_bench import fixes_every_second, fly, flying_memory, kepler
from harness import Flight, load

from flightsw.icd.alerts import AlertId
from flightsw.icd.can_frames import INTEGRITY, NAV_STATE
from flightsw.icd.enums import BurnFrame, FixType, FlagState, Governing, Mode, NavCommand, Uncovered, Validity, Verdict
from flightsw.icd.table_file import decode
from flightsw.memory import Memory
from flightsw.records import ENVELOPE
from ground.tables.build import build_navigation

ORBIT = circular_orbit(500e3)
WIDE = {
    "convergence_s": 20.0,
    "certified_age_s": 5000.0,
    "fix_sigma_max_m": 5.0,
    "velocity_sigma_max_mps": 5.0,
    "positions_alone": 0,
}


def truth(t_gps_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return two_body(ORBIT, t_gps_ns)


def memory_with(**changes: Any) -> Memory:
    """Set two_body of the bench, with a certificate that covers 500 km unless changed."""
    memory = loaded_memory("two_body", limit_m=1e5)
    values = certificate(decode(build_navigation("paper")), **{**WIDE, **changes})
    memory.load_envelope(values)
    return memory


def causes(memory: Memory, inputs: np.ndarray) -> list[tuple[int, int]]:
    """Verdict, and what is not covered."""
    return [(int(out.verdict), int(out.uncovered)) for out in run(memory, inputs)]


def flown(memory: Memory, inputs: np.ndarray) -> tuple[list[int], list[int]]:
    said = [(int(out.verdict), int(out.validity)) for out in run(memory, inputs)]
    return [verdict for verdict, _ in said], [validity for _, validity in said]


def test_the_record_takes_every_field_of_the_envelope() -> None:
    memory = memory_with(positions_alone=1)
    assert all(memory.table[name][0] != 0.0 for name in ENVELOPE)
    assert not memory.table.flags.writeable
    memory.load_envelope(None)
    assert all(memory.table[name][0] == 0.0 for name in ENVELOPE)


def test_trusted_only_after_convergence() -> None:
    """GIVEN a certificate for 20 s after the start and later WHEN fixes come THEN NOT_CERTIFIED and state not valid
    until then, TRUSTED and valid from then on."""
    memory = memory_with()
    verdicts, validity = flown(memory, steady_calls(60, truth))
    started = int(record(memory.nav).t_start_gps_ns)
    from flight_bench import T0_GPS_NS

    ready = (started - T0_GPS_NS) // NS + 20
    assert set(verdicts[ready - 10 : ready]) == {Verdict.NOT_CERTIFIED}
    assert set(verdicts[ready:]) == {Verdict.TRUSTED}
    assert not any(one & Validity.STATE_VALID for one in validity[:ready])
    assert all(one & Validity.STATE_VALID for one in validity[ready:])


@pytest.mark.parametrize(
    "outside",
    [
        {"altitude_min_km": 510.0},
        {"altitude_max_km": 490.0},
        {"fix_sigma_max_m": 0.9},
        {"fix_sigma_min_m": 1.1},
        {"velocity_sigma_max_mps": 0.9},
        {"velocity_sigma_min_mps": 1.1},
        {"velocity_sigma_max_mps": 0.0, "positions_alone": 1},
    ],
    ids=lambda outside: next(iter(outside)),
)
def test_never_trusted_outside_the_envelope(outside: dict[str, float]) -> None:
    """GIVEN 500 km and fixes that claim 1 m and 1 m/s WHEN the certificate covers something else THEN NOT_CERTIFIED
    throughout, with fixes and without, and the state is not valid; with a certificate that covers them, trusted."""
    inputs = steady_calls(90, truth, fix_stop_s=60)
    for changes, wanted in ((outside, {Verdict.NOT_CERTIFIED}), ({}, {Verdict.TRUSTED, Verdict.TRUSTED_COASTING})):
        verdicts, validity = flown(memory_with(**changes), inputs)
        assert set(verdicts[40:]) == wanted
        assert all(bool(one & Validity.STATE_VALID) is not bool(outside is changes) for one in validity[40:])


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({}, Uncovered.NOTHING),
        ({"altitude_max_km": 490.0}, Uncovered.HEIGHT),
        ({"fix_sigma_max_m": 0.9}, Uncovered.CONVERGENCE),
        ({"convergence_s": 1000.0}, Uncovered.CONVERGENCE),
    ],
)
def test_the_cause_is_told(changes: dict[str, float], cause: Uncovered) -> None:
    """GIVEN something that is not covered THEN it stands beside NOT_CERTIFIED, and nothing beside any other verdict."""
    told = causes(memory_with(**changes), steady_calls(60, truth))
    assert told[-1] == (Verdict.NOT_CERTIFIED if cause else Verdict.TRUSTED, cause)
    assert all((verdict == Verdict.NOT_CERTIFIED) == (why != Uncovered.NOTHING) for verdict, why in told)


def test_activity_is_that_of_the_force_table() -> None:
    """GIVEN the envelope's rule WHEN the force table's flux lies outside THEN not covered; if none flies, covered."""
    from flightsw.integrity import envelope

    memory = memory_with(f107_min=70.0, f107_max=150.0)
    finish(run(memory, steady_calls(60, truth)))
    nav, table = record(memory.nav), record(memory.table)
    now = int(nav.t_fix_gps_ns)
    fluxes = (0.0, 69.0, 70.0, 150.0, 151.0, np.nan)
    assert [envelope.uncovered(nav, table, flux, now) for flux in fluxes] == [
        *(Uncovered.NOTHING, Uncovered.ACTIVITY, Uncovered.NOTHING),
        *(Uncovered.NOTHING, Uncovered.ACTIVITY, Uncovered.ACTIVITY),
    ]


def test_the_certified_age_raises_the_flag_as_the_limit_does() -> None:
    """GIVEN a certificate for 40 s WHEN the outage is older THEN the flag is raised at the first step past 40 s, though
    the bound is far below the limit; it stays until fixes have cleared it by the table's rules."""
    memory = memory_with(certified_age_s=40.0)
    inputs = steady_calls(200, truth, fix_stop_s=60)
    put_fixes(inputs, slice(130, None), inputs["pulse_gps_ns"][130:], truth)
    rows = [
        (int(o.flag), int(o.verdict), int(o.mode), float(o.flag_age_s), float(o.bound_m)) for o in run(memory, inputs)
    ]
    raised = [k for k, row in enumerate(rows) if row[0] == FlagState.RAISED]
    assert raised[0] == 59 + 41
    assert rows[raised[0]][1:3] == (Verdict.DO_NOT_USE, Mode.FAILED)
    assert 40.0 <= rows[raised[0]][3] <= 41.0
    assert rows[raised[0]][4] < 1e5
    clear_fixes = int(memory.table["clear_fixes"][0])
    assert raised[-1] + 1 == 130 + clear_fixes - 1
    assert rows[-1][1] == Verdict.TRUSTED
    assert raised == list(range(raised[0], raised[-1] + 1))


def burn_at(inputs: np.ndarray, k: int) -> None:
    inputs["burn_present"][k], inputs["burn_id"][k], inputs["burn_frame"][k] = 1, 3, int(BurnFrame.RTN)
    inputs["burn_start_gps_ns"][k] = inputs["pulse_gps_ns"][k] + 5 * NS
    inputs["burn_duration_ns"][k] = 10 * NS
    inputs["burn_sigma_mps"][k] = 1e-4


def doubted_after(verdicts: list[int], first: int) -> list[int]:
    return [k for k, verdict in enumerate(verdicts) if verdict == Verdict.NOT_CERTIFIED and k >= first]


@pytest.mark.parametrize("claim", [{"fix_sigma_r_m": 0.4}, {"fix_sigma_r_m": 6.0}, {"fix_sigma_v_mps": 6.0}])
def test_fixes_that_are_not_covered_begin_convergence_anew(claim: dict[str, float]) -> None:
    """GIVEN ten fixes that claim something else than was certified WHEN covered ones follow THEN NOT_CERTIFIED from the
    first of them until 20 s after the last."""
    inputs = steady_calls(130, truth)
    for name, value in claim.items():
        inputs[name][60:70] = value
    verdicts, _ = flown(memory_with(), inputs)
    doubted = doubted_after(verdicts, 50)
    assert doubted == list(range(doubted[0], doubted[-1] + 1))
    assert doubted[0] in (60, 61)
    assert 88 <= doubted[-1] <= 91


def test_positions_alone_are_trusted_only_where_they_were_certified() -> None:
    """GIVEN the flight filter WHEN a receiver stops giving velocities THEN NOT_CERTIFIED while positions come alone and
    20 s on; WHEN the certificate is one of positions alone THEN it is the velocities that are not covered; WHEN of both
    THEN trusted throughout."""
    with_velocity = fixes_every_second(0, 200, kepler())
    with_velocity["fix_has_velocity"][100:150] = 0
    with_velocity["fix_type"][100:150] = int(FixType.POSITION_3D)
    for changes, trusted in (
        ({}, [(90, 100), (171, 200)]),
        ({"velocity_sigma_max_mps": 0.0, "positions_alone": 1}, [(121, 150)]),
        ({"positions_alone": 1}, [(90, 200)]),
    ):
        memory = flying_memory()
        bounds = {**WIDE, "fix_sigma_max_m": 20.0, **changes}
        memory.load_envelope(certificate(decode(build_navigation("flight")), **bounds))
        verdicts = fly(memory, with_velocity)["verdict"].tolist()
        for k, verdict in enumerate(verdicts[90:], 90):
            if any(first <= k < stop for first, stop in trusted):
                assert verdict == Verdict.TRUSTED
            elif not any(first - 2 <= k < stop + 2 for first, stop in trusted):
                assert verdict == Verdict.NOT_CERTIFIED


def wrong_by(inputs: np.ndarray, part: slice, metres: float) -> None:
    r, _ = truth(inputs["fix_gps_ns"][part])
    inputs["fix_r_itrf_m"][part] *= 1.0 + metres / np.linalg.norm(r, axis=1)[:, None]


def test_fixes_that_overrule_a_converged_state_are_for_the_operator_to_judge() -> None:
    """GIVEN a state that is trusted WHEN fixes a kilometre away agree with each other THEN it is replaced, the flag
    clears by the table's rules, and the verdict stays NOT_CERTIFIED through an outage and back, until the operator
    resets the filter: then it is trusted again after convergence."""
    inputs = steady_calls(320, truth)
    inputs["fix_present"][160:200] = 0
    wrong_by(inputs, slice(80, 320), 1000.0)
    inputs["command_present"][240] = 1
    inputs["command_id"][240] = int(NavCommand.RESET_FILTER)
    memory = memory_with()
    rows = [(int(o.verdict), int(o.flag), int(o.events), int(o.uncovered)) for o in run(memory, inputs)]
    restart = 1 << int(AlertId.REINITIALISED)
    overruled = next(k for k, row in enumerate(rows) if row[2] & restart)
    assert rows[overruled - 1][0] == Verdict.TRUSTED_COASTING
    cleared = next(k for k, row in enumerate(rows) if k > overruled and row[1] == FlagState.CLEAR)
    assert {row[0] for row in rows[cleared:240]} == {Verdict.NOT_CERTIFIED}
    assert {row[3] for row in rows[cleared:240]} == {Uncovered.OVERRULED}
    assert {row[0] for row in rows[overruled:cleared]} == {Verdict.DO_NOT_USE}
    assert {row[0] for row in rows[310:]} == {Verdict.TRUSTED}


def test_a_wrong_start_that_was_never_trusted_leaves_no_trace() -> None:
    """GIVEN a start from fixes a kilometre away WHEN ten agreeing ones replace it before it has converged THEN their
    state is trusted after convergence."""
    inputs = steady_calls(120, truth)
    wrong_by(inputs, slice(0, 12), 1000.0)
    memory = memory_with()
    rows = [(int(o.verdict), int(o.events)) for o in run(memory, inputs)]
    assert any(events & (1 << int(AlertId.REINITIALISED)) for _, events in rows)
    assert {verdict for verdict, _ in rows[80:]} == {Verdict.TRUSTED}


@pytest.mark.parametrize("covered", [True, False])
def test_a_burn_that_is_not_covered_begins_convergence_anew(covered: bool) -> None:
    """GIVEN a burn of 10 s from 65 s on, announced WHEN the certificate does not cover burns THEN NOT_CERTIFIED from
    its begin until 20 s after its end; WHEN it does THEN trusted throughout."""
    inputs = steady_calls(130, truth)
    burn_at(inputs, 60)
    verdicts, _ = flown(memory_with(burns=int(covered)), inputs)
    doubted = doubted_after(verdicts, 51)
    if covered:
        assert doubted == []
    else:
        assert doubted == list(range(doubted[0], doubted[-1] + 1))
        assert doubted[0] in (65, 66)
        assert 93 <= doubted[-1] <= 95


def test_the_time_to_flag_ends_at_the_certified_age() -> None:
    """GIVEN a certificate for 300 s and a limit that no bound reaches WHEN the time to flag is predicted THEN it is
    300 s after the last fix, and the certified age governs."""
    memory = memory_with(certified_age_s=300.0)
    inputs = steady_calls(60, truth)
    finish(run(memory, inputs))
    for _ in range(1000):
        memory.predict(int(inputs["counter_now_ns"][-1]), 10)
        if memory.ahead["valid"][0]:
            break
    assert memory.ahead["governing"][0] == Governing.CERTIFIED_AGE
    assert memory.ahead["t_flag_gps_ns"][0] - memory.nav["t_fix_gps_ns"][0] == 300 * NS


def published(flight: Flight, layout: Any, name: str) -> list[int]:
    place = layout.dtype.names.index(name)
    import struct

    return [
        struct.unpack(layout.struct_format, payload)[place]
        for _, frame_id, payload in flight.published
        if frame_id == layout.frame_id
    ]


@pytest.mark.parametrize("required", [False, True])
def test_an_uncertified_table_is_never_trusted_in_words(required: bool) -> None:
    """GIVEN a set without a certificate WHEN it flies THEN INTEGRITY never says TRUSTED but NOT_CERTIFIED; its state
    stays valid for those who fly it, unless flight was told to require a certificate."""
    with Flight(load('flight.table_set="paper"')) as flight:
        flight.loop.require_certificate = required
        flight.fly(until_s=20.0)
        verdicts = published(flight, INTEGRITY, "verdict")
        assert set(verdicts) == {Verdict.NOT_READY, Verdict.NOT_CERTIFIED}
        assert verdicts[-1] == Verdict.NOT_CERTIFIED
        valid = bool(published(flight, NAV_STATE, "validity")[-1] & Validity.STATE_VALID)
        assert valid is not required
        assert flight.out["verdict"][0] == Verdict.TRUSTED  # the step itself: what campaigns certify


def test_a_certified_table_is_trusted_within(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN the same set with a certificate that covers the scenario WHEN it flies THEN INTEGRITY says TRUSTED."""
    from flightsw.kernels import registry
    from flightsw.tables.stimulus import encode
    from ground.campaign.stimulus import make

    registry.warm_up()
    plain = build_navigation("paper")
    image = certified(plain, stimulus=encode(*make(decode(plain))), convergence_s=5.0)
    monkeypatch.setattr(harness, "build_navigation", lambda *_: image)
    with Flight(load('flight.table_set="paper"')) as flight:
        flight.fly(until_s=20.0)
        assert published(flight, INTEGRITY, "verdict")[-1] == Verdict.TRUSTED
        assert published(flight, INTEGRITY, "certificate")[-1] == 2
