"""The world of pseudoranges: geometry against a plain computation, noise laws, faults, pace of the frames."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from harness import load

from flightsw.icd.can_frames import GNSS_EPHEMERIS, GNSS_EPOCH, GNSS_RANGES
from hil_sim import scenario
from hil_sim.errors import ScenarioError
from hil_sim.pseudorange_schema import LAWS
from hil_sim.pseudoranges.receiver import noise
from hil_sim.pseudoranges.sky import WALKERS
from hil_sim.world import World

LIGHT_MPS = 299_792_458.0
EXACT = ("pseudoranges.sigma_m=0", "pseudoranges.clock_walk_m=0", "satellite_fault=[]")


@cache
def world(*settings: str) -> World:
    return World.build(load("time.duration_s=60", *settings, name="gnss_faults"))


def test_a_range_is_the_way_of_the_light_and_two_clocks() -> None:
    """GIVEN ranges without noise THEN each is the distance from the satellite where the light left it, found here by
    bisection, plus the receiver's clock and delay, less the satellite's; what the frames say of the satellite gives it.
    """
    built = world(*EXACT)
    raw = built.raw
    assert raw is not None
    t0_ns, k = built.t_start_gps_ns, 30
    frames = [data for tick in range(310) for frame_id, data in built.frames_due(tick) if frame_id == 338]
    told = {}
    for record in np.frombuffer(b"".join(frames), GNSS_EPHEMERIS.dtype):
        told[int(record["constellation"]), int(record["satellite"])] = record
    biases = (0.0, -4.0, 2.7)
    receiver, _ = built.truth.state_gcrf(raw.t_true_gps_ns[k : k + 1])
    offset_s = (raw.t_gps_ns[k] - raw.t_true_gps_ns[k]) / 1e9
    assert abs(offset_s * LIGHT_MPS - 1000.0 - 31.0) < 1.0
    seen = np.flatnonzero(raw.seen[k])
    assert len(seen) >= 15
    for s in seen:
        system, number = int(raw.system[s]), int(raw.number[s])
        walker = WALKERS[("gps", "glonass", "galileo")[system]]

        def late(flight_s: float, w: object = walker, j: int = number) -> float:
            age_s = (int(raw.t_true_gps_ns[k]) - t0_ns) / 1e9 - flight_s
            there = w.states(age_s)[0][j - 1]  # type: ignore[attr-defined]
            return float(np.linalg.norm(there - receiver[0]) / LIGHT_MPS - flight_s)

        low, high = 0.05, 0.12
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if late(middle) > 0.0 else (low, middle)
        record = told[system, number]
        age_s = (int(raw.t_true_gps_ns[k]) - int(record["t_ref_gps_ns"])) / 1e9 - low
        clock_m = record["clock_m"] + record["clock_drift_mps"] * age_s
        expected = low * LIGHT_MPS + offset_s * LIGHT_MPS + biases[system] - clock_m
        assert raw.range_m[k, s] == pytest.approx(expected, abs=0.01)


def test_who_is_seen_stands_above_mask_and_limb() -> None:
    """GIVEN a mask below the horizon THEN satellites behind the Earth are not seen, and those above it all are."""
    built = world(*EXACT, "pseudoranges.mask_deg=-30")
    raw = built.raw
    assert raw is not None
    radius = np.linalg.norm(raw.r_true_gcrf_m, axis=1)[:, None]
    dip = np.arccos(6_428_137.0 / radius)
    assert (raw.seen == (raw.elevation_rad > -dip)).mean() > 0.999
    assert raw.seen.sum(axis=1).min() >= 30
    assert raw.elevation_rad[raw.seen].min() < math.radians(-20.0)


@pytest.mark.parametrize("law", LAWS)
def test_every_law_has_the_same_variance(law: str) -> None:
    """GIVEN a million draws THEN mean 0 and variance 1, each within 1.5 %; the tails differ."""
    drawn = noise(law, np.random.default_rng(1), (1000, 1000))
    assert abs(drawn.mean()) < 0.005
    assert drawn.var() == pytest.approx(1.0, abs=0.015)
    beyond = (np.abs(drawn) > 4.0).mean()
    assert (beyond == 0.0) == (law == "uniform")
    assert (beyond > 5e-4) == (law in ("laplace", "student", "spikes"))


def test_faults_strike_whom_they_name_and_nobody_else() -> None:
    """GIVEN faults of every kind THEN what is measured or told of these satellites changes, for that time only."""
    entries = (
        '{kind="step", constellation="gps", count=2, start_s=20.0, duration_s=10.0, value=50.0}',
        '{kind="ramp", constellation="galileo", start_s=20.0, duration_s=10.0, value=2.0}',
        '{kind="silent", constellation="glonass", satellites=[1, 2, 3, 4, 5, 6, 7], start_s=20.0, duration_s=10.0}',
        '{kind="sigma", constellation="glonass", start_s=40.0, duration_s=10.0, value=9.0}',
        '{kind="nan", constellation="glonass", count=1, start_s=40.0, duration_s=10.0}',
    )
    struck = world(*EXACT[:2], f"satellite_fault=[{', '.join(entries)}]").raw
    clean = world(*EXACT).raw
    assert struck is not None
    assert clean is not None
    age_s = (clean.t_true_gps_ns - world(*EXACT).t_start_gps_ns) / 1e9
    during, later = (age_s >= 20.0) & (age_s < 30.0), (age_s >= 40.0) & (age_s < 50.0)
    apart = struck.range_m - clean.range_m
    gps, glonass, galileo = (clean.system == k for k in range(3))
    assert np.count_nonzero(apart[during][0, gps]) == 2
    assert set(apart[during][:, gps].ravel()) == {0.0, 50.0}
    highest = np.argsort(-np.where(gps & clean.seen[during][0], clean.elevation_rad[during][0], -9.0))[:2]
    assert apart[during][0, highest].tolist() == [50.0, 50.0]
    np.testing.assert_allclose(apart[during][:, galileo], np.repeat(2.0 * (age_s[during, None] - 20.0), 24, axis=1))
    assert not struck.seen[np.ix_(during, glonass & (clean.number <= 7))].any()
    assert (struck.sigma_m[np.ix_(later, glonass)] == 9.0).all()
    assert np.isnan(apart[later]).any(axis=0).sum() == 1
    other = ~(during | later)
    assert not apart[other].any()
    assert (struck.seen[other] == clean.seen[other]).all()


def test_no_tick_is_flooded_and_every_epoch_is_whole() -> None:
    """GIVEN a sky of four constellations and a low mask THEN no tick has more frames than flight drains, every epoch's
    count is that of its rows, and the end comes last.
    """
    four = 'pseudoranges.constellations=["gps", "glonass", "galileo", "beidou"]'
    built = world(*EXACT, four, "pseudoranges.mask_deg=-20")
    rows: dict[int, int] = {}
    ends = 0
    for tick in range(built.n_ticks):
        frames = built.frames_due(tick)
        assert len(frames) <= 60
        for frame_id, data in frames:
            if frame_id == GNSS_RANGES.frame_id:
                record = np.frombuffer(data, GNSS_RANGES.dtype)[0]
                rows[int(record["t_gps_ns"])] = rows.get(int(record["t_gps_ns"]), 0) + int(record["count"])
            elif frame_id == GNSS_EPOCH.frame_id:
                record = np.frombuffer(data, GNSS_EPOCH.dtype)[0]
                assert rows.pop(int(record["t_gps_ns"])) == record["count"] >= 40
                ends += 1
    assert not rows
    assert ends == 59


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ('flight.functions.gnss="nothing"', None),
        ('pseudoranges.constellations=["gps", "qzss"]', "pseudoranges.constellations: 'qzss'"),
        ('pseudoranges.law="cauchy"', "pseudoranges.law"),
        ('satellite_fault=[{kind="step", start_s=1.0, duration_s=1.0}]', "satellite_fault.0.value"),
        ('satellite_fault=[{kind="nan", start_s=1.0, duration_s=1.0, value=1.0}]', "takes no value"),
        ('satellite_fault=[{kind="melt", start_s=1.0, duration_s=1.0}]', "no such fault"),
        ('satellite_fault=[{kind="nan", satellites=[1], start_s=1.0, duration_s=1.0}]', "belong to one constellation"),
    ],
)
def test_what_cannot_be_is_refused_by_key(setting: str, told: str | None) -> None:
    """GIVEN a scenario with one mistake THEN it is refused, and the key and the remedy are named."""
    settings = ["time.duration_s=60", "outage=[]", "satellite_fault=[]", setting]
    if told is None:
        flies = scenario.load("gnss_faults", settings).scenario.flight.functions
        assert flies["gnss"] == "nothing"  # the builder refuses it
        return
    with pytest.raises(ScenarioError, match=told.replace(".", r"\.").replace("'", ".")):
        scenario.load("gnss_faults", settings)


def test_pseudoranges_need_somebody_who_hears_them() -> None:
    with pytest.raises(ScenarioError, match="no flight function"):
        scenario.load("two_orbits", ["pseudoranges.sigma_m=1.0"])


def test_a_table_changed_is_one_that_flies() -> None:
    with pytest.raises(ScenarioError, match=r"function_table\.gnss: no such function flies; set flight"):
        scenario.load("two_orbits", ["flight.function_table.gnss={clear_epochs=6}"])
