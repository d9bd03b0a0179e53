"""A test that leaves a process and a folder behind; named on a command line it is collected."""

from __future__ import annotations

import subprocess
import tempfile


def test_leaves_something_behind() -> None:
    subprocess.Popen(["sleep", "1000"], start_new_session=True)
    assert tempfile.mkdtemp()
