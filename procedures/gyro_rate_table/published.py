"""The textbook: means less those at rest, a line on the commanded rates, plain spreads.

Rate of the table as commanded, output less the mean at rest of the same switch-on, a line by least
squares (practice after IEEE Std 952; no clause is quoted).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from procedures.common.constants import SECONDS_PER_HOUR
from station.findings import Published

from .dataset import PPM, Array
from .parameters import UNITS
from .screening import Kept

METHOD = "least-squares"


def published_values(records: Sequence[Kept], earth_deg_per_h: float) -> list[Published]:
    """Return what the rules give on the same data, None where they cannot run."""
    values: dict[str, float | None] = dict.fromkeys(UNITS)
    del values["nonlinearity"]
    repeats = list(dict.fromkeys(kept.record.repeat for kept in records))
    lines, rests = [], []
    for repeat in repeats:
        own = [kept for kept in records if kept.record.repeat == repeat]
        rest = [kept.mean for kept in own if not kept.record.commanded_deg_per_s]
        turned = [kept for kept in own if kept.record.commanded_deg_per_s]
        if not rest or len(turned) < 2:
            continue
        rests.append(float(np.mean(rest)))
        rate = np.array([kept.record.commanded_deg_per_s for kept in turned]) * SECONDS_PER_HOUR
        lines.append(_line(rate, np.array([kept.mean for kept in turned]) - rests[-1]))
    if lines:
        scale = float(np.mean([line[0] for line in lines]))
        values["scale_factor"] = scale
        values["nonlinearity_of_full_scale"] = float(np.mean([line[1] for line in lines]))
        values["asymmetry"] = float(np.mean([line[2] for line in lines]))
        values["bias"] = float(np.mean(rests)) - earth_deg_per_h
    if len(lines) > 1:
        spread = float(np.std([line[0] for line in lines], ddof=1))
        values["scale_factor_repeatability"] = PPM * spread / abs(scale)
    methods = {"bias": "mean", "scale_factor_repeatability": "standard-deviation"}
    return [
        Published(name, "IA", value, UNITS[name], methods.get(name, METHOD))
        for name, value in values.items()
    ]


def _line(rate: Array, output: Array) -> tuple[float, float, float]:
    """Return slope, largest residual over the largest output and |K+ - K-|/K, these in ppm."""
    design = np.column_stack((rate, np.ones(len(rate))))
    (slope, offset), *_ = np.linalg.lstsq(design, output, rcond=None)
    left = output - slope * rate - offset
    largest = float(np.max(np.abs(left)) / np.max(np.abs(output))) * PPM
    up, down = (
        float(rate[sense] @ output[sense]) / max(float(rate[sense] @ rate[sense]), 1e-300)
        for sense in (rate > 0.0, rate < 0.0)
    )
    return float(slope), largest, abs(up - down) / abs(float(slope)) * PPM
