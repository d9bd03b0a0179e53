"""Which cases of a table are with the quick tests."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def quick(cases: Iterable[Any], *names: Any) -> list[Any]:
    """Return the cases as parameters; those not named are with the campaigns."""
    cases = list(cases)
    assert set(names) <= set(cases), names
    return [
        case if case in names else pytest.param(case, marks=pytest.mark.campaign) for case in cases
    ]
