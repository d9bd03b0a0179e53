"""What the reader must know about a dataset and its analysis, one flag a sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from procedures.estimation.flags import Gaps, counted, frozen, gaps_of, not_identifiable
from station.findings import Estimate, Flag, Published

from .attitude import BiasSolution
from .dataset import AXES, Array, NineAxisDataset, Saturated
from .findings import ASYMMETRY, BIAS, MISALIGNMENT, NONLINEARITY, StaticSummary
from .means import interval_of
from .pose import PUBLISHED
from .scale import ScaleSolution
from .settings import AnalysisSettings
from .turning import AxisMeans

FEWEST_RATES = 5
RATE_DIFFERS = 0.01


def data_flags(
    dataset: NineAxisDataset,
    static: Sequence[StaticSummary],
    means: Mapping[int, AxisMeans],
    saturated: Sequence[Saturated],
    at_rest: int,
    settings: AnalysisSettings,
) -> list[Flag]:
    """Return the flags on the samples: wild and saturated ones, gaps, part turns, true rates."""
    flags: list[Flag] = []
    for axis in sorted({record.axis for record in saturated}):
        own = [record for record in saturated if record.axis == axis]
        count = sum(record.count for record in own)
        rates = sorted(
            {record.commanded_deg_per_s for record in own}, key=lambda rate: (abs(rate), -rate)
        )
        what = "the records" if any(record.whole for record in own) else "they"
        overload_text = (
            f"Saturated: {counted(count, 'sample')} of gyro {AXES[axis]} at "
            f"{listed_numbers(rates)} deg/s; {what} are left out."
        )
        flags.append(Flag("overload", overload_text, AXES[axis], {"count": count, "rates": rates}))
    if at_rest:
        at_rest_text = f"Saturated: {counted(at_rest, 'sample')} at rest; they are left out."
        flags.append(Flag("overload", at_rest_text, None, {"count": at_rest}))
    flags += _outliers(dataset, static, means)
    flags += _gaps(dataset, settings)
    for axis, turned in means.items():
        rates = sorted({abs(float(rate)) for rate in turned.commanded[turned.part]})
        if rates:
            part_text = (
                f"{AXES[axis]} did not turn whole turns at {listed_numbers(rates)} deg/s; the part "
                "of the earth's rotation that this leaves in the means is solved for and taken off."
            )
            details = {"count": len(rates), "rates": rates}
            flags.append(Flag("part-turns", part_text, AXES[axis], details))
        flags += _rates(axis, turned)
        flags += _encoder(axis, turned)
    return flags


def _encoder(axis: int, turned: AxisMeans) -> list[Flag]:
    """Return the flags on readings of the angle, and on a table that was not at its rate."""
    flags = []
    if turned.wild_readings:
        wild_text = (
            f"Left out, for they do not fit the turn: {turned.wild_readings} readings of the "
            f"table's angle with {AXES[axis]} up."
        )
        details: dict[str, object] = {"count": turned.wild_readings, "what": "encoder"}
        flags.append(Flag("outliers-rejected", wild_text, AXES[axis], details))
    rates = sorted(
        {
            float(rate)
            for rate, count in zip(turned.commanded, turned.unsteady, strict=True)
            if count
        },
        key=lambda rate: (abs(rate), -rate),
    )
    if rates:
        count = sum(turned.unsteady)
        unsteady_text = (
            "Left out, for by its encoder the table was not at its rate: "
            f"{counted(count, 'sample')} of {AXES[axis]} at {listed_numbers(rates)} deg/s. "
            "Spin-up and braking belong into no record."
        )
        details = {"count": count, "rates": rates}
        flags.append(Flag("unsteady-rate", unsteady_text, AXES[axis], details))
    return flags


def frozen_flags(at_rest: int, turning: int) -> list[Flag]:
    """Return the flag on samples that only repeat one before."""
    if not at_rest + turning:
        return []
    extent = f"{counted(at_rest, 'sample')} at rest and {turning} turning"
    details = {"count": at_rest + turning, "at_rest": at_rest, "turning": turning}
    return [frozen("The output", extent, "the sensor", "They are left out.", details)]


def _outliers(
    dataset: NineAxisDataset, static: Sequence[StaticSummary], means: Mapping[int, AxisMeans]
) -> list[Flag]:
    flags = []
    for axis, name in enumerate(AXES):
        finite = [np.isfinite(record.rate_deg_per_h[:, axis]) for record in dataset.static]
        at_rest = sum(
            int(np.sum(there & ~summary.kept[:, axis]))
            for there, summary in zip(finite, static, strict=True)
        )
        turning = 0
        if axis in means:
            own = [turn for turn in dataset.turns if turn.axis == axis]
            turning = sum(
                int(np.sum(np.isfinite(record.rate_deg_per_s[:, axis]) & ~kept)) - unsteady
                for record, kept, unsteady in zip(
                    own, means[axis].kept, means[axis].unsteady, strict=True
                )
                if bool(kept.any())
            )
        if at_rest + turning:
            outliers_text = (
                f"Left out, for they lie far from the others: {counted(at_rest, 'sample')} of gyro "
                f"{name} at rest and {turning} of it turning."
            )
            details = {"count": at_rest + turning, "at_rest": at_rest, "turning": turning}
            flags.append(Flag("outliers-rejected", outliers_text, name, details))
    return flags


def _gaps(dataset: NineAxisDataset, settings: AnalysisSettings) -> list[Flag]:
    gaps = Gaps()
    for records in (dataset.static, dataset.turns):
        times = [record.time_s for record in records]
        nominal_s = interval_of(times)
        gaps = sum((gaps_of(time_s, nominal_s, settings.gap) for time_s in times), gaps)
    if not gaps.count:
        return []
    gap_text = (
        f"The records have {counted(gaps.count, 'gap')}, the longest {gaps.longest_s:g} s, with "
        f"{gaps.missing} samples missing; the means do not mind."
    )
    return [Flag("gap", gap_text, None, gaps.details)]


def _rates(axis: int, means: AxisMeans) -> list[Flag]:
    """Return the flag of rates that the table did not turn at, and of too few of them."""
    flags = []
    rates = sorted({abs(float(rate)) for rate in means.commanded})
    if len(rates) < FEWEST_RATES:
        few_rates_text = (
            f"{AXES[axis]} was turned at {len(rates)} rates; the method is published for five and "
            "more."
        )
        flags.append(
            Flag("outside-published-range", few_rates_text, AXES[axis], {"count": len(rates)})
        )
    off = means.rate / means.commanded - 1.0
    off = np.where(np.isfinite(off), off, 0.0)
    worst = int(np.argmax(np.abs(off)))
    if abs(off[worst]) > RATE_DIFFERS:
        rate_text = (
            f"At {means.commanded[worst]:g} deg/s the encoder of {AXES[axis]} says "
            f"{means.rate[worst]:.5g} deg/s; the result uses the encoder."
        )
        details = {"relative_difference": float(off[worst])}
        flags.append(Flag("rate-differs-from-commanded", rate_text, AXES[axis], details))
    return flags


def result_flags(
    estimates: Sequence[Estimate],
    static: Sequence[StaticSummary],
    bias: BiasSolution | None,
    wander: Array,
    wider: float,
    axes: Mapping[int, ScaleSolution | None],
    published: Sequence[Published],
    settings: AnalysisSettings,
) -> list[Flag]:
    """Return the flags on the results: wrong positions, what is noise, what is not determined."""
    flags = _positions(static)
    if bias is not None and not bias.heading_used and len({s.position for s in static}) > 1:
        heading_text = (
            f"By the gyros the plate's heading is {_arcmin(bias.heading_rad):.1f} arcmin off, "
            "beyond its prior; the biases are solved without that prior."
        )
        details = {"heading_arcmin": _arcmin(bias.heading_rad)}
        flags.append(Flag("heading-differs-from-prior", heading_text, None, details))
    if wider > 1.0:
        disagree_text = (
            "The static means contradict each other beyond their uncertainties, which are "
            f"multiplied by {wider:.2g}: a bias changed between the positions, or the sensor stood "
            "less well than the priors say."
        )
        flags.append(Flag("positions-disagree", disagree_text, None, {"factor": wider}))
    for axis, name in enumerate(AXES):
        if wander[axis] > 0.0:
            wander_text = (
                f"The bias of gyro {name} wanders by {wander[axis]:.2g} deg/h at rest; that is in "
                "its uncertainty. Longer records do not help."
            )
            details = {"wander_deg_per_h": float(wander[axis])}
            flags.append(Flag("bias-wanders", wander_text, name, details))
    flags += _noise(estimates, axes, settings)
    for axis, solution in axes.items():
        if solution is not None and solution.one_sense:
            rates = list(solution.one_sense)
            one_sense_text = (
                f"{AXES[axis]} has no usable record at {listed_numbers(rates)} deg/s in one sense "
                "or in both; these rates are left out."
            )
            which = {"count": len(rates), "rates": rates}
            flags.append(Flag("one-sense-only", one_sense_text, AXES[axis], which))
    return flags + _undetermined(estimates, published)


def _positions(static: Sequence[StaticSummary]) -> list[Flag]:
    flags = []
    for summary in static:
        if summary.pose.right:
            continue
        wrong_text = (
            f"The sensor did not stand as in position {summary.position}: {summary.pose.why}"
        )
        if summary.pose.stands_as is not None:
            wrong_text += f", as in position {summary.pose.stands_as}"
        wrong_text += (
            "; the record is left out of the best estimate. Look at how it stood, and at the "
            "columns of gyros and accelerometers: their order, signs and units."
        )
        details = {"position": int(summary.position)}
        flags.append(Flag("wrong-position", wrong_text, None, details))
    there = {summary.position for summary in static}
    for position in PUBLISHED:
        if static and position not in there:
            missing_text = (
                f"Position {position} was not recorded: the published mean of the axis that faces "
                "east there is missing, the best estimate takes the other positions."
            )
            details = {"position": position}
            flags.append(Flag("position-missing", missing_text, None, details))
    return flags


def _noise(
    estimates: Sequence[Estimate],
    axes: Mapping[int, ScaleSolution | None],
    settings: AnalysisSettings,
) -> list[Flag]:
    flags = []
    for estimate in estimates:
        if estimate.name not in {ASYMMETRY, NONLINEARITY} or estimate.value is None:
            continue
        u = estimate.standard_uncertainty or 0.0
        small = abs(estimate.value) < settings.not_significant * u
        solution = axes[AXES.index(estimate.axis or "")]
        agree = estimate.name == NONLINEARITY and solution is not None and solution.agree
        if small or agree:
            noise_text = (
                f"The {estimate.name} of {estimate.axis}, {estimate.value:.3g} ppm with u = "
                f"{u:.2g} ppm, cannot be distinguished from noise."
            )
            details = {"name": estimate.name}
            flags.append(Flag("not-significant", noise_text, estimate.axis, details))
    return flags


def _undetermined(estimates: Sequence[Estimate], published: Sequence[Published]) -> list[Flag]:
    flags = []
    cross = [
        str(estimate.axis)
        for estimate in estimates
        if estimate.name == MISALIGNMENT and estimate.value is None
    ]
    if cross:
        cross_text = (
            f"The misalignments {', '.join(cross)} are not determined: the other gyros were not "
            "recorded there, or their output never changed."
        )
        names = [f"{MISALIGNMENT} {axis}" for axis in cross]
        flags.append(not_identifiable(cross_text, names, count=len(names)))
    other = [
        estimate
        for estimate in estimates
        if estimate.name != MISALIGNMENT and estimate.value is None
    ]
    if other:
        names = [f"{estimate.name} {estimate.axis}" for estimate in other]
        undetermined_text = f"The data do not determine {', '.join(names)}."
        if any(estimate.name == BIAS for estimate in other):
            undetermined_text += " No static record was usable."
        flags.append(not_identifiable(undetermined_text, names, count=len(names)))
    silent = [f"{entry.name} {entry.axis}" for entry in published if entry.value is None]
    if silent:
        silent_text = f"The published rule has no data for {', '.join(silent)}."
        which = {"count": len(silent), "coefficients": silent}
        flags.append(Flag("published-rule-without-data", silent_text, None, which))
    return flags


def listed_numbers(values: Sequence[float]) -> str:
    """Return numbers in words: 1, 5 and 10."""
    texts = [f"{value:g}" for value in values]
    return " and ".join([", ".join(texts[:-1]), texts[-1]]) if len(texts) > 1 else texts[0]


def _arcmin(angle_rad: float) -> float:
    return float(np.degrees(angle_rad) * 60.0)
