"""What no range can show: errors that leave every link's length and clock difference as it is.

A common translation (3), a common rotation (3) and, with one-way ranges, a common clock offset (1) of all satellites
stretch no link. Where links are few, more is added to them. The rank of all sensitivities says how much; the weakest
direction of each satellite, how large a jump can hide in it.
"""

from __future__ import annotations

import math

from flightsw.crosslink.declare import kernel
from flightsw.crosslink.matrices import pivoted_rank
from flightsw.crosslink.records import PARAMETERS

_ZERO_PIVOT = 1e-8  # of the largest; those of the Walker constellation that are none are below 1e-14
_EVERY_EPOCHS = 60
_ITERATIONS = 24


@kernel
def _rank(test, satellites, matrix):
    columns = satellites * PARAMETERS
    for a in range(columns):
        for b in range(columns):
            matrix[a, b] = 0.0
    for link in range(test["links"]):
        for one in range(2):
            at = (test["receiver"][link] if one == 0 else test["sender"][link]) * PARAMETERS
            for other in range(2):
                to = (test["receiver"][link] if other == 0 else test["sender"][link]) * PARAMETERS
                for j in range(PARAMETERS):
                    for k in range(PARAMETERS):
                        matrix[at + j, to + k] += test["h"][link, one, j] * test["h"][link, other, k]
    return pivoted_rank(matrix, columns, _ZERO_PIVOT)


@kernel
def _longest(root, dof, vector, image):
    """Largest eigenvalue of root' root by power iteration: the variance of the weakest direction."""
    value = 0.0
    for k in range(PARAMETERS):
        vector[k] = 1.0 / (1.0 + k)
    for _ in range(_ITERATIONS):
        length = 0.0
        for k in range(PARAMETERS):
            length += vector[k] * vector[k]
        length = math.sqrt(length)
        if not (length > 0.0):
            return 0.0
        for k in range(PARAMETERS):
            vector[k] /= length
        for i in range(dof):
            image[i] = 0.0
            for k in range(PARAMETERS):
                image[i] += root[i, k] * vector[k]
        value = 0.0
        for k in range(PARAMETERS):
            vector[k] = 0.0
            for i in range(dof):
                vector[k] += root[i, k] * image[i]
        for i in range(dof):
            value += image[i] * image[i]
    return value


@kernel
def has_changed(test, state):
    """Whether to look at the subspace anew: where links have come or gone, and at times."""
    changed = test["links"] != state["linked"] or state["epochs"] % _EVERY_EPOCHS == 0
    state["linked"] = test["links"]
    return changed


@kernel
def subspace(table, test, work, verdict):
    """Fill rank, parameters, undetectable dimension, weakest jump."""
    satellites = table["satellites"]
    for satellite in range(satellites):
        work["found"][satellite] = 0
    for link in range(test["links"]):
        work["found"][test["receiver"][link]] = 1
        work["found"][test["sender"][link]] = 1
    parameters = 0
    full = PARAMETERS - 1 if table["two_way"] != 0 else PARAMETERS
    verdict["weakest"], verdict["weakest_m"] = -1, 0.0
    for satellite in range(satellites):
        if work["found"][satellite] != 0:
            parameters += full
            variance = math.inf
            if test["ready"] != 0 and test["dof"][satellite] == full:
                variance = _longest(test["root"][satellite], full, test["reduced_g"], test["small"])
            jump_m = math.sqrt(table["certain_noncentrality"] * variance)
            if jump_m > verdict["weakest_m"]:
                verdict["weakest"], verdict["weakest_m"] = satellite, jump_m
    verdict["parameters"] = parameters
    verdict["rank"] = _rank(test, satellites, work["rank"])
    verdict["undetectable"] = parameters - verdict["rank"]
