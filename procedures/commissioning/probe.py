"""P1: where the probe stands in the coils, and how even their field is, by moving the probe.

Each coil is a Helmholtz pair: two equal loops about its axis, one radius apart up to a small error.
The field that a coil makes along its own direction, seen at several places about one, has the
centre and the radius in it, and which of the bench's axes that direction is: neither exchanged
coils nor an exchanged probe hide the place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from station.fields import StrictModel, Unit
from station.findings import Analysis, Flag, InputQuantity, contradiction
from station.method.commands import CoilOff, CoilOn, FieldRange, SteadyField
from station.method.duration import on_the_way
from station.method.run import Run
from station.method.verbs import require_off
from station.procedure import Prompt, RecordUse, Step
from station.roles import DirectCurrentSupply

from .coils import (
    EARTH_FIELD_MT,
    GAUSSMETER,
    PLACE_PROBE,
    RANGE_HEADROOM,
    axes_of_probe,
    field_of,
    follow_field,
    mean_of,
    supply_of,
)
from .part import COILS, Figure, Part, undetermined

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from station.instruments.bench import Bench
    from station.instruments.coil_geometry import Position
    from station.record.folder import RunFolder

    Array = NDArray[np.float64]

OFFSET = Figure("probe_offset", "mm", COILS)
FIELD_ERROR = Figure("probe_field_error", axes=COILS, limit=0.002)
"""Relative: the field at the probe over that at the centre. The place of a probe matters by what it
costs of the field; this is less than half of a gaussmeter's usual 0.5 % (k = 2)."""
HOMOGENEITY = Figure("homogeneity", axes=COILS, limit=0.005)
"""Relative, within the device: as much as the gaussmeter's own uncertainty."""
FIGURES = (OFFSET, FIELD_ERROR, HOMOGENEITY)
MIN_SHARE = 0.5
"""Of the commanded field: a coil with less on its own axis is another one, or not connected."""
SPACING_U = 0.01
"""Relative standard uncertainty of a Helmholtz pair's spacing: windings of some width."""
MOVE_MM = 80.0
"""A third of a usual coil's radius: the field falls off there by more than its readings' noise."""
MAX_OFF_U = 3.0
"""In standard uncertainties of each coordinate: once in a hundred healthy benches."""
SENSES = {"plus": 1.0, "minus": -1.0}
N = len(COILS)
CENTRE, SCALE, RADIUS, SPACING = (slice(N * k, N * (k + 1)) for k in range(4))
METHOD = "least squares of Helmholtz pairs"
FIELD = ("parameters", "probe", "field")
RAMP_S = 4.0
BACK = Prompt("move-probe-back", "Move the probe back to the place of the device.")


@dataclass(frozen=True)
class ProbePlace:
    """Where a person puts the probe, in mm from the place of the device."""

    name: str
    shift_mm: tuple[float, float, float]


DEVICE = ProbePlace("at the device", (0.0, 0.0, 0.0))
PLACES = (
    DEVICE,
    *(
        ProbePlace(
            f"{axis}-{sense}",
            (
                MOVE_MM * sign * (axis == "x"),
                MOVE_MM * sign * (axis == "y"),
                MOVE_MM * sign * (axis == "z"),
            ),
        )
        for axis in COILS
        for sense, sign in SENSES.items()
    ),
)


@dataclass(frozen=True)
class PlaceRecord:
    """A unit of work: the field of a coil in one sense, at a place of the probe."""

    place: ProbePlace
    coil: str
    sense: str
    field_mT: float

    @property
    def unit(self) -> str:
        """The name of the unit of work."""
        return f"probe {self.place.name}, coil {self.coil} {self.sense}"


class ProbeParameters(StrictModel):
    """What the engineer chooses; `device` is the edge of the cube that holds the device."""

    field_mT: Annotated[float, Unit("mT"), Field(gt=0, le=2.0)] = 0.5
    record_s: Annotated[float, Unit("s"), Field(ge=2, le=600)] = 3.0
    settle_s: Annotated[float, Unit("s"), Field(ge=0.5, le=60)] = 1.0
    device_mm: Annotated[float, Unit("mm"), Field(gt=0, le=200)] = 60.0
    placing_mm: Annotated[float, Unit("mm"), Field(ge=0, le=10)] = 1.0

    def records_at(self, place: ProbePlace) -> tuple[PlaceRecord, ...]:
        """Return the records at a place: every coil in both senses."""
        return tuple(
            PlaceRecord(place, coil, sense, sign * self.field_mT)
            for coil in COILS
            for sense, sign in SENSES.items()
        )


def move_of(place: ProbePlace) -> Prompt:
    """Return what a person is asked to do to bring the probe to a place."""
    if place == DEVICE:
        return PLACE_PROBE
    axis, sense = place.name.split("-")
    way = {"plus": f"+{axis}", "minus": f"-{axis}"}[sense]
    return Prompt(
        f"move-probe-{place.name}",
        f"All coils are off. Move the probe by {MOVE_MM:g} mm from the place of the device towards "
        f"{way}, without turning it.",
    )


def places(run: Run) -> None:
    """P1: the probe at each place, there each coil alone in both senses."""
    parameters: ProbeParameters = run.parameters.probe
    for coil in COILS:
        run.role(supply_of(coil), DirectCurrentSupply).programme_limits()
    run.apply(field_range(parameters))
    for place in PLACES:
        records = parameters.records_at(place)
        if all(run.is_finished(record.unit) for record in records):
            continue
        all_off(run)
        run.may_pause()
        run.ask(move_of(place))
        for record in run.unfinished(records, lambda record: record.unit, pauses=False):
            measure(run, record)
        all_off(run)
    run.ask(BACK)


def field_range(parameters: ProbeParameters) -> FieldRange:
    """Return the range of the probe; the ambient field adds to the coil's."""
    range_mT = RANGE_HEADROOM * (parameters.field_mT + EARTH_FIELD_MT)
    return FieldRange(GAUSSMETER, range_mT, decided_by=FIELD)


def coil_field(record: PlaceRecord) -> SteadyField:
    """Return the steady field of a record."""
    return SteadyField(supply_of(record.coil), record.field_mT, decided_by=FIELD)


def all_off(run: Run) -> None:
    """Switch every coil off and prove it, before a hand comes near."""
    for coil in COILS:
        run.apply(CoilOff(supply_of(coil)))
        require_off(run, supply_of(coil))


def measure(run: Run, record: PlaceRecord) -> None:
    """Record the field of one coil in one sense."""
    parameters: ProbeParameters = run.parameters.probe
    supply = supply_of(record.coil)
    run.apply(CoilOn(supply))
    run.apply(coil_field(record), takes=on_the_way(RAMP_S))
    with run.unit(record.unit):
        follow_field(run, record.unit, parameters.settle_s, parameters.record_s)
    if record.sense == "minus":
        run.apply(CoilOff(supply))


@dataclass(frozen=True)
class ProbeDataset:
    """Fields in mT of each coil at the probe, (places, coils, axes), with type A uncertainties.

    The axes are those of the probe, whatever they are to the bench. `shift_mm` (places, 3) from the
    place of the device, each with `placing_u_mm`; `device_mm` is the edge of the cube that holds
    the device.
    """

    shift_mm: Array
    field_mT: Array
    field_u_mT: Array
    placing_u_mm: float
    commanded_mT: float
    device_mm: float
    stated: Sequence[Position] = ()
    """Where the bench file has probe and device: the probe is at one of these places here."""


@dataclass(frozen=True)
class ProbeFit(Analysis):
    """The outcome; `radius_mm` (3,) of each pair as the fit has it."""

    radius_mm: Array


def dataset(folder: RunFolder, parameters: ProbeParameters, bench: Bench) -> ProbeDataset:
    """Return half the difference of both senses; it is free of the ambient field and of zeros."""
    import numpy as np

    fields: list[list[Array]] = []
    u: list[list[Array]] = []
    for place in PLACES:
        means = {
            (record.coil, record.sense): mean_of(field_of(folder, record.unit))
            for record in parameters.records_at(place)
        }
        both = [(means[coil, "plus"], means[coil, "minus"]) for coil in COILS]
        fields.append([(a.field_mT - b.field_mT) / 2.0 for a, b in both])
        u.append([np.hypot(a.u_mT, b.u_mT) / 2.0 for a, b in both])
    return ProbeDataset(
        np.array([place.shift_mm for place in PLACES]),
        np.array(fields),
        np.array(u),
        parameters.placing_mm,
        parameters.field_mT,
        parameters.device_mm,
        stated_places(bench),
    )


def stated_places(bench: Bench) -> tuple[Position, ...]:
    """Return the places of probe and device that a bench states; none where it states none."""
    stated = bench.coil_geometry and bench.coil_geometry.three_axis
    return (stated.probe, stated.device) if stated else ()


def shares_at(point_mm: Array, unknown: Array, normal: Array) -> Array:
    """Return each coil's field over that at its centre, shape (..., 3), at points (..., 3).

    `normal` (coils, 3) is the direction of each coil in the bench.
    """
    import numpy as np

    from procedures.common.helmholtz import pair_field

    along = point_mm @ normal.T
    across = np.sqrt(np.maximum(np.sum(point_mm**2, axis=-1)[..., None] - along**2, 0.0))
    return pair_field(along, across, unknown[RADIUS], unknown[SPACING])[0]


def analyse(data: ProbeDataset, inputs: Sequence[InputQuantity] = ()) -> ProbeFit:
    """Return offset, field error and homogeneity, and the cause where the probe is off centre.

    Which of the bench's axes each coil stands along is that which the fields at all places fit
    best.
    """
    import numpy as np

    mean_mT = data.field_mT.mean(axis=0)
    strongest = np.abs(mean_mT).argmax(axis=1)
    weak = np.linalg.norm(mean_mT, axis=1) < MIN_SHARE * data.commanded_mT
    weak |= np.bincount(strongest, minlength=N)[strongest] > 1
    if weak.any():
        return undecided([axis for axis, is_weak in zip(COILS, weak, strict=True) if is_weak])
    direction = mean_mT / np.linalg.norm(mean_mT, axis=1)[:, None]
    field_mT = np.sum(data.field_mT * direction, axis=-1)
    u_mT = np.sqrt(np.sum((data.field_u_mT * direction) ** 2, axis=-1))
    sense = np.sign(direction[range(N), strongest])[:, None]
    fits = []
    for stands in permutations(range(N)):
        normal = np.zeros((N, N))
        normal[:, [stands[coil] for coil in np.argsort(strongest)]] = direction * sense
        fits.append(PairsFit.of(data, field_mT, u_mT, normal))
    fit = min(fits, key=lambda fit: fit.misfit)
    result = fit.figures(data.device_mm)
    if result.flags:  # the place is named already, and not that of a run
        return result
    u_mm = np.sqrt(np.diag(fit.covariance)[CENTRE])
    return replace(result, flags=elsewhere(fit.unknown[CENTRE], u_mm, data.stated))


def elsewhere(place_mm: Array, u_mm: Array, stated: Sequence[Position]) -> tuple[Flag, ...]:
    """Return the flag of a probe that is at no place which the bench states."""
    import numpy as np

    def off(place: Position) -> float:
        apart_mm = np.abs(place_mm - place.point_mm)
        return float(np.max(apart_mm / np.hypot(u_mm, place.uncertainty_mm)))

    if not stated or min(map(off, stated)) <= MAX_OFF_U:
        return ()
    where = ", ".join(f"{axis} {mm:+.1f} mm" for axis, mm in zip(COILS, place_mm, strict=True))
    message = (
        f"By the coils' fields the probe stands at {where} of their centre: neither the probe nor "
        "the device is there by `coil_geometry` of the bench file. Measure both places again."
    )
    flag = contradiction("coil_geometry.three_axis", message, offset_mm=place_mm.tolist())
    return (flag,)


@dataclass(frozen=True)
class PairsFit:
    """Three pairs along `normal` fitted: the unknowns, their covariance, and chi-square."""

    unknown: Array
    covariance: Array
    misfit: float
    normal: Array
    freedom: float
    steps: Array

    @classmethod
    def of(cls, data: ProbeDataset, field_mT: Array, u_mT: Array, normal: Array) -> PairsFit:
        """Fit the fields (places, coils) of pairs that stand along `normal`."""
        import numpy as np
        from scipy.optimize import least_squares

        reach = float(np.abs(data.shift_mm).max())

        def shares(unknown: Array, off_mm: Array | float = 0.0) -> Array:
            return shares_at(data.shift_mm + unknown[CENTRE] + off_mm, unknown, normal)

        def fitted(sigma: Array, start: Array) -> Any:
            def residuals(unknown: Array) -> Array:
                prior = (unknown[SPACING] - 1.0) / SPACING_U
                misses = (field_mT - unknown[SCALE] * shares(unknown)) / sigma
                return np.concatenate((misses.ravel(), prior))

            return least_squares(residuals, start, x_scale=scale, bounds=bounds)

        begin = np.concatenate((np.zeros(N), field_mT[0], np.full(N, 3.0 * reach), np.ones(N)))
        scale = np.concatenate(
            (np.full(N, 10.0), field_mT[0], np.full(N, reach), np.full(N, SPACING_U))
        )
        span = np.concatenate((np.full(N, 2.0 * reach), np.full(N, np.inf)))
        lowest = np.concatenate((-span, np.full(N, 1.5 * reach), np.full(N, 0.9)))
        highest = np.concatenate((span, np.full(N, 20.0 * reach), np.full(N, 1.1)))
        bounds = (lowest, highest)
        first = fitted(u_mT, begin).x
        slopes = [(shares(first, step) - shares(first, -step)) / 2.0 for step in np.eye(N)]
        slope = np.sqrt(np.sum(np.square(slopes), axis=0)) * np.abs(first[SCALE])
        best = fitted(np.hypot(u_mT, slope * data.placing_u_mm), first)
        covariance = np.linalg.pinv(best.jac.T @ best.jac)
        freedom = float(field_mT.size - begin.size + N)
        return cls(best.x, covariance, float(best.cost), normal, freedom, 1e-3 * scale)

    def figures(self, device_mm: float) -> ProbeFit:
        """Return what the fit says of the place and of a device of this edge in the centre."""
        import numpy as np

        corners = np.stack(np.meshgrid(*N * [(-0.5, 0.0, 0.5)]), axis=-1).reshape(-1, N)
        corners = corners * device_mm

        def figures(of: Array) -> Array:
            here = shares_at(of[CENTRE], of, self.normal) - 1.0
            uneven = np.abs(shares_at(corners, of, self.normal) - 1.0).max(axis=0)
            return np.concatenate((of[CENTRE], here, uneven))

        values = figures(self.unknown)
        jacobian = np.column_stack(
            [
                (figures(self.unknown + step) - figures(self.unknown - step)) / (2.0 * step.sum())
                for step in np.diag(self.steps)
            ]
        )
        u = np.sqrt(np.diag(jacobian @ self.covariance @ jacobian.T))
        wanted = [(figure, axis) for figure in FIGURES for axis in COILS]
        estimates = [
            figure.measured(float(value), float(its_u), METHOD, axis, self.freedom)
            for (figure, axis), value, its_u in zip(wanted, values, u, strict=True)
        ]
        flags = off_centre(values[:N], values[N : 2 * N], u[N : 2 * N])
        return ProbeFit(estimates, (), flags, self.unknown[RADIUS])


def undecided(weak: list[str]) -> ProbeFit:
    """Return the outcome where a coil does not show, or along the same axis as another one."""
    import numpy as np

    message = (
        f"The probe does not show the field of coil {', '.join(weak)} along an axis of its own: "
        "its place is not decided. Mend first what the coils' part (C) names."
    )
    flag = Flag("probe-place-undecided", message, details={"coils": weak})
    return ProbeFit(undetermined(FIGURES, METHOD), (), (flag,), np.full(N, np.nan))


def off_centre(offset_mm: Array, error: Array, error_u: Array) -> tuple[Flag, ...]:
    """Return the flag of a probe whose place costs more of the field than the limit."""
    import numpy as np

    if not any(map(FIELD_ERROR.is_off, error, error_u)):
        return ()
    where = ", ".join(f"{axis} {mm:+.0f} mm" for axis, mm in zip(COILS, offset_mm, strict=True))
    worst = int(np.abs(error).argmax())
    message = (
        f"The probe stands off the centre of the coils ({where}): the field of coil "
        f"{COILS[worst]} differs there by {100.0 * error[worst]:+.2f} % from that at the centre. "
        "Set probe and device in the centre."
    )
    return (Flag("probe-off-centre", message, details={"offset_mm": offset_mm.tolist()}),)


def records(parameters: ProbeParameters, bench: Bench) -> tuple[RecordUse, ...]:
    """Return the gaussmeter's, of which shares of a field need no gain and no zero."""
    # In the budget, with a part of zero: gain and zero leave the ratio of two differences alone.
    use = (GAUSSMETER, "field", parameters.field_mT, "mT")
    return (RecordUse(*use, in_budget=True, needed=False, corrected=False),)


PART = Part(
    name="probe",
    steps=(Step("P1", "Place of the probe and homogeneity, by moving the probe", places),),
    figures=FIGURES,
    needs=(GAUSSMETER, *map(supply_of, COILS)),
    has=lambda bench: axes_of_probe(bench) == len(COILS),
    units=lambda parameters: (
        record.unit for place in PLACES for record in parameters.records_at(place)
    ),
    dataset=dataset,
    analyse=analyse,
    records=records,
)
