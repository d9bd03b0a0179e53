"""What the reader must know about records at rest, one flag a sentence."""

from __future__ import annotations

from procedures.estimation.channel import flags
from procedures.estimation.flags import counted, not_identifiable
from station.findings import Flag

from .axis import AxisAnalysis
from .dataset import COEFFICIENTS, AnalysisSettings, StaticDataset
from .parameters import UNITS


def data_flags(dataset: StaticDataset, analysed: AxisAnalysis) -> list[Flag]:
    """Return the flags on samples: what was left out, and an output of few steps."""
    raised = flags(analysed.screened, analysed.axis, "sample")
    if analysed.fit is not None and analysed.fit.sawtooth and dataset.pulse_arcsec:
        sentence = (
            f"{analysed.axis} walks by less than half a pulse from sample to sample: its roundings "
            "follow one another, and u of the quantisation noise is twice as large."
        )
        raised.append(Flag("coarse-output", sentence, analysed.axis))
    return raised + _bursts(analysed)


def _bursts(analysed: AxisAnalysis) -> list[Flag]:
    """Return the flags of blocks that the noise does not give, and that are left out."""
    raised = []
    for block in analysed.disturbed:
        how = f"lies {block.burst.shift:.3g} deg/h beside the rest"
        if block.burst.scatter:
            how = f"scatters {block.burst.scatter:.2g} times as much as the rest"
        sentence = (
            f"From {block.begin_s:.5g} s to {block.end_s:.5g} s of switch-on {block.switch_on} "
            f"{analysed.axis} {how}, which its noise does not do: {counted(block.count, 'sample')} "
            "left out. Look for a shock, a step or somebody at the plate."
        )
        details = {"count": block.count, "begin_s": block.begin_s, "end_s": block.end_s}
        raised.append(Flag("misfit", sentence, analysed.axis, {"what": "burst", **details}))
    return raised


def noise_flags(analysed: AxisAnalysis, settings: AnalysisSettings) -> list[Flag]:
    """Return the flags on the noise of an axis."""
    fit = analysed.fit
    if fit is None:
        seen = ("bias",) if len(analysed.means) > 1 else ()
        lost = [name for name in UNITS if name not in seen]
        sentence = f"No record of {analysed.axis} is long enough to show its noise; record longer."
        return [not_identifiable(sentence, lost, analysed.axis)]
    raised = []
    if len(analysed.means) == 1:
        sentence = f"{analysed.axis} has one switch-on with samples, which shows no repeatability."
        raised.append(not_identifiable(sentence, ["bias_repeatability"], analysed.axis))
    small = []
    for n, name in enumerate(COEFFICIENTS):
        if n == 0 and not fit.quantisation_seen:
            sentence = (
                f"The output of {analysed.axis} is filtered: up to a quarter of its bandwidth "
                "quantisation noise does not show."
            )
            raised.append(not_identifiable(sentence, [name], analysed.axis))
        elif fit.theta[n] < settings.not_significant * fit.u[n]:
            small.append(name)
    if small:
        sentence = (
            f"Of {analysed.axis} the squares of {', '.join(small)} are less than "
            f"{settings.not_significant:g} of their standard uncertainties: the upper limits say "
            "what the record shows."
        )
        raised.append(Flag("not-significant", sentence, analysed.axis, {"coefficients": small}))
    if abs(fit.ramp) > settings.drift_removed * fit.ramp_u:
        sentence = (
            f"{analysed.axis} drifts by {fit.ramp:.3g} deg/h^2, u = {fit.ramp_u:.2g}; the drift is "
            "fitted with the noise and is not in its coefficients."
        )
        raised.append(Flag("drift-removed", sentence, analysed.axis, {"ramp_deg_per_h2": fit.ramp}))
    for line in fit.lines:
        sentence = (
            f"{analysed.axis} swings by {line.amplitude_deg_per_h:.3g} deg/h with a period of "
            f"{1.0 / line.frequency_Hz:.4g} s; the line is fitted with the noise. Look for what "
            "has this period: air conditioning, dither, a neighbour."
        )
        details = {
            "period_s": 1.0 / line.frequency_Hz,
            "amplitude_deg_per_h": line.amplitude_deg_per_h,
        }
        raised.append(Flag("periodic", sentence, analysed.axis, details))
    if analysed.minimum is not None and analysed.minimum.at_end:
        sentence = (
            f"The Allan deviation of {analysed.axis} still falls at {analysed.minimum.tau_s:.4g} "
            "s, a ninth of the longest record: its minimum lies beyond. Record longer."
        )
        raised.append(
            Flag("short-record", sentence, analysed.axis, {"tau_s": analysed.minimum.tau_s})
        )
    return raised
