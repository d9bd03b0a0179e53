"""The laboratory that a bench belongs to, as its certificates name it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from station.fields import StrictModel

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
    letters (ISO 3166-1). `trusted_keys` are those whose signatures of run folders count.
    """

    name: Words
    address: Words
    location: Words | None = None
    country: Annotated[str, Field(pattern="^[A-Z]{2}$")] | None = None
    accreditation: Words | None = None
    signatories: tuple[Signatory, ...] = ()
    trusted_keys: tuple[TrustedKey, ...] = ()
