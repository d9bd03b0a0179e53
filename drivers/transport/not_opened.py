"""Why a line cannot be opened, and what to do: what systems and libraries say, put in order."""

from __future__ import annotations

import errno
from contextlib import suppress
from pathlib import Path

BUSY = (errno.EBUSY, errno.EAGAIN)
PYTHON_VISA = "@py"
GPIB, USB = "GPIB", "USB"
USUAL_GROUP = "dialout"
NO_LIBRARY = ("error while accessing", "wrapper not found", "could not open visa library")
NO_BACKEND = "please install"
NO_RESOURCE = ("vi_error_inv_rsrc_name", "vi_error_rsrc_nfound")


def why_not_opened(address: str, error: BaseException) -> tuple[str, str] | None:
    """Return what is wrong at an address, and what to do about it; None where nobody answers.

    `error` is what the system, pyserial or the VISA library raised.
    """
    return _serial(address, error) or _visa(address, error)


def _serial(address: str, error: BaseException) -> tuple[str, str] | None:
    port = _port_of(address)
    if port is None:
        return None
    number = error.errno if isinstance(error, OSError) else None
    if number == errno.ENOENT or "no ports found" in str(error):
        return (
            f"this computer has no serial port {port}",
            "plug its adapter in, look with `station scan` which ports there are, and correct the "
            "address in the bench file",
        )
    if number in (errno.EACCES, errno.EPERM):
        group = _group_of(port)
        return (
            f"this user may not use the serial port {port}, which is the group {group}'s",
            f"have an administrator run `usermod -aG {group} USER`, then log in again",
        )
    if number in BUSY:
        return (
            f"another program uses the serial port {port}",
            f"end that program (`fuser -v {port}` shows it on Linux), then try again",
        )
    return None


def _visa(address: str, error: BaseException) -> tuple[str, str] | None:
    reason, kind = str(error).lower(), address.upper()
    if any(words in reason for words in NO_LIBRARY):
        return (
            "the VISA library of settings.visa_library cannot be loaded",
            "install the maker's VISA, or correct its path in the bench file; without "
            f"visa_library the Python library {PYTHON_VISA} is used, for everything but GPIB",
        )
    if NO_BACKEND in reason and kind.startswith(GPIB):
        return (
            "the VISA library in use has no GPIB",
            "state the library of the GPIB adapter's maker as settings.visa_library in the bench "
            "file, or install linux-gpib with its Python package `gpib`",
        )
    if NO_BACKEND in reason and kind.startswith(USB):
        return (
            "the VISA library in use has no USB",
            "install the Python packages `pyusb` and `libusb-package`, or state the maker's "
            "library as settings.visa_library in the bench file",
        )
    if any(words in reason for words in NO_RESOURCE):
        return (
            "the VISA library reports no such resource",
            "switch the instrument on, check its cable, and look with `station scan` which "
            "resources there are",
        )
    return None


def _port_of(address: str) -> str | None:
    """Return the serial port of an address, None for a line of another kind."""
    if address.upper().startswith("ASRL"):
        name = address[4:].split("::")[0]
        return f"COM{name}" if name.isdigit() else name
    other = "::" in address or ("://" in address and not address.startswith("hwgrep://"))
    return None if other else address


def _group_of(port: str) -> str:
    """Return the group that may use a port; that of most systems where it is not known."""
    with suppress(NotImplementedError, OSError, KeyError):
        name = Path(port).group()
        return USUAL_GROUP if name == "root" else name
    return USUAL_GROUP
