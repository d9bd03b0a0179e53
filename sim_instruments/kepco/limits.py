"""The commands for the supply's own limits and protections.

From the manuals of the BOP 1KW family; whether the BIT 802E takes the same ones is not confirmed,
so both spellings found in the maker's manuals are taken: POSitive and NEGative, HIGH and LOW.
"""

from __future__ import annotations

from collections.abc import Callable

from sim_instruments.kepco.output import Output, scientific
from sim_instruments.wire.scpi import CommandTree, ScpiError, none, number, one
from station.clock import Clock

Bounds = dict[tuple[str, str], float]

SIDES: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...] = (
    (("[:BOTH]",), ("POS", "NEG")),
    ((":POSitive", ":HIGH"), ("POS",)),
    ((":NEGative", ":LOW"), ("NEG",)),
)


def add_limit_commands(
    tree: CommandTree, output: Output, clock: Clock, list_runs: Callable[[], bool]
) -> None:
    """Add `CURR|VOLT:LIM` and `CURR|VOLT:PROT` with their queries.

    A set point beyond a limit is refused; an output beyond a protection is switched off. A set
    point that a new limit leaves outside is brought within it.
    """
    for root in ("", "SOURce:"):
        for kind, word in (("CURR", "CURRent"), ("VOLT", "VOLTage")):
            for what, table, lowest, highest in (
                ("LIMit", output.limits, 0.0, 1.0),
                ("PROTection", output.protections, 0.01, 1.01),
                ("PROTect", output.protections, 0.01, 1.01),
            ):
                span = (lowest * output.rated[kind], highest * output.rated[kind])
                for names, sides in SIDES:
                    keys = [(kind, side) for side in sides]
                    write, show = _handlers(output, clock, list_runs, table, keys, span)
                    for name in names:
                        header = f"{root}{word}[:LEVel]:{what}{name}"
                        tree.add(header, write)
                        tree.add(f"{header}?", show)


def _handlers(
    output: Output,
    clock: Clock,
    list_runs: Callable[[], bool],
    table: Bounds,
    keys: list[tuple[str, str]],
    span: tuple[float, float],
) -> tuple[Callable[[list[str]], None], Callable[[list[str]], str]]:
    def write(parameters: list[str]) -> None:
        value = _bound(one(parameters), span)
        for key in keys:
            table[key] = value
        output.apply_limits(clock.now(), keys[0][0], list_runs())

    def show(parameters: list[str]) -> str:
        none(parameters)
        return ",".join(scientific(table[key]) for key in keys)

    return write, show


def _bound(text: str, span: tuple[float, float]) -> float:
    lowest, highest = span
    words = {"MAX": highest, "MAXIMUM": highest, "MIN": lowest, "MINIMUM": lowest}
    if text.upper() in words:
        return words[text.upper()]
    # The negative side is given by its magnitude.
    value = abs(number(text))
    if not lowest <= value <= highest:
        raise ScpiError(-222)
    return value
