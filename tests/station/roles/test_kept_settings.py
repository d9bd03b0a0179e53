"""What an instrument keeps after a run is noted when it is set, and put back at the end."""

from __future__ import annotations

from typing import Any

import pytest

from station.errors import InstrumentError
from station.roles.kept_settings import KeptSettings


class Unit:
    """An instrument with settings by name, which may fall silent."""

    def __init__(self, **settings: str) -> None:
        self.settings = settings
        self.written: list[tuple[str, str]] = []
        self.silent = False
        self.notes: list[tuple[str, dict[str, Any]]] = []
        self.kept = KeptSettings(lambda kind, **details: self.notes.append((kind, details)))

    def set(self, name: str, value: str) -> None:
        self.kept.set(name, value, lambda: self.read(name), lambda text: self.write(name, text))

    def read(self, name: str) -> str:
        if self.silent:
            raise InstrumentError("unit", f"asked {name}", "nothing", "seat its cable")
        return self.settings[name]

    def write(self, name: str, value: str) -> None:
        self.written.append((name, value))
        self.settings[name] = value


def test_a_setting_is_noted_once_and_put_back_as_it_was_met() -> None:
    unit = Unit(unit="GAUSS", rate="100")
    unit.set("unit", "TESLA")
    unit.set("rate", "250")
    unit.set("rate", "500")
    assert unit.settings == {"unit": "TESLA", "rate": "500"}
    assert unit.notes == [
        ("instrument-settings", {"setting": "unit", "was": "GAUSS", "set": "TESLA"}),
        ("instrument-settings", {"setting": "rate", "was": "100", "set": "250"}),
    ]
    unit.kept.put_back()
    assert unit.settings == {"unit": "GAUSS", "rate": "100"}
    assert len(unit.notes) == 2
    unit.kept.put_back()
    assert len(unit.written) == 5


def test_what_stands_right_is_not_written_into_the_memory() -> None:
    unit = Unit(unit="TESLA")
    unit.set("unit", "TESLA")
    unit.kept.put_back()
    assert unit.written == []


def test_what_cannot_be_put_back_is_noted_after_one_try() -> None:
    unit = Unit(unit="GAUSS", rate="100")
    unit.set("unit", "TESLA")
    unit.set("rate", "250")
    unit.silent = True
    unit.kept.put_back()
    ((kind, details),) = unit.notes[2:]
    assert kind == "settings-stay"
    assert details["was"] == {"rate": "100", "unit": "GAUSS"}
    assert "asked rate" in details["message"] and unit.settings["unit"] == "TESLA"


def test_a_setting_that_cannot_be_read_is_not_written() -> None:
    unit = Unit(unit="GAUSS")
    unit.silent = True
    with pytest.raises(InstrumentError):
        unit.set("unit", "TESLA")
    assert unit.written == [] and unit.notes == []
