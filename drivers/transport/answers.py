"""What came back over a line, as a number, or cut to a length that a sentence can hold."""

from __future__ import annotations

import math

from station.errors import InstrumentError

OTHER_ADDRESS = "check that the address in the bench file is its own"


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


def odd(
    instrument: str, attempted: str, answer: str, do_now: str = OTHER_ADDRESS
) -> InstrumentError:
    """Return the error of an answer that is none."""
    return InstrumentError(instrument, attempted, f"{shortened(answer)!r} came back", do_now)


def identification(instrument: str, answer: str) -> list[str]:
    """Return the fields of an answer to `*IDN?`, four at least; fewer are an InstrumentError."""
    fields = [field.strip() for field in answer.split(",")]
    if len(fields) < 4:
        raise odd(instrument, "asked *IDN?", answer)
    return fields


def shortened(text: str, longest: int = 60) -> str:
    """Return `text`, its middle left out when it is long."""
    return text if len(text) <= longest else f"{text[: longest // 2]}…{text[-longest // 2 :]}"
