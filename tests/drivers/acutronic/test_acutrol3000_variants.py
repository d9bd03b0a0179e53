"""The turntable's driver against each form in which a controller may answer."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from table_bench import AXIS, LIMITED, LIMITS, TABLE, table_bench
from variants import variant

from drivers.acutronic.prefix import Prefix, prefix_of
from station.errors import InstrumentError

PROCEDURE = "fog-scale-factor-temperature"
WITH_MODE, WITHOUT_MODE = (
    f"limits of trip and position {one} a mode" for one in ("with", "without")
)


@pytest.mark.parametrize("framing", ["framed", "line"])
@pytest.mark.parametrize("error_form", ["colon", "comma"])
@pytest.mark.parametrize("empty_queue", ["nothing", "zero", "no-error"])
def test_an_empty_queue_and_an_error_are_taken_in_every_form(
    framing: str, empty_queue: str, error_form: str
) -> None:
    truth = {"framing": framing, "empty_queue": empty_queue, "error_form": error_form}
    with table_bench(truth) as bench:
        table = bench.driver()
        with pytest.raises(InstrumentError, match=r"error 6, AXIS NOT SERVOED"):
            table._line.command(":Mode 1,Rate")
        table._line.command(":Demand:Rate 1,0")
        table.programme_limits()


@pytest.mark.parametrize("commands_answer", ["ok", "line-end"])
@pytest.mark.parametrize("prefix", ["digits", "high-byte-first", "low-byte-first"])
def test_the_prefix_that_is_met_is_noted(prefix: str, commands_answer: str) -> None:
    truth = {"prefix": prefix, "commands_answer": commands_answer}
    with variant(TABLE, PROCEDURE, **truth) as here:
        table = here.driver()
        assert table.identify().serial == "A3-0117"
        table.programme_limits()
        coded = "digits" if prefix == "digits" else f"32-bit words, {prefix.replace('-', ' ')}"
        assert here.met() == [f"prefix of answers in {coded}", WITH_MODE]
        with pytest.raises(InstrumentError, match="it refused"):
            table._line.command(":Demand:Rate 7,1")
        table.make_safe(here.clock.now() + 10.0)
        assert table.read_safety().safe


def test_words_have_the_byte_order_in_which_the_length_is_possible() -> None:
    for length in (1, 130, 256, 32768):
        for order, name in ((">", "high"), ("<", "low")):
            found = prefix_of(struct.pack(f"{order}II", 5, length))
            assert found == Prefix(5, length, f"32-bit words, {name} byte first")
    assert prefix_of(struct.pack("<II", 5, 0)) == Prefix(5, 0, "32-bit words, low byte first")
    assert prefix_of(b"00070012") == Prefix(7, 12, "digits")
    assert prefix_of(b"Acutroni") is None
    assert prefix_of(struct.pack(">II", 5, 32769)) is None


@pytest.mark.parametrize(
    ("limits_by", "met"), [("either", WITH_MODE), ("mode", WITH_MODE), ("axis", WITHOUT_MODE)]
)
def test_limits_are_proved_with_a_mode_or_without(limits_by: str, met: str) -> None:
    truth = {"axis_1": LIMITED, "limits_by": limits_by, "absolute_limits": 7}
    limits = {**LIMITS, "angle_low": -95.0, "angle_high": 95.0}
    with table_bench(truth) as bench:
        table, noted = bench.driver(limits, continuous=[2, 3]), []
        table._limits._met = noted.append
        table.programme_limits()
        assert set(noted) == {met}
        served: Any = bench.simulation._served[TABLE]
        for mode in ("POSITION", "RATE"):
            one, other = served.axes[1].limits[mode], served.axes[2].limits[mode]
            assert (one.low_deg, one.high_deg) == (-95.0, 95.0)
            assert one.velocity_trip == pytest.approx(121.0)
            assert other.high_deg == float("inf"), "of an axis that turns for ever none is written"
        sent = [data for direction, data in bench.heard if direction == ">"]
        tried = sum(b":Limit:VTR P," in data for data in sent)
        assert tried == (1 if limits_by == "axis" else 3), "what is not taken is tried once"


def test_a_limit_that_another_program_holds_is_no_limit() -> None:
    with table_bench({"absolute_limits": 6}) as bench:
        served: Any = bench.simulation._served[TABLE]
        table = bench.driver()
        keep = served._language._acts["LIMIT", "RATE"]
        served._language._acts["LIMIT", "RATE"] = lambda given: keep([*given[:2], "50.0"])
        served._language._known.clear()
        with pytest.raises(InstrumentError, match=r"set Limit:Rate P,1 to 110: 50 reads back"):
            table.programme_limits()


@pytest.mark.parametrize("decimals", [1, 3, 5])
def test_numbers_agree_within_half_of_the_last_printed_digit(decimals: int) -> None:
    limits = {"rate": 33.333333, "acceleration": 7.777777}
    with table_bench({"decimals": decimals, "rate_noise": "0 deg/s"}) as bench:
        table = bench.homed(limits=limits)
        table.turn(1, 12.345678)
        bench.wait_for_rate(table)
        assert table.rate_deg_per_s(1) == pytest.approx(12.345678, abs=0.51 * 10.0**-decimals)
        value, half_digit = table._line.printed("?", f"{12.345678:.{decimals}f}")
        assert abs(value - 12.345678) <= half_digit == 0.5 * 10.0**-decimals
        with pytest.raises(InstrumentError, match="read back"):
            table._line.verify(1, "Rate", 12.345678 + 2.0 * 10.0**-decimals, "Rate")


@pytest.mark.parametrize("bit", [2, 12])
def test_a_tracking_fault_is_named_in_either_bit(bit: int) -> None:
    fault = {"fault": "following-error", "at": "20 s", "for": "5 s"}
    with table_bench({"tracking_bit": bit}, fault) as bench:
        table = bench.homed()
        bench.clock.sleep_until(18.0)
        table.turn(1, 100.0)
        bench.clock.sleep_until(24.0)
        with pytest.raises(InstrumentError, match=rf"following error.*faults {1 << bit}\b"):
            bench.wait_for_rate(table)


@pytest.mark.parametrize(
    ("mode_home", "why"), [("ignored", "after that, not zero"), ("refused", "UNKNOWN COMMAND")]
)
def test_a_search_that_did_not_end_at_zero_homes_nothing(mode_home: str, why: str) -> None:
    with table_bench({"mode_home": mode_home, "axis_1": AXIS}) as bench:
        table = bench.driver(zero="search")
        table.home(1)
        with pytest.raises(InstrumentError, match=why):
            bench.wait(table)
        assert not table.is_homed(1)
