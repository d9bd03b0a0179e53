"""Our drivers: where each one's instrument stands, who it is, and a question of its own."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from quick_yaml import load_yaml

from station import registry
from station.conformance.fixture import Fixture, fixture_of
from station.files.lookup import BENCHES, find
from station.files.yaml.reading import read_yaml_text
from station.instruments.bench import Bench, bench_of
from station.roles import Identity
from station.roles.role import role_of

RLG, FOG = "rlg-magnetic-sensitivity", "fog-scale-factor-temperature"
ACCELEROMETER, SERF = "accelerometer-magnetic-sensitivity", "serf-nonorthogonality"
NINE_AXIS = "nine-axis-calibration"

Ask = Callable[[Fixture, Any], Any]


def who(fixture: Fixture, driver: Any) -> Any:
    return driver.identify()


def status(fixture: Fixture, driver: Any) -> Any:
    return driver.status()


def air_degC(fixture: Fixture, chamber: Any) -> float:
    return float(chamber.temperature_degC())


def nothing(fixture: Fixture, driver: Any) -> None:
    """Leave an instrument as it is."""


def carries_two_ampere(fixture: Fixture, supply: Any) -> None:
    supply.programme_limits()
    supply.switch_on()
    supply.ramp_to(2.0)


def records_field(fixture: Fixture, meter: Any) -> None:
    meter.start(1.5)


def field_nT(fixture: Fixture, meter: Any) -> float:
    fixture.clock.sleep(1.0)
    columns = meter.drain().columns
    return float(np.nansum([columns[f"{axis}_T"][-1] ** 2 for axis in "xyz"]) ** 0.5 * 1e9)


def burst_of_volts(fixture: Fixture, meter: Any) -> float:
    meter.configure(1.0, 1)
    return burst(fixture, meter, "voltage_V")


def burst_of_degrees(fixture: Fixture, meter: Any) -> float:
    return burst(fixture, meter, "temperature_degC")


def burst(fixture: Fixture, meter: Any, column: str) -> float:
    """Return the mean of a burst, which is fetched in one look."""
    meter.start(3)
    fixture.clock.sleep(5.0)
    return float(meter.fetch().columns[column].mean())


def holds_a_volt(fixture: Fixture, generator: Any) -> str:
    generator.hold(1, 1.0)
    return str(generator.read_quantity("output"))


def samples_of_a_record(fixture: Fixture, digitizer: Any) -> int:
    digitizer.prepare(10e3, 0.05, 1.0)
    digitizer.fire()
    fixture.clock.sleep(0.1)
    samples = len(digitizer.fetch())
    digitizer.release()
    return samples


def outputs(fixture: Fixture, sensor: Any) -> bool:
    sensor.start(10.0)
    fixture.clock.sleep(1.0)
    return len(sensor.drain()) > 5


def lets_light_through(fixture: Fixture, shutter: Any) -> None:
    shutter.open_shutter()


def warms_the_cell(fixture: Fixture, heater: Any) -> None:
    heater.programme_limits()
    heater.switch_on()


def stands_at_30_deg(fixture: Fixture, stage: Any, *axis: int) -> None:
    stage.home(*axis)
    while stage.is_moving(*axis):
        fixture.clock.sleep(0.1)
    stage.move_to(*axis, 30.0)
    while stage.is_moving(*axis):
        fixture.clock.sleep(0.1)


def feeds(fixture: Fixture, power: Any) -> str:
    power.switch_on()
    return str(power.read_quantity("output"))


@dataclass(frozen=True)
class Case:
    """One driver: who answers, and a question with the words of its message.

    `name` and `entry` are the instrument's in a bench file where no shipped bench has it. A
    `patient` question is asked three times before its error is believed; one that is `asked_once`
    is not asked again over a new line either. `bears` says of single faults whether the answer is
    right all the same; `untouched` are faults that find nothing in its answer to change.
    """

    identity: Identity
    command: str = ""
    ask: Ask = who
    prepare: Callable[[Fixture, Any], None] = nothing
    bench: str = "sim"
    name: str = ""
    entry: Mapping[str, Any] = field(default_factory=dict)
    patient: bool = False
    asked_once: bool = False
    bears: Mapping[str, bool] = field(default_factory=dict)
    untouched: tuple[str, ...] = ()


WORLDS = {
    **dict.fromkeys(("navigator", "thermal_chamber", "turntable"), FOG),
    **dict.fromkeys(("multimeter", "thermometer", "rotary_stage"), ACCELEROMETER),
    **dict.fromkeys(("signal_generator", "digitizer", "pump_laser", "cell_heater"), SERF),
    "imu": NINE_AXIS,
}
"""In which procedure's world the instrument of a role stands; the others in a laser gyro's."""

A_03 = "A.03.01-03.15-03.01-00.52-04-02"
KVH = "ICB DSP Rev B Version: 104; ICB FPGA Rev: 2A; GCB DSP Rev C Version: 31; GCB FPGA Rev: D"
KEYSIGHT, OURS = "Keysight Technologies", "house-made"
ACUTROL = ("Acutronic R&D USA", "Acutrol3000")
OTHER = "sim-alternate"
ENCODER = {
    "encoder_offset": "2 arcsec",
    "encoder_sine": "0.7 arcsec",
    "encoder_phase": "70 deg",
    "angle_at_start": "30 deg",
}

CASES: dict[str, Case] = {
    "kepco-bop-36-12": Case(
        Identity("KEPCO", "BIT 802E 36-12", "H148201", "1.15-1.80"),
        "MEAS:CURR?",
        lambda _, supply: supply.current_A(),
        carries_two_ampere,
    ),
    "kepco-bop-1kw": Case(
        Identity("KEPCO", "BOP 72-14MG", "K2304411", "2.24"),
        "MEAS:CURR?",
        lambda _, supply: supply.current_A(),
        carries_two_ampere,
        OTHER,
    ),
    "lakeshore-f71": Case(
        Identity("Lake Shore", "F71", "LSA2B7X", "1.6.2019092002"),
        "FETC:BUFF",
        field_nT,
        records_field,
        asked_once=True,
    ),
    "lakeshore-425": Case(
        Identity("LSCI", "MODEL425", "4250022", "1.0"), "RDGFIELD", field_nT, records_field, OTHER
    ),
    "lakeshore-336": Case(
        Identity("LSCI", "MODEL336", "LSA23CH", "2.9"),
        "CRDG? A",
        air_degC,
        warms_the_cell,
        untouched=("nan",),
    ),
    "can-pulse-board": Case(Identity(OURS, "CAN pulse board", "1042", "1.2"), "100"),
    "serial-pulse-board": Case(
        Identity(OURS, "serial pulse board", "2051", "1.2"), "identify", bench=OTHER
    ),
    "can-navigator": Case(Identity(OURS, "FOG navigator", "3107", "1.0"), "0A0", status),
    "serial-navigator": Case(
        Identity(OURS, "FOG navigator", "3108", "1.0"),
        "status",
        status,
        bench=OTHER,
        bears={"previous-reply": True},
    ),
    "kvh-1775": Case(
        Identity("KVH", "1775", "1775042", KVH),
        "=dr",
        outputs,
        untouched=("wrong-crc",),  # lines have none
    ),
    "can-imu": Case(Identity(OURS, "nine-axis sensor", "4711", "1.0"), "0C0", status, bench=OTHER),
    "keysight-34465a": Case(
        Identity(KEYSIGHT, "34465A", "MY60012345", A_03), "FETC", burst_of_volts
    ),
    "keysight-34465a-pt100": Case(
        Identity(KEYSIGHT, "34465A", "MY60012346", A_03), "FETC", burst_of_degrees
    ),
    "keysight-daq970a": Case(
        Identity(KEYSIGHT, "DAQ970A", "MY58010326", "A.02.04-00.16-11.29-00.02-02-01"),
        "FETC",
        burst_of_degrees,
        bench=OTHER,
    ),
    "keithley-dmm6500": Case(
        Identity("KEITHLEY INSTRUMENTS", "MODEL DMM6500", "04503417", "1.7.12b"),
        "TRAC:DATA",
        burst_of_volts,
        bench=OTHER,
    ),
    "operator-power": Case(Identity("", "operator", "", "")),
    "keysight-e36312a": Case(
        Identity(KEYSIGHT, "E36312A", "MY59002391", "2.1.0-1.0.4-1.12"),
        "MEAS:CURR?",
        lambda _, supply: supply.read_quantity("current"),
        lambda _, supply: supply.switch_on(),
        OTHER,
        patient=True,
        bears={"nan": False},
    ),
    "watlow-f4t": Case(Identity("Watlow", "F4T", "10423177", "5.1203"), "read 2820", air_degC),
    "watlow-f4": Case(
        Identity("Watlow", "F4", "208417", "2.03"), "read 100", air_degC, bench=OTHER
    ),
    "watlow-output-power": Case(
        Identity("Watlow", "F4T", "10423512", "5.1203"),
        "write 33958",
        feeds,
        name="dut_power",
        # An F4T whose loop is not wired; the device hangs behind its first output.
        entry={
            "serial": "10423512",
            "settings": {"output": "2.1", "word_order": "high-first"},
            "simulator": {
                "steers": "nothing",
                "word_order": "high-first",
                "sensor_error": "0 K",
                "noise": "0.01 K",
                "set_point_low": "-70 degC",
                "set_point_high": "180 degC",
                "alarms": 4,
                "limit_modules": [],
                "outputs": {"2.1": "dut_power"},
                "inputs": {},
            },
        },
    ),
    "newport-esp301": Case(
        Identity("Newport", "ESP301 with URS100BPP", "B2K0417", "3.0.1"),
        "1TP?",
        lambda _, stage: stage.angle_deg(),
        stands_at_30_deg,
    ),
    "acutrol-3000": Case(
        Identity(*ACUTROL, "A3-0117", "A8800-001-01.000-a"),
        ":Read:Position?",
        lambda _, table: table.angle_deg(3),
        lambda fixture, table: stands_at_30_deg(fixture, table, 3),
        # An answer of known length has no terminator to be wrong or to wait for.
        bears={"wrong-terminator": True, "flood": True, "stray line before": False},
    ),
    # The controller's plain lines, as on IEEE-488.
    "acutrol-3000 in lines": Case(
        Identity(*ACUTROL, "A3-0118", "A8800-001-01.000-a"),
        ":Read:Position?",
        lambda _, table: table.angle_deg(1),
        lambda fixture, table: stands_at_30_deg(fixture, table, 1),
        name="turntable",
        entry={
            "serial": "A3-0118",
            "settings": {"framing": "line", "zero": "absolute"},
            "simulator": {
                "framing": "line",
                "maximum_rate": "200 deg/s",
                "maximum_acceleration": "100 deg/s^2",
                "rate_error": "-20 ppm",
                "rate_noise": "0.0005 deg/s",
                "encoder_noise": "0.1 arcsec",
                "resolution": "0.00001 deg",
                "tracking_delay": "8 ms",
                "settling": "0.5 s",
                **{f"axis_{n}": ENCODER for n in (1, 2, 3)},
            },
        },
    ),
    "ideal-aerosmith": Case(
        Identity("Ideal Aerosmith", "rate table", "untold", "untold"),
        "1PPO",
        lambda _, table: table.angle_deg(1),
        lambda fixture, table: stands_at_30_deg(fixture, table, 1),
        OTHER,
        bears={"wrong-terminator": True},  # the prompt before it is what ends an answer
    ),
    "ideal-aerosmith-stage": Case(
        Identity("Ideal Aerosmith", "rate table", "untold", "untold"),
        "PPO",
        lambda _, stage: stage.angle_deg(),
        stands_at_30_deg,
        name="rotary_stage",
        entry={
            "serial": "untold",
            "settings": {"continuous": []},
            "simulator": {
                "maximum_rate": "40 deg/s",
                "maximum_acceleration": "80 deg/s^2",
                "rate_error": "10 ppm",
                "rate_noise": "0.0005 deg/s",
                "encoder_noise": "0.2 arcsec",
                "resolution": "0.00001 deg",
                "tracking_delay": "8 ms",
                "axis_1": {**ENCODER, "low": "-10 deg", "high": "370 deg"},
            },
        },
        bears={"wrong-terminator": True},
    ),
    "interlock-chain-line": Case(
        Identity(OURS, "interlock chain reader", "IC-0001", "1.0"),
        "CHAIN?",
        lambda _, chain: chain.is_closed(),
        patient=True,
        untouched=("nan",),
    ),
    "interlock-chain-shared": Case(
        Identity("", "contacts of turntable and thermal_chamber", "", ""), bench=OTHER
    ),
    "keysight-33522b": Case(
        Identity(KEYSIGHT, "33522B", "MY59000101", "4.00-1.19-2.00-52-00"), "FUNC?", holds_a_volt
    ),
    "rigol-dg800": Case(
        Identity("Rigol Technologies", "DG822", "DG8A262000837", "00.02.06.00.01"),
        "FUNC",
        holds_a_volt,
        name="signal_generator.xy",
        entry={"serial": "DG8A262000837"},
    ),
    "red-pitaya-125-14": Case(
        Identity("Red Pitaya", "STEMlab 125-14", "0", "INSTR2024 01-02"),
        ":N?",
        samples_of_a_record,
    ),
    "thorlabs-sc10": Case(
        Identity("Thorlabs", "SC10", "untold", "1.07"),
        "closed?",
        lambda _, shutter: shutter.is_open(),
        lets_light_through,
        bears={"wrong-terminator": True, "stray line before": False},
        untouched=("nan",),
    ),
}


def driver_of(case_name: str) -> str:
    """Return the name of the driver of a case."""
    return case_name.partition(" ")[0]


def name_of(case_name: str) -> str:
    """Return the name of the instrument of a case on its bench."""
    case, driver = CASES[case_name], driver_of(case_name)
    entries = shipped(case.bench)["instruments"].items()
    return case.name or next(name for name, entry in entries if entry["driver"] == driver)


def world_of(case_name: str) -> str:
    """Return the procedure in whose world the instrument of a case stands."""
    return WORLDS.get(role_of(name_of(case_name)), RLG)


@cache
def shipped(name: str) -> Mapping[str, Any]:
    data: Mapping[str, Any] = load_yaml(find(BENCHES, name).read_text(encoding="utf-8"))
    return data


def alone(data: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return a bench with one instrument, those whose lines it shares, and what is about them."""
    names = (name, *data["instruments"][name].get("shares", ()))
    return {
        **data,
        "instruments": {kept: data["instruments"][kept] for kept in names},
        "interlocks": [
            lock for lock in data["interlocks"] if lock["when"].get("instrument") in names
        ],
        "safe_state": [
            rest
            for rest in data["safe_state"]
            if any(kept.startswith(rest["role"]) for kept in names)
        ],
    }


def bench_data(case_name: str) -> dict[str, Any]:
    """Return the shipped bench of a case as data, with nothing but its instrument."""
    case, name = CASES[case_name], name_of(case_name)
    data = alone(shipped(case.bench), name)
    if case.entry:
        own = {"driver": driver_of(case_name), **case.entry}
        data["instruments"][name] = {**data["instruments"][name], **own}
        del data["interlocks"]  # some of them are about quantities of the other model
    return data


def as_text(bench: Mapping[str, Any]) -> str:
    """Return a bench file, in which what looks like a number and is none has its quotes."""
    return json.dumps(bench, default=str)


def bench_from(data: Mapping[str, Any]) -> Bench:
    """Return a bench that is given as data."""
    document = read_yaml_text(as_text(data), Path("bench.yaml"))
    return bench_of(document, registry.names(registry.DRIVERS))


@cache
def bench_for(case_name: str) -> Bench:
    """Return the bench of a case."""
    return bench_from(bench_data(case_name))


@contextmanager
def stood(case_name: str) -> Iterator[Fixture]:
    """Serve the instrument of a case on virtual time."""
    where = bench_for(case_name), name_of(case_name), world_of(case_name)
    with fixture_of(*where) as fixture:
        yield fixture
