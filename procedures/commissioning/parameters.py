"""The parameters of a commissioning: which parts it has, and those of each."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from station.fields import StrictModel

from .coils.parameters import CoilParameters
from .motion.parameters import MotionParameters

PartName = Literal["coils", "motion"]


class CommissioningParameters(StrictModel):
    """What the engineer chooses. `checks` are the parts, walked in the order of the steps.

    `watch` holds the figures against those of the bench's commissioning.
    """

    checks: Annotated[tuple[PartName, ...], Field(min_length=1)] = ("coils", "motion")
    watch: bool = False
    coils: CoilParameters = CoilParameters()
    motion: MotionParameters = MotionParameters()
