"""How many causes the parts name: a bench of which one is named does not pass."""

from __future__ import annotations

from collections.abc import Sequence

from station.findings import NOT_TRIED, Estimate, Flag

CAUSES = "named_causes"
UNDECIDED = "-undecided"
"""The end of the codes of what the data do not decide; the figure beside it says so, too."""
NOT_MEASURED = "not-measured"


def named_causes(flags: Sequence[Flag]) -> Estimate:
    """Return the number of causes among the flags of all parts, with their codes.

    A cause may have no figure of its own that a limit could hold, such as a reversed accelerometer.
    """
    codes = [flag.code for flag in flags if not flag.code.endswith(UNDECIDED)]
    named = [code for code in codes if code not in (NOT_MEASURED, NOT_TRIED)]
    extra = {"codes": named}
    method = "causes that the parts name"
    return Estimate(CAUSES, None, float(len(named)), "1", 0.0, None, method, {}, extra)
