"""The simulated Kepco supply on its socket: what the manual allows, refuses and measures."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import pyvisa
from sim_bench import Line, served

from sim_instruments.bench import SimulatedBench
from station.clock import Clock, RealClock

CLEAN = '0,"No error"'


@pytest.fixture
def supply(bench: SimulatedBench, clock: Clock) -> Iterator[Line]:
    with Line(bench, "coil_supply.x", clock) as line:
        yield line


def energise(supply: Line, amperes: float) -> None:
    reply = supply.ask(f"FUNC:MODE CURR;:VOLT 30;:CURR:RANG 1;:CURR {amperes};:OUTP ON;:SYST:ERR?")
    assert reply == CLEAN


def upload(supply: Line, points: list[float], dwell_s: float, count: int) -> None:
    assert supply.ask("LIST:CLE;*OPC?") == "1"
    for first in range(0, len(points), 20):
        part = ",".join(f"{point:.5f}" for point in points[first : first + 20])
        assert supply.ask(f"LIST:CURR {part};*OPC?") == "1"
    assert supply.ask(f"LIST:DWEL {dwell_s};COUN {count};:SYST:ERR?") == CLEAN


def test_it_names_maker_card_rating_and_serial(supply: Line) -> None:
    assert supply.ask("*IDN?").split(",")[0] == "KEPCO"
    assert "36-12" in supply.ask("*IDN?") and "H148201" in supply.ask("*idn?")


def test_short_long_and_rooted_headers_mean_the_same(supply: Line) -> None:
    energise(supply, 2.0)
    for header in ("CURR?", "current?", ":SOUR:CURR:LEV:IMM:AMP?", "SOURCE:CURRENT:LEVEL?"):
        assert float(supply.ask(header)) == pytest.approx(2.0, abs=1e-3)
    assert supply.ask("CURRE?;:SYST:ERR?").startswith("-113")


def test_a_header_after_a_semicolon_continues_where_the_last_one_stood(supply: Line) -> None:
    assert len(supply.ask("MEAS:CURR?;VOLT?").split(";")) == 2
    assert supply.ask("LIST:COUN 7;COUN?") == "7"
    assert supply.ask("LIST:COUN 7;OUTP?;:SYST:ERR?").startswith("-113")


def test_a_set_point_comes_back_as_the_converter_made_it(supply: Line) -> None:
    energise(supply, 1.5)
    back = float(supply.ask("CURR?"))
    assert back != 1.5
    assert back == pytest.approx(1.5, abs=12 / 2**15)


def test_the_measured_current_follows_the_set_point_with_calibration_errors(
    supply: Line, clock: Clock
) -> None:
    energise(supply, 2.0)
    clock.sleep(1.0)
    measured = np.array([float(supply.ask("MEAS:CURR?")) for _ in range(50)])
    driven_A = 2.0 * 1.0005 + 3e-4
    assert measured.mean() == pytest.approx(driven_A * 0.9997 - 5e-4, abs=5e-4)
    assert 5e-5 < measured.std() < 5e-4
    assert float(supply.ask("MEAS:VOLT?")) == pytest.approx(driven_A * 1.2, abs=5e-3)


def test_the_coil_delays_the_current(supply: Line, clock: Clock) -> None:
    began_s = clock.now()
    energise(supply, 2.0)
    # The read-back is the mean over the filter's 5 ms before the query; the time constant is 15 ms.
    after = (clock.now() - began_s) / 0.015
    expected = 2.0 * (1 - np.exp(-after) * (np.exp(1 / 3) - 1) * 3)
    assert float(supply.ask("MEAS:CURR?")) == pytest.approx(expected, abs=0.01)


def test_out_of_range_values_are_refused_and_ignored(supply: Line) -> None:
    energise(supply, 1.0)
    assert supply.ask("CURR 12.5;:SYST:ERR?").startswith("-222")
    assert supply.ask("CURR -13;:SYST:ERR?").startswith("-222")
    assert float(supply.ask("CURR?")) == pytest.approx(1.0, abs=1e-3)
    assert float(supply.ask("CURR? MAX")) == 12.0 and float(supply.ask("CURR? MIN")) == -12.0


@pytest.mark.parametrize("limit", ["CURR:LIM 3", "CURR:LIM:POS 3;NEG 3", "CURR:LIM:HIGH 3;LOW 3"])
def test_its_own_current_limit_narrows_the_range(supply: Line, limit: str) -> None:
    energise(supply, 0.0)
    assert supply.ask(f"{limit};:CURR 3.1;:SYST:ERR?").startswith("-222")
    assert supply.ask("CURR -3.1;:SYST:ERR?").startswith("-222")
    assert supply.ask("LIST:CURR 0,1,3.5;:SYST:ERR?").startswith("-222")
    assert supply.ask("CURR 2.9;:SYST:ERR?") == CLEAN
    assert [float(text) for text in supply.ask("CURR:LIM?").split(",")] == [3.0, 3.0]


def test_a_protection_switches_the_output_off_and_says_so(supply: Line, clock: Clock) -> None:
    energise(supply, 1.0)
    assert supply.ask("CURR:PROT 2;:CURR 2.5;:OUTP?") == "0"
    assert int(supply.ask("STAT:QUES:COND?")) & 8192
    clock.sleep(1.0)
    assert abs(float(supply.ask("MEAS:CURR?"))) < 0.005
    assert supply.ask("CURR 0;:OUTP ON;:STAT:QUES:COND?") == "0"


def test_the_compliance_voltage_limits_the_current(supply: Line, clock: Clock) -> None:
    energise(supply, 5.0)
    assert int(supply.ask("STAT:OPER:COND?")) & 1024
    supply.ask("VOLT 2.4;*OPC?")
    clock.sleep(0.5)
    assert float(supply.ask("MEAS:CURR?")) == pytest.approx(2.0, abs=0.01)
    assert int(supply.ask("STAT:OPER:COND?")) & 256


def test_output_off_lets_the_current_decay(supply: Line, clock: Clock) -> None:
    energise(supply, 3.0)
    clock.sleep(1.0)
    assert supply.ask("OUTP OFF;OUTP?") == "0"
    clock.sleep(0.2)
    assert abs(float(supply.ask("MEAS:CURR?"))) < 0.003


def test_a_message_of_254_characters_is_refused_whole(supply: Line) -> None:
    fits = "LIST:CURR " + ",".join(["0.5"] * 58)
    assert supply.ask(fits.ljust(253 - 6) + ";*OPC?") == "1"
    assert supply.ask("LIST:CURR:POIN?") == "58"
    supply.write(fits.ljust(254))
    assert supply.ask("SYST:ERR?").startswith("-363")
    assert supply.ask("LIST:CURR:POIN?") == "58"


def test_a_list_holds_1002_points_and_shows_16_at_a_time(supply: Line) -> None:
    energise(supply, 0.0)
    upload(supply, [k / 1000 for k in range(1000)], 0.01, 1)
    assert supply.ask("LIST:CURR 1,1,1;:SYST:ERR?").startswith("-223")
    assert supply.ask("LIST:CURR 1,1;CURR:POIN?") == "1002"
    shown = supply.ask("LIST:QUER 500;CURR?").split(",")
    assert len(shown) == 16
    assert float(shown[0]) == pytest.approx(0.5, abs=1e-3)


def test_lists_that_do_not_fit_together_are_refused(supply: Line) -> None:
    energise(supply, 0.0)
    assert supply.ask("CURR:MODE LIST;:SYST:ERR?").startswith("-221")
    assert supply.ask("LIST:CURR 0,1,2;VOLT 1;:SYST:ERR?").startswith("-221")
    assert supply.ask("CURR:MODE LIST;:SYST:ERR?").startswith("-226")
    assert supply.ask("LIST:DWEL 0.1,0.2;:CURR:MODE LIST;:SYST:ERR?").startswith("-226")
    assert supply.ask("LIST:DWEL 0.3;:CURR:MODE LIST;:SYST:ERR?") == CLEAN


@pytest.mark.parametrize("dwell", ["0.0004", "10.1"])
def test_dwell_times_have_limits(supply: Line, dwell: str) -> None:
    assert supply.ask(f"LIST:DWEL {dwell};:SYST:ERR?").startswith("-222")


def test_list_commands_are_refused_while_the_list_runs(supply: Line) -> None:
    energise(supply, 0.0)
    upload(supply, [0.0, 1.0], 1.0, 0)
    assert supply.ask("CURR:MODE LIST;:CURR:MODE?") == "LIST"
    assert int(supply.ask("STAT:OPER:COND?")) & 16384
    for refused in ("LIST:CLE", "LIST:COUN 3", "LIST:CURR 1", "CURR 1", "FUNC:MODE VOLT"):
        assert supply.ask(f"{refused};:SYST:ERR?").startswith("-221")
    assert supply.ask("LIST:CURR:POIN?") == "2"


def test_a_stopped_list_leaves_the_fixed_set_point(supply: Line, clock: Clock) -> None:
    energise(supply, 0.5)
    upload(supply, [2.0, 2.0], 5.0, 0)
    supply.ask("CURR:MODE LIST;*OPC?")
    clock.sleep(1.0)
    assert float(supply.ask("MEAS:CURR?")) == pytest.approx(2.0, abs=0.01)
    supply.ask("CURR:MODE FIX;*OPC?")
    clock.sleep(0.3)
    assert float(supply.ask("MEAS:CURR?")) == pytest.approx(0.5, abs=0.01)


def test_the_list_ends_after_its_count_on_its_own_slower_time_base(
    supply: Line, clock: Clock
) -> None:
    energise(supply, 0.0)
    upload(supply, [1.0] * 10, 10.0, 20)
    begin_s = clock.now()
    supply.ask("CURR:MODE LIST;*OPC?")
    clock.sleep_until(begin_s + 2000.0 + 0.09)
    assert supply.ask("CURR:MODE?") == "LIST"
    clock.sleep_until(begin_s + 2000.0 + 0.11)
    assert supply.ask("CURR:MODE?") == "FIX"
    # It must be armed again.
    clock.sleep(5.0)
    assert abs(float(supply.ask("MEAS:CURR?"))) < 0.005
    assert supply.ask("CURR:MODE LIST;:CURR:MODE?") == "LIST"


def test_a_list_walks_down_or_in_its_own_sequence(supply: Line, clock: Clock) -> None:
    energise(supply, 0.0)
    upload(supply, [1.0, 2.0, 3.0], 1.0, 1)

    def walk() -> list[int]:
        supply.ask("CURR:MODE LIST;*OPC?")
        seen = []
        for _ in range(3):
            clock.sleep(0.9)
            seen.append(round(float(supply.ask("MEAS:CURR?"))))
            clock.sleep(0.1)
        clock.sleep(1.0)
        return seen

    assert walk() == [1, 2, 3]
    supply.ask("LIST:DIR DOWN;*OPC?")
    assert walk() == [3, 2, 1]
    supply.ask("LIST:DIR UP;SEQ 1,1,0;GEN SEQ;*OPC?")
    assert walk() == [2, 2, 1]


def test_a_transient_returns_by_itself(supply: Line, clock: Clock) -> None:
    energise(supply, 0.5)
    clock.sleep(1.0)
    assert supply.ask("CURR:MODE TRAN 0.5;:CURR 2;:SYST:ERR?") == CLEAN
    clock.sleep(0.4)
    assert float(supply.ask("MEAS:CURR?")) == pytest.approx(2.0, abs=0.01)
    clock.sleep(0.4)
    assert float(supply.ask("MEAS:CURR?")) == pytest.approx(0.5, abs=0.01)
    assert supply.ask("CURR:MODE?") == "FIX"


def test_errors_queue_first_in_first_out_and_set_the_event_register(supply: Line) -> None:
    supply.ask("NONSENSE;:CURR x;:CURR 99;*OPC?")
    codes = [supply.ask("SYST:ERR?").split(",")[0] for _ in range(4)]
    assert codes == ["-113", "-120", "-222", "0"]
    assert int(supply.ask("*ESR?")) == 32 + 16
    assert supply.ask("*ESR?") == "0"


def test_a_full_error_queue_says_so_and_clears(supply: Line) -> None:
    for _ in range(30):
        supply.ask("NONSENSE;*OPC?")
    entries = [supply.ask("SYST:ERR?").split(",")[0] for _ in range(21)]
    assert entries == ["-113"] * 19 + ["-350", "0"]
    supply.ask("NONSENSE;*OPC?")
    assert supply.ask("*CLS;SYST:ERR?") == CLEAN


def test_several_clients_share_the_supply(bench: SimulatedBench, clock: Clock) -> None:
    with Line(bench, "coil_supply.y", clock) as first:
        assert first.ask("FUNC:MODE CURR;:FUNC:MODE?") == "1"
    with Line(bench, "coil_supply.y", clock) as second:
        assert second.ask("FUNC:MODE?") == "1"


def test_pyvisa_talks_to_it_in_real_time() -> None:
    with served(RealClock()) as simulation:
        manager = pyvisa.ResourceManager("@py")
        supply = manager.open_resource(
            simulation.instruments["coil_supply.z"]["address"],
            read_termination="\n",
            write_termination="\n",
        )
        assert supply.query("*IDN?").startswith("KEPCO")
        supply.write("FUNC:MODE CURR;:VOLT 20;:CURR 1;:OUTP ON")
        assert float(supply.query("CURR?")) == pytest.approx(1.0, abs=1e-3)
        supply.close()
        manager.close()
