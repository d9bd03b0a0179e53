"""Whether one lost answer may decide what a driver does now."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

PATIENT = ContextVar("PATIENT", default=False)


@contextmanager
def patience(*, granted: bool = True) -> Iterator[None]:
    """Let no lost answer decide until exit: what does no harm twice is sent again.

    A driver's way to rest, its looks whether it is there, and who watches a level have it; also a
    decorator of what a driver does in the same way anywhere.
    """
    before = PATIENT.set(granted)
    try:
        yield
    finally:
        PATIENT.reset(before)
