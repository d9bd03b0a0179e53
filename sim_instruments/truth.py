"""Read the truth of a simulated bench: quantities with units, and no defaults."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from station.units import UnitError, parse_as


class SimulationError(Exception):
    """The description of a simulated bench is incomplete or wrong."""


class Truth:
    """A mapping of the bench file that knows where it stands, for messages that point there."""

    def __init__(self, data: Any, where: str) -> None:
        if not isinstance(data, Mapping):
            raise SimulationError(f"{where}: a mapping was expected, got {data!r}")
        self._data: Mapping[Any, Any] = data
        self.where = where

    def __contains__(self, key: object) -> bool:
        return key in self._data

    def raw(self, key: str) -> Any:
        """Return the value of `key` as it stands in the file; SimulationError without one."""
        if key not in self._data:
            present = ", ".join(str(name) for name in self._data) or "nothing"
            raise SimulationError(
                f"{self.where}: '{key}' is missing (present: {present}); "
                "the truth of a simulated bench has no defaults"
            )
        return self._data[key]

    def section(self, key: str) -> Truth:
        """Return the mapping below `key`."""
        return Truth(self.raw(key), f"{self.where}.{key}")

    def quantity(self, key: str, unit: str, default: float | None = None) -> float:
        """Return the value of `key`, written with its unit, in `unit`.

        Only an option, of a fault or of an instrument, has a `default`.
        """
        if default is not None and key not in self:
            return default
        return self._convert(self.raw(key), key, unit)

    def positive(self, key: str, unit: str, default: float | None = None) -> float:
        """Return a quantity that must be above zero."""
        value = self.quantity(key, unit, default)
        if value <= 0:
            raise SimulationError(f"{self.where}.{key}: must be positive")
        return value

    def error(self, key: str, unit: str) -> float:
        """Return an error that need not be given, in `unit`; none without the key."""
        return self.quantity(key, unit, 0.0)

    def errors(self, key: str, names: Sequence[str], unit: str) -> list[float]:
        """Return the errors that may stand below `key` under `names`, in that order, in `unit`."""
        return [self.section(key).error(name, unit) if key in self else 0.0 for name in names]

    def quantities(self, key: str, names: Sequence[str], unit: str) -> list[float]:
        """Return the quantities that stand below `key` under `names`, in that order, in `unit`."""
        section = self.section(key)
        return [section.quantity(name, unit) for name in names]

    def integer(self, key: str, minimum: int, default: int | None = None) -> int:
        """Return a whole number of at least `minimum`."""
        if default is not None and key not in self:
            return default
        value = self.raw(key)
        if isinstance(value, bool) or not isinstance(value, int) or value < minimum:
            raise SimulationError(
                f"{self.where}.{key}: a whole number of at least {minimum} was expected, "
                f"got {value!r}"
            )
        return value

    def text(self, key: str, default: str | None = None) -> str:
        """Return a text; a bare number is taken as it is written."""
        if default is not None and key not in self:
            return default
        value = self.raw(key)
        if isinstance(value, Mapping | list) or value is None:
            raise SimulationError(f"{self.where}.{key}: a text was expected, got {value!r}")
        return str(value)

    def word(self, key: str, words: Collection[str], default: str | None = None) -> str:
        """Return a text that is one of several."""
        text = self.text(key, default)
        if text not in words:
            raise SimulationError(
                f"{self.where}.{key}: one of {', '.join(words)} was expected, got {text!r}"
            )
        return text

    def switch(self, key: str) -> bool:
        """Return true or false; false when the key is missing, a switch being no number."""
        value = self._data.get(key, False)
        if not isinstance(value, bool):
            raise SimulationError(f"{self.where}.{key}: true or false was expected, got {value!r}")
        return value

    def _convert(self, value: Any, key: str, unit: str) -> float:
        if not isinstance(value, str):
            raise SimulationError(
                f"{self.where}.{key}: a number with its unit was expected, such as '1 {unit}', "
                f"got {value!r}"
            )
        try:
            return float(parse_as(value, unit))
        except UnitError as error:
            raise SimulationError(f"{self.where}.{key}: {error}") from error
