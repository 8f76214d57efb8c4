"""The parts of `ground gnss study` about tests and exclusion: false alarms, detection, exact exclusion, bad inputs."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from flightsw.crosslink.thresholds import chi2_quantile, noncentral_chi2_tail
from flightsw.gnss.records import EPOCH, SATELLITES, Consistency, Rule, Verdict
from flightsw.gnss.setup import Settings, build_table, thresholds
from ground.campaign.statistics import lower_limit, upper_limit
from ground.gnss.scene import LAWS, SIGMA_M, Batch, User, add_faults, draw, exact, judge, of_epochs, renew

CHUNK = 1_000
_RENEWALS = 10  # times that noise is drawn on one geometry
EARTH, SPARSE = User(), User(mask_deg=20.0)
PAPER = Settings(rule=Rule.GREEDY, local_alpha=0.0, faulty_max=0)
# mask, faults, size in sigmas, wanted share of exact sets (None: none was asked for)
CASES = (
    (5.0, 1, 10.0, None),
    (5.0, 1, 20.0, None),
    (5.0, 3, 20.0, None),
    (5.0, 5, 20.0, 0.98),
    (5.0, 5, 7.0, 0.85),
    (20.0, 1, 10.0, None),
    (20.0, 2, 50.0, None),
    (20.0, 3, 50.0, 0.95),
)
RULES = {
    "raw": Settings(rule=Rule.GREEDY, alpha=1e-3, local_alpha=0.0, faulty_max=8),
    "flight": Settings(),
}


def rate(count: int, trials: int) -> dict[str, float]:
    """A share with its limits of Clopper and Pearson, each at 95 %."""
    return {
        "count": count,
        "trials": trials,
        "rate": count / trials,
        "lower": lower_limit(count, trials),
        "upper": upper_limit(count, trials),
    }


def chunks(total: int, size: int = CHUNK) -> list[int]:
    """Sizes of the chunks that so many epochs are drawn in."""
    return [min(size, total - start) for start in range(0, total, size)]


def alarms_part(seed: int, epochs: int) -> dict[str, Any]:
    """False alarms of both tests and of the flight settings, by law of the noise; noise at its bound.

    The verdict of a test without exclusion is its statistic against its threshold: one pass serves them all.
    """
    found: dict[str, Any] = {"epochs": epochs, "laws": {}}
    tests = {
        "chi2 .05": replace(PAPER, alpha=0.05),
        "chi2 .001": replace(PAPER, alpha=0.001),
        "markov .05": replace(PAPER, alpha=0.05, test=Consistency.MARKOV),
        "flight": Settings(faulty_max=0),
    }
    limits = {name: np.array(thresholds(settings)) for name, settings in tests.items()}
    largest = float(build_table(tests["flight"])["local_threshold"][0])
    counts = {law: dict.fromkeys(tests, 0) for law in LAWS}
    satellites = 0
    geometry = np.random.default_rng([seed, 1])
    noises = [np.random.default_rng([seed, 1, number]) for number in range(len(LAWS))]
    for size in chunks(epochs, CHUNK * _RENEWALS):
        batch = draw(EARTH, geometry, -(-size // _RENEWALS))
        satellites += int(batch.count.sum())
        for law, rng in zip(LAWS, noises, strict=True):
            left = size
            while left > 0:
                renew(batch, rng, law)
                result = judge(batch, tests["flight"])[:left]
                for name, limit in limits.items():
                    alarm = result["statistic"] > limit[result["dof"]]
                    if name == "flight":
                        alarm |= result["largest"] > largest
                        assert np.array_equal(alarm, result["verdict"] == Verdict.INCONSISTENT)
                    counts[law][name] += int(alarm.sum())
                left -= len(result)
    for law in LAWS:
        found["laws"][law] = {name: rate(count, epochs) for name, count in counts[law].items()}
    found["mean_satellites"] = satellites / sum(-(-size // _RENEWALS) for size in chunks(epochs, CHUNK * _RENEWALS))
    return found


def detection_part(seed: int, epochs: int) -> dict[str, Any]:
    """Share of single biases that each test finds, by size; sizes found with 50 and 99 %, and as theory has them."""
    chi2, markov = replace(PAPER, alpha=0.05), replace(PAPER, alpha=0.05, test=Consistency.MARKOV)
    sizes = {
        "chi2 .05": (chi2, np.arange(1.0, 11.01, 0.5)),
        "chi2 .001": (replace(PAPER, alpha=0.001), np.arange(1.0, 11.01, 0.5)),
        "markov .05": (markov, np.arange(15.0, 31.01, 1.0)),
    }
    found: dict[str, Any] = {"epochs": epochs}
    rng = np.random.default_rng([seed, 2])
    batch = draw(EARTH, rng, epochs)
    for name, (settings, biases) in sizes.items():
        shares = []
        for bias in biases:
            renew(batch, rng)
            add_faults(batch, rng, 1, float(bias) * SIGMA_M)
            shares.append(float((judge(batch, settings)["verdict"] == Verdict.INCONSISTENT).mean()))
        found[name] = {
            "sigmas": biases.tolist(),
            "share": shares,
            "half": _crossing(biases, shares, 0.5),
            "nearly_all": _crossing(biases, shares, 0.99),
        }
    found["theory"] = _theory(judge(batch, chi2))
    return found


def _crossing(sizes: np.ndarray, shares: list[float], level: float) -> float:
    """Size at which the share first reaches a level, linear between the sizes tried; NaN: never."""
    for k in range(1, len(sizes)):
        if shares[k] >= level > shares[k - 1]:
            part = (level - shares[k - 1]) / (shares[k] - shares[k - 1])
            return float(sizes[k - 1] + part * (sizes[k] - sizes[k - 1]))
    return math.nan


def _theory(result: np.ndarray) -> dict[str, float]:
    """Sizes that the noncentral chi-square finds with 50 and 99 %, over redundancies that the epochs have."""
    rng = np.random.default_rng(0)
    rows = [(int(r["dof"]), float(rng.choice(r["redundancy"][: r["usable"]]))) for r in result[:60] if r["dof"] > 0]
    quantile = {dof: chi2_quantile(0.05, dof) for dof, _ in rows}
    answer = {}
    for name, level in (("half", 0.5), ("nearly_all", 0.99)):
        low, high = 0.0, 40.0
        for _ in range(14):
            middle = 0.5 * (low + high)
            power = np.mean([noncentral_chi2_tail(quantile[dof], dof, middle**2 * share) for dof, share in rows])
            low, high = (middle, high) if power < level else (low, middle)
        answer[name] = high
    return answer


def exclusion_part(seed: int, cases: int) -> dict[str, Any]:
    """Exact fault sets of the paper's rule and of the flight's, on the same epochs; wrong and missed satellites."""
    found = []
    for number, (mask, faults, size, wanted) in enumerate(CASES):
        rng = np.random.default_rng([seed, 3, number])
        row: dict[str, Any] = {"mask_deg": mask, "faults": faults, "sigmas": size, "wanted": wanted}
        totals: dict[str, dict[str, int]] = {name: dict.fromkeys(("exact", "ambiguous", "none"), 0) for name in RULES}
        trials = 0
        for many in chunks(cases):
            batch = draw(User(mask_deg=mask), rng, many)
            add_faults(batch, rng, faults, size * SIGMA_M)
            # with fewer the paper's own conditions say: cannot be excluded
            batch = of_rows(batch, batch.count - 6 - faults >= 1)
            trials += len(batch.epochs)
            for name, settings in RULES.items():
                result = judge(batch, settings)
                totals[name]["exact"] += int(exact(batch, result).sum())
                totals[name]["ambiguous"] += int((result["verdict"] == Verdict.AMBIGUOUS).sum())
                totals[name]["none"] += int((result["verdict"] >= Verdict.INCONSISTENT).sum())
        for name, counts in totals.items():
            row[name] = {**rate(counts["exact"], trials), "ambiguous": counts["ambiguous"], "none": counts["none"]}
        found.append(row)
    return {"cases": found}


def of_rows(batch: Batch, rows: np.ndarray) -> Batch:
    """Some epochs of a batch, copied."""
    return Batch(batch.epochs[rows], batch.truth_m[rows], batch.count[rows], batch.fault[rows], batch.exact_m[rows])


def inputs_part(seed: int) -> dict[str, str]:
    """The verdict that each kind of bad input gets."""
    rng = np.random.default_rng([seed, 4])
    good = draw(EARTH, rng, 1)
    while good.count[0] < 20:
        good = draw(EARTH, rng, 1)
    found = {}
    for name, epoch in bad_inputs(good, rng):
        result = judge(of_epochs(epoch), Settings(protect=True))[0]
        found[name] = f"{Verdict(int(result['verdict'])).name}, {int(result['used'])} used"
    return found


def bad_inputs(good: Batch, rng: np.random.Generator) -> list[tuple[str, np.ndarray]]:
    """(name, one epoch) of every kind of bad input, each made of a good epoch."""
    n = int(good.count[0])

    def changed(**fields: Any) -> np.ndarray:
        epoch = good.epochs.copy()
        for name, value in fields.items():
            epoch[name][0, : len(value) if np.ndim(value) else 1] = value
        return epoch

    def with_count(count: int) -> np.ndarray:
        epoch = good.epochs.copy()
        epoch["count"] = count
        return epoch

    full = good.epochs.copy()
    full["count"] = SATELLITES
    for name in ("r_m", "range_m", "sigma_m", "constellation"):
        full[name][0] = np.resize(full[name][0, :n], full[name][0].shape)
    full["satellite"][0] = np.arange(SATELLITES)
    full["range_m"][0] = np.resize(good.exact_m[0, :n], SATELLITES) + rng.normal(0.0, SIGMA_M, SATELLITES)
    ranges = good.epochs["range_m"][0, :n]
    one = good.epochs.copy()
    one["r_m"][0, :n] = one["r_m"][0, 0]
    return [
        ("a good epoch", good.epochs.copy()),
        ("zero satellites", with_count(0)),
        ("three satellites", with_count(3)),
        ("a negative count", with_count(-3)),
        ("more rows than there is room", with_count(SATELLITES + 1)),
        ("64 satellites", full),
        ("NaN in a range", changed(range_m=math.nan)),
        ("NaN in all ranges", changed(range_m=np.full(n, math.nan))),
        ("infinite ranges", changed(range_m=np.full(n, math.inf))),
        ("missing ephemerides", changed(r_m=np.zeros((n, 3)))),
        ("an ephemeris of NaN", changed(r_m=np.full((1, 3), math.nan))),
        ("a wrong constellation", changed(constellation=9)),
        ("wrong constellations throughout", changed(constellation=np.full(n, -1))),
        ("a duplicate number", changed(satellite=good.epochs["satellite"][0, 1], constellation=0)),
        ("all numbers equal", changed(satellite=np.full(n, 7), constellation=np.zeros(n, int))),
        ("a sigma of zero", changed(sigma_m=0.0)),
        ("negative sigmas", changed(sigma_m=np.full(n, -1.0))),
        ("all satellites in one place", one),
        ("all faulty, by kilometres", changed(range_m=ranges + rng.normal(0.0, 5e3, n))),
        ("all faulty, by thousands of kilometres", changed(range_m=np.abs(ranges + rng.normal(0.0, 5e6, n)) + 2e6)),
        ("random bits", _random_bits(rng)),
    ]


def _random_bits(rng: np.random.Generator) -> np.ndarray:
    epoch = np.frombuffer(rng.bytes(EPOCH.itemsize), EPOCH).copy()
    epoch["count"] = 40
    return epoch
