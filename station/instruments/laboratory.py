"""The laboratory that a bench belongs to, as its certificates name it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, field_validator

from station.fields import AnyQuantity, StrictModel
from station.units import UnitError, convert, parse_quantity

Words = Annotated[str, Field(min_length=1)]
TrustedKey = Annotated[str, Field(pattern=r"^[0-9a-fA-F]{64}( +\S.*)?$")]
"""The SHA-256 of a public key, then the name that it signs in."""


class Signatory(StrictModel):
    """A person who may authorise a certificate."""

    name: Words
    function: Words


class Laboratory(StrictModel):
    """Who measures, and where (ISO/IEC 17025:2017, 7.8.2.1 b, c and o).

    `location` is where the bench stands, where that is not the address, `country` its code of two
    letters (ISO 3166-1). `trusted_keys` are those whose signatures of run folders count. `cmc` is
    the smallest U, by name of the result, that the laboratory's scope allows it to state, and
    `si_statement` how its results are traceable.
    """

    name: Words
    address: Words
    location: Words | None = None
    country: Annotated[str, Field(pattern="^[A-Z]{2}$")] | None = None
    accreditation: Words | None = None
    signatories: tuple[Signatory, ...] = ()
    trusted_keys: tuple[TrustedKey, ...] = ()
    cmc: dict[str, AnyQuantity] = Field(default_factory=dict)
    si_statement: Words | None = None

    @field_validator("cmc")
    @classmethod
    def cmc_is_positive(cls, cmc: dict[str, str | float]) -> dict[str, str | float]:
        """Refuse what is no quantity, or allows any U."""
        for text in cmc.values():
            if smallest_of(text)[0] <= 0.0:
                raise ValueError(f"'{text}' is not above zero: a CMC is the smallest U")
        return cmc

    def smallest_expanded(self, name: str, unit: str) -> float | None:
        """Return the CMC of a result in its unit; None without one. Raises UnitError."""
        if name not in self.cmc:
            return None
        value, own = smallest_of(self.cmc[name])
        return convert(value, own, unit, difference=True)


def smallest_of(text: str | float) -> tuple[float, str]:
    """Return number and unit of a CMC; raises ValueError."""
    if not isinstance(text, str):
        return float(text), "1"
    try:
        quantity = parse_quantity(text)
    except UnitError as error:
        raise ValueError(str(error)) from None
    return quantity.value, quantity.unit
