"""What the analysis of a nine-axis sensor says, and the settings of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from procedures.estimation.allan import AllanDeviation, NoiseCoefficients
from procedures.nine_axis_calibration.attitude import BiasSolution
from procedures.nine_axis_calibration.means import Mask
from procedures.nine_axis_calibration.pose import Pose, PoseLimits
from procedures.nine_axis_calibration.scale import ScaleSolution
from procedures.nine_axis_calibration.turning import AxisMeans
from station.findings import Estimate, Flag, Published

Array = NDArray[np.float64]

BIAS, SCALE_FACTOR, ASYMMETRY = "bias", "scale_factor", "asymmetry"
NONLINEARITY, MISALIGNMENT = "nonlinearity", "misalignment"
FRAME = "mounting"
"""What misalignments are angles to: the table's axes, as the sensor was mounted between them."""
UNITS = {
    BIAS: "deg/h",
    SCALE_FACTOR: "1",
    ASYMMETRY: "ppm",
    NONLINEARITY: "ppm",
    MISALIGNMENT: "arcsec",
}


@dataclass(frozen=True)
class AnalysisSettings:
    """Thresholds of the flags and choices of the estimator, each with its default.

    `not_significant` is in standard uncertainties, `outlier` in robust standard deviations, `gap`
    in nominal intervals.
    """

    not_significant: float = 2.0
    gap: float = 1.5
    outlier: float = 5.0
    pose: PoseLimits = field(default_factory=PoseLimits)


@dataclass(frozen=True)
class StaticSummary:
    """One static record: means in deg/h and g with their u, (3,) each, and how it was judged.

    `kept` (n, 3) are the gyro samples in the means; `allan` and `noise` are those of each gyro.
    """

    position: int
    gyro: Array
    gyro_u: Array
    accelerometer: Array
    accelerometer_u: Array
    pose: Pose
    kept: Mask
    allan: tuple[AllanDeviation, ...]


@dataclass(frozen=True)
class NineAxisAnalysis:
    """The whole outcome.

    Sensitivities of the estimates are derivatives by the inputs of type B, the priors among them.
    `axes` are the solutions of the turned axes by number, None where a turned axis could not be
    solved; `gain` (3, 3) is the output of gyro j per rate about axis i in [j, i] with its u, NaN
    where unknown. `noise` is what the static records of each gyro show.
    """

    estimates: tuple[Estimate, ...]
    published: tuple[Published, ...]
    flags: tuple[Flag, ...]
    static: tuple[StaticSummary, ...]
    bias: BiasSolution | None
    axes: Mapping[int, ScaleSolution | None]
    means: Mapping[int, AxisMeans]
    gain: Array
    gain_u: Array
    noise: tuple[NoiseCoefficients | None, ...]

    def estimate(self, name: str, axis: str) -> Estimate:
        """Return one estimate; KeyError where the dataset does not concern it."""
        for one in self.estimates:
            if (one.name, one.axis) == (name, axis):
                return one
        raise KeyError((name, axis))
