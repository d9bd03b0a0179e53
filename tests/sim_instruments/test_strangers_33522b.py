"""What other programs send a Keysight 33522B every day, and what the unit answers."""

from __future__ import annotations

import struct

import pytest
from generator_fixture import standing

from drivers.keysight.generator_33522b import Keysight33522B


def floats(answer: str) -> list[float]:
    return [float(one) for one in answer.split(";")]


def test_apply_sets_everything_and_is_answered_in_quotes() -> None:
    with standing() as here, here.line() as line:
        line.write("APPL:SIN 5.0E3,3.0,-2.5")
        assert line.ask("APPL?") == (
            '"SIN +5.0000000000000E+03,+3.0000000000000E+00,-2.5000000000000E+00"'
        )
        assert line.ask("FUNC?;:FREQ?;:VOLT?;:VOLT:OFFS?;:OUTP?").split(";")[::4] == ["SIN", "1"]
        line.write("SOUR2:APPL:DC DEF,DEF,1.5")
        assert line.ask("SOUR2:FUNC?;:OUTP2?") == "DC;1"
        assert here.room.volts("y", here.clock.now()) == [pytest.approx(3.0)]
        line.write("APPL:SIN 1e3,1,1,1")
        assert line.ask("SYST:ERR?").startswith("-108")


def test_values_shown_are_rescaled_by_the_load_without_an_error() -> None:
    with standing() as here, here.line() as line:
        line.write("VOLT 2;:VOLT:OFFS 1;:OUTP:LOAD INF")
        assert floats(line.ask("VOLT?;:VOLT:OFFS?")) == [4.0, 2.0]
        line.write("OUTP:LOAD 50")
        assert floats(line.ask("VOLT?;:VOLT:OFFS?")) == [2.0, 1.0]
        assert line.ask("SYST:ERR?") == '+0,"No error"'


@pytest.mark.parametrize(("load", "largest_V"), [("50", 5.0), ("INF", 10.0)])
def test_offset_and_half_the_amplitude_stay_within_what_the_load_allows(
    load: str, largest_V: float
) -> None:
    with standing() as here, here.line() as line:
        line.write(f"OUTP:LOAD {load};:VOLT 2;:VOLT:OFFS {largest_V}")
        offset_V, amplitude_V = floats(line.ask("VOLT:OFFS?;:VOLT?"))
        assert abs(offset_V) + amplitude_V / 2 <= largest_V * 1.001
        assert line.ask("SYST:ERR?").startswith("-2")


def test_the_error_queue_holds_20_and_outlives_a_reset() -> None:
    with standing() as here, here.line() as line:
        for _ in range(25):
            line.write("NONSENSE 1")
        line.write("*RST")
        errors = [line.ask("SYST:ERR?").partition(",")[0] for _ in range(21)]
        assert errors == ["-113"] * 19 + ["-350", "+0"]


@pytest.mark.parametrize("words", ["No error", "No errors in queue"])
@pytest.mark.parametrize("maker", ["Agilent Technologies", "Keysight Technologies"])
def test_the_driver_takes_either_maker_and_either_wording(maker: str, words: str) -> None:
    with standing(maker=maker, empty_queue=words) as here:
        generator = Keysight33522B(here.place())
        assert generator.identify().maker == maker
        generator.hold(1, 0.5)
        assert here.room.volts("x", here.clock.now()) == [pytest.approx(0.5)]
        generator.make_safe(here.clock.now() + 1.0)
        generator.close()


@pytest.mark.parametrize(
    ("header", "value"),
    [
        ("PHAS", "-90"), ("FUNC:SQU:DCYC", "20"), ("FUNC:RAMP:SYMM", "50"),
        ("FUNC:PULS:PER", "2e-3"), ("FUNC:PULS:WIDT", "2e-4"), ("FUNC:PULS:DCYC", "25"),
        ("FUNC:PULS:TRAN", "2e-8"), ("FUNC:PULS:TRAN:LEAD", "2e-8"),
        ("FUNC:PULS:TRAN:TRA", "2e-8"), ("SWE:TIME", "3"), ("FREQ:STAR", "10"),
        ("FREQ:STOP", "20"), ("BURS:INT:PER", "0.5"), ("SOUR2:PHAS", "45"),
        ("TRIG:TIM", "0.3"), ("TRIG2:COUN", "7"),
    ],
)  # fmt: skip
def test_what_is_set_is_answered(header: str, value: str) -> None:
    with standing() as here, here.line() as line:
        assert line.ask(f"{header} {value};:SYST:ERR?") == '+0,"No error"'
        assert float(line.ask(f"{header}?")) == pytest.approx(float(value))
        line.write("*RST")
        assert float(line.ask(f"{header}?")) != pytest.approx(float(value))


@pytest.mark.parametrize(
    ("header", "word", "default"),
    [
        ("BURS:GATE:POL", "INV", "NORM"),
        ("SOUR2:FUNC:ARB:ADV", "TRIG", "SRAT"),
        ("OUTP:TRIG", "1", "0"),
        ("OUTP:TRIG:SLOP", "NEG", "POS"),
        ("OUTP:TRIG:SOUR", "CH2", "CH1"),
    ],
)
def test_a_word_is_kept_until_a_reset(header: str, word: str, default: str) -> None:
    with standing() as here, here.line() as line:
        assert line.ask(f"{header}?") == default
        assert line.ask(f"{header} {word};:{header}?") == word
        assert line.ask(f"*RST;:{header}?;:SYST:ERR?") == f'{default};+0,"No error"'


@pytest.mark.parametrize(
    ("message", "query", "kept", "end"),
    [
        ("FUNC:SQU:DCYC 100", "FUNC:SQU:DCYC?", 99.99, "upper"),
        ("FREQ 10e6;:FUNC:SQU:DCYC 1", "FUNC:SQU:DCYC?", 16.0, "lower"),
        ("FREQ 40e6", "FREQ?", 30e6, "upper"),
        ("FREQ 0", "FREQ?", 1e-6, "lower"),
        ("FUNC:PULS:WIDT 2e-3", "FUNC:PULS:WIDT?", 1e-3 - 16e-9, "upper"),
        ("FUNC:PULS:WIDT 1e-9", "FUNC:PULS:WIDT?", 16e-9, "lower"),
        ("FUNC:PULS:PER 2e6", "FUNC:PULS:PER?", 1e6, "upper"),
        ("FUNC:PULS:TRAN 2e-6", "FUNC:PULS:TRAN?", 1e-6, "upper"),
        ("FUNC:PULS:TRAN:LEAD 1e-9", "FUNC:PULS:TRAN:LEAD?", 8.4e-9, "lower"),
        ("FUNC:PULS:WIDT 40e-9;:FUNC:PULS:TRAN 30e-9", "FUNC:PULS:TRAN?", 25e-9, "upper"),
        ("PHAS 400", "PHAS?", 360.0, "upper"),
        ("BURS:NCYC 0", "BURS:NCYC?", 1.0, "lower"),
        ("TRIG1:DEL 2000", "TRIG1:DEL?", 1000.0, "upper"),
        ("OUTP:LOAD 20e3", "OUTP:LOAD?", 10e3, "upper"),
    ],
)
def test_a_number_beyond_its_limits_is_clipped_and_changed(
    message: str, query: str, kept: float, end: str
) -> None:
    with standing() as here, here.line() as line:
        line.write(message)
        assert line.ask("SYST:ERR?") == f'-222,"Data out of range;value clipped to {end} limit"'
        assert line.ask("SYST:ERR?").startswith("+0")
        assert float(line.ask(query)) == pytest.approx(kept)


def test_edges_and_duty_cycle_give_way_to_a_pulse_and_a_period() -> None:
    with standing() as here, here.line() as line:
        line.write("FUNC PULS;:FUNC:PULS:TRAN 1e-7;:FUNC:PULS:WIDT 4e-8")
        assert line.ask("SYST:ERR?").startswith("-221")
        assert float(line.ask("FUNC:PULS:TRAN:TRA?")) == pytest.approx(2.5e-8)
        line.write("*RST;:FUNC SQU;:FUNC:SQU:DCYC 5;:FREQ 20e6")
        assert line.ask("SYST:ERR?").startswith("-221")
        assert float(line.ask("FUNC:SQU:DCYC?")) == pytest.approx(32.0)


def test_words_of_sync_and_sweep_are_answered() -> None:
    with standing() as here, here.line() as line:
        line.write("OUTP:SYNC OFF;:OUTP:SYNC:SOUR CH2;:OUTP2:SYNC:MODE CARR;:OUTP:SYNC:POL INV")
        assert line.ask("OUTP:SYNC?;:OUTP:SYNC:SOUR?;:OUTP2:SYNC:MODE?;:OUTP:SYNC:POL?") == (
            "0;CH2;CARR;INV"
        )
        line.write("BURS:STAT ON;:SWE:SPAC LOG;:SWE:STAT ON")
        assert line.ask("SWE:STAT?;:SWE:SPAC?;:BURS:STAT?") == "1;LOG;0"
        assert line.ask("PHAS:SYNC;:SYST:BEEP;:SYST:ERR?") == '+0,"No error"'


def test_a_waveform_of_170_kB_in_one_line_arrives_whole() -> None:
    with standing() as here, here.line() as line:
        values = ",".join(f"{k % 1000 / 1000:.5f}" for k in range(21_250))
        assert len(values) > 169_000
        line.write(f"SOUR1:DATA:ARB long,{values}")
        assert line.ask("FUNC:ARB long;:FUNC ARB;:SYST:ERR?") == '+0,"No error"'
        assert len(here.simulator._channels[1].wave._memory["LONG"]) == 21_250


def test_a_block_of_bytes_may_hold_the_end_of_a_line() -> None:
    with standing() as here, here.line() as line:
        counts = [0, 0x0A0A, 0x3B2C, -1, 0x2322, 32767, -32767, 0x0A]
        block = struct.pack(">8h", *counts)
        assert block.count(b"\n") == 3
        line._send(b"SOUR1:DATA:ARB:DAC bytes,#216" + block + b"\n")
        assert line.ask("SYST:ERR?") == '+0,"No error"'
        kept = here.simulator._channels[1].wave._memory["BYTES"] * 32767
        assert kept.tolist() == pytest.approx(counts)
        line._send(b"SOUR1:DATA:ARB:DAC odd,#217" + block + b"x\n")
        assert line.ask("SYST:ERR?").startswith("-161")


def test_a_line_beyond_the_input_ends_in_an_error_and_the_next_one_counts() -> None:
    with standing() as here, here.line() as line:
        here.simulator._server._longest = 1000
        line.write(f"DATA:ARB long,{','.join(['0.5'] * 500)}")
        assert line.ask("SYST:ERR?").startswith("-363")
        assert "LONG" not in line.ask("DATA:VOL:CAT?")
