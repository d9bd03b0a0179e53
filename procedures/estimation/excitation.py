"""Whether the coils made the field that was commanded, and what is likely wrong where they did not.

A result holds for the measured field, so that a small difference spoils nothing. Beyond the bound
nobody knows what the device was exposed to, and nothing is decided about it.
"""

from __future__ import annotations

from collections.abc import Mapping

from station.findings import Flag

LARGEST_ERROR = 0.5
"""Part of the commanded field by which the measured one may differ."""
SEEN = 0.1
"""Part of the commanded field below which a coil makes none."""


def excitation_flags(
    coil: str,
    own: str,
    seen: Mapping[str, float],
    commanded: tuple[float, str],
    axis: str | None = None,
) -> list[Flag]:
    """Return the flag of a coil whose field is missing or wrong by more than the bound, or none.

    `seen` holds the measured field over the commanded one by axis, with a sign where that is known,
    and without the axes that were not measured or that another coil drives alike; `own` is the axis
    of the coil, `commanded` its field with the unit.
    """
    share = seen[own]
    if abs(share - 1.0) <= LARGEST_ERROR:
        return []
    details: dict[str, object] = {"coil": coil, "relative_difference": share - 1.0}
    elsewhere = {other: abs(size) for other, size in seen.items() if other != own}
    most = max(elsewhere, key=lambda other: elsewhere[other], default=own)
    if elsewhere and elsewhere[most] >= max(1.0 - LARGEST_ERROR, abs(share)):
        details["appears_on"] = most
        what = f"appears on axis {most}"
        why = (
            f"are the coils or the supplies of {own} and {most} exchanged? Look at the cables and "
            "at the addresses in the bench file"
        )
    elif share <= LARGEST_ERROR - 1.0:
        what = "is reversed"
        why = "exchange the two leads of the coil, or turn the probe that measures the field"
    elif max(abs(share), elsewhere.get(most, 0.0)) < SEEN:
        what = "appears on no axis" if elsewhere else "is missing"
        why = (
            "are two supplies exchanged? Look whether the coil is connected, at the output of its "
            "supply, and at what measures the field"
        )
    else:
        what = "is too weak" if share < 1.0 else "is too strong"
        why = (
            "look at the coil's constant and the supply's voltage limit in the bench file, at the "
            "coil's cable, for a field that nobody commanded, and at what measures the field: its "
            "unit, its range"
        )
    field, unit = commanded
    return [
        Flag(
            "wrong-excitation",
            f"The field of coil {coil} {what}: {share * field:.3g} {unit} of the commanded "
            f"{field:.5g} {unit} was measured on its own axis. There is no verdict on the device; "
            f"{why}.",
            axis,
            details,
        )
    ]
