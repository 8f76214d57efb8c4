"""Ensembles: what is drawn stays in its ranges and cells, depends on nothing but the run's number, and flies."""

from __future__ import annotations

from collections import Counter
from datetime import date, timedelta

import numpy as np
import pytest

from flightsw.icd.table_file import decode
from ground.campaign import cells, seeds
from ground.campaign.ensemble import EARTH_RADIUS_KM, Ensemble, draw
from ground.campaign.outage import Flight, ages_s, fly, forces_of
from ground.errors import OperatorError
from ground.tables.build import build_navigation
from ground.tables.forces import build_forces, read_space_weather
from hil_sim import scenario
from hil_sim.sensors.gnss_receiver import coloured_noise

ROOT = seeds.tuning(5)


@pytest.fixture(scope="module")
def drawn():
    return [draw(Ensemble(), ROOT, run, "flight") for run in range(360)]


def test_every_run_lies_in_its_cell_and_no_two_share_a_day(drawn) -> None:
    """GIVEN 360 runs WHEN drawn THEN each of the 12 cells has 30; perigee, and F10.7 of the day before as CelesTrak has
    it, lie within; days differ; the apogee stays below the ensemble's."""
    assert set(Counter(one.cell for one in drawn).values()) == {30}
    for one in drawn[::31]:
        cell, orbit = cells.CELLS[one.cell], one.tree["orbit"]
        a_km = orbit["semi_major_axis_m"] / 1e3
        assert cell.altitude_km[0] <= a_km * (1 - orbit["eccentricity"]) - EARTH_RADIUS_KM <= cell.altitude_km[1]
        assert a_km * (1 + orbit["eccentricity"]) - EARTH_RADIUS_KM <= 1450.001
        known = read_space_weather(one.weather.day)
        assert cell.f107_sfu[0] <= known.f107 < cell.f107_sfu[1]
        assert one.weather[1:] == pytest.approx(known)
        assert date.fromisoformat(one.tree["time"]["start"][:10]) == one.weather.day
    assert len({(one.cell, one.weather.day) for one in drawn}) == 360


def test_every_run_is_a_scenario_that_the_simulator_accepts(drawn) -> None:
    """GIVEN drawn trees WHEN validated as scenario files are THEN all pass, seeds differ, and some have a second outage
    or an announced burn."""
    loaded = [scenario.from_tree(dict(one.tree), one.where).scenario for one in drawn]
    assert len({one.seed for one in loaded}) == len(loaded)
    assert 20 < sum(len(one.outage) == 2 for one in loaded) < 100
    assert 10 < sum(len(one.burn) == 1 for one in loaded) < 80
    for one in loaded:
        assert one.truth.area_step is not None
        assert one.truth.area_step.at_s == one.outage[0].start_s
        assert 0.5 <= one.truth.area_step.factor <= 2.0
        assert one.gnss.latency_s < 0.6 <= float("0" + one.time.start[19:])  # a fix is taken on its own second


def test_a_run_depends_on_its_number_only() -> None:
    """GIVEN the same root WHEN run 17 is drawn alone, after others, or with other shares of burns THEN its orbit, day
    and noise are the same; another root draws another."""
    alone, again = draw(Ensemble(), ROOT, 17, "flight"), draw(Ensemble(), ROOT, 17, "flight")
    assert alone == again
    burning = draw(Ensemble(burn_share=1.0, second_share=0.0), ROOT, 17, "flight")
    assert burning.tree["orbit"] == alone.tree["orbit"]
    assert burning.tree["gnss"] == alone.tree["gnss"]
    assert len(burning.tree["burn"]) == 1
    assert draw(Ensemble(), seeds.tuning(6), 17, "flight").tree["orbit"] != alone.tree["orbit"]


def test_positions_alone_have_a_start_beside_their_acquisition(drawn) -> None:
    """GIVEN the runs THEN a quarter have receivers without velocity, whose fixes come for the start and for as long as
    others' besides."""
    alone = [one for one in drawn if one.drawn["positions_alone"]]
    assert 60 < len(alone) < 120
    assert all(one.tree["gnss"]["velocity"] is False and one.start_s == 62.0 for one in alone)
    assert min(one.acquisition_s for one in alone) == 122.0
    others = [one for one in drawn if not one.drawn["positions_alone"]]
    assert all(one.tree["gnss"].get("velocity", True) and one.start_s == 0.0 for one in others)
    assert min(one.acquisition_s for one in others) == 60.0
    assert min(one.drawn["sigma_position_m"] for one in drawn) < 0.6


def test_a_radio_burst_is_no_weather() -> None:
    """GIVEN the flux readings as published WHEN radio bursts are looked for THEN those that are known are found (939
    sfu on 7 March 2011, 707 on 9 September 2005), no day near one is flown, and a rise by the sun's rotation is none.
    """
    start = date(2003, 10, 1)
    rise = {start + timedelta(days=k): 100.0 * 1.15 ** min(k, 7) for k in range(20)}
    assert cells.bursts_of(rise) == frozenset()
    assert cells.bursts_of(rise | {start + timedelta(days=4): 400.0}) == {start + timedelta(days=4)}
    flown = {day.day for day in cells.weather()}
    for burst in (date(2011, 3, 7), date(2005, 9, 9)):
        assert not flown & {burst + timedelta(days=k) for k in (-2, -1, 0, 1)}
        assert {burst - timedelta(days=4), burst + timedelta(days=3)} <= flown | {date(2005, 9, 12)}
    assert max(day.f107 for day in cells.weather()) < 340.0
    assert 10_600 < len(flown) < 10_700


def test_the_force_table_of_a_run_is_that_of_its_day(drawn) -> None:
    """GIVEN a run WHEN its force table is made without reading the space weather again THEN it is, field by field, what
    `ground table forces` builds for that day and satellite."""
    one = drawn[11]
    usual = decode(build_forces({"area_to_mass_m2pkg": one.area_to_mass_m2pkg}, day=one.weather.day)).values
    mine = forces_of(one).values
    for name in usual.dtype.names or ():
        assert mine[name][0] == pytest.approx(usual[name][0], rel=1e-12), name


def test_the_days_are_real_and_measured() -> None:
    """GIVEN all days of the ensembles THEN every range of F10.7 has more than a thousand and all lie in it."""
    for flux in cells.F107_RANGES_SFU:
        days = cells.days_of(flux)
        assert len(days) > 1000
        assert all(flux[0] <= day.f107 < flux[1] for day in days)
    # the Halloween storms of 2003
    (storm,) = [day for day in cells.weather() if day.day == date(2003, 10, 29)]
    assert storm.f107 > 250.0
    assert storm.ap > 150.0
    assert storm.day - timedelta(days=1) in {day.day for day in cells.weather()}


def test_tuning_cannot_construct_what_certification_draws() -> None:
    """GIVEN a table, an ensemble and an attempt WHEN roots are made THEN each of the three changes it, it is beyond any
    of tuning, and even the same number would branch elsewhere."""
    image, ensemble = build_navigation("flight"), Ensemble().document()
    first = seeds.certification(image, ensemble, 1)
    others = (
        seeds.certification(build_navigation("flight", {"k_axis": 3.9}), ensemble, 1),
        seeds.certification(image, Ensemble(drag_error=0.2).document(), 1),
        seeds.certification(image, ensemble, 2),
    )
    assert len({first, *others}) == 4
    assert first == seeds.certification(image, ensemble, 1)
    assert first.entropy > 1 << 63
    assert first.of_run(3).spawn_key != seeds.Seeds(first.entropy, seeds.TUNING).of_run(3).spawn_key
    with pytest.raises(ValueError, match="seed"):
        seeds.tuning(first.entropy)
    with pytest.raises(ValueError, match="attempts"):
        seeds.certification(image, ensemble, 0)


def test_nonsense_is_refused() -> None:
    """GIVEN a noise or a cell that does not exist WHEN an ensemble is made THEN it is refused."""
    with pytest.raises(OperatorError, match="white"):
        Ensemble(noise="pink")
    with pytest.raises(OperatorError, match="cells"):
        Ensemble(cells=(12,))


SHORT = Ensemble(outage_s=(120.0, 120.0), acquisition_s=(60.0,), second_share=1.0, second_gap_s=(30.0, 31.0))


@pytest.mark.compiled
def test_a_run_flies_and_its_figures_agree_with_each_other() -> None:
    """GIVEN a minute of fixes, an outage of 120 s and a second one WHEN flown THEN errors and bounds are there for each
    age, the worst ratio is at least that of any age, and no fix of the acquisition was lost to the coarse tick."""
    ensemble = Ensemble(**{**SHORT.__dict__, "second_s": (60.0, 60.0)})
    figures = fly(Flight(ensemble, ROOT, "flight"), 3)
    ages = ages_s(120.0)
    assert figures["error_m"].shape == (len(ages), 3)
    assert np.isfinite(figures["error_m"]).all()
    assert figures["started"]
    assert figures["epochs"] in (120, 121)
    ratio = np.abs(figures["error_m"]).max(axis=1) / figures["bound_m"]
    assert figures["worst_ratio"] >= ratio.max()
    assert figures["violated"] == (figures["worst_ratio"] > 1.0)
    assert np.isfinite(figures["second_ratio"])
    assert figures["orbits"] > 0.0
    assert (np.diff(figures["bound_m"][-4:]) > 0.0).all()
    # k sigma, but no less than the bound of the last fix, which had its margin
    values = decode(build_navigation("flight")).values
    grown_m = float(values["k_axis"][0]) * figures["sigma_m"].max(axis=1)
    held_m = float(values["fixes_margin"][0]) * grown_m[0]
    bound_m = np.maximum(grown_m, held_m)
    assert (figures["bound_m"] > 0.98 * bound_m).all()
    assert (figures["bound_m"][:3] < 1.02 * bound_m[:3]).all()
    assert (figures["bound_m"] < 1.1 * bound_m).all()  # it is that of the later end of a step of ten seconds


@pytest.mark.compiled
def test_the_drag_of_the_truth_is_felt_where_it_must_be() -> None:
    """GIVEN a run at 350-450 km in a high Sun WHEN its cross-section doubles at the loss of GNSS, and when it does not
    THEN errors differ after 20 minutes, while all before the loss is the same to the bit."""
    cell = Ensemble(cells=(2,), outage_s=(1200.0, 1200.0), acquisition_s=(600.0,), second_share=0.0, burn_share=0.0)
    doubled, kept = (
        fly(Flight(Ensemble(**{**cell.__dict__, "area_step": (f, f)}), ROOT, "flight"), 0) for f in (2.0, 1.0)
    )
    assert doubled["nees_before"] == kept["nees_before"]
    assert np.abs(doubled["error_m"][0] - kept["error_m"][0]).max() < 1e-3
    assert np.abs(doubled["error_m"][-1] - kept["error_m"][-1]).max() > 0.5


def test_coloured_runs_have_coloured_fixes() -> None:
    """GIVEN the coloured ensemble WHEN a run is drawn THEN sigma and time of the lasting error are in the ranges, and
    its noise is as correlated as that says."""
    gnss = draw(Ensemble(noise="coloured"), ROOT, 4, "flight_coloured").tree["gnss"]
    assert 2.0 <= gnss["coloured_sigma_m"] <= 5.0
    assert 200.0 <= gnss["coloured_tau_s"] <= 450.0
    noise = coloured_noise(np.random.default_rng(1), 40_000, 1.0, gnss["coloured_sigma_m"], gnss["coloured_tau_s"])
    lag = round(gnss["coloured_tau_s"])
    correlation = np.mean(noise[lag:] * noise[:-lag]) / np.mean(noise**2)
    assert correlation == pytest.approx(np.exp(-1.0), abs=0.15)
