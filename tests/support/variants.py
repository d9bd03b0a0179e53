"""An instrument of a shipped bench in another of its forms, and who talks to it.

The form is set by keys of `simulator` in the bench file, as a laboratory would set them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from plan_runs import shipped_bench
from quick_yaml import dump_yaml
from sim_bench import Line

from station import registry
from station.conformance.fixture import Fixture, fixture_of
from station.instruments.bench import read_bench


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
def variant(name: str, procedure: str, bench: str = "sim", **truth: Any) -> Iterator[Variant]:
    """Serve an instrument of a shipped bench alone on virtual time, with changes of its truth."""
    data = shipped_bench(bench)
    entry = data["instruments"][name]
    data["instruments"] = {name: {**entry, "simulator": {**entry["simulator"], **truth}}}
    data["interlocks"] = [
        one for one in data["interlocks"] if one["when"].get("instrument") == name
    ]
    data["safe_state"] = [one for one in data["safe_state"] if name.startswith(one["role"])]
    data["simulation"].pop("faults", None)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "bench.yaml"
        path.write_text(dump_yaml(data), encoding="utf-8")
        read = read_bench(path, registry.names(registry.DRIVERS))
        with fixture_of(read, name, procedure) as fixture:
            yield Variant(fixture)
