"""What a laboratory states on paper, held against what can be: words that say something, dates."""

from __future__ import annotations

import datetime as dt
import re
import unicodedata
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from station.clock import local_time, utc_today
from station.files.faults import Fault
from station.files.yaml.document import Document, Where, leaves

TO_BE_WRITTEN = re.compile(
    "fixme|tba|tbd|tobeconfirmed|tobedefined|tobedetermined|todo|notapplicable|notknown|unknown|"
    "xxx+|不详|不适用|待定|待填|未知"
)
"""What stands where nothing is written yet, its letters and digits alone, in small letters."""
NOTHING = ("0", "n/a", "n.a.", "xx")
"""What does so in this form alone: `0 %` is a number, and Na is a name."""
INVISIBLE = "\u115f\u1160\u3164\uffa0"
"""Letters that print nothing."""
OF_PLAN = ("operator", "customer", "references", "deviations", "dut", "room")
"""Keys of a plan that stand on a certificate."""


def says_something(text: str) -> bool:
    """Tell whether a text has a letter or a digit, and is no mark of what is still to be written.

    A letter of any script counts that prints something. A name in angle brackets is such a mark, as
    templates have it.
    """
    bare = text.strip()
    if (bare.startswith("<") and bare.endswith(">")) or bare.casefold() in NOTHING:
        return False
    letters = "".join(
        letter
        for letter in unicodedata.normalize("NFKC", bare).casefold()
        if letter.isalnum() and letter not in INVISIBLE
    )
    return bool(letters) and not TO_BE_WRITTEN.fullmatch(letters)


def statements_of_plan(document: Document) -> Iterator[Fault]:
    """Yield each text of a plan that says nothing, and a receipt that is still to come."""
    for key in OF_PLAN:
        yield from wordless(document, (key,))
    where: Where = ("dut", "received")
    if (date := future_date(document, where)) is not None:
        yield document.fault(where, f"the receipt on {date} is in the future; look at the year")


def statements_of_bench(document: Document) -> Iterator[Fault]:
    """Yield each text of laboratory and records that says nothing, and records of the future."""
    yield from wordless(document, ("laboratory",))
    for name in document.data["instruments"]:
        record: Where = ("instruments", name, "calibration")
        yield from wordless(document, record)
        if (date := future_date(document, (*record, "date"))) is not None:
            what = f"the calibration of {date} is in the future; look at the year"
            yield document.fault((*record, "date"), what)


def wordless(document: Document, where: Where) -> Iterator[Fault]:
    """Yield a fault for each text below a place of a file that says nothing."""
    for place, value in leaves(_at(document, where), where):
        if isinstance(value, str) and not says_something(value):
            yield document.fault(place, "says nothing; write what it is, or leave the key out")


def future_date(document: Document, where: Where) -> dt.date | None:
    """Return the date at a place of a file where it is after today, None where not.

    Today is the later one of the date in UTC and of that where the computer is.
    """
    with suppress(ValueError, TypeError):  # what is no date is a fault of its own
        date = dt.date.fromisoformat(_at(document, where))
        return date if date > max(utc_today(), local_time().date()) else None
    return None


def _at(document: Document, where: Where) -> Any:
    data: Any = document.data
    for part in where:
        data = data.get(part) if isinstance(data, dict) else None
    return data
