"""Files of a run folder, read with care: anybody may have put anything there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from station.record.files import is_own_file

MAX_BYTES = 16_000_000
"""Of a file that is read as a whole."""
MAX_LINE = 4_000_000


def read_json(path: Path) -> dict[str, Any]:
    """Return the mapping of a JSON file, empty where it cannot be read."""
    return mapping(own_text(path))


def own_text(path: Path) -> str:
    """Return the text of a file, empty where it cannot be read, is a link, or is too large."""
    try:
        if not is_own_file(path) or path.stat().st_size > MAX_BYTES:
            return ""
        return path.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return ""


def first_line(path: Path) -> dict[str, Any]:
    """Return the mapping in the first line of a log, empty where it cannot be read."""
    try:
        if not is_own_file(path):
            return {}
        with path.open(encoding="utf-8") as log:
            return mapping(log.readline(MAX_LINE))
    except (OSError, ValueError):
        return {}


def mapping(text: str) -> dict[str, Any]:
    """Return the mapping that a JSON text is, an empty one where it is none."""
    try:
        data = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return data if isinstance(data, dict) else {}


def words(value: object) -> str:
    """Return a text that any answer can hold, empty for what is no text."""
    return value.encode(errors="replace").decode() if isinstance(value, str) else ""
