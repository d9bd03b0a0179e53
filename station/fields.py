"""Quantities as fields of pydantic models: `0.1 Hz` in YAML, `frequency_Hz = 0.1` in the program.

    class Drive(StrictModel):
        frequency_Hz: Annotated[float, Unit("Hz"), Field(gt=0)]   # the key is `frequency`
        amplitude_mT: Millitesla                                  # the key is `amplitude`

A rule that joins several fields belongs into a field validator that looks at the fields before it
through `info.data`, so that its fault is reported together with all the others (a model validator
would run only when every field is right):

        @field_validator("amplitude_mT")
        @classmethod
        def within_reach(cls, amplitude_mT: float, info: ValidationInfo) -> float:
            frequency_Hz = info.data.get("frequency_Hz")   # None when that field has a fault itself
            if frequency_Hz is not None and amplitude_mT * frequency_Hz > 1:
                raise ValueError("the supply cannot follow; lower the amplitude or the frequency")
            return amplitude_mT
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Any, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from station.units import (
    UNITS,
    UnitError,
    dimension_of,
    expectation,
    format_quantity,
    parse_as,
)

UNIT_ERROR = "quantity"
"""Type of the pydantic error that a wrong quantity makes; `ctx` holds `what` and `hint`."""


@dataclass(frozen=True)
class Unit:
    """Mark a float as read from a quantity in text, kept in this unit.

    `difference` says that degC means a temperature difference here, not a temperature.
    """

    symbol: str
    difference: bool = False

    def __post_init__(self) -> None:
        dimension_of(self.symbol)

    @property
    def suffix(self) -> str:
        """The end of the name of an attribute in this unit: `_deg_per_h2`; none for `1`."""
        if self.symbol == "1":
            return ""
        name = self.symbol.replace("/", "_per_").replace("sqrt(h)", "sqrt_h").replace("^", "")
        return "_" + name.replace("%", "percent")

    def parse(self, value: object) -> float:
        """Return the number in this unit; raise a pydantic error that carries sentence and hint."""
        try:
            return parse_as(value, self.symbol, difference=self.difference)
        except UnitError as error:
            raise PydanticCustomError(
                UNIT_ERROR, "{what}", {"what": error.what, "hint": error.hint}
            ) from None

    def write(self, value: float) -> str | float:
        """Return the number as it is written in YAML."""
        return value if self.symbol == "1" else format_quantity(value, self.symbol)

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_before_validator_function(
            self.parse,
            handler(source),
            serialization=core_schema.plain_serializer_function_ser_schema(
                self.write, when_used="json"
            ),
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return self.json_schema()

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of a quantity of this dimension, as an editor checks it."""
        dimension = dimension_of(self.symbol)
        units = [unit for unit in UNITS if dimension_of(unit) == dimension]
        return {
            "type": ["string", "number"] if self.symbol == "1" else "string",
            "pattern": quantity_pattern(units),
            "description": expectation(self.symbol, difference=self.difference),
        }


def quantity_pattern(units: Iterable[str]) -> str:
    """Return the regular expression, in the dialect of JSON Schema, of a number with a unit."""
    escaped = "|".join(re.sub(r"([\^()])", r"\\\1", unit) for unit in units)
    return rf"^\s*[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?\s+({escaped})\s*$"


class StrictModel(BaseModel):
    """A mapping of a YAML file: no unknown keys, no change after reading.

    The key of an attribute that carries a unit is its name without the unit.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        renamed = False
        for name, field in cls.model_fields.items():
            unit = unit_in((field.annotation, *field.metadata))
            if unit is None or not unit.suffix or field.alias is not None:
                continue
            if not name.endswith(unit.suffix):
                raise TypeError(f"{cls.__name__}.{name} is in {unit.symbol}: end it {unit.suffix}")
            key = name.removesuffix(unit.suffix)
            field.alias = field.validation_alias = field.serialization_alias = key
            renamed = True
        if renamed:
            cls.model_rebuild(force=True)


class WarmUpWindow(StrictModel):
    """What every warm-up's `window_s` and `at_most_s` hold to; it adds its own limit of a slope."""

    @field_validator("at_most_s", check_fields=False)
    @classmethod
    def longer_than_window(cls, at_most_s: float, info: ValidationInfo) -> float:
        """Refuse a time-out that ends before the window can be full."""
        window_s = info.data.get("window_s")
        if window_s is not None and at_most_s < window_s:
            raise ValueError(f"the warm-up may not end before its window of {window_s:g} s is full")
        return at_most_s


def unit_in(parts: tuple[object, ...]) -> Unit | None:
    """Return the first unit within annotations: `Unit`, `Hertz`, `Hertz | None`, `list[Hertz]`."""
    for part in parts:
        unit = part if isinstance(part, Unit) else unit_in(get_args(part))
        if unit is not None:
            return unit
    return None


def key_of(model: type[BaseModel], attribute: str) -> str:
    """Return the YAML key of an attribute."""
    return model.model_fields[attribute].alias or attribute


def to_yaml_data(model: BaseModel) -> dict[str, Any]:
    """Return a model as data for YAML, with keys and units as a person writes them."""
    return model.model_dump(mode="json", by_alias=True)


AnyQuantity = Annotated[
    str | float,
    WithJsonSchema(
        {
            "type": ["string", "number"],
            "pattern": quantity_pattern(UNITS),
            "description": "a number with its unit",
        }
    ),
]
"""How a value is written whose unit another key decides; for the JSON Schema only."""

Hertz = Annotated[float, Unit("Hz")]
Second = Annotated[float, Unit("s")]
Millitesla = Annotated[float, Unit("mT")]
Degree = Annotated[float, Unit("deg")]
DegreePerSecond = Annotated[float, Unit("deg/s")]
Celsius = Annotated[float, Unit("degC")]


class InputAxis(StrictModel):
    """Where a positive input axis points."""

    azimuth_deg: Annotated[float, Unit("deg"), Field(ge=-360, le=360)]
    elevation_deg: Annotated[float, Unit("deg"), Field(ge=-90, le=90)]
