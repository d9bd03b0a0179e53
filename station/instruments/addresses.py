"""One instrument address in its several spellings: what each of them stands for here."""

from __future__ import annotations

import os
import re
import socket
import sys
from contextlib import suppress
from ipaddress import IPv4Address, IPv6Address, ip_address
from threading import Thread
from urllib.parse import urlsplit

from station.roles.can_addresses import can_address

RESOLVES_WITHIN_S = 2.0
THIS_COMPUTER = "this computer"
DEFAULT_PORTS = {"modbus-tcp": 502, "socketcand": 29536}
GPIB = re.compile(r"gpib(\d*)::(.*?)(::instr)?")
USB = re.compile(r"usb(\d*)::(\w+)::(\w+)::([^:]+)(?:::(\d+))?(?:::instr)?")
VXI = re.compile(r"tcpip\d*::([^:]+|\[.*\])(?:::([^:]+))?::instr")
SOCKET = re.compile(r"tcpip\d*::(.+)::(\d+)::socket")

HEXADECIMAL = re.compile(r"0x[0-9a-f]+")
NUMBER_16 = r"(?:0x[0-9a-f]{1,4}|\d{1,5})"
VISA_NAMES = {
    "GPIB": (
        re.compile(r"gpib\d*::(?:[12]?\d|30)(?:::(?:[12]?\d|30))?(?:::instr)?", re.IGNORECASE),
        "GPIB0::22::INSTR, with the primary address, 0 to 30, and perhaps a secondary one",
    ),
    "USB": (
        re.compile(
            rf"usb\d*::{NUMBER_16}::{NUMBER_16}::[^:]+(?:::\d+)?(?:::(?:instr|raw))?", re.IGNORECASE
        ),
        "USB0::0x2A8D::0x0101::SERIAL::INSTR, with the numbers of maker and model",
    ),
    "ASRL": (
        re.compile(r"asrl(?:\d+|com\d+|/[^:]+|\\\\\.\\.+)(?:::instr)?", re.IGNORECASE),
        "ASRL/dev/ttyUSB0::INSTR or ASRL3::INSTR",
    ),
}
"""What follows the kind in a resource name of VISA (VPP-4.3, 4.3.1), and an example of each."""
VISA_KINDS = ("TCPIP", "GPIB", "USB", "ASRL", "VXI", "PXI", "VICP", "PRLGX-TCPIP", "PRLGX-ASRL")
PORTED = ("socket", "rfc2217", "modbus-tcp", "socketcand")
SERIAL_PORT = re.compile(r"/.+|COM\d+|\\\\.\\.+", re.IGNORECASE)
KINDS = (
    "a VISA resource such as 'TCPIP::192.168.3.11::5025::SOCKET', 'socket://host:port', "
    "'modbus-tcp://host', 'socketcand://host:port/can0', 'can://socketcan/can0', or a "
    "serial port such as '/dev/ttyUSB0'"
)


def why_unknown(address: str) -> str | None:
    """Return why an address is of no known kind, and what to write; None where it is of one."""
    text = address.strip()
    what = f"'{address}' is no address of a known kind; write {KINDS}"
    scheme, is_url, rest = text.partition("://")
    if is_url:
        return _why_no_url(text, scheme.lower(), rest, what)
    kind, is_visa, rest = text.partition("::")
    if not is_visa:
        return None if SERIAL_PORT.fullmatch(text) else what
    if re.fullmatch(r"TCPIP\d*", kind, re.IGNORECASE):
        return None if _is_whole_tcpip(rest) else what
    if whole := next((name for name in VISA_NAMES if kind.upper().startswith(name)), None):
        form, example = VISA_NAMES[whole]
        why = f"'{text}' is no whole VISA resource name; write it as {example}"
        return None if form.fullmatch(text) else why
    known = any(re.match(rf"{name}(\d*$)", kind, re.IGNORECASE) for name in VISA_KINDS)
    return None if known else what


def _is_whole_tcpip(rest: str) -> bool:
    """Whether a VISA resource name has a host, of a socket with its port."""
    host, *ends = rest.split("::") if "[" not in rest else re.split(r"::(?![^\[]*\])", rest)
    if ends and ends[-1].upper() not in ("SOCKET", "INSTR"):
        return False
    if not host or (":" in host and "[" not in host):
        return False
    if ends[-1:] and ends[-1].upper() == "SOCKET":
        return len(ends) == 2 and ends[0].isdecimal() and 0 < int(ends[0]) < 1 << 16
    return True


def _why_no_url(text: str, scheme: str, rest: str, what: str) -> str | None:
    """Return why a URL is not whole: its scheme, host, port, or the channel of a CAN bus."""
    if scheme == "can":
        try:
            can_address(text)
        except ValueError as error:
            return f"'{text}' is no CAN address: {error}"
    elif scheme == "hwgrep":  # options follow a `&`
        try:
            re.compile(rest.partition("&")[0])
        except re.error as error:
            wrong = f"what follows hwgrep:// is no regular expression ({error})"
            return f"'{text}' is no address: {wrong}"
    elif scheme in PORTED:
        with suppress(ValueError):
            parts = urlsplit(text)
            port = parts.port or DEFAULT_PORTS.get(scheme)
            if parts.hostname and port and (scheme != "socketcand" or len(parts.path) > 1):
                return None
        return what
    return None


def forms_of(address: str, *, resolve: bool = True) -> frozenset[str]:
    """Return what an address stands for; two that may reach the same instrument share a form.

    Host names are resolved, for 2 s at most, to every address that they have, unless `resolve` is
    False: then nothing is asked of the network, and a host stands for itself alone. Links of serial
    ports are followed. Capitals, and numbers that may be left out, make no difference. That a host
    answers on two ports cannot be seen here: behind them may be one instrument, or two.
    """
    text = address.strip()
    lowered = text.lower()
    if match := SOCKET.fullmatch(lowered):
        return tcp_forms(match[1], int(match[2]), resolve)
    if match := VXI.fullmatch(lowered):
        device = match[2] or "inst0"
        # A number after the comma is a port, but of a gateway to GPIB the address of an instrument.
        device = device if device.startswith("gpib") else device.split(",")[0]
        return frozenset(f"{device} at {host}" for host in hosts(match[1], resolve))
    if match := GPIB.fullmatch(lowered):
        return frozenset({f"gpib{number_form(match[1] or '0')}::{match[2]}"})
    if match := USB.fullmatch(lowered):
        maker, model = number_form(match[2]), number_form(match[3])
        return frozenset({f"usb::{maker}::{model}::{match[4]}::{number_form(match[5] or '0')}"})
    if "://" in text:
        return url_forms(text, resolve)
    name = text[4:].split("::")[0] if lowered.startswith("asrl") else text
    return frozenset({port_form(f"COM{name}" if name.isdigit() else name)})


def url_forms(address: str, resolve: bool) -> frozenset[str]:
    """Return what `scheme://host:port/path` stands for."""
    if address.lower().startswith("can:"):
        return frozenset({address.partition("?")[0].lower()})
    with suppress(ValueError):  # a port that is no number: the driver says so; brackets of no host
        parts = urlsplit(address)
        port = parts.port or DEFAULT_PORTS.get(parts.scheme.lower())
        if parts.hostname and port:
            path = parts.path.rstrip("/").lower() if parts.scheme.lower() == "socketcand" else ""
            return frozenset(f"{form}{path}" for form in tcp_forms(parts.hostname, port, resolve))
    return frozenset({address.lower()})


def tcp_forms(host: str, port: int, resolve: bool) -> frozenset[str]:
    """Return what a TCP port of a host stands for."""
    return frozenset(f"tcp {form} {port}" for form in hosts(host, resolve))


def number_form(text: str) -> str:
    """Return a number without zeros before it, and in tens; what is no number as it stands."""
    if HEXADECIMAL.fullmatch(text):
        return str(int(text, 16))
    return text.lstrip("0") or "0" if text.isdecimal() else text


def port_form(name: str) -> str:
    """Return what the name of a serial port stands for."""
    if sys.platform == "win32":
        return name.upper().removeprefix("\\\\.\\")
    return os.path.realpath(name) if name.startswith("/") else name.lower()


def hosts(name: str, resolve: bool) -> frozenset[str]:
    """Return the network addresses that a host has, its name where none is known in time."""
    bare = name.strip("[]").rstrip(".").lower()
    if not resolve:
        with suppress(ValueError):
            return frozenset({str(number_of("127.0.0.1" if bare == "localhost" else bare))})
        return frozenset({bare})
    with suppress(ValueError):
        return frozenset({host_form(bare)})
    resolved: list[str] = []

    def ask() -> None:
        with suppress(OSError, UnicodeError):
            resolved.extend(str(entry[4][0]) for entry in socket.getaddrinfo(bare, None))

    # Nothing but the system limits how long it takes, and it may be long.
    asking = Thread(target=ask, name="resolve", daemon=True)
    asking.start()
    asking.join(RESOLVES_WITHIN_S)
    return frozenset(host_form(numeric) for numeric in [*resolved]) or frozenset({bare})


def host_form(numeric: str) -> str:
    """Return one form of a numeric address; raises ValueError where it is none."""
    address = number_of(numeric)
    if address.is_loopback or address.is_unspecified:
        return THIS_COMPUTER
    family = socket.AF_INET6 if isinstance(address, IPv6Address) else socket.AF_INET
    with suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as trying:
        trying.bind((str(address), 0))  # the system lets only what is its own be taken
        return THIS_COMPUTER
    return str(address)


def number_of(numeric: str) -> IPv4Address | IPv6Address:
    """Return a numeric address, of version 4 where it is one in 6; raises ValueError for none."""
    address = ip_address(numeric.split("%")[0])
    return getattr(address, "ipv4_mapped", None) or address
