"""Which commands of a driver its simulator knows: asked of the simulator itself, not declared."""

from __future__ import annotations

import sys
from collections.abc import Callable
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

from sim_instruments.bench import SimulatedBench
from sim_instruments.instrument import Setting, SimulatedInstrument
from station import registry
from station.clock import VirtualClock

sys.path.append(str(Path(__file__).parents[2] / "tests" / "support"))

import our_drivers

ASKED = (", and with ?", " and their queries with (@n)")
"""What stands behind the commands of a row that are asked for, too."""
WITH = {"watlow-f4t": {"limit_modules": [1]}}
"""With what a simulator has the registers that a row gives for the first of several."""
ANSWERS = ("9.9E+37", "CMD_NOT_DEFINED, CMD_ARG_INVALID")
"""Rows that an instrument answers: nobody sends them."""


@cache
def simulator_of(driver: str) -> Any:
    """Return the simulator of a driver's model, which served once; None where there is none."""
    if driver not in registry.own_names(registry.SIMULATORS):
        return None
    maker = registry.load(registry.SIMULATORS, driver)
    made: list[SimulatedInstrument] = []

    def kept(setting: Setting) -> SimulatedInstrument:
        made.append(maker(setting))
        return made[0]

    data, world = deepcopy(our_drivers.bench_data(driver)), our_drivers.world_of(driver)
    data["instruments"][our_drivers.name_of(driver)]["simulator"].update(WITH.get(driver, {}))
    SimulatedBench(data, VirtualClock(), world, {driver: kept}).close()
    return made[0]


def commands_in(row: str) -> list[str]:
    """Return the commands of a row, each as it is sent."""
    text, asked = row, False
    for words in ASKED:
        text, asked = text.removesuffix(words), asked or text.endswith(words)
    commands = text.removesuffix(" with (@n)").split(", ")
    return commands + [f"{one.partition(' ')[0]}?" for one in commands if asked]


def answered(driver: str, row: str) -> str:
    """Return whether the simulator knows the commands of a row: yes, no, or which it does not."""
    simulator = simulator_of(driver)
    if simulator is None or row in ANSWERS:
        return ""
    knows: Callable[[str], bool] = simulator.knows
    commands = commands_in(row)
    unknown = [one for one in commands if not knows(one)]
    if len(unknown) == len(commands):
        return "no"
    return f"not {', '.join(f'`{one}`' for one in unknown)}" if unknown else "yes"
