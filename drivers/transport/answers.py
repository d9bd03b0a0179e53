"""What came back over a line, as a number, or cut to a length that a sentence can hold."""

from __future__ import annotations

import math

from station.errors import InstrumentError


def number_of(instrument: str, message: str, answer: str) -> float:
    """Return the answer to a message as a finite number; anything else is InstrumentError."""
    try:
        value = float(answer)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InstrumentError(
            instrument,
            f"sent {message!r}",
            f"{shortened(answer)!r} came back where a number belongs",
            "check the cable and that nobody else talks to the instrument",
        )
    return value


def shortened(text: str, longest: int = 60) -> str:
    """Return `text`, its middle left out when it is long."""
    return text if len(text) <= longest else f"{text[: longest // 2]}…{text[-longest // 2 :]}"
