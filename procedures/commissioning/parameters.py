"""The parameters of a commissioning: which parts it has, and those of each."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import Field

from station.fields import StrictModel

from .chamber import ChamberParameters
from .clocks import ClockParameters
from .coils import Ambient, CoilParameters
from .contacts import ContactParameters
from .gyro import EarthRate, GyroParameters
from .lines import LineParameters
from .motion import MotionParameters
from .pick_up import PickUpParameters
from .probe import ProbeParameters
from .stage import StageParameters
from .supplies import SupplyParameters

PartName = Literal[
    "contacts",
    "lines",
    "supplies",
    "coils",
    "probe",
    "pick_up",
    "motion",
    "stage",
    "gyro",
    "chamber",
    "clocks",
]


class CommissioningParameters(StrictModel):
    """What the engineer chooses. `checks` are the parts, walked in the order of the steps.

    `watch` are the figures that are held against those of the bench's commissioning. `ambient` and
    `earth` are what is known of the site.
    """

    checks: Annotated[tuple[PartName, ...], Field(min_length=1)] = get_args(PartName)
    watch: tuple[str, ...] = ()
    ambient: Ambient | None = None
    earth: EarthRate | None = None
    lines: LineParameters = LineParameters()
    contacts: ContactParameters = ContactParameters()
    supplies: SupplyParameters = SupplyParameters()
    coils: CoilParameters = CoilParameters()
    probe: ProbeParameters = ProbeParameters()
    pick_up: PickUpParameters = PickUpParameters()
    motion: MotionParameters = MotionParameters()
    stage: StageParameters = StageParameters()
    gyro: GyroParameters = GyroParameters()
    chamber: ChamberParameters = ChamberParameters()
    clocks: ClockParameters = ClockParameters()
