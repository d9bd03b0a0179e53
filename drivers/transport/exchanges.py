"""Exchanges: one question and its answer at a time, in step, with patience and proof.

What lies on a line before a question is the answer to nothing, or the true answer to the question
before. What comes behind an answer is no better. Either is an event of the run, the line is brought
into step again, and the question is asked again where the driver says that this does no harm; else
it is a fault. A harmless question whose line broke is asked again over a new connection.

A driver declares which of its messages do no harm when the instrument gets them twice: its
`repeatable`. On the way to rest, where a lost answer must not end in a coil that is cut off at full
current, and by whoever watches a level, such a message is sent again whatever went wrong with it.
In a step it is sent again only where its line broke, or where its answer was not the only one that
came. Any other fault, and each one of any other message, ends the run at once.
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import lru_cache
from types import MappingProxyType
from typing import Any, TypeVar

from drivers.transport.ports import Attachment, Port, TracedLine
from station.errors import InstrumentError, InstrumentTimeout, reason_of
from station.roles import EXCHANGE_DEADLINE_S, TRIES, Place
from station.roles.base import ANSWER_TIME
from station.roles.patience import PATIENT, patience

Answer = TypeVar("Answer")

MESSAGES_KEPT = 256
"""Queries come again and again; of set-points there is no end."""

QUIET_S = 0.1
"""A line on which nothing has come for this run time has nothing more on its way."""

QUIET_LOOKS = 5
LARGEST_ANSWER_BYTES = 1 << 20
LARGEST_NOTE_BYTES = 4096


class AnswerInDoubt(InstrumentError):
    """An answer that may belong to another question, or to none."""


class LineBroken(InstrumentError):
    """A connection that ended while it was used."""


class TooLate(InstrumentError):
    """A message that was not sent: its line had to be brought into step, and its moment is over."""


class Repeatable:
    """The messages of an instrument that may be sent twice.

    Each pattern is a regular expression for one whole command, upper and lower case alike, without
    the colon before it. A message of several commands, joined by `;`, is repeatable when each of
    them is and starts from the root again (`:` or `*`): what a relative header means depends on
    the one before it. An instrument without such headers has `rooted` False.
    """

    def __init__(self, *patterns: str, rooted: bool = True) -> None:
        self._rooted = rooted
        self._pattern = re.compile(
            "|".join(f"(?:{pattern})" for pattern in patterns), re.IGNORECASE
        )
        self._known = lru_cache(MESSAGES_KEPT)(self._all_match)

    def __contains__(self, message: object) -> bool:
        return self._known(str(message))

    def _all_match(self, message: str) -> bool:
        first, *others = message.split(";")
        rooted = not self._rooted or all(other.lstrip().startswith((":", "*")) for other in others)
        commands = [command.strip().removeprefix(":") for command in (first, *others)]
        return rooted and all(self._pattern.fullmatch(command) for command in commands)


NEVER = Repeatable(r"(?!)")
"""Nothing may be sent twice."""


def patiently(repeatable: Repeatable, message: str, exchange: Callable[[], Answer]) -> Answer:
    """Return what an exchange of `message` brings.

    Where one lost answer must not decide (`patience`) and the message is repeatable, the exchange
    is tried three times, as a whole, before its error is believed.
    """
    if PATIENT.get() and message in repeatable:
        with patience(granted=False):
            for _ in range(TRIES - 1):
                with suppress(InstrumentError):
                    return exchange()
            return exchange()
    return exchange()


class ExchangeLine(TracedLine, ABC):
    """What a line of exchanges does whatever its messages look like.

    `repeatable` has the messages that do no harm twice, `deadlines` the s that a message with a
    pattern may take. After an exchange that failed the port is opened anew, so that no late answer
    is taken for the next.
    """

    largest_bytes = LARGEST_ANSWER_BYTES
    pause_s = 0.0
    """Run time that an instrument needs after a message or an answer before the next message."""

    padding: bytes = b""
    """What may come behind an answer, early or late, without being anything."""

    def __init__(
        self,
        place: Place,
        attachment: Attachment,
        repeatable: Repeatable = NEVER,
        deadlines: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        super().__init__(place)
        self._attachment = attachment
        self._deadlines = deadlines
        self._stated_s = lru_cache(MESSAGES_KEPT)(self._longest_stated_s)
        self._lock = place.clock.lock(f"{place.name} line")
        self._wire = place.clock.wire(attachment.wire)
        self._repeatable = repeatable
        self.proof = Proof(place, self)
        self._port: Port | None = None
        self._opened = 0
        self._must_calm = False
        self._free_s = -math.inf
        self._last: tuple[str, object] | None = None
        """The last question and its answer, which is in doubt where something comes after it."""
        self.doubts = 0
        """How often something was found that nobody had asked for."""
        self.padded = False
        """Whether `padding` has come behind an answer yet."""
        self.delays = 0
        """How often the line was opened anew or read until quiet, which takes time."""
        self._open()

    def close(self) -> None:
        """Close the line; one that is already gone is no error."""
        if self._port is not None:
            self._traced("-", b"closed")
        self._disconnect()

    def patiently(
        self, message: str, exchange: Callable[[], Answer], *, now: bool = False
    ) -> Answer:
        """Return what an exchange of `message` brings, by `patiently`; `now` it goes once."""
        return exchange() if now else patiently(self._repeatable, message, exchange)

    @property
    def patient(self) -> Any:
        """This line with `patience`, as drivers of before ask on their way to rest."""
        return Patient(self)

    @patience()
    def repeated(self, message: str, exchange: Callable[[], Answer]) -> Answer:
        """Return what an exchange brings, with `patience`, as drivers of before ask."""
        return self.patiently(message, exchange)

    @abstractmethod
    def echoes_identity(self) -> bool:
        """Whether the answer to who is there is the identity."""

    def resynchronise(self) -> None:
        """Have the next exchange begin on a line that is opened anew and quiet."""
        with self._lock:
            self._last, self._must_calm = None, True
            if self._port is not None and self._port.is_connection:
                self._disconnect()

    def _greet(self, port: Port) -> None:
        """Send what a line that is opened anew needs before it is read until quiet."""

    def _prove(self, port: Port) -> None:
        """Ask who is there, on a line that was out of step; raises InstrumentError for another."""

    def _settle(self, port: Port, message: str, answer: object) -> None:
        """Do away with the doubt about the last answer, or raise InstrumentError."""
        if message not in self._repeatable:
            raise self._fault(
                f"sent {shortened(message)!r}",
                "something came after its answer, which is therefore in doubt",
                self._attachment.when_wrong,
            )

    def _exchange(
        self, message: str, once: Callable[[Port], Answer], *, now: bool = False
    ) -> Answer:
        """Return the answer to a message; `once` sends it on a port and reads the answer.

        A message that does no harm twice is asked at most three times where its line breaks or its
        answer is in doubt. One that is due `now` is sent once, and not at all (TooLate) where the
        line must be brought into step before.
        """
        with self._lock:
            tries = TRIES if message in self._repeatable and not now else 1
            while True:
                tries -= 1
                try:
                    delays = self.delays
                    port = self._ready(message)
                    if now and self.delays != delays:
                        raise self._too_late(message)
                    answer = self._timed(message, once, port)
                    self._nothing_behind(port, message)
                    self._last = message, answer
                    return answer
                except TooLate:  # nothing was sent, and the line is in step
                    raise
                except (AnswerInDoubt, LineBroken) as error:
                    self._forget_connection()
                    if not tries:
                        raise
                    if isinstance(error, LineBroken):
                        self._place.note(
                            "line-reopened", message=shortened(message), why=str(error)
                        )
                except BaseException:  # whoever comes next must not read this answer as its own
                    self._forget_connection()
                    raise

    def deadline_of_s(self, message: str) -> float:
        """Return how long the answer to a message may take from now on, s of run time."""
        return self._place.exchanges.deadline_of_s(self._stated_s(message), self._clock.now())

    def _longest_stated_s(self, message: str) -> float:
        """Return the deadline that the driver states of a message, or the usual one, s."""
        stated_s = [
            deadline_s
            for pattern, deadline_s in self._deadlines.items()
            if re.search(pattern, message, re.IGNORECASE)
        ]
        return max(stated_s, default=EXCHANGE_DEADLINE_S)

    def _timed(self, message: str, once: Callable[[Port], Answer], port: Port) -> Answer:
        """Return the answer of one exchange, and note where it took much of its deadline."""
        deadline_s, began_s = self.deadline_of_s(message), self._clock.now()
        answer = once(port)
        took_s = self._clock.now() - began_s
        if self._place.exchanges.is_noteworthy(took_s, deadline_s):
            times = {"took_s": round(took_s, 3), "deadline_s": deadline_s}
            self._place.note(ANSWER_TIME, message=shortened(message), **times)
        return answer

    def _ready(self, message: str) -> Port:
        """Return the port, opened again after a fault, with nothing on it before a message."""
        port = self._port
        if port is None:
            port = self._open()
            self._prove(port)  # behind the address there may be another one by now
            return port
        try:
            came = self._taken_off(port)
        except OSError as error:
            raise self._broken(f"send {shortened(message)!r}", error) from error
        if self._meant(came) or self._must_calm:
            port = self._in_step_again(port, came)
        return port

    def _in_step_again(self, port: Port, came: bytes) -> Port:
        """Return the port of a line on which something had come, with nothing on it any more."""
        last, self._last = self._last, None
        if came:
            self._doubt(came, last[0] if last else "")
        self._must_calm = True
        if port.is_connection:
            self._disconnect()  # what is still on its way ends with the connection
            port = self._open()
        else:
            self._await_quiet(port)
        self._prove(port)
        if last is not None and came:
            self._settle(port, *last)
        return port

    def _nothing_behind(self, port: Port, message: str) -> None:
        """Raise AnswerInDoubt where there is more on the line than the answer."""
        behind = b""
        with suppress(OSError):  # a connection that ends here is seen by whoever comes next
            behind = self._meant(port.read(0.0))
        if behind:
            self._doubt(behind, message)
            raise self._doubtful(f"sent {shortened(message)!r}", "more came behind its answer")

    def _doubt(self, came: bytes, asked: str) -> None:
        """Note that something came which nobody had asked for, behind an answer to `asked`."""
        self.doubts += 1
        self._must_calm = True
        self._traced("<", came)
        self._traced("-", b"not asked for, forgotten")
        text = came[:LARGEST_NOTE_BYTES].decode("ascii", "backslashreplace")
        self._place.note("line-resynchronised", came=shortened(text), after=shortened(asked))

    def _attempt(self, send: Callable[[Port], None], attempted: str) -> None:
        """Send the one command that switches off where no answer can be understood any more."""
        self._blindly(send, QUIET_S)
        self._place.note("switched-off-at-once", attempted=attempted)  # sent: no more is known

    def _blindly(self, send: Callable[[Port], None], heard_s: float = 0.0) -> None:
        """Send what needs no answer, whatever lies on the line and whatever still comes.

        The instrument is given some run time to hear it, before the line may be opened anew.
        """
        with self._lock:
            self._last = None
            try:
                send(self._port if self._port is not None else self._open(calm=False))
                if heard_s:
                    self._clock.sleep(heard_s)
            except BaseException:
                self._forget_connection()
                raise

    def _open(self, *, calm: bool = True) -> Port:
        port: Port | None = None
        try:
            port = self._wire.port() or self._attachment.open()
            self._wire.open()
            self._opened += 1
            self.delays += 1
            self._traced("-", b"opened" if self._opened == 1 else b"reopened")
            fresh = self._opened == 1 and port.is_connection
            if self._must_calm or not (fresh or self._attachment.begins_quiet):
                self._greet(port)
                if calm:
                    self._await_quiet(port)
        except BaseException as error:
            self._wire.close()
            if port is not None:
                port.close()
            if not isinstance(error, OSError | ValueError):
                raise
            raise self._not_opened(error) from error
        self._port = port
        return port

    def _await_quiet(self, port: Port) -> None:
        """Read until nothing has come for a while; what comes is no answer to anything.

        Raises InstrumentError where it never ends.
        """
        self.delays += 1
        for _ in range(QUIET_LOOKS):
            self._clock.sleep(QUIET_S)
            came = self._taken_off(port)
            if not came:
                self._must_calm = False
                return
            self._traced("<", came)
            self._traced("-", b"not asked for, forgotten")
        raise self._fault(
            f"waited {QUIET_LOOKS * QUIET_S:g} s for an empty line",
            "it never stops sending",
            "switch the instrument off and on, and see that nobody else talks to it",
        )

    def _taken_off(self, port: Port) -> bytes:
        """Take what has come off the line; raises InstrumentError where there is no end to it."""
        taken = port.read(0.0)
        while taken and (more := port.read(0.0)):
            taken += more
            if len(taken) > self.largest_bytes:
                raise self._flooded("looked for what had come unasked")
        if taken:
            self._wire.received()
        return self._meant(taken)

    def _meant(self, came: bytes) -> bytes:
        """Return what came unasked if it could be taken for an answer: nothing where it is none."""
        self.padded |= bool(came) and not came.strip(self.padding)
        return came if came.strip(self.padding) else b""

    def _forget_connection(self) -> None:
        self._last = None
        self._disconnect()

    def _disconnect(self) -> None:
        self._wire.close()
        port, self._port = self._port, None
        if port is not None:
            with suppress(OSError):
                port.close()

    def keep_pause(self) -> None:
        """Leave the instrument the time that it needs before the next message."""
        if self.pause_s and self._clock.now() < self._free_s:
            self._clock.sleep_until(self._free_s)

    def _send(self, port: Port, attempted: str, data: bytes) -> None:
        self.keep_pause()
        try:
            self._wire.sent(len(data))
            self._traced(">", data)
            port.write(data)
            self._free_s = self._clock.now() + self.pause_s
        except OSError as error:
            raise self._broken(attempted, error) from error

    def _receive(
        self, port: Port, attempted: str, deadline_s: float, is_whole: Callable[[bytes], bool]
    ) -> bytes:
        """Return what came until it was whole, or until no more did; never nothing.

        Raises InstrumentTimeout where nothing comes, and InstrumentError where there is no end.
        """
        if not self._wire.wait(self._clock.now() + deadline_s):
            try:
                port.read(0.0)
            except OSError as error:
                raise self._broken(attempted, error) from error
            raise self._silent(attempted, "no answer came", deadline_s)
        until_s = self._clock.now() + self._clock.patience_s(deadline_s)
        left_s, answer = deadline_s, b""
        try:
            while left_s > 0:
                came = port.read(self._clock.real_timeout_s(left_s))
                answer += came
                if not came or is_whole(answer):
                    break
                if len(answer) > self.largest_bytes:
                    raise self._flooded(attempted)
                left_s = until_s - self._clock.now()
        except OSError as error:
            raise self._broken(attempted, error, answer) from error
        finally:
            if answer:
                self._traced("<", answer)
        if not answer:
            raise self._silent(attempted, "no answer came", deadline_s)
        self._wire.received()
        self._free_s = self._clock.now() + self.pause_s
        return answer

    def _flooded(self, attempted: str) -> InstrumentError:
        self._must_calm = True
        return self._fault(
            attempted,
            f"more than {self.largest_bytes} bytes came without the end of an answer",
            "switch the instrument off and on, check its address and the settings of its line",
        )

    def _broken(self, attempted: str, error: OSError, answer: bytes = b"") -> InstrumentError:
        """Close the line, which broke, and return the error of that."""
        self._disconnect()
        text = answer.decode("ascii", "backslashreplace")
        only = f"only {shortened(text)!r} came and " if answer else ""
        return self._fault(
            attempted,
            f"{only}the line broke ({reason_of(error)})",
            "check that nobody else uses the instrument, its cable and its power",
            LineBroken,
        )

    def _silent(self, attempted: str, what: str, deadline_s: float) -> InstrumentError:
        came_back = f"{what} within {deadline_s:g} s"
        do_now = (
            f"{self._attachment.when_silent}; one that takes longer needs a `deadline` in the "
            "bench file"
        )
        return self._fault(attempted, came_back, do_now, InstrumentTimeout)

    def _wrong(self, attempted: str, came_back: str) -> InstrumentError:
        return self._fault(attempted, came_back, self._attachment.when_wrong)

    def _doubtful(self, attempted: str, came_back: str) -> InstrumentError:
        return self._fault(attempted, came_back, self._attachment.when_wrong, AnswerInDoubt)

    def _too_late(self, message: str) -> InstrumentError:
        return self._fault(
            f"send {shortened(message)!r} at its moment",
            "something lay on the line, and the moment is over now that it is empty",
            self._attachment.when_wrong,
            TooLate,
        )


class Patient:
    """A line each of whose questions has `patience`, whoever asks."""

    def __init__(self, line: ExchangeLine) -> None:
        self._line = line

    def __getattr__(self, name: str) -> Any:
        return patience()(getattr(self._line, name))


class Proof:
    """The proof that one line's answers are those to the questions asked.

    A line may be out of step: a stray line, a lost or doubled answer, a device that is some
    answers behind. Then each answer looks like one, and belongs to another question. Where a
    reading decides whether something is at rest, an identity is asked before, between and after
    the readings: no other question has that answer, so none of them can have moved.
    """

    def __init__(self, place: Place, line: ExchangeLine) -> None:
        self._place, self._line = place, line

    def in_step(self) -> bool:
        """Whether the line answers who is there with the identity, at once; never raises."""
        delays = self._line.delays
        with suppress(InstrumentError):
            return self._line.echoes_identity() and self._line.delays == delays
        return False

    def of(self, *readings: Callable[[], Any]) -> list[Any]:
        """Return what the readings bring, with two identities before and one after each of them.

        All are asked again, three times at most, where one of the identities is none or something
        came that was not asked for. Raises InstrumentError where that brings no proof.
        """
        failed: InstrumentError | None = None
        for _ in range(TRIES):
            results, doubts, failed = [], self._line.doubts, None
            try:
                # Twice, so that a line two answers behind meets an identity where a reading is due.
                in_step = self._line.echoes_identity() and self._line.echoes_identity()
                for read in readings if in_step else ():
                    results.append(read())
                    in_step = in_step and self._line.echoes_identity()
            except InstrumentError as error:
                in_step, failed = False, error
            if in_step and self._line.doubts == doubts:
                return results
            with suppress(InstrumentError):
                self._line.resynchronise()
        if failed is not None:
            raise failed
        raise InstrumentError(
            self._place.name,
            "asked who it is between readings, to prove that each is the answer to its question",
            "it answered with something else each time, so nothing that it reads back counts",
            "look at its display, switch it off by hand where it is on, then switch it off and on",
        )


def shortened(text: str, longest: int = 60) -> str:
    """Return `text`, its middle left out when it is long."""
    return text if len(text) <= longest else f"{text[: longest // 2]}…{text[-longest // 2 :]}"
