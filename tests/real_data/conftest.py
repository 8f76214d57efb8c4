"""Where the real data lie: the variable LEONAV_DATA, else ../shared/data beside the repository."""

from pathlib import Path

import pytest

from hil_sim.scenario import data_folder


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real data; the test is skipped with a reason where it is absent."""
    folder = data_folder()
    if not folder.is_dir():
        pytest.skip(f"no real data at {folder}: set LEONAV_DATA to their folder")
    return folder
