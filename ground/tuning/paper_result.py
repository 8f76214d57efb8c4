"""What the paper's tuning finds: one outage solved, one row for many start phases, Table 1 beside them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ground.tuning.descent import Found
from ground.tuning.outages import Flown
from ground.tuning.paper_search import Problem

TABLE_1 = np.array([500.0, 0.05, 1e-6, 1000.0, 22.0])  # the paper's autonomous row


class Single(NamedTuple):
    """One outage solved: T [s], the row, when its bound crosses eps [s], epochs at which it is broken before T."""

    phase_deg: float
    t_s: float
    found: Found
    flag_s: float
    broken: int


class Common(NamedTuple):
    """One row for many start phases. T_flag / T (L,), NaN where the error never reached eps; worst error / bound before
    T (L,), of the phases tuned on and of the others."""

    found: Found
    margin: float
    share: np.ndarray
    worst: np.ndarray
    share_unseen: np.ndarray
    worst_unseen: np.ndarray


class Result(NamedTuple):
    """All that was found with fixes of one quality."""

    sigma_m: float
    flown: Flown
    problem: Problem
    exact: Single
    statistical: Single
    common: Common
    table_1: list[str]  # what the saturation linter says of Table 1
