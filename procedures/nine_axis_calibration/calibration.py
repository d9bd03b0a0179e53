"""The calibration file: JSON, and the same correction for C, MATLAB and Python.

The correction is defined once, as a list of assignments whose expressions mean the same in all
three languages; each language only adds what stands around them.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from procedures.common.constants import ARCSEC_PER_RAD, SECONDS_PER_HOUR

from .all_axes.results import other_sensors
from .dataset import AXES, Array
from .findings import (
    ASYMMETRY,
    BIAS,
    FRAME,
    SCALE_FACTOR,
    NineAxisAnalysis,
)

if TYPE_CHECKING:
    from station.findings import Findings
    from station.results import ResultDocument


PPM = 1e-6
NAME = "calibrate_gyros"
WHAT = "Corrects the three gyros: output and result are X, Y, Z in deg/s."


@dataclass(frozen=True)
class Correction:
    """true rate = inverse gain x ((output - bias) / (1 + asymmetry/2 x its sign)).

    `bias_deg_per_s` (3,), `asymmetry` (3,) as a ratio, zero where it is not significant, `inverse`
    (3, 3). `frame` is what its axes are those of; None where the misalignments were not measured,
    and count as zero.
    """

    bias_deg_per_s: Array
    asymmetry: Array
    inverse: Array
    frame: str | None


def correction_of(analysis: NineAxisAnalysis, significant: float = 2.0) -> Correction | None:
    """Return the correction that an analysis gives; None while a bias or a K is not determined."""
    biases, asymmetries = [], []
    for axis in AXES:
        try:
            bias = analysis.estimate(BIAS, axis).value
            scale = analysis.estimate(SCALE_FACTOR, axis).value
            asymmetry = analysis.estimate(ASYMMETRY, axis)
        except KeyError:
            return None
        if bias is None or scale is None:
            return None
        biases.append(bias / SECONDS_PER_HOUR)
        u = asymmetry.standard_uncertainty
        sure = asymmetry.value is not None and u is not None
        value = asymmetry.value if sure and abs(asymmetry.value or 0.0) >= significant * u else 0.0  # type: ignore[operator]
        asymmetries.append(PPM * (value or 0.0))
    gain, frame = _gain_of(analysis)
    known = bool(np.isfinite(gain).all())
    inverse = np.linalg.inv(np.where(np.isfinite(gain), gain, 0.0))
    return Correction(np.array(biases), np.array(asymmetries), inverse, frame if known else None)


def _gain_of(analysis: NineAxisAnalysis) -> tuple[Array, str]:
    """Return the gyros' matrix and its frame: the accelerometers' where they are determined."""
    to_accelerometers = analysis.others.misalignment if analysis.others is not None else ()
    if not to_accelerometers:
        return analysis.gain, FRAME
    own = [analysis.estimate(SCALE_FACTOR, axis).value for axis in AXES]
    gain = np.diag(np.array(own, dtype=np.float64))
    for estimate in to_accelerometers:
        assert estimate.axis is not None
        assert estimate.value is not None
        gyro, axis = (AXES.index(name) for name in estimate.axis)
        gain[gyro, axis] = gain[gyro, gyro] * estimate.value / ARCSEC_PER_RAD
    return gain, str(to_accelerometers[0].extra["frame"])


def assignments(correction: Correction) -> tuple[tuple[str, str], ...]:
    """Return the correction as (name, expression), in order; inputs are output1 to output3.

    A comparison counts as 1 or 0 in all three languages: (u > 0) - (u < 0) is the sign.
    """
    bias = correction.bias_deg_per_s
    lines = [(f"u{n + 1}", f"output{n + 1} - ({_text(bias[n])})") for n in range(3)]
    for n in range(3):
        half = _text(0.5 * correction.asymmetry[n])
        sign = f"((u{n + 1} > 0) - (u{n + 1} < 0))"
        lines.append((f"v{n + 1}", f"u{n + 1} / (1.0 + ({half}) * {sign})"))
    for n in range(3):
        terms = [f"({_text(correction.inverse[n, k])}) * v{k + 1}" for k in range(3)]
        lines.append((f"rate{n + 1}", " + ".join(terms)))
    return tuple(lines)


def snippet_c(correction: Correction) -> str:
    """Return the correction as a C function."""
    body = [f"    const double output{n + 1} = output[{n}];" for n in range(3)]
    body += [f"    const double {name} = {text};" for name, text in assignments(correction)]
    body += [f"    rate[{n}] = rate{n + 1};" for n in range(3)]
    head = f"void {NAME}(const double output[3], double rate[3])"
    return "\n".join([f"/* {WHAT} */", head, "{", *body, "}", ""])


def snippet_matlab(correction: Correction) -> str:
    """Return the correction as a MATLAB function."""
    body = [f"    output{n + 1} = output({n + 1});" for n in range(3)]
    body += [f"    {name} = {text};" for name, text in assignments(correction)]
    body.append("    rate = [rate1; rate2; rate3];")
    head = f"function rate = {NAME}(output)"
    return "\n".join([head, f"% {WHAT}", *body, "end", ""])


def snippet_python(correction: Correction) -> str:
    """Return the correction as a Python function."""
    body = [f"    output{n + 1} = float(output[{n}])" for n in range(3)]
    body += [f"    {name} = {text}" for name, text in assignments(correction)]
    body.append("    return [rate1, rate2, rate3]")
    return "\n".join([f"def {NAME}(output):", f'    """{WHAT}"""', *body, ""])


def calibration_data(
    correction: Correction, document: ResultDocument | None = None
) -> dict[str, object]:
    """Return the calibration file as data; every number is finite."""
    data: dict[str, object] = {
        "calibration": 1,
        "procedure": "nine-axis-calibration",
        "axes": list(AXES),
        "unit": "deg/s",
        "model": "true rate = inverse_gain * ((output - bias) / (1 + asymmetry / 2 * sign))",
        "sign": "of output - bias, each axis its own",
        "bias": _list(correction.bias_deg_per_s),
        "asymmetry": _list(correction.asymmetry),
        "inverse_gain": [_list(row) for row in correction.inverse],
        "misalignment_measured": correction.frame is not None,
        "frame": correction.frame,
    }
    if document is not None:
        data["results"] = [
            {key: entry[key] for key in ("name", "axis", "value", "unit", "expanded_uncertainty")}
            for entry in (result.to_data() for result in document.results)
        ]
    return data


def files_of(findings: Findings, document: ResultDocument) -> dict[str, str]:
    """Return the calibration that findings give, file name to text."""
    return calibration_files(findings.detail.analysis, document)


def calibration_files(
    analysis: NineAxisAnalysis, document: ResultDocument | None = None
) -> dict[str, str]:
    """Return the calibration file and the snippets, name to text; none where it is undetermined."""
    correction = correction_of(analysis)
    if correction is None:
        return {}
    data = calibration_data(correction, document)
    if analysis.others is not None:
        data |= other_sensors(analysis.others)
    return {
        "calibration.json": json.dumps(data, indent=1, allow_nan=False) + "\n",
        f"{NAME}.c": snippet_c(correction),
        f"{NAME}.m": snippet_matlab(correction),
        f"{NAME}.py": snippet_python(correction),
    }


def _list(values: Sequence[float] | Array) -> list[float]:
    return [float(value) for value in values]


def _text(value: float) -> str:
    return repr(float(value))
