"""A thermometer with places, read beside a run where the bench has one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from procedures.common.places import PLACES
from procedures.common.stage_and_meter import THERMOMETER
from station.method.verbs import keep
from station.roles import Block, Thermometer
from station.roles.multimeter import places_in

if TYPE_CHECKING:
    from station.method.run import Run

EVERY_S = 60.0
"""Run time from one reading to the next: temperatures in a chamber take minutes."""


class PlaceReadings:
    """A thermometer with places that is read beside what a run records, where the bench has one."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._thermometer = run.optional(THERMOMETER, Thermometer, PLACES)
        self._due_s, self._reads = run.now_s, False
        self._silent: set[str] = set()

    def look(self, unit: str) -> None:
        """Begin a reading where it is time to, and record one that has come; never waits."""
        thermometer, now_s = self._thermometer, self._run.now_s
        if thermometer is None:
            return
        if self._reads:
            block = thermometer.fetch()
            if block is not None:
                keep(self._run, unit, thermometer, block)
                self._name_silent(block)
            self._reads = block is None
        elif now_s >= self._due_s:
            self._due_s = now_s + EVERY_S
            thermometer.start(1)
            self._reads = True

    def _name_silent(self, block: Block) -> None:
        """Name each place that reads no number to who is at the bench, once."""
        for place, column in places_in(block.columns).items():
            if place not in self._silent and math.isnan(block.columns[column][-1]):
                self._silent.add(place)
                self._run.say(
                    f"WARNING: the thermometer reads no number at {place}; the run goes on without "
                    "it, check the sensor and its wires"
                )
