"""Uploads judged in bulk by the kernels that fly: residuals from drawn errors, then all three monitors."""

from __future__ import annotations

import numpy as np

from flightsw.crosslink.declare import ROOM, entry
from flightsw.crosslink.isolation import isolate
from flightsw.crosslink.majority import UNRELIABLE, heard_by, majority
from flightsw.crosslink.own import decide
from flightsw.crosslink.records import MONITOR_TABLE, TEST, WORK
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


_judge = _declare(ROOM)


def judge(memory: MonitorMemory, errors_m: np.ndarray, noise_m: np.ndarray) -> np.ndarray:
    """Judge k uploads in the geometry that a monitor was made ready in.

    errors_m (k, 4n) [m]: radial, along-track, cross-track, clock of each satellite; noise_m (k, links) [m]. Returns
    (k,) of JUDGED.
    """
    judged = np.zeros(len(errors_m), JUDGED)
    heard, start = _heard(memory)
    _judge(memory.table, memory.network, memory.own, memory.work, errors_m, noise_m, heard, start, judged)
    return judged


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
