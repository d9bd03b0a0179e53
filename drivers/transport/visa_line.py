"""Text messages over VISA: a request and its answer as one exchange."""

from __future__ import annotations

import math
import select
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pyvisa
from pyvisa import constants

from drivers.roles import Place
from drivers.transport.answers import number_of, shortened
from drivers.transport.traced import TracedLine
from station.errors import InstrumentError, InstrumentTimeout

EXCHANGE_DEADLINE_S = 0.5
CONNECT_DEADLINE_S = 2.0
LARGEST_ANSWER_BYTES = 1 << 20
ENCODING = "ascii"


def resource_manager(library: str) -> pyvisa.ResourceManager:
    """Return the resource manager of a VISA library, `@py` or the path of the vendor's."""
    # PyVISA keeps one a library and makes a new one where somebody closed it.
    return pyvisa.ResourceManager(library)


def is_socket(resource_name: str) -> bool:
    """Whether a resource is a bare TCP connection, where nothing but the bytes ends an answer."""
    parts = resource_name.split("::")
    return len(parts) == 4 and parts[-1].upper() == "SOCKET"


def wire_address(resource_name: str) -> str:
    """Return `host:port` of a socket resource, else the resource name itself."""
    parts = resource_name.split("::")
    return f"{parts[1]}:{parts[2]}" if is_socket(resource_name) else resource_name


def has_ended(resource: Any) -> bool:
    """Whether the other side of a bare TCP connection has closed it.

    PyVISA-py takes that for silence; False where it keeps its socket elsewhere, or with the
    vendor's library.
    """
    session = getattr(resource.visalib, "sessions", {}).get(resource.session)
    its_socket = getattr(session, "interface", None)
    if not isinstance(its_socket, socket.socket):
        return False
    try:
        readable, _, _ = select.select([its_socket], [], [], 0)
        return bool(readable) and its_socket.recv(1, socket.MSG_PEEK) == b""
    except (OSError, ValueError):
        return True


class VisaLine(TracedLine):
    """One instrument's line; ends of lines are stripped from answers and added to requests.

    An answer is complete with the last character of `answer_end`.
    """

    def __init__(self, place: Place, *, request_end: str = "\n", answer_end: str = "\n") -> None:
        super().__init__(place)
        self._request_end = request_end
        self._answer_end = answer_end.encode(ENCODING)
        self._lock = place.clock.lock(place.name)
        self._wire = place.clock.wire(wire_address(place.address))
        self._resource: Any = None
        self._timeout_ms = math.nan
        self._opened = 0
        self._connect()

    def query(self, message: str, deadline_s: float = EXCHANGE_DEADLINE_S) -> str:
        """Send `message` and return the answer without its end.

        Raises InstrumentTimeout when no complete answer comes within `deadline_s` of run time.
        """
        with self._lock:
            self._write(message)
            try:
                answer = self._read(message, deadline_s)
                self._wire.received()
                return answer
            except BaseException:  # whoever comes next must not read this answer as its own
                self._disconnect()
                raise

    def write(self, message: str) -> None:
        """Send `message`, for commands whose protocol has no answer to ask for with them."""
        with self._lock:
            self._write(message)

    def close(self) -> None:
        """Close the line; a line that is already gone is no error."""
        if self._resource is not None:
            self._traced("-", b"closed")
        self._disconnect()

    def _connect(self) -> None:
        library = str(self._place.settings.get("visa_library", "@py"))
        try:
            self._resource = resource_manager(library).open_resource(
                self._place.address,
                open_timeout=int(1000 * CONNECT_DEADLINE_S),
                read_termination=self._answer_end.decode(ENCODING),
                write_termination=self._request_end,
            )
        except Exception as error:  # pyvisa-py raises bare Exception for a refused connection
            raise self._nobody_answers(error) from error
        self._resource.chunk_size = LARGEST_ANSWER_BYTES
        if is_socket(self._place.address):
            # What came of an answer without its end is then given out, and can be shown.
            with suppress(pyvisa.errors.Error):
                attribute = constants.ResourceAttribute.suppress_end_enabled
                self._resource.set_visa_attribute(attribute, False)
        self._timeout_ms = math.nan
        self._wire.open()
        self._opened += 1
        self._traced("-", b"opened" if self._opened == 1 else b"reopened")

    def _disconnect(self) -> None:
        self._wire.close()
        if self._resource is not None:
            with suppress(pyvisa.errors.Error, OSError):
                self._resource.close()
            self._resource = None

    def _write(self, message: str) -> None:
        if self._resource is None:
            # After a timeout a late answer would be taken for the next one: a fresh line has none.
            self._connect()
        sent = (message + self._request_end).encode(ENCODING)
        try:
            self._wire.sent(len(sent))
            self._traced(">", sent)
            self._resource.write_raw(sent)
        except (pyvisa.errors.Error, OSError) as error:
            raise self._broken(message, error) from error

    def _read(self, message: str, deadline_s: float) -> str:
        """Return the answer, which is complete with the last character of its end."""
        if not self._wire.wait(self._clock.now() + deadline_s):
            raise self._silent(message, "no answer came", deadline_s)
        answer, last = b"", self._answer_end[-1:]
        until_s = self._clock.now() + self._clock.patience_s(deadline_s)
        left_s = deadline_s
        try:
            while not answer.endswith(last) and left_s > 0:
                self._limit_read(left_s)
                answer += self._resource.read_raw()
                left_s = until_s - self._clock.now()
        except pyvisa.errors.VisaIOError as error:
            if error.error_code != constants.StatusCode.error_timeout:
                raise self._broken(message, error) from error
        except (OSError, pyvisa.errors.Error) as error:
            raise self._broken(message, error) from error
        finally:
            if answer:
                self._traced("<", answer)
        if not answer:
            raise self._silent(message, "no answer came", deadline_s)
        text = answer.decode(ENCODING, "backslashreplace")
        if not answer.endswith(last):
            what = f"only {shortened(text)!r} came, without the end of an answer,"
            raise self._silent(message, what, deadline_s)
        if not answer.isascii():
            raise self._fault(
                f"sent {shortened(message)!r}",
                f"{shortened(text)!r} came back, which is no text",
                "check the cable, and the baud rate where the line is serial",
            )
        end = self._answer_end if answer.endswith(self._answer_end) else last
        return text[: -len(end)]

    def _limit_read(self, run_seconds: float) -> None:
        timeout_ms = 1000 * self._clock.real_timeout_s(run_seconds)
        if timeout_ms != self._timeout_ms:  # it is nearly always the same, and setting it is slow
            self._resource.timeout = self._timeout_ms = timeout_ms

    def _silent(self, message: str, what: str, deadline_s: float) -> InstrumentError:
        if has_ended(self._resource):
            return self._fault(
                f"sent {shortened(message)!r}",
                f"{what} and the other side closed the connection",
                "check that nobody else uses the instrument, its network cable and its power",
                InstrumentTimeout,
            )
        return self._fault(
            f"sent {shortened(message)!r}",
            f"{what} within {deadline_s:g} s",
            "check that the instrument is on, in remote mode, and its cable is seated",
            InstrumentTimeout,
        )

    def _broken(self, message: str, error: BaseException) -> InstrumentError:
        self._disconnect()
        return self._fault(
            f"sent {shortened(message)!r}",
            f"the line broke ({error})",
            "check the cable and the instrument's power, then start again",
        )


class ScpiLine(VisaLine):
    """A VISA line whose instrument keeps an error queue that is asked in the same message.

    `error_query` is appended to each command; `no_error(answer)` tells an empty queue.
    """

    def __init__(
        self,
        place: Place,
        *,
        error_query: str,
        no_error: Callable[[str], bool],
        answer_end: str = "\n",
    ) -> None:
        super().__init__(place, answer_end=answer_end)
        self._error_query = error_query
        self._no_error = no_error

    def command(self, message: str) -> None:
        """Send a command and read the error queue in one exchange; a refusal is InstrumentError."""
        answer = self.query(f"{message};{self._error_query}")
        if not self._no_error(answer):
            raise self.refused(message, answer)

    def refused(self, message: str, answer: str) -> InstrumentError:
        """Return the error of a command that the instrument refused with `answer`."""
        return InstrumentError(
            self._place.name,
            f"sent {shortened(message)!r}",
            f"it refused with {shortened(answer)}",
            "compare the plan's and the bench file's values with the instrument's ranges",
        )

    def number(self, message: str) -> float:
        """Return the answer to `message` as a finite number; anything else is InstrumentError."""
        return number_of(self._place.name, message, self.query(message))
