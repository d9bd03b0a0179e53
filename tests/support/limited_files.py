"""Files that may not grow."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from command_line import station_command
from for_people import need_sentences

LIMITED = """
import os, resource, sys
os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
sys.dont_write_bytecode = True
hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv.pop(1)), hard))
from station.cli import main
main()
"""
"""A program that takes the size and a command line. Where a file may not grow, Python would leave
half of a compiled module behind, for whoever comes next."""


def limited(largest_file_bytes: int, plan: Path, output: Path) -> subprocess.CompletedProcess[str]:
    """Run a plan in a process whose files may not grow beyond a size."""
    arguments = station_command("run", plan, "--non-interactive", "--json", "--output", output)[3:]
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(largest_file_bytes), *arguments],
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )
    need_sentences(done.stdout + done.stderr, "station run")
    return done
