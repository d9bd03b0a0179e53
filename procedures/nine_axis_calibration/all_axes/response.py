"""What the gyros of a mounting read of its turns, and by how much that is no straight line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from .stands import Array
from .waves import Wave

SURE = 1e-3
HALF = 0.5


@dataclass(frozen=True)
class Response:
    """The gyros' output per rate `gain` (3,) with u, and the records (r,) that it comes from.

    `rate_deg_per_s` (r,), `mean_deg_per_s` and `mean_u` (r, 3) of the three gyros.
    `nonlinearity` (3,) is the scatter of single rates' gains, over the gain, that noise does not
    explain; NaN where the records cannot show one.
    """

    gain: Array
    gain_u: Array
    rate_deg_per_s: Array
    mean_deg_per_s: Array
    mean_u: Array
    nonlinearity: Array


def response_of(waves: Sequence[Wave], rounding: Array) -> Response | None:
    """Return the gyros' response; None where the mounting was not turned in both senses.

    What grows with the magnitude of the rate, an asymmetry, is free. `rounding` (3,) is what the
    steps of the gyros' outputs leave in each mean, NaN of a gyro that never changes.
    """
    rate = np.degrees(np.array([wave.rate_rad_per_s for wave in waves]))
    if not (bool((rate > 0.0).any()) and bool((rate < 0.0).any())):
        return None
    mean = np.array([wave.value[0, :3] for wave in waves])
    noise = np.array([wave.sigma[:3] * np.sqrt(wave.inverse[0, 0]) for wave in waves])
    size = _alike(rate, np.hypot(noise, rounding))
    gain, u, bent = np.full(3, np.nan), np.full(3, np.nan), np.full(3, np.nan)
    free = len(np.unique(np.round(np.abs(rate), 1))) > 1
    columns = np.column_stack([rate, np.ones(len(rate)), *([np.abs(rate)] if free else [])])
    for gyro in range(3):
        good = np.isfinite(mean[:, gyro]) & (size[:, gyro] > 0.0)
        freedom = int(good.sum()) - columns.shape[1]
        if freedom < 0:
            continue
        design = columns[good] / size[good, gyro, None]
        inverse = np.linalg.pinv(design.T @ design)
        solved = inverse @ (design.T @ (mean[good, gyro] / size[good, gyro]))
        gain[gyro], u[gyro] = solved[0], np.sqrt(inverse[0, 0])
        if freedom:
            left = mean[good, gyro] - columns[good] @ solved
            noise = chdtrc(freedom, float(np.sum((left / size[good, gyro]) ** 2))) >= SURE
            relative = np.sum((left / (rate[good] * solved[0])) ** 2) / freedom
            bent[gyro] = 0.0 if noise else float(np.sqrt(relative))
    return Response(gain, u, rate, mean, size, bent)


def _alike(rate: Array, size: Array) -> Array:
    """Return u of means (r, 3), both senses of a rate alike.

    What a gyro's gain differs from rate to rate would not drop out between unlike weights.
    """
    pooled = size.copy()
    for magnitude in np.unique(np.round(np.abs(rate), 1)):
        own = np.round(np.abs(rate), 1) == magnitude
        pooled[own] = np.sqrt(np.mean(size[own] ** 2, axis=0))
    return pooled


def with_nonlinearity(responses: Sequence[Response | None]) -> list[Response | None]:
    """Return responses whose u hold by how much a gyro's gain differs from rate to rate.

    Mountings were turned at different rates; what the gyro along the table's axis showed at
    several of them holds for it in all mountings.
    """
    bent = np.zeros(3)
    for response in responses:
        if response is None:
            continue
        along = np.abs(response.gain) > HALF
        bent = np.fmax(bent, np.where(along, response.nonlinearity, np.nan))
    return [
        response
        if response is None
        else replace(response, gain_u=np.hypot(response.gain_u, bent * response.gain))
        for response in responses
    ]
