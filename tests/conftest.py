"""What every test stands on: a state folder of its own, so that no test knows of another's trip."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from station.cli import ONE_BLAS_THREAD

os.environ.update(ONE_BLAS_THREAD)  # as a run has it; NumPy reads it when it is first imported


@pytest.fixture(autouse=True, scope="session")
def state_folder_of_the_tests(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Keep what the station remembers between runs away from the user's own folder."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("state")
        patch.setenv("XDG_STATE_HOME", str(folder))
        yield folder
