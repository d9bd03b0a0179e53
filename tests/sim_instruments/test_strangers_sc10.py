"""A Thorlabs SC10 as other programs use it, and its two prompts."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from fixture import Fixture, standing
from trigger_fixture import Room
from variants import variant

from drivers.thorlabs.sc10 import ThorlabsSc10
from sim_instruments.thorlabs.sc10 import ThorlabsSc10 as Controller

TRUTH = {"opening_time": "12 ms", "closing_time": "9 ms", "gate_inverter": True}
ENDS = {"blank": b"> ", "bare": b">"}


@contextmanager
def controller(prompt: str, *faults: dict[str, Any]) -> Iterator[Fixture]:
    room = Room(lambda after_s: after_s)
    truth = {**TRUTH, "prompt": prompt}
    with standing("pump_laser", Controller, truth, room, *faults) as fixture:
        yield fixture


@pytest.mark.parametrize("prompt", ENDS)
def test_what_other_programs_ask_and_set(prompt: str) -> None:
    with controller(prompt) as fixture, fixture.line() as line:
        for text, value in (
            ("*idn?", "THORLABS SC10 VERSION 1.07"),
            ("rep=5", None),
            ("rep?", "5"),
            ("open=20", None),
            ("open?", "20"),
            ("xto=1", None),
            ("xto?", "1"),
            ("baud?", "0"),
            ("rep=100", "Command error CMD_ARG_INVALID"),
        ):
            echoed = "".join(f"{part}\r" for part in (text, value) if part is not None)
            whole = echoed.encode("ascii") + ENDS[prompt]
            assert line.raw_ask(text.encode("ascii") + b"\r") == whole


@pytest.mark.parametrize("prompt", ENDS)
def test_the_driver_copes_with_either_prompt_and_says_which_it_met(prompt: str) -> None:
    with variant("pump_laser", "serf-nonorthogonality", prompt=prompt) as here:
        driver = here.driver()
        assert driver.identify().firmware == "1.07"
        driver.open_shutter()
        assert driver.is_open()
        driver.close_shutter()
        driver.make_safe(here.clock.now() + 5.0)
        assert driver.read_safety().safe
        assert driver._line.doubts == 0, "a blank is nothing"
        driver.close()
        assert here.met() == [f"prompt {'with' if prompt == 'blank' else 'without'} a blank"]


@pytest.mark.parametrize("prompt", ENDS)
def test_a_lost_answer_does_not_leave_the_light_on_with_either_prompt(prompt: str) -> None:
    fault = {"fault": "no-reply", "command": "ens?", "at": "1 s"}
    with controller(prompt, fault) as fixture:
        driver = ThorlabsSc10(fixture.place())
        driver.follow_trigger()
        fixture.clock.sleep_until(1.0)
        driver.make_safe(fixture.clock.now() + 5.0)
        assert driver.read_safety().safe
        driver.close()
