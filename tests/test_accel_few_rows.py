"""The accelerometer analysis on small or odd records: warming, a large offset, no field."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from accelerometer_records import SIX_FIELDS_T, codes, off_in_u, points, record

from procedures.accelerometer_magnetic_sensitivity.analysis import analyse
from procedures.accelerometer_magnetic_sensitivity.commanded import commanded_angles


def test_a_warming_that_follows_the_angle_is_not_taken_for_the_coefficients() -> None:
    count = len(points(("io",), 12, SIX_FIELDS_T)[0])
    warm = 23.0 + 0.5 * (1.0 - np.exp(-3.0 * np.arange(count) / count))
    dataset = record(
        16, ("io",), 12, SIX_FIELDS_T, temperature_degC=warm, K0_per_K=3e-5, Ki_per_K=1e-4
    )
    assert max(off_in_u(analyse(dataset)).values()) < 4.0


def test_an_offset_of_half_a_degree_is_no_drift_and_changes_no_list() -> None:
    dataset = record(17, ("io", "ip"), 12, SIX_FIELDS_T, offset_arcsec=1800.0)
    analysis = analyse(dataset)
    assert max(off_in_u(analysis).values()) < 4.0
    assert codes(analysis) == {"not-identifiable"}
    read_deg = np.repeat(60.0 * np.arange(6), 3) + 0.123 + 1e-5 * np.arange(18)
    assert set(commanded_angles(read_deg)) == {0.0, 60.0, 120.0, 180.0, 240.0, 300.0}


def test_without_input_acceleration_no_offset_of_the_encoder_is_sought() -> None:
    for seed in range(4):
        analysis = analyse(record(seed, ("op",), 7, (0.0, 0.05)))
        assert "encoder offset" not in {one.name for one in analysis.nuisances}


def test_a_field_that_was_never_there_ends_in_a_flag() -> None:
    dataset = record(18)
    analysis = analyse(replace(dataset, field_T=np.zeros(len(dataset))))
    assert all(one.value is None for one in analysis.estimates)
    flag = next(flag for flag in analysis.flags if flag.code == "not-identifiable")
    assert "do not follow the commanded ones" in flag.message
