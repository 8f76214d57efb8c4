"""The consistent way: the filter's own covariance, kept whole through the outage, times the smallest k that holds.

Process noise first, where the ensemble shows that the bound has not the errors' shape in age and altitude; then k. The
ensemble is that of a certification, from a root that no certification draws from.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

import numpy as np

from flightsw.icd.table_file import decode
from ground.campaign import executor, store
from ground.campaign.cells import CELLS
from ground.campaign.certificate import CELL_LIMIT, POOLED_LIMIT
from ground.campaign.certify import code_hash, ensemble_of
from ground.campaign.ensemble import Ensemble
from ground.campaign.floor import floor
from ground.campaign.outage import Arrays, Flight
from ground.campaign.seeds import tuning
from ground.errors import OperatorError
from ground.tables.build import build_navigation
from ground.tuning import overbound_report
from ground.tuning.factors import Factor, factor
from ground.tuning.method import Bar, Effort, Tuned
from ground.tuning.shape import NOISES, Shape, better, shape

USUAL_RUNS, QUICK_RUNS = 1200, 1008
SEARCH_SHARE = 0.2  # of the runs, on which process noise is tried
SEARCH_FACTORS = (2.0, 0.5)
K_HIGHEST = 10.0  # of the schema


class Overbound:
    """See the module."""

    help = "flight filter: its own covariance, process noise and k from an ensemble"
    usual_set = "flight"

    def tune(self, table_set: str, folder: Path, effort: Effort, bar: Bar) -> Tuned:
        """Fly the ensemble, choose process noise (not when quick), fit k."""
        ensemble = ensemble_of(table_set, effort.quick)
        runs = effort.runs or (QUICK_RUNS if effort.quick else USUAL_RUNS)
        values = decode(build_navigation(table_set)).values[0]
        campaign = _Campaign(ensemble, table_set, folder, effort, bar)
        noise: dict[str, float] = {}
        tried: list[tuple[str, float, Shape]] = []
        if not effort.quick:
            noise, tried = self._noise(campaign, values, max(round(SEARCH_SHARE * runs), len(CELLS)))
        figures = campaign.fly("flying outages", noise, runs)
        factors = fit(figures, ensemble, float(values["k_axis"]), float(values["k_radius"]))
        k_axis, k_radius = (chosen(group) for group in factors)
        for name, k in (("k_axis", k_axis), ("k_radius", k_radius)):
            if not k <= K_HIGHEST:
                raise OperatorError(
                    f"{name}: {k:.3g} sigmas would be needed, more than a table takes ({K_HIGHEST:g}): "
                    "the covariance is wrong, which no factor mends; raise the process noise of the base set"
                )
        changes = {**noise, "bound.k_axis": round(k_axis, 2), "bound.k_radius": round(k_radius, 2)}
        proven = factors[0][0].proven and factors[1][0].proven
        summary = (
            f"k_axis = {k_axis:.2f}, k_radius = {k_radius:.2f} from {runs} outages of {ensemble.outage_s[1]:.0f} s"
            + ("" if proven else "; too few to prove 0.003 for each outage: carried on from the largest")
        )
        evidence = {
            "method": "overbound",
            "ensemble": ensemble.document(),
            "ensemble_sha256": ensemble.hash,
            "seeds": tuning(effort.seed).document(),
            "runs": runs,
            "proven": proven,
            "k_axis": [one._asdict() for one in factors[0]],
            "k_radius": [one._asdict() for one in factors[1]],
            "base": {"k_axis": float(values["k_axis"]), "k_radius": float(values["k_radius"])},
            "process_noise": noise,
            "process_noise_tried": [
                {"key": key, "value": value, "loss": one.loss, "loss_sigma": one.sigma} for key, value, one in tried
            ],
        }
        told = overbound_report.Told(table_set, ensemble, figures, factors, values, changes, tried)
        return Tuned(changes, summary, evidence, overbound_report.lines(told), overbound_report.drawings(told))

    def _noise(
        self, campaign: _Campaign, values: np.void, runs: int
    ) -> tuple[dict[str, float], list[tuple[str, float, Shape]]]:
        """Coordinate descent on the settings that the base set has, the same outages flown with each."""
        chosen: dict[str, float] = {}
        present = shape(campaign.fly("process noise as it is", chosen, runs), campaign.ensemble)
        tried = [("as it is", 0.0, present)]
        for key in NOISES:
            name = key.split(".")[1]
            if float(values[name]) <= 0.0:
                continue
            for scale in SEARCH_FACTORS:
                value = float(f"{scale * float(values[name]):.3g}")
                attempt = {**chosen, key: value}
                other = shape(campaign.fly(f"{name} = {value:g}", attempt, runs), campaign.ensemble)
                tried.append((key, value, other))
                if better(other, present):
                    chosen, present = attempt, other
                    break
        return chosen, tried


class _Campaign:
    """The ensemble flown with changes of a set; each has its folder, and goes on where it was interrupted."""

    def __init__(self, ensemble: Ensemble, table_set: str, folder: Path, effort: Effort, bar: Bar) -> None:
        self.ensemble, self._set, self._folder, self._effort, self._bar = ensemble, table_set, folder, effort, bar

    def fly(self, label: str, changes: Mapping[str, float], runs: int) -> Arrays:
        """Figures of so many runs."""
        overrides = tuple(sorted(changes.items()))
        flight = Flight(self.ensemble, tuning(self._effort.seed), self._set, overrides)
        words = [f"{key.rpartition('.')[2]}={value:g}" for key, value in overrides] or ["base"]
        place = self._folder / "runs" / "-".join(words)
        store.open_folder(place, store.definition(flight, code_hash()))
        with self._bar(label, runs) as advance:
            return executor.complete(place, flight, runs, advance, jobs=self._effort.jobs, chunk_runs=12)


def fit(figures: Arrays, ensemble: Ensemble, k_axis: float, k_radius: float) -> tuple[list[Factor], list[Factor]]:
    """What k each group of outages needs, per axis and in space: all of them, each cell, and INTEGRATED mode."""
    lowest_k = _floor_k(round(float(np.median(figures["perigee_km"])), -2), min(ensemble.outage_s[1], 2000.0))
    started = figures["started"]
    found: tuple[list[Factor], list[Factor]] = ([], [])
    for group, k, ratio in zip(found, (k_axis, k_radius), ("worst_ratio", "worst_3d_ratio"), strict=True):
        needed = k * figures[ratio]
        group.append(factor("all outages", needed[started], POOLED_LIMIT, lowest_k))
        for cell in ensemble.cells:
            inside = started & (figures["cell"] == cell)
            one = factor(CELLS[cell].label, needed[inside], CELL_LIMIT, lowest_k)
            if one.proven:  # a cell with few outages is what the pooled factor, carried on, is for
                group.append(one)
    integrated = k_axis * figures["integrated_ratio"]
    integrated = integrated[~np.isnan(integrated)]
    orbits = int(figures["orbits"].sum())
    found[0].append(factor("INTEGRATED, each revolution", integrated, POOLED_LIMIT, lowest_k, orbits))
    return found


def chosen(factors: list[Factor]) -> float:
    """The largest k of all outages, the first, and of the groups that prove theirs; carried on, the first alone."""
    return max(one.k for index, one in enumerate(factors) if index == 0 or one.proven)


@lru_cache(maxsize=4)
def _floor_k(altitude_km: float, outage_s: float) -> float:
    return floor(altitude_km, outage_s).k
