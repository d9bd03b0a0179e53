"""V1, V2: a limit of a supply's own acts, and an output that is off is off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from station import registry
from station.fields import StrictModel, Unit
from station.findings import Analysis, Estimate, Flag, InputQuantity
from station.method.commands import CoilOff, FieldRange
from station.method.duration import on_the_way
from station.method.run import Run
from station.method.set_points import Bounds, Command, Station
from station.method.verbs import keep_row
from station.procedure import RecordUse, Step
from station.roles import DirectCurrentSupply, ProvesItself

from .coils import (
    EARTH_FIELD_MT,
    GAUSSMETER,
    MT_PER_T,
    PLACE_PROBE,
    follow_field,
    supply_of,
    turned_probe,
)
from .part import COILS, Cause, Figure, Part

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

    Array = NDArray[np.float64]

OWN_LIMIT = Figure("own_limit_ratio", axes=COILS, limit=1.05)
"""Over the limit that was programmed: a limit of a supply is set to some per cent."""
AFTER_CUT = Figure(
    "field_after_cut",
    "mT",
    COILS,
    limit=0.01,
    cause=Cause(
        "output-stays-on",
        "Coil {axis} still makes {value:.3g} mT after its output is off: current flows that the "
        "supply does not show. Switch it off at the mains; do not use it.",
    ),
)
"""As after a ramp to zero: 20 mA, what counts as no current, make up to 8 uT in a coil."""
GAIN = "field_gain_of_cut"
COMMANDED, FLOWS = "commanded_A", "current_A"

WHERE = ("parameters", "supplies")
FIELD_OF_CUT = (GAUSSMETER, "field", 0.1, "mT")
RANGE_MT, RAMP_S = 0.5, 3.0
"""A few hundred mA in a coil of up to 0.4 mT/A, and the ambient field."""
COLUMNS = {FLOWS: "A, read back", COMMANDED: "A, asked for beyond the limit"}


def limit_unit(coil: str) -> str:
    """Return the unit of work in which a supply is asked for more than a limit of its own."""
    return f"own limit {coil}"


def before_unit(coil: str) -> str:
    """Return the unit of work that records the field with the output off."""
    return f"before {coil} is on"


def cut_unit(coil: str) -> str:
    """Return the unit of work that records the field after the output was cut off."""
    return f"after {coil} is cut off"


class SupplyParameters(StrictModel):
    """What the engineer chooses; both currents are small, and below every limit of the bench."""

    limit_A: Annotated[float, Unit("A"), Field(gt=0, le=2)] = 0.3
    beyond: Annotated[float, Unit("1"), Field(gt=0.1, le=1)] = 0.5
    cut_at_A: Annotated[float, Unit("A"), Field(gt=0, le=1)] = 0.3
    record_s: Annotated[float, Unit("s"), Field(ge=2, le=600)] = 3.0
    settle_s: Annotated[float, Unit("s"), Field(ge=0.5, le=60)] = 1.0
    turn_probe: bool = False

    @property
    def asked_A(self) -> float:
        """The current that is asked for while the limit is in force."""
        return self.limit_A * (1.0 + self.beyond)


@dataclass(frozen=True)
class BeyondOwnLimit(Command[float]):
    """More current than a limit that the supply is given for it; the current in A that flows."""

    limit_A: float
    asked_A: float

    def words(self, bench: Bench) -> str:
        """Return limit and current."""
        return f"{self.asked_A:g} A asked for at a limit of its own of {self.limit_A:g} A"

    def bounds(self, bench: Bench) -> Bounds:
        """Return what flows where the limit does not act."""
        return {"current_A": self.asked_A}

    def apply(self, station: Station, prepared: float | None) -> float:
        """Ask for it and return to zero."""
        supply = station.role(self.instrument, ProvesItself)
        return supply.current_beyond_limit_A(self.limit_A, self.asked_A)


@dataclass(frozen=True)
class CutOff(Command[None]):
    """The output off at once while a small current flows: no ramp hides one that stays on."""

    at_A: float

    def words(self, bench: Bench) -> str:
        """Return the current at which it is cut off."""
        return f"cut off at {self.at_A:g} A"

    def bounds(self, bench: Bench) -> Bounds:
        """Return the current."""
        return {"current_A": self.at_A}

    def apply(self, station: Station, prepared: None) -> None:
        """Go to the current within the slew limit, then switch the output off."""
        supply = station.role(self.instrument, ProvesItself)
        supply.switch_on()
        supply.ramp_to(self.at_A)
        supply.cut_off()


def own_limits(run: Run) -> None:
    """V1: a low limit into each supply, and a little more than that asked of it."""
    run.ask(PLACE_PROBE)
    parameters: SupplyParameters = run.parameters.supplies
    for coil in COILS:
        supply = supply_of(coil)
        run.role(supply, DirectCurrentSupply).programme_limits()
        for unit in run.unfinished([limit_unit(coil)]):
            with run.unit(unit):
                flows_A = run.apply(beyond_limit(parameters, coil), takes=on_the_way(RAMP_S))
                keep_row(run, unit, supply, COLUMNS, flows_A, parameters.asked_A)


def cuts(run: Run) -> None:
    """V2: a small current cut off, and whether its field is gone."""
    parameters: SupplyParameters = run.parameters.supplies
    times_s = parameters.settle_s, parameters.record_s
    for coil in COILS:
        before, after = before_unit(coil), cut_unit(coil)
        if run.is_finished(before) and run.is_finished(after):
            continue
        run.may_pause()
        run.apply(field_range(parameters, coil))
        if not run.is_finished(before):
            with run.unit(before):
                follow_field(run, before, *times_s)
        with run.unit(after):
            run.apply(cut(parameters, coil), takes=on_the_way(RAMP_S))
            follow_field(run, after, *times_s)
        # Whatever the field shows: to zero within the slew limit, then off.
        run.apply(CoilOff(supply_of(coil)))


def field_range(parameters: SupplyParameters, coil: str) -> FieldRange:
    """Return the range of the probe, turned along a coil where it has one axis."""
    turned = coil if parameters.turn_probe else None
    return FieldRange(GAUSSMETER, RANGE_MT + EARTH_FIELD_MT, turned, decided_by=WHERE)


def beyond_limit(parameters: SupplyParameters, coil: str) -> BeyondOwnLimit:
    """Return the current beyond a supply's own limit."""
    where = (*WHERE, "limit")
    limit_A, asked_A = parameters.limit_A, parameters.asked_A
    return BeyondOwnLimit(supply_of(coil), limit_A, asked_A, decided_by=where)


def cut(parameters: SupplyParameters, coil: str) -> CutOff:
    """Return the current that is cut off."""
    return CutOff(supply_of(coil), parameters.cut_at_A, decided_by=(*WHERE, "cut_at"))


@dataclass(frozen=True)
class SupplyRecord:
    """One coil's supply: the current in A that flowed beyond a limit, the fields in mT of a cut.

    `current_u_A` is the standard uncertainty of the read-back near zero. `before_mT` and
    `after_mT` (n, axes) are those on the axes of the probe, NaN on one that it does not have.
    """

    coil: str
    limit_A: float
    flows_A: float
    current_u_A: float
    before_mT: Array
    after_mT: Array


def dataset(
    folder: RunFolder, parameters: SupplyParameters, bench: Bench
) -> tuple[SupplyRecord, ...]:
    """Return what was recorded of each supply."""
    return tuple(record_of(folder, parameters, bench, coil) for coil in COILS)


def record_of(
    folder: RunFolder, parameters: SupplyParameters, bench: Bench, coil: str
) -> SupplyRecord:
    """Return what was recorded of one supply."""
    supply = supply_of(coil)
    return SupplyRecord(
        coil,
        parameters.limit_A,
        float(folder.rows(supply, limit_unit(coil))[FLOWS][0]),
        # What counts as no current is what a read-back may be off by: a rectangle of that.
        bench.instruments[supply].limits["zero_current"] / math.sqrt(3.0),
        shown_mT(folder, before_unit(coil)),
        shown_mT(folder, cut_unit(coil)),
    )


def shown_mT(folder: RunFolder, unit: str) -> Array:
    """Return the valid readings of a record on all axes of the probe, shape (n, 3)."""
    import numpy as np

    rows = folder.rows(GAUSSMETER, unit)
    valid = rows[rows["state"] == 0]
    return np.column_stack([valid[f"{axis}_T"] * MT_PER_T for axis in COILS])


def analyse(data: Sequence[SupplyRecord], inputs: Sequence[InputQuantity] = ()) -> Analysis:
    """Return what the limits hold, the fields after a cut, and causes; ValueError for no record."""
    estimates, flags = list[Estimate](), list[Flag]()
    for supply in data:
        ratio, u = abs(supply.flows_A) / supply.limit_A, supply.current_u_A / supply.limit_A
        method = "the current that flows over the limit that is programmed"
        estimates += [OWN_LIMIT.measured(ratio, u, method, supply.coil), _left(supply)]
        if OWN_LIMIT.is_off(ratio, u):
            message = (
                f"The supply of coil {supply.coil} gives {abs(supply.flows_A):.3g} A at a limit of "
                f"its own of {supply.limit_A:g} A: the limit does not act. Only the station's "
                "interlocks protect the coil; have the supply repaired, or its interface card."
            )
            flags.append(Flag("own-limit-does-not-act", message, supply.coil))
    return Analysis(estimates, (), flags)


def _left(supply: SupplyRecord) -> Estimate:
    import numpy as np

    readings = min(len(supply.before_mT), len(supply.after_mT))
    if readings < 2:
        raise ValueError("a mean of the field needs two readings")
    records = supply.before_mT, supply.after_mT
    left_mT = supply.after_mT.mean(axis=0) - supply.before_mT.mean(axis=0)
    # A probe whose axes are exchanged shows the coil's field on another one.
    strongest, own = int(np.nanargmax(np.abs(left_mT))), COILS.index(supply.coil)
    k = strongest if abs(left_mT[strongest]) > AFTER_CUT.limit else own
    u_mT = math.hypot(*(float(np.std(x[:, k], ddof=1)) / math.sqrt(len(x)) for x in records))
    freedom = float(len(supply.before_mT) + len(supply.after_mT) - 2)
    by = {GAIN: float(left_mT[k])}
    return AFTER_CUT.measured(
        float(left_mT[k]), u_mT, "after less before", supply.coil, freedom, by
    )


def prove_themselves(bench: Bench) -> bool:
    """Return whether the supplies of all coils can prove themselves."""
    drivers = [bench.instruments[supply_of(coil)].driver for coil in COILS]
    return all(
        not registry.why_not(registry.DRIVERS, driver)
        and hasattr(registry.load(registry.DRIVERS, driver), "cut_off")
        for driver in drivers
    )


PART = Part(
    name="supplies",
    steps=(
        Step("V1", "Supplies: a limit of their own acts", own_limits),
        Step("V2", "Supplies: an output that is cut off carries nothing", cuts),
    ),
    figures=(OWN_LIMIT, AFTER_CUT),
    needs=(GAUSSMETER, *map(supply_of, COILS)),
    has=prove_themselves,
    units=lambda parameters: (
        unit(coil) for coil in COILS for unit in (limit_unit, before_unit, cut_unit)
    ),
    dataset=dataset,
    inputs=lambda parameters, bench: list(
        bench.stated_input(FIELD_OF_CUT, GAIN, "gain of the gaussmeter", relative=True)
    ),
    analyse=analyse,
    records=lambda parameters, bench: (
        RecordUse(*FIELD_OF_CUT, corrected=False),
        RecordUse(GAUSSMETER, "angle", 0.0, "deg", needed=False, corrected=False),
    ),
    fits=lambda bench: turned_probe(bench, "supplies"),
)
