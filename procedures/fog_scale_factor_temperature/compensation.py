"""The compensation to build in: one definition, written as a table and in three languages.

A true rate is the measured one over 1 + delta(T). The temperature is held at the ends of the
calibrated range: beyond them a polynomial says nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .curve import Curve
from .dataset import AXES

if TYPE_CHECKING:
    from station.findings import Findings
    from station.results import ResultDocument

SAID = "rate / (1 + delta(T)): divide, never multiply. T is the gyro's own temperature in degC."


@dataclass(frozen=True)
class AxisDefinition:
    """Numbers of one axis, as they are written: ppm, lowest order first, and the range in degC."""

    axis: str
    low: float
    high: float
    coefficients: tuple[float, ...]

    def numbers(self, separator: str = ", ") -> str:
        """Return the coefficients as text that reads back as the same numbers."""
        return separator.join(repr(number) for number in self.coefficients)


def definition_of(curves: Mapping[str, Curve]) -> tuple[AxisDefinition, ...]:
    """Return the compensation of all axes that have a curve, in the order x, y, z."""
    return tuple(
        AxisDefinition(
            axis,
            float(curves[axis].domain_degC[0]),
            float(curves[axis].domain_degC[1]),
            tuple(float(number) for number in curves[axis].coefficients_ppm),
        )
        for axis in AXES
        if axis in curves
    )


def table_csv(curves: Mapping[str, Curve], step_degC: float = 1.0) -> str:
    """Return the scale-factor errors as CSV: whole steps of temperature, empty outside a range."""
    axes = [axis for axis in AXES if axis in curves]
    low = min(curves[axis].domain_degC[0] for axis in axes)
    high = max(curves[axis].domain_degC[1] for axis in axes)
    grid = np.arange(np.ceil(low / step_degC), np.floor(high / step_degC) + 1) * step_degC
    lines = [",".join(["temperature_degC", *(f"delta_{axis}_ppm" for axis in axes)])]
    values = {axis: curves[axis].error_ppm(grid) for axis in axes}
    for n, heat in enumerate(grid):
        cells = [
            f"{values[axis][n]:.3f}" if curves[axis].holds(float(heat)) else "" for axis in axes
        ]
        lines.append(",".join([f"{heat:g}", *cells]))
    return "\n".join(lines) + "\n"


def files_of(findings: Findings, document: ResultDocument) -> dict[str, str]:
    """Return the compensation that findings give, file name to text."""
    fits = findings.detail.analysis.fits
    return compensation_files(
        {axis: fit.curve for axis, fit in fits.items() if fit.curve is not None}
    )


def compensation_files(curves: Mapping[str, Curve]) -> dict[str, str]:
    """Return the table and the three sources, file name to text; nothing without a curve."""
    if not curves:
        return {}
    definition = definition_of(curves)
    return {
        "compensation.csv": table_csv(curves),
        "compensation.c": c_source(definition),
        "compensated.m": matlab_source(definition),
        "compensation.py": python_source(definition),
    }


def python_source(definition: tuple[AxisDefinition, ...]) -> str:
    """Return a Python module without imports: `compensated(axis, rate, temperature_degC)`."""
    rows = "".join(
        f'    "{curve.axis}": ({curve.low!r}, {curve.high!r}, ({curve.numbers()},)),\n'
        for curve in definition
    )
    return (
        f'"""Compensation of a gyro\'s scale factor over temperature: {SAID}"""\n\n'
        "MODEL = {\n" + rows + "}\n\n\n"
        "def delta_ppm(axis, temperature_degC):\n"
        "    low, high, c = MODEL[axis]\n"
        "    t = min(max(temperature_degC, low), high)\n"
        "    u = (2.0 * t - low - high) / (high - low)\n"
        "    b1 = b2 = 0.0\n"
        "    for k in range(len(c) - 1, 0, -1):\n"
        "        b1, b2 = c[k] + 2.0 * u * b1 - b2, b1\n"
        "    return c[0] + u * b1 - b2\n\n\n"
        "def compensated(axis, rate, temperature_degC):\n"
        "    return rate / (1.0 + 1e-6 * delta_ppm(axis, temperature_degC))\n"
    )


def c_source(definition: tuple[AxisDefinition, ...]) -> str:
    """Return C99 for `double compensated(char axis, double rate, double temperature_degC)`."""
    most = max(len(curve.coefficients) for curve in definition)
    rows = "".join(
        f"    {{'{curve.axis}', {curve.low!r}, {curve.high!r}, {len(curve.coefficients)}, "
        f"{{{curve.numbers()}}}}},\n"
        for curve in definition
    )
    return (
        "/* Compensation of a gyro's scale factor over temperature:\n"
        f"   {SAID} */\n"
        "struct model { char axis; double low, high; int terms; "
        f"double c[{most}]; }};\n"
        "static const struct model MODEL[] = {\n" + rows + "};\n\n"
        "double delta_ppm(char axis, double temperature_degC)\n{\n"
        f"    int m = 0, k;\n"
        f"    while (m < {len(definition) - 1} && MODEL[m].axis != axis) m++;\n"
        "    const struct model *p = &MODEL[m];\n"
        "    double t = temperature_degC;\n"
        "    if (t < p->low) t = p->low;\n"
        "    if (t > p->high) t = p->high;\n"
        "    double u = (2.0 * t - p->low - p->high) / (p->high - p->low);\n"
        "    double b1 = 0.0, b2 = 0.0;\n"
        "    for (k = p->terms - 1; k >= 1; k--) {\n"
        "        double b0 = p->c[k] + 2.0 * u * b1 - b2;\n"
        "        b2 = b1;\n"
        "        b1 = b0;\n"
        "    }\n"
        "    return p->c[0] + u * b1 - b2;\n}\n\n"
        "double compensated(char axis, double rate, double temperature_degC)\n{\n"
        "    return rate / (1.0 + 1e-6 * delta_ppm(axis, temperature_degC));\n}\n"
    )


def matlab_source(definition: tuple[AxisDefinition, ...]) -> str:
    """Return the MATLAB function file `compensated(axis, rate, temperature_degC)`."""
    cases = "".join(
        f"        case '{curve.axis}'\n"
        f"            low = {curve.low!r}; high = {curve.high!r};\n"
        f"            c = [{curve.numbers()}];\n"
        for curve in definition
    )
    return (
        "function true_rate = compensated(axis, rate, temperature_degC)\n"
        f"% {SAID}\n"
        "    true_rate = rate / (1.0 + 1e-6 * delta_ppm(axis, temperature_degC));\n"
        "end\n\n"
        "function delta = delta_ppm(axis, temperature_degC)\n"
        "    switch axis\n" + cases + "    end\n"
        "    t = min(max(temperature_degC, low), high);\n"
        "    u = (2.0 * t - low - high) / (high - low);\n"
        "    b1 = 0.0; b2 = 0.0;\n"
        "    for k = length(c):-1:2\n"
        "        b0 = c(k) + 2.0 * u * b1 - b2;\n"
        "        b2 = b1;\n"
        "        b1 = b0;\n"
        "    end\n"
        "    delta = c(1) + u * b1 - b2;\n"
        "end\n"
    )
