"""A track of several pieces: where the force jumps, at either end of a burn, one polynomial must not reach across."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from hil_sim.truth.hermite import HermiteTrack


class PiecewiseTrack:
    """Pieces end to end. edges_ns (k,) rising: piece i + 1 serves from edges_ns[i] on.

    Every piece covers its own span and may reach beyond it.
    """

    def __init__(self, edges_ns: Sequence[int], pieces: Sequence[HermiteTrack]) -> None:
        if len(pieces) != len(edges_ns) + 1 or any(b <= a for a, b in pairwise(edges_ns)):
            raise ValueError(f"{len(pieces)} pieces need {len(pieces) - 1} rising edges")
        for edge_ns, (before, after) in zip(edges_ns, pairwise(pieces), strict=True):
            if before.t_last_ns < edge_ns or after.t_first_ns > edge_ns:
                raise ValueError("a piece does not reach its edge")
        self._edges_ns = np.array(edges_ns, dtype=np.int64)
        self._pieces = tuple(pieces)

    @property
    def t_first_ns(self) -> int:
        """First instant served [ns]."""
        return self._pieces[0].t_first_ns

    @property
    def t_last_ns(self) -> int:
        """Last instant served [ns]."""
        return self._pieces[-1].t_last_ns

    def evaluate(self, t_ns: np.ndarray, derivatives: int = 1) -> list[np.ndarray]:
        """[r (n,3) m, v (n,3) m/s, a (n,3) m/s2, ...] up to `derivatives`; ValueError outside the track.

        At an edge the piece that begins there is taken: what jumps has the value after it.
        """
        t_ns = np.atleast_1d(np.asarray(t_ns, dtype=np.int64))
        at = np.searchsorted(self._edges_ns, t_ns, side="right")
        results = [np.empty((len(t_ns), 3)) for _ in range(derivatives + 1)]
        for i in np.unique(at):
            rows = np.flatnonzero(at == i)
            for result, part in zip(results, self._pieces[i].evaluate(t_ns[rows], derivatives), strict=True):
                result[rows] = part
        return results
