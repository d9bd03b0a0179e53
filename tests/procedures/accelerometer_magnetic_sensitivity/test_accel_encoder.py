"""An encoder that is off, from a row on or at one angle: found, corrected and said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from accelerometer_records import codes, off_in_u, record

from procedures.accelerometer_magnetic_sensitivity.analysis import analyse


@pytest.mark.parametrize(
    ("seed", "planes", "angles", "rows", "jump_deg"),
    [
        (1, ("io", "ip"), 24, slice(100, None), 0.05),
        (0, ("io", "ip"), 24, slice(130, None), 5.0),
        (4, ("io",), 24, slice(49, None), -1.0),
        (7, ("io", "ip"), 9, slice(50, None), 0.3),
        # One angle of nine leaves least absolute residuals that fit it and not the others.
        (2, ("io",), 9, slice(6, 9), 2.0),
        (0, ("io", "ip"), 9, slice(24, 27), -0.1),
    ],
)
def test_an_encoder_that_loses_counts_is_found_and_corrected(
    seed: int,
    planes: tuple[str, ...],
    angles: int,
    rows: slice,
    jump_deg: float,
) -> None:
    dataset = record(seed, planes, angles)
    theta = dataset.theta_deg.copy()
    theta[rows] += jump_deg
    analysis = analyse(replace(dataset, theta_deg=theta))
    assert codes(analysis) == {"not-identifiable", "encoder-jump"}
    flag = next(flag for flag in analysis.flags if flag.code == "encoder-jump")
    # A row at which the output hardly moves with the angle cannot tell.
    assert abs(int(str(flag.details["row"])) - rows.start) <= 3
    assert float(str(flag.details["jump_arcsec"])) == pytest.approx(3600 * jump_deg, abs=3.0)
    assert max(off_in_u(analysis).values()) < 3.7


def test_a_jump_between_two_planes_is_told_from_misalignment_by_its_square() -> None:
    dataset = record(4)
    theta = dataset.theta_deg + np.where(dataset.plane == "ip", 0.5, 0.0)
    analysis = analyse(replace(dataset, theta_deg=theta))
    assert codes(analysis) == {"not-identifiable", "encoder-jump"}
    assert max(off_in_u(analysis).values()) < 3.7
