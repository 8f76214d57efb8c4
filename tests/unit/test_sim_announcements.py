"""Burns, commands and position-only fixes on the bus: what frames say, when they come, and that an outage of GNSS or a
fault of the receiver leaves them alone."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest

from flightsw.icd import can_codec
from flightsw.icd.can_frames import ATTITUDE, BURN, GNSS_POSITION, GNSS_VELOCITY, LAYOUTS, NAV_COMMAND, TIME_SYNC
from flightsw.icd.enums import BurnFrame, EditMode, FixType, MeasurementType, NavCommand
from flightsw.icd.frame_layout import FrameLayout
from hil_sim import scenario
from hil_sim.evaluation import evaluate
from hil_sim.world import World, flown_burns

NS = 1_000_000_000
PLAIN = ("time.duration_s=120", "outage=[]")
TWO_BURNS = (
    "burn=["
    "{start_s=40.0, duration_s=10.0, dv_mps=[0.1, 1.0, -0.2], sigma_mps=[0.01, 0.02, 0.03], announce_lead_s=35.0},"
    '{start_s=60.0, duration_s=5.0, dv_mps=[0.0, -1.0, 0.0], frame="gcrf", announce_lead_s=58.0},'
    "{start_s=80.0, duration_s=5.0, dv_mps=[0.0, 0.5, 0.0], announce_lead_s=-3.0},"
    "{start_s=100.0, duration_s=5.0, dv_mps=[0.0, 0.05, 0.0], sigma_mps=[0.0, 0.001, 0.0], announced=false}"
    "]"
)
COMMANDS = (
    'command=[{at_s=50.0, command="reset_filter"}, {at_s=20.0, command="edit", target="velocity", value="inhibit"}]'
)
REPORTED = ("attitude.sigma_rad=0.001", "attitude.rate_hz=2")


def build(*settings: str) -> World:
    return World.build(scenario.load("two_orbits", [*PLAIN, *settings]))


def heard(world: World, layout: FrameLayout) -> tuple[np.ndarray, np.ndarray]:
    """Time of the tick [s] and record of every frame of a kind; each intact by its CRC."""
    ticks, payloads = [], []
    for k in range(world.n_ticks):
        for frame_id, payload in world.frames_due(k):
            if frame_id == layout.frame_id:
                assert can_codec.decode_into(layout, payload, bytearray(layout.length)) == can_codec.OK
                ticks.append((world.t_true_gps_ns[k] - world.t_start_gps_ns) / 1e9)
                payloads.append(payload)
    return np.array(ticks), np.frombuffer(b"".join(payloads), layout.dtype)


def test_burns_are_announced_as_commanded_and_flown_with_their_errors() -> None:
    """GIVEN four burns, one told late, one not at all THEN three frames, each at its time, in the order of being told;
    they hold the command, its sigma and the true times, and not the error of execution."""
    world = build(TWO_BURNS)
    at_s, frames = heard(world, BURN)
    assert at_s == pytest.approx([2.0, 5.0, 83.0], abs=0.1)
    assert frames["burn_id"].tolist() == [2, 1, 3]
    assert frames["counter"].tolist() == [0, 1, 2]
    assert frames["frame"].tolist() == [BurnFrame.GCRF, BurnFrame.RTN, BurnFrame.RTN]
    assert ((frames["t_start_gps_ns"] - world.t_start_gps_ns) / 1e9).tolist() == [60.0, 40.0, 80.0]
    assert (frames["duration_ns"] / 1e9).tolist() == [5.0, 10.0, 5.0]
    first = frames[1]
    assert [first[f"dv_{axis}_mps"] for axis in "xyz"] == [0.1, 1.0, -0.2]
    assert [first[f"sigma_{axis}_mps"] for axis in "xyz"] == pytest.approx([0.01, 0.02, 0.03], rel=1e-6)
    flown = flown_burns(world.loaded)
    assert flown[0].dv_mps != (0.1, 1.0, -0.2)
    assert flown[1].dv_mps == (0.0, -1.0, 0.0)
    assert flown[3].dv_mps[1] != 0.05
    assert flown_burns(scenario.load("two_orbits", [*PLAIN, TWO_BURNS, "seed=2"]))[0] != flown[0]


def test_the_truth_has_the_burns_and_the_announcement_does_not_change_it() -> None:
    """GIVEN 1 m/s along track THEN from then on the truth is another; told or not told, it is the same."""
    told = build("burn=[{start_s=40.0, duration_s=10.0, dv_mps=[0.0, 1.0, 0.0], announce_lead_s=30.0}]")
    untold = build("burn=[{start_s=40.0, duration_s=10.0, dv_mps=[0.0, 1.0, 0.0], announced=false}]")
    still = build()
    assert np.array_equal(told.r_true_gcrf_m, untold.r_true_gcrf_m)
    apart = np.linalg.norm(told.v_true_gcrf_mps - still.v_true_gcrf_mps, axis=1)
    after = told.t_true_gps_ns >= told.t_start_gps_ns + 50 * NS
    before = told.t_true_gps_ns < told.t_start_gps_ns + 40 * NS
    assert apart[before].max() < 1e-6
    assert apart[after] == pytest.approx(1.0, abs=0.1)
    assert len(heard(told, BURN)[0]) == 1
    assert len(heard(untold, BURN)[0]) == 0


def test_commands() -> None:
    at_s, frames = heard(build(COMMANDS), NAV_COMMAND)
    assert at_s == pytest.approx([20.0, 50.0], abs=0.1)
    assert frames["command"].tolist() == [NavCommand.EDIT, NavCommand.RESET_FILTER]
    assert frames["target"].tolist()[0] == MeasurementType.VELOCITY
    assert frames["value"].tolist()[0] == EditMode.INHIBIT
    assert frames["counter"].tolist() == [0, 1]


def test_a_receiver_without_velocity() -> None:
    """GIVEN gnss.velocity = false THEN positions of type POSITION_3D, no velocity frame; the positions are those of the
    same seed with velocity."""
    alone, whole = build("gnss.velocity=false"), build()
    _, positions = heard(alone, GNSS_POSITION)
    assert (positions["fix_type"] == FixType.POSITION_3D).all()
    assert len(heard(alone, GNSS_VELOCITY)[0]) == 0
    _, with_velocity = heard(whole, GNSS_POSITION)
    assert (with_velocity["fix_type"] == FixType.FIX_3D).all()
    for axis in "xyz":
        assert np.array_equal(positions[f"{axis}_itrf_m"], with_velocity[f"{axis}_itrf_m"])
    assert set(alone._ids) == {GNSS_POSITION.frame_id, TIME_SYNC.frame_id}


def test_an_outage_of_gnss_silences_the_receiver_alone() -> None:
    """GIVEN no GNSS from 0 to 120 s THEN announcements, attitudes and commands come as without the outage."""
    others = (TWO_BURNS, COMMANDS, *REPORTED)
    silent, plain = build("outage=[{start_s=0.0, duration_s=120.0}]", *others), build(*others)
    for layout in (BURN, ATTITUDE, NAV_COMMAND):
        quiet, loud = heard(silent, layout), heard(plain, layout)
        assert len(quiet[0]) > 1
        assert quiet[1].tobytes() == loud[1].tobytes()
        assert np.array_equal(quiet[0], loud[0])
    for layout in (TIME_SYNC, GNSS_POSITION, GNSS_VELOCITY):
        assert len(heard(silent, layout)[0]) == 0


def gnss_frames(world: World) -> list[tuple[int, bytes]]:
    ours = (TIME_SYNC.frame_id, GNSS_POSITION.frame_id, GNSS_VELOCITY.frame_id)
    return [(i, p) for i, p in zip(world._ids, world._payloads, strict=True) if i in ours]


def test_other_senders_do_not_change_what_befalls_the_receivers_frames() -> None:
    """GIVEN random drops and flipped bits WHEN attitude and commands are added THEN the same frames of the receiver are
    struck in the same bit; and those of the others are struck too."""
    fault = (
        'fault=[{kind="frame_drop", start_s=0.0, duration_s=120.0, probability=0.3},'
        '{kind="bit_flip", start_s=0.0, duration_s=120.0, probability=0.3}]'
    )
    plain, busy = build(fault), build(fault, COMMANDS, *REPORTED)
    assert gnss_frames(busy) == gnss_frames(plain)
    attitudes = [p for i, p in zip(busy._ids, busy._payloads, strict=True) if i == ATTITUDE.frame_id]
    assert 0.5 < len(attitudes) / 240 < 0.9
    damaged = sum(can_codec.decode_into(ATTITUDE, p, bytearray(32)) != can_codec.OK for p in attitudes)
    assert 0.15 < damaged / len(attitudes) < 0.45


@pytest.mark.parametrize("target", ["burn", "attitude", "command"])
def test_frames_of_one_other_sender_may_be_struck(target: str) -> None:
    """GIVEN that all its frames vanish THEN there is none of that kind, and every other frame."""
    others = (TWO_BURNS, COMMANDS, *REPORTED)
    fault = f'fault=[{{kind="frame_drop", start_s=0.0, duration_s=200.0, target="{target}"}}]'
    struck, plain = Counter(build(fault, *others)._ids), Counter(build(*others)._ids)
    gone = {"burn": BURN, "attitude": ATTITUDE, "command": NAV_COMMAND}[target].frame_id
    assert gone in plain
    del plain[gone]
    assert struck == plain


def test_a_run_with_burns_lists_them_and_one_without_does_not(tmp_path) -> None:
    """GIVEN burns THEN truth.npz holds them and the evaluation lists command, flown change and announcement; without
    burns both are as they were."""
    world = build(TWO_BURNS)
    world.save_truth(tmp_path / "truth.npz")
    with np.load(tmp_path / "truth.npz") as saved:
        truth = dict(saved)
    n = world.n_ticks
    monitor = {
        "tick": np.arange(n),
        "nav": np.zeros(n, LAYOUTS[0x200].dtype),
        "integrity": np.zeros(n, LAYOUTS[0x201].dtype),
    }
    listed = json.loads(json.dumps(evaluate(truth, monitor)))["burns"]
    assert [(b["start_s"], b["duration_s"], b["announced_s"], b["frame"]) for b in listed] == [
        (40.0, 10.0, 5.0, "rtn"),
        (60.0, 5.0, 2.0, "gcrf"),
        (80.0, 5.0, 83.0, "rtn"),
        (100.0, 5.0, None, "rtn"),
    ]
    assert listed[0]["dv_mps"] == [0.1, 1.0, -0.2]
    assert listed[0]["flown_dv_mps"] == pytest.approx(flown_burns(world.loaded)[0].dv_mps, abs=1e-9)
    plain = build()
    assert not [key for key in plain.truth_arrays() if key.startswith("burn")]
    assert "burns" not in evaluate(plain.truth_arrays(), monitor)


@pytest.mark.parametrize("name", ["burn_in_outage", "unannounced_burn"])
def test_shipped_worlds_with_burns(name: str) -> None:
    """GIVEN a scenario that ships THEN its world is built, its burn is in the truth, and is announced or is not."""
    world = World.build(scenario.load(name))
    (flown,) = flown_burns(world.loaded)
    burn = world.scenario.burn[0]
    frames = heard(world, BURN)[1]
    assert len(frames) == int(burn.announced) == (1 if name == "burn_in_outage" else 0)
    assert flown.dv_mps[1] == pytest.approx(burn.dv_mps[1], rel=0.1)
    still = World.build(scenario.load(name, ["burn=[]"]))
    apart = np.linalg.norm(world.r_true_gcrf_m - still.r_true_gcrf_m, axis=1)
    elapsed_s = (world.t_true_gps_ns - world.t_start_gps_ns) / 1e9
    assert apart[elapsed_s <= burn.start_s].max() < 1e-3
    # along track a burn runs away at three times its velocity change, on the mean of an orbit (Clohessy-Wiltshire)
    assert apart[-1] == pytest.approx(3.0 * flown.dv_mps[1] * (elapsed_s[-1] - burn.start_s), rel=0.5)
