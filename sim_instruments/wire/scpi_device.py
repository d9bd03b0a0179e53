"""What every instrument with SCPI does alike: messages in, replies out, status and errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, ClassVar, NamedTuple

from sim_instruments.wire.requests import LineInstrument
from sim_instruments.wire.scpi import (
    NO_ERROR,
    CommandTree,
    ErrorQueue,
    Handler,
    ScpiError,
    none,
    single_parameter,
)
from sim_instruments.wire.scpi import whole_number as whole

REMEMBERED_MESSAGES, MAX_REMEMBERED = 4096, 1024
Give = Callable[[], str | float]
Pair = tuple[Callable[[str], object] | None, Give | None]
"""What takes the parameter of a header, and what gives the answer to its query, if it has them."""


class Listed(NamedTuple):
    """A setting whose command and query get all their parameters, however many."""

    take: Callable[[list[str]], Any] | None = None
    give: Callable[[list[str]], str] | None = None


Value = Pair | Listed | Callable[[], Any]
KeptTable = Mapping[str, tuple[Callable[[str], str | float], str | float]]
"""What reads each setting, and its value after `*RST`."""


def kept(owner: object, name: str, read: Callable[[str], object]) -> Pair:
    """Return a setting that is an attribute of its owner, `read` from the parameter."""
    return lambda text: setattr(owner, name, read(text)), partial(getattr, owner, name)


def taken(owner: object, name: str, take: Callable[[str], object]) -> Pair:
    """Return a setting that `take` changes and an attribute of its owner shows."""
    return take, partial(getattr, owner, name)


def around(
    act: Handler, before: Callable[[], object] | None, after: Callable[[], object] | None
) -> Handler:
    """Return a command with what is called before it and, where it is not refused, after it."""
    if before is None and after is None:
        return act

    def handler(parameters: list[str]) -> None:
        if before is not None:
            before()
        act(parameters)
        if after is not None:
            after()

    return handler


class KeptSettings:
    """Settings that do no more than be kept."""

    def __init__(self, table: KeptTable) -> None:
        self._table = table
        self.reset()

    def reset(self) -> None:
        """Go to the state after `*RST`."""
        self.values = {header: value for header, (_, value) in self._table.items()}

    def commands(self) -> dict[str, Pair]:
        """Return the table of their commands."""
        return {
            header: (partial(self._take, header), partial(self._give, header))
            for header in self._table
        }

    def _take(self, header: str, text: str) -> None:
        self.values[header] = self._table[header][0](text)

    def _give(self, header: str) -> str | float:
        return self.values[header]


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

    protocol = "scpi"
    resource = "TCPIP::{host}::{port}::SOCKET"
    error_queue_depth = 20
    own_texts: ClassVar[Mapping[int, str]] = {}
    """Of errors that SCPI does not have."""
    number_form: ClassVar[str] = "+.8E"
    reply_end: ClassVar[bytes] = b"\n"

    def __init__(self, identity: str, no_error: str = NO_ERROR) -> None:
        self.identity = identity
        self.errors = ErrorQueue(self.error_queue_depth, no_error, self.own_texts)
        self.tree = CommandTree()
        self.only = single_parameter
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

    def add_commands(
        self,
        table: Mapping[str, Value],
        *roots: str,
        before: Callable[[], object] | None = None,
        after: Callable[[], object] | None = None,
    ) -> None:
        """Add headers, behind each of the `roots` where there are any, with what they do.

        A pair is a setting, see `Pair`; what stands alone takes no parameter: it acts, or answers
        where its header ends with `?`. `before` and `after` are called around each that is no
        query, `after` where it was not refused.
        """
        for header, does in table.items():
            act, answer = self._handlers(header, does)
            for root in roots or ("",):
                if act is not None:
                    self.tree.add(root + header, around(act, before, after))
                if answer is not None:
                    self.tree.add(f"{root}{header.removesuffix('?')}?", answer)

    add_settings = add_commands
    """Its name before there was more in a table."""

    def _handlers(self, header: str, does: Value) -> tuple[Handler | None, Handler | None]:
        """Return what a header does as a command, and as a query."""
        if isinstance(does, Listed):
            return does.take, does.give
        if isinstance(does, tuple):
            take, give = does
            return take and self._taking(take), give and self._answer(give)
        return (None, self._answer(does)) if header.endswith("?") else (self._do(does), None)

    def written(self, value: str | float) -> str:
        """Return a value as the instrument answers it: a switch as 1 or 0."""
        if isinstance(value, str):
            return value
        return str(int(value)) if isinstance(value, int) else format(value, self.number_form)

    def refuse(self, code: int, more: str = "") -> None:
        """Put an error into the queue and its class into the standard event register."""
        self.errors.push(code, more)
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
        self.add_commands(
            {
                "*IDN?": lambda: self.identity,
                "*TST?": lambda: "0",
                "*OPC?": lambda: "1",
                "*OPC": self._operation_complete,
                "*WAI": lambda: None,
                "*RST": self.reset,
                "*CLS": self._clear,
                "*ESR?": self._take_standard_event,
                "*ESE": kept(self, "_standard_enable", partial(whole, minimum=0, maximum=255)),
                "*SRE": kept(self, "_service_enable", partial(whole, minimum=0, maximum=255)),
                "*STB?": self._status_byte,
                "SYSTem:ERRor[:NEXT]?": lambda: self.errors.pop(),
                "SYSTem:ERRor:ALL?": lambda: self.errors.pop_all(),
                "SYSTem:ERRor:COUNt?": lambda: len(self.errors),
                "SYSTem:VERSion?": lambda: "1997.0",
                "STATus:PRESet": self._preset,
            }
        )
        for name, group in (("OPERation", self.operation), ("QUEStionable", self.questionable)):
            registers: dict[str, Value] = {
                ":CONDition?": group.condition,
                "[:EVENt]?": group.take_event,
                ":ENABle": kept(group, "enable", partial(whole, minimum=0, maximum=65535)),
            }
            self.add_commands(registers, f"STATus:{name}")

    def _answer(self, give: Give) -> Handler:
        def handler(parameters: list[str]) -> str:
            none(parameters)
            return self.written(give())

        return handler

    def _taking(self, take: Callable[[str], object]) -> Handler:
        only = self.only

        def handler(parameters: list[str]) -> None:
            take(only(parameters))

        return handler

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

    def _status_byte(self) -> int:
        byte = 4 * bool(self.errors) + 8 * self.questionable.summary()
        byte += 32 * bool(self._standard_event & self._standard_enable)
        byte += 128 * self.operation.summary()
        return byte + 64 * bool(byte & self._service_enable)
