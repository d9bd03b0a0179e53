"""What a run tells its guardian over the pipe: one JSON object a line."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

BEAT = "beat"
WATCH = "watch"
DISMISS = "dismiss"


@dataclass(frozen=True)
class Instructions:
    """The first line: everything that the guardian needs when nobody can be asked any more.

    `bench` is the path of the resolved bench file, `instruments` are those whose drivers must be
    ready, `addresses` replace those of the bench file; `speed` and `epoch_unix` are the run's time.
    """

    folder: str
    bench: str
    instruments: Sequence[str]
    addresses: Mapping[str, str]
    runner_pid: int
    speed: float
    epoch_unix: float

    def to_line(self) -> bytes:
        """Return the line."""
        return line_of(asdict(self))

    @classmethod
    def from_line(cls, line: bytes) -> Instructions:
        """Read the line."""
        return cls(**json.loads(line))


def line_of(data: Mapping[str, Any]) -> bytes:
    """Return a message as a line."""
    return json.dumps(data).encode() + b"\n"


def said(what: str, **details: Any) -> bytes:
    """Return the line of `BEAT`, `WATCH` (with `instruments`) or `DISMISS`."""
    return line_of({"say": what, **details})
