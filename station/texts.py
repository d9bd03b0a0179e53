"""The languages that people read: English stands in the code, others in `catalogues/`.

An English sentence is the key of its translation, so that English costs nothing; a sentence that a
catalogue lacks is shown in English. What machines read is English in every language.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

ENGLISH = "en"
FOLDER = Path(__file__).parent / "catalogues"


def languages() -> tuple[str, ...]:
    """Return the languages there are, English first: a file in the folder is a language."""
    return (ENGLISH, *sorted(path.stem for path in FOLDER.glob("*.json")))


@cache
def catalogue(language: str) -> dict[str, str]:
    """Return the translation of each English sentence; nothing for English."""
    if language == ENGLISH:
        return {}
    texts: dict[str, str] = json.loads((FOLDER / f"{language}.json").read_text(encoding="utf-8"))
    return texts


def preferred(wishes: str) -> str:
    """Return the first language there is of an `Accept-Language` header; English without one."""
    ranked: list[tuple[float, str]] = []
    for wish in wishes.split(","):
        tag, _, weight = wish.partition(";")
        name = tag.strip().lower().partition("-")[0]
        try:
            rank = float(weight.strip().removeprefix("q=") or 1.0)
        except ValueError:
            continue
        if name in languages() and rank > 0:
            ranked.append((rank, name))
    return max(ranked, key=lambda pair: pair[0], default=(1.0, ENGLISH))[1]
