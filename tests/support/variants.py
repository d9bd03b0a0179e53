"""An instrument of a shipped bench in another of its forms, and who talks to it.

The form is set by keys of `simulator` in the bench file, as a laboratory would set them.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from our_drivers import alone, bench_from, shipped
from sim_bench import Line

from station.conformance.fixture import Fixture, fixture_of


class Variant:
    """One served instrument: its driver with what that notes, or a stranger's raw line."""

    def __init__(self, fixture: Fixture) -> None:
        self.fixture, self.clock = fixture, fixture.clock
        self.notes: list[tuple[str, dict[str, Any]]] = []

    def driver(self) -> Any:
        """Return the instrument's driver, its line open, whose notes are kept."""
        driver = self.fixture.open()
        driver.place = replace(
            driver.place, noter=lambda kind, details: self.notes.append((kind, dict(details)))
        )
        return driver

    def line(self) -> Line:
        """Return a raw line, as another program's; on virtual time there is room for one."""
        return Line(self.fixture.simulation, self.fixture.name, self.clock)

    @property
    def simulator(self) -> Any:
        """The simulated instrument itself."""
        return self.fixture.simulation._served[self.fixture.name]

    def met(self) -> list[str]:
        """Return which forms the driver noted that it met."""
        return [details["met"] for kind, details in self.notes if kind == "instrument-variant"]

    def settings(self) -> dict[str, tuple[str, str]]:
        """Return the settings that the driver noted: as met, and as set."""
        return {
            details["setting"]: (details["was"], details["set"])
            for kind, details in self.notes
            if kind == "instrument-settings"
        }


@contextmanager
def variant(
    name: str,
    procedure: str,
    bench: str = "sim",
    *faults: Mapping[str, Any],
    world: Mapping[str, Mapping[str, Any]] | None = None,
    **truth: Any,
) -> Iterator[Variant]:
    """Serve an instrument of a shipped bench alone on virtual time, with changes of its truth.

    `world` has changes of sections of the world's truth.
    """
    data = copy.deepcopy(alone(shipped(bench), name))
    data["instruments"][name]["simulator"] |= truth
    for section, changes in (world or {}).items():
        data["simulation"][section] |= changes
    data["simulation"]["faults"] = [{"instrument": name, **fault} for fault in faults]
    with fixture_of(bench_from(data), name, procedure) as fixture:
        yield Variant(fixture)
