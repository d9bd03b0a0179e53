"""What a run or a plan says, as the panel shows it in the language of a viewer."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from station.texts import Texts

STATE = (
    *("title", "sentence", "message", "text", "checklist", "then", "name"),
    *("read_back", "why"),
)
LIVE = ("set", "said", "text", "now", "name")
LOOK = ("title", "text", "warnings", "faults", "which", "quantity", "note")
HOME = ("title", "what")
OF_RESULTS = ("message", "name")
ANSWER = ("said",)
ERROR = ("error",)


def translated(data: Any, texts: Texts, names: Collection[str], name: str = "") -> Any:
    """Return data of JSON with the texts that stand under some names in a language."""
    if isinstance(data, dict):
        return {key: translated(value, texts, names, key) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [translated(value, texts, names, name) for value in data]
    return texts(data) if name in names and isinstance(data, str) else data
