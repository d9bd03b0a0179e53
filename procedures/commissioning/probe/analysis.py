"""Where the probe stands in the coils, and how even their field is: a fit of their own falling off.

Each coil is a Helmholtz pair: two equal loops about its axis, one radius apart up to a small error.
Its field on its own axis, seen at several places about one, has the centre and the radius in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from station.findings import Analysis, Estimate, Flag, undetermined

from .limits import COVERAGE, MIN_SHARE, PROBE_FIELD_ERROR, SPACING_U
from .parameters import COILS, RESULTS

Array = NDArray[np.float64]
N = len(COILS)
CENTRE, SCALE, RADIUS, SPACING = (slice(N * k, N * (k + 1)) for k in range(4))
METHOD = "least squares of Helmholtz pairs"


@dataclass(frozen=True)
class ProbeDataset:
    """Fields in mT of each coil on its own axis, (places, coils), with type A uncertainties.

    `shift_mm` (places, 3) from the place of the device, each with `placing_u_mm`; `device_mm` is
    the edge of the cube that holds the device.
    """

    shift_mm: Array
    field_mT: Array
    field_u_mT: Array
    placing_u_mm: float
    commanded_mT: float
    device_mm: float


@dataclass(frozen=True)
class ProbeFit(Analysis):
    """The outcome; `radius_mm` (3,) of each pair as the fit has it."""

    radius_mm: Array


def pair_field(along: Array, across: Array, radius: Array | float, spacing: Array | float) -> Array:
    """Return a pair's axial field over that at its centre; lengths in one unit, broadcast.

    `spacing` is over the radius. Source: the field of a loop by complete elliptic integrals.
    """
    from scipy.special import ellipe, ellipk

    def loop(z: Array, rho: Array) -> Array:
        near, far = (radius - rho) ** 2 + z**2, (radius + rho) ** 2 + z**2
        m = 4.0 * radius * rho / far
        share = (radius**2 - rho**2 - z**2) / near
        return np.asarray((ellipk(m) + share * ellipe(m)) / np.sqrt(far))

    half = np.asarray(radius * spacing / 2.0)
    centre = 2.0 * loop(half, np.zeros_like(half))
    return (loop(along - half, across) + loop(along + half, across)) / centre


def shares_at(point_mm: Array, unknown: Array) -> Array:
    """Return each coil's field over that at its centre, shape (..., 3), at points (..., 3)."""
    columns = []
    for k in range(N):
        across = np.hypot(*(point_mm[..., i] for i in range(N) if i != k))
        columns.append(
            pair_field(point_mm[..., k], across, unknown[RADIUS][k], unknown[SPACING][k])
        )
    return np.stack(columns, axis=-1)


def analyse(data: ProbeDataset) -> ProbeFit:
    """Return offset, field error and homogeneity, and the cause where the probe is off centre."""
    from scipy.optimize import least_squares

    weak = np.abs(data.field_mT[0]) < MIN_SHARE * data.commanded_mT
    if weak.any():
        return undecided([axis for axis, is_weak in zip(COILS, weak, strict=True) if is_weak])

    def model(unknown: Array) -> Array:
        return unknown[SCALE] * shares_at(data.shift_mm + unknown[CENTRE], unknown)

    def fitted(sigma: Array, start: Array) -> tuple[Array, Array]:
        def residuals(unknown: Array) -> Array:
            prior = (unknown[SPACING] - 1.0) / SPACING_U
            return np.concatenate((((data.field_mT - model(unknown)) / sigma).ravel(), prior))

        best = least_squares(residuals, start, x_scale=scale, bounds=bounds)
        return best.x, np.linalg.pinv(best.jac.T @ best.jac)

    at_device, reach = data.field_mT[0], float(np.abs(data.shift_mm).max())
    begin = np.concatenate((np.zeros(N), at_device, np.full(N, 3.0 * reach), np.ones(N)))
    scale = np.concatenate(
        (np.full(N, 10.0), np.abs(at_device), np.full(N, reach), np.full(N, SPACING_U))
    )
    span = np.concatenate((np.full(N, 2.0 * reach), np.full(N, np.inf)))
    lowest = np.concatenate((-span, np.full(N, 1.5 * reach), np.full(N, 0.9)))
    highest = np.concatenate((span, np.full(N, 20.0 * reach), np.full(N, 1.1)))
    bounds = (lowest, highest)
    unknown, _ = fitted(data.field_u_mT, begin)
    slope = gradient(unknown, data.shift_mm + unknown[CENTRE]) * np.abs(unknown[SCALE])
    unknown, covariance = fitted(np.hypot(data.field_u_mT, slope * data.placing_u_mm), unknown)
    freedom = float(data.field_mT.size - begin.size + N)

    corners = np.stack(np.meshgrid(*N * [(-0.5, 0.0, 0.5)]), axis=-1).reshape(-1, N)
    corners = corners * data.device_mm

    def figures(of: Array) -> Array:
        here = shares_at(of[CENTRE], of) - 1.0
        uneven = np.abs(shares_at(corners, of) - 1.0).max(axis=0)
        return np.concatenate((of[CENTRE], here, uneven))

    values = figures(unknown)
    steps = 1e-3 * scale
    jacobian = np.column_stack(
        [
            (figures(unknown + step) - figures(unknown - step)) / (2.0 * step.sum())
            for step in np.diag(steps)
        ]
    )
    u = np.sqrt(np.diag(jacobian @ covariance @ jacobian.T))
    names = [("probe_offset", "mm"), ("probe_field_error", "1"), ("homogeneity", "1")]
    estimates = [
        Estimate(name, axis, float(values[i]), unit, float(u[i]), freedom, METHOD)
        for i, (name, unit, axis) in enumerate((*named, axis) for named in names for axis in COILS)
    ]
    flags = off_centre(values[:N], values[N : 2 * N], u[N : 2 * N])
    return ProbeFit(estimates, (), flags, unknown[RADIUS])


def undecided(weak: list[str]) -> ProbeFit:
    """Return the outcome where a coil makes too little of its field on its own axis."""
    message = (
        f"Too little field of coil {', '.join(weak)} on the probe's axis of that name: the place "
        "of the probe is not decided. Mend first what the coils' part (C) names."
    )
    estimates = [
        undetermined(name, axis, kind.unit, METHOD)
        for name, kind in RESULTS.items()
        for axis in kind.axes or ()
    ]
    flag = Flag("probe-place-undecided", message, details={"coils": weak})
    return ProbeFit(estimates, (), (flag,), np.full(N, np.nan))


def gradient(unknown: Array, point_mm: Array) -> Array:
    """Return the size of each share's gradient in 1/mm, shape (places, 3)."""
    steps = np.eye(N)
    slopes = [
        (shares_at(point_mm + step_mm, unknown) - shares_at(point_mm - step_mm, unknown)) / 2.0
        for step_mm in steps
    ]
    return np.asarray(np.sqrt(np.sum(np.square(slopes), axis=0)))


def off_centre(offset_mm: Array, error: Array, error_u: Array) -> tuple[Flag, ...]:
    """Return the flag of a probe whose place costs more of the field than the limit."""
    if not (np.abs(error) > PROBE_FIELD_ERROR + COVERAGE * error_u).any():
        return ()
    where = ", ".join(f"{axis} {mm:+.0f} mm" for axis, mm in zip(COILS, offset_mm, strict=True))
    worst = int(np.abs(error).argmax())
    message = (
        f"The probe stands off the centre of the coils ({where}): the field of coil "
        f"{COILS[worst]} differs there by {100.0 * error[worst]:+.2f} % from that at the centre. "
        "Set probe and device in the centre."
    )
    return (Flag("probe-off-centre", message, details={"offset_mm": offset_mm.tolist()}),)
