"""What VISA libraries and the system list on this computer, each in a process of its own."""

from __future__ import annotations

from station.instruments.own_process import asked_alone

VISA_WITHIN_S = 20.0
PORTS_WITHIN_S = 8.0
Listed = tuple[str, str, bool]
"""An address, what is said there, and whether that is the answer to `*IDN?`."""
LIST_VISA = """\
import json, sys, warnings
import pyvisa
warnings.simplefilter("ignore")  # what the library could find with further packages
manager = pyvisa.ResourceManager(sys.argv[1])
for name in sorted(manager.list_resources()):
    if not name.endswith("::INSTR") or name.startswith("ASRL"):
        continue
    print(json.dumps([name, "no answer to *IDN? (its library does not return)", False]), flush=True)
    try:
        with manager.open_resource(name, open_timeout=1000) as resource:
            resource.timeout = 1000
            said, answered = resource.query("*IDN?").strip(), True
    except Exception as error:
        said, answered = f"no answer to *IDN? ({error})", False
    print(json.dumps([name, said, answered]), flush=True)
"""
LIST_PORTS = """\
import json
from serial.tools.list_ports import comports
for port in sorted(comports()):
    if port.hwid != "n/a":
        print(json.dumps([f"ASRL{port.device}::INSTR", f"serial port, {port.description}", False]))
"""


def visa_resources(
    library: str, *, program: str = LIST_VISA, within_s: float = VISA_WITHIN_S
) -> list[Listed]:
    """Return each resource that a VISA library lists, asked who it is; serial ports left out.

    `program` prints address, words and whether they are an answer, as JSON, the last line of an
    address counts. A library that fails or does not return in time is a line of its own.
    """
    lines, why = asked_alone(program, library, within_s)
    listed = list({line[0]: (line[0], line[1], line[2]) for line in lines}.values())
    if why:
        listed.append((library, f"this VISA library lists no more ({why})", False))
    return listed


def serial_ports(*, program: str = LIST_PORTS, within_s: float = PORTS_WITHIN_S) -> list[Listed]:
    """Return the serial ports of this computer with what their adapters say of themselves."""
    lines, why = asked_alone(program, "", within_s)
    listed = [(line[0], line[1], line[2]) for line in lines]
    return [*listed, ("ASRL", f"the serial ports are not listed ({why})", False)] if why else listed
