"""The parameters of the gyro's part."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from station.fields import StrictModel, Unit
from station.procedure import ResultKind

RESULTS = {
    "gyro_channel_offset": ResultKind((), "1"),
    "rest_rate": ResultKind((), "deg/h"),
    "pulse_weight_ratio": ResultKind((), "1"),
    "board_clock_error": ResultKind((), "ppm"),
}
"""What is reported of the gyro, with its unit."""
CHANNELS = (1, 2, 3)
CHANNELS_UNIT = "gyro channels"
REST_UNIT = "gyro at rest"


class EarthRate(StrictModel):
    """What of the earth's rate the gyro feels at rest, and how well that is known.

    Elevation counts up from the level, azimuth from north over east; uncertainties are standard.
    """

    latitude_deg: Annotated[float, Unit("deg"), Field(ge=-90, le=90)]
    elevation_deg: Annotated[float, Unit("deg"), Field(ge=-90, le=90)]
    azimuth_deg: Annotated[float, Unit("deg"), Field(ge=-360, le=360)] = 0.0
    direction_deg: Annotated[float, Unit("deg"), Field(gt=0, le=10)] = 0.05
    bias_deg_per_h: Annotated[float, Unit("deg/h"), Field(gt=0, le=10)] = 0.01


class GyroParameters(StrictModel):
    """What the engineer chooses. Without `earth` the pulse weight is not reported."""

    channel: Annotated[int, Field(ge=1, le=3)] = 1
    pulse_weight_arcsec: Annotated[float, Unit("arcsec"), Field(gt=0)] = 0.0625
    sample_interval_s: Annotated[float, Unit("s"), Field(ge=0.01, le=10)] = 1.0
    warm_up_s: Annotated[float, Unit("s"), Field(ge=0, le=86400)] = 3600.0
    record_s: Annotated[float, Unit("s"), Field(ge=20, le=86400)] = 600.0
    earth: EarthRate | None = None
