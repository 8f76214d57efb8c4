"""Uploads judged in bulk: residuals from drawn errors, then all three monitors.

The kernels that fly judge every upload in which anything could be found. Of all others, which are nearly all healthy
ones, only the statistics are wanted: each is the squared length of four linear functions of the residuals. These
functions are read off the flight kernels themselves, a unit residual at a time, and thousands of uploads are multiplied
by them at once.
"""

from __future__ import annotations

import numpy as np

from flightsw.crosslink.declare import ROOM, entry
from flightsw.crosslink.isolation import isolate
from flightsw.crosslink.majority import UNRELIABLE, heard_by, majority
from flightsw.crosslink.own import CLEAR, NOT_JUDGED, SMALL, decide
from flightsw.crosslink.records import MONITOR_TABLE, PARAMETERS, TEST, WORK
from flightsw.crosslink.setup import MonitorMemory
from flightsw.crosslink.weighted_test import evaluate
from flightsw.kernels.registry import MATRIX, TIMES, frozen_records, records

JUDGED = np.dtype(
    [
        ("beyond", "i8"),  # bit mask of the satellites that the paper's rule flags
        ("statistic", "f8"),  # largest of the network monitor
        ("worst", "i8"),
        ("named", "i8"),  # bit mask
        ("own_statistic", "f8"),
        ("own", "i8"),  # own.py
        ("largest_m", "f8"),  # |residual| of a link that counts for the own satellite's majority
        ("code", "i8"),
    ],
    align=True,
)


def _declare(room):
    @entry(
        frozen_records(MONITOR_TABLE),
        records(TEST),
        records(TEST),
        records(WORK),
        MATRIX,
        MATRIX,
        TIMES,
        TIMES,
        records(JUDGED),
    )
    def _judge(tables, networks, owns, works, errors_m, noise_m, heard, start, judged):
        table, network, own, work = tables[0], networks[0], owns[0], works[0]
        satellites, links = table["satellites"], network["links"]
        threshold = table["network_threshold"]
        h, residual, mine = network["h"], work["residual_m"], work["own_residual_m"]
        for upload in range(errors_m.shape[0]):
            result = judged[upload]
            own_links = 0
            for link in range(links):
                at, to = network["receiver"][link], network["sender"][link]
                value = noise_m[upload, link]
                for k in range(4):
                    value += h[link, 0, k] * errors_m[upload, 4 * at + k] + h[link, 1, k] * errors_m[upload, 4 * to + k]
                residual[link] = value
            beyond = 0
            for satellite in range(satellites):
                count = 0
                for place in range(start[satellite], start[satellite + 1]):
                    mine[count] = residual[heard[place]]
                    count += 1
                if satellite == table["own"]:
                    largest = 0.0
                    for link in range(count):
                        largest = max(largest, abs(mine[link]))
                    result["largest_m"] = largest
                if majority(mine, count, table["majority_threshold_m"]) == UNRELIABLE:
                    beyond |= 1 << satellite
            result["beyond"] = beyond
            for link in range(links):
                if network["receiver"][link] == table["own"] or network["sender"][link] == table["own"]:
                    mine[own_links] = residual[link]
                    own_links += 1
            result["own"], _ = decide(own, mine, table["own_threshold"], table["clear_threshold"])
            result["own_statistic"] = own["statistic"][0]
            evaluate(network, residual)
            worst, most, found = -1, 0.0, False
            for satellite in range(satellites):
                dof = network["dof"][satellite]
                if dof > 0:
                    value = network["statistic"][satellite]
                    if value > most:
                        worst, most = satellite, value
                    found = found or value > threshold[dof]
            result["statistic"], result["worst"], result["named"] = most, worst, 0
            if found:
                for satellite in range(satellites):
                    work["set"][satellite] = 0
                isolate(network, work["set"], threshold, table["faulty_max"], work["without"])
                for satellite in range(satellites):
                    if work["set"][satellite] != 0:
                        result["named"] |= 1 << satellite
            result["code"] = room

    return _judge


def _declare_functions(room):
    @entry(records(TEST), MATRIX, MATRIX, TIMES)
    def _functions(tests, residual_m, out, code):
        """out (k, 4 satellites): what the statistics are the squared lengths of, for residuals (k, links)."""
        test = tests[0]
        for row in range(residual_m.shape[0]):
            evaluate(test, residual_m[row])
            for satellite in range(test["columns"] // PARAMETERS):
                at = PARAMETERS * satellite
                for i in range(PARAMETERS):
                    value = 0.0
                    if i < test["dof"][satellite]:
                        for k in range(PARAMETERS):
                            value += test["root"][satellite, i, k] * test["g"][at + k]
                    out[row, at + i] = value
        code[0] = room

    return _functions


_judge = _declare(ROOM)
_functions = _declare_functions(ROOM)
_SURELY = 0.999  # of a threshold: what stays below it is no finding of the flight kernels, whatever the rounding


def judge_each(memory: MonitorMemory, errors_m: np.ndarray, noise_m: np.ndarray) -> np.ndarray:
    """Judge k uploads by the kernels that fly, in the geometry that a monitor was made ready in.

    errors_m (k, 4n) [m]: radial, along-track, cross-track, clock of each satellite; noise_m (k, links) [m]. Returns
    (k,) of JUDGED.
    """
    judged = np.zeros(len(errors_m), JUDGED)
    heard, start = _heard(memory)
    _judge(memory.table, memory.network, memory.own, memory.work, errors_m, noise_m, heard, start, judged)
    return judged


class Judge:
    """What `judge_each` does, for thousands of uploads in one geometry: `judge`, with the same result."""

    def __init__(self, memory: MonitorMemory) -> None:
        test, table = memory.network[0], memory.table[0]
        links, n, own = int(test["links"]), int(table["satellites"]), int(table["own"])
        receiver, sender = test["receiver"][:links], test["sender"][:links]
        self._memory = memory
        self._sensitivity = np.zeros((PARAMETERS * n, links))
        for k in range(PARAMETERS):
            self._sensitivity[PARAMETERS * receiver + k, np.arange(links)] = test["h"][:links, 0, k]
            self._sensitivity[PARAMETERS * sender + k, np.arange(links)] = test["h"][:links, 1, k]
        self._network = linear_functions(memory.network, links, PARAMETERS * n)
        self._sum = np.repeat(np.eye(n), PARAMETERS, axis=0)
        self._own_links = np.flatnonzero((receiver == own) | (sender == own))
        self._own_dof = int(memory.own["dof"][0, 0])
        self._own = linear_functions(memory.own, len(self._own_links), int(memory.own["columns"][0]))[:, :PARAMETERS]
        heard, start = _heard(memory)
        self._mine = heard[start[own] : start[own + 1]]
        dof = np.array(test["dof"])[:n]
        self._thresholds = np.where(dof > 0, np.array(table["network_threshold"])[dof], np.inf)
        self._own_threshold = float(table["own_threshold"][self._own_dof])
        self._own_clear = float(table["clear_threshold"][self._own_dof])
        self._majority_m = float(table["majority_threshold_m"])

    def judge(self, errors_m: np.ndarray, noise_m: np.ndarray) -> np.ndarray:
        """As `judge_each`; statistics of uploads without a finding are the same but for rounding."""
        residual = errors_m @ self._sensitivity
        residual += noise_m
        statistic = (residual @ self._network) ** 2 @ self._sum
        own = ((residual[:, self._own_links] @ self._own) ** 2).sum(axis=1)
        size = np.abs(residual)
        judged = np.zeros(len(residual), JUDGED)
        judged["statistic"], judged["worst"] = statistic.max(axis=1), statistic.argmax(axis=1)
        judged["own_statistic"] = own
        judged["own"] = NOT_JUDGED if self._own_dof == 0 else np.where(own < self._own_clear, CLEAR, SMALL)
        judged["largest_m"] = size[:, self._mine].max(axis=1, initial=0.0)
        found = (statistic > _SURELY * self._thresholds).any(axis=1)
        found |= own > _SURELY * self._own_threshold
        found |= size.max(axis=1) > _SURELY * self._majority_m
        if found.any():
            judged[found] = judge_each(self._memory, errors_m[found], noise_m[found])
        return judged


def judge(memory: MonitorMemory, errors_m: np.ndarray, noise_m: np.ndarray) -> np.ndarray:
    """`Judge(memory).judge`, for a batch that stands alone."""
    return Judge(memory).judge(errors_m, noise_m)


def linear_functions(test: np.ndarray, links: int, columns: int) -> np.ndarray:
    """Linear functions (links, columns) of the residuals of a test made ready, as `_functions` computes them."""
    out = np.zeros((links, columns))
    _functions(test, np.eye(links), out, np.zeros(1, np.int64))
    return out


def _heard(memory: MonitorMemory) -> tuple[np.ndarray, np.ndarray]:
    """Links that count for each satellite's majority, in one list, and where each satellite's begin (n + 1,)."""
    test, table = memory.network[0], memory.table[0]
    links, n = int(test["links"]), int(table["satellites"])
    lists = [
        [k for k in range(links) if heard_by(i, test["receiver"][k], test["sender"][k], bool(table["both"]))]
        for i in range(n)
    ]
    start = np.cumsum([0, *(len(one) for one in lists)])
    return np.array([k for one in lists for k in one], np.int64), start.astype(np.int64)


def mask_of(satellites: tuple[int, ...] | np.ndarray) -> int:
    """Bit mask of satellites."""
    mask = 0
    for satellite in satellites:
        mask |= 1 << int(satellite)
    return mask
