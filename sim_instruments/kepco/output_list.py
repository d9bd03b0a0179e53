"""The LIST memory of the Kepco interface card: points, dwells, order and count.

Kepco BIT 4886 operator manual 243-1303, appendix B (LIST subsystem, tables B-2 and B-3).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TypeVar

import numpy as np

from sim_instruments.kepco.output import Output, scientific
from sim_instruments.wire.scpi import ScpiError, number, whole_number, word
from sim_instruments.wire.scpi_device import Listed, Value, kept
from sim_instruments.world.piecewise import Array

Entry = TypeVar("Entry", int, float)

MAX_POINTS = 1002
MAX_SEQUENCE_STEPS = 512
SHORTEST_DWELL_S, MAX_DWELL_S = 0.0005, 10.0
POINTS_PER_REPLY = 16


class ListMemory:
    """What the LIST commands have stored."""

    def __init__(self) -> None:
        self.points: dict[str, list[float]] = {"CURR": [], "VOLT": []}
        self.dwells: list[float] = []
        self.clear()

    def clear(self) -> None:
        """Forget everything, as `LIST:CLE` and `*RST` do."""
        self.points = {"CURR": [], "VOLT": []}
        self.dwells = []
        self.sequence: list[int] = []
        self.count = 1
        self.skip = 0
        self.direction, self.generation = "UP", "DSEQ"
        self.pointer = 0

    def append_points(self, kind: str, values: list[float]) -> None:
        """Append levels; -221 when the other kind has entries, -223 when they do not fit."""
        other = "VOLT" if kind == "CURR" else "CURR"
        if self.points[other]:
            raise ScpiError(-221)
        if len(self.points[kind]) + len(values) > MAX_POINTS:
            raise ScpiError(-223)
        self.points[kind].extend(values)

    def show_points(self, kind: str) -> list[float]:
        """Return up to 16 levels from the query pointer on; -221 when the other kind is in use."""
        if self.points["VOLT" if kind == "CURR" else "CURR"]:
            raise ScpiError(-221)
        return self.window(self.points[kind])

    def window(self, entries: list[Entry]) -> list[Entry]:
        """Return up to 16 entries from the query pointer on."""
        return entries[self.pointer : self.pointer + POINTS_PER_REPLY]

    def append_dwells(self, parameters: list[str]) -> None:
        """Append dwell times of 0.5 ms to 10 s."""
        values = [number(text) for text in some(parameters)]
        if any(not SHORTEST_DWELL_S <= value <= MAX_DWELL_S for value in values):
            raise ScpiError(-222)
        if len(self.dwells) + len(values) > MAX_POINTS:
            raise ScpiError(-223)
        self.dwells.extend(values)

    def append_sequence(self, parameters: list[str]) -> None:
        """Append locations to the user's sequence, at most 512 in all."""
        values = [whole_number(text, 0, MAX_POINTS - 1) for text in some(parameters)]
        if len(self.sequence) + len(values) > MAX_SEQUENCE_STEPS:
            raise ScpiError(-223)
        self.sequence.extend(values)

    def passes(self, kind: str) -> list[tuple[Array, Array, int]]:
        """Return the walk as (levels, dwells in s, cycles) for the first and the later passes.

        Raises ScpiError -221 when nothing of this kind is stored or the sequence points beyond
        it, -226 when there are neither one dwell time nor as many as levels.
        """
        levels = np.array(self.points[kind])
        if levels.size == 0 or (self.generation == "SEQ" and not self.sequence):
            raise ScpiError(-221)
        if len(self.dwells) not in (1, levels.size):
            raise ScpiError(-226)
        dwells = np.broadcast_to(np.array(self.dwells), levels.shape)
        order = np.array(self.sequence) if self.generation == "SEQ" else np.arange(levels.size)
        if order.max() >= levels.size:
            raise ScpiError(-221)
        if self.direction == "DOWN":
            order = order[::-1]
        if self.count == 1 or self.skip == 0:
            return [(levels[order], dwells[order], self.count)]
        later = order[self.skip :]
        first = (levels[order], dwells[order], 1)
        if later.size == 0:
            return [first]
        return [first, (levels[later], dwells[later], max(self.count - 1, 0))]


def list_commands(memory: ListMemory, output: Output) -> dict[str, Value]:
    """Return the LIST subsystem."""

    def appending(kind: str) -> Callable[[list[str]], None]:
        def append(parameters: list[str]) -> None:
            values = [number(text) for text in some(parameters)]
            for value in values:
                output.check_level(kind, value)
            memory.append_points(kind, [output.rounded(kind, value) for value in values])

        return append

    steps = partial(whole_number, minimum=0, maximum=255)
    return {
        "CLEar": memory.clear,
        "DWELl": Listed(memory.append_dwells),
        "DWELl?": lambda: scientific_all(memory.window(memory.dwells)),
        "DWELl:POINts?": lambda: len(memory.dwells),
        "SEQuence": Listed(memory.append_sequence),
        "SEQuence?": lambda: ",".join(map(str, memory.window(memory.sequence))),
        "COUNt": kept(memory, "count", steps),
        "COUNt:SKIP": kept(memory, "skip", steps),
        "DIRection": kept(memory, "direction", word("UP", "DOWN")),
        "GENeration": kept(memory, "generation", word("DSEQuence", "SEQuence")),
        "QUERy": kept(memory, "pointer", partial(whole_number, minimum=0, maximum=MAX_POINTS - 1)),
        "CURRent[:LEVel]": Listed(appending("CURR")),
        "VOLTage[:LEVel]": Listed(appending("VOLT")),
        "CURRent[:LEVel]?": lambda: scientific_all(memory.show_points("CURR")),
        "VOLTage[:LEVel]?": lambda: scientific_all(memory.show_points("VOLT")),
        "CURRent[:LEVel]:POINts?": lambda: len(memory.points["CURR"]),
        "VOLTage[:LEVel]:POINts?": lambda: len(memory.points["VOLT"]),
    }


def some(parameters: list[str]) -> list[str]:
    """Return parameters; ScpiError -109 without any."""
    if not parameters:
        raise ScpiError(-109)
    return parameters


def scientific_all(values: list[float]) -> str:
    """Return numbers the way the card writes them."""
    return ",".join(map(scientific, values))
