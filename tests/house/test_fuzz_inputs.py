"""Odd inputs, the short form of `benchmarks/fuzz_inputs.py`: none is a fault of the program."""

from __future__ import annotations

import sys

import pytest
from places import ROOT

from benchmarks.fuzz_inputs import attempt, datasets_in

PIECES, EACH = 3, 28


@pytest.mark.campaign
@pytest.mark.skipif(sys.platform == "win32", reason="there is no interval timer")
@pytest.mark.parametrize("piece", range(PIECES))
def test_an_odd_input_ends_in_a_sentence(piece: int) -> None:
    datasets = datasets_in([ROOT / "tests" / "data"])
    ended = [attempt(number, datasets) for number in range(piece * EACH, (piece + 1) * EACH)]
    broken = [one for one in ended if one.broken and not one.broken.startswith("longer")]
    assert not broken
