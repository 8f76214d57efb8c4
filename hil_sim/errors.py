"""Errors that a person can act on: each says where and what to do; commands print them on one line."""

from __future__ import annotations


class SimulationError(Exception):
    """Base of everything hil_sim refuses with an explanation."""


class ScenarioError(SimulationError):
    """A scenario that may not run: file, key and remedy are in the text."""


class DataError(SimulationError):
    """Missing, unreadable or unsuitable input data: orbit files, Earth orientation, space weather."""


class BusError(SimulationError):
    """The simulated bus did not take or deliver what it must."""
