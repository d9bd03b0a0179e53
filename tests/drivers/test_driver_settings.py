"""Settings are held against the driver's model, interlocks against what the driver reads."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

import pytest
from command_line import station
from pydantic import Field, field_validator

from station import registry
from station.cli.validating import validate_plans
from station.clock import RealClock
from station.driver_checks import (
    driver_faults,
    keys_of,
    role_faults,
    settings_of,
    settings_of_role,
)
from station.errors import InstrumentError, QuantityNotRead
from station.fields import Second, StrictModel
from station.files.faults import FaultList
from station.files.lookup import BENCHES, find
from station.files.yaml.document import Document
from station.files.yaml.reading import read_yaml_text
from station.instruments.addresses import why_unknown
from station.instruments.bench import Bench, bench_of, faults_of_use
from station.instruments.opening import InstrumentPlace
from station.roles import Driver, DriverSettings
from station.roles.role import kind_of, quantities_of, roles, roles_of

PLAN = "fog-scale-factor-temperature"
DRIVERS = {
    name: registry.load(registry.DRIVERS, name)
    for name in registry.names(registry.DRIVERS)
    if registry.load(registry.DRIVERS, name).__module__.startswith("drivers.")
}


def bench_file(folder: Path, old: str, new: str) -> Path:
    """Write the shipped bench with one text replaced."""
    text = find(BENCHES, "sim").read_text(encoding="utf-8")
    assert text.count(old) == 1, old
    path = folder / "bench.yaml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


def document_of(name: str, driver: str, settings: Mapping[str, Any], watched: str = "") -> Document:
    """Return a bench file of one instrument, and an interlock on one of its quantities."""
    lines = ["bench: 1", "name: lab", "instruments:", f"  {name}:", f"    driver: {driver}"]
    lines += [f"    settings: {json.dumps(settings)}"]
    if watched:
        kind = kind_of(name, watched)
        test = f"equals: {kind.states[0]}" if kind.states else f"above: 1 {kind.unit}"
        when = f"{{instrument: {name}, quantity: {watched}, {test}}}"
        lines += ["interlocks:", f"  - {{name: a, when: {{any: [{{not: {when}}}]}}}}"]
    return read_yaml_text("\n".join((*lines, "safe_state: []", "")), Path("bench.yaml"))


def said(document: Document) -> list[str]:
    return [str(fault) for fault in driver_faults(document)]


def test_dor_in_place_of_door_is_refused_with_line_and_column_and_the_words_expected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bench_file(tmp_path, ', door: "2.2"}', ', dor: "2.2"}')
    assert validate_plans([PLAN], str(path)) == 2
    line = next(
        number
        for number, text in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if "dor:" in text
    )
    (fault,) = capsys.readouterr().err.splitlines()
    assert fault == (
        f"{path}:{line}:70: instruments.thermal_chamber.settings.dor: there is no setting 'dor'; "
        "did you mean 'door'; this driver knows loop, ramp, alarms, limit_modules, door, "
        "baud_rate, data_bits, parity, stop_bits, hardware_handshake, unit, word_order"
    )


def test_a_run_refuses_it_before_anything_is_opened(tmp_path: Path) -> None:
    bench_file(tmp_path, ', door: "2.2"}', ', dor: "2.2"}')
    done = station(tmp_path, "run", PLAN, "--bench", "bench.yaml", "--non-interactive")
    assert done.returncode == 2
    assert "there is no setting 'dor'" in done.stderr
    assert [one.name for one in tmp_path.iterdir()] == ["bench.yaml"]


def test_a_record_of_before_is_read_and_its_resumption_refused() -> None:
    wrong = document_of("thermal_chamber", "watlow-f4t", {"dor": "2.2"})
    wrong.data["instruments"]["thermal_chamber"]["limits"] = {
        "temperature_low": "1 degC",
        "temperature_high": "2 degC",
    }
    recorded: Bench = bench_of(wrong, registry.names(registry.DRIVERS))
    assert any("'dor'" in str(fault) for fault in faults_of_use(recorded.document))


@pytest.mark.parametrize(
    ("name", "driver", "settings", "fault"),
    [
        ("multimeter", "keysight-34465a", {"auto_zero": "yes"}, "auto_zero: must be true or false"),
        ("rotary_stage", "newport-esp301", {"axis": 4}, "axis: must be at most 3, not 4"),
        ("rotary_stage", "newport-esp301", {"axis": "1"}, "axis: must be a whole number, not '1'"),
        ("rotary_stage", "newport-esp301", {"in_position": "1 mm"}, "is a length, expected an ang"),
        ("digitizer", "red-pitaya-125-14", {"jumper": "lv"}, "did you mean 'LV'"),
        ("digitizer", "red-pitaya-125-14", {"os_version": 2.05}, "must be text, not 2.05; did you"),
        ("digitizer", "red-pitaya-125-14", {"os_version": "x"}, "'x' is no version such as"),
        ("turntable", "acutrol-3000", {"axes": 2, "continuous": [1, 3]}, "there is no axis 3"),
        ("turntable", "acutrol-3000", {"outer_axis": 4}, "outer_axis: must be at most 3, not 4"),
        ("turntable", "acutrol-3000", {"axes": 4}, "axes: must be at most 3, not 4"),
        ("turntable", "acutrol-3000", {"continuous": [4]}, "continuous[1]: must be at most 3"),
        ("turntable", "acutrol-3000", {"framing": "gpib"}, "must be 'framed' or 'line', not"),
        ("turntable", "acutrol-3000", {"zero": "where"}, "must be 'absolute' or 'search', not"),
        ("rotary_stage", "newport-esp301", {"home_mode": 0}, "home_mode: must be at least 1, not"),
        ("digitizer", "red-pitaya-125-14", {"channel": 3}, "channel: must be at most 2, not 3"),
        ("thermometer", "keysight-34465a-pt100", {"r0": "100"}, "r0: '100' has no unit, expected"),
        ("thermometer", "keysight-34465a-pt100", {"r0": "-100 ohm"}, "r0: must be above 0, not"),
        ("signal_generator.xy", "keysight-33522b", {"load": "open"}, "'open' is not a number with"),
        ("signal_generator.xy", "keysight-33522b", {"load": 50}, "load: must be text, not 50"),
        ("signal_generator.xy", "keysight-33522b", {"load": "0.5 ohm"}, "1 ohm to 10000 ohm, or"),
        (
            "signal_generator.xy",
            "keysight-33522b",
            {"load": "50 ohm", "trigger": "internal"},
            "trigger: must be 'external' or 'bus', not 'internal'",
        ),
        ("thermal_chamber", "watlow-f4t", {"loop": 5}, "loop: must be at most 4, not 5"),
        ("thermal_chamber", "watlow-f4t", {"unit": 0}, "unit: must be at least 1, not 0"),
        ("thermal_chamber", "watlow-f4t", {"word_order": "no"}, "'low-first' or 'high-first', not"),
        ("thermal_chamber", "watlow-f4t", {"door": "2"}, "door: '2' is no module and number"),
        ("thermal_chamber", "watlow-f4t", {"ramp": "no"}, "must be 'controller' or 'stepped', not"),
        ("thermal_chamber", "watlow-f4t", {"alarms": 15}, "alarms: must be at most 14, not 15"),
        ("thermal_chamber", "watlow-f4", {"chamber_event": 9}, "must be at most 8, not 9"),
        ("thermal_chamber", "watlow-f4", {"parity": "X"}, "parity: must be 'N', 'E' or 'O', not"),
        ("dut_power", "watlow-output-power", {"output": "2"}, "'2' is no module and number such"),
        ("dut_power", "watlow-output-power", {"output": "2.1", "event": 9}, "event: must be at m"),
        ("pump_laser", "thorlabs-sc10", {"moves_within": "fast"}, "'fast' is not a number with a"),
        ("thermometer", "keysight-34465a-pt100", {"nplc": 3}, "it cannot integrate over nplc 3"),
        ("thermal_chamber", "watlow-f4t", {"limit_modules": [7]}, "limit_modules[1]: must be at"),
        ("thermal_chamber", "watlow-f4t", {"door": "7.1"}, "door: '7.1' is beyond module 6"),
        ("thermal_chamber", "watlow-f4", {"baud_rate": 1200}, "must be 9600 or 19200, not 1200"),
        ("signal_generator.xy", "keysight-33522b", {"load": "1 V"}, "must be high-impedance, or"),
        ("coil_supply.x", "kepco-bop-36-12", {"coil_constant": "0 mT/A"}, "may not be zero"),
        (
            "coil_supply.x",
            "kepco-bop-36-12",
            {"coil_constant": "1 mT/A", "coil_resistance": "2 V"},
            "coil_resistance: '2 V' is a voltage, expected a resistance",
        ),
        ("pump_laser", "thorlabs-sc10", {"moves_within": "-8.4 ms"}, "above 0, not '-8.4 ms'"),
        (
            "multimeter",
            "keysight-34465a",
            {"line_frequency": "1 kHz"},
            "at most 60 Hz, not '1 kHz'",
        ),
        (
            "turntable",
            "acutrol-3000",
            {"outer_axis": 2, "inner_axis": 2},
            "number of outer_axis, too",
        ),
        ("turntable", "ideal-aerosmith", {"outer_axis": 3}, "no axis 3, as settings.axes is 1"),
        ("turntable", "acutrol-3000", {"axes": 1, "outer_axis": 3}, "or settings.axes: 3"),
        ("turntable", "acutrol-3000", {"axes": 2, "middle_axis": 3}, "middle_axis: there is no ax"),
        ("turntable", "ideal-aerosmith", {"axes": 2, "inner_axis": 3}, "inner_axis: there is no a"),
        ("rotary_stage", "ideal-aerosmith-stage", {"axis": 2}, "axis: there is no axis 2, as sett"),
        ("turntable", "ideal-aerosmith", {"prefixes": [">"]}, "prefixes[1]: '>' cannot name an"),
        ("turntable", "ideal-aerosmith", {"longest_move": "1 arcsec"}, "must be at least 1 deg"),
        ("turntable", "acutrol-3000", {"at_rest": "50 deg/s"}, "at_rest: must be at most 1 deg/s"),
        (
            "pump_laser",
            "thorlabs-sc10",
            {"trigger_to_dark": "8 degC"},
            "is a temperature, expected",
        ),
    ],
)
def test_wrong_types_and_values_out_of_range_are_refused_at_their_place(
    name: str, driver: str, settings: dict[str, Any], fault: str
) -> None:
    (found,) = said(document_of(name, driver, settings))
    assert found.startswith("bench.yaml:6:")
    assert f"instruments.{name}.settings." in found and fault in found
    if not {"outer_axis", "middle_axis", "inner_axis"} & settings.keys():  # a procedure's to read
        limits = dict.fromkeys(("current", "voltage", "slew", "zero_current"), 1.0)
        place = InstrumentPlace(name, "TCPIP::127.0.0.1::1::SOCKET", RealClock(), settings, limits)
        with pytest.raises(InstrumentError, match="read the bench file: its settings are wrong"):
            DRIVERS[driver](place)


def test_missing_required_settings_are_named() -> None:
    assert [
        one.partition("settings.")[2]
        for one in (
            *said(document_of("gaussmeter", "lakeshore-f71", {})),
            *said(document_of("signal_generator.xy", "keysight-33522b", {})),
            *said(document_of("dut_power", "watlow-output-power", {})),
            *said(document_of("coil_supply.dc", "kepco-bop-1kw", {})),
        )
    ] == [
        "averaging: is missing; this driver needs it",
        "timestamp: is missing; this driver needs it",
        "load: is missing; this driver needs it",
        "output: is missing; this driver needs it",
        "coil_constant: is missing; a coil_supply needs it",
    ]


@pytest.mark.parametrize("driver", DRIVERS)
def test_every_driver_refuses_a_setting_that_it_does_not_know(driver: str) -> None:
    for role in roles_of(DRIVERS[driver]):
        name = "coil_supply.x" if role == "coil_supply" else role
        name = "signal_generator.xy" if role == "signal_generator" else name
        faults = said(document_of(name, driver, {"chanel_number": 1}))
        known = [*keys_of(settings_of(DRIVERS[driver]))]
        known += keys_of(settings_of_role(role) or StrictModel)
        words = ", ".join(known) or "none"
        assert any(
            "there is no setting 'chanel_number'" in one and f"; this driver knows {words}" in one
            for one in faults
        )


@pytest.mark.parametrize("driver", DRIVERS)
def test_an_interlock_on_what_a_driver_does_not_read_is_refused_in_the_same_words(
    driver: str,
) -> None:
    reads = DRIVERS[driver].quantities
    for role in roles_of(DRIVERS[driver]):
        name = f"{role}.x" if role == "coil_supply" else role
        name = f"{role}.xy" if role == "signal_generator" else name
        for quantity in quantities_of(role):
            faults = [one for one in said(document_of(name, driver, {}, quantity)) if ":8:" in one]
            if quantity not in reads:
                assert len(faults) == 1
                assert faults[0].endswith(
                    f"interlocks[1].when.any[1].not.quantity: the driver of {name} does not read "
                    f"'{quantity}'; it reads {', '.join(reads) or 'none'}; take this interlock out "
                    "of the bench file"
                )
            elif quantity not in DRIVERS[driver].wired_by:
                assert faults == []


@pytest.mark.parametrize("driver", DRIVERS)
def test_what_a_method_publishes_is_in_the_unit_and_the_words_of_its_role(driver: str) -> None:
    methods = (getattr(DRIVERS[driver], name) for name in dir(DRIVERS[driver]))
    for name, unit, states in (one.publishes for one in methods if hasattr(one, "publishes")):
        for role in roles_of(DRIVERS[driver]):
            kind = kind_of(role, name)
            assert kind.unit == unit
            assert states is None or set(states) == set(kind.states)


@pytest.mark.parametrize(("driver", "wired"), [("watlow-f4", 1), ("watlow-f4t", "2.2")])
def test_a_quantity_that_no_setting_wires_is_refused_with_the_missing_setting(
    driver: str, wired: Any
) -> None:
    (fault,) = said(document_of("thermal_chamber", driver, {}, "door"))
    assert (
        "settings.door is missing, without which the driver of thermal_chamber does not read 'door'"
    ) in fault
    assert said(document_of("thermal_chamber", driver, {"door": wired}, "door")) == []


class LabSettings(DriverSettings):
    """What a laboratory's own gaussmeter takes."""

    averaging_s: Annotated[Second, Field(gt=0)]


class LabMeter(Driver):
    """A laboratory's own gaussmeter."""

    Settings = LabSettings
    quantities: ClassVar = {"field": lambda self: 1.5, "temperature": lambda self: None}
    wired_by: ClassVar = {"temperature": "probe"}

    def __init__(self, place: Any) -> None:
        self.place = place


class Plain:
    """A driver that declares nothing."""


@pytest.fixture
def laboratory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have drivers of another package."""
    ours = {"lab-meter": LabMeter, "lab-plain": Plain}
    assert roles()  # collected from the registry as it is
    monkeypatch.setattr(registry, "names", lambda group: tuple(ours))
    monkeypatch.setattr(registry, "load", lambda group, name: ours[name])


@pytest.mark.usefixtures("laboratory")
def test_a_driver_of_another_package_is_held_to_what_it_declares() -> None:
    good = {"averaging": "50 ms"}
    assert said(document_of("gaussmeter", "lab-meter", good, "field")) == []
    (typo,) = said(document_of("gaussmeter", "lab-meter", {**good, "averagin": "1 s"}))
    assert "'averagin'; did you mean 'averaging'; this driver knows averaging" in typo
    (missing,) = said(document_of("gaussmeter", "lab-meter", {}))
    assert missing.endswith("settings.averaging: is missing; this driver needs it")
    (unwired,) = said(document_of("gaussmeter", "lab-meter", good, "temperature"))
    assert "settings.probe is missing" in unwired
    (none,) = said(document_of("gaussmeter", "lab-plain", good))
    assert "there is no setting 'averaging'; this driver knows none" in none
    (unread,) = said(document_of("gaussmeter", "lab-plain", {}, "field"))
    assert "the driver of gaussmeter does not read 'field'; it reads none" in unread


def test_a_chain_whose_driver_does_not_read_it_is_refused_without_an_interlock() -> None:
    (fault,) = said(document_of("interlock_chain", "operator-power", {}))
    assert "bench.yaml:5:13: instruments.interlock_chain.driver: the driver of inter" in fault
    assert "does not read 'chain'" in fault


def test_a_driver_that_cannot_be_loaded_is_a_fault_at_its_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def load(group: str, name: str) -> Any:
        raise SyntaxError("a comma is missing")

    assert roles()  # collected from the registry as it is
    monkeypatch.setattr(registry, "load", load)
    (fault,) = said(document_of("imu", "kvh-1775", {}))
    assert fault == "bench.yaml:5:13: instruments.imu.driver: a comma is missing"


def test_a_driver_that_is_asked_all_the_same_says_the_same() -> None:
    class Here:
        name, settings = "gaussmeter", {"averaging": "1 s"}

    meter = LabMeter(Here())
    assert meter.read_quantity("field") == 1.5
    with pytest.raises(QuantityNotRead, match="the driver of gaussmeter does not read 'chain'"):
        meter.read_quantity("chain")
    with pytest.raises(QuantityNotRead, match=r"settings\.probe is missing"):
        meter.read_quantity("temperature")


@pytest.mark.parametrize("name", ["sim", "sim-alternate"])
def test_the_shipped_benches_say_what_their_drivers_know(name: str) -> None:
    text = find(BENCHES, name).read_text(encoding="utf-8")
    try:
        bench_of(read_yaml_text(text, Path(name)), registry.names(registry.DRIVERS), bounded=True)
    except FaultList as found:
        pytest.fail(str(found))


@pytest.mark.parametrize(
    ("name", "driver", "can"),
    [
        ("gaussmeter", "operator-power", "cannot be a gaussmeter; it can be dut_power"),
        ("multimeter", "lakeshore-f71", "cannot be a multimeter; it can be gaussmeter"),
        ("gaussmeter", "lakeshore-f71", ""),
    ],
)
def test_a_driver_of_another_role_is_refused(name: str, driver: str, can: str) -> None:
    faults = [str(one) for one in role_faults(document_of(name, driver, {}))]
    assert len(faults) == bool(can)
    assert all(
        f"5:13: instruments.{name}.driver: the driver '{driver}' {can}" in one for one in faults
    )


def test_settings_that_raise_are_a_fault_of_their_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    class Odd(DriverSettings):
        gain: int

        @field_validator("gain")
        @classmethod
        def divide(cls, gain: int) -> int:
            return gain // 0

    assert roles()  # collected from the registry as it is
    monkeypatch.setattr(LabMeter, "Settings", Odd)
    monkeypatch.setattr(registry, "names", lambda group: ("lab-meter",))
    monkeypatch.setattr(registry, "load", lambda group, name: LabMeter)
    (fault,) = said(document_of("gaussmeter", "lab-meter", {"gain": 1}))
    assert (
        "5:13: instruments.gaussmeter.driver: the settings of the driver 'lab-meter' cannot"
        in fault
    )
    assert "modulo by zero" in fault


@pytest.mark.parametrize(
    "address",
    [
        "TCPIP::192.0.2.1::5025::SOCKT",
        "TCPIP::192.0.2.1:5025::SOCKET",
        "TCPIP::192.0.2.1::99999::SOCKET",
        "TCPIP::::5025::SOCKET",
        "socketcand://192.0.2.1:29536",
        "socketcand://192.0.2.1:x/can0",
        "modbus-tcp://",
        "socket://192.0.2.1",
        "hwgrep://(0403",
    ],
)
def test_an_address_without_host_port_channel_or_whole_pattern_is_refused(address: str) -> None:
    assert why_unknown(address) is not None


@pytest.mark.parametrize(
    "address",
    [
        "TCPIP::192.0.2.1::INSTR",
        "TCPIP0::[fe80::1]::5025::SOCKET",
        "tcpip::h::hislip0,4880::instr",
        "socketcand://h/can0",
        "modbus-tcp://h",
        "rfc2217://[::1]:5000",
        "lab://anything",
        "hwgrep://0403:(6001|6010)&n=1",
    ],
)
def test_an_address_that_is_whole_is_not_refused(address: str) -> None:
    assert why_unknown(address) is None
