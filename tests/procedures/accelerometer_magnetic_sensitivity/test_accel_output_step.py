"""A step of the output is no jump of the encoder, and no drift."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from accelerometer_records import SIX_FIELDS_T, codes, off_in_u, record

from procedures.accelerometer_magnetic_sensitivity.analysis import analyse
from procedures.accelerometer_magnetic_sensitivity.dataset import AccelerometerDataset

USUAL = {"not-identifiable", "not-significant", "drift-removed", "outliers-rejected"}


def stepped(dataset: AccelerometerDataset, row: int, size_V: float) -> AccelerometerDataset:
    output = dataset.output_V.copy()
    output[row:] += size_V
    return replace(dataset, output_V=output)


@pytest.mark.parametrize("row", [10, 27, 40])
@pytest.mark.parametrize("drift_V", [0.0, 30e-6])
def test_a_step_of_the_output_is_flagged_and_removed(row: int, drift_V: float) -> None:
    for seed in range(3):
        drift = drift_V * np.linspace(-1.0, 1.0, 54)
        analysis = analyse(stepped(record(seed, drift_V=drift), row, 100e-6))
        assert codes(analysis) <= USUAL | {"output-step"}
        flag = next(flag for flag in analysis.flags if flag.code == "output-step")
        assert abs(int(str(flag.details["row"])) - row) <= 1
        assert flag.details["step_V"] == pytest.approx(100e-6, abs=25e-6)
        off = off_in_u(analysis)
        del off["K0"]  # the mean of before and after
        assert max(off.values()) < 4.5


def test_a_step_in_one_plane_and_a_small_one() -> None:
    for seed in range(3):
        plane = record(seed, ("io",), 24, SIX_FIELDS_T)
        for size_V in (100e-6, -20e-6):
            analysis = analyse(stepped(plane, 70, size_V))
            assert "output-step" in codes(analysis)
            assert "encoder-jump" not in codes(analysis)
            off = off_in_u(analysis)
            del off["K0"]
            assert max(off.values()) < 4.5


def test_clean_records_have_no_step() -> None:
    for seed in range(80):
        one = record(seed, drift_V=15e-6 * (seed % 2) * np.linspace(-1.0, 1.0, 54) ** 3)
        assert not codes(analyse(one)) & {"output-step", "encoder-jump"}, seed
