"""Derivative estimation made ready: tables from settings, memory, and the norms of the two-stage normalisation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from flightsw.derivative.records import (
    AXES,
    BANK,
    BANK_TABLE,
    CANDIDATES,
    CHECK,
    CHECK_TABLE,
    LAG_STATE,
    LAG_TABLE,
    MODELS,
    STATES,
    TUNED,
    TUNED_TABLE,
)


@dataclass(frozen=True)
class Model:
    """One model of motion: a chain of `order` integrators, the density of what drives the last one, its mean stay.

    q: unit^2 / s^(2 order - 1). enter: weight with which it is entered when another model ends.
    """

    order: int
    q: float
    stay_s: float
    enter: float = 1.0


# Quiet, turning, jumping. From `ground derivative tune` on the paper's scenario, in round numbers and with stays that
# suit other vehicles as well.
USUAL_MODELS = (Model(2, 1e-10, 1000.0), Model(5, 4e-11, 1000.0), Model(2, 0.25, 1.0, 0.01))


@dataclass(frozen=True)
class BankSettings:
    """A multiple-model filter: its models; how many axes; gaps after which it begins anew; what a start does not know.

    start_sigma: of velocity, acceleration, ... [unit/s, unit/s^2, ...].
    """

    models: tuple[Model, ...] = USUAL_MODELS
    axes: int = 1
    gap_s: float = 30.0
    start_sigma: tuple[float, ...] = (100.0, 3.0, 0.3, 0.03, 0.003)

    def __post_init__(self) -> None:
        """Raises ValueError, naming the setting, for what no filter can be built from."""
        _check(self.axes, self.gap_s, self.start_sigma)
        if not 1 <= len(self.models) <= MODELS:
            raise ValueError(f"derivative: {len(self.models)} models; give 1 to {MODELS}")
        for model in self.models:
            _check_chain(model.order, model.q)
            if not 0.0 < model.stay_s < math.inf or not 0.0 < model.enter < math.inf:
                raise ValueError(f"derivative: stay_s {model.stay_s}, enter {model.enter}: must be positive")


@dataclass(frozen=True)
class LagSettings:
    """A fixed-lag smoother: one chain, how late it answers."""

    order: int = 5
    q: float = 1e-10
    lag_s: float = 30.0
    axes: int = 1
    gap_s: float = 30.0
    start_sigma: tuple[float, ...] = (100.0, 3.0, 0.3, 0.03, 0.003)

    def __post_init__(self) -> None:
        """Raises ValueError, naming the setting."""
        _check(self.axes, self.gap_s, self.start_sigma)
        _check_chain(self.order, self.q)
        if not 0.0 <= self.lag_s < math.inf:
            raise ValueError(f"derivative: lag_s {self.lag_s} is out of its range")


@dataclass(frozen=True)
class TunedSettings:
    """The paper's algorithm. q: candidates for the diagonal of Q per step, position first, in physical units.

    scale: the paper's rho. gain: given, it is constant from the start. normalised: work in its normalised variables.
    """

    order: int = 5
    step_s: float = 0.2
    scale: float = 1.0
    sigma: float = 1.0
    q: tuple[tuple[float, ...], ...] = ()
    settle_s: float = 40.0
    tune_s: float = 168.8
    normalised: bool = True
    gain: tuple[float, ...] = ()
    start_sigma: tuple[float, ...] = (100.0, 3.0, 0.3, 0.03, 0.003)
    norm: tuple[float, ...] = field(default=())

    def __post_init__(self) -> None:
        """Raises ValueError, naming the setting."""
        _check(1, 1.0, self.start_sigma)
        _check_chain(self.order, 1.0)
        if not self.gain and not 1 <= len(self.q) <= CANDIDATES:
            raise ValueError(f"derivative: {len(self.q)} candidates for Q; give 1 to {CANDIDATES}")
        if any(len(one) != self.order or min(one) < 0.0 or max(one) <= 0.0 for one in self.q):
            raise ValueError("derivative: a candidate for Q is a diagonal of the chain, not negative and not zero")
        if self.gain and len(self.gain) != self.order:
            raise ValueError(f"derivative: a gain of {len(self.gain)} for a chain of {self.order}")
        if not (self.step_s > 0.0 and self.scale > 0.0 and self.sigma > 0.0):
            raise ValueError("derivative: step_s, scale and sigma must be positive")


def _check(axes: int, gap_s: float, start_sigma: Sequence[float]) -> None:
    if not 1 <= axes <= AXES:
        raise ValueError(f"derivative: {axes} axes; give 1 to {AXES}")
    if not gap_s > 0.0:
        raise ValueError(f"derivative: gap_s {gap_s} must be positive")
    if len(start_sigma) != STATES - 1 or not all(0.0 < s < math.inf for s in start_sigma):
        raise ValueError(f"derivative: start_sigma needs {STATES - 1} positive values")


def _check_chain(order: int, q: float) -> None:
    if not 2 <= order <= STATES:
        raise ValueError(f"derivative: a chain of {order}; give 2 to {STATES}")
    if not 0.0 <= q < math.inf:
        raise ValueError(f"derivative: q {q} is out of its range")


def norms(order: int) -> np.ndarray:
    """Norms (order,) of the columns of N_f, N_f[i, j] = i^(j-1): the second stage of the normalisation."""
    powers = np.arange(1, order + 1, dtype=float)[:, None] ** np.arange(order)
    return np.asarray(np.sqrt((powers**2).sum(axis=0)))


def _frozen(table: np.ndarray) -> np.ndarray:
    table.flags.writeable = False
    return table


class Bank:
    """Table and memory of a multiple-model filter."""

    __slots__ = ("state", "table")

    def __init__(self, settings: BankSettings) -> None:
        table = np.zeros(1, BANK_TABLE)
        record, models = table[0], settings.models
        record["models"], record["axes"], record["gap_s"] = len(models), settings.axes, settings.gap_s
        record["start_sigma"][1:] = settings.start_sigma
        for i, model in enumerate(models):
            record["order"][i], record["q"][i], record["stay_s"][i] = model.order, model.q, model.stay_s
            others = np.array([0.0 if k == i else other.enter for k, other in enumerate(models)])
            if len(models) > 1:
                record["enter"][i, : len(models)] = others / others.sum()
            else:
                record["stay_s"][i] = math.inf
        self.table, self.state = _frozen(table), np.zeros(1, BANK)


class Lagged:
    """Table and memory of a fixed-lag smoother. Steps so short that the lag needs more than LAG epochs shorten it."""

    __slots__ = ("state", "table")

    def __init__(self, settings: LagSettings) -> None:
        table = np.zeros(1, LAG_TABLE)
        for name in ("order", "q", "lag_s", "axes", "gap_s"):
            table[0][name] = getattr(settings, name)
        table[0]["start_sigma"][1:] = settings.start_sigma
        self.table, self.state = _frozen(table), np.zeros(1, LAG_STATE)


class Tuned:
    """Table and memory of the paper's algorithm."""

    __slots__ = ("state", "table")

    def __init__(self, settings: TunedSettings) -> None:
        table = np.zeros(1, TUNED_TABLE)
        record, n = table[0], settings.order
        record["order"], record["step_s"], record["scale"] = n, settings.step_s, settings.scale
        record["r"], record["candidates"] = settings.sigma**2, max(len(settings.q), 1)
        for i, one in enumerate(settings.q):
            record["q"][i, :n] = one
        record["settle_epochs"] = round(settings.settle_s / settings.step_s)
        record["tune_epochs"] = round(settings.tune_s / settings.step_s)
        record["normalised"] = settings.normalised
        record["fixed"] = bool(settings.gain)
        record["gain"][: len(settings.gain)] = settings.gain
        record["start_p"][0] = settings.sigma**2
        record["start_p"][1:] = np.square(settings.start_sigma)
        record["norm"][:n] = settings.norm or norms(n)
        self.table, self.state = _frozen(table), np.zeros(1, TUNED)


@dataclass(frozen=True)
class CheckSettings:
    """A velocity check; the fields of table `velocity_check`, flightsw/icd/velocity_check_schema.py."""

    q_m2ps3: float = 1e-9
    start_sigma_mps: float = 1.0
    armed_sigma_mps: float = 0.004
    reference: float = 0.3
    threshold: float = 30.1
    clear: float = 8.0
    step_max: float = 5.0
    gap_s: float = 60.0
    coloured_r_m: float = 0.0
    coloured_v_mps: float = 0.0
    coloured_s: float = 300.0


class Check:
    """Table and memory of a velocity check."""

    __slots__ = ("state", "table")

    def __init__(self, settings: CheckSettings) -> None:
        table = np.zeros(1, CHECK_TABLE)
        for name in CHECK_TABLE.names or ():
            table[0][name] = getattr(settings, name)
        self.table, self.state = _frozen(table), np.zeros(1, CHECK)
