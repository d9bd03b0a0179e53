"""What noise and each prior of the set-up add to the uncertainties of the other six axes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from procedures.estimation.shares import Shares
from procedures.nine_axis_calibration.dataset import AXES
from station.findings import Estimate, InputQuantity, Key

from .inertial import K2, TURN, B, Inertial, K, M, N
from .magnetic import Magnetic
from .results import ARCSEC_PER_RAD, EDGES, METHOD, NAMES, OtherResults, slopes_of
from .sources import DIRECTIONS, EDGE, FIELD, INCLINATION, NOISE, SECOND_ORDER
from .stands import OtherAxes

ROWS = (
    ("accelerometer_bias", AXES, B, 1.0),
    ("accelerometer_scale_factor", AXES, K, 1.0),
    ("accelerometer_nonorthogonality", EDGES, N, 2.0 * ARCSEC_PER_RAD),
    ("accelerometer_second_order", AXES, K2, 1e6),
    ("boresight", AXES, TURN, ARCSEC_PER_RAD),
    ("misalignment", NAMES, slice(M, M + len(NAMES)), ARCSEC_PER_RAD),
)
"""Results of the fit of the accelerometers: their axes, their unknowns, their unit."""


def with_rows(estimates: list[Estimate], results: OtherResults) -> list[Estimate]:
    """Return estimates whose type A uncertainty is that of noise alone, each prior an input."""
    shares: dict[Key, Mapping[str, float]] = {}
    if results.inertial is not None:
        shares |= dict(_of_inertial(results.inertial))
    if results.magnetic is not None:
        shares |= dict(_of_magnetic(results.magnetic))
    return [_split(estimate, shares) for estimate in estimates]


def _split(estimate: Estimate, shares: Mapping[Key, Mapping[str, float]]) -> Estimate:
    """Return an estimate of these fits with its own shares; one of another fit as it is."""
    own = shares.get((estimate.name, estimate.axis), {})
    u = estimate.standard_uncertainty
    whole = math.hypot(*own.values())
    if not u or not whole or estimate.method != METHOD or abs(whole / u - 1.0) > SAME:
        return estimate
    priors = {name: size for name, size in own.items() if name != NOISE and size > 0.0}
    return replace(
        estimate,
        standard_uncertainty=own[NOISE],
        sensitivities={**estimate.sensitivities, **priors},
    )


SAME = 1e-6
"""A result that rests on another fit, as the scale factors in a coil, has another uncertainty."""


def _of_inertial(inertial: Inertial) -> Iterator[tuple[Key, Mapping[str, float]]]:
    unknowns = np.eye(len(inertial.state))
    for name, axes, where, factor in ROWS:
        for axis, slope in zip(axes, unknowns[where], strict=True):
            yield (name, axis), inertial.shares.of(factor * slope)


def _of_magnetic(magnetic: Magnetic) -> Iterator[tuple[Key, Mapping[str, float]]]:
    shares: Shares = magnetic.shares
    for name, axis, _, factor, slope in slopes_of(magnetic):
        yield (name, axis), shares.of(factor * slope)


def prior_rows(data: OtherAxes) -> Iterator[InputQuantity]:
    """Yield the priors of the other six axes, each in units of its own standard uncertainty."""
    field_nT, inclination = data.field_u_nT, data.inclination_u_rad
    described = {
        EDGE: "directions between axes, each stand",
        SECOND_ORDER: f"second order of the accelerometers, {1e6 * data.second_order_u:.3g} ug/g^2",
        DIRECTIONS: "directions of the stands, as the accelerometers or the priors give them",
        FIELD: f"magnitude of the earth's field, {field_nT:.3g} nT",
        INCLINATION: f"inclination of the earth's field, {math.degrees(inclination):.3g} deg",
    }
    for name, about in described.items():
        yield InputQuantity(name, about, 1.0, "1", data.source)
