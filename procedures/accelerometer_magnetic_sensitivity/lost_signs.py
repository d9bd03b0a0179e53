"""Fields whose columns hold their size alone: the signs that make the model follow the output.

A row has one of two outputs, the model's at the field or at its opposite. From a first guess signs
and coefficients are found in turn, each row taking the sign that leaves it less.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .dataset import Rows
from .model import model_columns

Array = NDArray[np.float64]
ROUNDS = 12


def with_signs(rows: Rows) -> Rows | None:
    """Return the rows with the signs of the field that suit them best; None where it has signs."""
    commanded_T = rows.commanded_T
    one_sided = float(commanded_T.min()) >= 0.0 or float(commanded_T.max()) <= 0.0
    if not one_sided or not commanded_T.any():
        return None
    input_g = rows.accelerations()[:, 0]
    left_V = _fitted(rows)[1]
    went = np.cumsum(np.diff(np.abs(commanded_T), prepend=0.0) > 0.0) % 2
    begins = (left_V, left_V * np.where(input_g < 0.0, -1.0, 1.0), 2.0 * went - 1.0)
    tried = [_settled(rows, np.where(begin < 0.0, -1.0, 1.0)) for begin in begins]
    return min(tried, key=lambda settled: settled[1])[0]


def _settled(rows: Rows, signs: Array) -> tuple[Rows, float]:
    """Return the rows with signs that no row would change any more, and the squares left."""
    size_T = np.abs(rows.field_T)
    for _ in range(ROUNDS):
        signed = replace(rows, field_T=signs * size_T)
        coefficients, left_V = _fitted(signed)
        turned_V = rows.output_V - _columns(replace(rows, field_T=-signed.field_T)) @ coefficients
        better = np.abs(turned_V) < np.abs(left_V)
        if not better.any():
            break
        signs = np.where(better, -signs, signs)
    return signed, float(left_V @ left_V)


def _columns(rows: Rows) -> Array:
    """Return the columns of model and alignment (rows, 16), the field over its largest."""
    acceleration_g = rows.accelerations()
    field = rows.field_T / float(np.max(np.abs(rows.field_T)))
    model = model_columns(acceleration_g, field)
    return np.column_stack((model, acceleration_g[:, 1:], rows.slope))


def _fitted(rows: Rows) -> tuple[Array, Array]:
    """Return the coefficients of these columns (16,) and what they leave, in V (rows,)."""
    columns = _columns(rows)
    coefficients = np.asarray(np.linalg.lstsq(columns, rows.output_V, rcond=1e-9)[0])
    return coefficients, rows.output_V - columns @ coefficients
