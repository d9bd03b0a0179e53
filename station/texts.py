"""The languages that people read: English stands in the code, others in `catalogues/`.

An English sentence is the key of its translation, so that English costs nothing; a sentence that a
catalogue lacks is shown in English. What machines read is English in every language.
"""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path

ENGLISH, PANEL, REPORT = "en", "panel", "report"
SHORT = 8
"""So long are the names of axes, of coefficients, and numbers at most."""
FOLDER = Path(__file__).parent / "catalogues"
PLACE = re.compile(r"\\{(\w+)\\}")
"""The place of a value in a sentence that is escaped for a regular expression."""


def languages() -> tuple[str, ...]:
    """Return the languages there are, English first: each folder of catalogues is a language."""
    return (ENGLISH, *sorted(path.name for path in FOLDER.iterdir() if path.is_dir()))


@cache
def catalogue(language: str, room: str) -> dict[str, str]:
    """Return the translation of each English sentence of the panel or report; none for English."""
    if language == ENGLISH:
        return {}
    file = FOLDER / language / f"{room}.json"
    texts: dict[str, str] = json.loads(file.read_text(encoding="utf-8"))
    return texts


class Texts:
    """The texts of a report in a language, or in two of which the first stands above the second.

    `wanted` names them, such as `zh` or `zh+en`.
    """

    def __init__(self, wanted: str = ENGLISH) -> None:
        self.languages = tuple(wanted.split("+"))
        self._exact = [catalogue(language, REPORT) for language in self.languages]
        self._patterns = [_patterns(texts) for texts in self._exact]

    def __call__(self, text: str) -> str:
        """Return a text in the languages, one to a line; English where there is no translation."""
        inner = text.strip()
        if self.languages == (ENGLISH,) or not inner:
            return text
        pairs = zip(self._exact, self._patterns, strict=True)
        return "\n".join(dict.fromkeys(self._translated(inner, *pair) for pair in pairs))

    def _translated(
        self, text: str, exact: dict[str, str], patterns: list[tuple[re.Pattern[str], str]]
    ) -> str:
        if text in exact:
            return exact[text]
        for pattern, translation in patterns:
            if match := pattern.fullmatch(text):
                values = {
                    name: self._translated(value, exact, patterns)
                    for name, value in match.groupdict().items()
                }
                begins = next((name for name, at in match.re.groupindex.items() if at == 1), "")
                # Any sentence may hold "at": a value at its beginning is short, or known itself.
                known = values[begins] != match[begins] or len(match[begins]) <= SHORT
                if match.start(begins) > 0 or known:
                    return translation.format(**values)
        return text


def _patterns(texts: dict[str, str]) -> list[tuple[re.Pattern[str], str]]:
    """Return the sentences that hold values, as patterns with the translation of each."""
    return [
        (re.compile(PLACE.sub(r"(?P<\1>.+?)", re.escape(english)), re.DOTALL), other)
        for english, other in texts.items()
        if "{" in english
    ]


IN_ENGLISH = Texts()


def choices() -> tuple[str, ...]:
    """Return what a report can be written in: each language, and each above English."""
    others = languages()[1:]
    return (*languages(), *(f"{other}+{ENGLISH}" for other in others))


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
