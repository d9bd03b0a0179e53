"""The calibration file: C, MATLAB and Python correct alike, and bring back the true rate."""

from __future__ import annotations

import ctypes
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from nine_axis_records import ASYMMETRY, BIAS, CROSS, SCALE, Setting, record

from procedures.nine_axis_calibration.analysis import analyse
from procedures.nine_axis_calibration.calibration import (
    NAME,
    Correction,
    calibration_files,
    correction_of,
)

ANALYSIS = analyse(record(Setting(noise=0.001)), allan=False)
TRUE = np.array([[0.0, 0.001, -0.002], [1.0, -2.0, 3.0], [-80.0, 40.0, 95.0], [0.1, 0.0, -100.0]])


def apply(correction: Correction, output_deg_per_s: np.ndarray) -> np.ndarray:
    """Return true rates of outputs, both (n, 3) in deg/s: what the snippets do, in one go."""
    offset = output_deg_per_s - correction.bias_deg_per_s
    even = offset / (1.0 + 0.5 * correction.asymmetry * np.sign(offset))
    return np.asarray(even @ correction.inverse.T)


def outputs() -> np.ndarray:
    """Return what the sensor reads at the true rates."""
    felt = TRUE @ (SCALE[:, None] * (np.eye(3) + CROSS)).T
    return felt * (1 + ASYMMETRY / 2 * np.sign(felt)) + BIAS / 3600.0


def by_python(text: str, output: np.ndarray) -> list[float]:
    names: dict = {}  # type: ignore[type-arg]
    exec(text, names)
    return list(names[NAME](list(output)))


def by_matlab(text: str, output: np.ndarray) -> list[float]:
    """Carry out the MATLAB function: its assignments mean the same in Python."""
    assert text.startswith(f"function rate = {NAME}(output)\n")
    assert text.rstrip().endswith("end")
    body = [line.strip() for line in text.splitlines()[2:-1]]
    assert all(line.endswith(";") for line in body)
    lines = [re.sub(r"output\((\d)\)", lambda m: f"output[{int(m[1]) - 1}]", one) for one in body]
    names = {"output": [float(one) for one in output]}
    exec("\n".join(line.rstrip(";").replace("; ", ", ") for line in lines), {}, names)
    return list(names["rate"])


def test_the_correction_brings_back_the_true_rates() -> None:
    correction = correction_of(ANALYSIS)
    assert correction is not None
    assert apply(correction, outputs()) == pytest.approx(TRUE, abs=2e-6)


def test_python_and_matlab_correct_as_the_definition_does() -> None:
    correction = correction_of(ANALYSIS)
    assert correction is not None
    files = calibration_files(ANALYSIS)
    for output, expected in zip(outputs(), apply(correction, outputs()), strict=True):
        assert by_python(files[f"{NAME}.py"], output) == pytest.approx(expected, abs=1e-12)
        assert by_matlab(files[f"{NAME}.m"], output) == pytest.approx(expected, abs=1e-12)


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_c_corrects_as_python_does(tmp_path: Path) -> None:
    files = calibration_files(ANALYSIS)
    (tmp_path / "one.c").write_text(files[f"{NAME}.c"], encoding="utf-8")
    library = tmp_path / "one.so"
    subprocess.run(
        ["cc", "-Wall", "-Werror", "-ffp-contract=off", "-shared", "-fPIC", "-o", library, "one.c"],
        cwd=tmp_path,
        check=True,
    )
    function = ctypes.CDLL(str(library))[NAME]
    triple = ctypes.c_double * 3
    for output in outputs():
        rate = triple()
        function(triple(*output), rate)
        assert list(rate) == by_python(files[f"{NAME}.py"], output)


def test_the_file_holds_the_correction_as_finite_numbers() -> None:
    data = json.loads(calibration_files(ANALYSIS)["calibration.json"])
    assert data["unit"] == "deg/s"
    assert np.array(data["bias"]) * 3600 == pytest.approx(BIAS, abs=1e-3)
    assert np.linalg.inv(data["inverse_gain"]) == pytest.approx(
        SCALE[:, None] * (np.eye(3) + CROSS), abs=1e-7
    )
    assert data["misalignment_measured"] is True


def test_asymmetry_that_is_noise_is_not_corrected_and_missing_results_make_no_file() -> None:
    noisy = analyse(record(Setting(dwell_s=72, noise=20.0)), allan=False)
    correction = correction_of(noisy)
    assert correction is not None
    assert float(np.max(np.abs(correction.asymmetry))) < 1e-4
    assert calibration_files(analyse(record(Setting(positions=())), allan=False)) == {}


def test_misalignments_that_were_not_recorded_count_as_zero() -> None:
    correction = correction_of(analyse(record(Setting(alone=True)), allan=False))
    assert correction is not None
    assert correction.frame is None
    assert np.count_nonzero(correction.inverse) == 3
