"""What becomes of a navigator's outputs and answers when its line, or its partner, goes wrong."""

from __future__ import annotations

import numpy as np
import pytest
from fixture import recorded, said_of_a_line_that_is_gone
from navigator_fixture import KINDS, NAME, navigator

from station.errors import InstrumentTimeout
from station.roles import NavigatorStatus

both = pytest.mark.parametrize("kind", KINDS)


@both
def test_a_silent_navigator_leaves_a_gap_in_the_counter(kind: str) -> None:
    with navigator(kind, {"fault": "silent", "at": "10 s", "for": "5 s"}) as (fixture, driver):
        driver.start(10.0)
        steps = np.diff(recorded(fixture, driver, 20.0).columns["counter"].astype(int))
        assert sorted(set(steps.tolist())) == [1, 51]


LOST = [("can", "lost-frame", name) for name in ("0B0", "0B1", "0B2")]
LOST += [
    ("serial", kind, "output")
    for kind in ("lost-frame", "no-reply", "garbled", "wrong-crc", "partial")
]


@pytest.mark.parametrize(("kind", "fault", "message"), LOST)
def test_a_lost_output_is_a_gap_and_no_more(kind: str, fault: str, message: str) -> None:
    entry = {"fault": fault, "command": message, "nth": 50, "count": 1}
    with navigator(kind, entry) as (fixture, driver):
        driver.start(10.0)
        counter = recorded(fixture, driver, 20.0).columns["counter"].tolist()
        assert counter == [k for k in range(1, counter[-1] + 1) if k != 50]


@pytest.mark.parametrize(("kind", "message"), [("can", "0A0"), ("serial", "command start")])
@pytest.mark.parametrize("fault", ["lost-frame", "no-reply"])
def test_a_lost_answer_is_told_clearly(kind: str, message: str, fault: str) -> None:
    entry = {"fault": fault, "command": message, "nth": 2 if kind == "can" else 1, "count": 1}
    with navigator(kind, entry) as (_, driver):
        with pytest.raises(InstrumentTimeout) as raised:
            driver.start(1.0)
        assert str(raised.value).startswith(
            f"{NAME}: sent the command start: no acknowledgement came within 0.5 s; check"
        )
        driver.start(1.0)


@both
def test_a_late_answer_is_not_taken_for_the_next(kind: str) -> None:
    message = "0A0" if kind == "can" else "command identify"
    entry = {"fault": "late", "command": message, "count": 1, "delay": "0.8 s"}
    with navigator(kind, entry) as (fixture, driver):
        with pytest.raises(InstrumentTimeout):
            driver.identify()
        fixture.clock.sleep(1.0)
        assert driver.status() == NavigatorStatus(False, None, ())
        assert driver.identify().serial == "0"


@both
def test_a_line_that_ends_is_told_clearly(kind: str) -> None:
    entry = {"fault": "port-gone", "at": "5 s"}
    with navigator(kind, entry) as (fixture, driver):
        driver.start(2.0)
        fixture.clock.sleep(4.0)
        assert driver.read_quantity("temperature") is not None
        fixture.clock.sleep(3.0)
        said = said_of_a_line_that_is_gone(driver)
        assert said.startswith(NAME) and "broke (" in said


@both
@pytest.mark.parametrize("rate_Hz", [0.9, 10.1])
def test_the_navigator_itself_refuses_too(kind: str, rate_Hz: float) -> None:
    with navigator(kind) as (fixture, driver):
        driver._send("start", 7, {"rate_Hz": rate_Hz})
        (answer,) = driver._commands._line.wait_for("acknowledgement", fixture.clock.now() + 0.5)
        assert (answer["request_id"], str(answer["result"])) == (7, "bad_rate")
        driver.start(1.0)
        driver._send("start", 8, {"rate_Hz": 1.0})
        (answer,) = driver._commands._line.wait_for("acknowledgement", fixture.clock.now() + 0.5)
        assert str(answer["result"]) == "already_running"
