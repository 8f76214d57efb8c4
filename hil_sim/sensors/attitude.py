"""How the body is turned, truly and as it is reported; where that puts the antenna.

Body axes when it points to nadir: z along the nadir, y against the orbit normal, x completes, on the side of the flight
direction. An offset turns it from there by yaw, pitch, roll (3-2-1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hil_sim.scenario_schema import Attitude
from hil_sim.truth.interface import Truth
from hil_sim.truth.local_frames import rtn_axes

MINIMUM_SIGMA_RAD = 1e-6


@dataclass
class AttitudeSeries:
    """Attitudes of a run, one row each: instant measured and arrival (n,) [ns], quaternion as reported (n,4).

    The quaternion is a unit one, scalar first: v_body = q* v_gcrf q.
    """

    t_true_gps_ns: np.ndarray
    arrival_gps_ns: np.ndarray
    sent: np.ndarray
    q: np.ndarray
    sigma_rad: float


class Pointing(NamedTuple):
    """True attitude of the body: pointing to nadir, turned from there by constant angles [rad]."""

    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0

    @classmethod
    def of(cls, settings: Attitude | None) -> Pointing:
        """That of a scenario; exactly to nadir without the section."""
        if settings is None:
            return cls()
        return cls(*(math.radians(angle) for angle in (settings.yaw_deg, settings.pitch_deg, settings.roll_deg)))

    def body_axes(self, r_gcrf_m: np.ndarray, v_gcrf_mps: np.ndarray) -> np.ndarray:
        """Matrices (n,3,3) GCRF -> body at true positions and velocities (n,3); rows: the body's axes."""
        radial, along, cross = rtn_axes(r_gcrf_m, v_gcrf_mps).transpose(1, 0, 2)
        nadir = np.stack((along, -cross, -radial), axis=1)
        return np.einsum("ij,njk->nik", self._turned(), nadir)

    def lever(self, truth: Truth, t_gps_ns: np.ndarray, offset_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Position and velocity (n,3) [m, m/s], GCRF, of a point of the body (3,) [m] against its centre of mass.

        The body turns with the RTN axes: omega = h / r^2 along the normal, and r / h times the acceleration along the
        normal about the radius (Vallado, Fundamentals, 4th ed., 9.3, Gauss).
        """
        r, v = truth.state_gcrf(t_gps_ns)
        radial, _, normal = rtn_axes(r, v).transpose(1, 0, 2)
        radius = np.linalg.norm(r, axis=1)
        momentum = np.linalg.norm(np.cross(r, v), axis=1)
        # central gravity has no part along the normal: the residual has all of it
        sideways = np.einsum("ni,ni->n", truth.acceleration_residual(t_gps_ns), normal)
        omega = (momentum / radius**2)[:, None] * normal + (radius / momentum * sideways)[:, None] * radial
        offset_gcrf_m = np.einsum("nji,j->ni", self.body_axes(r, v), offset_m)
        return offset_gcrf_m, np.cross(omega, offset_gcrf_m)

    def _turned(self) -> np.ndarray:
        cy, sy = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        cp, sp = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        cr, sr = math.cos(self.roll_rad), math.sin(self.roll_rad)
        yaw = np.array([[cy, sy, 0.0], [-sy, cy, 0.0], [0.0, 0.0, 1.0]])
        pitch = np.array([[cp, 0.0, -sp], [0.0, 1.0, 0.0], [sp, 0.0, cp]])
        roll = np.array([[1.0, 0.0, 0.0], [0.0, cr, sr], [0.0, -sr, cr]])
        turned: np.ndarray = roll @ pitch @ yaw
        return turned


def measure(
    truth: Truth, pointing: Pointing, settings: Attitude, t_gps_ns: np.ndarray, stream: np.random.Generator
) -> AttitudeSeries:
    """Attitudes reported at instants (n,) [ns]: the true ones, turned about each body axis by white errors."""
    q = quaternions(pointing.body_axes(*truth.state_gcrf(t_gps_ns)))
    half = 0.5 * settings.sigma_rad * stream.standard_normal((len(t_gps_ns), 3))
    error = np.concatenate((np.ones((len(half), 1)), half), axis=1)
    reported = multiply(q, error / np.linalg.norm(error, axis=1, keepdims=True))
    return AttitudeSeries(
        t_true_gps_ns=t_gps_ns,
        arrival_gps_ns=t_gps_ns + round(settings.latency_s * 1e9),
        sent=np.ones(len(t_gps_ns), dtype=bool),
        q=reported,
        sigma_rad=max(settings.sigma_rad, MINIMUM_SIGMA_RAD),
    )


def quaternions(to_body: np.ndarray) -> np.ndarray:
    """Unit quaternions (n,4), scalar first and not negative, of matrices (n,3,3) GCRF -> body: v_body = q* v_gcrf q.

    Shepperd's method (Journal of Guidance and Control 1, 1978): the largest component by its square, the others by it.
    """
    m = to_body
    trace = np.trace(m, axis1=1, axis2=2)
    squares = np.stack((trace, m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]), axis=1)
    first = np.argmax(squares, axis=1)
    # products of components, four times: row i, column j is 4 q_i q_j
    w = np.stack((m[:, 1, 2] - m[:, 2, 1], m[:, 2, 0] - m[:, 0, 2], m[:, 0, 1] - m[:, 1, 0]), axis=1)
    products = np.empty((len(m), 4, 4))
    products[:, 0, 0] = 1.0 + trace
    products[:, 0, 1:] = products[:, 1:, 0] = w
    for i in range(3):
        for j in range(3):
            products[:, i + 1, j + 1] = m[:, i, j] + m[:, j, i] if i != j else 1.0 + 2.0 * m[:, i, i] - trace
    q = products[np.arange(len(m)), first]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    return np.where(q[:, :1] < 0.0, -q, q)


def multiply(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Quaternion products p q, (n,4) each, scalar first (Hamilton)."""
    p0, p1 = p[:, :1], p[:, 1:]
    q0, q1 = q[:, :1], q[:, 1:]
    scalar = p0 * q0 - np.einsum("ni,ni->n", p1, q1)[:, None]
    return np.concatenate((scalar, p0 * q1 + q0 * p1 + np.cross(p1, q1)), axis=1)
