"""From data to findings: an imported dataset, its analysis, and the type B inputs."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from numpy.polynomial import Chebyshev

from procedures.estimation.direction import attitude_inputs, with_latitude
from station.findings import Estimate, Findings, InputQuantity, findings_of

from .analysis import analyse
from .dataset import dataset_of_import

if TYPE_CHECKING:
    from station.dataset_reading import RawDataset

WARMTH = "thermometer_degC"


def findings_of_dataset(raw: RawDataset) -> Findings:
    """Return what an imported dataset says."""
    dataset, conditions = dataset_of_import(raw)
    u_arcmin, source = conditions.attitude_uncertainty_arcmin, "the dataset's conditions"
    inputs = list(attitude_inputs(dataset.directions, u_arcmin, source))
    about = "offset of the thermometer, by the slope of the bias"
    u_degC = conditions.thermometer_uncertainty_degC
    inputs.append(InputQuantity.if_stated(WARMTH, about, u_degC, "degC", source))
    findings = findings_of(analyse(dataset), dataset, inputs)
    findings = replace(findings, estimates=[*map(_by_warmth, findings.estimates)])
    u_arcmin = conditions.latitude_uncertainty_arcmin
    return with_latitude(findings, dataset.directions, dataset.latitude_rad, u_arcmin, source)


def _by_warmth(estimate: Estimate) -> Estimate:
    """Return a bias that depends on the thermometer by its slope at the reference temperature."""
    model = estimate.extra.get("model")
    if model is None:
        return estimate
    at_degC = float(estimate.extra["conditions"]["temperature"].removesuffix(" degC"))
    curve = Chebyshev(model["coefficients"], model["domain"])
    slopes = {WARMTH: float(curve.deriv()(at_degC))}
    return replace(estimate, sensitivities={**estimate.sensitivities, **slopes})
