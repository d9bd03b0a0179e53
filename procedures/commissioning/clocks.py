"""K1: an instrument that stamps its readings keeps the station's time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from station.fields import StrictModel, Unit
from station.findings import Analysis, Estimate, Flag, InputQuantity
from station.method.commands import FieldRange
from station.method.run import Run
from station.method.verbs import Recording
from station.procedure import Step
from station.roles import Gaussmeter

from .coils import EARTH_FIELD_MT, GAUSSMETER, stamps
from .part import COVERAGE, Figure, Part

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

    Array = NDArray[np.float64]

CLOCK_PPM = 100.0
"""A quartz is within 50 ppm, a good computer's clock, too. In 10 min 100 ppm are 60 ms, a hundredth
of the period of a drive of 0.17 Hz."""
CLOCK_DRIFT_PPM = 50.0
CLOCK = Figure("gaussmeter_clock_error", "ppm", limit=CLOCK_PPM, drift=CLOCK_DRIFT_PPM)
PPM = 1e6
OF_SLOPE = 3.5
"""The line's two ends are each as sure as its offset, and stand about a half of the record apart;
measured, with lateness that spreads evenly (a test)."""
METHOD = "line below the arrivals of its time stamps"
UNIT = "gaussmeter clock"
RANGE = FieldRange(GAUSSMETER, 3.0 * EARTH_FIELD_MT, decided_by=("parameters", "clocks"))


class ClockParameters(StrictModel):
    """What the engineer chooses."""

    record_s: Annotated[float, Unit("s"), Field(ge=20, le=3600)] = 300.0


def gaussmeter(run: Run) -> None:
    """K1: readings with their time stamps."""
    parameters: ClockParameters = run.parameters.clocks
    for unit in run.unfinished([UNIT]):
        run.apply(RANGE)
        run.role(GAUSSMETER, Gaussmeter).drain()
        with run.unit(unit):
            Recording(run, unit, {GAUSSMETER: None}).follow(parameters.record_s, unit)


def dataset(folder: RunFolder, parameters: ClockParameters, bench: Bench) -> tuple[Array, Array]:
    """Return the gaussmeter's time stamps and when they came, in s, each (n,)."""
    rows = folder.rows(GAUSSMETER, UNIT)
    return rows["instrument_time_s"].astype(float), rows["arrival_time_s"]


def analyse(data: tuple[Array, Array], inputs: Sequence[InputQuantity]) -> Analysis:
    """Return the error of the gaussmeter's clock."""
    error = clock_estimate(CLOCK, *data)
    return Analysis([error], (), list(clock_flags(error, GAUSSMETER)))


def clock_estimate(figure: Figure, counter_s: Array, arrival_s: Array) -> Estimate:
    """Return by how much an instrument's seconds are longer than the station's, in ppm.

    `counter_s` (n,) by the instrument, `arrival_s` (n,) in run time. ValueError for fewer than ten.
    """
    import numpy as np

    from procedures.estimation.alignment import align

    # Of what arrived together only the last was not waiting.
    last = np.flatnonzero(np.append(np.diff(arrival_s) > 0.0, True))
    if len(last) < 10:
        raise ValueError("a clock needs ten time stamps that arrived one by one")
    line = align(counter_s[last], arrival_s[last], 1.0)
    span_s = float(counter_s[-1] - counter_s[0])
    u_ppm = PPM * OF_SLOPE * line.offset_u_s / span_s
    return figure.measured(PPM * (line.rate - 1.0), u_ppm, METHOD)


def clock_flags(estimate: Estimate, instrument: str) -> Iterator[Flag]:
    """Yield that a clock is off, or that the record does not decide it."""
    assert estimate.value is not None and estimate.standard_uncertainty is not None
    u = COVERAGE * estimate.standard_uncertainty
    if abs(estimate.value) - u > CLOCK_PPM:
        way = "slow" if estimate.value > 0.0 else "fast"
        message = (
            f"The clock of {instrument} is {abs(estimate.value):.0f} ppm {way} against the "
            f"computer's (U = {u:.0f} ppm). One of both is wrong: compare each with a time "
            "standard."
        )
        yield Flag("clock-off", message, instrument)
    elif u > CLOCK_PPM:
        message = f"The clock of {instrument} is known to {u:.0f} ppm only: record for longer."
        yield Flag("clock-undecided", message, instrument)


PART = Part(
    name="clocks",
    steps=(Step("K1", "Gaussmeter: its clock against the station's", gaussmeter),),
    figures=(CLOCK,),
    needs=(GAUSSMETER,),
    has=stamps,
    units=lambda parameters: (UNIT,),
    dataset=dataset,
    analyse=analyse,
)
