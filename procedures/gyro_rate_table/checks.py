"""What the reader must know about a gyro on a rate table, one flag a sentence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri

from procedures.common.frozen import frozen_flag
from procedures.estimation.flags import Gaps, counted, gaps_of, not_identifiable
from procedures.estimation.plausibility import Bounds, implausible
from station.findings import Estimate, Flag, contradiction

from .dataset import PPM, AnalysisSettings, RateTableDataset
from .screening import Kept, Screened
from .solution import JointFit, Results

FEWEST_RATES = 7
SCALE = Bounds(
    "gyro_output",
    "The gyro's output over the encoder's rate",
    0.95,
    1.05,
    "deg/deg",
    "Look whether its input axis points up, and at the unit of its output.",
)
BY_CHANCE = 1e-3


def data_flags(
    dataset: RateTableDataset, screened: Screened, settings: AnalysisSettings
) -> list[Flag]:
    """Return the flags on samples and turns."""
    flags = _left_out(screened, settings, dataset.axis)
    gaps = sum(
        (
            gaps_of(record.time_s, dataset.sample_interval_s, settings.gap)
            for record in dataset.records
        ),
        Gaps(),
    )
    then = "the angle is taken over the samples that are there"
    flags += gaps.flags("The records have", dataset.sample_interval_s, then, "IA")
    flags += _turns(screened.kept, settings)
    if screened.shift is not None:
        sentence = (
            f"Where the table changes its rate the gyro follows {screened.shift:.2g} samples after "
            "the stamps: look at `timestamp`. Samples from while the table was not at its rate are "
            "left out."
        )
        flags.append(contradiction("timestamp", sentence, "IA", samples=screened.shift))
    return flags + implausible(screened.scale, SCALE, "IA")


def _left_out(screened: Screened, settings: AnalysisSettings, axis: str) -> list[Flag]:
    flags = []
    if screened.saturated:
        rates = _rates([record.commanded_deg_per_s for record in screened.saturated])
        sentence = (
            f"Saturated: the output stands at its largest value at {_listed(rates)} deg/s; "
            f"{counted(len(screened.saturated), 'record')} left out."
        )
        flags.append(Flag("overload", sentence, "IA", {"rates": rates}))
    if screened.wild:
        sentence = (
            f"{counted(screened.wild, 'sample')} of {axis} lie more than {settings.outlier:g} "
            "standard deviations from the table's rate and are left out."
        )
        flags.append(Flag("outliers-rejected", sentence, "IA", {"count": screened.wild}))
    wild = sum(kept.record.wild_readings for kept in screened.kept)
    if wild:
        sentence = (
            f"Left out, for they do not fit the turn: {counted(wild, 'reading')} of the encoder."
        )
        flags.append(Flag("outliers-rejected", sentence, "IA", {"count": wild, "what": "encoder"}))
    if screened.frozen:
        flags.append(
            frozen_flag(
                "The output",
                counted(screened.frozen, "sample"),
                "the gyro",
                "They are left out.",
                {"count": screened.frozen},
                "IA",
            )
        )
    return flags


def _turns(records: Sequence[Kept], settings: AnalysisSettings) -> list[Flag]:
    flags = []
    turning = [kept for kept in records if kept.record.commanded_deg_per_s]
    part = [
        kept.record.commanded_deg_per_s
        for kept in turning
        if abs(kept.turns - round(kept.turns)) > settings.part_turns * kept.turns
    ]
    if part:
        rates = _rates(part)
        sentence = (
            f"The table did not turn whole turns at {_listed(rates)} deg/s; what the earth's rate "
            "leaves there is solved for and taken off, an error of the encoder is not."
        )
        flags.append(Flag("part-turns", sentence, "IA", {"rates": rates}))
    unsteady = [kept for kept in turning if bool(kept.record.unsteady.any())]
    if unsteady:
        rates = _rates([kept.record.commanded_deg_per_s for kept in unsteady])
        count = sum(int(kept.record.unsteady.sum()) for kept in unsteady)
        sentence = (
            f"By its encoder the table was not at its rate in {counted(count, 'sample')} at "
            f"{_listed(rates)} deg/s. Spin-up and settling belong into no record."
        )
        flags.append(Flag("unsteady-rate", sentence, "IA", {"count": count, "rates": rates}))
    off = [kept.table / 3600.0 / kept.record.commanded_deg_per_s - 1.0 for kept in turning]
    if off and max(map(abs, off)) > settings.rate_differs:
        worst = int(np.argmax(np.abs(off)))
        sentence = (
            f"At {turning[worst].record.commanded_deg_per_s:g} deg/s the encoder shows "
            f"{turning[worst].table / 3600.0:.5g} deg/s; the result uses the encoder, the "
            "published values do not."
        )
        flags.append(
            Flag("rate-differs-from-commanded", sentence, "IA", {"relative_difference": off[worst]})
        )
    senses = {kept.record.commanded_deg_per_s for kept in turning}
    single = _rates([rate for rate in senses if -rate not in senses])
    if single:
        sentence = f"At {_listed(single)} deg/s there is a usable record in one sense only."
        flags.append(Flag("one-sense-only", sentence, "IA", {"rates": single}))
    count = len({abs(rate) for rate in senses})
    if 0 < count < FEWEST_RATES:
        sentence = f"The gyro was turned at {counted(count, 'rate')}; seven and more are usual."
        flags.append(Flag("outside-published-range", sentence, "IA", {"count": count}))
    return flags


def result_flags(
    screened: Screened,
    fit: JointFit | None,
    results: Results | None,
    estimates: Sequence[Estimate],
    settings: AnalysisSettings,
) -> list[Flag]:
    """Return the flags on the results: what is noise, what is not determined, what does not fit."""
    flags = []
    small = [
        estimate.name
        for estimate in estimates
        if estimate.value is not None
        and estimate.standard_uncertainty is not None
        and estimate.name in ("nonlinearity", "nonlinearity_of_full_scale", "asymmetry")
        and abs(estimate.value) < _bound(estimate.name, settings) * estimate.standard_uncertainty
    ]
    if results is not None and results.agree and results.nonlinearity is not None:
        small += [n for n in ("nonlinearity",) if n not in small]
    if small:
        sentence = f"{_words(small)} cannot be distinguished from noise."
        flags.append(Flag("not-significant", sentence, "IA", {"coefficients": small}))
    lost = [estimate.name for estimate in estimates if estimate.value is None]
    if lost:
        sentence = f"The records do not determine {', '.join(lost)}."
        if lost == ["scale_factor_repeatability"]:
            sentence = "One switch-on shows no repeatability of the scale factor."
        flags.append(not_identifiable(sentence, lost, "IA"))
    if fit is None:
        return flags
    ramps = fit.ramps()
    for number, ramp in zip(fit.layout.repeats, ramps, strict=True):
        if not fit.determined(ramp):
            continue
        value, u = float(ramp @ fit.value), float(np.sqrt(ramp @ fit.covariance @ ramp))
        if abs(value) > settings.drift_removed * u:
            sentence = f"In switch-on {number} the bias drifts by {value:.3g} deg/h^2, u = {u:.2g}."
            details = {"ramp_deg_per_h2": value, "repeat": number}
            flags.append(Flag("drift-removed", sentence, "IA", details))
    if fit.walk_gain > float(chdtri(1, BY_CHANCE)):
        wander = float(np.sqrt(fit.walk))
        sentence = (
            f"The bias wanders by {wander:.2g} deg/h in an hour; that is in the uncertainties. A "
            f"single disturbed record shows so, too; the furthest off is one "
            f"{_worst(screened.kept, fit)}."
        )
        flags.append(Flag("bias-wanders", sentence, "IA", {"wander_deg_per_h": wander}))
    if fit.freedom > 0 and fit.chi_square > float(chdtri(fit.freedom, BY_CHANCE)):
        sentence = (
            "The records contradict one another beyond their noise and the walk of the bias: chi-"
            f"square is {fit.chi_square:.3g} with {fit.freedom} degrees of freedom. The worst is "
            f"{_worst(screened.kept, fit)}."
        )
        flags.append(Flag("misfit", sentence, "IA", {"chi_square": fit.chi_square}))
    if fit.drifting:
        flags.append(_drifts(fit))
    return flags


def _drifts(fit: JointFit) -> Flag:
    """Return the flag of a scale factor that drifts, with its mean drift per hour."""
    mean = fit.drifts().mean(axis=0)
    drift, u = float(mean @ fit.value) * PPM, float(np.sqrt(mean @ fit.covariance @ mean)) * PPM
    sentence = (
        f"The scale factor drifts by {drift:.3g} ppm an hour, u = {u:.2g} ppm: the output "
        "runs off as the rate does, within the records or from one to the next. It holds for the "
        "mean time, and its u has in it how far it strayed. Let the gyro warm up for longer."
    )
    return Flag("drift-removed", sentence, "IA", {"drift_ppm_per_h": drift})


def _worst(records: Sequence[Kept], fit: JointFit) -> str:
    number = int(np.argmax(np.abs(fit.residual) / fit.residual_u))
    record = records[number].record
    return f"at {abs(record.commanded_deg_per_s):g} deg/s in switch-on {record.repeat}"


def _bound(name: str, settings: AnalysisSettings) -> float:
    if name == "asymmetry":
        return settings.not_significant
    return settings.nonlinearity_not_significant


def _rates(rates: Sequence[float]) -> list[float]:
    return sorted(set(rates), key=lambda rate: (abs(rate), -rate))


def _listed(rates: Sequence[float]) -> str:
    return ", ".join(f"{rate:g}" for rate in rates)


def _words(names: Sequence[str]) -> str:
    text = ", ".join(names).replace("_", " ")
    return text[0].upper() + text[1:]
