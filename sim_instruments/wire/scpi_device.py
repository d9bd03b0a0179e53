"""What every instrument with SCPI does alike: messages in, replies out, status and errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import ClassVar

from sim_instruments.wire.requests import LineInstrument
from sim_instruments.wire.scpi import (
    CommandTree,
    ErrorQueue,
    Handler,
    ScpiError,
    none,
    single_parameter,
)
from sim_instruments.wire.scpi import whole_number as whole

REMEMBERED_MESSAGES, MAX_REMEMBERED = 4096, 1024
Value = tuple[Callable[[str], None] | None, Callable[[], str] | None]
"""What takes the parameter of a header, and what gives the answer to its query."""


class StatusGroup:
    """A condition register computed on demand, with its latched events and its enable mask."""

    def __init__(self, condition: Callable[[], int]) -> None:
        self._condition = condition
        self._event = 0
        self.enable = 0

    def condition(self) -> int:
        """Return the present condition, which also latches its bits as events."""
        now = self._condition()
        self._event |= now
        return now

    def take_event(self) -> int:
        """Return the latched events and clear them."""
        self.condition()
        event, self._event = self._event, 0
        return event

    def summary(self) -> bool:
        """Return whether an enabled event is latched."""
        self.condition()
        return bool(self._event & self.enable)

    def latch(self, bits: int) -> None:
        """Latch events that the condition does not show."""
        self._event |= bits

    def clear(self) -> None:
        """Clear the latched events."""
        self._event = 0


class ScpiDevice(LineInstrument):
    """The IEEE 488.2 commands, the status groups and the error queue of one instrument."""

    error_queue_depth = 20
    reply_end: ClassVar[bytes] = b"\n"

    def __init__(self, identity: str) -> None:
        self.identity = identity
        self.errors = ErrorQueue(self.error_queue_depth)
        self.tree = CommandTree()
        self.operation = StatusGroup(self.operation_condition)
        self.questionable = StatusGroup(self.questionable_condition)
        self._standard_event = 0
        self._standard_enable = 0
        self._service_enable = 0
        self._parsed: dict[str, list[tuple[Handler | ScpiError, list[str]]]] = {}
        self._add_common()

    def operation_condition(self) -> int:
        """Return the operation condition register."""
        return 0

    def questionable_condition(self) -> int:
        """Return the questionable condition register."""
        return 0

    def reset(self) -> None:
        """Go to the state after `*RST`."""

    def before_each(self) -> None:
        """Bring the instrument's state up to the present before a command acts on it."""

    def execute(self, message: str) -> str | None:
        """Carry out one message; return the replies joined by `;`, or None when there is none.

        A refused command leaves an entry in the error queue; the rest of the message is still
        carried out.
        """
        replies = []
        for handler, parameters in self._lookup(message):
            try:
                if isinstance(handler, ScpiError):
                    raise handler
                self.before_each()
                reply = handler(parameters)
            except ScpiError as error:
                self.refuse(error.code)
                continue
            if reply is not None:
                replies.append(reply)
        return ";".join(replies) if replies else None

    def knows(self, command: str) -> bool:
        """Whether the instrument has every header of a message."""
        return not any(isinstance(handler, ScpiError) for handler, _ in self._lookup(command))

    def _line(self, line: bytes) -> bytes:
        reply = self.execute(line.decode("ascii", "replace").strip())
        return b"" if reply is None else reply.encode("ascii") + self.reply_end

    def _too_long(self) -> bytes:
        self.refuse(-363)
        return b""

    def add_settings(self, settings: Mapping[str, Value], *roots: str) -> None:
        """Add headers, behind each of the `roots` where there are any, that hold one value.

        Each is set by its only parameter and asked for without one; None where it cannot be.
        """
        for root in roots or ("",):
            for header, (take, give) in settings.items():
                if take is not None:
                    self.tree.add(root + header, self._taking(take))
                if give is not None:
                    self.tree.add(f"{root}{header}?", self._answer(give))

    def refuse(self, code: int) -> None:
        """Put an error into the queue and its class into the standard event register."""
        self.errors.push(code)
        kind = -code // 100
        self._standard_event |= {1: 32, 2: 16, 3: 8, 4: 4}.get(kind, 8)

    def _lookup(self, message: str) -> list[tuple[Handler | ScpiError, list[str]]]:
        known = self._parsed.get(message)
        if known is None:
            known = []
            for unit in self.tree.parse(message):
                try:
                    handler: Handler | ScpiError = self.tree.find(unit)
                except ScpiError as error:
                    handler = error
                known.append((handler, unit.parameters))
            if len(self._parsed) < REMEMBERED_MESSAGES and len(message) < MAX_REMEMBERED:
                self._parsed[message] = known
        return known

    def _add_common(self) -> None:
        add = self.tree.add
        add("*IDN?", self._answer(lambda: self.identity))
        add("*TST?", self._answer(lambda: "0"))
        add("*OPC?", self._answer(lambda: "1"))
        add("*OPC", self._do(self._operation_complete))
        add("*WAI", self._do(lambda: None))
        add("*RST", self._do(self.reset))
        add("*CLS", self._do(self._clear))
        add("*ESR?", self._answer(self._take_standard_event))
        add("*ESE?", self._answer(lambda: str(self._standard_enable)))
        add("*ESE", self._set_standard_enable)
        add("*SRE?", self._answer(lambda: str(self._service_enable)))
        add("*SRE", self._set_service_enable)
        add("*STB?", self._answer(lambda: str(self._status_byte())))
        add("SYSTem:ERRor[:NEXT]?", self._answer(self.errors.pop))
        add("SYSTem:ERRor:ALL?", self._answer(self.errors.pop_all))
        add("SYSTem:ERRor:COUNt?", self._answer(lambda: str(len(self.errors))))
        add("SYSTem:VERSion?", self._answer(lambda: "1997.0"))
        add("STATus:PRESet", self._do(self._preset))
        for name, group in (
            ("OPERation", self.operation),
            ("QUEStionable", self.questionable),
        ):
            self._add_group(f"STATus:{name}", group)

    def _add_group(self, header: str, group: StatusGroup) -> None:
        def enable(parameters: list[str]) -> None:
            group.enable = whole(single_parameter(parameters), 0, 65535)

        self.tree.add(f"{header}:CONDition?", self._answer(lambda: str(group.condition())))
        self.tree.add(f"{header}[:EVENt]?", self._answer(lambda: str(group.take_event())))
        self.tree.add(f"{header}:ENABle?", self._answer(lambda: str(group.enable)))
        self.tree.add(f"{header}:ENABle", enable)

    @staticmethod
    def _answer(reply: Callable[[], str]) -> Handler:
        def handler(parameters: list[str]) -> str:
            none(parameters)
            return reply()

        return handler

    def _taking(self, take: Callable[[str], None]) -> Handler:
        return lambda parameters: take(self.only(parameters))

    @staticmethod
    def only(parameters: list[str]) -> str:
        """Return the only parameter; ScpiError -109 without one, -108 with more."""
        return single_parameter(parameters)

    @staticmethod
    def _do(act: Callable[[], None]) -> Handler:
        def handler(parameters: list[str]) -> None:
            none(parameters)
            act()

        return handler

    def _operation_complete(self) -> None:
        self._standard_event |= 1

    def _clear(self) -> None:
        self.errors.clear()
        self.operation.clear()
        self.questionable.clear()
        self._standard_event = 0

    def _preset(self) -> None:
        self.operation.enable = self.questionable.enable = 0

    def _take_standard_event(self) -> str:
        event, self._standard_event = self._standard_event, 0
        return str(event)

    def _set_standard_enable(self, parameters: list[str]) -> None:
        self._standard_enable = whole(single_parameter(parameters), 0, 255)

    def _set_service_enable(self, parameters: list[str]) -> None:
        self._service_enable = whole(single_parameter(parameters), 0, 255)

    def _status_byte(self) -> int:
        byte = 4 * bool(self.errors) + 8 * self.questionable.summary()
        byte += 32 * bool(self._standard_event & self._standard_enable)
        byte += 128 * self.operation.summary()
        return byte + 64 * bool(byte & self._service_enable)
