"""A bench file says what there is, what it may never exceed, and how well it measures."""

from __future__ import annotations

import datetime as dt
import socket
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from station import registry
from station.files.faults import nearest
from station.files.lookup import BENCHES, find
from station.files.validation import validate_model
from station.files.yaml.document import yaml_text
from station.files.yaml.reading import FaultList, read_yaml_text
from station.instruments.bench import Bench, bench_of, faults_of_use, read_bench
from station.instruments.calibration import Calibration, NotCalibrated

DRIVERS = ("bop", "f71", "pulse-board")

GOOD = """\
bench: 1
name: lab-2
instruments:
  gaussmeter:
    driver: f71
    address: TCPIP::192.0.2.7::7777::SOCKET
    serial: "0815"
    settings: {averaging: 100 ms}
    calibration:
      certificate: K-114
      date: 2026-01-31
      due: 2027-01-31
      uncertainty:
        - {quantity: field, up_to: 350 uT, relative: 0.1 %, absolute: 200 nT, coverage_factor: 2}
        - {quantity: field, from: 350 uT, up_to: 3.5 mT, relative: 0.5 %, coverage_factor: 2}
        - {quantity: temperature, from: 10 degC, up_to: 300 K, absolute: 1 K, coverage_factor: 2}
        - {quantity: scale, relative: 50 ppm, coverage_factor: 1}
      corrections:
        - {quantity: field, gain: 1.002, offset: 3 uT}
  coil_supply.x:
    driver: bop
    settings: {coil_constant: 0.25 mT/A}
    limits: {current: 8 A, voltage: 36 V, slew: 2 A/s, zero_current: 20 mA, field: 2000 uT}
safe_state:
  - {role: coil_supply, within: 30 s}
  - {instrument: gaussmeter, within: 1 min}
"""


def bench_from(text: str) -> Bench:
    return bench_of(read_yaml_text(text, Path("bench.yaml")), DRIVERS)


def faults_of(text: str) -> list[str]:
    with pytest.raises(FaultList) as caught:
        bench_from(text)
    return [str(fault).removeprefix("bench.yaml:") for fault in caught.value.faults]


def gaussmeter_calibration() -> Calibration:
    calibration = bench_from(GOOD).instruments["gaussmeter"].calibration
    assert calibration is not None
    return calibration


def test_a_bench_gives_its_instruments_limits_and_safe_state_in_order() -> None:
    bench = bench_from(GOOD)
    assert list(bench.instruments) == ["gaussmeter", "coil_supply.x"]
    assert bench.instruments["coil_supply.x"].limits == {
        "current": 8.0,
        "voltage": 36.0,
        "slew": 2.0,
        "zero_current": 0.02,
        "field": 2.0,
    }
    assert bench.instruments["gaussmeter"].serial == "0815"
    assert bench.safe_order() == [("coil_supply", 30.0), ("gaussmeter", 60.0)]
    assert bench.simulation is None


def test_a_simulated_world_is_handed_on_untouched() -> None:
    world = "simulation: {seed: 7, gyro: {sensitivity: [0.05 deg/h/mT], on: NO}}\n"
    bench = bench_from(GOOD + world)
    assert bench.simulation == {"seed": 7, "gyro": {"sensitivity": ["0.05 deg/h/mT"], "on": "NO"}}
    assert bench.data["simulation"] == bench.simulation


@pytest.mark.parametrize("name", ["sim", "sim-alternate"])
def test_a_resolved_bench_can_be_used(name: str, tmp_path: Path) -> None:
    """A guardian and a resumed run open instruments by it."""
    drivers = registry.names(registry.DRIVERS)
    shipped, again = read_bench(find(BENCHES, name), drivers), tmp_path / "bench.resolved.yaml"
    again.write_text(yaml_text(shipped.to_yaml_data()), encoding="utf-8")
    assert read_bench(again, drivers).file == shipped.file


def test_the_resolved_bench_reads_back_the_same() -> None:
    bench = bench_from(GOOD)
    assert bench_from(yaml_text(bench.to_yaml_data())).file == bench.file


def test_every_fault_of_a_bench_is_reported_at_once() -> None:
    faults = faults_of(
        "bench: 1\n"
        "name: x\n"
        "instruments:\n"
        "  coil_suply.x: {driver: bop}\n"
        "  gaussmeter: {driver: f17, serial: 0815, limits: {fild: 1 mT, current: -1 A}}\n"
        "  coil_supply.y:\n"
        "    driver: bop\n"
        "    limits: {current: 8 A, voltage: 36 mT, slew: 2 A/s}\n"
        "    settings: {coil_constant: 0.25 mT/A}\n"
        "    calibration:\n"
        "      due: soon\n"
        "      uncertainty: [{quantity: curent, relative: 1 %, coverage_factor: 2}]\n"
        "safe_state:\n"
        "  - {role: pump, within: 30 s}\n"
        "  - {instrument: gaussmeter, within: 30}\n"
        "  - {role: coil_supply, instrument: gaussmeter, within: 3 s}\n"
        "  - {instrument: gaussmeter, within: 3 s}\n"
    )
    assert faults == [
        "4:3: instruments.coil_suply.x: is no instrument that a procedure asks for; did you mean "
        "'coil_supply.x'",
        "5:24: instruments.gaussmeter.driver: there is no driver 'f17'; did you mean 'f71'; "
        "there are bop, f71, pulse-board",
        '5:37: instruments.gaussmeter.serial: must be text, not 815; did you mean "0815"',
        "5:52: instruments.gaussmeter.limits.fild: is not known here; did you mean 'field'",
        "5:73: instruments.gaussmeter.limits.current: must be above 0, not '-1 A'",
        "8:13: instruments.coil_supply.y.limits.zero_current: is missing; a coil_supply needs it",
        "8:37: instruments.coil_supply.y.limits.voltage: '36 mT' is a magnetic field, expected a "
        "voltage such as '5 V'",
        "11:12: instruments.coil_supply.y.calibration.due: must be a date such as 2027-01-31, not "
        "'soon'",
        "12:32: instruments.coil_supply.y.calibration.uncertainty[1].quantity: 'curent' is not "
        "known; did you mean 'current'",
        "14:12: safe_state[1].role: this bench has no role 'pump'; it has coil_suply, gaussmeter, "
        "coil_supply",
        "15:38: safe_state[2].within: 30 has no unit, expected a time such as '30 s'; did you mean "
        "'30 s'",
        "16:5: safe_state[3]: must name one instrument, or one role",
        "17:18: safe_state[4].instrument: 'gaussmeter' was named before; keep one step",
    ]


def test_a_bench_without_a_safe_state_is_refused() -> None:
    assert faults_of(GOOD[: GOOD.index("safe_state")]) == ["1:1: safe_state: is missing"]


def test_a_standard_uncertainty_is_the_stated_one_of_its_range_over_the_coverage_factor() -> None:
    calibration = gaussmeter_calibration()
    in_low_range = (0.1 * 0.001 + 0.0002) / 2
    assert calibration.standard_uncertainty("field", 0.1, "mT") == pytest.approx(in_low_range)
    assert calibration.standard_uncertainty("field", -2.0, "mT") == pytest.approx(0.005)
    assert calibration.standard_uncertainty("field", 0.002, "T") == pytest.approx(5e-6)
    assert calibration.standard_uncertainty("scale", 1.0, "1") == pytest.approx(50e-6)


def test_the_uncertainty_of_a_temperature_is_a_difference() -> None:
    calibration = gaussmeter_calibration()
    assert calibration.standard_uncertainty("temperature", 20.0, "degC") == pytest.approx(0.5)
    assert calibration.standard_uncertainty("temperature", 293.15, "K") == pytest.approx(0.5)
    assert not calibration.covers("temperature", -20.0, "degC")


@pytest.mark.parametrize(("quantity", "value", "unit"), [("field", 4.0, "mT"), ("current", 1, "A")])
def test_no_uncertainty_is_invented_where_the_record_states_none(
    quantity: str, value: float, unit: str
) -> None:
    calibration = gaussmeter_calibration()
    assert not calibration.covers(quantity, value, unit)
    with pytest.raises(NotCalibrated, match=f"K-114.*states no uncertainty of {quantity}"):
        calibration.standard_uncertainty(quantity, value, unit)


def test_a_correction_holds_for_numbers_and_arrays_in_any_unit_of_the_quantity() -> None:
    calibration = gaussmeter_calibration()
    assert calibration.corrected("field", 1.0, "mT") == pytest.approx(1.005)
    assert calibration.corrected("field", 1000.0, "uT") == pytest.approx(1005.0)
    assert calibration.corrected("voltage", 1.0, "V") == 1.0
    array = calibration.corrected("field", np.array([[0.0, 1.0]]), "mT")
    np.testing.assert_allclose(array, [[0.003, 1.005]])


def test_a_calibration_holds_on_its_due_date_and_not_after() -> None:
    calibration = gaussmeter_calibration()
    assert not calibration.overdue(dt.date(2027, 1, 31))
    assert calibration.overdue(dt.date(2027, 2, 1))
    assert calibration.source == "certificate K-114 of 2026-01-31"


@pytest.mark.parametrize(
    ("record", "sentence"),
    [
        ("{due: 2026-01-01, date: 2026-01-01}", "is not after the date of the calibration"),
        ("{due: 2026-01-01, uncertainty: [{quantity: field, relative: 1 %}]}", "is missing"),
        (
            "{due: 2026-01-01, uncertainty: [{quantity: field, coverage_factor: 2}]}",
            "states no uncertainty",
        ),
        (
            "{due: 2026-01-01, uncertainty: [{quantity: field, from: 2 mT, up_to: 1 mT, "
            "relative: 1 %, coverage_factor: 2}]}",
            "ends before it begins",
        ),
        (
            "{due: 2026-01-01, uncertainty: [{quantity: field, absolute: 1 V, "
            "coverage_factor: 2}]}",
            "'1 V' is a voltage, expected a magnetic field",
        ),
        (
            "{due: 2026-01-01, corrections: [{quantity: field}, {quantity: field}]}",
            "two corrections of field",
        ),
    ],
)
def test_a_calibration_record_that_makes_no_sense_is_refused(record: str, sentence: str) -> None:
    document = read_yaml_text(f"calibration: {record}\n", Path("bench.yaml"))
    with pytest.raises(FaultList, match=sentence):
        validate_model(document, Calibration, at=("calibration",))


LINES = """\
bench: 1
name: lab
instruments:
  multimeter: {{driver: keysight-34465a, address: "{0}"}}
  thermometer:
    driver: keysight-34465a-pt100
    settings: {{r0: 100 ohm}}
    address: "{1}"
safe_state: []
"""


def faults_of_use_of(text: str) -> list[str]:
    faults = faults_of_use(read_yaml_text(text, Path("bench.yaml")))
    return [str(fault).removeprefix("bench.yaml:") for fault in faults]


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("TCPIP::192.0.2.7::5025::SOCKET", "TCPIP::192.0.2.7::5025::SOCKET"),
        ("TCPIP::192.0.2.7::5025::SOCKET", "tcpip0::192.0.2.7::5025::socket"),
        ("TCPIP::192.0.2.7::5025::SOCKET", "socket://192.0.2.7:5025"),
        ("TCPIP::localhost::5025::SOCKET", "socket://127.0.0.1:5025"),
        ("TCPIP::meter.invalid::5025::SOCKET", "rfc2217://METER.invalid:5025"),
        ("GPIB::22", "GPIB0::22::INSTR"),
        ("USB::10893::257::MY1::INSTR", "USB0::0x2A8D::0x0101::MY1::0::INSTR"),
        ("{link}", "{port}"),
        ("ASRL{link}::INSTR", "{port}"),
    ],
)
def test_one_line_for_two_instruments_is_refused_in_any_spelling(
    one: str, other: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def looked_up(*arguments: object) -> NoReturn:
        pytest.fail("a host name was looked up")

    monkeypatch.setattr(socket, "getaddrinfo", looked_up)
    port, link = tmp_path / "ttyUSB0", tmp_path / "usb-FTDI-if00"
    port.touch()
    link.symlink_to(port)
    first, second = (text.format(port=port, link=link) for text in (one, other))
    (fault,) = faults_of_use_of(LINES.format(first, second))
    assert fault == (
        f"8:14: instruments.thermometer.address: is the address of multimeter, too, written there "
        f"'{first}'; give each instrument its own, or name what it is reached over in `shares`"
    )


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("GPIB::22", "GPIB::23"),
        ("GPIB0::22", "GPIB1::22"),
        ("TCPIP::192.0.2.7::5025::SOCKET", "TCPIP::192.0.2.7::5024::SOCKET"),
        ("TCPIP::127.0.0.1::5025::SOCKET", "TCPIP::127.0.0.2::5025::SOCKET"),
        ("TCPIP::192.0.2.7::gpib0,22::INSTR", "TCPIP::192.0.2.7::gpib0,23::INSTR"),
        ("hwgrep://SER=MY[1]", "hwgrep://SER=MY[2]"),
        ("socketcand://192.0.2.7/can0", "socketcand://192.0.2.7:29536/can0"),
    ],
)
def test_what_several_instruments_are_on_is_no_line_of_one(one: str, other: str) -> None:
    faults = faults_of_use_of(LINES.format(one, other))
    assert not any("is the address of" in fault for fault in faults)


@pytest.mark.parametrize(
    ("unit", "driver", "refused"),
    [("2", "watlow-f4", False), ("1", "watlow-f4", True), ("2", "ideal-aerosmith", True)],
)
def test_devices_of_a_modbus_line_are_distinguished_by_their_numbers(
    unit: str, driver: str, refused: bool
) -> None:
    faults = faults_of_use_of(
        "bench: 1\n"
        "name: lab\n"
        "instruments:\n"
        f"  thermal_chamber: {{driver: {driver}, address: /dev/ttyS7}}\n"
        "  cell_heater:\n"
        "    driver: watlow-f4\n"
        "    address: ASRL/dev/ttyS7::INSTR\n"
        f"    settings: {{unit: {unit}}}\n"
        "safe_state: []\n"
    )
    assert any("is the address of thermal_chamber, too" in fault for fault in faults) == refused


@pytest.mark.parametrize(
    ("instrument", "fault"),
    [
        (
            "interlock_chain: {driver: interlock-chain-shared, shares: [rotary_stage]}",
            "8:61: instruments.interlock_chain.shares: rotary_stage sees no contact of the chain; "
            "write shares: [turntable], shares: [thermal_chamber], or both",
        ),
        (
            "interlock_chain: {driver: interlock-chain-shared}",
            "8:20: instruments.interlock_chain.shares: it shares no line; write shares: "
            "[turntable], shares: [thermal_chamber], or both",
        ),
        (
            "dut_power: {driver: watlow-output-power, settings: {output: '2.1'}, shares: "
            "[rotary_stage]}",
            "8:79: instruments.dut_power.shares: rotary_stage is no Watlow F4T; share the chamber "
            "whose controller has the output, or give an address",
        ),
        (
            "multimeter: {driver: keysight-34465a, shares: [rotary_stage]}",
            "8:49: instruments.multimeter.shares: its driver has a line of its own; write its "
            "`address` in place of `shares`",
        ),
    ],
)
def test_shares_of_what_leads_nowhere_are_refused_as_a_run_refuses_them(
    instrument: str, fault: str
) -> None:
    stage = (
        "bench: 1\n"
        "name: lab\n"
        "instruments:\n"
        "  rotary_stage:\n"
        "    driver: ideal-aerosmith-stage\n"
        "    address: COM3\n"
        "    limits: {rate: 20 deg/s, acceleration: 40 deg/s^2}\n"
    )
    assert faults_of_use_of(f"{stage}  {instrument}\nsafe_state: []\n") == [fault]
    assert not faults_of_use_of(f"{stage}safe_state: []\n")


LAB = """\
bench: 1
name: lab
instruments:
  turntable:
    driver: ideal-aerosmith
    address: /dev/ttyUSB0
    settings: {axes: 3, outer_axis: 3, middle_axis: 2, inner_axis: 1}
    limits: {rate: 110 deg/s, acceleration: 50 deg/s^2}
  coil_supply.x:
    driver: kepco-bop-36-12
    address: TCPIP::192.0.2.11::5025::SOCKET
    settings: {coil_constant: 0.3 mT/A}
    limits: {current: 8 A, voltage: 30 V, slew: 2 A/s, zero_current: 20 mA}
  interlock_chain:
    driver: interlock-chain-shared
    shares: [turntable]
interlocks:
  - {name: coil, when: {instrument: coil_supply.x, quantity: current, above: 8.2 A}, grace: 0.4 s}
  - {name: rate, when: {instrument: turntable, quantity: rate, above: 115 deg/s}, grace: 0.4 s}
safe_state:
  - {role: turntable, within: 15 s}
  - {instrument: coil_supply.x, within: 30 s}
"""
SLIPS = {
    ("  turntable:\n", "  rate_table:\n"): "4:3: instruments.rate_table: is no instrument that a "
    "procedure asks for; did you mean 'turntable'",
    ("  coil_supply.x:\n", "  coil_supply:\n"): "9:3: instruments.coil_supply: is no instrument "
    "that a procedure asks for; did you mean 'coil_supply.x'",
    ("driver: ideal-aerosmith", "driver: ideal-aerosmith-stage"): "5:13: "
    "instruments.turntable.driver: the driver 'ideal-aerosmith-stage' cannot be a turntable; it "
    "can be rotary_stage",
    ("    address: /dev", "    Address: /dev"): "6:5: instruments.turntable.Address: is not known "
    "here; did you mean 'address'",
    ("    driver: kepco", "    Driver: kepco"): "10:5: instruments.coil_supply.x.Driver: is not "
    "known here; did you mean 'driver'",
    ("voltage: 30 V", "voltag: 30 V"): "13:28: instruments.coil_supply.x.limits.voltag: is not "
    "known here; did you mean 'voltage'",
    ("{name: coil,", "{name:coil,"): "18:6: interlocks[1].name:coil: is not known here; a blank is "
    "missing behind the colon; did you mean 'name'",
    ("    settings: {axes", "    moves_by: MOV\n    settings: {axes"): "7:5: "
    "instruments.turntable.moves_by: is not known here; did you mean 'settings.moves_by'",
    (
        "    limits: {rate: 110 deg/s, a",
        "    rate: 110 deg/s\n    limits: {rate: 110 deg/s, a",
    ): "8:5: instruments.turntable.rate: is not known here; did you mean 'limits.rate'",
    (
        "{axes: 3,",
        "{axes: 3, rate: 9 deg/s,",
    ): "7:25: instruments.turntable.settings.rate: there "
    "is no setting 'rate'; did you mean 'limits.rate'",
    ("shares: [turntable]", "shares: [turntable]\n    address: COM7"): "17:14: "
    "instruments.interlock_chain.address: has no effect beside `shares`; keep what the instrument "
    "is reached by",
}


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_of_the_pen_is_one_fault_at_its_place(slip: tuple[str, str]) -> None:
    drivers = registry.names(registry.DRIVERS)
    assert LAB.count(slip[0]) == 1
    bench_of(read_yaml_text(LAB, Path("bench.yaml")), drivers, bounded=True)
    with pytest.raises(FaultList) as caught:
        document = read_yaml_text(LAB.replace(*slip), Path("bench.yaml"))
        bench_of(document, drivers, bounded=True)
    assert [str(fault) for fault in caught.value.faults] == [f"bench.yaml:{SLIPS[slip]}"]


@pytest.mark.parametrize(
    ("model", "driver"),
    [("F71", "lakeshore-f71"), ("DAQ970A", "keysight-daq970a"), ("bop 36-12", "kepco-bop-36-12")],
)
def test_a_driver_is_named_by_its_model_where_only_one_has_it(model: str, driver: str) -> None:
    assert nearest(model, registry.names(registry.DRIVERS)) == driver
    assert nearest("keysight", registry.names(registry.DRIVERS)) != driver
