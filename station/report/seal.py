"""The seal on paper: the head of a run's log, and its QR code.

It is that of the run itself, as the run ended. Held against the folder it says whether the run ever
was in that state, and what was done since.
"""

from __future__ import annotations

import io
from shlex import quote

from station.report.sheet import Block
from station.texts import AsTyped

SCALE, MARGIN = 8, 4
"""Pixels of a module, and the quiet zone in modules."""
WHAT_IT_PROVES = (
    "The head of the log stands for the run as it was when it ended. The command, which is also in "
    "the QR code, says whether the run ever was in that state, and what was done with it since."
)


def seal(run: str, head: str) -> Block:
    """Return the head of the log of a run, the command that holds it against the run, its code."""
    command = AsTyped(f"station verify {quote(run)} --head {head}")
    rows = (("Head of the log", head), ("Command", command))
    return Block("seal", rows=rows, caption=WHAT_IT_PROVES, image=qr_code(command))


def qr_code(text: str) -> bytes:
    """Return the QR code of a text as PNG; up to 15 % of it may be unreadable."""
    import segno

    written = io.BytesIO()
    code = segno.make_qr(text, error="m", boost_error=False)
    code.save(written, kind="png", scale=SCALE, border=MARGIN)
    return written.getvalue()
