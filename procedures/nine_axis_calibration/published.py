"""The source document's own rules: mean of the east axis, equal mean over nominal rates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from procedures.nine_axis_calibration.dataset import AXES, NineAxisDataset, StaticRecord, TurnRecord
from procedures.nine_axis_calibration.findings import BIAS, SCALE_FACTOR, UNITS
from procedures.nine_axis_calibration.positions import EAST_AXIS
from station.findings import Published


def published_values(dataset: NineAxisDataset, turned: Sequence[int]) -> tuple[Published, ...]:
    """Return bias and scale factor of each axis by the published rules, on the data as they are.

    b is the mean of the axis that faces east; K = (1/N) sum (w+ - w-)/(2 w) with the nominal rates
    w, over those that were turned in both senses. None where there is nothing to take a mean of.
    """
    found = [
        *((BIAS, axis, _bias(dataset.static, axis)) for axis in range(len(AXES))),
        *((SCALE_FACTOR, axis, _scale(dataset.turns, axis)) for axis in turned),
    ]
    return tuple(Published(name, AXES[axis], one, UNITS[name], "mean") for name, axis, one in found)


def _bias(records: Sequence[StaticRecord], axis: int) -> float | None:
    samples = [
        one.rate_deg_per_h[:, axis] for one in records if EAST_AXIS.get(one.position) == axis
    ]
    return _mean(samples)


def _scale(records: Sequence[TurnRecord], axis: int) -> float | None:
    own = [one for one in records if one.axis == axis]
    found = []
    for rate in sorted({abs(one.commanded_deg_per_s) for one in own}):
        senses = [
            _mean([r.rate_deg_per_s[:, axis] for r in own if r.commanded_deg_per_s == sense * rate])
            for sense in (1.0, -1.0)
        ]
        if senses[0] is not None and senses[1] is not None:
            found.append((senses[0] - senses[1]) / (2.0 * rate))
    return float(np.mean(found)) if found else None


def _mean(samples: Sequence[np.ndarray]) -> float | None:
    together = np.concatenate(samples) if samples else np.empty(0)
    together = together[np.isfinite(together)]
    return float(together.mean()) if len(together) else None
