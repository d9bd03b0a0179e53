"""C1, C2: what the coils, their supplies and the field probe do."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

from pydantic import Field

from station import registry
from station.fields import StrictModel, Unit
from station.findings import Analysis, Estimate, Findings, InputQuantity
from station.method.commands import CoilOff, CoilOn, FieldRange, SteadyField
from station.method.duration import on_the_way
from station.method.run import Run
from station.method.verbs import Recording, keep_row, require_off
from station.procedure import Problem, Prompt, RecordUse, Step
from station.roles import DirectCurrentSupply, Gaussmeter
from station.units import parse_as

from .completing import Completion
from .part import COILS, COVERAGE, Figure, Part

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from station.instruments.bench import Bench
    from station.record.folder import RunFolder

    Array = NDArray[np.float64]

CONSTANT = Figure("coil_constant_ratio", axes=COILS, limit=0.015, nominal=1.0, drift=0.005)
"""Relative. A field that is off by more shifts a sensitivity by more than its usual budget; a
gaussmeter of 0.5 % (k = 2) decides it, and leaves half of it open from week to week."""
CROSS_AXIS = Figure("cross_axis", axes=COILS, limit=0.05, drift=0.01)
"""Relative to the coil's field: 3 deg, more than windings and probe are set up to by eye. A coil
that was knocked moves by 0.6 deg."""
AFTER_OFF = Figure("field_after_off", "mT", COILS, limit=0.01)
"""A supply at rest carries up to `zero_current`, 20 mA, and a coil makes up to 0.4 mT/A."""
AMBIENT = Figure("ambient_field", "mT", COILS, drift=0.003)
"""What changes by more from week to week is a steel door or a car."""
NOISE = Figure("ambient_noise", "mT", COILS, limit=0.005)
"""Standard deviation of single readings. More than that is traffic, a lift or a loose probe."""
GAIN, ZERO, ANGLE = "field_gain", "field_zero_mT", "probe_angle_rad"
MT_PER_T = 1e3
GAUSSMETER = "gaussmeter"
FIELD = ("parameters", "coils", "field")
RANGE_HEADROOM, EARTH_FIELD_MT = 1.5, 0.1
RANGE_S, RAMP_S = 0.5, 1.0
LOOK_S = 0.5
"""A gaussmeter that keeps no readings gives ten in a record of five seconds."""
SLOW_RECORD_S = 20.0
"""Of such a gaussmeter: forty readings of 1 uT of noise leave a tenth of the watched drift."""
CURRENT_COLUMNS = {
    "current_A": "A, read back",
    "commanded_A": "A, set-point by the bench's coil constant",
}
PLACE_PROBE = Prompt(
    "place-probe",
    "Set the gaussmeter's probe at the place of the device, its axes along the coils x, y, z; take "
    "the device and all iron and magnets away.",
)


class Ambient(StrictModel):
    """The ambient field along the bench's axes, from a map of the field and a compass."""

    x_mT: Annotated[float, Unit("mT")]
    y_mT: Annotated[float, Unit("mT")]
    z_mT: Annotated[float, Unit("mT")]
    standard_uncertainty_mT: Annotated[float, Unit("mT"), Field(gt=0)]

    @property
    def field_mT(self) -> tuple[float, ...]:
        """The components, in the order of `COILS`."""
        return (self.x_mT, self.y_mT, self.z_mT)


@dataclass(frozen=True)
class CoilRecord:
    """A unit of work: a coil at a field of either sense, or off, seen along a direction."""

    along: str
    coil: str
    state: str
    field_mT: float

    @property
    def unit(self) -> str:
        """The name of the unit of work."""
        return f"coil {self.coil} {self.state} along {self.along}"


class CoilParameters(StrictModel):
    """What the engineer chooses. A probe of one axis needs `turn_probe`: a person turns it.

    `ambient` is a key of the plan's own, which `Part.own` puts here.
    """

    field_mT: Annotated[float, Unit("mT"), Field(gt=0, le=1.0)] = 0.2
    record_s: Annotated[float, Unit("s"), Field(ge=2, le=600)] = 5.0
    settle_s: Annotated[float, Unit("s"), Field(ge=0.5, le=60)] = 1.0
    turn_probe: bool = False
    ambient: ClassVar[Ambient | None] = None

    @property
    def directions(self) -> tuple[str, ...]:
        """The directions in which the probe stands, one after the other."""
        return COILS if self.turn_probe else ("all",)

    def coil_records(self, along: str) -> tuple[CoilRecord, ...]:
        """Return the records of every coil, seen along a direction."""
        states = {"plus": self.field_mT, "minus": -self.field_mT, "off": 0.0}
        return tuple(CoilRecord(along, coil, *state) for coil in COILS for state in states.items())


def ambient_unit(along: str) -> str:
    """Return the name of the unit of work that records the ambient field along a direction."""
    return f"ambient along {along}"


def ambient(run: Run) -> None:
    """C1: limits into the supplies, then the field with all coils off."""
    run.ask(PLACE_PROBE)
    parameters: CoilParameters = run.parameters.coils
    for coil in COILS:
        run.role(supply_of(coil), DirectCurrentSupply).programme_limits()
    for along in run.unfinished(parameters.directions, ambient_unit):
        run.apply(field_range(parameters, along), takes=on_the_way(RANGE_S))
        with run.unit(ambient_unit(along)):
            follow_field(run, ambient_unit(along), parameters.settle_s, parameters.record_s)


def coils(run: Run) -> None:
    """C2: a small field of each sense from each coil alone, then its output off."""
    parameters: CoilParameters = run.parameters.coils
    for along in reversed(parameters.directions):
        wanted = parameters.coil_records(along)
        if all(run.is_finished(record.unit) for record in wanted):
            continue
        run.apply(field_range(parameters, along))
        for coil in COILS:
            of_coil = [record for record in wanted if record.coil == coil]
            if not all(run.is_finished(record.unit) for record in of_coil):
                run.may_pause()
                run.apply(CoilOn(supply_of(coil)))
                for record in of_coil:
                    measure(run, record)


def supply_of(coil: str) -> str:
    """Return the supply of a coil."""
    return f"coil_supply.{coil}"


def field_range(parameters: CoilParameters, along: str) -> FieldRange:
    """Return the range of the probe along a direction; the ambient field adds to the coil's."""
    range_mT = RANGE_HEADROOM * (parameters.field_mT + EARTH_FIELD_MT)
    turned = along if parameters.turn_probe else None
    return FieldRange(GAUSSMETER, range_mT, turned, decided_by=FIELD)


def coil_field(record: CoilRecord) -> SteadyField:
    """Return the steady field of a record."""
    return SteadyField(supply_of(record.coil), record.field_mT, decided_by=FIELD)


def measure(run: Run, record: CoilRecord) -> None:
    """Record the field of one coil, and the current that its supply reads back.

    A coil is driven as before where the record is finished: what follows is measured after that.
    """
    if run.is_finished(record.unit):
        drive(run, record)
        return
    supply, parameters = supply_of(record.coil), run.parameters.coils
    with run.toward(record.unit):
        drive(run, record)
        with run.unit(record.unit):
            if record.state != "off":
                source = run.role(supply, DirectCurrentSupply)
                commanded_A = run.read(lambda: record.field_mT / source.coil_constant_mT_per_A)
                current_A = source.current_A()
                keep_row(run, record.unit, supply, CURRENT_COLUMNS, current_A, commanded_A)
            follow_field(run, record.unit, parameters.settle_s, parameters.record_s)


def drive(run: Run, record: CoilRecord) -> None:
    """Bring a coil to the field of a record, or off and proven so."""
    if record.state != "off":
        run.apply(coil_field(record), takes=on_the_way(RAMP_S))
        return
    run.apply(CoilOff(supply_of(record.coil)), takes=on_the_way(RAMP_S))
    require_off(run, supply_of(record.coil))


def follow_field(run: Run, unit: str, settle_s: float, record_s: float) -> None:
    """Wait until what was averaged before is past, then record the field."""
    run.wait(settle_s, unit)
    run.role(GAUSSMETER, Gaussmeter).drain()
    Recording(run, unit, {GAUSSMETER: None}).follow(record_s, unit, every_s=LOOK_S)


@dataclass(frozen=True)
class Mean:
    """The mean field in mT (3,), its type A standard uncertainty (3,), the readings' noise (3,)."""

    field_mT: Array
    u_mT: Array
    noise_mT: Array
    readings: int


@dataclass(frozen=True)
class CoilFields:
    """A coil's fields on the probe's axes, and its supply's current: read back and commanded."""

    plus: Mean
    minus: Mean
    off: Mean
    read_A: float
    commanded_A: float


@dataclass(frozen=True)
class CoilDataset:
    """All of C1 and C2. `constants_mT_per_A` (3,) is what the bench file states of the coils.

    `gain_u` is the gaussmeter's relative, `zero_u_mT` its absolute standard uncertainty,
    `angle_u_rad` that of the direction of a probe that is turned by hand.
    `expected_mT` (3,) is the ambient field from a map, with `expected_u_mT`; None without one.
    """

    ambient: Mean
    coils: tuple[CoilFields, ...]
    constants_mT_per_A: Array
    gain_u: float
    zero_u_mT: float
    angle_u_rad: float = 0.0
    expected_mT: Array | None = None
    expected_u_mT: float = math.inf


def mean_of(field_mT: Array) -> Mean:
    """Return the mean of readings, shape (n, 3), n of at least 2.

    Raises ValueError for fewer, or for readings that are no numbers.
    """
    import numpy as np

    readings = len(field_mT)
    if readings < 2 or not np.isfinite(field_mT).all():
        raise ValueError("a mean of the field needs two readings that are numbers")
    noise_mT = np.std(field_mT, axis=0, ddof=1)
    return Mean(field_mT.mean(axis=0), noise_mT / math.sqrt(readings), noise_mT, readings)


def units(parameters: CoilParameters) -> list[str]:
    """Return the records that the figures are computed from."""
    return [
        unit
        for along in parameters.directions
        for unit in (
            ambient_unit(along),
            *(record.unit for record in parameters.coil_records(along)),
        )
    ]


def dataset(folder: RunFolder, parameters: CoilParameters, bench: Bench) -> CoilDataset:
    """Return the means of all records; ValueError where a record has no readings."""
    import numpy as np

    def mean(units: Sequence[str]) -> Mean:
        seen = [field_of(folder, unit) for unit in units]
        if not parameters.turn_probe:
            return mean_of(seen[0])
        shortest = min(len(rows) for rows in seen)
        return mean_of(np.column_stack([rows[:shortest, k] for k, rows in enumerate(seen)]))

    def state(coil: str, name: str) -> list[str]:
        return [
            record.unit
            for along in parameters.directions
            for record in parameters.coil_records(along)
            if (record.coil, record.state) == (coil, name)
        ]

    def current_A(coil: str, column: str) -> float:
        """Return half the difference of both senses, which is free of the read-back's zero."""
        plus, minus = (
            np.mean([folder.rows(supply_of(coil), unit)[column].mean() for unit in state(coil, of)])
            for of in ("plus", "minus")
        )
        return float(plus - minus) / 2.0

    coils = tuple(
        CoilFields(
            mean(state(coil, "plus")),
            mean(state(coil, "minus")),
            mean(state(coil, "off")),
            current_A(coil, "current_A"),
            current_A(coil, "commanded_A"),
        )
        for coil in COILS
    )
    settings = [bench.instruments[supply_of(coil)].settings for coil in COILS]
    constants = [parse_as(str(coil["coil_constant"]), "mT/A") for coil in settings]
    gain_u, zero_u_mT, _ = _gaussmeter(bench, parameters.field_mT)
    ambient = mean([ambient_unit(along) for along in parameters.directions])
    known = parameters.ambient
    return CoilDataset(
        ambient,
        coils,
        np.array(constants),
        gain_u,
        zero_u_mT,
        _angle_u_rad(bench),
        None if known is None else np.array(known.field_mT),
        math.inf if known is None else known.standard_uncertainty_mT,
    )


def field_of(folder: RunFolder, unit: str) -> Array:
    """Return the valid readings of a record, shape (n, 3)."""
    import numpy as np

    rows = folder.rows(GAUSSMETER, unit)
    good = rows[rows["state"] == 0]
    return np.column_stack([good[f"{axis}_T"] for axis in COILS]) * MT_PER_T


def _gaussmeter(bench: Bench, field_mT: float) -> tuple[float, float, str]:
    """Return the standard uncertainties of gain (relative) and zero (mT), and their source."""
    stated = bench.stated(GAUSSMETER, "field", field_mT, "mT")
    if stated is None:
        return 0.0, 0.0, ""
    at_field, source = stated
    at_zero, _ = bench.stated(GAUSSMETER, "field", 0.0, "mT") or (0.0, source)
    # A record states a part at zero and, added to it, a part that grows with the field.
    return max(at_field - at_zero, 0.0) / field_mT, at_zero, source


def _angle_u_rad(bench: Bench) -> float:
    """Return the standard uncertainty of the probe's direction, 0 where no record states it."""
    stated = bench.stated(GAUSSMETER, "angle", 0.0, "deg")
    return 0.0 if stated is None else math.radians(stated[0])


def inputs(parameters: CoilParameters, bench: Bench) -> list[InputQuantity]:
    """Return gain and zero of the gaussmeter, where its calibration record states them."""
    gain_u, zero_u_mT, source = _gaussmeter(bench, parameters.field_mT)
    if not source:
        return []
    quantities = [
        InputQuantity(GAIN, "gain of the gaussmeter", gain_u, "1", source),
        InputQuantity(ZERO, "zero of the gaussmeter", zero_u_mT, "mT", source),
    ]
    if angle_u_rad := _angle_u_rad(bench):
        quantities.append(
            InputQuantity(ANGLE, "direction of the probe", angle_u_rad, "rad", source)
        )
    return quantities


@dataclass(frozen=True)
class Measured:
    """What causes are found from; rows of (3, 3) are probe axes, columns coils.

    `response` is the field over that of the stated constant, `response_u` its combined standard
    uncertainty, `after_off_mT` (coil, axis) the field after the output went off less the ambient.
    """

    response: Array
    response_u: Array
    constants_mT_per_A: Array
    after_off_mT: Array
    after_off_u_mT: Array
    ambient_mT: Array
    expected_mT: Array | None
    ambient_u_mT: float


@dataclass(frozen=True)
class CoilAnalysis(Analysis):
    """The outcome, and what the causes are found from."""

    measured: Measured


def analyse(data: CoilDataset, inputs: Sequence[InputQuantity] = ()) -> CoilAnalysis:
    """Return coil constants, cross-axis parts, ambient field, and what causes are found from.

    The difference of both senses is free of the ambient field and of the probe's zero.
    """
    import numpy as np

    columns, uncertainties = [], []
    for coil, constant in zip(data.coils, data.constants_mT_per_A, strict=True):
        stated_mT = constant * coil.read_A
        column = (coil.plus.field_mT - coil.minus.field_mT) / 2.0 / stated_mT
        type_a = np.hypot(coil.plus.u_mT, coil.minus.u_mT) / 2.0 / abs(stated_mT)
        # Which of read-back and set-point is right is not known: a rectangle between both.
        current_u = abs(coil.read_A / coil.commanded_A - 1.0) / math.sqrt(3.0)
        columns.append(column)
        uncertainties.append(np.hypot(type_a, current_u * np.abs(column)))
    response, response_u = np.column_stack(columns), np.column_stack(uncertainties)
    estimates: list[Estimate] = []
    for k, axis in enumerate(COILS):
        estimates += _of_coil(axis, k, data, response, response_u)
    estimates += [_ambient(axis, k, data.ambient) for k, axis in enumerate(COILS)]
    estimates += [_noise(axis, k, data.ambient) for k, axis in enumerate(COILS)]
    after_off = np.array([coil.off.field_mT - data.ambient.field_mT for coil in data.coils])
    after_off_u = np.array([np.hypot(coil.off.u_mT, data.ambient.u_mT) for coil in data.coils])
    measured = Measured(
        response,
        np.hypot(response_u, data.gain_u * np.abs(response)),
        data.constants_mT_per_A,
        after_off,
        after_off_u,
        data.ambient.field_mT,
        data.expected_mT,
        math.hypot(data.expected_u_mT, data.zero_u_mT),
    )
    return CoilAnalysis(estimates, (), (), measured)


def _of_coil(
    axis: str, k: int, data: CoilDataset, response: Array, response_u: Array
) -> list[Estimate]:
    import numpy as np

    own, own_u = float(response[k, k]), float(response_u[k, k])
    across, across_u = across_of(response, response_u, k, k)
    along = math.sqrt(1.0 - across**2)
    coil = data.coils[k]
    freedom = float(coil.plus.readings + coil.minus.readings - 2)
    left_mT = float(coil.off.field_mT[k] - data.ambient.field_mT[k])
    left_u_mT = float(np.hypot(coil.off.u_mT[k], data.ambient.u_mT[k]))
    left_freedom = float(coil.off.readings + data.ambient.readings - 2)
    constant = float(data.constants_mT_per_A[k]) * own
    extra = {"coil_constant_mT_per_A": constant, "column": response[:, k].tolist()}
    method = "half the difference of both senses over the stated field"
    return [
        CONSTANT.measured(own, own_u, method, axis, freedom, {GAIN: own}, **extra),
        CROSS_AXIS.measured(across, across_u, method, axis, freedom, {ANGLE: along}),
        AFTER_OFF.measured(left_mT, left_u_mT, "off less ambient", axis, left_freedom),
    ]


def _ambient(axis: str, k: int, ambient: Mean) -> Estimate:
    field_mT, u_mT = float(ambient.field_mT[k]), float(ambient.u_mT[k])
    freedom, by = float(ambient.readings - 1), {GAIN: field_mT, ZERO: 1.0}
    return AMBIENT.measured(field_mT, u_mT, "mean", axis, freedom, by)


def _noise(axis: str, k: int, ambient: Mean) -> Estimate:
    noise_mT, freedom = float(ambient.noise_mT[k]), float(ambient.readings - 1)
    u_mT = noise_mT / math.sqrt(2.0 * freedom)
    return NOISE.measured(noise_mT, u_mT, "standard deviation", axis, freedom)


def across_of(response: Array, response_u: Array, axis: int, supply: int) -> tuple[float, float]:
    """Return the part across `axis` of the field of a supply over the whole of it, and its u."""
    import numpy as np

    others = [i for i in range(len(COILS)) if i != axis]
    whole = max(float(np.linalg.norm(response[:, supply])), 1e-9)
    across = float(np.hypot(*response[others, supply]))
    return across / whole, float(np.hypot(*response_u[others, supply])) / whole


def completions(findings: Findings, bench: Bench) -> Iterator[Completion]:
    """Yield each coil's measured constant, where the stated one lies outside its uncertainty.

    Nothing where no record states the gaussmeter's gain. Causes are the caller's to look at.
    """
    gains = [input.standard_uncertainty for input in findings.inputs if input.name == GAIN]
    gain_u = next(iter(gains), None)
    if gain_u is None:
        return
    for estimate in findings.estimates:
        if (
            estimate.name != "coil_constant_ratio"
            or estimate.value is None
            or estimate.axis not in COILS
        ):
            continue
        u = ((estimate.standard_uncertainty or 0.0) ** 2 + (gain_u * estimate.value) ** 2) ** 0.5
        if abs(estimate.value - 1.0) <= COVERAGE * u:
            continue
        constant = estimate.extra["coil_constant_mT_per_A"]
        yield Completion(
            ("instruments", supply_of(estimate.axis), "settings", "coil_constant"),
            f"{constant:.6g} mT/A",
            f"measured, U = {100.0 * COVERAGE * u / estimate.value:.2g} % (k = {COVERAGE:g})",
            (estimate.name, estimate.axis, 1.0),
        )


def of_gaussmeter(bench: Bench, attribute: str) -> int:
    """Return what the driver of a bench's gaussmeter states of it; 0 where nobody knows."""
    gaussmeter = bench.instruments.get(GAUSSMETER)
    if gaussmeter is None or registry.why_not(registry.DRIVERS, gaussmeter.driver):
        return 0
    return int(getattr(registry.load(registry.DRIVERS, gaussmeter.driver), attribute))


def axes_of_probe(bench: Bench) -> int:
    """Return how many axes the gaussmeter of a bench measures; none where nobody knows."""
    return of_gaussmeter(bench, "axes")


def stamps(bench: Bench) -> bool:
    """Return whether the gaussmeter of a bench keeps readings, each with its time."""
    return bool(of_gaussmeter(bench, "keeps_readings"))


def turned_probe(bench: Bench, part: str) -> Iterator[str]:
    """Yield that in a part a probe of one axis is turned."""
    if axes_of_probe(bench) == 1:
        yield f"parameters.{part}.turn_probe=true"


def fits(bench: Bench) -> Iterator[str]:
    """Yield that a probe of one axis is turned, and a record that decides a drift."""
    yield from turned_probe(bench, "coils")
    if not stamps(bench):
        yield f"parameters.coils.record={SLOW_RECORD_S:g} s"


def records(parameters: CoilParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return what the analysis takes of calibration records: the gaussmeter's gain, zero, angle."""
    return (
        RecordUse(GAUSSMETER, "field", parameters.field_mT, "mT", corrected=False),
        RecordUse(GAUSSMETER, "angle", 0.0, "deg", needed=False, corrected=False),
    )


def check(parameters: CoilParameters, bench: Bench) -> Iterator[Problem]:
    """Yield that a probe of one axis has to be turned."""
    if axes_of_probe(bench) == 1 and not parameters.turn_probe:
        driver = bench.instruments[GAUSSMETER].driver
        yield Problem(
            ("parameters", "coils", "turn_probe"),
            f"the gaussmeter ({driver}) measures one axis; write `turn_probe: true`",
        )


PART = Part(
    name="coils",
    steps=(
        Step("C1", "Ambient field and its noise, all coils off", ambient),
        Step("C2", "Coils: polarity, axis, constant, cross-axis, output off", coils),
    ),
    figures=(CONSTANT, CROSS_AXIS, AFTER_OFF, AMBIENT, NOISE),
    needs=(GAUSSMETER, *map(supply_of, COILS)),
    units=units,
    dataset=dataset,
    inputs=inputs,
    analyse=analyse,
    records=records,
    check=check,
    fits=fits,
    site="ambient",
    completes=completions,
    may_stand=frozenset({"coil-constant-off"}),
)
