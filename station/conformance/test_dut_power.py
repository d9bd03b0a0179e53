"""What a supply of the device under test owes: it asks for nothing that it did not declare."""

from __future__ import annotations

from typing import Any

import pytest

from station.conformance.fixture import Fixture


def test_its_prompts_are_declared_with_a_text(fixture: Fixture) -> None:
    """A run checks before it begins that every prompt can be answered."""
    for prompt_id, text in getattr(fixture.driver, "prompts", {}).items():
        assert prompt_id == prompt_id.strip().lower(), f"{prompt_id!r} is no stable id"
        assert " " not in prompt_id, f"{prompt_id!r} is no stable id"
        assert text.strip(), f"{prompt_id} says nothing"


@pytest.mark.energises
def test_it_switches_on_and_off_and_asks_only_what_it_declared(
    fixture: Fixture, dut_power: Any
) -> None:
    """Both acts work, twice, and an operator is asked by declared ids alone."""
    for _ in range(2):
        dut_power.switch_on()
        dut_power.switch_off()
    assert set(fixture.asked) <= set(getattr(fixture.driver, "prompts", {}))
