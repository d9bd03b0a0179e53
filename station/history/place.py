"""Where the history is; this alone is read where nobody keeps one."""

from __future__ import annotations

import os
import re
from pathlib import Path

URL = "STATION_HISTORY"
"""The environment variable that names another database, such as `postgresql+psycopg://…`."""
FILE = ".history.sqlite3"
"""Hidden, so that `runs/*` stays the run folders alone."""
DATABASE = re.compile(r"(sqlite|postgresql|mysql|mariadb|mssql|oracle)(\+\w+)?://")
"""How the URL of a database begins, unlike that of a place with run folders."""


def url_of(parent: Path) -> str:
    """Return the URL of the history of the runs below `parent`."""
    return os.environ.get(URL) or beside(parent)


def beside(parent: Path) -> str:
    """Return the URL of the history that stands beside the run folders."""
    return f"sqlite:///{parent / FILE}"


def is_kept(parent: Path) -> bool:
    """Whether somebody asked for a history of the runs below `parent` before, or names one."""
    return bool(os.environ.get(URL)) or (parent / FILE).is_file()
