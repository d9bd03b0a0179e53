"""The LIST memory of the Kepco interface card: points, dwells, order and count.

Kepco BIT 4886 operator manual 243-1303, appendix B (LIST subsystem, tables B-2 and B-3).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from sim_instruments.kepco.output import Output, scientific
from sim_instruments.wire.scpi import (
    Handler,
    ScpiError,
    choice,
    none,
    number,
    single_parameter,
    whole_number,
)
from sim_instruments.wire.scpi_device import ScpiDevice, Value
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
        self.down = False
        self.own_sequence = False
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
        if not parameters:
            raise ScpiError(-109)
        values = [number(text) for text in parameters]
        if any(not SHORTEST_DWELL_S <= value <= MAX_DWELL_S for value in values):
            raise ScpiError(-222)
        if len(self.dwells) + len(values) > MAX_POINTS:
            raise ScpiError(-223)
        self.dwells.extend(values)

    def append_sequence(self, parameters: list[str]) -> None:
        """Append locations to the user's sequence, at most 512 in all."""
        if not parameters:
            raise ScpiError(-109)
        values = [whole_number(text, 0, MAX_POINTS - 1) for text in parameters]
        if len(self.sequence) + len(values) > MAX_SEQUENCE_STEPS:
            raise ScpiError(-223)
        self.sequence.extend(values)

    def set_count(self, parameters: list[str]) -> None:
        """Set how often the list is walked through, 0 for ever."""
        self.count = whole_number(single_parameter(parameters), 0, 255)

    def set_skip(self, parameters: list[str]) -> None:
        """Set how many steps are left out from the second pass on."""
        self.skip = whole_number(single_parameter(parameters), 0, 255)

    def set_pointer(self, parameters: list[str]) -> None:
        """Set the first location that queries show."""
        self.pointer = whole_number(single_parameter(parameters), 0, MAX_POINTS - 1)

    def set_direction(self, parameters: list[str]) -> None:
        """Set whether the list is walked up or down."""
        self.down = choice(single_parameter(parameters), {"UP": "UP", "DOWN": "DOWN"}) == "DOWN"

    def set_generation(self, parameters: list[str]) -> None:
        """Set whether the default or the user's sequence is walked."""
        names = {"DSEQ": "DSEQ", "DSEQUENCE": "DSEQ", "SEQ": "SEQ", "SEQUENCE": "SEQ"}
        self.own_sequence = choice(single_parameter(parameters), names) == "SEQ"

    def forget(self, parameters: list[str]) -> None:
        """Carry out `LIST:CLE`."""
        none(parameters)
        self.clear()

    def passes(self, kind: str) -> list[tuple[Array, Array, int]]:
        """Return the walk as (levels, dwells in s, cycles) for the first and the later passes.

        Raises ScpiError -221 when nothing of this kind is stored or the sequence points beyond
        it, -226 when there are neither one dwell time nor as many as levels.
        """
        levels = np.array(self.points[kind])
        if levels.size == 0 or (self.own_sequence and not self.sequence):
            raise ScpiError(-221)
        if len(self.dwells) not in (1, levels.size):
            raise ScpiError(-226)
        dwells = np.broadcast_to(np.array(self.dwells), levels.shape)
        order = np.array(self.sequence) if self.own_sequence else np.arange(levels.size)
        if order.max() >= levels.size:
            raise ScpiError(-221)
        if self.down:
            order = order[::-1]
        if self.count == 1 or self.skip == 0:
            return [(levels[order], dwells[order], self.count)]
        later = order[self.skip :]
        first = (levels[order], dwells[order], 1)
        if later.size == 0:
            return [first]
        return [first, (levels[later], dwells[later], max(self.count - 1, 0))]


def add_list_commands(
    device: ScpiDevice, memory: ListMemory, output: Output, list_runs: Callable[[], bool]
) -> None:
    """Add the LIST subsystem; its commands, not its queries, are refused while a list runs."""
    commands: dict[str, Callable[[list[str]], None]] = {
        "CLEar": memory.forget,
        "DWELl": memory.append_dwells,
        "SEQuence": memory.append_sequence,
        "COUNt": memory.set_count,
        "COUNt:SKIP": memory.set_skip,
        "DIRection": memory.set_direction,
        "GENeration": memory.set_generation,
        "QUERy": memory.set_pointer,
        "CURRent[:LEVel]": _append_points(memory, output, "CURR"),
        "VOLTage[:LEVel]": _append_points(memory, output, "VOLT"),
    }
    queries: dict[str, Callable[[], str]] = {
        "DWELl": lambda: _joined(memory.window(memory.dwells)),
        "DWELl:POINts": lambda: str(len(memory.dwells)),
        "SEQuence": lambda: ",".join(str(step) for step in memory.window(memory.sequence)),
        "COUNt": lambda: str(memory.count),
        "COUNt:SKIP": lambda: str(memory.skip),
        "DIRection": lambda: "DOWN" if memory.down else "UP",
        "GENeration": lambda: "SEQ" if memory.own_sequence else "DSEQ",
        "QUERy": lambda: str(memory.pointer),
        "CURRent[:LEVel]": lambda: _joined(memory.show_points("CURR")),
        "VOLTage[:LEVel]": lambda: _joined(memory.show_points("VOLT")),
        "CURRent[:LEVel]:POINts": lambda: str(len(memory.points["CURR"])),
        "VOLTage[:LEVel]:POINts": lambda: str(len(memory.points["VOLT"])),
    }
    for root in ("", "SOURce:"):
        for name, act in commands.items():
            device.tree.add(f"{root}LIST:{name}", not_while(list_runs, act))
    shown: dict[str, Value] = {f"LIST:{name}": (None, reply) for name, reply in queries.items()}
    device.add_settings(shown, "", "SOURce:")


def _append_points(memory: ListMemory, output: Output, kind: str) -> Callable[[list[str]], None]:
    def append(parameters: list[str]) -> None:
        if not parameters:
            raise ScpiError(-109)
        values = [number(text) for text in parameters]
        for value in values:
            output.check_level(kind, value)
        memory.append_points(kind, [output.rounded(kind, value) for value in values])

    return append


def not_while(list_runs: Callable[[], bool], act: Callable[[list[str]], None]) -> Handler:
    """Return what does an act, refused with -221 while a list runs."""

    def handler(parameters: list[str]) -> None:
        if list_runs():
            raise ScpiError(-221)
        act(parameters)

    return handler


def _joined(values: list[float]) -> str:
    return ",".join(scientific(value) for value in values)
