"""A certification: what it counts, what it calls full, that no attempt is forgotten; and one that is really flown."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from ground import __main__ as ground_command
from ground.campaign import attempts, certificate, certify, endurance, floor, pictures, report, seeds, store
from ground.campaign.ensemble import Ensemble, draw
from ground.campaign.outage import ages_s
from ground.errors import OperatorError
from ground.tables.build import SETS, build_navigation

AGES = ages_s(2000.0)
ENSEMBLE = Ensemble()


def figures(runs: int, errors: float = 0.25) -> dict[str, np.ndarray]:
    """Outages made up: bound 10 m + 0.05 m/s, error a share of it on x, nothing broken."""
    bound = 10.0 + 0.05 * AGES * np.ones((runs, 1))
    error = np.zeros((runs, len(AGES), 3))
    error[:, :, 0] = -errors * bound
    found = {
        "run": np.arange(runs),
        "cell": np.arange(runs) % 12,
        "started": np.ones(runs, bool),
        "error_m": error,
        "bound_m": bound,
        "bound_3d_m": bound,
        "violated": np.zeros(runs, bool),
        "violated_before_flag": np.zeros(runs, bool),
        "worst_ratio": np.full(runs, errors),
        "worst_3d_ratio": np.full(runs, errors),
        "epochs": np.full(runs, 2000),
        "broken_epochs": np.zeros(runs, int),
        "crossing_error_s": np.full((runs, 2), np.nan),
        "crossing_bound_s": np.tile([800.0, np.nan], (runs, 1)),
        "orbits": np.full(runs, 0.5),
        "integrated_broken": np.zeros(runs, int),
        "integrated_ratio": np.full(runs, 0.3),
        "second_outage": np.zeros(runs),
        "second_violated": np.zeros(runs, bool),
        "second_ratio": np.full(runs, np.nan),
        "return_ratio": np.full(runs, np.nan),
        "burns": np.zeros(runs),
        "positions_alone": np.zeros(runs),
        "sigma_position_m": np.full(runs, 5.0),
        "start_s": np.zeros(runs),
        "nees_before": np.full(runs, 6.0),
        "outage_s": np.full(runs, 2000.0),
        "acquisition_s": np.full(runs, 6000.0),
    }
    drawn = [draw(ENSEMBLE, seeds.tuning(1), run, "flight").drawn for run in range(12)]
    for name in ("perigee_km", "eccentricity", "argument_of_latitude_deg", "f107", "ap", "day"):
        found[name] = np.array([drawn[run % 12][name] for run in range(runs)])
    return found


def test_what_is_counted_is_what_was_put_in() -> None:
    """GIVEN 2400 outages whose error is a quarter of the bound, three of them broken in one cell, one with a late flag
    WHEN summed up THEN violations, limits, tightness, hazard and cells say just that."""
    made = figures(2400)
    broken = np.flatnonzero(made["cell"] == 4)[:3]
    made["violated"][broken] = True
    made["worst_ratio"][broken] = 1.2
    made["broken_epochs"][broken] = 7
    made["crossing_error_s"][5, 0] = 700.0  # before its bound, at 800 s
    summary = certificate.summarise(ENSEMBLE, made)
    pooled, cells = summary["pooled"], summary["cells"]
    assert (pooled["outages"], pooled["violated"], pooled["misleading_epochs"]) == (2400, 3, 21)
    assert [cell["violated"] for cell in cells] == [0, 0, 0, 0, 3, 0, 0, 0, 0, 0, 0, 0]
    assert pooled["upper_limit_95"] == pytest.approx(0.003228, abs=2e-5)  # 2583 would do for 0.003
    assert cells[0]["upper_limit_95"] == pytest.approx(1.0 - 0.05 ** (1 / 200))
    assert set(pooled["tightness"].values()) == {4.0}
    at_50 = pooled["limits"]["50"]
    assert (at_50["hazardous"], at_50["flags"], at_50["early_flags"]) == (1, 2400, 2399)
    # 0.25 (10 + 0.05 t) never is 50 m within 2000 s
    assert at_50["t_s"] is None
    assert pooled["limits"]["2000"]["t_flag_median_s"] is None
    judged = {line.what: line for line in certificate.judge(summary)}
    assert judged["violated outages, all cells, 95 % limit"].met is False
    assert judged["mean tightness, 350-450 km, F10.7 < 100"].met is False
    assert judged["median T_flag / T at 50 m, 350-450 km, F10.7 < 100"].met is None


def test_kinds_of_fixes_are_counted_apart() -> None:
    """GIVEN 2400 outages, every fourth with positions alone, every third of them fine, two of those broken, one with
    fixes WHEN summed up THEN each kind that was flown has its own counts, and together they are all."""
    made = figures(2400)
    made["positions_alone"][::4] = 1.0
    made["sigma_position_m"][::12] = 0.7
    made["violated"][[12, 24]] = True
    made["integrated_broken"][36] = 5
    kinds = certificate.summarise(ENSEMBLE, made)["fixes"]
    assert [(one["kind"], one["outages"], one["violated"]) for one in kinds] == [
        ("with velocity, 2 m and more", 1800, 0),
        ("positions alone, below 2 m", 200, 2),
        ("positions alone, 2 m and more", 400, 0),
    ]
    assert [one["integrated"]["violated"] for one in kinds] == [0, 1, 0]


def test_time_to_flag_is_measured_where_both_are_reached() -> None:
    """GIVEN errors of 0.8 of the bound WHEN the limit is 50 m THEN T is where 0.8 (10 + 0.05 t) reaches it, to the age
    kept, and the flag comes at 800 s: 0.76 of it."""
    at_50 = certificate.summarise(ENSEMBLE, figures(24, 0.8))["pooled"]["limits"]["50"]
    assert 1050.0 < at_50["t_s"] <= 1150.0
    assert at_50["t_flag_over_t"] == pytest.approx(800.0 / at_50["t_s"])


def test_time_to_flag_is_that_of_settled_runs() -> None:
    """GIVEN runs of which half had a minute of fixes and huge errors WHEN the time to flag is measured THEN it is that
    of the others, while hazards are counted in all."""
    mixed = figures(48, 0.8)
    mixed["acquisition_s"][24:] = 60.0
    mixed["error_m"][24:] *= 10.0
    mixed["crossing_error_s"][24:, 0] = 20.0
    at_50 = certificate.summarise(ENSEMBLE, mixed)["pooled"]["limits"]["50"]
    alone = certificate.summarise(ENSEMBLE, figures(24, 0.8))["pooled"]["limits"]["50"]
    assert at_50["t_flag_over_t"] == alone["t_flag_over_t"]
    assert at_50["hazardous"] == 24


def test_a_run_without_a_state_is_no_outage_but_is_counted() -> None:
    """GIVEN runs that had no state when GNSS was lost WHEN summed up THEN they are no trials, and said."""
    made = figures(24)
    made["started"][:2] = False
    pooled = certificate.summarise(ENSEMBLE, made)["pooled"]
    assert (pooled["outages"], pooled["not_started"]) == (22, 2)


def test_empty_bins_of_coverage_are_said() -> None:
    """GIVEN outages that all begin after 6000 s of fixes WHEN coverage is counted THEN all other lengths are empty."""
    part = certificate.coverage(ENSEMBLE, figures(24))["fixes before [s]"]
    assert part["counts"]["1801-7200"] == 24
    assert len(part["empty"]) == 5


def test_full_needs_a_thousand_in_every_cell() -> None:
    """GIVEN counts WHEN graded THEN only twelve cells of a thousand and no --quick make it full."""
    assert certificate.grade_of(ENSEMBLE, [1000] * 12, False) == "full"
    assert certificate.grade_of(ENSEMBLE, [1000] * 12, True) == "quick"
    assert certificate.grade_of(ENSEMBLE, [1100] * 11 + [999], False) == "quick"
    assert certificate.grade_of(Ensemble(cells=(0,)), [12_000], False) == "quick"


def test_the_floor_is_that_of_a_covariance_known_perfectly() -> None:
    """GIVEN errors drawn from their own covariance WHEN the factor is sought that 0.3 % of 2000 s outages break THEN it
    is more than 3 (where 0.5 to 0.8 % would break it), less than 3.6, and leaves 1.05 to 1.3 at a single age."""
    lowest = floor.floor(500.0, 2000.0)
    assert 3.05 < lowest.k < 3.6
    assert 1.03 < lowest.over(60.0, 2001.0) < 1.3


def test_no_attempt_is_forgotten(tmp_path: Path) -> None:
    """GIVEN an attempt that was begun WHEN the same is asked THEN it goes on; another table abandons it; a finished one
    is flown anew only on request; all stay in the ledger."""
    assert attempts.begin(tmp_path, {"table": "a"})["attempt"] == 1
    assert attempts.begin(tmp_path, {"table": "a"})["attempt"] == 1
    assert attempts.begin(tmp_path, {"table": "b"})["attempt"] == 2
    attempts.finish(tmp_path, 2, {"violated": 3})
    assert attempts.begin(tmp_path, {"table": "b"})["attempt"] == 2
    assert attempts.begin(tmp_path, {"table": "b"}, again=True)["attempt"] == 3
    states = [(one["attempt"], one["state"]) for one in attempts.read(tmp_path)]
    assert states == [(1, "abandoned"), (2, "finished"), (3, "begun")]
    (tmp_path / attempts.LEDGER).write_text("{}")
    with pytest.raises(OperatorError, match="never forgotten"):
        attempts.begin(tmp_path, {"table": "c"})


@pytest.fixture(autouse=True)
def _no_ledger_ships(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """What is made up here is no attempt at a certificate of a set that ships."""
    monkeypatch.setattr(attempts, "SETS", tmp_path / "no_sets")


def test_a_new_folder_goes_on_from_the_ledger_that_ships(tmp_path: Path) -> None:
    """GIVEN a ledger with an attempt that failed WHEN the set is flown in a new folder THEN by other code, with another
    table or on another ensemble it is attempt 2; the very same is that one again; with no ledger it is the first."""
    of_old = {"table_sha256": "a", "ensemble_sha256": "b", "code_sha256": "old"}
    attempts.begin(tmp_path, of_old)
    attempts.finish(tmp_path, 1, {"violated": 29})
    before = tmp_path / attempts.LEDGER
    assert attempts.begin(tmp_path / "new", of_old | {"code_sha256": "new"}, before=before)["attempt"] == 2
    assert [one["attempt"] for one in attempts.read(tmp_path / "new")] == [1, 2]
    assert attempts.begin(tmp_path / "same", of_old, before=before)["attempt"] == 1
    assert attempts.begin(tmp_path / "other", of_old | {"ensemble_sha256": "c"}, before=before)["attempt"] == 2
    assert attempts.begin(tmp_path / "table", of_old | {"table_sha256": "c"}, before=before)["attempt"] == 2
    assert attempts.begin(tmp_path / "none", of_old, before=tmp_path / "no.json")["attempt"] == 1


@pytest.mark.parametrize(("table_set", "long"), [("flight", False), ("flight", True), ("flight_coloured", False)])
def test_ledgers_that_ship_are_of_their_sets(table_set: str, long: bool) -> None:
    """GIVEN a shipped ledger THEN its last attempt is of the set's present table and the present ensemble."""
    ensemble = certify.ensemble_of(table_set, quick=False)
    ensemble = endurance.ensemble_of(ensemble) if long else ensemble
    ledger = SETS / attempts.shipped(table_set, long).name
    last = json.loads(ledger.read_text())[-1]["what"]
    assert last["ensemble_sha256"] == ensemble.hash
    assert last["table_sha256"] == hashlib.sha256(build_navigation(table_set)).hexdigest()


def made_up(folder: Path, runs: int = 24, **how) -> certify.Certified:
    return certify.certify(
        folder, "flight", ENSEMBLE, runs, lambda n: None, fly=lambda *args, **more: figures(runs), **how
    )


def test_certificate_and_report_name_what_was_certified(tmp_path: Path) -> None:
    """GIVEN figures of 24 runs WHEN certified twice, the second time again THEN the certificate is plain JSON of grade
    quick with both attempts, different seeds, its envelope; the report says NOT CERTIFIED and shows its pictures."""
    first = made_up(tmp_path).document
    second = made_up(tmp_path, again=True)
    document = json.loads((tmp_path / certify.CERTIFICATE).read_text())
    assert (document["grade"], document["certified"], document["attempt"]) == ("quick", False, 2)
    assert [one["attempt"] for one in document["attempts"]] == [1, 2]
    assert document["seeds"] != first["seeds"]
    assert document["envelope"]["age_s"] == 2000.0
    assert document["envelope"]["fixes_before_s"] == 6000.0
    drawn = pictures.draw(second, tmp_path / "figures")
    text = report.write(tmp_path, second.document, second.targets, drawn).read_text()
    assert "NOT CERTIFIED: a quick campaign certifies nothing" in text
    for path in drawn:
        assert path.stat().st_size > 10_000
        assert f"figures/{path.name}" in text


def test_a_campaign_is_judged_again_without_being_flown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a finished campaign WHEN other code judges it THEN nothing is flown or begun, and the certificate names the
    code that flew; a folder of something else, or with runs still to fly, is refused and left as it is."""

    def flown(place: Path, flight: object, runs: int, advance: object, **how: object) -> certify.Arrays:
        store.save_chunk(place, 0, runs - 1, figures(runs))
        return store.collect(place, runs)

    first = certify.certify(tmp_path, "flight", ENSEMBLE, 24, lambda n: None, fly=flown).document
    monkeypatch.setattr(certify, "code_hash", lambda long=False: "f" * 64)
    ledger = (tmp_path / attempts.LEDGER).read_bytes()
    again = certify.certify(tmp_path, "flight", ENSEMBLE, 24, lambda n: None, judge=True).document
    assert again == first
    assert (tmp_path / attempts.LEDGER).read_bytes() == ledger
    coloured = Ensemble(noise="coloured")
    for changed, said in (((coloured, 24), "ensemble_sha256 differ"), ((ENSEMBLE, 25), "runs differ")):
        with pytest.raises(OperatorError, match=said):
            certify.certify(tmp_path, "flight", *changed, lambda n: None, judge=True)
    with pytest.raises(OperatorError, match="nothing was flown there"):
        certify.endure(tmp_path, "flight", ENSEMBLE, 24, lambda n: None, judge=True)
    assert (tmp_path / attempts.LEDGER).read_bytes() == ledger
    next((tmp_path / "attempt-001" / store.CHUNKS).iterdir()).unlink()
    with pytest.raises(OperatorError, match="24 of 24 runs are not flown yet"):
        certify.certify(tmp_path, "flight", ENSEMBLE, 24, lambda n: None, judge=True)


def test_only_integrity_stands_between_a_full_campaign_and_its_certificate() -> None:
    """GIVEN what was wanted WHEN a flag came too early or a bound was loose THEN nothing is unproven; WHEN a bound
    broke too often, or how often could not be told, THEN it is."""
    held = certificate.judge(certificate.summarise(ENSEMBLE, figures(24)))
    of_integrity = [line for line in held if line.integrity]
    assert [line.what.split(",")[0] for line in of_integrity[:1]] == ["violated outages"]
    assert sum("hazardous" in line.what for line in of_integrity) == 2
    assert sum("INTEGRATED" in line.what for line in of_integrity) == 1
    assert not any("tightness" in line.what or "T_flag" in line.what for line in of_integrity)
    fine = [line._replace(met=True) for line in held]
    for place, line in enumerate(fine):
        for met in (False, None):
            changed = [*fine[:place], line._replace(met=met), *fine[place + 1 :]]
            assert certificate.unproven(changed) == ([line.what] if line.integrity else [])


def test_only_sets_of_the_flight_filter_are_certified() -> None:
    """GIVEN the paper's set WHEN an ensemble is asked for THEN it is refused; the flight sets get their own noise."""
    with pytest.raises(OperatorError, match="paper"):
        certify.ensemble_of("paper", quick=True)
    assert certify.ensemble_of("flight", quick=False).noise == "white"
    assert certify.ensemble_of("flight_coloured", quick=False).noise == "coloured"


@pytest.mark.compiled
def test_the_command_flies_and_goes_on_where_it_was(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """GIVEN two short outages WHEN `ground certify` flies them, and is called again THEN it says what they prove, and
    the second call flies nothing."""
    short = Ensemble(outage_s=(60.0, 60.0), acquisition_s=(40.0,), second_share=0.0)
    monkeypatch.setattr(certify, "ensemble_of", lambda table_set, quick: short)
    command = ["certify", "--set", "flight", "--quick", "--runs", "2", "--jobs", "1", "--out", str(tmp_path)]
    assert ground_command.main(command) == 0
    said = capsys.readouterr().out
    assert "2 outages, 0 with a broken bound" in said
    outages = tmp_path / "attempt-001" / "outages.npz"
    chunk = next((tmp_path / "attempt-001" / "chunks").iterdir())
    before, flown_at = outages.read_bytes(), chunk.stat().st_mtime_ns
    assert ground_command.main(command) == 0
    assert outages.read_bytes() == before
    assert chunk.stat().st_mtime_ns == flown_at
    assert capsys.readouterr().out == said
    # flown again they give the same figures; one that was another is named
    assert ground_command.main([*command, "--reproduce", "2"]) == 0
    assert "the same figures" in capsys.readouterr().out
    held = store.load_outages(chunk)
    held["error_m"][1, 5] += 0.5
    store.save_chunk(tmp_path / "attempt-001", 0, 1, held)
    assert ground_command.main([*command, "--reproduce", "2"]) == 1
    assert "differs: error_m in 1 of them" in capsys.readouterr().out
    assert ground_command.main([*command, "--reproduce", "3"]) == 2


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--runs", "0"), "--runs 0"),
        (("--set", "flihgt"), "flihgt"),
        (("--set", "paper"), "flight filter"),
    ],
)
def test_mistakes_are_one_line(words: tuple[str, ...], said: str, tmp_path: Path, capsys) -> None:
    """GIVEN arguments that cannot be WHEN called THEN one line says which, and status is 2."""
    assert ground_command.main(["certify", *words, "--out", str(tmp_path)]) == 2
    error = capsys.readouterr().err.strip()
    assert said in error
    assert "\n" not in error
