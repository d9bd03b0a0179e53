"""What the rows of a gyro's switch-ons must be, whatever the procedure."""

from __future__ import annotations

import numpy as np

from station.dataset_reading import Table, refuse

CLOSE = 0.1
"""By how much of it the spacing of the rows may differ from the sample interval."""


def switch_ons(table: Table, column: str, interval_s: float) -> np.ndarray:
    """Return the first row of each switch-on, whose number stands in a column such as `switch_on`.

    Raises FaultList for switch-ons that return, times `t_s` that do not rise, and rows that are not
    a sample interval apart.
    """
    number, time_s = table[column], table["t_s"]
    begins = np.flatnonzero(np.diff(number, prepend=np.nan) != 0.0)
    word = column.replace("_", "-")
    faults, seen = [], set()
    for row in begins.tolist():
        if number[row] != int(number[row]):
            faults.append(table.fault(row, column, f"{number[row]:g} is no whole number"))
        elif number[row] in seen:
            what = f"{word} {number[row]:g} returns; keep its rows together"
            faults.append(table.fault(row, column, what))
        seen.add(number[row])
    steps = np.diff(time_s)
    within = np.diff(number) == 0.0
    for row in (np.flatnonzero(within & (steps <= 0.0)) + 1).tolist():
        what = f"{time_s[row]:.10g} is not after {time_s[row - 1]:.10g} of the row above"
        faults.append(table.fault(row, "t_s", f"{what}; times must rise"))
    if not faults and within.any():
        usual = float(np.median(steps[within]))
        if abs(usual - interval_s) > CLOSE * interval_s:
            what = f"rows are {usual:.4g} s apart, the sample interval is {interval_s:g} s"
            faults.append(table.fault(1, "t_s", what))
    refuse(faults)
    return np.asarray(begins)
