"""What `validate` says of a plan: what its positions determine, and how well."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from procedures.common.constants import ARCSEC_PER_RAD
from procedures.estimation.folding import Terms
from station.findings import combination_text
from station.report.numbers import format_number

from .analysis import RATIOS
from .dataset import TumbleDataset
from .model import COEFFICIENTS, UNITS, Array, judge
from .parameters import TumbleParameters
from .solution import Parts, beside_model

UNDECIDED = "this plan does not determine {}; its verdict will be inconclusive (exit code 6)"


def ideal(parameters: TumbleParameters) -> TumbleDataset:
    """Return the readings of a perfect accelerometer without noise."""
    points = parameters.points
    commanded = np.deg2rad([point.angle_deg for point in points])
    head = np.deg2rad([point.setting.head_deg for point in points])
    return TumbleDataset(
        time_s=np.arange(len(points), dtype=float),
        plane=np.array([point.setting.plane for point in points]),
        reverse=np.array([-1.0 if point.setting.reversed else 1.0 for point in points]),
        head_rad=head,
        commanded_rad=commanded,
        encoder_rad=commanded,
        output_V=parameters.scale_factor_V_per_g * np.sin(commanded + head),
        temperature_degC=None,
        gravity_g=parameters.local_gravity_g,
        encoder_accuracy_rad=(parameters.encoder_accuracy_arcsec or 0.0) / ARCSEC_PER_RAD,
        mounting_rad=parameters.mounting_repeatability_arcsec / ARCSEC_PER_RAD,
    )


def determined(dataset: TumbleDataset) -> Terms:
    """Return what positions determine."""
    return judge(dataset.plane, dataset.reverse, dataset.theta_rad, dataset.gravity_g)


def expected_u(parameters: TumbleParameters) -> tuple[Terms, Array]:
    """Return what a plan determines, with the standard uncertainty of each.

    That of noise, mountings and the encoder as the plan states it; drift and temperature are not
    known beforehand.
    """
    dataset = ideal(parameters)
    terms = determined(dataset)
    model = dataset.columns[:, [COEFFICIENTS.index(name) for name in terms]]
    every = np.ones(len(model), dtype=bool)
    beside = beside_model(dataset, parameters.scale_factor_V_per_g)
    parts = Parts(dataset.output_V, every, model, {}, {}, beside)
    design, _ = parts.system(parameters.reading_noise_V / np.sqrt(parameters.readings))
    size = np.linalg.norm(design, axis=0)
    inverse = np.linalg.pinv(design / size, rcond=1e-12) / size[:, None]
    return terms, np.linalg.norm(inverse, axis=1)[: len(terms)]


def undetermined(parameters: TumbleParameters) -> Mapping[str, str]:
    """Return each coefficient that a plan does not determine alone, and what it does instead."""
    terms = determined(ideal(parameters))
    why: dict[str, str] = {}
    for name in COEFFICIENTS:
        together = [combination_text(own) for own in terms.values() if name in own]
        if name in terms and len(terms[name]) == 1 and len(together) == 1:
            continue
        if name in terms:
            why[name] = f"this plan determines only {together[0]}; the limit is held against that"
            continue
        what = f"{name} alone, only {', '.join(together)}" if together else f"{name} at all"
        why[name] = UNDECIDED.format(what)
    for name, axis, over, _, _ in RATIOS:
        if over != "K0" and len(terms.get(over, {})) != 1:
            why[name] = UNDECIDED.format(f"{name} {axis}" if axis else name)
    return why


def outlook(parameters: TumbleParameters) -> Sequence[str]:
    """Return in lines what a plan determines, and how well."""
    terms, u = expected_u(parameters)
    lines = [f"{len(parameters.points)} positions in {len(parameters.settings)} mountings"]
    lines += [
        f"{combination_text(own)}: u = {format_number(float(own_u), 2)} {UNITS[name]}"
        for (name, own), own_u in zip(terms.items(), u, strict=True)
    ]
    lines.append(
        "u here is that of noise and mountings; calibration records, the encoder's first of all, "
        "local gravity, temperature and drift add to it."
        if parameters.encoder_accuracy_arcsec is None
        else "u here is that of noise, encoder and mountings; calibration records, local gravity, "
        "temperature and drift add to it."
    )
    return lines
