"""The head of a run's log."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def head_of(folder: Path) -> dict[str, Any]:
    text = (folder / "served.json").read_text(encoding="utf-8").splitlines()[0]
    head: dict[str, Any] = json.loads(text)
    return head
