"""What repeats under other conditions say of a result: half the field, another frequency, none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import erfc

from station.findings import Flag

from .dataset import Segment
from .findings import AnalysisSettings, RlgAnalysis
from .gyro import fit_gyro


@dataclass(frozen=True)
class Tested:
    """One axis under another condition, in deg/h/mT.

    `value` is the sensitivity there, or for the background the line's magnitude over M;
    `difference` is that to the result, for the background the value itself; `bound` is what chance
    may make of it.
    """

    check: str
    axis: str | None
    frequency_Hz: float
    amplitude_mT: float
    value: float
    uncertainty: float
    difference: float
    difference_uncertainty: float
    bound: float

    @property
    def differs(self) -> bool:
        """Whether the difference is more than chance makes it."""
        return abs(self.difference) > self.bound

    def to_data(self) -> dict[str, object]:
        """Return it as it stands in the results."""
        return {
            "check": self.check,
            "frequency_Hz": self.frequency_Hz,
            "amplitude_mT": self.amplitude_mT,
            "value": self.value,
            "standard_uncertainty": self.uncertainty,
            "difference": self.difference,
            "difference_standard_uncertainty": self.difference_uncertainty,
            "differs": self.differs,
        }


def repeated(
    check: str, result: RlgAnalysis, again: RlgAnalysis, segments: Sequence[Segment], reach: float
) -> Iterator[Tested]:
    """Yield each axis that was measured again; `reach` is in standard uncertainties."""
    before = {one.axis: one for one in result.estimates}
    for one in again.estimates:
        first = before.get(one.axis)
        if first is None or first.value is None or first.standard_uncertainty is None:
            continue
        if one.value is None or one.standard_uncertainty is None:
            continue
        drive = next(d for s in segments for axis, d in s.drive.items() if axis == one.axis)
        u = float(np.hypot(one.standard_uncertainty, first.standard_uncertainty))
        yield Tested(
            check,
            one.axis,
            drive.frequency_Hz,
            drive.amplitude_mT,
            one.value,
            one.standard_uncertainty,
            one.value - first.value,
            u,
            reach * u,
        )


def background(
    segment: Segment, amplitude_mT: float, settings: AnalysisSettings
) -> Iterator[Tested]:
    """Yield the gyro's line at each frequency of a record without field, over the field's M.

    Its phase means nothing, so the magnitude is held against what noise alone exceeds as rarely as
    it exceeds `checks_differ` standard uncertainties.
    """
    driven = {axis: drive.frequency_Hz for axis, drive in segment.drive.items()}
    fit = fit_gyro(segment, list(driven.values()), settings)
    if fit is None:
        return
    chance = float(erfc(settings.checks_differ / np.sqrt(2.0)))
    reach = float(np.sqrt(-2.0 * np.log(chance)))
    for k, (axis, frequency_Hz) in enumerate(driven.items()):
        part = np.diag(fit.covariance)[2 * k : 2 * k + 2]
        u = float(np.sqrt(part.mean())) / amplitude_mT
        size = float(abs(fit.phasor_deg_per_h[k])) / amplitude_mT
        named = axis if len(driven) > 1 else None
        yield Tested("background", named, frequency_Hz, 0.0, size, u, size, u, reach * u)


def flags_of(tested: Sequence[Tested]) -> Iterator[Flag]:
    """Yield a flag for each difference that chance does not explain."""
    for one in tested:
        if not one.differs:
            continue
        whose = "" if one.axis is None else f" of {one.axis}"
        off = (
            f"{one.difference:+.2g} deg/h/mT ({one.difference / one.difference_uncertainty:+.1f} u)"
        )
        details = {
            "difference": one.difference,
            "standard_uncertainty": one.difference_uncertainty,
        }
        if one.check == "linearity":
            yield Flag(
                "not-linear",
                f"At {one.amplitude_mT:g} mT the magnetic sensitivity{whose} is another one by "
                f"{off}: the response is not in proportion to the field, as that of a shield near "
                "saturation; state the sensitivity with its field.",
                one.axis,
                details,
            )
        elif one.check == "frequency":
            yield Flag(
                "differs-with-frequency",
                f"At {one.frequency_Hz:.4g} Hz the magnetic sensitivity{whose} is another one by "
                f"{off}: a delay, eddy currents and pickup grow with the frequency; the lower one "
                "is nearer to a steady field.",
                one.axis,
                details,
            )
        else:
            yield Flag(
                "background-line",
                f"With the coils off the output has a line at {one.frequency_Hz:.4g} Hz that would "
                f"pass for {one.value:.2g} deg/h/mT{whose}: something else acts at the field's "
                "frequency; choose another frequency.",
                one.axis,
                details,
            )
