"""Files that a case of bad input names."""

from __future__ import annotations

import io
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
from for_people import need_sentences

from station.cli import main

COLUMNS = "200"


def here(words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the command line in this process, which has its libraries loaded already."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.chdir(folder)
        patch.setenv("COLUMNS", COLUMNS)
        patch.setattr(sys, "argv", ["station", *words])
        with pytest.raises(SystemExit) as ended:
            main()
    code = ended.value.code
    assert isinstance(code, int)
    need_sentences(out.getvalue() + err.getvalue(), f"station {' '.join(words)}")
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())
