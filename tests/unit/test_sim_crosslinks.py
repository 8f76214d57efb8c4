"""The crosslink terminal of the world: where the satellites are, what ranges mean, how frames are paced."""

from __future__ import annotations

import math
import tomllib
from functools import cache

import numpy as np
import pytest
from harness import load, tables

from flightsw.icd.can_frames import CROSSLINK_EPHEMERIS, CROSSLINK_RANGES
from hil_sim import scenario
from hil_sim.crosslinks import _Messages
from hil_sim.errors import ScenarioError
from hil_sim.world import World

LIGHT_MPS = 299_792_458.0
MU = 3.986004418e14
QUIET = ("crosslink_fault=[]", "crosslink.sigma_range_m=0", "crosslink.claimed_sigma_m=1")
EXACT = (*QUIET, "crosslink.ephemeris_sigma_m=[0,0,0,0]", "crosslink.ephemeris_rate_mps=[0,0,0,0]")


@cache
def world(*settings: str) -> World:
    return World.build(load("time.duration_s=12", *settings, name="crosslink_jump"))


def frames(built: World, layout: object) -> list[np.void]:
    """Records of all frames of a kind, in order of arrival."""
    return [
        np.frombuffer(payload, layout.dtype)[0]  # type: ignore[attr-defined]
        for k in range(built.n_ticks)
        for frame_id, payload in built.frames_due(k)
        if frame_id == layout.frame_id  # type: ignore[attr-defined]
    ]


def messages(built: World, second: int) -> dict[int, np.void]:
    t_ns = built.t_start_gps_ns + second * 10**9
    return {int(f["satellite"]): f for f in frames(built, CROSSLINK_EPHEMERIS) if f["t_ref_gps_ns"] == t_ns}


def position(record: np.void) -> np.ndarray:
    return np.array([record[f"{axis}_gcrf_m"] for axis in "xyz"])


def velocity(record: np.void) -> np.ndarray:
    return np.array([record[f"v{axis}_gcrf_mps"] for axis in "xyz"], dtype=float)


def test_the_flown_satellite_is_where_the_truth_is_and_the_others_are_in_its_pattern() -> None:
    """GIVEN messages without error THEN number 1 is the truth of the run; Walker 24/3/1: eight satellites 45 degrees
    apart in its plane, the other planes inclined alike with nodes 120 degrees apart and 15 degrees of phase."""
    built = world(*EXACT)
    said = messages(built, 5)
    truth, _ = built.truth.state_gcrf(np.array([built.t_start_gps_ns + 5 * 10**9], np.int64))
    assert position(said[0]) == pytest.approx(truth[0], abs=1e-6)

    def angle(one: np.ndarray, other: np.ndarray) -> float:
        return math.degrees(math.acos(one @ other / np.linalg.norm(one) / np.linalg.norm(other)))

    for k in range(7):
        assert angle(position(said[k]), position(said[k + 1])) == pytest.approx(45.0, abs=1e-4)
    normals = [np.cross(position(said[k]), velocity(said[k])) for k in (0, 8, 16)]
    nodes = [math.degrees(math.atan2(n[0], -n[1])) for n in normals]
    assert (nodes[1] - nodes[0]) % 360.0 == pytest.approx(120.0, abs=1e-3)
    assert (nodes[2] - nodes[1]) % 360.0 == pytest.approx(120.0, abs=1e-3)
    for plane, normal in enumerate(normals):
        assert angle(normal, np.array([0.0, 0.0, 1.0])) == pytest.approx(64.8, abs=1e-3)
        node = np.array([-normal[1], normal[0], 0.0])
        latitude = math.degrees(
            math.atan2(
                position(said[8 * plane]) @ np.cross(normal, node) / np.linalg.norm(normal),
                position(said[8 * plane]) @ node,
            )
        )
        mean_motion = math.degrees(math.sqrt(MU / 25_508_000.0**3))
        assert latitude == pytest.approx(52.0 + 15.0 * plane + 5.0 * mean_motion, abs=1e-3)


def test_a_range_is_the_way_of_the_signal_and_the_clocks() -> None:
    """GIVEN neither noise nor error WHEN the sender is put back along its orbit by the time that the range says the
    signal took THEN the distance to the receiver and the two clocks are the range, to a millimetre."""
    built = world(*EXACT)
    said = messages(built, 7)
    checked = 0
    for record in frames(built, CROSSLINK_RANGES):
        if record["t_gps_ns"] != built.t_start_gps_ns + 7 * 10**9:
            continue
        for place in range(1, 6):
            sender, receiver = int(record[f"sender_{place}"]), int(record["receiver"])
            if sender == 255:
                continue
            clocks = float(said[receiver]["clock_m"] - said[sender]["clock_m"])
            distance = float(record[f"range_{place}_m"]) - clocks
            tau = distance / LIGHT_MPS
            r, v = position(said[sender]), velocity(said[sender])
            angle = tau * np.linalg.norm(v) / np.linalg.norm(r)  # a circle: exact
            then = math.cos(angle) * r - math.sin(angle) * v * np.linalg.norm(r) / np.linalg.norm(v)
            assert np.linalg.norm(position(said[receiver]) - then) == pytest.approx(distance, abs=1e-3)
            assert abs(clocks) > 0.0
            checked += 1
    assert checked > 200


def test_frames_of_an_epoch_are_spread_below_the_drain_of_a_tick() -> None:
    """GIVEN 24 satellites that all range, and everything else on the bus THEN no tick has more frames than flight takes
    in one: half of it at most; an epoch's frames are over before the next begins."""
    built = world("crosslink_fault=[]")
    navigation, _ = tables(built.loaded)
    limit = int(navigation.values["drain_frames_max"][0])
    most = max(len(built.frames_due(k)) for k in range(built.n_ticks))
    assert most <= limit // 2
    total = {int(f["t_gps_ns"]): int(f["links_total"]) for f in frames(built, CROSSLINK_RANGES)}
    heard = dict.fromkeys(total, 0)
    for record in frames(built, CROSSLINK_RANGES):
        heard[int(record["t_gps_ns"])] += sum(int(record[f"sender_{place}"]) != 255 for place in range(1, 6))
    assert heard == total
    assert len(total) == 12


def test_healthy_errors_have_the_named_sigma_at_every_age() -> None:
    """GIVEN Table 2 WHEN errors are drawn for many uploads THEN their spread is that of the table at the start of an
    upload and half an hour later, and so is the spread of their rates."""
    link = scenario.load("crosslink_jump", ["crosslink.satellites=32", "crosslink.planes=4"]).scenario.crosslink
    assert link is not None
    said = _Messages(link, 400 * 1800.0, np.random.default_rng(3))
    t_s = np.arange(0.0, 399 * 1800.0, 450.0)
    errors = np.array([said.at(t)[0] for t in t_s])
    rates = np.array([said.at(t + 0.01)[0] for t in t_s]) - errors
    assert errors.std(axis=(0, 1))[:3] == pytest.approx((0.5, 3.5, 3.5), rel=0.03)
    assert np.quantile(np.abs(rates) / 0.01, 0.683, axis=(0, 1))[:3] == pytest.approx((0.0017, 2e-4, 2e-4), rel=0.03)
    assert (errors[:, :, 3] == 0.0).all()
    issues = np.array([said.at(t)[1] for t in t_s])
    assert (np.diff(issues, axis=0).sum(axis=0) >= 397).all()


def test_adding_crosslinks_leaves_the_receivers_noise_as_it_was() -> None:
    path = scenario.find("crosslink_jump")
    tree = tomllib.loads(path.read_text(encoding="utf-8"))
    tree["name"], tree["time"]["duration_s"] = "without", 12.0
    del tree["crosslink"], tree["crosslink_fault"]
    without = World.build(scenario.from_tree(tree, "without"))
    errors = [built.truth_arrays()["fix_error_m"] for built in (without, world("crosslink_fault=[]"))]
    assert np.array_equal(*errors)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (("crosslink.planes=5",), "no Walker pattern 24/5/1"),
        (("flight.functions={}",), "no flight function would hear it; set flight.functions.crosslink"),
        (("crosslink.own=25",), "25 is not one of 24"),
        (("crosslink.spread_s=1.0",), "an epoch would end after the next began"),
        (("crosslink.period_s=1.05",), "no whole number"),
        (("crosslink_fault.0.satellites=[0]",), "is none of them"),
        (("crosslink_fault.0.jump_m=[0,0,0,0]",), "does nothing"),
        (("crosslink_fault.0.start_s=500",), "starts after the run"),
        (("crosslink_fault.0.jump=[1,0,0,0]",), "did you mean 'jump_m'"),
    ],
)
def test_contradictions_are_refused_with_key_and_remedy(settings: tuple[str, ...], said: str) -> None:
    with pytest.raises(ScenarioError, match="crosslink") as refused:
        scenario.load("crosslink_jump", settings)
    assert said in str(refused.value)


def test_faults_without_a_constellation_are_refused() -> None:
    with pytest.raises(ScenarioError, match=r"add \[crosslink\]"):
        scenario.load("nominal", ["crosslink_fault=[{satellites=[1], start_s=1.0, jump_m=[1.0,0.0,0.0,0.0]}]"])
