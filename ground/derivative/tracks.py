"""Whole tracks through the estimators that fly: a compiled `for` around each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flightsw.derivative.bank import bank_epoch
from flightsw.derivative.declare import ROOM, entry, kernel
from flightsw.derivative.lagged import lagged_epoch, lagged_look
from flightsw.derivative.records import BANK, BANK_TABLE, LAG_STATE, LAG_TABLE, TUNED, TUNED_TABLE
from flightsw.derivative.setup import Bank, BankSettings, Lagged, LagSettings, Tuned, TunedSettings
from flightsw.derivative.tuned import tuned_epoch
from flightsw.kernels.registry import MATRIX, VECTOR, frozen_records, records, types

_CUBE = types.Array(types.float64, 3, "C")
KEPT = 3  # states that a track keeps: position, velocity, acceleration


class Track(NamedTuple):
    """Estimates (m, axes, 3) at m epochs with their sigmas, NaN where there is none.

    Of a bank also the weights (m, models), and how well each position was foretold: nis (m,), about one.
    """

    mean: np.ndarray
    sigma: np.ndarray
    weight: np.ndarray
    nis: np.ndarray


@entry(frozen_records(BANK_TABLE), records(BANK), VECTOR, MATRIX, MATRIX, _CUBE, _CUBE, MATRIX, VECTOR)
def _bank_track(table, bank, t_s, z, sigma, mean, spread, weight, nis):
    _ = ROOM
    for k in range(t_s.shape[0]):
        dt_s = t_s[k] - t_s[k - 1] if k > 0 else 0.0
        bank_epoch(table, bank, dt_s, z[k], sigma[k])
        for axis in range(z.shape[1]):
            for s in range(mean.shape[2]):
                mean[k, axis, s] = bank[0]["mean"][axis, s]
                spread[k, axis, s] = max(bank[0]["covariance"][axis, s, s], 0.0) ** 0.5
        nis[k] = bank[0]["nis"]
        for i in range(weight.shape[1]):
            weight[k, i] = bank[0]["weight"][i]


@kernel
def _copy(state, mean, spread):
    for axis in range(mean.shape[0]):
        for s in range(mean.shape[1]):
            mean[axis, s] = state[0]["mean"][axis, s]
            spread[axis, s] = max(state[0]["covariance"][axis, s, s], 0.0) ** 0.5


@entry(frozen_records(LAG_TABLE), records(LAG_STATE), VECTOR, MATRIX, MATRIX, _CUBE, _CUBE)
def _lagged_track(table, state, t_s, z, sigma, mean, spread):
    _ = ROOM
    asked = 0  # first epoch without an answer
    for k in range(t_s.shape[0]):
        kept = state[0]["count"]
        outcome = lagged_epoch(table, state, t_s[k], z[k], sigma[k])
        if outcome < 0:
            continue
        if k > 0 and state[0]["count"] == 1 and kept > 0:
            asked = k  # a gap: what lies before it has its last answers already
        if outcome == 1:
            answered = state[0]["t_answer_s"]
            while asked < k and t_s[asked] < answered:  # a long step may have taken several past the lag at once
                if k - asked < state[0]["count"] and lagged_look(table, state, k - asked) == 1:
                    _copy(state, mean[asked], spread[asked])
                asked += 1
            if state[0]["t_answer_s"] == answered or lagged_look(table, state, k - asked) == 1:
                _copy(state, mean[asked], spread[asked])
            asked += 1
        last = k + 1 == t_s.shape[0] or t_s[k + 1] - t_s[k] > table[0]["gap_s"]
        if last:  # nothing later will come: the rest of this stretch is answered with what there is
            for age in range(state[0]["count"]):
                if k - age >= asked and lagged_look(table, state, age) == 1:
                    _copy(state, mean[k - age], spread[k - age])


@entry(frozen_records(TUNED_TABLE), records(TUNED), VECTOR, MATRIX)
def _tuned_track(table, state, z, mean):
    _ = ROOM
    for k in range(z.shape[0]):
        tuned_epoch(table, state, z[k])
        for s in range(mean.shape[1]):
            mean[k, s] = state[0]["mean"][s]


def causal(settings: BankSettings, t_s: np.ndarray, z: np.ndarray, sigma: np.ndarray) -> Track:
    """The multiple-model filter over positions z (m, axes) with sigmas (m, axes) at t_s (m,), ascending."""
    bank = Bank(settings)
    shape = (*z.shape, KEPT)
    weight = np.zeros((len(t_s), len(settings.models)))
    track = Track(np.full(shape, np.nan), np.full(shape, np.nan), weight, np.full(len(t_s), np.nan))
    _bank_track(bank.table, bank.state, t_s, z, sigma, *track)
    return track


def smoothed(settings: LagSettings, t_s: np.ndarray, z: np.ndarray, sigma: np.ndarray) -> Track:
    """The fixed-lag smoother over positions as in `causal`, all finite: at each epoch what is known lag_s later."""
    lagged = Lagged(settings)
    shape = (*z.shape, KEPT)
    track = Track(np.full(shape, np.nan), np.full(shape, np.nan), np.zeros((len(t_s), 0)), np.zeros(0))
    _lagged_track(lagged.table, lagged.state, t_s, z, sigma, track.mean, track.sigma)
    return track


class TunedTrack(NamedTuple):
    """Estimates (m, 3) of the paper's algorithm; the gain it ended with, which Q that was, and the cost of each."""

    mean: np.ndarray
    gain: np.ndarray
    chosen: int
    cost: np.ndarray


def tuned(settings: TunedSettings, z: np.ndarray) -> TunedTrack:
    """The paper's algorithm over positions z (m,) at its constant step."""
    one = Tuned(settings)
    mean = np.full((len(z), KEPT), np.nan)
    _tuned_track(one.table, one.state, z, mean)
    state = one.state[0]
    gain = np.array(state["gain_now"][: settings.order])
    return TunedTrack(mean, gain, int(state["chosen"]), np.array(state["cost"][: max(len(settings.q), 1)]))
