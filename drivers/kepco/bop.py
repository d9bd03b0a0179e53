"""Kepco BOP 36-12 with interface card BIT 802E (LAN) or BIT 4886: a sine as an uploaded list.

Sources: BIT 4886 manual P/N 243-1303 for the list system and the 253-character limit. Not confirmed
in a primary source: the header `CURR:LIM` of the card's own current limit. A card that does not
know it (-113) keeps its rating as limit, and the bench limit must not be above it.

Commands and their sources:
    CURR:LIM - the card's own current limit - BOP 1KW-MG manual, another model - not confirmed
    VOLT - the compliance voltage in current mode - BIT 4886 manual 243-1303 - confirmed
    LIST:CURR, LIST:CURR:POIN?, LIST:DWEL - a period of up to 1002 points in lines of 253
        characters, dwells of 0.5 ms to 10 s - BIT 4886 manual 243-1303 - confirmed
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from drivers.kepco.supply import BEHIND_MODEL, KepcoSupply
from drivers.transport.exchanges import Repeatable
from drivers.transport.text_line import ERROR_QUERY

MAX_MESSAGE = 253
LIST_POINTS = 1000
DWELL_RANGE_S = (0.0005, 10.0)


class KepcoBop(KepcoSupply):
    """A coil supply whose sine is a list that the card repeats until stopped."""

    recognises: ClassVar[str] = (
        r"^KEPCO,\s*(?P<model>BIT\s?[\w-]+\s+\d+-\d+\w*|BOP \d+-\d+[A-Z]?(?<![GL]))" + BEHIND_MODEL
    )
    repeatable: ClassVar[Repeatable] = Repeatable(
        r"\*IDN\?|\*CLS|SYST:ERR\?",
        r"(CURR|VOLT|OUTP|MEAS:CURR|MEAS:VOLT|STAT:OPER:COND|LIST:CURR:POIN)\?( MAX)?",
        r"(CURR|VOLT|CURR:LIM) -?[\d.]+",
        r"FUNC:MODE CURR|CURR:MODE FIX|CURR:RANG 1|OUTP OFF|LIST:CLE",
    )
    """Not a list's points, which are appended; nor its start, which begins a period again; nor
    the output's switching on, which lifts a protection that tripped meanwhile."""

    def _programme_limits(self) -> None:
        self._line.forget_errors()
        self._line.command("FUNC:MODE CURR")
        self._line.command("CURR:MODE FIX;:CURR 0")
        # First, since a lower limit that somebody left is what the card then ends at.
        answer = self._line.query(f"CURR:LIM {self._current_limit_A:.4f};{ERROR_QUERY}")
        self.check_rating("current", self._line.number("CURR? MAX"), "A")
        self._line.command(f"VOLT {self._voltage_limit_V:.4f}")
        if not answer.startswith(("0,", "-113")):
            raise self._line.refused("CURR:LIM", answer)
        self.met("CURR:LIM is known" if answer.startswith("0,") else "limited by its rating alone")

    def _prepare(self, frequency_Hz: float, amplitude_A: float) -> float:
        dwell_s = 1.0 / (frequency_Hz * LIST_POINTS)
        if not DWELL_RANGE_S[0] <= dwell_s <= DWELL_RANGE_S[1]:
            raise self.error(
                f"prepare a sine of {frequency_Hz:g} Hz",
                f"its list would dwell {dwell_s:g} s a point",
                "choose a frequency between 0.0001 Hz and 2 Hz",
            )
        dwell_s = round(dwell_s, 7)
        self._line.command("CURR:MODE FIX;:CURR 0")
        self._line.command("CURR:RANG 1")
        self._line.command("LIST:CLE")
        phases = 2 * np.pi * np.arange(LIST_POINTS) / LIST_POINTS
        for message in list_messages(amplitude_A * np.sin(phases)):
            self._line.command(message)
        self._line.command(f"LIST:DWEL {dwell_s:.7f}")
        self._line.command("LIST:COUN 0")
        uploaded = self._line.number("LIST:CURR:POIN?")
        if uploaded != LIST_POINTS:
            raise self.error(
                f"upload a list of {LIST_POINTS} points",
                f"{uploaded:g} arrived",
                "run again; if it happens again, slow the line down or change its cable",
            )
        return 1.0 / (LIST_POINTS * dwell_s)


def list_messages(currents_A: np.ndarray) -> list[str]:
    """Return the messages that append `currents_A` (shape (points,), A) to the card's list.

    Each is at most 253 characters long together with the error query that follows it.
    """
    messages: list[str] = []
    room = MAX_MESSAGE - len(ERROR_QUERY) - len(";\n")
    message = ""
    for value in currents_A:
        text = f"{value:.4f}"
        if message and len(message) + 1 + len(text) <= room:
            message += f",{text}"
        else:
            if message:
                messages.append(message)
            message = f"LIST:CURR {text}"
    return [*messages, message]
