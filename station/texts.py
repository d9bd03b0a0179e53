"""The languages that people read: English stands in the code, others in catalogues.

An English sentence is the key of its translation, so that English costs nothing; a sentence that a
catalogue lacks is shown in English. What machines read is English in every language, and so is all
that is recorded: translated is what is shown.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, lru_cache, partial
from pathlib import Path

from station import registry

ENGLISH, PANEL, REPORT, RUN, TERMINAL, FLAGS = "en", "panel", "report", "run", "terminal", "flags"
FAULTS = "faults"
TAGS = {"zh": "zh-CN"}
"""Language and country of a language that more than one country writes: it chooses the signs."""
SHORT = 8
"""So long are the names of axes, of coefficients, and numbers at most."""
FEW = 3
"""Letters of a sentence that is tried last."""
FOLDER = Path(__file__).parent / "catalogues"
OF_PACKAGE = "texts"
"""The folder, in the package of a procedure or driver, of its catalogues: `texts/zh.json`."""
PLACE = re.compile(r"\{(\w+)\}")
"""The place of a value in a sentence."""
FORMS = {"n": "[-+]?[0-9.]+(?:e[-+]?[0-9]+)?", "symbol": r"\S+", "IA": "[-+A-Z0-9]{1,6}"}
"""What alone fills a place of that name: a number, a word, an axis; other places hold anything."""
AS_IT_IS = ("key", "keys")
"""How the name of a place ends whose value stands in files: it is the same in every language."""
INSTRUMENT = "instrument"
"""What, at the beginning, only the name of an instrument fills."""
REMEMBERED = 5000
"""Sentences of a language whose translation is not looked for again."""
LONGEST = 2000
"""Signs of a text of which a translation is looked for."""
DEEPEST = 8
"""So many sentences stand within one another at most; what is deeper stays English."""
BETWEEN = re.compile(r"(?<=[.!?…]) (?=[A-Z`])")
"""What stands between two sentences."""
OR_IF = ", or if "
"""What joins the clauses of a sentence that are translated each."""
LINES = re.compile(r"(\n *(?:- )?)")
"""What stands between two lines, of a list or not."""
WORD = re.compile(r"[A-Za-z\0]+")
COMBINATION = r"(?: ?[-+−]? ?(?:[0-9.]+(?:e[-+]?[0-9]+)? )?K\w+)+"
SAME = re.compile(
    rf"[-+]?[0-9.]+|[A-Z]{{1,2}}|[A-Za-z0-9]+_\w+|(?:[-+]?[xyz])+|`[^`]+`|{COMBINATION}"
)
"""Numbers, axes, coefficients, names of columns and commands: the same in every language."""
IDEOGRAPH = "[\u4e00-\u9fff]"
TOUCHING = re.compile(rf"(?<=[A-Za-z0-9])\0+(?={IDEOGRAPH})|(?<={IDEOGRAPH})\0+(?=[A-Za-z0-9])")
"""Where, with a zero at either end of a value, a blank stands between it and its sentence."""


def languages() -> tuple[str, ...]:
    """Return the languages there are, English first: each folder of catalogues is a language."""
    return (ENGLISH, *sorted(path.name for path in FOLDER.iterdir() if path.is_dir()))


def tag(language: str) -> str:
    """Return a language as pages and typesetters name it, with its country where that counts."""
    return TAGS.get(language, language)


@cache
def catalogue(language: str, room: str) -> dict[str, str]:
    """Return the translation of each English sentence of a room of the station; none for English.

    The rooms are the panel's own pages, reports, what runs say, the codes of flags, the terminal,
    and what is wrong with files and run folders.
    """
    if language == ENGLISH:
        return {}
    file = FOLDER / language / f"{room}.json"
    texts: dict[str, str] = json.loads(file.read_text(encoding="utf-8"))
    return texts


def of_packages(language: str) -> Iterator[tuple[str, str]]:
    """Yield what the packages of procedures and drivers say in a language, a laboratory's too.

    What is wrong with a catalogue costs its own sentences alone: they are shown in English.
    """
    groups = (registry.PROCEDURES, registry.DRIVERS)
    entries = [(group, name) for group in groups for name in registry.names(group)]
    for folder in dict.fromkeys(registry.folder_of(*entry) for entry in entries):
        try:
            file = (folder or FOLDER) / OF_PACKAGE / f"{language}.json"
            texts = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        for english, other in texts.items() if isinstance(texts, dict) else ():
            if isinstance(other, str) and is_sound(english, other):
                yield english, other


def is_sound(english: str, other: str) -> bool:
    """Return whether a sentence has words, and its translation the same values, each once."""
    names = places(english)
    has_words = bool(PLACE.sub("", english).strip())
    return has_words and names == places(other) and len(names) == len({*names})


def places(text: str) -> list[str]:
    """Return the names of the values in a sentence, in the order of the alphabet."""
    return sorted(PLACE.findall(text))


@cache
def whole(language: str) -> dict[str, str]:
    """Return all that is translated into a language; the station's own rooms count first.

    Of the panel's pages only what holds no value: "{a} of {b}" would be found in any sentence.
    """
    pages = catalogue(language, PANEL).items()
    return {
        **dict(of_packages(language)),
        **{english: other for english, other in pages if not PLACE.search(english)},
        **catalogue(language, FAULTS),
        **catalogue(language, TERMINAL),
        **catalogue(language, RUN),
        **catalogue(language, REPORT),
    }


def filling(name: str) -> str:
    """Return the regular expression of what may fill a place."""
    return FORMS.get(name, "(?:(?![;:] ).)+?" if name.endswith(AS_IT_IS) else ".+?")


class Pattern:
    """A sentence that holds values."""

    def __init__(self, english: str, other: str) -> None:
        self.english, self.other = english, other
        self._parts = PLACE.split(english)[::2]
        self.letters = len("".join("".join(self._parts).split()))
        """So many of its signs are not values."""
        # A word that touches a value may be a part of a longer one of the text.
        self.words = {word for word in WORD.findall("\0".join(self._parts)) if "\0" not in word}
        names, parts = PLACE.findall(english), [re.escape(part) for part in self._parts]
        self.begins = "" if self._parts[0] else names[0]
        """The value with which it begins."""
        self.is_line = self._parts[1] == ":"
        """Whether it begins with the line of a file, `plan.yaml:3`."""
        values = [
            f"(?P<{name}>{filling(name)}){part}"
            for name, part in zip(names, parts[1:], strict=True)
        ]
        if values and not parts[-1]:
            values[-1] = f"(?s:{values[-1]})"  # a list of lines may come last
        self._quoted = {name for name in names if f"`{{{name}}}`" in english}
        """Values that are what is typed, in every language."""
        self._pattern = re.compile("".join((parts[0], *values)))

    def may_begin(self, value: str, translation: str) -> bool:
        """Return whether a value may stand at the beginning; any sentence may hold "at"."""
        if self.begins == INSTRUMENT:
            from station.roles.role import role, role_of

            return not {" ", ":"} & {*value} and role(role_of(value)) is not None
        is_name = (
            self.is_line
            or bool(SAME.fullmatch(value))
            or (" " not in value and not value.isalpha())
        )
        is_short = len(value) <= max(SHORT, 2 * self.letters)
        return (
            is_name or is_short or value != translation or not any(sign.isalpha() for sign in value)
        )

    def inserted(
        self, values: Mapping[str, str], translated: Callable[[str], str]
    ) -> dict[str, str]:
        """Return the values as the translation has them."""
        return {
            name: value if name in self._quoted or name.endswith(AS_IT_IS) else translated(value)
            for name, value in values.items()
        }

    def values(self, text: str) -> dict[str, str]:
        """Return the values of a text; none where it is another sentence."""
        if not all(part in text for part in self._parts):
            return {}
        match = self._pattern.fullmatch(text)
        return {name: value.strip() for name, value in match.groupdict().items()} if match else {}


@cache
def translator(language: str) -> Callable[[str], str]:
    """Return what translates into a language; a text that no catalogue knows stays English."""
    exact: Mapping[str, str] = whole(language)
    patterns = [Pattern(english, other) for english, other in exact.items() if "{" in english]
    # What is said of a line, of a unit of work, or of a request, holds a sentence of its own;
    # what is hardly a word, as " is ", stands in other sentences too.
    outer = {*catalogue(language, RUN).values()}
    first = {own for own in patterns if own.is_line or (own.other in outer and own.letters >= FEW)}
    patterns.sort(key=lambda own: (own not in first, -own.letters))
    counts = Counter(word for pattern in patterns for word in pattern.words)
    having: dict[str, list[int]] = {}
    for index, pattern in enumerate(patterns):
        rarest = min(pattern.words, key=lambda word: (counts[word], word), default="")
        having.setdefault(rarest, []).append(index)

    @lru_cache(maxsize=REMEMBERED)
    def translated(text: str, depth: int = 0) -> str:
        for known in (text, text.replace("_", " ")):
            if known in exact:
                return exact[known]
        if (several := listed(BETWEEN.split(text), "", depth)) is not None:
            return several
        if "; " in text and (whole_sentence := filled(text, depth, "; ")) is not None:
            return whole_sentence
        if (several := listed(text.split("; "), "; ", depth)) is not None:
            return several
        clauses = [text] if text.endswith(".") else text.split(OR_IF)
        if (several := listed(clauses, OR_IF, depth)) is not None:
            return several
        if (sentence := filled(text, depth)) is not None:
            return sentence
        if "\n" in text:
            lines = LINES.split(text)
            lines[::2] = [translated(line, depth) if line else line for line in lines[::2]]
            return "".join(lines)
        parts = text.replace(", and ", ", ").replace(" and ", ", ").split(", ")
        several = listed(parts, ", ", depth)
        return text if several is None else several

    def filled(text: str, depth: int, holding: str = "") -> str | None:
        """Return a text as a pattern has it that holds something itself; None where none fits."""
        if depth == DEEPEST:
            return None
        words = {"", *WORD.findall(text)}
        for index in sorted(index for word in words for index in having.get(word, ())):
            pattern = patterns[index]
            given = pattern.values(text) if holding in pattern.english else {}
            values = pattern.inserted(given, partial(translated, depth=depth + 1))
            begins = given.get(pattern.begins, "")
            if values and pattern.may_begin(begins, values.get(pattern.begins, "")):
                ends = {name: f"\0{value}\0" for name, value in values.items()}
                return TOUCHING.sub(" ", pattern.other.format(**ends)).replace("\0", "")
        return None

    def listed(parts: Sequence[str], joint: str, depth: int) -> str | None:
        """Return a list of what is known in the language; None for what is no such list."""
        others = [translated(part, depth) for part in parts] if len(parts) > 1 else parts
        kept = [part for part, other in zip(parts, others, strict=True) if part == other]
        if len(parts) == 1 or not all(map(SAME.fullmatch, kept)):
            return None
        return (joint if len(kept) == len(parts) else exact.get(joint, joint)).join(others)

    return translated


class AsTyped(str):
    """What a person typed, such as a name: in no language is it another one."""


class Texts:
    """The texts of a language, or of two of which the first stands above the second.

    `wanted` names them, such as `zh` or `zh+en`.
    """

    def __init__(self, wanted: str = ENGLISH) -> None:
        self.languages = tuple(wanted.split("+"))

    def __call__(self, text: str) -> str:
        """Return a text in the languages, one to a line; English where there is no translation."""
        inner = text.strip()
        if self.languages == (ENGLISH,) or not inner or len(inner) > LONGEST:
            return text
        if isinstance(text, AsTyped):
            return text
        return "\n".join(dict.fromkeys(translator(language)(inner) for language in self.languages))


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
