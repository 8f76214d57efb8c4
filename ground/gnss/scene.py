"""Random epochs of a user of GPS, GLONASS and Galileo: nominal Walker constellations, noise laws, faults.

Ranges are made here by an exact rotation of the Earth during the flight; nothing is shared with the flight kernels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from flightsw.gnss.epoch import gnss_epoch
from flightsw.gnss.records import EPOCH, RESULT, SATELLITES
from flightsw.gnss.setup import EARTH_RATE_RADPS, Memory, Settings
from flightsw.kernels.registry import warm_up
from hil_sim.truth.constellation.orbits import Walker

LIGHT_MPS = 299_792_458.0
EARTH_RADIUS_M = 6_371_000.0
CONSTELLATIONS = (
    Walker(24, 6, 2, 26_559_700.0, 55.0),
    Walker(24, 3, 1, 25_508_000.0, 64.8),
    Walker(24, 3, 1, 29_599_800.0, 56.0),
)
LAWS = ("gauss", "uniform", "laplace", "student", "spikes")
SIGMA_M = 6.0  # the paper's unit weight: a variance of 36
BIAS_M = 30.0
_POOL = 400
_SPIKE_SHARE, _SPIKE_SIZE = 0.01, 10.0


@dataclass(frozen=True)
class User:
    """Who measures: height above a spherical Earth, elevation mask, which constellations are there."""

    altitude_m: float = 0.0
    mask_deg: float = 5.0
    constellations: tuple[int, ...] = (0, 1, 2)


@dataclass
class Batch:
    """m epochs ready to be judged.

    truth_m (m,3); count (m,): rows; fault (m,64) bool: rows that carry one; exact_m (m,64): ranges without noise.
    """

    epochs: np.ndarray
    truth_m: np.ndarray
    count: np.ndarray
    fault: np.ndarray
    exact_m: np.ndarray


@lru_cache(maxsize=1)
def _pool() -> np.ndarray:
    """Positions (times, satellites, 3) of all satellites at times that no period divides."""
    return np.stack([np.concatenate([w.states(7_919.0 * k)[0] for w in CONSTELLATIONS]) for k in range(_POOL)])


_SYSTEM = np.repeat(np.arange(3), 24)


def noise(law: str, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Errors of zero mean and unit variance."""
    if law == "gauss":
        return rng.standard_normal(shape)
    if law == "uniform":
        return rng.uniform(-math.sqrt(3.0), math.sqrt(3.0), shape)
    if law == "laplace":
        return rng.laplace(0.0, math.sqrt(0.5), shape)
    if law == "student":
        return rng.standard_t(5, shape) * math.sqrt(3.0 / 5.0)
    if law == "spikes":
        spiked = rng.random(shape) < _SPIKE_SHARE
        variance = 1.0 - _SPIKE_SHARE + _SPIKE_SHARE * _SPIKE_SIZE**2
        return rng.standard_normal(shape) * np.where(spiked, _SPIKE_SIZE, 1.0) / math.sqrt(variance)
    raise ValueError(f"noise law {law}: there are {', '.join(LAWS)}")


def renew(batch: Batch, rng: np.random.Generator, law: str = "gauss", sigma_m: float = SIGMA_M) -> None:
    """New noise on the same geometry, and no fault."""
    batch.epochs["range_m"] = batch.exact_m + sigma_m * noise(law, rng, batch.exact_m.shape)
    batch.fault[:] = False


def draw(
    user: User,
    rng: np.random.Generator,
    m: int,
    law: str = "gauss",
    sigma_m: float = SIGMA_M,
    bias_m: float = BIAS_M,
) -> Batch:
    """m random epochs without a fault: place, time, clocks of the receiver per constellation, noise.

    bias_m: 1-sigma of the biases between constellations.
    """
    satellite = _pool()[rng.integers(0, _POOL, m)]
    z = rng.uniform(-1.0, 1.0, m)
    longitude = rng.uniform(0.0, 2.0 * math.pi, m)
    up = np.stack((np.sqrt(1.0 - z * z) * np.cos(longitude), np.sqrt(1.0 - z * z) * np.sin(longitude), z), axis=1)
    truth = up * (EARTH_RADIUS_M + user.altitude_m)
    line = satellite - truth[:, None, :]
    distance = np.linalg.norm(line, axis=2)
    elevation = np.einsum("mnk,mk->mn", line, up) / distance
    seen = (elevation > math.sin(math.radians(user.mask_deg))) & np.isin(_SYSTEM, user.constellations)
    for _ in range(3):  # flight time through the turning Earth
        angle = EARTH_RATE_RADPS * distance / LIGHT_MPS
        cosine, sine = np.cos(angle), np.sin(angle)
        x, y = satellite[..., 0], satellite[..., 1]
        turned = np.stack((cosine * x + sine * y, cosine * y - sine * x, satellite[..., 2]), axis=2)
        distance = np.linalg.norm(turned - truth[:, None, :], axis=2)
    clock = rng.uniform(-3e5, 3e5, (m, 1)) + np.concatenate((np.zeros((m, 1)), rng.normal(0.0, bias_m, (m, 2))), axis=1)
    exact_m = np.zeros((m, SATELLITES))
    order = np.argsort(~seen, axis=1, kind="stable")[:, :SATELLITES]
    epochs = np.zeros(m, EPOCH)
    wide = order.shape[1]
    rows = np.arange(m)[:, None]
    count = np.minimum(seen.sum(axis=1), SATELLITES)
    epochs["count"] = count
    epochs["satellite"][:, :wide] = order % 24 + 1
    epochs["constellation"][:, :wide] = _SYSTEM[order]
    exact_m[:, :wide] = (distance + clock[:, _SYSTEM])[rows, order]
    epochs["sigma_m"][:, :wide] = sigma_m
    epochs["r_m"][:, :wide] = satellite[rows, order]
    batch = Batch(epochs, truth, count, np.zeros((m, SATELLITES), bool), exact_m)
    renew(batch, rng, law, sigma_m)
    return batch


def of_epochs(epochs: np.ndarray) -> Batch:
    """Epochs of any origin as a batch; nothing is known of their truth."""
    m = len(epochs)
    return Batch(epochs, np.zeros((m, 3)), epochs["count"], np.zeros((m, SATELLITES), bool), epochs["range_m"].copy())


def add_faults(batch: Batch, rng: np.random.Generator, faults: int, size_m: float) -> None:
    """Bias that many random rows of every epoch by size_m [m], signs at random."""
    present = np.arange(SATELLITES) < batch.count[:, None]
    order = np.argsort(np.where(present, rng.random(present.shape), 2.0), axis=1)[:, :faults]
    rows = np.arange(len(order))[:, None]
    sign = rng.choice((-1.0, 1.0), order.shape)
    batch.epochs["range_m"][rows, order] += sign * size_m
    batch.fault[rows, order] = True


def judge(batch: Batch, settings: Settings) -> np.ndarray:
    """Results (m,) of RESULT of the flight test."""
    warm_up()
    memory = Memory(settings)
    result = np.zeros(len(batch.epochs), RESULT)
    gnss_epoch(memory.table, batch.epochs, memory.work, result)
    return result


def excluded(result: np.ndarray) -> np.ndarray:
    """Rows left out, as (m, 64) bool."""
    return (result["excluded"].astype(np.uint64)[:, None] >> np.arange(SATELLITES, dtype=np.uint64)) & np.uint64(1) == 1


def exact(batch: Batch, result: np.ndarray) -> np.ndarray:
    """(m,) bool: exactly the faulty rows are left out of a fix that passed."""
    return (result["verdict"] <= 2) & (excluded(result) == batch.fault).all(axis=1)
