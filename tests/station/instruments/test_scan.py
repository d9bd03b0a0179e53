"""`station scan`: who is attached, and a draft of a bench file that says what is missing."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from command_line import begun, station
from places import SIM

from station import registry
from station.clock import RealClock
from station.conformance.faulty_server import FaultyServer, closed_port
from station.files.yaml.reading import FaultList
from station.instruments.bench import read_bench
from station.instruments.scan import (
    IDENTIFY,
    AttachedDevice,
    ask_can,
    ask_port,
    draft,
    modbus_identity,
    recognised,
)

FILLED_IN = {
    "coil_supply": "    settings: {coil_constant: 0.3 mT/A}\n"
    "    limits: {current: 8 A, voltage: 30 V, slew: 2 A/s, zero_current: 20 mA}\n",
    "gaussmeter": "    settings: {averaging: 100 ms, timestamp: interval-end}\n",
    "rotary_stage": "    limits: {rate: 20 deg/s, acceleration: 40 deg/s^2}\n",
    "turntable": "    limits: {rate: 110 deg/s, acceleration: 50 deg/s^2}\n",
    "signal_generator": "    settings: {load: high-impedance}\n    limits: {voltage: 9 V}\n",
    "cell_heater": "    limits: {temperature_high: 200 degC, temperature_slew: 20 degC/min}\n",
    "thermal_chamber": "    limits: {temperature_low: -45 degC, temperature_high: 70 degC}\n",
}

MADE_SAFE = (
    "turntable",
    "coil_supply",
    "rotary_stage",
    "signal_generator",
    "pump_laser",
    "digitizer",
    "cell_heater",
    "thermal_chamber",
)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("served")
    with (folder / "served.json").open("w", encoding="utf-8") as first_line:
        process = begun(folder, "sim", "sim", "--until-stdin-closes", stdout=first_line)
    assert process.stderr is not None
    assert "serving" in process.stderr.readline()
    yield folder
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=20)


@pytest.fixture(scope="module")
def scanned(served: Path) -> subprocess.CompletedProcess[str]:
    done = station(served, "scan", "--served", "served.json")
    assert done.returncode == 0, done.stderr
    return done


def test_every_served_instrument_is_recognised_with_its_serial_number(
    served: Path, scanned: subprocess.CompletedProcess[str]
) -> None:
    told = json.loads((served / "served.json").read_text(encoding="utf-8"))["instruments"]
    drafted = yaml.safe_load(scanned.stdout)["instruments"]
    shipped = yaml.safe_load(SIM.read_text(encoding="utf-8"))["instruments"]
    assert set(drafted) == set(told)
    for name, one in drafted.items():
        assert one["driver"] == shipped[name]["driver"]
        assert one["serial"] == shipped[name]["serial"]
        assert one["address"] == told[name]["address"]
    assert len(scanned.stderr.splitlines()) == len(told)
    assert all(line.startswith("ok ") for line in scanned.stderr.splitlines())


def test_the_draft_lacks_only_what_a_person_must_say(
    scanned: subprocess.CompletedProcess[str], tmp_path: Path
) -> None:
    path = tmp_path / "draft.yaml"
    path.write_text(scanned.stdout, encoding="utf-8")
    drivers = registry.names(registry.DRIVERS)
    with pytest.raises(FaultList) as raised:
        read_bench(path, drivers)
    for fault in raised.value.faults:
        roles = "coil_supply|rotary_stage|turntable|signal_generator|thermal_chamber|cell_heater"
        assert re.search(f"is missing; (a ({roles})|this driver) needs it", str(fault))
    text = scanned.stdout
    for line in text.splitlines():
        role = line.strip().rstrip(":").split(".")[0]
        if line.startswith("  ") and line.endswith(":") and role in FILLED_IN:
            text = text.replace(f"{line}\n", f"{line}\n{FILLED_IN[role]}")
    path.write_text(text, encoding="utf-8")
    bench = read_bench(path, drivers)
    assert bench.safe_order() == [(role, 30.0) for role in MADE_SAFE]
    assert "FILL IN" in text


def test_json_is_one_document_with_what_was_seen(served: Path) -> None:
    done = station(served, "scan", "--served", "served.json", "--json")
    document = json.loads(done.stdout)
    assert {one["driver"] for one in document["seen"]} >= {"lakeshore-f71", "can-pulse-board"}
    assert yaml.safe_load(document["draft"])["bench"] == 1


def test_nothing_but_the_identity_is_asked() -> None:
    with FaultyServer(RealClock(), lambda data: b"FLUKE,8588A,123,1.0\r\n") as server:
        seen = ask_port("127.0.0.1", server.port)
        assert server.received == IDENTIFY
    address = f"TCPIP::127.0.0.1::{server.port}::SOCKET"
    assert seen == AttachedDevice(address, "FLUKE,8588A,123,1.0")


@pytest.mark.parametrize("answer", [b"", None], ids=["silent", "hangs-up"])
def test_who_does_not_answer_is_not_there(answer: bytes | None) -> None:
    with FaultyServer(RealClock(), lambda data: answer) as server:
        assert ask_port("127.0.0.1", server.port) is None
    assert ask_port("127.0.0.1", closed_port()) is None


def test_nothing_at_all_is_exit_code_3_and_still_a_bench_file(tmp_path: Path) -> None:
    done = station(tmp_path, "scan", "--visa-library", "no-such-library")
    assert done.returncode == 3
    assert "nothing answers" in done.stderr
    assert "Traceback" not in done.stderr
    assert yaml.safe_load(done.stdout)["instruments"] == {}


def test_a_modbus_device_tells_its_maker_product_and_version() -> None:
    names = b"".join(bytes([k, len(one)]) + one for k, one in enumerate([b"Watlow", b"F4T", b"4"]))
    head = bytes.fromhex("0001 0000 0000 01 2b0e 01 01 00 00 03".replace(" ", ""))
    assert modbus_identity(head + names) == "Modbus: Watlow, F4T, 4"
    refusal = bytes.fromhex("000100000003 01 ab 01".replace(" ", ""))
    assert modbus_identity(refusal) == "Modbus: a device without a name"
    assert modbus_identity((head + names)[:-1]) == "Modbus: Watlow, F4T"


def test_what_has_no_driver_or_no_place_stands_in_comments() -> None:
    meters = [recognised(f"A{k}", f"Lake Shore,F71,LSA{k}/X,1.0") for k in range(2)]
    stranger = recognised("GPIB0::5::INSTR", "ACME: key: [value]\n\x85- {x\u2028}")
    text = draft([*meters, stranger])
    data = yaml.safe_load(text)
    assert list(data["instruments"]) == ["gaussmeter"]
    assert data["instruments"]["gaussmeter"]["serial"] == "LSA0"
    assert "#   A1: Lake Shore,F71,LSA1/X,1.0 (lakeshore-f71); every place for it is taken" in text
    assert "#   GPIB0::5::INSTR: ACME: key: [value]" in text


def test_a_can_daemon_is_told_by_its_greeting_and_is_sent_nothing() -> None:
    with FaultyServer(RealClock(), lambda data: b"", can=True) as server:
        with socket.create_connection(("127.0.0.1", server.port), 5.0) as line:
            seen = ask_can(line, "127.0.0.1", server.port)
        assert server.received == b""
    assert seen == AttachedDevice(f"socketcand://127.0.0.1:{server.port}/CHANNEL", "a CAN daemon")
