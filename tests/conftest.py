"""Shared by all tests: one fixed hypothesis profile, and the way to the real data."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

# Derandomised: a test either fails always or never. No deadline: a busy machine is no error.
settings.register_profile("leonav", derandomize=True, deadline=None, database=None)
settings.load_profile("leonav")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[object]:
    """Keep the collector of garbage from what is imported: none of it is, and to look through it takes 0.3 s a time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


_ROOT = Path(__file__).resolve().parents[1]


def find_repo_data_dir() -> Path | None:
    """The shared real data: $LEONAV_DATA, else ../shared/data beside the repository; None where absent."""
    path = Path(os.environ.get("LEONAV_DATA", _ROOT.parent / "shared" / "data"))
    return path if path.is_dir() else None


@pytest.fixture(scope="session")
def repo_data_dir() -> Path:
    """The folder of the shared real data; skips the test where it is absent."""
    path = find_repo_data_dir()
    if path is None:
        pytest.skip("shared real data absent: set LEONAV_DATA or put it at ../shared/data")
    return path
