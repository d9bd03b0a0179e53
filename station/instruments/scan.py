"""What is attached at all: ask whoever can be asked who it is; and a draft of a bench file.

Only identification is asked: `*IDN?`, the Modbus device identification, and the greeting of a CAN
daemon, which comes unasked. Serial ports are listed and not written to: at a wrong baud rate a
question may be taken for a command. What is not known is left to fill in.
"""

from __future__ import annotations

import json
import re
import socket
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from station import registry
from station.clock import RealClock
from station.driver_checks import settings_of
from station.fields import key_of
from station.files.yaml.document import plain_scalar
from station.instruments.attached import serial_ports, visa_resources
from station.instruments.can_adapters import can_interfaces
from station.instruments.opening import InstrumentPlace
from station.roles.base import MadeSafe
from station.roles.role import instances, role_of, roles, roles_of, safe_states
from station.safety.bounds import COIL

CONNECT_S = 1.0
ANSWER_S = 1.0
IDENTIFY = b"*IDN?\r\n"
MAX_ANSWER = 4096
MODBUS_PORT = 502
CAN_PORTS = (28600, 29536)
TEXT_PORTS = (5025, 7777, 9878, 5000)
PORTS = (*TEXT_PORTS, MODBUS_PORT, *CAN_PORTS)
"""Where instruments listen: SCPI, Lake Shore, raw SCPI of others, Modbus, socketcand."""

# Transaction 1, protocol 0, five bytes, unit 1, function 43/14: basic identification from object 0.
MODBUS_QUESTION = struct.pack(">HHHBBBBB", 1, 0, 5, 1, 0x2B, 0x0E, 1, 0)


@dataclass(frozen=True)
class AttachedDevice:
    """Something attached: its address, what it said, and the driver that recognises it.

    `answered` is False for what is only listed, as a serial port.
    """

    address: str
    said: str
    answered: bool = True
    driver: str | None = None
    serial: str | None = None


def scan(
    hosts: Iterable[str], library: str, served: Mapping[str, Any] | None
) -> list[AttachedDevice]:
    """Return what is attached, in a fixed order.

    `hosts` are tried on the known ports; `library` is the VISA library; `served`, the first line of
    `station sim`, takes the place of everything else.
    """
    if served is not None:
        with ThreadPoolExecutor() as pool:
            return list(pool.map(ask_served, served["instruments"].items()))
    places = [(host, port) for host in hosts for port in PORTS]
    with ThreadPoolExecutor(max(len(places), 1)) as pool:
        answers = pool.map(lambda place: ask_port(*place), places)
        answered = [answer for answer in answers if answer is not None]
    return [*visa(library), *ports(), *can_buses(), *answered]


def ask_port(host: str, port: int) -> AttachedDevice | None:
    """Ask a TCP port who is there, in the manner of what usually listens on it."""
    ask = ask_can if port in CAN_PORTS else ask_modbus if port == MODBUS_PORT else ask_text
    try:
        with socket.create_connection((host, port), CONNECT_S) as line:
            line.settimeout(ANSWER_S)
            return ask(line, host, port)
    except OSError:
        return None


def ask_text(line: socket.socket, host: str, port: int) -> AttachedDevice:
    """Ask `*IDN?`; OSError when no line comes back."""
    return recognised(f"TCPIP::{host}::{port}::SOCKET", first_line(line))


def ask_modbus(line: socket.socket, host: str, port: int) -> AttachedDevice:
    """Ask for the device identification; OSError when nothing comes back."""
    line.sendall(MODBUS_QUESTION)
    return AttachedDevice(f"{host}:{port}", modbus_identity(line.recv(MAX_ANSWER)))


def ask_can(line: socket.socket, host: str, port: int) -> AttachedDevice | None:
    """Wait for the greeting of a CAN daemon; OSError when nothing comes."""
    if line.recv(MAX_ANSWER) != b"< hi >":
        return None
    return AttachedDevice(f"socketcand://{host}:{port}/CHANNEL", "a CAN daemon")


def first_line(line: socket.socket) -> str:
    """Ask `*IDN?` and return the first line of the answer; OSError when there is none."""
    line.settimeout(ANSWER_S)
    line.sendall(IDENTIFY)
    answer = b""
    while b"\n" not in answer and len(answer) < MAX_ANSWER:
        more = line.recv(MAX_ANSWER)
        if not more:
            raise ConnectionError("closed before a whole line came")
        answer += more
    return answer.partition(b"\n")[0].decode("ascii", "replace").strip()


def modbus_identity(answer: bytes) -> str:
    """Return maker, product and version of a Modbus device from its answer, if it gives them."""
    names = []
    if answer[7:9] == b"\x2b\x0e":
        rest = answer[14:]
        while len(rest) >= 2 and len(rest) >= 2 + rest[1]:
            names.append(rest[2 : 2 + rest[1]].decode("ascii", "replace"))
            rest = rest[2 + rest[1] :]
    return "Modbus: " + (", ".join(names) or "a device without a name")


def ask_served(entry: tuple[str, Mapping[str, Any]]) -> AttachedDevice:
    """Ask a simulated instrument that `station sim` serves."""
    _, entry_data = entry
    address = str(entry_data["address"])
    scheme = address.partition("://")[0]
    if "://" in address:
        for name, driver in registry.loaded(registry.DRIVERS):
            if getattr(driver, "identifies_on", None) == scheme:
                with suppress(Exception):  # a driver that cannot is not the one
                    return identified(
                        driver(InstrumentPlace("scan", address, RealClock())), name, address
                    )
        return AttachedDevice(address, f"{entry_data['protocol']}, no driver recognises it")
    try:
        with socket.create_connection((entry_data["host"], entry_data["port"]), CONNECT_S) as line:
            return recognised(address, first_line(line))
    except OSError as error:
        return AttachedDevice(address, f"no answer to *IDN? ({error})", answered=False)


def identified(instrument: Any, driver: str, address: str) -> AttachedDevice:
    """Return what an instrument says through its driver's own identification."""
    try:
        identity = instrument.identify()
    finally:
        instrument.close()
    answer = ", ".join(str(part) for part in vars(identity).values() if part)
    return AttachedDevice(address, answer, True, driver, identity.serial)


def recognised(address: str, said: str) -> AttachedDevice:
    """Return what answered, with the driver whose pattern `recognises` finds in the answer."""
    said = "".join(letter if letter.isprintable() else " " for letter in said).strip()
    for name, driver in registry.loaded(registry.DRIVERS):
        pattern = getattr(driver, "recognises", None)
        match = re.search(pattern, said) if pattern else None
        if match is not None:
            serial = match.groupdict().get("serial")
            return AttachedDevice(address, said, True, name, serial.strip() if serial else None)
    return AttachedDevice(address, said)


def visa(library: str) -> list[AttachedDevice]:
    """Ask every resource that a VISA library lists, serial ports left out."""
    return [
        recognised(address, sentence)
        if answered
        else AttachedDevice(address, sentence, answered=False)
        for address, sentence, answered in visa_resources(library)
    ]


def ports() -> list[AttachedDevice]:
    """List the serial ports of this computer with what their adapters say of themselves."""
    return [AttachedDevice(*serial_port) for serial_port in serial_ports()]


def can_buses() -> list[AttachedDevice]:
    """List the CAN interfaces that python-can detects."""
    return [
        AttachedDevice(address, sentence, answered=False) for address, sentence in can_interfaces()
    ]


FILL_IN = "FILL IN"
DRAFT_LEVEL = "1 A"
HEAD = f"""\
# A draft from `station scan`. It says who answered where, and nothing more: which coil hangs on
# which supply, what may never be exceeded and what was calibrated is for you to write, at every
# {FILL_IN}. Then `station validate PLAN --bench THIS-FILE` names what is still missing.
bench: 1
name: draft
"""
CALIBRATION = f"""\
    # {FILL_IN}, from the certificate; without it results carry no uncertainty of this instrument:
    # calibration:
    #   certificate: NUMBER
    #   date: YYYY-MM-DD
    #   due: YYYY-MM-DD
    #   uncertainty:
    #     - {{quantity: …, up_to: …, relative: …, absolute: …, coverage_factor: 2}}
"""


def draft(seen: Iterable[AttachedDevice]) -> str:
    """Return the text of a bench file; whatever no driver recognises stands in comments."""
    free = list(instances())
    entries, rest, safe = [], [], []
    for answer in seen:
        if answer.driver is None:
            rest.append(f"#   {answer.address}: {answer.said}\n")
            continue
        alike = drivers_alike(answer.driver)
        places = ((name, place) for name in alike for place in free_places(name, free))
        name, instance = next(places, (answer.driver, None))
        if instance is None:
            what = f"{answer.said} ({answer.driver}); every place for it is taken"
            rest.append(f"#   {answer.address}: {what}\n")
            continue
        free.remove(instance)
        driver = registry.load(registry.DRIVERS, name)
        others = [other for other in alike if other != name]
        entries.append("".join(entry_lines(instance, replace(answer, driver=name), driver, others)))
        if issubclass(driver, MadeSafe) and role_of(instance) not in safe:
            safe.append(role_of(instance))
    text = HEAD
    text += "\ninstruments:\n" + "\n".join(entries) if entries else "\ninstruments: {}\n"
    if rest:
        text += "\n# Also there, without a driver or a place:\n" + "".join(rest)
    coils = [
        instance for instance in instances() if role_of(instance) == COIL and instance not in free
    ]
    if coils:
        text += f"\n# {FILL_IN}: what ends a run. Set each level just above its coil's limit of\n"
        text += f"# current; until then {DRAFT_LEVEL} ends it.\ninterlocks:\n"
        text += "".join(map(interlock_line, coils))
    if not safe:
        return text + "\nsafe_state: []\n"
    order = [name for name in safe_states() if name in safe]
    steps = "".join(f"  - {{role: {name}, within: 30 s}}\n" for name in order)
    return (
        text
        + f"\n# {FILL_IN}: the order in which the bench comes to rest, and how fast.\n"
        + (f"safe_state:\n{steps}")
    )


def interlock_line(coil: str) -> str:
    """Return the line of an interlock on a coil's current, at a level that is safe and too low."""
    name = coil.replace(f"{COIL}.", "coil-")
    when = f"{{instrument: {coil}, quantity: current, above: {DRAFT_LEVEL}}}"
    return f"  - {{name: {name}-current, when: {when}, grace: 0.4 s}}\n"


def drivers_alike(name: str) -> list[str]:
    """Return a driver, and after it those that recognise the same model for another use."""
    loaded = registry.loaded(registry.DRIVERS)
    patterns = {other: getattr(driver, "recognises", other) for other, driver in loaded}
    return [
        name,
        *(other for other in patterns if other != name and patterns[other] == patterns[name]),
    ]


def free_places(driver: str, free: Iterable[str]) -> list[str]:
    """Return the places on the bench that a driver can take."""
    fills = roles_of(registry.load(registry.DRIVERS, driver))
    return [place for place in free if role_of(place) in fills]


def entry_lines(
    instance: str, seen: AttachedDevice, driver: type, others: Sequence[str] = ()
) -> Iterator[str]:
    """Yield the lines of one instrument; `others` are drivers that it may be meant for, too."""
    role = roles()[role_of(instance)]
    yield f"  {instance}:\n"
    if role.members:
        places = ", ".join(role.instances)
        yield f"    # {FILL_IN}: one of {places}? They were given in the order found.\n"
    yield f"    # said: {seen.said}\n"
    if others:
        yield f"    # {FILL_IN}: or {', '.join(others)}? Which use is this unit's?\n"
    yield f"    driver: {seen.driver}\n"
    yield f"    address: {scalar(seen.address)}\n"
    if seen.serial:
        yield f"    serial: {scalar(seen.serial)}\n"
    else:
        yield f"    # {FILL_IN}: serial: NUMBER, so that no other unit is taken for this one\n"
    models = [model for model in (role.settings, settings_of(driver)) if model is not None]
    fields = {
        key_of(model, name): field for model in models for name, field in model.model_fields.items()
    }
    if fields:
        needed = ", ".join(f"{key}: …" for key, field in fields.items() if field.is_required())
        yield f"    # {FILL_IN}: settings: {{{needed or '…'}}}\n"
        yield from (f"    #   {key}: {field.description}\n" for key, field in fields.items())
    if role.needed_limits:
        units = {name: role.limits[name].unit for name in role.needed_limits}
        needed = ", ".join(f"{name}: … {unit}" for name, unit in units.items())
        yield f"    # {FILL_IN}: limits: {{{needed}}}\n"
    yield CALIBRATION


def scalar(text: str) -> str:
    """Return a text as a YAML scalar that our reading gives back as the same text."""
    return text if plain_scalar(text) == text and ": " not in text else json.dumps(text)
