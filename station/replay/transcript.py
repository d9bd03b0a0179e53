"""A transcript: what one instrument's file below `trace/` of a run folder says, read back."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from station.errors import InputError
from station.instruments.trace import ADDRESS, FOLDER

LINE = re.compile(r" *(-?\d+\.\d{6}) ([-><!]) (.*)")
ESCAPE = re.compile(r"\\(x[0-9a-f]{2}|.)", re.DOTALL)
NAMED = {"n": "\n", "r": "\r", "t": "\t", "\\": "\\"}
OPENED = ("opened", "reopened")
CLOSED = "closed"
CAN = ("socketcand://", "can://")


@dataclass(frozen=True)
class Entry:
    """One message: its line in the file, run time in s, direction and bytes."""

    line: int
    time_s: float
    direction: str
    data: bytes


@dataclass
class Opening:
    """What went over a line from one opening to the next; `refused` where nobody answered."""

    refused: str = ""
    entries: list[Entry] = field(default_factory=list)


@dataclass
class Transcript:
    """What went over one instrument's wire, opening by opening.

    `whole` is False where the file ends before the line was closed: the run was killed.
    """

    instrument: str
    path: Path
    address: str
    openings: list[Opening]
    whole: bool


def unreadable(text: str) -> bytes:
    """Return the bytes that `readable` made text of; raises ValueError where it cannot have."""

    def octet(match: re.Match[str]) -> str:
        name = match[1]
        if name in NAMED:
            return NAMED[name]
        if len(name) == 1:
            raise ValueError(match[0])
        return chr(int(name[1:], 16))

    return ESCAPE.sub(octet, text).encode("latin-1")


def read_transcripts(run: Path) -> dict[str, Transcript]:
    """Return the transcripts of a run's first process, by instrument.

    Raises InputError where there is none, or a line is no message.
    """
    paths = sorted((run / FOLDER).glob("*.txt"))
    if not paths:
        raise InputError(
            f"{run} holds no transcript: record the run with `station run --record-wire`"
        )
    return {path.stem: read_transcript(path) for path in paths}


def read_transcript(path: Path) -> Transcript:
    """Return one transcript; raises InputError that names file and line."""
    transcript = Transcript(path.stem, path, "", [], whole=False)
    lines = path.read_bytes().decode("utf-8", "replace").split("\n")
    for number, line in enumerate(lines, 1):
        if not line or line.startswith("#"):
            if line.startswith(ADDRESS):
                transcript.address = line.removeprefix(ADDRESS)
            continue
        match = LINE.fullmatch(line)
        try:
            if match is None:
                raise ValueError
            _take(transcript, number, float(match[1]), match[2], match[3])
        except ValueError:
            if number == len(lines):  # the run was killed while it wrote
                break
            raise InputError(f"{path}:{number}: this is no message of a transcript") from None
    return transcript


def _take(transcript: Transcript, number: int, time_s: float, direction: str, text: str) -> None:
    openings = transcript.openings
    transcript.whole = direction == "-" and text == CLOSED
    if direction == "-" and text in OPENED:
        openings.append(Opening())
    elif direction == "!" and text.startswith("open "):
        transcript.whole = True
        openings.append(Opening(refused=text))
    elif openings:
        if transcript.address.startswith(CAN):  # its name is for whoever reads it
            text = text.partition(" ")[0] if direction in "<>" else text
        data = text.encode() if direction in "-!" else unreadable(text)
        openings[-1].entries.append(Entry(number, time_s, direction, data))
