"""The Lake Shore F71, which fills a buffer, and the 425, whose probe has one axis."""

from __future__ import annotations

import numpy as np
import pytest
from fixture import taken
from our_drivers import bench_from
from plan_runs import shipped_bench
from variants import variant
from wires import HANG_UP, Wire, gaussmeter, no_thread_is_left  # noqa: F401

from station.cli.validating import read_plan_for
from station.errors import InstrumentError
from station.files.faults import FaultList

METER = ("gaussmeter", "rlg-magnetic-sensitivity", "sim-alternate")


def test_a_line_feed_alone_ends_an_answer_of_the_gaussmeter() -> None:
    with Wire((b"Lake Shore,F71,LSA1/2,1.0\n",)) as wire:
        instrument = gaussmeter(wire)
        assert instrument.identify().serial == "LSA1"
        instrument.close()


@pytest.mark.parametrize(
    "record",
    [
        b"rubbish",
        b"2026-01-01T00:00:00,1,2",
        b"yesterday,1e-3,1e-3,1e-3,1e-3,0,0",
        b"2026-01-01T00:00:00.1,1e-3,abc,1e-3,1e-3,0,0",
        b"2026-01-01T00:00:00.1,1e-3,nan,1e-3,1e-3,0,0",
        b"2026-01-01T00:00:00.1,1,1,1,1,0,0;2026-01-01T00:00:00.2+01:00,1,1,1,1,0,0",
    ],
)
def test_a_buffer_with_something_else_in_it_is_told(record: bytes) -> None:
    with Wire((b'"' + record + b';"\r\n',)) as wire:
        instrument = gaussmeter(wire)
        with pytest.raises(InstrumentError, match=r"read its buffer.*is no reading"):
            instrument.drain()
        instrument.close()


def test_a_buffer_that_was_lost_is_not_read_again() -> None:
    with Wire((HANG_UP,), (b'""\r\n',)) as wire:
        instrument = gaussmeter(wire)
        with pytest.raises(InstrumentError):
            instrument.drain()
        assert wire.requests == [b"FETC:BUFF:DC?\n"]
        instrument.close()


def test_the_probe_is_turned_once_and_only_its_axis_has_readings() -> None:
    with variant(*METER) as here:
        meter = here.driver()
        meter.turn_to("y")
        meter.turn_to("y")
        assert here.fixture.asked == ["turn-probe-y"]
        meter.start(1.5)
        rows = taken(here.fixture, meter, 5.0)
        assert np.isfinite(rows["y_T"]).all()
        assert np.isnan(rows["x_T"]).all() and np.isnan(rows["z_T"]).all()
        assert rows["y_T"] * 1e3 == pytest.approx(-0.004, abs=0.01)  # the ambient field


def test_the_gaussmeter_is_left_alone_for_30_ms_after_each_line() -> None:
    with variant(*METER) as here:
        meter = here.driver()
        meter.start(1.5)
        meter.drain()
        times_s = [time_s for time_s, direction, _ in here.fixture.heard if direction in "<>"]
        sent_s = [time_s for time_s, direction, _ in here.fixture.heard if direction == ">"]
        assert len(sent_s) > 8
        for next_s in sent_s[1:]:
            assert next_s - max(time_s for time_s in times_s if time_s < next_s) > 0.0299


def test_an_answer_of_before_is_told_and_so_is_a_turned_knob() -> None:
    fault = {"fault": "previous-reply", "command": "RDGFIELD", "nth": 3}
    with variant(*METER, fault) as here:
        meter = here.driver()
        meter.start(1.5)
        meter.drain()
        meter.drain()
        with pytest.raises(InstrumentError, match=r"read the field: (UNIT|RDGMODE)\? answers"):
            meter.drain()


def test_a_reading_beyond_the_range_is_marked() -> None:
    with variant(*METER, {"fault": "overload", "at": "2 s"}) as here:
        meter = here.driver()
        meter.start(1.5)
        rows = taken(here.fixture, meter, 5.0)
        assert rows["state"].tolist() == [0.0, 1.0, 1.0, 1.0, 1.0]
        assert meter.read_quantity("field") == np.inf


@pytest.mark.parametrize(
    ("forget", "setting", "said"),
    [
        (False, "parameters.excitation=simultaneous", "measures one axis at a time"),
        (True, "parameters.settle=20 s", "must state the uncertainty of the angle"),
    ],
)
def test_what_a_probe_of_one_axis_cannot_do_is_refused(
    forget: bool, setting: str, said: str
) -> None:
    data = shipped_bench("sim-alternate")
    if forget:
        del data["instruments"]["gaussmeter"]["calibration"]["uncertainty"][-1]
    with pytest.raises(FaultList, match=said):
        read_plan_for(METER[1], bench_from(data), (setting,))
